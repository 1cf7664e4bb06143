"""Gradings and recipes as laboratories print them."""

from __future__ import annotations

import json
from pathlib import Path

import packstone
import pytest
from live_server import LiveServer
from packstone import Box, Mix, PackstoneError

CURVE = "Sieve (mm);Passing (%)\n0,063;1,5\n0,25;8\n1;24\n4;51,5\n8;74\n16;100\n"
POINTS = ((0.063, 0.015), (0.25, 0.08), (1.0, 0.24), (4.0, 0.515), (8.0, 0.74), (16.0, 1.0))
TWO = (
    "Sieve (mm);Sand 0/4, passing %;Gravel 4/16, passing %\n"
    "16;100;100\n8;100;40\n4;98;5\n1;55;1\n0,25;12;0\n0,063;0;0\n"
)
RECIPE = (
    "Material;kg/m3;Density kg/m3\nCement CEM I 42,5 R;350;3100\nWater;175;1000\n"
    "Sand 0/4;750;2650\nGravel 4/16;1080;2680\n"
)


def test_a_table_is_read_from_a_path_from_bytes_and_from_a_text(tmp_path: Path) -> None:
    path = tmp_path / "curve.csv"
    path.write_text(CURVE, encoding="utf-16")
    for table in (path, str(path), path.read_bytes(), CURVE):
        reading = Mix.read(table)
        assert reading.verdict == "ok"
        (curve,) = reading.curves
        assert (curve.points, curve.meaning, curve.unit) == (POINTS, "passing", "mm")
        grading = reading.request["mix"]["grading"]
        assert grading["points"] == [list(point) for point in POINTS]
    assert "6 sieves, 0.063 to 16 mm" in repr(reading)


def test_one_call_packs_what_was_read() -> None:
    mix = {**Mix.read(CURVE).request["mix"], "volume_fraction": 0.3, "d_min_mm": 4}
    packing = packstone.pack(specimen=Box(60), mix=mix, seed=1)
    assert len(packing) > 10


def test_a_table_with_two_readings_asks_and_an_option_chooses() -> None:
    reading = Mix.read(TWO)
    assert reading.verdict == "ask"
    assert len(reading.candidates) >= 2
    assert all(candidate.request["mix"] for candidate in reading.candidates)
    with pytest.raises(PackstoneError, match="choose one of `candidates`") as refused:
        _ = reading.request
    assert all(candidate.label in str(refused.value) for candidate in reading.candidates)
    assert "candidates" in repr(reading)
    chosen = Mix.read(TWO, column="3")
    (curve,) = chosen.curves
    assert dict(curve.points)[4.0] == 0.05


def test_a_recipe_has_its_parts() -> None:
    reading = Mix.read(RECIPE)
    (recipe,) = reading.recipes
    assert (recipe.cement_kg_m3, recipe.water_kg_m3, recipe.water_cement) == (350, 175, 0.5)
    assert [(one.mass_kg_m3, one.density_kg_m3) for one in recipe.aggregates] == [(750, 2650), (1080, 2680)]
    assert recipe.volume_sum_m3 == pytest.approx(350 / 3100 + 0.175 + 750 / 2650 + 1080 / 2680, abs=1e-4)


def test_a_file_without_a_table_raises_when_its_request_is_used(tmp_path: Path) -> None:
    reading = Mix.read(b"%PDF-1.7")
    assert reading.verdict == "refuse"
    assert "PDF" in repr(reading)
    with pytest.raises(PackstoneError, match="PDF"):
        _ = reading.request
    with pytest.raises(FileNotFoundError):
        Mix.read(tmp_path / "none.csv")
    with pytest.raises(PackstoneError, match="furlong.*must be one of mm, um, in"):
        Mix.read(CURVE, unit="furlong")  # type: ignore[arg-type]


def test_the_package_and_the_service_answer_alike(server: LiveServer) -> None:
    import httpx

    for table in (CURVE, TWO, RECIPE, "no table"):
        answer = httpx.post(f"{server.url}/v1/mixes/read", content=table.encode())
        assert answer.status_code == 200
        assert answer.json() == json.loads(json.dumps(Mix.read(table.encode()).document))
