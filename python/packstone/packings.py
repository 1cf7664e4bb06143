"""A packing, made in this process or by a service, or read from a file."""

from __future__ import annotations

import json
from functools import cached_property
from importlib.util import find_spec
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast, overload

from . import _files, _html, _matplotlib
from ._conversions import Conversions
from ._exporting import PackingExports
from ._sources import File, FileFormat, PackingPlotKind, Theme, file_of
from .builders import Box, Cylinder, Specimen
from .errors import PackstoneError, invalid
from .picture import Picture
from .svg import Svg
from .view import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from typing_extensions import NotRequired, Unpack

    from .jupyter import Viewer
    from .options import FileOptions
    from .reports import QualityReport
    from .results import CheckReport, EngineInfo, Partial, Report, Summary

    class PackingReport(Report):
        """Everything that is known about a packing but its grains and its request."""

        engine: EngineInfo
        job_id: NotRequired[str]


# Of a packing with more grains notebooks show a cross-section, which a server draws without sending the grains.
MOST_GRAINS_OF_PICTURES = 100_000


class Packing(Conversions, PackingExports):
    """A packing, which :func:`pack` makes in this process, :meth:`Job.result` returns from a service, or :func:`load`
    reads from a file.

    ``numpy.asarray(packing)`` is the array :attr:`grains`, ``len(packing)`` the number of grains, and iteration gives
    each :class:`Grain`. The parts of a packing of a service are fetched when they are needed. The pickle of a packing
    holds its grains and no API key: one of a service is fetched for it.

    Examples
    --------
    >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.3, d_min_mm=4), distance=0.2, seed=1)
    >>> packing
    <Packing of 68 grains: box of 40 x 40 x 40 mm, volume fraction 0.1922, distance 0.2 mm, seed 1>
    >>> packing.positions.shape, packing.diameters[:2].round(1).tolist()
    ((68, 3), [15.8, 13.2])
    >>> sum(grain.diameter > 8 for grain in packing)
    12
    """

    @cached_property
    def report(self) -> PackingReport:
        """Everything but grains and request: engine, summary, timings, statistics, check, curves, warnings."""
        report: PackingReport = cast("PackingReport", self._source.report())
        return report

    @property
    def summary(self) -> Summary:
        """The main figures: grains, volume fractions, distance, size classes."""
        return self.report["summary"].copy()

    @property
    def partial(self) -> Partial | None:
        """How far the run came, if it ended before its target and its packing was kept, else `None`."""
        partial = self.summary.get("partial")
        return None if partial is None else partial.copy()

    @property
    def check(self) -> CheckReport:
        """What the independent check of the packing found: smallest gaps in mm, greatest error of a size class."""
        return self.report["check"].copy()

    @cached_property
    def request(self) -> dict[str, Any]:
        """The request with the defaults filled in, with the seed: the same request makes the same packing."""
        return self._source.request()

    @property
    def seed(self) -> int:
        """The seed of all random numbers."""
        return int(self.request["seed"])

    @property
    def volume_fraction(self) -> float:
        """The volume of the grains over that of the specimen."""
        return self.report["summary"]["volume_fraction_effective"]

    @property
    def specimen(self) -> Specimen:
        """The region that is filled: a :class:`Box` or a :class:`Cylinder`."""
        given = dict(self.request["specimen"])
        if given.pop("type") == "box":
            return Box(given.pop("size_mm"), **given)
        return Cylinder(**given)

    def read(
        self, format: FileFormat, *, timeout: float | None = None, **options: Unpack[FileOptions]
    ) -> bytes:
        """Returns the packing in a file format, as :meth:`save` writes it.

        Examples
        --------
        >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
        >>> packing.read("csv").splitlines()[0]
        b'x_mm,y_mm,z_mm,d_mm'
        """
        return self._source.read(file_of(format, options), timeout)

    def save(
        self,
        path: str | PathLike[str],
        format: FileFormat | None = None,
        *,
        timeout: float | None = None,
        overwrite: bool = False,
        **options: Unpack[FileOptions],
    ) -> Path:
        """Writes the packing to a file and returns the path. :func:`load` reads it again.

        Parameters
        ----------
        path
            The file. Missing folders are created. Beside a mesh ``a.msh`` the script ``a.msh.geo`` is written, which
            Gmsh opens to fill it: ``gmsh -3 a.msh.geo -o model.msh``.
        format
            That of the suffix if it is not named: the grains as ``json`` (with everything that is known of them),
            ``csv``, ``npy``, ``vtp``, ``vtk`` or ``view``; ``html``, a page with a viewer; or the export that the
            suffix names: ``msh``, ``vti``, ``raw``, ``svg`` or ``png``. :meth:`export` makes all.
        timeout
            Longest wait in s for a server, which makes exports when they are first needed.
        overwrite
            Whether a file of the same name is replaced.
        **options
            Those of the export, as ``save("a.msh", segments=24)``.

        Raises
        ------
        FileExistsError
            If the file exists.
        ValueError
            If the format is unknown, or has no such option.

        Examples
        --------
        >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
        >>> packing.save("grains.vtp").name
        'grains.vtp'
        >>> packing.save("grains.vtp")
        Traceback (most recent call last):
        FileExistsError: grains.vtp exists: choose another name, or pass overwrite=True
        """
        file, path = file_of(format or Path(path).suffix.removeprefix(".").lower(), options), Path(path)
        _files.refuse_existing(path, overwrite)
        self._source.save(file, path, timeout)
        if file.type is not None:
            _files.write_companion(path, file.type, {"format": file.format, **file.options})
        return path

    def quality(self, *, timeout: float | None = None) -> QualityReport:
        """Measures whether the packing is random: gaps, contacts, bond order, walls and blocks, by size.

        The keys are those of the export ``quality``, and lengths are in mm.

        Examples
        --------
        >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
        >>> packing.quality()["grains"] == len(packing)
        True
        """
        report: QualityReport = json.loads(self._source.read(File("json", "quality", {}), timeout))
        return report

    @overload
    def plot(
        self,
        kind: PackingPlotKind = "grading",
        path: str | PathLike[str] | None = None,
        *,
        title: bool = True,
        theme: Theme = "light",
        overwrite: bool = False,
    ) -> Svg: ...
    @overload
    def plot(
        self, kind: Literal["grading", "section", "distance", "zingg"] = "grading", *, ax: Axes, title: bool = True
    ) -> Axes: ...
    def plot(
        self,
        kind: str = "grading",
        path: str | PathLike[str] | None = None,
        *,
        title: bool = True,
        theme: Theme = "light",
        overwrite: bool = False,
        ax: Axes | None = None,
    ) -> Svg | Axes:
        """Draws a plot: as SVG, which notebooks show, or with `ax` into axes of matplotlib.

        Parameters
        ----------
        kind
            ``grading``: the target and the actual grading; ``distance``: the distance of grown grains against
            time; ``radial``: the pair correlation function; ``profile``: the volume fraction against the depth;
            ``zingg`` and ``flakiness``: the forms of grains that are not spheres, and their flakiness index by size;
            ``quality``: volumes near the walls, near pairs and bond order, each against chance. In axes of matplotlib
            ``grading``, ``distance``, ``zingg``, and ``section``, the cross-section through the middle.
        path
            A file for the SVG.
        title
            Whether the plot has a title.
        theme
            ``dark`` has light strokes without a ground.
        overwrite
            Whether a file of the same name is replaced.
        ax
            Axes of matplotlib, which are returned.

        Raises
        ------
        ValueError
            For a plot that the packing has no data for.

        Examples
        --------
        >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
        >>> packing.plot("grading", "grading.svg")[:4]
        '<svg'
        >>> import matplotlib.figure
        >>> packing.plot("section", ax=matplotlib.figure.Figure().subplots()).get_xlabel()
        'x in mm'
        """
        if ax is not None:
            return _matplotlib.draw(self, kind, ax, title)
        if path is not None:
            _files.refuse_existing(path, overwrite)
        svg = Svg(self._source.plot(cast("PackingPlotKind", kind), title, theme))
        if path is not None:
            svg.save(path, overwrite=overwrite)
        return svg

    def picture(
        self, path: str | PathLike[str] | None = None, *, pixels: int = 800, overwrite: bool = False
    ) -> Picture:
        """Returns a picture of the packing with one octant removed, as ``packstone run --picture`` draws it.

        Parameters
        ----------
        path
            A file for the picture, as PNG.
        pixels
            Pixels along the longer edge, 64 to 8192.
        overwrite
            Whether a file of the same name is replaced.

        Examples
        --------
        >>> packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
        >>> packing.picture("packing.png", pixels=200)[1:4]
        b'PNG'
        """
        if not 64 <= pixels <= 8192:
            raise invalid("pixels", f"{pixels} is out of range: must be at least 64 and at most 8192")
        if path is not None:
            _files.refuse_existing(path, overwrite)
        picture = Picture(self._source.picture(pixels))
        if path is not None:
            picture.save(path, overwrite=overwrite)
        return picture

    def view(self, *, height_px: int = 640) -> View | Viewer:
        """Returns the packing in three dimensions, which notebooks show: the viewer of the web page, in a frame.

        Of more than a million grains it shows the largest. With anywidget (``packstone[jupyter]``) it is a widget,
        else HTML. A saved notebook has a picture beside either, which stays where the viewer cannot run.
        ``save("a.html")`` writes the same page for a browser.
        """
        page, png = self.read("html").decode(), self._repr_png_()
        if find_spec("anywidget") is None:
            return View(page, height_px, png)
        from .jupyter import Viewer

        return Viewer.of(page, height_px, png)

    def __getstate__(self) -> dict[str, Any]:
        return {"_source": self._source.in_memory()}

    def __repr__(self) -> str:
        title = f"Packing of {self._source.title}"
        try:
            return f"<{title}: {', '.join(self._figures())}>"
        except (PackstoneError, ValueError):
            # A table has no figures, and a server may not answer.
            return f"<{title}>"

    def _figures(self) -> list[str]:
        figures = [] if "grains" in self._source.title else [f"{len(self)} grains"]
        specimen, summary = self.specimen, self.summary
        if isinstance(specimen, Box):
            kind = "periodic box" if specimen.get("boundary") == "periodic" else "box"
            figures.append(f"{kind} of {' x '.join(f'{edge:g}' for edge in specimen['size_mm'])} mm")
        else:
            figures.append(f"cylinder of {specimen['diameter_mm']:g} mm, {specimen['height_mm']:g} mm high")
        figures.append(f"volume fraction {self.volume_fraction:.4g}")
        distance = summary.get("distance_mm")
        rule = self.request["distance"]["type"] if distance is None else f"{distance:g} mm"
        figures.append(f"distance {rule}")
        if self.partial is not None:
            figures.append(f"partial ({self.partial['reason']})")
        return [*figures, f"seed {self.seed}"]

    def _repr_png_(self) -> bytes | None:
        """A picture, or of many grains a cross-section through the middle; `None` if the packing gives neither."""
        try:
            if len(self) <= MOST_GRAINS_OF_PICTURES:
                return self.picture(pixels=480)
            return self.read("png", timeout=10, pixels=480)
        except (PackstoneError, ValueError):
            return None

    def _repr_html_(self) -> str:
        try:
            rows = {name: value for name, value in self.summary.items() if not isinstance(value, (dict, list))}
            if self.partial is not None:
                rows = {"partial": self.partial["reason"], **rows}
        except ValueError:
            # Of a table.
            rows = {"grains": len(self)}
        return _html.card(f"Packing of {self._source.title}", rows, png=self._repr_png_())
