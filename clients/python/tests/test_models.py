"""Models of packings: meshes, voxels, cuts, lattices."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mixes
import numpy as np
import packstone
import pytest
from faulty_proxy import Answered, FaultyProxy


@pytest.fixture(scope="module")
def job(session_client: packstone.Client) -> packstone.Job:
    return session_client.submit(mixes.quick()).wait()


def test_a_model_is_asked_for_waited_for_and_saved(job: packstone.Job, tmp_path: Path) -> None:
    seen: list[str] = []
    model = job.derive("raw", cells=20, label="phase")
    model.wait(timeout=60, progress=lambda model: seen.append(model.state))
    assert model.succeeded and model.finished and model.error is None and seen[-1] == "succeeded"
    assert model.type == "raw" and model.options["cells"] == 20 and model.options["samples"] == 4
    saved = model.save(tmp_path / "labels.raw")
    labels = np.fromfile(saved, dtype=model.report["dtype"])
    assert labels.size == np.prod(model.report["shape"])
    fraction = model.report["volume_fraction"]
    assert fraction == pytest.approx(job.result().summary["volume_fraction_effective"])
    assert labels.mean() == pytest.approx(fraction, rel=0.2)
    assert model.read() == saved.read_bytes()
    assert job.derive("raw", cells=20).id == model.id, "the same is made once"
    assert [found.id for found in job.derived()].count(model.id) == 1
    assert str(model) == f"raw {model.id}: succeeded"


def test_a_model_may_be_a_format_of_the_result(job: packstone.Job, tmp_path: Path) -> None:
    result = job.result()
    saved = result.save(tmp_path / "a.vti", cells=10, fractions=True)
    assert saved.read_bytes() == result.read("vti", cells=10, fractions=True)
    assert saved.read_bytes().startswith(b"<?xml")
    archive = result.save(tmp_path / "surfaces.zip", "stl", segments=8)
    assert archive.read_bytes().startswith(b"PK")


def test_a_cut_is_a_picture_or_a_table(job: packstone.Job, tmp_path: Path) -> None:
    cut = json.loads(job.slice(tmp_path / "cut.json", axis="x", at_mm=10))
    assert json.loads((tmp_path / "cut.json").read_text()) == cut
    assert cut["axis"] == "x" and cut["at_mm"] == 10 and 0 < cut["area_fraction"] < 1
    assert job.slice(form="png", pixels=64).startswith(b"\x89PNG")
    assert b"<svg" in job.slice()
    with pytest.raises(ValueError, match="'gif' is no form of cuts: must be one of svg, png, json, geo"):
        job.slice(tmp_path / "a.gif")


def test_a_job_may_ask_beforehand(client: packstone.Client) -> None:
    job = client.submit(mixes.quick(), postprocess=[{"type": "raw", "cells": 8}, {"type": "slice"}]).wait()
    assert sorted(model.wait(60).type for model in job.derived()) == ["raw", "slice"]
    model = next(job.derived())
    model.delete()
    assert [left.id for left in job.derived()] != [] and model.id not in {left.id for left in job.derived()}


@pytest.mark.parametrize(
    ("type", "options", "kind"),
    [
        ("raw", {"cells": 0}, "validation-error"),
        ("raw", {"colour": "red"}, "validation-error"),
        ("raw", {"cells": 8000}, "too-large"),
        ("ball", {}, "validation-error"),
    ],
)
def test_what_cannot_be_made_is_refused(
    job: packstone.Job, type: str, options: dict[str, Any], kind: str
) -> None:
    with pytest.raises(packstone.PackstoneError) as refused:
        job.derive(type, **options)
    assert refused.value.kind == kind
    assert refused.value.errors[0].pointer == f"/{next(iter(options), 'type')}"


def test_what_takes_long_is_asked_for_again(proxy: FaultyProxy, pauses: list[float]) -> None:
    with packstone.Client(proxy.url, retry_s=0.001) as client:
        job = client.submit(mixes.quick()).wait()
        problem = {"type": "/problems/format-not-ready", "status": 404, "detail": "it is being made"}
        headers = {"retry-after": "2", "content-type": "application/problem+json"}
        proxy.faults.extend([Answered(404, headers, json.dumps(problem).encode())] * 2)
        assert len(job.result().read("raw", cells=10)) == 1000
    assert pauses == [2.0, 2.0], "as long as the server asks for, and longer than failures are met"
