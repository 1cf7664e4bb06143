"""Blends of stockpiles that meet a curve or a band: the answers of :meth:`Mix.blend`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Union

from . import _native
from ._requests import encoded
from ._refusals import refusals
from .readings import MixBand

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Limits = Union[MixBand, Sequence[tuple[float, float, float]]]


@dataclass(frozen=True)
class BlendedSieve:
    """What passes a sieve of a blend."""

    sieve_mm: float
    """Openings of the sieve."""
    target_low: float
    """The least that is to pass."""
    target_high: float
    """The most that is to pass: that of `target_low` for a curve."""
    passing: float
    """What passes of the blend."""
    residual: float
    """What passes of the blend less the limit that it breaks; 0 in a band."""


@dataclass(frozen=True)
class Blend:
    """The blend of stockpiles that comes nearest to a target, by least squares over its sieves."""

    shares: dict[str, float]
    """Share of each stockpile of the volume of all aggregate."""
    mass_shares: dict[str, float]
    """The same of the mass; empty where no densities were given."""
    sieves: tuple[BlendedSieve, ...]
    """Each sieve, from fine to coarse."""
    largest_residual: float
    """Largest size of a residual."""
    root_mean_square_residual: float
    """Root of the mean square of the residuals."""
    curve: tuple[tuple[float, float], ...]
    """The grading curve of the blend: diameters in mm with the share that passes them, from fine to coarse."""
    figures: dict[str, Any] | None
    """Fineness modulus, specific surface and packing density, as a plan states them."""
    warnings: tuple[str, ...]
    """What to look at before the shares are used."""
    document: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)
    """The answer as ``POST /v1/mixes/blend`` has it."""

    @property
    def request(self) -> dict[str, Any]:
        """The part of a request that has this blend: ``{"mix": {"aggregates": [...]}}``."""
        return dict(self.document["request"])

    def __repr__(self) -> str:
        shares = ", ".join(f"{name} {100 * share:.1f} %" for name, share in self.shares.items())
        return f"<Blend {shares}; residual at most {100 * self.largest_residual:.2f} %>"


def blend(
    aggregates: Mapping[str, Mapping[str, Any] | None],
    target: Mapping[str, Any] | Limits | ArrayLike,
    densities_kg_m3: Mapping[str, float] | None,
    sieves_mm: Sequence[float] | ArrayLike | None,
    packing_model: Mapping[str, float] | None,
) -> Blend:
    """Finds the shares; see :meth:`Mix.blend`."""
    densities = densities_kg_m3 or {}
    unknown = [name for name in densities if name not in aggregates]
    if unknown:
        raise ValueError(f"densities_kg_m3 names {unknown[0]!r}, which is none of {list(aggregates)}")
    points = target.points if isinstance(target, MixBand) else target
    request: dict[str, Any] = {
        "aggregates": [
            {"name": name, "grading": grading, "density_kg_m3": densities.get(name)}
            for name, grading in aggregates.items()
        ],
        "target": points if isinstance(points, Mapping) else {"type": "band", "points": points},
    }
    if sieves_mm is not None:
        request["sieves_mm"] = sieves_mm
    if packing_model is not None:
        request["packing_model"] = packing_model
    with refusals():
        found: dict[str, Any] = json.loads(_native.blend_mix(encoded(request)))
    blended = dict(zip(aggregates, found["aggregates"]))
    return Blend(
        shares={name: one["share"] for name, one in blended.items()},
        mass_shares={name: one["mass_share"] for name, one in blended.items() if "mass_share" in one},
        sieves=tuple(BlendedSieve(**sieve) for sieve in found["sieves"]),
        largest_residual=found["largest_residual"],
        root_mean_square_residual=found["root_mean_square_residual"],
        curve=tuple(map(tuple, found["curve"])),
        figures=found.get("figures"),
        warnings=tuple(found["warnings"]),
        document=found,
    )
