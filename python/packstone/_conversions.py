"""A packing as arrays of voxels, as pairs of neighbours, and in the terms of other libraries."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args, overload

from ._grain_arrays import GrainArrays
from ._numpy import np
from ._optional import needed
from ._sources import File
from .errors import invalid

if TYPE_CHECKING:
    import meshio
    import pyvista
    import trimesh
    from numpy.typing import NDArray
    from typing_extensions import Unpack

    from .options import SurfaceOptions

PyVistaKind = Literal["points", "surfaces", "voxels", "mesh"]


@dataclass(frozen=True)
class Neighbours:
    """Pairs of grains, and grains and walls, whose surfaces are close to one another. Lengths are in mm."""

    closer_than_mm: float
    """The gap below which pairs are listed."""
    pairs: NDArray[np.int64] = field(repr=False)
    """The indices of the two grains of each pair: M x 2."""
    gaps_mm: NDArray[np.float64] = field(repr=False)
    """The gap of each pair, from surface to surface, measured along its normal."""
    normals: NDArray[np.float64] = field(repr=False)
    """The unit vector of each pair that separates both grains, from the first to the second: M x 3."""
    images: NDArray[np.int64] = field(repr=False)
    """The periodic image of the second grain, in edges of the specimen: M x 3."""
    at_walls: NDArray[np.int64] = field(repr=False)
    """The indices of the grains near a wall."""
    wall_gaps_mm: NDArray[np.float64] = field(repr=False)
    """The gap of each of these from its wall."""
    wall_normals: NDArray[np.float64] = field(repr=False)
    """The unit vector of each of these towards its wall."""

    def __len__(self) -> int:
        return len(self.pairs)

    def __repr__(self) -> str:
        walls = f"{len(self.at_walls)} at walls"
        return f"<Neighbours closer than {self.closer_than_mm:.4g} mm: {len(self.pairs)} pairs, {walls}>"

    def counts(self, grains: int) -> NDArray[np.int64]:
        """Returns the number of neighbours of each grain, of a packing with that number of `grains`."""
        return np.bincount(self.pairs.ravel(), minlength=grains)


class Conversions(GrainArrays):
    """What a :class:`Packing` becomes in other libraries."""

    def voxels(
        self,
        cells: int | None = None,
        *,
        voxel_mm: float | None = None,
        label: Literal["phase", "grain"] | None = None,
        timeout: float | None = None,
    ) -> NDArray[Any]:
        """Returns the labels of voxels as an array, whose indices count along x, y and z.

        Parameters
        ----------
        cells
            Voxels along the longest edge of the specimen, 100 if neither this nor `voxel_mm` is given.
        voxel_mm
            The edge of a voxel in mm.
        label
            ``phase`` (the default): 0 in the matrix and 1 in a grain. ``grain``: the number of the grain from 1.
        timeout
            Longest wait for a server in s.

        Returns
        -------
        numpy.ndarray
            The labels, in three dimensions.

        Examples
        --------
        >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
        >>> packing.voxels(20).shape
        (20, 20, 20)
        """
        given = {"cells": cells, "voxel_mm": voxel_mm, "label": label}
        options = {name: value for name, value in given.items() if value is not None}
        content = io.BytesIO(self._source.read(File("npy", "voxels", options), timeout))
        labels: NDArray[Any] = np.load(content, allow_pickle=False)
        return labels

    def neighbours(self, closer_than_mm: float | None = None, *, timeout: float | None = None) -> Neighbours:
        """Returns the pairs of grains, and of grains and walls, whose gap is small.

        The engine certifies each: the plane of its normal separates both bodies by at least the gap.

        Parameters
        ----------
        closer_than_mm
            The gap below which pairs are listed: a tenth of the smallest diameter beyond the required distance if it is
            not given.
        timeout
            Longest wait for a server in s.

        Examples
        --------
        >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.3, d_min_mm=4), distance=0.2, seed=1)
        >>> near = packing.neighbours(1.0)
        >>> bool((near.gaps_mm >= 0.2).all())
        True
        """
        options = {} if closer_than_mm is None else {"closer_than_mm": closer_than_mm}
        listed = json.loads(self._source.read(File("json", "certificates", options), timeout))
        columns = listed["columns"]
        rows = np.array(listed["rows"], dtype=np.float64).reshape(-1, len(columns))

        def of(which: NDArray[np.bool_], *names: str) -> NDArray[np.float64]:
            return rows[which][:, [columns.index(name) for name in names]]

        walls = rows[:, columns.index("second")] < 0
        image, normal = ("image_x", "image_y", "image_z"), ("normal_x", "normal_y", "normal_z")
        return Neighbours(
            closer_than_mm=float(listed["closer_than_mm"]),
            pairs=of(~walls, "first", "second").astype(np.int64),
            gaps_mm=of(~walls, "separation_mm")[:, 0],
            normals=of(~walls, *normal),
            images=of(~walls, *image).astype(np.int64),
            at_walls=of(walls, "first")[:, 0].astype(np.int64),
            wall_gaps_mm=of(walls, "separation_mm")[:, 0],
            wall_normals=of(walls, *normal),
        )

    @overload
    def to_pyvista(
        self, kind: Literal["points", "surfaces"] = "points", *, resolution: int = 16
    ) -> pyvista.PolyData: ...
    @overload
    def to_pyvista(self, kind: Literal["voxels"], *, cells: int | None = None) -> pyvista.ImageData: ...
    @overload
    def to_pyvista(
        self, kind: Literal["mesh"], **options: Unpack[SurfaceOptions]
    ) -> pyvista.UnstructuredGrid: ...
    def to_pyvista(self, kind: PyVistaKind = "points", **options: Any) -> Any:
        """Returns the packing as an object of PyVista. Needs pyvista.

        Parameters
        ----------
        kind
            ``points``: the centres, with the point data ``diameter_mm``.
            ``surfaces``: the surfaces of the grains, each of `resolution` segments (16), with the point data
            ``diameter_mm``, or the cell data ``diameter_mm`` where grains are polyhedra.
            ``voxels``: the labels of :meth:`voxels`, with `cells` along the longest edge, as the cell data of an image.
            ``mesh``: the surface mesh of the specimen and its grains, as :meth:`to_meshio` with its options.
        **options
            `resolution`, `cells`, or the options of the mesh, as the kind has them.

        Examples
        --------
        >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
        >>> packing.to_pyvista().n_points == len(packing)
        True
        >>> packing.to_pyvista("voxels", cells=20).dimensions
        (21, 21, 21)
        """
        from . import _surfaces

        if kind not in get_args(PyVistaKind):
            raise invalid("kind", f"{kind!r} is unknown: must be one of {', '.join(get_args(PyVistaKind))}")
        with needed("pyvista", "to_pyvista()", "packstone[pyvista]"):
            import pyvista
        if kind == "mesh":
            return pyvista.from_meshio(self.to_meshio(**options))
        if kind == "voxels":
            content = self._source.read(File("vti", "voxels", options), None)
            return _surfaces.read_vtk(content, "voxels.vti")
        if kind == "points":
            return _surfaces.points(self.grains)
        resolution = int(options.get("resolution", 16))
        if "template" in self.columns:
            return _surfaces.polyhedra(self._source.read(File("vtp", None, {}), None))
        if "a_mm" in self.columns:
            return _surfaces.ellipsoids(self.grains, self.columns, resolution)
        return _surfaces.spheres(self.grains, resolution)

    def to_trimesh(self, *, timeout: float | None = None, **options: Unpack[SurfaceOptions]) -> trimesh.Trimesh:
        """Returns the surface of all grains as one mesh of trimesh. Needs trimesh.

        ``split()`` of the mesh gives the grains.

        Parameters
        ----------
        timeout
            Longest wait for a server in s.
        **options
            The options of the export ``mesh``, such as `segments`.

        Examples
        --------
        >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
        >>> packing.to_trimesh(segments=8).is_watertight
        True
        """
        with needed("trimesh", "to_trimesh()", "packstone[trimesh]"):
            import trimesh
        from zipfile import ZipFile

        content = self._source.read(File("stl", "mesh", options), timeout)
        with ZipFile(io.BytesIO(content)) as archive, archive.open("aggregates.stl") as surfaces:
            loaded = trimesh.load_mesh(io.BytesIO(surfaces.read()), file_type="stl")
        assert isinstance(loaded, trimesh.Trimesh)
        return loaded

    def to_meshio(self, *, timeout: float | None = None, **options: Unpack[SurfaceOptions]) -> meshio.Mesh:
        """Returns the surface mesh of the specimen and its grains as a mesh of meshio. Needs meshio.

        Parameters
        ----------
        timeout
            Longest wait for a server in s.
        **options
            The options of the export ``mesh``, such as `segments`.

        Returns
        -------
        meshio.Mesh
            Triangles in the groups of ``save("a.msh")``: ``aggregates``, ``matrix`` and the faces of the specimen.

        Examples
        --------
        >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
        >>> "aggregates" in packing.to_meshio(segments=8).cell_sets
        True
        """
        import tempfile

        with needed("meshio", "to_meshio()", "packstone[meshio]"):
            import meshio
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "mesh.msh"
            path.write_bytes(self._source.read(File("msh", "mesh", options), timeout))
            return meshio.read(path)
