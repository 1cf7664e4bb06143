"""Exports of a packing: meshes, voxel models, cross-sections and lattice models."""

from __future__ import annotations

import io
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from . import _files, _html, _warnings
from ._resource import Changing
from .errors import error_of
from .options import ExportType

ExportState = Literal["queued", "running", "succeeded", "failed"]

# The suffixes that name one export and its format.
TYPE_OF_SUFFIX: dict[str, ExportType] = {
    "msh": "mesh",
    "vti": "voxels",
    "raw": "voxels",
    "svg": "slice",
    "png": "slice",
}
# The suffixes of exports that name more than one of them, or an archive of several files, with their types.
AMBIGUOUS_SUFFIXES: dict[str, tuple[ExportType, ...]] = {
    "geo": ("mesh", "slice"),
    "inp": ("mesh", "voxels", "slice"),
    "stl": ("mesh",),
    "zip": ("mesh", "voxels", "deck", "ldpm"),
}


class Export(Changing):
    """An export of a packing as it was when it was last read; :meth:`refresh` and :meth:`wait` read it again."""

    @property
    def type(self) -> ExportType:
        """The type: ``mesh``, ``voxels``, ``slice``, ``deck``, ``ldpm``, ``certificates``, ``shapes``, ``quality`` or
        ``properties``."""
        type: ExportType = self.data["type"]
        return type

    @property
    def format(self) -> str:
        """The file format."""
        return str(self.data.get("format") or self.options["format"])

    @property
    def options(self) -> dict[str, Any]:
        """The options with the defaults filled in."""
        return dict(self.data["options"])

    @property
    def state(self) -> ExportState:
        """The state: ``queued``, ``running``, ``succeeded`` or ``failed``."""
        state: ExportState = self.data["state"]
        return state

    @property
    def finished(self) -> bool:
        """Whether the file is made, or could not be made."""
        return self.state not in ("queued", "running")

    @property
    def succeeded(self) -> bool:
        """Whether the file is made."""
        return self.state == "succeeded"

    @property
    def kept(self) -> bool:
        """Whether the file stays with the job. Other files are a cache that the server may remove."""
        return bool(self.data["kept"])

    @property
    def report(self) -> dict[str, Any]:
        """Figures of the file, such as its number of triangles; empty until it is made."""
        return dict(self.data["report"] or {})

    @property
    def warnings(self) -> list[str]:
        """What is doubtful about the file, one sentence each; empty until it is made."""
        return _warnings.texts(self.report)

    @property
    def error(self) -> dict[str, Any] | None:
        """The problem document if the file could not be made."""
        error = self.data["error"]
        return None if error is None else dict(error)

    def save(self, path: str | PathLike[str], timeout: float | None = None, *, overwrite: bool = False) -> Path:
        """Writes the file when it is made, and returns the path.

        Missing folders are created. Beside a mesh for Gmsh its script is written, as :meth:`Packing.save` does.

        Parameters
        ----------
        path
            The file.
        timeout
            Longest wait in s.
        overwrite
            Whether a file of the same name is replaced.

        Raises
        ------
        FileExistsError
            If the file exists.
        PackstoneError
            If the file could not be made; :class:`WaitTimeout` after `timeout`.
        """
        _files.refuse_existing(path, overwrite)
        saved = _files.save(self._transport, self._file(timeout), path)
        _files.write_companion(saved, self.type, self.options)
        return saved

    def read(self, timeout: float | None = None) -> bytes:
        """Returns the content of the file when it is made."""
        buffer = io.BytesIO()
        self._transport.download(self._file(timeout), buffer)
        return buffer.getvalue()

    def delete(self) -> None:
        """Removes the file from the server. An export that is being made is cancelled."""
        self._transport.request("DELETE", str(self.data["links"]["file"]))

    def _file(self, timeout: float | None) -> str:
        self.wait(timeout)
        if self.error is not None:
            raise error_of(self.error)
        return str(self.data["links"]["file"])

    @property
    def _title(self) -> str:
        return f"{self.type} ({self.format})"

    def _state_words(self) -> str:
        return self.state

    def __str__(self) -> str:
        words = f"{self._title} of job {self.data['job_id']}: {self.state}"
        if self.state == "running" and self.progress:
            words += f", {self.fraction:.0%}"
        return words

    def __repr__(self) -> str:
        return f"<Export {self.type} {self.format} {self.state}>"

    def _repr_html_(self) -> str:
        rows = {"state": self.state, "job": self.data["job_id"], **self.options, **self.report}
        plain = {name: value for name, value in rows.items() if not isinstance(value, (dict, list))}
        return _html.card(self._title, plain, bar=None if self.finished else self.fraction)
