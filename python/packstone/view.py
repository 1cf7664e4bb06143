"""The viewer of a packing as HTML for notebooks."""

from __future__ import annotations

from html import escape
from os import PathLike
from pathlib import Path

from . import _files

# The page runs its scripts and saves pictures, and has no access to the notebook around it.
SANDBOX = "allow-scripts allow-downloads"


class View:
    """The page of a packing with its viewer, which notebooks show in a frame."""

    def __init__(self, page: str, height_px: int, png: bytes | None = None) -> None:
        self.page = page
        """The page as HTML, a document of its own."""
        self.height_px = height_px
        """The height of the frame."""
        self._png = png

    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> Path:
        """Writes the page to a file and returns its path. Missing folders are created.

        Raises `FileExistsError` if the file exists, unless `overwrite`.
        """
        _files.refuse_existing(path, overwrite)
        return _files.write(path, self.page.encode())

    def _repr_html_(self) -> str:
        style = f"width: 100%; height: {self.height_px}px; border: 0"
        return f'<iframe title="Packing" sandbox="{SANDBOX}" style="{style}" srcdoc="{escape(self.page)}"></iframe>'

    def _repr_png_(self) -> bytes | None:
        """What is shown of a saved notebook where pages cannot run."""
        return self._png

    def __repr__(self) -> str:
        return f"<View of {len(self.page)} characters of HTML>"
