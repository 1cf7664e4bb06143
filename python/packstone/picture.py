"""Pictures as PNG."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from . import _files


class Picture(bytes):
    """A picture as the bytes of a PNG. Notebooks show it, and keep it where they are saved."""

    __slots__ = ()

    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> Path:
        """Writes the picture to a file and returns its path. Missing folders are created.

        Raises `FileExistsError` if the file exists, unless `overwrite`.
        """
        _files.refuse_existing(path, overwrite)
        return _files.write(path, self)

    def _repr_png_(self) -> bytes:
        return bytes(self)

    def __repr__(self) -> str:
        return f"<Picture of {len(self)} bytes of PNG>"
