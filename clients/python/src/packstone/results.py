"""The packing of a job."""

from __future__ import annotations

import io
import json
import tempfile
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from . import _files, _html
from ._transport import Transport, document
from .errors import PackstoneError
from .exports import AMBIGUOUS_SUFFIXES, TYPE_OF_SUFFIX, parameters

if TYPE_CHECKING:
    import meshio
    import pandas as pd
    import pyvista

TableFormat = Literal["json", "csv", "npy", "vtp", "vtk", "view"]
FileFormat = Literal[TableFormat, "msh", "vti", "raw", "inp", "svg", "png"]

COLUMNS = ("x_mm", "y_mm", "z_mm", "d_mm")
"""Columns of spheres: centre and diameter."""

ELLIPSOID_COLUMNS = (*COLUMNS, "sieve_mm", "qw", "qx", "qy", "qz", "a_mm", "b_mm", "c_mm")
"""Columns of ellipsoids: those of the sphere of equal volume, sieve size, orientation quaternion, semi-axes."""

POLYHEDRON_COLUMNS = (*COLUMNS, "sieve_mm", "qw", "qx", "qy", "qz", "template")
"""Columns of polyhedra: those of the sphere of equal volume, sieve size, orientation quaternion, index of the template.
"""

MIXED_COLUMNS = (*ELLIPSOID_COLUMNS, "template")
"""Columns of ellipsoids and polyhedra in one packing: polyhedra have the semi-axes 0, ellipsoids the template -1."""

_COLUMNS_OF_WIDTH = {
    len(names): names for names in (COLUMNS, ELLIPSOID_COLUMNS, POLYHEDRON_COLUMNS, MIXED_COLUMNS)
}


class Result:
    """A packing on the server. Its parts are fetched when they are needed."""

    def __init__(self, transport: Transport, job_path: str, title: str) -> None:
        self._transport = transport
        self._job_path = job_path
        self._title = title

    @cached_property
    def report(self) -> dict[str, Any]:
        """Everything but the grains: request, engine, summary, timings, statistics, check, curves."""
        return document(self._transport.request("GET", f"{self._job_path}/result/summary"))

    @property
    def summary(self) -> dict[str, Any]:
        """The main figures: grains, volume fractions, distance, size classes."""
        return dict(self.report["summary"])

    def to_numpy(self) -> NDArray[np.float64]:
        """Returns the grains, largest first: an N x 4 array of the centre x, y, z and the diameter, in mm.

        Ellipsoids have the columns ``ELLIPSOID_COLUMNS``, polyhedra ``POLYHEDRON_COLUMNS``, packings of both
        ``MIXED_COLUMNS``. Of a mix of several aggregates the last column is ``aggregate``, their index from 0.
        """
        grains: NDArray[np.float64] = np.load(io.BytesIO(self.read("npy")), allow_pickle=False)
        return grains

    def to_dataframe(self) -> pd.DataFrame:
        """Returns the grains as a table with the columns x_mm, y_mm, z_mm and d_mm. Needs pandas.

        Ellipsoids have the columns ``ELLIPSOID_COLUMNS``, polyhedra ``POLYHEDRON_COLUMNS``, packings of both
        ``MIXED_COLUMNS``. Of a mix of several aggregates the last column is ``aggregate``, their index from 0.
        """
        import pandas as pd

        grains = self.to_numpy()
        aggregate = ("aggregate",) if self.summary.get("aggregates") else ()
        names = _COLUMNS_OF_WIDTH[grains.shape[1] - len(aggregate)]
        return pd.DataFrame(grains, columns=[*names, *aggregate])

    def templates(self) -> list[dict[str, Any]]:
        """Returns the templates that the column ``template`` of polyhedra counts from 0; an empty list of other grains.

        Each has ``vertices`` and ``faces`` of its core, ``rounding``, and derived figures, all in equivalent diameters.
        """
        return list(json.loads(self.read("json")).get("templates", []))

    def to_pyvista(self, *, spheres: bool = False, resolution: int = 16) -> pyvista.PolyData:
        """Returns the centres with the point data ``diameter_mm``, as PyVista's points. Needs pyvista.

        With `spheres` it returns the surfaces of the grains, each of `resolution` segments, ellipsoids too; packings
        with polyhedra have faces as polygons, with cell data in place of point data:
        ``to_pyvista(spheres=True).plot()``.
        """
        import pyvista

        grains = self.to_numpy()
        points = pyvista.PolyData(grains[:, :3].copy())
        points.point_data["diameter_mm"] = grains[:, 3]
        points.set_active_scalars("diameter_mm")
        if not spheres:
            return points
        if grains.shape[1] in (len(POLYHEDRON_COLUMNS), len(MIXED_COLUMNS)):
            return _polyhedra(self.read("vtp"))
        sphere = pyvista.Sphere(radius=0.5, theta_resolution=resolution, phi_resolution=resolution)
        if grains.shape[1] == len(ELLIPSOID_COLUMNS):
            return _ellipsoids(grains, sphere)
        surfaces: pyvista.PolyData = points.glyph(geom=sphere, scale="diameter_mm", orient=False)
        return surfaces

    def to_meshio(self) -> meshio.Mesh:
        """Returns the centres as vertices with the point data ``diameter_mm``. Needs meshio.

        For surfaces save a mesh: ``save("a.msh")`` writes a file that meshio reads.
        """
        import meshio

        grains = self.to_numpy()
        cells = [("vertex", np.arange(len(grains)).reshape(-1, 1))]
        return meshio.Mesh(grains[:, :3], cells, point_data={"diameter_mm": grains[:, 3]})

    def read(self, format: FileFormat, *, timeout: float | None = None, **options: Any) -> bytes:
        """Returns the packing in a file format, as :meth:`save` writes it."""
        buffer = io.BytesIO()
        address, params = self._address(format, options)
        self._transport.download(address, buffer, params=params, timeout=timeout)
        return buffer.getvalue()

    def save(
        self,
        path: str | PathLike[str],
        format: FileFormat | None = None,
        *,
        timeout: float | None = None,
        **options: Any,
    ) -> Path:
        """Writes the packing to a file and returns the path.

        The format is that of the suffix if it is not named: the grains as ``json``, ``csv``, ``npy``, ``vtp``,
        ``vtk`` or ``view``; or an export, as ``msh``, ``vti``, ``raw``, ``inp``, ``svg`` or ``png``. Exports have options, as
        ``save("a.msh", segments=24)``. The server makes them when they are first needed, and this waits for
        it, at most `timeout` in s. Missing folders are created, and a file of the same name is replaced.
        """
        address, params = self._address(format or Path(path).suffix.removeprefix(".").lower(), options)
        return _files.save(self._transport, address, path, params, timeout)

    def _address(self, format: str, options: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        check_format(format)
        if format not in TYPE_OF_SUFFIX:
            return f"{self._job_path}/result", {"format": format, **options}
        return f"{self._job_path}/exports/{TYPE_OF_SUFFIX[format]}", {"format": format, **parameters(options)}

    def __repr__(self) -> str:
        return f"<Result of {self._title}>"

    def _repr_png_(self) -> bytes | None:
        """A cross-section through the middle; `None` if the server does not give one."""
        try:
            return self.read("png", timeout=10, pixels=480)
        except PackstoneError:
            return None

    def _repr_html_(self) -> str:
        rows = {name: value for name, value in self.summary.items() if not isinstance(value, (dict, list))}
        return _html.card(f"Result of {self._title}", rows, png=self._repr_png_())


def _ellipsoids(grains: NDArray[np.float64], sphere: pyvista.PolyData) -> pyvista.PolyData:
    """The surfaces of ellipsoids as images of a sphere of diameter 1."""
    import pyvista

    center, axes = grains[:, :3], 2 * grains[:, 9:12]
    w, x, y, z = (grains[:, 5:9] / np.linalg.norm(grains[:, 5:9], axis=1, keepdims=True)).T
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    unit = np.asarray(sphere.points, dtype=np.float64)
    points = np.einsum("ijn,nj,pj->npi", rotation, axes, unit) + center[:, None, :]
    faces = np.asarray(sphere.faces).reshape(-1, 4)
    offsets = np.arange(len(grains))[:, None, None] * len(unit)
    corners = faces[None, :, 1:] + offsets
    counted = np.concatenate([np.full((*corners.shape[:2], 1), 3), corners], axis=2)
    surfaces: pyvista.PolyData = pyvista.PolyData(points.reshape(-1, 3), counted.reshape(-1))
    surfaces.point_data["diameter_mm"] = np.repeat(grains[:, 3], len(unit))
    surfaces.set_active_scalars("diameter_mm")
    return surfaces


def _polyhedra(vtp: bytes) -> pyvista.PolyData:
    """The surfaces of a packing with polyhedra as the server writes them."""
    import pyvista

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "grains.vtp"
        file.write_bytes(vtp)
        surfaces: pyvista.PolyData = pyvista.PolyData(str(file))
    surfaces.cell_data["diameter_mm"] = surfaces.cell_data.pop("diameter")
    surfaces.set_active_scalars("diameter_mm", preference="cell")
    return surfaces


def check_format(format: str) -> None:
    """Raises a `ValueError` if a format is unknown or does not name one file."""
    known = [*get_args(TableFormat), *TYPE_OF_SUFFIX]
    if format in AMBIGUOUS_SUFFIXES:
        raise ValueError(
            f"{format!r} does not name one export: use job.export(type, format=...).save(path), "
            'as job.export("mesh", format="stl").save("surfaces.zip")'
        )
    if format not in known:
        raise ValueError(f"{format!r} is not a format of results: must be one of {', '.join(known)}")
