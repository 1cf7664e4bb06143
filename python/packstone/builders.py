"""Builders of requests: dictionaries with typed arguments, for completion and checks in an editor.

Each builder returns a dictionary of the form that :func:`pack` and ``POST /v1/jobs`` take. A plain dictionary does as
well. Bounds are checked by the engine, whose errors name the field, the value and the bound.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal

from . import blends, readings
from ._fields import Fields
from .errors import invalid
from .gradings import Grading

if TYPE_CHECKING:
    from datetime import datetime
    from os import PathLike

    import numpy as np
    from numpy.typing import ArrayLike
    from typing_extensions import TypedDict

    class JobFields(TypedDict, total=False):
        """The fields of a job."""

        name: str | None
        labels: Mapping[str, str]
        seed: int | np.integer[Any]
        priority: int
        threads: int | None
        timeout_s: float | None
        expires_at: str | datetime | None
        max_attempts: int
        shared: bool
        webhook_url: str | None
        specimen: Specimen | Mapping[str, Any] | float | tuple[float, float, float]
        mix: Mix | Mapping[str, Any]
        distance: Distance | Mapping[str, Any] | Literal["none", "maximize"] | float
        method: Method | Mapping[str, Any] | MethodName
        segregation: Segregation | Mapping[str, Any]
        on_limit: Literal["fail", "keep"]
        materials: Mapping[str, Mapping[str, float]]
        postprocess: Sequence[Mapping[str, Any]] | Mapping[str, Any]


MethodName = Literal["auto", "rsa", "edmd", "monte_carlo"]
Face = Literal["x_min", "x_max", "y_min", "y_max", "z_min", "z_max", "side"]


class Specimen(Fields):
    """The region that is filled: a :class:`Box` or a :class:`Cylinder`."""


class Box(Specimen):
    """A box: a cube of one edge length, or a prism of three.

    Parameters
    ----------
    x_mm
        The edge of a cube in mm, or all three edges as one tuple or array.
    y_mm, z_mm
        The other edges of a prism in mm.
    boundary
        ``walls`` (the default) for rigid walls, as of a mould, or ``periodic``.

    Examples
    --------
    >>> packstone.Box(150) == packstone.Box(150, 150, 150)
    True
    >>> packstone.Box((60, 40, 20), boundary="periodic")
    Box({'type': 'box', 'size_mm': [60, 40, 20], 'boundary': 'periodic'})
    """

    def __init__(
        self,
        x_mm: float | Sequence[float] | ArrayLike,
        y_mm: float | None = None,
        z_mm: float | None = None,
        *,
        boundary: Literal["walls", "periodic"] | None = None,
    ) -> None:
        size: list[Any]
        if isinstance(x_mm, Real):
            if (y_mm is None) != (z_mm is None):
                raise invalid("z_mm" if z_mm is None else "y_mm", "a box has one edge length or three")
            size = [x_mm, x_mm if y_mm is None else y_mm, x_mm if z_mm is None else z_mm]
        else:
            if y_mm is not None or z_mm is not None:
                raise invalid("y_mm" if y_mm is not None else "z_mm", "x_mm has all edges of the box")
            size = list(x_mm) if isinstance(x_mm, Iterable) else [x_mm]
            if len(size) != 3:
                raise invalid("x_mm", f"{len(size)} edge lengths: a box has one or three")
        super().__init__(type="box", size_mm=size, boundary=boundary)


class Cylinder(Specimen):
    """A cylinder that stands on z = 0 with its axis at x = y = diameter / 2.

    Parameters
    ----------
    diameter_mm, height_mm
        Its sizes in mm.

    Examples
    --------
    >>> packstone.Cylinder(100, 200)
    Cylinder({'type': 'cylinder', 'diameter_mm': 100, 'height_mm': 200})
    """

    def __init__(self, diameter_mm: float, height_mm: float) -> None:
        super().__init__(type="cylinder", diameter_mm=diameter_mm, height_mm=height_mm)


class Addition(Fields):
    """A fine addition to the cement, such as fly ash, in a cubic metre of concrete."""

    def __init__(self, mass_kg_m3: float, density_kg_m3: float) -> None:
        super().__init__(mass_kg_m3=mass_kg_m3, density_kg_m3=density_kg_m3)


class Proportions(Fields):
    """The contents of a cubic metre of fresh concrete.

    The aggregate takes the volume that the other parts leave, or has `aggregate_cement` times the mass of the
    cement.
    """

    def __init__(
        self,
        cement_kg_m3: float,
        water_cement: float,
        *,
        aggregate_cement: float | None = None,
        additions: Sequence[Addition] | None = None,
        air: float | None = None,
        cement_density_kg_m3: float | None = None,
        water_density_kg_m3: float | None = None,
        aggregate_density_kg_m3: float | None = None,
    ) -> None:
        super().__init__(
            cement_kg_m3=cement_kg_m3,
            water_cement=water_cement,
            aggregate_cement=aggregate_cement,
            additions=additions,
            air=air,
            cement_density_kg_m3=cement_density_kg_m3,
            water_density_kg_m3=water_density_kg_m3,
            aggregate_density_kg_m3=aggregate_density_kg_m3,
        )


class Ratios(Fields):
    """How the ratios of the axes ``a >= b >= c`` of grains are distributed.

    The elongation is b/a, the flatness c/b, both 0.1 to 1. A law of one ratio is a number, or a mapping as
    ``{"type": "uniform", "min": 0.5, "max": 0.9}``.
    """

    @classmethod
    def constant(cls, elongation: float, flatness: float) -> Ratios:
        """The same for all grains."""
        return cls(type="constant", elongation=elongation, flatness=flatness)

    @classmethod
    def independent(
        cls, elongation: float | Mapping[str, Any], flatness: float | Mapping[str, Any]
    ) -> Ratios:
        """Elongation and flatness independent of one another."""
        return cls(type="independent", elongation=elongation, flatness=flatness)

    @classmethod
    def triangle(cls, k: float) -> Ratios:
        """Uniform over ``k <= c/a <= b/a <= 1``."""
        return cls(type="triangle", k=k)

    @classmethod
    def measured(
        cls, axes: Sequence[tuple[float, float, float]] | ArrayLike, weights: Sequence[float] | None = None
    ) -> Ratios:
        """Those of grains that were measured: triples of axes in any unit."""
        return cls(type="measured", axes=axes, weights=weights)

    @classmethod
    def flakiness(cls, index: float, elongation: float | Mapping[str, Any] | None = None) -> Ratios:
        """Grains with this flakiness index of EN 933-3, 0 to 1."""
        return cls(type="flakiness", index=index, elongation=elongation)

    @classmethod
    def shape_index(cls, index: float, elongation: float | Mapping[str, Any] | None = None) -> Ratios:
        """Grains with this shape index of EN 933-4, 0 to 1."""
        return cls(type="shape_index", index=index, elongation=elongation)


class Shape(Fields):
    """The shape of grains."""

    @classmethod
    def sphere(cls) -> Shape:
        """Spheres."""
        return cls(type="sphere")

    @classmethod
    def ellipsoid(cls, ratios: Ratios | Mapping[str, Any]) -> Shape:
        """Ellipsoids with these ratios of axes."""
        return cls(type="ellipsoid", ratios=ratios)

    @classmethod
    def polyhedron(
        cls,
        template: Literal[
            "cuts",
            "deformed_cuboid",
            "voronoi",
            "tetrahedron",
            "cube",
            "octahedron",
            "dodecahedron",
            "icosahedron",
        ]
        | None = None,
        *,
        faces: int | None = None,
        displacement: float | None = None,
        ratios: Ratios | Mapping[str, Any] | None = None,
        rounding: float | None = None,
        template_count: int | None = None,
        template_seed: int | None = None,
    ) -> Shape:
        """Angular grains: convex polyhedra, each of them one of `template_count` templates in its own size.

        `faces` is the number of ``cuts``, `displacement` how far the corners of a ``deformed_cuboid`` are moved, as a
        share of its edge. Templates are stretched by `ratios` and rounded by a radius of `rounding` times the
        equivalent diameter. They depend on `template_seed` alone, not on the seed of the job. A Platonic solid has one
        template where `template_count` is left out.
        """
        return cls(
            type="polyhedron",
            template=template,
            faces=faces,
            displacement=displacement,
            ratios=ratios,
            rounding=rounding,
            template_count=template_count,
            template_seed=template_seed,
        )

    @classmethod
    def preset(cls, name: str) -> Shape:
        """A shape by its name, of those that the service lists as ``shape_presets`` in its capabilities."""
        return cls(type="preset", name=name)

    @classmethod
    def mixture(cls, parts: Sequence[tuple[float, Shape]]) -> Shape:
        """Grains of several shapes: pairs of the share of the volume and the shape."""
        return cls(type="mixture", of=[{"share": share, "shape": shape} for share, shape in parts])


class Aggregate(Fields):
    """One of several aggregates of a mix: a supply of grains with its own grading, shapes and density.

    `share` is its share of the volume of all aggregate; the shares of a mix sum to 1. In place of it, `mass_kg_m3` is
    its mass in a cubic metre of concrete, for all aggregates of a mix, each with its density: the mix then has no
    `volume_fraction`. `d_min_mm` is a cut-off of its own, that of the mix when absent. `shape` and `shapes` are as
    those of a :class:`Mix`.
    """

    def __init__(
        self,
        share: float | None = None,
        grading: str | Grading | Mapping[str, Any] | None = None,
        *,
        name: str | None = None,
        mass_kg_m3: float | None = None,
        density_kg_m3: float | None = None,
        d_min_mm: float | None = None,
        shape: Shape | Mapping[str, Any] | None = None,
        shapes: Sequence[tuple[float, Shape]] | None = None,
    ) -> None:
        super().__init__(
            name=name,
            share=share,
            mass_kg_m3=mass_kg_m3,
            density_kg_m3=density_kg_m3,
            grading=_grading(grading),
            d_min_mm=d_min_mm,
            shape=shape,
            shapes=_shapes(shapes),
        )


def _grading(grading: str | Grading | Mapping[str, Any] | None) -> Mapping[str, Any] | None:
    return Grading.standard(grading) if isinstance(grading, str) else grading


def _shapes(shapes: Sequence[tuple[float, Shape]] | None) -> list[dict[str, Any]] | None:
    return None if shapes is None else [{"above_mm": size, "shape": shape} for size, shape in shapes]


class Mix(Fields):
    """The aggregate: its grading, its smallest and largest diameter, and its amount.

    `grading` is a :class:`Grading` or the name of a curve of DIN 1045-2; `aggregates` takes its place in a mix of several
    aggregates, each with its own grading and shapes. The amount is a `volume_fraction` (``"maximize"`` for as dense as
    these grains get) or a `count` of grains, or follows from `proportions`, or from the masses of the aggregates.
    `volume_fraction_of` says what the fraction counts: ``all_aggregate`` (the default), including the part finer than
    `d_min_mm` and that coarser than `d_max_mm`, or ``placed_grains``.

    `shape` is the shape of all grains; `shapes` has pairs of the size above which a shape holds and the shape.
    `size` says what a diameter is of grains that are not spheres: their ``sieve`` size (the default) or the
    diameter of the sphere of ``equivalent`` volume. `packing_model` has the ``compaction_index`` and the
    ``residual_packing_density`` by which a plan states the packing density of the aggregate.
    """

    def __init__(
        self,
        grading: str | Grading | Mapping[str, Any] | None = None,
        volume_fraction: float | Literal["maximize"] | None = None,
        *,
        aggregates: Sequence[Aggregate | Mapping[str, Any]] | None = None,
        d_min_mm: float | None = None,
        d_max_mm: float | None = None,
        count: int | None = None,
        proportions: Proportions | Mapping[str, Any] | None = None,
        volume_fraction_of: Literal["all_aggregate", "placed_grains"] | None = None,
        allow_coarse: bool | None = None,
        shape: Shape | Mapping[str, Any] | None = None,
        shapes: Sequence[tuple[float, Shape]] | None = None,
        size: Literal["sieve", "equivalent"] | None = None,
        orientation: Mapping[str, Any] | None = None,
        packing_model: Mapping[str, float] | None = None,
    ) -> None:
        super().__init__(
            grading=_grading(grading),
            d_min_mm=d_min_mm,
            d_max_mm=d_max_mm,
            aggregates=aggregates,
            volume_fraction=volume_fraction,
            count=count,
            proportions=proportions,
            volume_fraction_of=volume_fraction_of,
            allow_coarse=allow_coarse,
            shape=shape,
            shapes=_shapes(shapes),
            size=size,
            orientation=orientation,
            packing_model=packing_model,
        )

    @staticmethod
    def blend(
        aggregates: Mapping[str, str | Grading | Mapping[str, Any]],
        target: str | Grading | Mapping[str, Any] | blends.Limits | ArrayLike,
        *,
        densities_kg_m3: Mapping[str, float] | None = None,
        sieves_mm: Sequence[float] | ArrayLike | None = None,
        packing_model: Mapping[str, float] | None = None,
    ) -> blends.Blend:
        """Finds the shares of stockpiles whose blend comes nearest to a curve or into a band.

        `aggregates` has the grading of each stockpile by its name. `target` is a grading, the name of a curve of
        DIN 1045-2, or a band: limits as ``(sieve in mm, least, most)``, those of a :class:`MixBand`, or those of a
        standard as ``{"type": "band", "standard": "ASTM C33", "name": "57"}``. It is met at the sieves `sieves_mm`, or
        at its own. With the density of each stockpile the answer has shares of the mass too.
        """
        return blends.blend(
            {name: _grading(grading) for name, grading in aggregates.items()},
            Grading.standard(target) if isinstance(target, str) else target,
            densities_kg_m3,
            sieves_mm,
            packing_model,
        )

    @staticmethod
    def read(
        table: str | PathLike[str] | bytes,
        sheet: str | None = None,
        curve: str | None = None,
        column: str | None = None,
        unit: readings.SieveUnit | None = None,
    ) -> readings.MixReading:
        """Reads a grading or a recipe as a laboratory prints it, and returns what was understood of it.

        `table` is the path of a text (CSV, tabs, semicolons, HTML, Markdown) or of a workbook (.xlsx, .ods), or the
        content of such a file; a text of several lines is the table itself. Where several readings fit, `sheet`,
        `curve` (or the recipe), `column` (its head, its letter in a workbook, or its number from 1) and `unit` choose.
        """
        return readings.read(table, sheet, curve, column, unit)


class Distance(Fields):
    """The rule for the distance that the surfaces of two grains keep.

    `wall_gap_mm` is the gap to the walls. Its default is half of what a grain keeps from another of its size.
    """

    @classmethod
    def none(cls, *, wall_gap_mm: float | None = None) -> Distance:
        """Grains may touch."""
        return cls(type="none", wall_gap_mm=wall_gap_mm)

    @classmethod
    def constant(cls, gap_mm: float, *, wall_gap_mm: float | None = None) -> Distance:
        """The same gap for every pair."""
        return cls(type="constant", gap_mm=gap_mm, wall_gap_mm=wall_gap_mm)

    @classmethod
    def proportional(cls, factor: float, *, wall_gap_mm: float | None = None) -> Distance:
        """A gap of `factor` times the mean diameter of the pair."""
        return cls(type="proportional", factor=factor, wall_gap_mm=wall_gap_mm)

    @classmethod
    def smaller_diameter(cls, factor: float, *, wall_gap_mm: float | None = None) -> Distance:
        """A gap of `factor` times the smaller diameter of the pair."""
        return cls(type="smaller_diameter", factor=factor, wall_gap_mm=wall_gap_mm)

    @classmethod
    def maximize(cls, *, wall_gap_mm: float | None = None) -> Distance:
        """The largest gap, the same for every pair, that can be reached."""
        return cls(type="maximize", wall_gap_mm=wall_gap_mm)


class Method(Fields):
    """The method that computes the packing."""

    @classmethod
    def auto(cls) -> Method:
        """Random sequential addition if it will almost surely succeed.

        Otherwise event-driven molecular dynamics, or hard-particle Monte Carlo for grains that are not spheres.
        """
        return cls(type="auto")

    @classmethod
    def rsa(cls, *, attempts_per_grain: int | None = None) -> Method:
        """Random sequential addition. Without `attempts_per_grain` the search is exhaustive.

        Grains that are no spheres end it after 20 000 000 draws, also where it is not proven that no place is left.
        """
        return cls(type="rsa", attempts_per_grain=attempts_per_grain)

    @classmethod
    def edmd(
        cls,
        *,
        time_s: float | None = None,
        events: int | None = None,
        stall_dt_s: float | None = None,
        initial_scale: float | None = None,
        growth_rate: float | None = None,
        initial_velocity: float | None = None,
        equal_mass: bool | None = None,
        swap: bool | None = None,
    ) -> Method:
        """Event-driven molecular dynamics with growing grains.

        It stops after `time_s` of packing, after a number of `events`, or if the simulated time per event and
        grain falls below `stall_dt_s`.
        """
        stop = Fields(time_s=time_s, events=events, stall_dt_s=stall_dt_s)
        return cls(
            type="edmd",
            initial_scale=initial_scale,
            growth_rate=growth_rate,
            initial_velocity=initial_velocity,
            equal_mass=equal_mass,
            swap=swap,
            stop=dict(stop) or None,
        )

    @classmethod
    def monte_carlo(cls, *, time_s: float | None = None, sweeps: int | None = None) -> Method:
        """Hard-particle Monte Carlo with growing grains, for grains that are not spheres.

        It stops after `time_s` of packing, or after a number of `sweeps`.
        """
        return cls(type="monte_carlo", stop=dict(Fields(time_s=time_s, sweeps=sweeps)) or None)


class Segregation(Fields):
    """A gradient of the grain sizes in the specimen."""

    @classmethod
    def none(cls) -> Segregation:
        """No gradient."""
        return cls(type="none")

    @classmethod
    def along(
        cls, axis: Literal["x", "y", "z"], strength: float, *, direction: Literal["up", "down"] | None = None
    ) -> Segregation:
        """Coarse grains gather at one end of an axis, at 0 by default."""
        field = Fields(type="linear", axis=axis, direction=direction)
        return cls(type="gradient", field=dict(field), strength=strength)

    @classmethod
    def at_face(cls, face: Face, strength: float) -> Segregation:
        """Coarse grains gather at a face of the specimen."""
        return cls(type="gradient", field={"type": "face", "face": face}, strength=strength)
