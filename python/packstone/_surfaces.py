"""Grains as points and surfaces of PyVista."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ._numpy import np

if TYPE_CHECKING:
    import pyvista
    from numpy.typing import NDArray


def points(grains: NDArray[np.float64]) -> pyvista.PolyData:
    """The centres with the point data ``diameter_mm``."""
    import pyvista

    centres = pyvista.PolyData(grains[:, :3].copy())
    centres.point_data["diameter_mm"] = grains[:, 3].copy()
    centres.set_active_scalars("diameter_mm")
    return centres


def spheres(grains: NDArray[np.float64], resolution: int) -> pyvista.PolyData:
    """The surfaces of spheres."""
    import pyvista

    geometry = _sphere(resolution)
    surfaces = points(grains).glyph(geom=geometry, scale="diameter_mm", orient=False)
    assert isinstance(surfaces, pyvista.PolyData)
    return surfaces


def ellipsoids(grains: NDArray[np.float64], columns: Sequence[str], resolution: int) -> pyvista.PolyData:
    """The surfaces of ellipsoids as images of a sphere of diameter 1; `columns` names the columns of the grains."""
    import pyvista

    def of(*names: str) -> NDArray[np.float64]:
        return grains[:, [columns.index(name) for name in names]]

    sphere = _sphere(resolution)
    center, axes = of("x_mm", "y_mm", "z_mm"), 2 * of("a_mm", "b_mm", "c_mm")
    turned = of("qw", "qx", "qy", "qz")
    w, x, y, z = (turned / np.linalg.norm(turned, axis=1, keepdims=True)).T
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    unit = np.asarray(sphere.points, dtype=np.float64)
    corners = np.einsum("ijn,nj,pj->npi", rotation, axes, unit) + center[:, None, :]
    faces = np.asarray(sphere.faces).reshape(-1, 4)
    offsets = np.arange(len(grains))[:, None, None] * len(unit)
    indices = faces[None, :, 1:] + offsets
    counted = np.concatenate([np.full((*indices.shape[:2], 1), 3), indices], axis=2)
    surfaces: pyvista.PolyData = pyvista.PolyData(corners.reshape(-1, 3), counted.reshape(-1))
    surfaces.point_data["diameter_mm"] = np.repeat(grains[:, 3], len(unit))
    surfaces.set_active_scalars("diameter_mm")
    return surfaces


def polyhedra(vtp: bytes) -> pyvista.PolyData:
    """The surfaces of a packing with polyhedra, of its file in the format ``vtp``."""
    import pyvista

    surfaces = read_vtk(vtp, "grains.vtp")
    assert isinstance(surfaces, pyvista.PolyData)
    surfaces.cell_data["diameter_mm"] = surfaces.cell_data.pop("diameter")
    surfaces.set_active_scalars("diameter_mm", preference="cell")
    return surfaces


def read_vtk(content: bytes, name: str) -> pyvista.DataSet:
    """The data of a file of VTK, whose `name` ends as its form does."""
    import pyvista

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / name
        file.write_bytes(content)
        read = pyvista.read(file)
    assert isinstance(read, pyvista.DataSet)
    return read


def _sphere(resolution: int) -> pyvista.PolyData:
    import pyvista

    return pyvista.Sphere(radius=0.5, theta_resolution=resolution, phi_resolution=resolution)
