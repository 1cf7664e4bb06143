"""A packing, made in this process or by a service."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cached_property
from importlib.util import find_spec
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, get_args

from . import _files, _html
from ._requests import named
from .errors import PackstoneError
from .exports import AMBIGUOUS_SUFFIXES, TYPE_OF_SUFFIX, ExportFormat, ExportType
from .svg import Svg
from .view import View

if TYPE_CHECKING:
    import meshio
    import numpy as np
    import pandas as pd
    import pyvista
    from numpy.typing import NDArray

    from .jupyter import Viewer

TableFormat = Literal["json", "csv", "npy", "vtp", "vtk", "view", "html"]
FileFormat = Literal[TableFormat, "msh", "vti", "raw", "inp", "svg", "png"]
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
    """Where a packing is: in this process or on a server."""

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


class Packing:
    """A packing, which :func:`pack` makes in this process and :meth:`Job.result` returns from a service.

    Of a service the parts are fetched when they are needed. A packing can be pickled.
    """

    def __init__(self, source: Source) -> None:
        self._source = source

    @cached_property
    def report(self) -> dict[str, Any]:
        """Everything but grains and request: engine, summary, timings, statistics, check, curves, warnings."""
        return self._source.report()

    @property
    def summary(self) -> dict[str, Any]:
        """The main figures: grains, volume fractions, distance, size classes."""
        return dict(self.report["summary"])

    @property
    def partial(self) -> dict[str, Any] | None:
        """How far the run came, if it ended before its target and its packing was kept, else `None`.

        It has ``reason`` (``time_limit``, ``event_limit``, ``stalled``, ``saturated``, ``timed_out`` or ``finished``),
        ``volume_fraction_requested`` and ``_reached``, ``distance_mm_requested`` and ``_reached``, ``size_scale`` (the
        factor on the sizes of all grains), ``grains_requested`` and ``grains_placed``.
        """
        partial = self.summary.get("partial")
        return None if partial is None else dict(partial)

    @property
    def check(self) -> dict[str, Any]:
        """What the independent check of the packing found: smallest gaps in mm, greatest error of a size class."""
        return dict(self.report["check"])

    @cached_property
    def request(self) -> dict[str, Any]:
        """The request with the defaults filled in, with the seed: the same request makes the same packing."""
        return self._source.request()

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns of :attr:`grains`."""
        return self._source.columns()

    @cached_property
    def grains(self) -> NDArray[np.float64]:
        """The grains, largest first: an N x 4 array of the centre x, y, z and the diameter, in mm.

        :attr:`columns` names them: other shapes have the sieve size, a quaternion, and the semi-axes of ellipsoids or
        the template of polyhedra, too. Of a mix of several aggregates the last column is ``aggregate``, their index from 0. All
        grains, :attr:`positions` and :attr:`diameters` are one array, which cannot be written: change a ``copy()``.
        """
        grains = self._source.grains()
        grains.setflags(write=False)
        return grains

    @property
    def positions(self) -> NDArray[np.float64]:
        """The centres of the grains, largest first: an N x 3 array in mm."""
        return self.grains[:, :3]

    @property
    def diameters(self) -> NDArray[np.float64]:
        """The diameters of the grains, largest first, in mm; of other shapes those of the spheres of equal volume."""
        return self.grains[:, 3]

    def to_numpy(self) -> NDArray[np.float64]:
        """Returns :attr:`grains`."""
        return self.grains

    def to_dataframe(self) -> pd.DataFrame:
        """Returns the grains as a table with the columns of :attr:`grains`: x_mm, y_mm, z_mm, d_mm. Needs pandas."""
        import pandas as pd

        return pd.DataFrame(self.grains, columns=list(self.columns), copy=True)

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
        from . import _surfaces

        if not spheres:
            return _surfaces.points(self.grains)
        if "template" in self.columns:
            return _surfaces.polyhedra(self.read("vtp"))
        if "a_mm" in self.columns:
            return _surfaces.ellipsoids(self.grains, self.columns, resolution)
        return _surfaces.spheres(self.grains, resolution)

    def to_meshio(self) -> meshio.Mesh:
        """Returns the centres as vertices with the point data ``diameter_mm``. Needs meshio.

        For surfaces save a mesh: ``save("a.msh")`` writes a file that meshio reads.
        """
        import meshio
        import numpy as np

        return meshio.Mesh(
            self.positions.copy(),
            {"vertex": np.arange(len(self.grains)).reshape(-1, 1)},
            point_data={"diameter_mm": self.diameters.copy()},
        )

    def read(self, format: FileFormat, *, timeout: float | None = None, **options: Any) -> bytes:
        """Returns the packing in a file format, as :meth:`save` writes it."""
        return self._source.read(_file(format, options), timeout)

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
        ``vtk`` or ``view``; ``html``, a page with a viewer; or an export, as ``msh``, ``vti``, ``raw``, ``inp``,
        ``svg`` or ``png``. Exports have options, as ``save("a.msh", segments=24)``. A server makes them when they
        are first needed, and this waits for it, at most `timeout` in s. Missing folders are created, and a file of
        the same name is replaced. Beside a mesh ``a.msh`` the script ``a.msh.geo`` is written, which Gmsh opens to fill
        it: ``gmsh -3 a.msh.geo -o model.msh``.
        """
        file, path = _file(format or Path(path).suffix.removeprefix(".").lower(), options), Path(path)
        self._source.save(file, path, timeout)
        if file.type is not None:
            _files.write_companion(path, file.type, {"format": file.format, **file.options})
        return path

    def export(
        self,
        type: ExportType,
        path: str | PathLike[str],
        *,
        format: ExportFormat | None = None,
        timeout: float | None = None,
        **options: Any,
    ) -> dict[str, Any]:
        """Writes an export of any type and format to a file, and returns its figures, such as a number of triangles.

        The types are ``mesh``, ``voxels``, ``slice``, ``deck``, ``ldpm``, ``certificates``, ``shapes``, ``quality`` and
        ``properties``.
        The format is the first of the type's formats if it is not named, whatever the suffix. An option that is a word
        of Python has an underscore behind it: ``export("voxels", "a.vti", for_="damask")``. Beside a mesh for Gmsh its
        script is written, as :meth:`save` does. A server does not keep the file: :meth:`Job.export` does. `timeout`
        limits the wait for a server, in s.
        """
        given = named(options if format is None else {"format": format, **options})
        report = self._source.export(type, given, Path(path), timeout)
        _files.write_companion(Path(path), type, given)
        return report

    def quality(self, *, timeout: float | None = None) -> dict[str, Any]:
        """Measures whether the packing is random: gaps, contacts, bond order, walls and blocks, by size.

        The keys are those of the export ``quality``, and lengths are in mm. `timeout` limits the wait for a server, in
        s.
        """
        report: dict[str, Any] = json.loads(self._source.read(File("json", "quality", {}), timeout))
        return report

    def plot(
        self,
        kind: PackingPlotKind,
        path: str | PathLike[str] | None = None,
        *,
        title: bool = True,
        theme: Theme = "light",
    ) -> Svg:
        """Returns a plot of the packing, and saves it if there is a `path`.

        ``grading``: the target curve and the actual one; ``distance``: the distance of grown grains against
        time; ``radial``: the pair correlation function; ``profile``: the volume fraction against the depth;
        ``zingg`` and ``flakiness``: the forms of grains that are no spheres, and their flakiness index by size;
        ``quality``: volumes near the walls, near pairs and bond order, each against chance.
        The theme ``dark`` has light strokes without a ground. A plot for which the packing has no data is refused.
        """
        svg = Svg(self._source.plot(kind, title, theme))
        if path is not None:
            svg.save(path)
        return svg

    def view(self, *, height_px: int = 640) -> View | Viewer:
        """Returns the packing in three dimensions, which notebooks show: the viewer of the web page, in a frame.

        Of more than a million grains it shows the largest. With anywidget (``packstone[jupyter]``) it is a widget,
        else HTML that stays in a notebook which is saved. ``save("a.html")`` writes the same page for a browser.
        """
        page = self.read("html").decode()
        if find_spec("anywidget") is None:
            return View(page, height_px)
        from .jupyter import Viewer

        return Viewer(page=page, height_px=height_px)

    def __len__(self) -> int:
        return self._source.count()

    def __bool__(self) -> bool:
        # Otherwise a truth test would fetch the report, and a packing without grains would be false.
        return True

    def __getstate__(self) -> dict[str, Any]:
        # The copy reads report and grains anew from its source.
        return {"_source": self._source}

    def __repr__(self) -> str:
        return f"<Packing of {self._source.title}>"

    def _repr_png_(self) -> bytes | None:
        """A cross-section through the middle; `None` if the packing does not give one."""
        try:
            return self.read("png", timeout=10, pixels=480)
        except PackstoneError:
            return None

    def _repr_html_(self) -> str:
        rows = {name: value for name, value in self.summary.items() if not isinstance(value, (dict, list))}
        if self.partial is not None:
            rows = {"partial": self.partial["reason"], **rows}
        return _html.card(f"Packing of {self._source.title}", rows, png=self._repr_png_())


def check_format(format: str) -> None:
    """Raises a `ValueError` if a format is unknown or does not name one file."""
    known = [*get_args(TableFormat), *TYPE_OF_SUFFIX]
    if format in AMBIGUOUS_SUFFIXES:
        raise ValueError(
            f"{format!r} does not name one export: use export(type, path, format=...), "
            'as packing.export("mesh", "surfaces.zip", format="stl")'
        )
    if format not in known:
        raise ValueError(f"{format!r} is not a format of packings: must be one of {', '.join(known)}")


def _file(format: str, options: Mapping[str, Any]) -> File:
    check_format(format)
    type = TYPE_OF_SUFFIX.get(format)
    if type is None and options:
        raise TypeError(f"the format {format!r} has no options: {', '.join(options)}")
    return File(format, type, named(options))
