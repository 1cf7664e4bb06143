"""Blends of stockpiles."""

from __future__ import annotations

import json

import httpx
import numpy as np
import packstone
import pytest
from live_server import LiveServer
from packstone import Box, Grading, Mix, PackstoneError
from packstone.readings import MixBand
from scipy.optimize import minimize

SIEVES = [0.063, 0.125, 0.25, 0.5, 1, 2, 4, 8, 16]


def piles(rng: np.random.Generator, count: int) -> dict[str, Grading]:
    """Stockpiles of random curves."""
    curves = np.sort(rng.uniform(0, 1, (count, len(SIEVES))), axis=1)
    curves[:, 0], curves[:, -1] = 0, 1
    return {f"pile {i}": Grading.sieves(list(zip(SIEVES, curve.tolist()))) for i, curve in enumerate(curves)}


def test_shares_are_those_of_another_solver() -> None:
    rng = np.random.default_rng(1)
    for count in (2, 3, 5, 8):
        stock = piles(rng, count)
        (target,) = piles(rng, 1).values()
        found = Mix.blend(stock, target)
        matrix = np.array([[passing for _, passing in pile["points"]] for pile in stock.values()]).T
        asked = np.array([passing for _, passing in target["points"]])
        other = minimize(
            lambda x: float(np.sum((matrix @ x - asked) ** 2)),
            np.full(count, 1 / count),
            jac=lambda x: 2 * matrix.T @ (matrix @ x - asked),
            bounds=[(0, 1)] * count,
            constraints={"type": "eq", "fun": lambda x: np.sum(x) - 1, "jac": np.ones_like},
            method="SLSQP",
            options={"ftol": 1e-16, "maxiter": 1000},
        )
        shares = np.array(list(found.shares.values()))
        assert np.allclose(shares, other.x, rtol=0, atol=1e-6)
        residuals = [sieve.residual for sieve in found.sieves]
        assert np.allclose(residuals, matrix @ shares - asked, rtol=0, atol=1e-12)
        assert np.isclose(found.root_mean_square_residual**2 * len(SIEVES), np.sum((matrix @ shares - asked) ** 2))


def test_a_blend_is_packed_and_says_what_it_is() -> None:
    stock = {
        "sand": Grading.sieves([(0.125, 0), (1, 0.6), (4, 1)]),
        "gravel": Grading.sieves([(2, 0), (8, 0.3), (16, 1)]),
    }
    found = Mix.blend(stock, "B16", densities_kg_m3={"sand": 2600, "gravel": 2800})
    assert list(found.shares) == ["sand", "gravel"]
    assert sum(found.shares.values()) == pytest.approx(1)
    assert found.mass_shares["gravel"] > found.shares["gravel"]
    assert found.figures is not None
    assert 2 < found.figures["k_value"] < 5
    assert "sand 53.7 %" in repr(found)
    mix = {**found.request["mix"], "volume_fraction": 0.3, "d_min_mm": 4}
    packing = packstone.pack(specimen=Box(80), mix=mix, seed=1)
    assert len(packing.grains) > 10


def test_limits_are_met_from_a_table_or_a_standard() -> None:
    stock: dict[str, str | Grading] = {"sand": "C8", "gravel": Grading.monodisperse(12)}
    band = MixBand(name=None, points=((2, 0.2, 0.4), (8, 0.55, 0.65), (16, 1, 1)))
    for target in (band, band.points):
        found = Mix.blend(stock, target, sieves_mm=[2, 8])
        assert found.largest_residual < 1e-5
        assert [sieve.sieve_mm for sieve in found.sieves] == [2, 8]
    named = Mix.blend(stock, {"type": "band", "standard": "ASTM C33", "name": "57"})
    assert named.warnings
    with pytest.raises(PackstoneError, match="must be one of"):
        Mix.blend(stock, "A17")
    with pytest.raises(ValueError, match="'sands', which is none of"):
        Mix.blend(stock, "A16", densities_kg_m3={"sands": 2600})


def test_arrays_of_numpy_are_taken() -> None:
    sand: list[tuple[float, float]] = [(0.125, 0), (1, 0.6), (4, 1)]
    gravel: list[tuple[float, float]] = [(2, 0), (8, 0.3), (16, 1)]
    lists = {"sand": sand, "gravel": gravel}
    limits = [(1, 0.2, 0.3), (8, 0.55, 0.7)]
    by_lists = Mix.blend({name: Grading.sieves(points) for name, points in lists.items()}, limits, sieves_mm=[1, 8])
    arrays = {name: Grading.sieves(np.array(points)) for name, points in lists.items()}
    by_arrays = Mix.blend(arrays, np.array(limits), sieves_mm=np.array([1.0, 8.0]))
    assert by_arrays == by_lists


def test_the_service_answers_alike(server: LiveServer) -> None:
    found = Mix.blend({"a": "A8", "b": "C32"}, "B16", packing_model={"compaction_index": 4.1})
    aggregates = [{"name": "a", "grading": Grading.standard("A8")}, {"name": "b", "grading": Grading.standard("C32")}]
    request = {
        "aggregates": aggregates,
        "target": Grading.standard("B16"),
        "packing_model": {"compaction_index": 4.1},
    }
    answer = httpx.post(f"{server.url}/v1/mixes/blend", json=request)
    assert answer.status_code == 200
    assert answer.json() == json.loads(json.dumps(found.document))
