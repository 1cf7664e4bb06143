"""Plots that the server draws."""

from __future__ import annotations

from os import PathLike
from pathlib import Path


class Svg(str):
    """A plot as SVG text, which notebooks show as the picture."""

    __slots__ = ()

    def save(self, path: str | PathLike[str]) -> Path:
        """Writes the plot to a file, and returns its path."""
        path = Path(path)
        path.write_text(self, encoding="utf-8")
        return path

    def _repr_svg_(self) -> str:
        return str(self)
