"""The packing that came out of a job."""

from __future__ import annotations

import io
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from ._transport import Transport, document

if TYPE_CHECKING:
    import pandas as pd

Format = Literal["json", "csv", "vtk", "vtp", "npy"]

COLUMNS = ("x_mm", "y_mm", "z_mm", "d_mm")


class Result:
    """A packing on the server; what is asked of it is fetched then."""

    def __init__(self, transport: Transport, job_path: str) -> None:
        self._transport = transport
        self._path = f"{job_path}/result"

    @cached_property
    def report(self) -> dict[str, Any]:
        """All but the spheres: request, engine, summary, timings, statistics, verification, curves."""
        return document(self._transport.request("GET", f"{self._path}/summary"))

    @property
    def summary(self) -> dict[str, Any]:
        """The figures people ask for first: grains, volume fractions, distance, size classes."""
        return dict(self.report["summary"])

    def to_numpy(self) -> NDArray[np.float64]:
        """The grains, largest first: an N x 4 array with the centre x, y, z and the diameter, in mm."""
        buffer = io.BytesIO()
        self._transport.download(self._path, buffer, params={"format": "npy"})
        buffer.seek(0)
        spheres: NDArray[np.float64] = np.load(buffer, allow_pickle=False)
        return spheres

    def to_dataframe(self) -> pd.DataFrame:
        """The grains as a table with the columns x_mm, y_mm, z_mm and d_mm; needs pandas."""
        import pandas as pd

        return pd.DataFrame(self.to_numpy(), columns=list(COLUMNS))

    def save(self, path: str | PathLike[str], format: Format | None = None) -> Path:
        """Writes the packing to a file, in the format of its suffix if none is named; returns the path.

        A file of that name is replaced once the new one is whole.
        """
        path = Path(path)
        named = format or path.suffix.removeprefix(".").lower()
        if named not in get_args(Format):
            known = ", ".join(get_args(Format))
            raise ValueError(f"{named!r} is no format of results: must be one of {known}")
        # Beside it, since only within one file system a file takes another's place at once.
        part = path.with_name(f".{path.name}.{uuid4().hex}.part")
        try:
            with part.open("xb") as sink:
                self._transport.download(self._path, sink, params={"format": named})
            part.replace(path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
        return path
