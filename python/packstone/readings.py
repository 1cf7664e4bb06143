"""What was understood of gradings and recipes as laboratories print them: the answers of :meth:`Mix.read`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypeVar

from . import _native
from .errors import PackstoneError
from ._refusals import refusals

SieveUnit = Literal["mm", "um", "in", "us_sieve", "bs_mesh", "tyler_mesh", "phi"]
Verdict = Literal["ok", "warn", "ask", "refuse"]

_T = TypeVar("_T")


def _of(kind: type[_T], found: Mapping[str, Any], **others: Any) -> _T:
    """Makes an object of the members that it has fields for."""
    known = {one.name for one in fields(kind)}  # type: ignore[arg-type]
    return kind(**{**{name: value for name, value in found.items() if name in known}, **others})


@dataclass(frozen=True)
class MixNote:
    """A sentence about a table."""

    level: Literal["note", "warning", "fault"]
    """How something was read, what to look at before it is used, or why nothing was read."""
    text: str
    """The sentence."""
    line: int | None = None
    """The line of the text, or the row of the sheet, from 1."""
    cell: str | None = None
    """The cell of the sheet, as ``B7``."""

    def __str__(self) -> str:
        place = f"cell {self.cell}: " if self.cell else f"line {self.line}: " if self.line else ""
        return place + self.text


@dataclass(frozen=True)
class MixCurve:
    """A grading curve that was read."""

    name: str | None
    """The name of the aggregate or the sample, where the table has one."""
    column: str
    """The head of the column that it was read from, or its number."""
    meaning: Literal["passing", "retained", "cumulative_retained", "mass", "cumulative_mass", "mass_passing"]
    """What the values of the column are."""
    unit: str
    """The unit of the sieves as printed."""
    points: tuple[tuple[float, float], ...]
    """Sieves in mm with the share of the mass that passes them, from the finest to the coarsest."""
    points_printed: tuple[tuple[str, str], ...] = ()
    """Sieve and value of each row as they are printed."""
    completed: tuple[float, ...] = ()
    """The sieves among the points that were added, in mm."""
    notes: tuple[MixNote, ...] = ()
    """What there is to say about it."""

    def __repr__(self) -> str:
        name = f" {self.name!r}" if self.name else ""
        if not self.points:
            return f"<MixCurve{name}>"
        finest, coarsest = self.points[0][0], self.points[-1][0]
        meaning = self.meaning.replace("_", " ")
        return f"<MixCurve{name}: {meaning}, {len(self.points)} sieves, {finest:g} to {coarsest:g} mm>"


@dataclass(frozen=True)
class MixBand:
    """Limits of a grading."""

    name: str | None
    """What they are called, where the table says so."""
    points: tuple[tuple[float, float, float], ...]
    """Sieves in mm with the least and the largest share that passes them, from the finest to the coarsest."""


@dataclass(frozen=True)
class MixPart:
    """An aggregate or a fine addition of a recipe."""

    name: str
    """What the recipe calls it."""
    mass_kg_m3: float
    """Its mass in a cubic metre of concrete."""
    density_kg_m3: float | None
    """Its density, where it is known."""


@dataclass(frozen=True)
class MixRecipe:
    """The contents of a concrete that were read."""

    name: str | None = None
    """What it is called, where the table says so."""
    cement_kg_m3: float | None = None
    """Mass of cement, without additions."""
    cement_density_kg_m3: float | None = None
    """Density of the cement: that of the recipe, or the usual one."""
    water_kg_m3: float | None = None
    """Mass of water that counts for the ratio."""
    water_cement: float | None = None
    """Water over cement by mass."""
    air_volume_fraction: float | None = None
    """Volume of air over that of the concrete, as stated."""
    aggregates: tuple[MixPart, ...] = ()
    """The aggregates."""
    additions: tuple[MixPart, ...] = ()
    """Fly ash, slag, silica fume, fillers."""
    aggregate_volume_fraction: float | None = None
    """Volume of all aggregate over that of the concrete, where all densities are known."""
    volume_sum_m3: float | None = None
    """The volume that all parts fill without air."""
    implied_air: float | None = None
    """The air that the volumes leave of a cubic metre."""
    notes: tuple[MixNote, ...] = ()
    """What there is to say about it."""


@dataclass(frozen=True)
class MixCandidate:
    """One of several readings that fit."""

    label: str
    """What distinguishes it from the others."""
    request: dict[str, Any]
    """The part of a request that follows from it: ``{"mix": ...}``."""
    curve: MixCurve | None = None
    """Its grading, if it is about one."""
    recipe: MixRecipe | None = None
    """Its recipe, if it is about one."""


@dataclass(frozen=True)
class MixReading:
    """What was understood of a table: gradings, limits, recipes, and the part of a request that follows.

    A table with several readings has the verdict ``ask``, and one with none ``refuse``; both raise nothing until
    :attr:`request` is used.
    """

    verdict: Verdict
    """``ok``, ``warn`` for one reading with warnings, ``ask`` where there is a choice to make, or ``refuse``."""
    curves: tuple[MixCurve, ...] = ()
    """The grading curves."""
    bands: tuple[MixBand, ...] = ()
    """Limits of gradings."""
    recipes: tuple[MixRecipe, ...] = ()
    """The contents of concretes."""
    candidates: tuple[MixCandidate, ...] = ()
    """The readings of which one is to be chosen: by the options of :meth:`Mix.read`, or by its request."""
    notes: tuple[MixNote, ...] = ()
    """What there is to say about the whole table."""
    document: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)
    """The answer of the importer, as ``POST /v1/mixes/read`` has it."""

    @property
    def request(self) -> dict[str, Any]:
        """The part of a request that follows: ``{"mix": ...}``.

        Raises :class:`PackstoneError` where there is a choice to make or nothing was read, with what the notes say.
        """
        request = self.document.get("request")
        if isinstance(request, dict):
            return dict(request)
        raise PackstoneError(self._why())

    def _why(self) -> str:
        faults = [str(note) for note in self.notes if note.level == "fault"]
        said = faults or [str(note) for note in self.notes]
        if self.verdict == "ask":
            labels = [f"{number}: {one.label}" for number, one in enumerate(self.candidates)]
            count = len(self.candidates)
            head = f"the table has {count} readings: choose one of `candidates`, or name its curve or column"
            return "\n  ".join([head, *labels, *said])
        if self.verdict == "refuse":
            return "\n  ".join(["the table has no reading", *said])
        return "\n  ".join(["no request follows from the table", *said])

    def __repr__(self) -> str:
        if self.verdict == "ask":
            found = f"{len(self.candidates)} candidates: " + ", ".join(repr(one.label) for one in self.candidates)
        elif self.verdict == "refuse":
            found = "; ".join(str(note) for note in self.notes)
        else:
            recipes = [f"recipe {one.name!r}" if one.name else "a recipe" for one in self.recipes]
            bands = [f"limits {one.name!r}" if one.name else "limits" for one in self.bands]
            found = ", ".join([*map(repr, self.curves), *recipes, *bands])
        return f"<MixReading {self.verdict}: {found}>"


def read(
    table: str | PathLike[str] | bytes,
    sheet: str | None,
    curve: str | None,
    column: str | None,
    unit: SieveUnit | None,
) -> MixReading:
    """Reads a table; see :meth:`Mix.read`."""
    if isinstance(table, str) and "\n" in table:
        content = table.encode()
    else:
        content = table if isinstance(table, bytes) else Path(table).read_bytes()
    with refusals():
        text = _native.read_mix(content, sheet=sheet, curve=curve, column=column, unit=unit)
    found: dict[str, Any] = json.loads(text)
    return MixReading(
        verdict=found["verdict"],
        curves=tuple(map(_curve, found["curves"])),
        bands=tuple(_of(MixBand, band, points=_rows(band["points"])) for band in found["bands"]),
        recipes=tuple(map(_recipe, found["recipes"])),
        candidates=tuple(map(_candidate, found["candidates"])),
        notes=_notes(found),
        document=found,
    )


def _rows(points: list[list[Any]]) -> tuple[tuple[Any, ...], ...]:
    return tuple(map(tuple, points))


def _notes(found: Mapping[str, Any]) -> tuple[MixNote, ...]:
    return tuple(_of(MixNote, note) for note in found["notes"])


def _curve(found: Mapping[str, Any]) -> MixCurve:
    return _of(
        MixCurve,
        found,
        points=_rows(found["points"]),
        points_printed=_rows(found["points_printed"]),
        completed=tuple(found["completed"]),
        notes=_notes(found),
    )


def _recipe(found: Mapping[str, Any]) -> MixRecipe:
    def parts(name: str) -> tuple[MixPart, ...]:
        return tuple(_of(MixPart, part) for part in found.get(name, []))

    return _of(MixRecipe, found, aggregates=parts("aggregates"), additions=parts("additions"), notes=_notes(found))


def _candidate(found: Mapping[str, Any]) -> MixCandidate:
    curve, recipe = found.get("curve"), found.get("recipe")
    return MixCandidate(
        label=found["label"],
        request=found["request"],
        curve=None if curve is None else _curve(curve),
        recipe=None if recipe is None else _recipe(recipe),
    )
