"""The packing that came out of a job."""

from __future__ import annotations

import io
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from . import _files
from ._transport import Transport, document

if TYPE_CHECKING:
    import pandas as pd

Format = Literal["json", "csv", "vtk", "vtp", "npy"]
ModelFormat = Literal["msh", "geo", "stl", "vti", "raw", "inp", "ldpm"]
# Models that are one zip of several files.
ARCHIVES = ("stl", "ldpm")

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

    def read(self, format: Format | ModelFormat, **options: Any) -> bytes:
        """The packing in a format; those that are models of it have options, as ``read("raw", cells=200)``."""
        buffer = io.BytesIO()
        self._transport.download(self._path, buffer, params=_params(format, options))
        return buffer.getvalue()

    def save(
        self, path: str | PathLike[str], format: Format | ModelFormat | None = None, **options: Any
    ) -> Path:
        """Writes the packing to a file, in the format of its suffix if none is named; returns the path.

        Formats that are models of the packing have options, as ``save("a.msh", segments=24)``; they are made
        when they are first asked for, which is waited for. A file of that name is replaced once the new one is
        whole.
        """
        path = Path(path)
        named = format or path.suffix.removeprefix(".").lower()
        known = [*get_args(Format), *get_args(ModelFormat)]
        # The models of the rest come as archives, whatever the name of the file.
        known = known if format else [name for name in known if name not in ARCHIVES]
        if named not in known:
            raise ValueError(f"{named!r} is no format of results: must be one of {', '.join(known)}")
        return _files.save(self._transport, self._path, path, _params(named, options))


def _params(format: str, options: dict[str, Any]) -> dict[str, Any]:
    # As the server spells them.
    plain = {name: str(value).lower() if isinstance(value, bool) else value for name, value in options.items()}
    return {"format": format, **plain}
