"""Jobs to send: named by what a test needs of them, not by their numbers."""

from __future__ import annotations

from math import pi
from typing import Any

Json = dict[str, Any]


def quick(seed: int = 1) -> Json:
    """Some hundred grains of A16 in a 40 mm cube: done in a blink."""
    return {
        "seed": seed,
        "specimen": {"type": "box", "size_mm": [40, 40, 40]},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4, "volume_fraction": 0.3},
        "distance": {"type": "constant", "gap_mm": 0.2},
    }


def ellipsoids(seed: int = 1) -> Json:
    """Some hundred ellipsoids of A16 in a 40 mm cube."""
    job = quick(seed)
    job["mix"]["shape"] = {"type": "ellipsoid", "ratios": {"type": "constant", "elongation": 0.8, "flatness": 0.6}}
    return job


def grown(seed: int = 1) -> Json:
    """The grains of `quick`, placed by event-driven molecular dynamics."""
    return quick(seed) | {"method": {"type": "edmd"}}


def mixed(seed: int = 1) -> Json:
    """Some hundred polyhedra and spheres of A16 in a 40 mm cube."""
    job = quick(seed)
    parts = [{"type": "polyhedron", "template_count": 3}, {"type": "sphere"}]
    job["mix"]["shape"] = {"type": "mixture", "of": [{"share": 0.5, "shape": part} for part in parts]}
    return job


def endless() -> Json:
    """Grows until it is stopped, as far as a test is concerned."""
    return {
        "name": "endless",
        "seed": 7,
        "specimen": {"type": "box", "size_mm": [80, 80, 80]},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2, "volume_fraction": 0.535},
        "distance": {"type": "maximize"},
        "method": {"type": "edmd", "stop": {"stall_dt_s": 1e-300}},
    }


def long() -> Json:
    """Grows for some seconds and then has its result."""
    job = without(endless(), "name")
    return job | {"method": {"type": "edmd", "stop": {"events": 3_000_000}}}


def dense() -> Json:
    """Equal spheres that jam before their target, and grow until they are stopped, as far as a test is concerned."""
    return {
        "seed": 3,
        "specimen": {"type": "box", "size_mm": [14.4, 14.4, 14.4], "boundary": "periodic"},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 1}, "volume_fraction": 0.7},
        "method": {"type": "edmd", "stop": {"stall_dt_s": 1e-300}},
    }


def unreachable() -> Json:
    """Ends soon as `target-not-reached`: equal spheres added at random jam near 0.384."""
    return {
        "seed": 1,
        "specimen": {"type": "box", "size_mm": [(1000 * pi / 6 / 0.5) ** (1 / 3)] * 3, "boundary": "periodic"},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 1}, "volume_fraction": 0.5},
        "method": {"type": "rsa", "attempts_per_grain": 100},
    }


def without(job: Json, field: str) -> Json:
    """The same job but for a field."""
    return {name: value for name, value in job.items() if name != field}
