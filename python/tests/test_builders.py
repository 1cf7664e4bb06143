"""Builders of requests."""

from __future__ import annotations

import json
import pickle

import mixes
import numpy as np
import packstone
import pytest
from packstone import (
    Aggregate,
    Box,
    Cylinder,
    Distance,
    Grading,
    Method,
    Mix,
    Proportions,
    Ratios,
    Segregation,
    Shape,
)
from packstone._requests import encoded


def test_builders_are_the_dictionaries_of_requests() -> None:
    assert Box(150) == {"type": "box", "size_mm": [150, 150, 150]}
    assert Box(40, 50, 160, boundary="periodic")["size_mm"] == [40, 50, 160]
    with pytest.raises(ValueError, match="one edge length or three"):
        Box(40, 50)
    assert Mix("A16", 0.7, d_min_mm=2) == {
        "grading": {"type": "standard", "name": "A16"},
        "d_min_mm": 2,
        "volume_fraction": 0.7,
    }
    assert Method.edmd(time_s=5, growth_rate=0.1) == {"type": "edmd", "growth_rate": 0.1, "stop": {"time_s": 5}}
    assert "stop" not in Method.edmd()
    assert Mix(None, 0.5, aggregates=[Aggregate(1, "A8", name="gravel")]) == {
        "aggregates": [{"name": "gravel", "share": 1, "grading": {"type": "standard", "name": "A8"}}],
        "volume_fraction": 0.5,
    }
    assert Shape.polyhedron() == {"type": "polyhedron"}
    assert Shape.preset("fi15") == {"type": "preset", "name": "fi15"}
    assert Shape.polyhedron("voronoi", rounding=0.1) == {"type": "polyhedron", "template": "voronoi", "rounding": 0.1}
    assert Shape.polyhedron("octahedron") == {"type": "polyhedron", "template": "octahedron"}
    assert json.loads(json.dumps(Grading.classes([(2, 4, 0.5)])))["classes"][0]["mass_fraction"] == 0.5
    assert repr(Method.auto()) == "Method({'type': 'auto'})"
    assert pickle.loads(pickle.dumps(Box(1))) == Box(1)


@pytest.mark.parametrize(
    "job",
    [
        {"specimen": Box(40), "mix": Mix("A16", 0.3, d_min_mm=4)},
        {"specimen": Cylinder(40, 80), "mix": Mix(Grading.fuller(16), 0.3, d_min_mm=4)},
        {
            "specimen": Box(40, boundary="periodic"),
            "mix": Mix(Grading.monodisperse(5), 0.3),
            "distance": Distance.constant(0.1),
        },
        {
            "specimen": Box(40),
            "mix": Mix(
                Grading.sieves([(4, 0), (8, 0.5), (16, 1)]),
                proportions=Proportions(400, 0.6, air=0.05, additions=[packstone.Addition(60, 2300)]),
            ),
            "distance": Distance.smaller_diameter(0.05, wall_gap_mm=1),
            "method": Method.edmd(initial_scale=0.9, swap=False, equal_mass=True, stall_dt_s=1e-9, events=10**9),
        },
        {
            "specimen": Cylinder(60, 60),
            "mix": Mix(Grading.classes([(4, 8, 0.5), (8, 16, 0.5)]), 0.3, volume_fraction_of="placed_grains"),
            "distance": Distance.proportional(0.1),
            "segregation": Segregation.at_face("side", 3),
        },
        {
            "specimen": Box(40),
            "mix": Mix("A16", 0.3, d_min_mm=4, size="equivalent", shape=Shape.ellipsoid(Ratios.constant(0.8, 0.5))),
            "method": Method.monte_carlo(time_s=60, sweeps=1000),
        },
        {
            "specimen": Cylinder(40, 40),
            "mix": Mix(
                "A16",
                0.2,
                d_min_mm=4,
                shapes=[
                    (8, Shape.mixture([(0.5, Shape.sphere()), (0.5, Shape.ellipsoid(Ratios.flakiness(0.2)))])),
                    (0, Shape.ellipsoid(Ratios.independent(0.7, {"type": "uniform", "min": 0.4, "max": 0.8}))),
                ],
                orientation={"type": "axis", "axis": "z", "concentration": 2},
            ),
        },
        {"specimen": Box(40), "mix": Mix("A16", 0.2, d_min_mm=4, shape=Shape.ellipsoid(Ratios.shape_index(0.1)))},
        {"specimen": Box(40), "mix": Mix("A16", 0.2, d_min_mm=4, shape=Shape.ellipsoid(Ratios.triangle(0.5)))},
        {
            "specimen": Box(40),
            "mix": Mix("A16", 0.2, d_min_mm=4, shape=Shape.ellipsoid(Ratios.measured([(3, 2, 1), (4, 3, 2)], [1, 2]))),
        },
        {
            "specimen": Box(40),
            "mix": Mix(
                volume_fraction=0.2,
                d_min_mm=4,
                aggregates=[
                    Aggregate(0.5, "A8", density_kg_m3=2600, shape=Shape.ellipsoid(Ratios.constant(0.8, 0.5))),
                    Aggregate(
                        0.5, Grading.fuller(12), density_kg_m3=2900, d_min_mm=6, shapes=[(0, Shape.sphere())]
                    ),
                ],
            ),
        },
        *(
            {"specimen": Box(60), "mix": Mix(grading, 0.2)}
            for grading in (
                Grading.standard("8", "ASTM C33", "upper"),
                Grading.standard("5-20", "GB/T 14685"),
                Grading.andreasen(2, 12, 0.3),
                Grading.bolomey(12, 10),
                Grading.faury(12, 24),
                Grading.faury(12, 24, 2, mould_radius_mm=40),
                Grading.dreux_gorisse(12, 2),
                Grading.lognormal(6, 0.3, by="number"),
                Grading.normal(6, 1, d_max_mm=8),
                Grading.weibull(6, 4, by="mass", d_min_mm=3),
                Grading.rosin_rammler(6, 4),
                Grading.sizes([(4, 100), (8, 12)], by="number"),
                Grading.sizes(np.array([[4, 0.4], [8, 0.6]])),
            )
        ),
        {"specimen": Box(60), "mix": Mix("A16", d_min_mm=4, count=200)},
        {"specimen": Box(40), "mix": Mix("A16", 0.2, d_min_mm=4, shape=Shape.polyhedron())},
        {
            "specimen": Box(40),
            "mix": Mix(
                "A16",
                0.2,
                d_min_mm=4,
                shapes=[
                    (8, Shape.polyhedron(faces=40, rounding=0.05, ratios=Ratios.triangle(0.4), template_count=16)),
                    (
                        0,
                        Shape.mixture(
                            [
                                (0.5, Shape.polyhedron("deformed_cuboid", displacement=0.1)),
                                (0.5, Shape.polyhedron("voronoi", template_seed=3)),
                            ]
                        ),
                    ),
                ],
            ),
            "method": Method.rsa(),
        },
        {
            "specimen": Box(60),
            "mix": Mix(Grading.diameters(np.full(50, 8.0))),
            "distance": Distance.none(wall_gap_mm=1),
            "method": Method.rsa(attempts_per_grain=10_000),
            "segregation": Segregation.along("z", 3, direction="up"),
        },
    ],
)
def test_the_server_takes_what_is_built(client: packstone.Client, job: packstone.builders.JobFields) -> None:
    assert client.plan(**job)["grains"] > 10


def test_the_largest_distance_is_looked_for(client: packstone.Client) -> None:
    mix = Mix(Grading.diameters([10.0] * 20))
    plan = client.plan(specimen=Box(60), mix=mix, distance=Distance.maximize(), segregation=Segregation.none())
    assert plan["grains"] == 20


def test_edges_of_a_box_may_be_one_value() -> None:
    assert Box((60, 40, 20)) == Box(60, 40, 20) == Box([60, 40, 20])
    assert json.loads(encoded(Box(np.array([60, 40, 20]), boundary="periodic")))["size_mm"] == [60, 40, 20]
    for edges in [(60, 40), (60, 40, 20, 10)]:
        with pytest.raises(ValueError, match=f"x_mm: {len(edges)} edge lengths: a box has one or three"):
            Box(edges)
    with pytest.raises(ValueError, match="z_mm: x_mm has all edges"):
        Box((60, 40, 20), z_mm=20)


def test_short_forms_are_written_out(client: packstone.Client) -> None:
    whole = mixes.quick() | {"method": {"type": "rsa"}}
    short = whole | {"specimen": (40, 40, 40), "distance": 0.2, "method": "rsa"}
    packing = packstone.pack(whole)
    for job in (short, short | {"specimen": 40}, short | {"distance": np.float64(0.2)}):
        again = packstone.pack(job)
        assert np.array_equal(again.grains, packing.grains)
        assert again.request == packing.request
    assert client.submit(short).result().request["method"] == {"type": "rsa"}
    assert packstone.pack(whole, distance="none").request["distance"] == {"type": "none"}
    with pytest.raises(ValueError, match=r'method\.type: "rsq" is unknown: must be one of'):
        packstone.pack(whole, method="rsq")  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]


def test_short_forms_in_studies() -> None:
    template = mixes.without(mixes.quick(), "seed") | {"distance": 0.2}
    study = packstone.study(template=template, grid={"/method": ["rsa", "edmd"], "/distance": [0.1, 0.2]}, seed=1)
    assert [row["method"] for row in study.runs()] == ["rsa", "rsa", "edmd", "edmd"]
    jobs = packstone.study(list=[template, template | {"method": "edmd"}], seed=1)
    assert {row["outcome"] for row in jobs.runs()} == {"succeeded"}


def test_percent_is_said_and_never_guessed() -> None:
    table = [(4, 0), (8, 60.5), (16, 100)]
    curve = Grading.sieves(table, percent=True)
    assert curve["points"] == [[4, 0], [8, 0.605], [16, 1]] and Grading.sieves(np.array(table), percent=True) == curve
    with pytest.raises(ValueError, match="points: 60.5 passes 8 mm, which is no fraction from 0 to 1: pass percent=Tr"):
        Grading.sieves(table)
    # Percent that look like fractions, and fractions that are said to be percent.
    with pytest.raises(ValueError, match="percent: the largest of points is 1, which is a fraction: leave percent out"):
        Grading.sieves([(4, 0), (8, 0.5), (16, 1)], percent=True)
    with pytest.raises(ValueError, match="points: 101 passes 16 mm, which is more than 100 percent"):
        Grading.sieves([(4, 0), (8, 60.5), (16, 101)], percent=True)
    with pytest.raises(ValueError, match=r"points: \[4, 0, 1\] must have 2 numbers"):
        Grading.sieves([(4, 0, 1)])
    classes = Grading.classes([(4, 8, 40), (8, 16, 60)], percent=True)
    assert [item["mass_fraction"] for item in classes["classes"]] == [0.4, 0.6]
    with pytest.raises(ValueError, match="classes: 40 is the share of 4 to 8 mm, which is no fraction"):
        Grading.classes([(4, 8, 40), (8, 16, 60)])
