"""Plots as SVG."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from . import _files


class Svg(str):
    """A plot as SVG text. Notebooks show the picture."""

    __slots__ = ()

    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> Path:
        """Writes the plot to a file and returns its path. Missing folders are created.

        Raises `FileExistsError` if the file exists, unless `overwrite`.
        """
        _files.refuse_existing(path, overwrite)
        return _files.write(path, self.encode())

    def _repr_svg_(self) -> str:
        return str(self)
