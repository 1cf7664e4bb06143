"""Where a packing is, and the forms in which it is read and saved."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, get_args

from ._requests import named
from .errors import invalid
from .exports import AMBIGUOUS_SUFFIXES, TYPE_OF_SUFFIX
from .options import ExportType, check_options

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

TableFormat = Literal["json", "csv", "npy", "vtp", "vtk", "view", "html"]
FileFormat = Literal[TableFormat, "msh", "vti", "raw", "svg", "png"]
PackingPlotKind = Literal["grading", "distance", "radial", "profile", "zingg", "flakiness", "quality"]
PACKING_PLOT_KINDS: tuple[PackingPlotKind, ...] = get_args(PackingPlotKind)
Theme = Literal["light", "dark"]


class File(NamedTuple):
    """A file of a packing: its grains in a format, or an export with its options."""

    format: str
    type: ExportType | None
    """The type of the export; `None` for the grains."""
    options: Mapping[str, Any]


class Source(Protocol):
    """Where a packing is: in this process, on a server, or in a table of grains."""

    @property
    def title(self) -> str:
        """What was packed, for a message or a heading."""
        ...

    def count(self) -> int:
        """The number of grains."""
        ...

    def report(self) -> dict[str, Any]:
        """The result without its grains and its request."""
        ...

    def request(self) -> dict[str, Any]:
        """The request with the defaults filled in."""
        ...

    def columns(self) -> tuple[str, ...]:
        """The names of the columns of the grains."""
        ...

    def grains(self) -> NDArray[np.float64]:
        """The grains as an array of their own."""
        ...

    def read(self, file: File, timeout: float | None) -> bytes:
        """The content of a file."""
        ...

    def save(self, file: File, path: Path, timeout: float | None) -> None:
        """Writes a file as a whole or not at all."""
        ...

    def export(
        self, type: ExportType, options: Mapping[str, Any], path: Path, timeout: float | None
    ) -> dict[str, Any]:
        """Writes an export and returns its figures."""
        ...

    def plot(self, kind: PackingPlotKind, title: bool, theme: Theme) -> str:
        """A plot as SVG."""
        ...

    def picture(self, pixels: int) -> bytes:
        """A picture with one octant removed, as PNG."""
        ...

    def in_memory(self) -> Source:
        """The same packing with its grains, in the memory of this process and without a server."""
        ...


def check_format(format: str) -> None:
    """Raises a `ValueError` if a format is unknown or does not name one file."""
    known = [*get_args(TableFormat), *TYPE_OF_SUFFIX]
    if format in AMBIGUOUS_SUFFIXES:
        types = " or ".join(AMBIGUOUS_SUFFIXES[format])
        raise ValueError(
            f"{format!r} does not name one export: use export(type, path, format=...), "
            f'as packing.export("{AMBIGUOUS_SUFFIXES[format][0]}", ...); the type is {types}'
        )
    if format not in known:
        raise ValueError(f"{format!r} is not a format of packings: must be one of {', '.join(known)}")


def file_of(format: str, options: Mapping[str, Any]) -> File:
    """The file of a format, with the options of the export that it is."""
    check_format(format)
    type = TYPE_OF_SUFFIX.get(format)
    if type is None and options:
        raise invalid(next(iter(options)), f"the format {format!r} has no options")
    if type is not None:
        check_options(type, options)
    return File(format, type, named(options))
