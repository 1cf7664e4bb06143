"""Mixes: the aggregate with its gradings and shapes, and its amount."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from . import blends, readings
from ._fields import Fields
from .gradings import Grading

if TYPE_CHECKING:
    from os import PathLike

    from numpy.typing import ArrayLike

    from .shapes import Shape


class Addition(Fields):
    """A fine addition to the cement, such as fly ash, in a cubic metre of concrete.

    Parameters
    ----------
    mass_kg_m3, density_kg_m3
        Its mass in a cubic metre of concrete, and its density.

    Examples
    --------
    >>> packstone.Addition(60, 2300)
    Addition({'mass_kg_m3': 60, 'density_kg_m3': 2300})
    """

    def __init__(self, mass_kg_m3: float, density_kg_m3: float) -> None:
        super().__init__(mass_kg_m3=mass_kg_m3, density_kg_m3=density_kg_m3)


class Proportions(Fields):
    """The contents of a cubic metre of fresh concrete, from which the amount of aggregate follows.

    Parameters
    ----------
    cement_kg_m3
        Mass of the cement.
    water_cement
        Mass of the water over that of the cement.
    aggregate_cement
        Mass of the aggregate over that of the cement. Without it the aggregate takes the volume that the other parts
        leave.
    additions
        Fine additions to the cement.
    air
        Volume of the air over that of the concrete.
    cement_density_kg_m3, water_density_kg_m3, aggregate_density_kg_m3
        Densities, where they are not the usual ones.

    Examples
    --------
    >>> parts = packstone.Proportions(350, 0.5, air=0.02, additions=[packstone.Addition(60, 2300)])
    >>> round(packstone.plan(specimen=100, mix=packstone.Mix("A16", d_min_mm=4, proportions=parts))["grains"])
    2432
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


class Aggregate(Fields):
    """One of several aggregates of a mix: a supply of grains with its own grading, shapes and density.

    Parameters
    ----------
    share
        Its share of the volume of all aggregate; the shares of a mix sum to 1.
    grading
        Its grading, or the name of a curve of DIN 1045-2.
    name
        A name for tables and messages.
    mass_kg_m3
        In place of `share`: its mass in a cubic metre of concrete, for all aggregates of a mix, each with its density.
        The mix then has no `volume_fraction`.
    density_kg_m3
        Its density.
    d_min_mm
        A smallest diameter of its own, that of the mix if it is not given.
    shape, shapes
        As those of a :class:`Mix`.

    Examples
    --------
    >>> gravel = packstone.Aggregate(0.6, packstone.Grading.sieves([(4, 0), (12, 1)]), name="gravel")
    >>> beads = packstone.Aggregate(0.4, packstone.Grading.monodisperse(5), name="beads")
    >>> mix = packstone.Mix(volume_fraction=0.3, aggregates=[gravel, beads])
    >>> packing = packstone.pack(specimen=40, mix=mix, seed=1)
    >>> [part["name"] for part in packing.summary["aggregates"]]
    ['gravel', 'beads']
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

    The amount is one of `volume_fraction`, `count` and `proportions`, or follows from the masses of the aggregates.

    Parameters
    ----------
    grading
        A :class:`Grading`, or the name of a curve of DIN 1045-2, as ``"A16"``.
    volume_fraction
        Volume of the aggregate over that of the specimen, or ``"maximize"`` for as dense as these grains get.
    aggregates
        In place of `grading`: several aggregates, each with its own grading and shapes.
    d_min_mm, d_max_mm
        The smallest and the largest diameter that is placed.
    count
        The number of grains.
    proportions
        The contents of a cubic metre of concrete.
    volume_fraction_of
        What the fraction counts: ``all_aggregate`` (the default), including the part finer than `d_min_mm` and that
        coarser than `d_max_mm`, or ``placed_grains``.
    allow_coarse
        Whether a mix is packed whose whole grains miss its volume.
    shape
        The shape of all grains, spheres if it is not given.
    shapes
        Pairs of the size above which a shape holds and the shape.
    size
        What a diameter is of grains that are not spheres: their ``sieve`` size (the default), or the diameter of the
        sphere of ``equivalent`` volume.
    orientation
        How the orientations are distributed.
    packing_model
        The ``compaction_index`` and the ``residual_packing_density`` by which a plan states the packing density of the
        aggregate.

    Examples
    --------
    >>> packing = packstone.pack(specimen=60, mix=packstone.Mix("A16", 0.5, d_min_mm=4), seed=1)
    >>> bool(packing.sieve_sizes.min() >= 4)
    True
    >>> crushed = packstone.Mix("A16", 0.3, d_min_mm=4, shape=packstone.Shape.polyhedron(template_count=5))
    >>> len(packstone.pack(specimen=40, mix=crushed, seed=1).templates())
    5
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

        Parameters
        ----------
        aggregates
            The grading of each stockpile by its name.
        target
            A grading, the name of a curve of DIN 1045-2, or a band: limits as ``(sieve in mm, least, most)``, those of
            a :class:`MixBand`, or those of a standard as ``{"type": "band", "standard": "ASTM C33", "name": "57"}``.
        densities_kg_m3
            The density of each stockpile: the answer has shares of the mass, too.
        sieves_mm
            The sieves at which the target is met, its own if they are not given.
        packing_model
            As that of a :class:`Mix`.

        Examples
        --------
        >>> sand = packstone.Grading.sieves([(0.125, 0), (1, 0.6), (4, 1)])
        >>> gravel = packstone.Grading.sieves([(2, 0), (8, 0.3), (16, 1)])
        >>> packstone.Mix.blend({"sand": sand, "gravel": gravel}, "A16")
        <Blend sand ... %, gravel ... %; residual at most ... %>
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

        Parameters
        ----------
        table
            The path of a text (CSV, tabs, semicolons, HTML, Markdown) or of a workbook (.xlsx, .ods), or the content of
            such a file; a text of several lines is the table itself.
        sheet, curve, column, unit
            What is meant, where several readings fit: the sheet, the curve (or the recipe), the column (its head, its
            letter in a workbook, or its number from 1), and the unit of the sieves.

        Examples
        --------
        >>> reading = packstone.Mix.read("Sieve mm;Passing %\\n4;36\\n8;60,5\\n16;100\\n")
        >>> reading.curves[0].points
        ((4.0, 0.36), (8.0, 0.605), (16.0, 1.0))
        """
        return readings.read(table, sheet, curve, column, unit)
