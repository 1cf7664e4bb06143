"""What is made of a packing on the server: meshes, voxels, cuts, lattice models."""

from __future__ import annotations

import io
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from . import _files
from ._resource import Changing
from .errors import error_of

DerivedState = Literal["queued", "running", "succeeded", "failed"]


class Derived(Changing):
    """A model of a packing, as last seen; :meth:`refresh` and :meth:`wait` look again."""

    @property
    def type(self) -> str:
        """What it is, as ``msh`` or ``ldpm``."""
        return str(self.data["type"])

    @property
    def options(self) -> dict[str, Any]:
        """What was asked for, with what the server has filled in."""
        return dict(self.data["options"])

    @property
    def state(self) -> DerivedState:
        """Where it stands."""
        state: DerivedState = self.data["state"]
        return state

    @property
    def finished(self) -> bool:
        """Whether it is made, or failed, as last seen."""
        return self.state not in ("queued", "running")

    @property
    def succeeded(self) -> bool:
        """Whether its file is there, as last seen."""
        return self.state == "succeeded"

    @property
    def report(self) -> dict[str, Any]:
        """What is worth knowing about it; empty until it is made."""
        return dict(self.data["report"] or {})

    @property
    def error(self) -> dict[str, Any] | None:
        """The problem document that ended it, if one did."""
        error = self.data["error"]
        return None if error is None else dict(error)

    def save(self, path: str | PathLike[str], timeout: float | None = None) -> Path:
        """Writes the file, once it is made, and returns the path.

        A file of that name is replaced once the new one is whole. Raises :class:`PackstoneError` when it could
        not be made, and :class:`WaitTimeout` past `timeout` in s.
        """
        return _files.save(self._transport, self._file(timeout), Path(path))

    def read(self, timeout: float | None = None) -> bytes:
        """The content of the file, once it is made."""
        buffer = io.BytesIO()
        self._transport.download(self._file(timeout), buffer)
        return buffer.getvalue()

    def _file(self, timeout: float | None) -> str:
        self.wait(timeout)
        if self.error is not None:
            raise error_of(self.error)
        return str(self.data["links"]["file"])

    def __str__(self) -> str:
        words = f"{self.type} {self.id}: {self.state}"
        if self.state == "running" and self.progress:
            words += f", {self.progress['fraction']:.0%}"
        return words

    def __repr__(self) -> str:
        return f"<Derived {self.type} {self.id} {self.state}>"
