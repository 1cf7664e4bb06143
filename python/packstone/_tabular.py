"""A packing that was read from a table: it has its grains alone."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from ._numpy import np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ._sources import File, PackingPlotKind, Theme
    from .options import ExportType

SPHERES = ("x_mm", "y_mm", "z_mm", "d_mm")
"""Columns of spheres: centre and diameter."""

ELLIPSOIDS = (*SPHERES, "sieve_mm", "qw", "qx", "qy", "qz", "a_mm", "b_mm", "c_mm")
"""Columns of ellipsoids: those of the sphere of equal volume, sieve size, orientation quaternion, semi-axes."""

POLYHEDRA = (*SPHERES, "sieve_mm", "qw", "qx", "qy", "qz", "template")
"""Columns of polyhedra: those of the sphere of equal volume, sieve size, orientation quaternion, index of the template.
"""

MIXED = (*ELLIPSOIDS, "template")
"""Columns of ellipsoids and polyhedra in one packing: polyhedra have the semi-axes 0, ellipsoids the template -1."""

INDICES = ("template", "aggregate")
"""The columns of whole numbers."""


def columns_of(grains: NDArray[np.float64]) -> tuple[str, ...] | None:
    """Returns the names of the columns of a table without a header, or `None` if it is no table of grains."""
    number = grains.shape[1]
    for columns in (SPHERES, POLYHEDRA, ELLIPSOIDS, MIXED):
        if number == len(columns) + 1 and not (columns == ELLIPSOIDS and _has_templates(grains)):
            return (*columns, "aggregate")
        if number == len(columns):
            return columns
    return None


def _has_templates(grains: NDArray[np.float64]) -> bool:
    """Whether the last column is that of templates: ellipsoids have -1 there, and polyhedra have no semi-axes."""
    return bool((grains[:, -1] < 0).any() or (grains[:, ELLIPSOIDS.index("a_mm")] == 0).any())


class Tabular:
    """A source of :class:`Packing`: the grains that a table had."""

    def __init__(self, path: Path, columns: Sequence[str], grains: NDArray[np.float64]) -> None:
        self._path, self._columns, self._grains = path, tuple(columns), grains

    @property
    def title(self) -> str:
        """The number of grains and the file."""
        return f"{len(self._grains)} grains of {self._path.name}"

    def count(self) -> int:
        """The number of grains."""
        return len(self._grains)

    def in_memory(self) -> Tabular:
        """This packing."""
        return self

    def report(self) -> dict[str, Any]:
        """A table has none."""
        self._lacks("figures")

    def request(self) -> dict[str, Any]:
        """A table has none."""
        self._lacks("its request")

    def columns(self) -> tuple[str, ...]:
        """The names of the columns of the grains."""
        return self._columns

    def grains(self) -> NDArray[np.float64]:
        """The grains as an array of their own."""
        return self._grains.copy()

    def read(self, file: File, timeout: float | None) -> bytes:
        """The grains as a table again."""
        if file.format == "npy" and file.type is None:
            content = io.BytesIO()
            np.save(content, self._grains)
            return content.getvalue()
        if file.format == "csv" and file.type is None:
            whole = [column in INDICES for column in self._columns]
            rows = [",".join(_text(*of) for of in zip(row, whole, strict=True)) for row in self._grains.tolist()]
            return "\n".join([",".join(self._columns), *rows, ""]).encode()
        needs = f"format {file.format}" if file.type is None else f"export {file.type}"
        self._lacks(f"the specimen, which the {needs} needs")

    def save(self, file: File, path: Path, timeout: float | None) -> None:
        """Writes the grains as a table again."""
        content = self.read(file, timeout)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)

    def export(
        self, type: ExportType, options: Mapping[str, Any], path: Path, timeout: float | None
    ) -> dict[str, Any]:
        """Exports need the specimen."""
        self._lacks(f"the specimen, which the export {type} needs")

    def plot(self, kind: PackingPlotKind, title: bool, theme: Theme) -> str:
        """Plots need the figures."""
        self._lacks(f"the figures that the plot {kind} needs")

    def picture(self, pixels: int) -> bytes:
        """Raises a `ValueError`."""
        self._lacks("the specimen that a picture needs")

    def _lacks(self, what: str) -> NoReturn:
        table = f"{self._path.stem}.csv"
        saved = "" if self._path.suffix.lower() == ".csv" else f' save("{table}") and'
        raise ValueError(
            f"{self._path.name} is a table of grains, without {what}: load the result as JSON, or{saved} run "
            f"`packstone export {table} --specimen JOB.json ...` with its job"
        )


def _text(value: float, is_index: bool) -> str:
    return str(int(value)) if is_index else repr(value)
