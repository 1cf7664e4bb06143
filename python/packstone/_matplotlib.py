"""Plots of a packing in axes of matplotlib."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ._numpy import np
from ._optional import needed
from ._sources import File
from .errors import invalid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .packings import Packing


def draw(packing: Packing, kind: str, ax: Axes, title: bool) -> Axes:
    """Draws a plot of a kind into axes, and returns them."""
    drawing = KINDS.get(kind)
    if drawing is None:
        others = f"; without ax, plot({kind!r}) is SVG" if kind in ("radial", "profile", "flakiness", "quality") else ""
        raise invalid("kind", f"{kind!r} is not drawn in axes of matplotlib: must be one of {', '.join(KINDS)}{others}")
    drawing(packing, ax)
    if title:
        ax.set_title(f"{len(packing)} grains, volume fraction {packing.volume_fraction:.4g}")
    return ax


def grading(packing: Packing, ax: Axes) -> None:
    """The share of the volume of the grains that is finer than a size, and that of the target at the sieves."""
    order = np.argsort(packing.sieve_sizes, kind="stable")
    sizes, volumes = packing.sieve_sizes[order], packing.diameters[order] ** 3
    ax.plot(sizes, 100 * np.cumsum(volumes) / volumes.sum(), drawstyle="steps-post", label="achieved")
    classes = packing.summary["classes"]
    bounds = [classes[0]["d_min_mm"], *(one["d_max_mm"] for one in classes)] if classes else []
    target = np.cumsum([0.0, *(one["target_volume_mm3"] for one in classes)])
    if bounds and target[-1] > 0:
        ax.plot(bounds, 100 * target / target[-1], "o--", label="target")
    ylabel = "passing of the grains placed in % of volume"
    ax.set(xscale="log", xlabel="sieve size in mm", ylabel=ylabel, ylim=(0, 100))
    ax.legend()


def section(packing: Packing, ax: Axes) -> None:
    """The cross-section through the middle, as the export ``slice`` draws it."""
    with needed("matplotlib", "plot(ax=...)", "packstone[plot]"):
        import matplotlib.image

    # A slice of shaped grains has outlines of several kinds: its picture has them all.
    source = packing._source
    plane = json.loads(source.read(File("json", "slice", {}), None))
    content = source.read(File("png", "slice", {"pixels": 1000}), None)
    picture: Any = matplotlib.image.imread(io.BytesIO(content), format="png")
    outline = plane["outline"]
    if outline["type"] == "rectangle":
        (left, right), (bottom, top) = outline["u_mm"], outline["v_mm"]
    else:
        (u, v), radius = outline["center_mm"], outline["radius_mm"]
        left, right, bottom, top = u - radius, u + radius, v - radius, v + radius
    # A picture of one channel has grey values, which matplotlib would show in colours of its own.
    ax.imshow(picture, extent=(left, right, bottom, top), cmap="gray", vmin=0, vmax=1)
    across, up = plane["plane"]
    ax.set(xlabel=f"{across} in mm", ylabel=f"{up} in mm", aspect="equal")


def distance(packing: Packing, ax: Axes) -> None:
    """The distance of grown grains against the time of the run."""
    curve: list[Any] = list(packing.report.get("growth_curve", []))
    points = [(point["packing_time_s"], point["distance_mm"]) for point in curve if point["distance_mm"] is not None]
    if not points:
        raise invalid("kind", "the packing has no 'distance': its grains did not grow to a constant distance")
    times, distances = zip(*points, strict=True)
    ax.plot(times, distances)
    ax.set(xlabel="time in s", ylabel="distance in mm")


def zingg(packing: Packing, ax: Axes) -> None:
    """The ratios of the axes of the grains, with Zingg's limits."""
    shapes = json.loads(packing._source.read(File("json", "shapes", {}), None))
    rows, columns = shapes["rows"], shapes["columns"]
    elongation, flatness = ([row[columns.index(name)] for row in rows] for name in ("elongation", "flatness"))
    ax.scatter(flatness, elongation, s=8)
    for limit in (ax.axhline, ax.axvline):
        limit(2 / 3, color="0.6", linewidth=0.8)
    ax.set(xlabel="flatness c/b", ylabel="elongation b/a", xlim=(0, 1.02), ylim=(0, 1.02), aspect="equal")


KINDS: dict[str, Callable[[Any, Any], None]] = {
    "grading": grading,
    "section": section,
    "distance": distance,
    "zingg": zingg,
}
