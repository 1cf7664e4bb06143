"""The archives that exports write: surfaces as STL, and lattices for Project Chrono."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._numpy import np
from ._optional import needed

if TYPE_CHECKING:
    from zipfile import ZipFile

    import pyvista
    from numpy.typing import NDArray

LATTICE = "ldpm-data-"


@dataclass(frozen=True)
class Lattice:
    """A lattice discrete particle model, as the export ``ldpm`` writes it for Project Chrono.

    All indices count from 0, and lengths are in mm.
    """

    summary: dict[str, Any] = field(repr=False)
    """Engine, options and figures of the lattice."""
    nodes: NDArray[np.float64] = field(repr=False)
    """The nodes, those of the surface first, then the grains: N x 3."""
    particles: NDArray[np.float64] = field(repr=False)
    """The grains: number, centre and diameter, M x 5."""
    tets: NDArray[np.int64] = field(repr=False)
    """The nodes of the tetrahedra: K x 4."""
    edges: NDArray[np.int64] = field(repr=False)
    """The nodes of the edges: L x 2."""
    facets: NDArray[np.float64] = field(repr=False)
    """The facets, twelve per tetrahedron, with the columns of the file ``ldpm-data-facets.dat``."""

    def __repr__(self) -> str:
        sizes = f"{len(self.nodes)} nodes, {len(self.tets)} tetrahedra, {len(self.facets)} facets"
        return f"<Lattice of {len(self.particles)} grains: {sizes}>"


def read(path: Path) -> Any:
    """Returns what an archive holds: a :class:`Lattice`, or the surfaces of each phase by its name."""
    from zipfile import BadZipFile, ZipFile

    try:
        with ZipFile(path) as archive:
            names = archive.namelist()
            if any(name.startswith(LATTICE) for name in names):
                return _lattice(archive)
            if names and all(name.endswith(".stl") for name in names):
                return _surfaces(archive)
    except BadZipFile as error:
        raise ValueError(f"{path.name} is damaged: {error}") from None
    if "deck.json" in names:
        raise ValueError(
            f"{path.name} is a deck of a solver: `packstone solve {path.name}` runs CalculiX on it; "
            "its mesh.inp is read by meshio.read"
        )
    if "microstructure.npy" in names:
        raise ValueError(f"{path.name} is a model for FANS: its make_h5.py writes what FANS reads; "
                         "its microstructure.npy is read by packstone.load and numpy.load")
    raise ValueError(f"{path.name} is an archive of {', '.join(names[:4]) or 'nothing'}: zipfile.ZipFile reads it")


def _surfaces(archive: ZipFile) -> dict[str, pyvista.PolyData]:
    import tempfile

    with needed("pyvista", "the surfaces of an archive"):
        import pyvista
    surfaces = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in archive.namelist():
            surface = pyvista.read(archive.extract(name, folder))
            assert isinstance(surface, pyvista.PolyData)
            surfaces[name.removesuffix(".stl")] = surface
    return surfaces


def _lattice(archive: ZipFile) -> Lattice:
    return Lattice(
        summary=json.loads(archive.read("summary.json")),
        nodes=_table(archive, "nodes", 3),
        particles=_table(archive, "particles", 5),
        tets=_table(archive, "tets", 4).astype(np.int64),
        edges=_table(archive, "edges", 2).astype(np.int64),
        facets=_table(archive, "facets", 19),
    )


def _table(archive: ZipFile, name: str, columns: int) -> NDArray[np.float64]:
    text = archive.read(f"{LATTICE}{name}.dat").decode()
    table = np.loadtxt(io.StringIO(text), comments="//", ndmin=2)
    return table.reshape(-1, columns)
