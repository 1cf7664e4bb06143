"""Studies that are run from this process, against those of the service."""

from __future__ import annotations

import _thread
import concurrent.futures
import importlib.util
import logging
import math
from pathlib import Path
from typing import Any

import mixes
import numpy as np
import packstone
import pytest

STUDY: mixes.Json = {
    "name": "two times two",
    "seed": 11,
    "template": mixes.without(mixes.quick(), "seed"),
    "grid": {"/mix/volume_fraction": [0.2, 0.3], "/method": [{"type": "rsa"}, {"type": "edmd"}]},
    "replicates": 2,
}


def untimed(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows without what no two runs agree on."""
    return [
        {name: value for name, value in row.items() if "time" not in name and not name.endswith("_us_median")}
        for row in rows
    ]


def test_the_table_is_that_of_the_service(client: packstone.Client, tmp_path: Path) -> None:
    there = client.study(STUDY).wait()
    seen: list[int] = []
    here = packstone.study(STUDY, keep=True, progress=lambda study: seen.append(len(study.runs())))
    assert seen == list(range(1, 9))
    assert (here.name, here.seed, here.points, here.jobs) == ("two times two", 11, 4, 8)
    assert here.columns == there.columns
    assert untimed(here.table()) == untimed(there.table())
    assert list(here.to_dataframe().columns) == list(there.to_dataframe().columns)
    by_place = {(job.data["point"], job.data["replicate"]): job for job in there.jobs()}
    assert by_place.keys() == here.packings.keys()
    for place, job in by_place.items():
        assert np.array_equal(job.result().grains, here.packings[place].grains), place
    runs = here.runs_dataframe()
    assert list(runs["seed"]) == [by_place[place].data["seed"] for place in sorted(by_place)]
    assert set(runs["method"]) == {"rsa", "edmd"} and set(runs["outcome"]) == {"succeeded"}
    saved = here.save_all(tmp_path / "kept", "npy", "{method}-{volume_fraction}-{replicate}")
    assert [path.name for path in saved][:2] == ["rsa-0.2-0.npy", "rsa-0.2-1.npy"] and len(saved) == 8
    with pytest.raises(ValueError, match="are both named"):
        here.save_all(tmp_path / "twice", "npy", "{method}")
    table = here.to_csv(tmp_path / "new" / "table.csv").read_text()
    assert table.startswith("/mix/volume_fraction,/method,grains,") and table.count("\n") == 5
    svg = here.plot("success", tmp_path / "success.svg", theme="dark")
    assert svg.startswith("<svg") and (tmp_path / "success.svg").read_text() == svg
    with pytest.raises(packstone.PackstoneError) as refused:
        here.plot("success", x="colour")
    assert "colour" in refused.value.detail


def test_warnings_are_told_once_each_with_their_points(client: packstone.Client) -> None:
    template = mixes.without(mixes.quick(), "seed")
    template["mix"] = template["mix"] | {"allow_coarse": True}
    # So few grains that whole ones miss the volume: the points 2 and 3.
    grid = {"/mix/volume_fraction": [0.3, 1e-6], "/distance/gap_mm": [0.2, 0.201]}
    study = {"template": template, "grid": grid, "seed": 1}
    with pytest.warns(packstone.PackstoneWarning):
        here = packstone.study(study).warnings
    with pytest.warns(packstone.PackstoneWarning) as seen:
        there = client.study(study).wait().warnings
    assert here == there and here
    assert [str(warning.message) for warning in seen] == there
    with pytest.warns(packstone.PackstoneWarning):
        ample, coarse = (
            client.plan(template | {"mix": template["mix"] | {"volume_fraction": fraction}})["warnings"]
            for fraction in (0.3, 1e-6)
        )
    assert set(ample) < set(coarse)
    points = {text: "all 4 points" if text in ample else "2 of 4 points" for text in coarse}
    assert sorted(here) == sorted(f"{text} ({of})" for text, of in points.items())


def test_runs_that_fail_count_and_a_stop_rule_ends_a_point() -> None:
    template = mixes.without(mixes.unreachable(), "seed")
    study = packstone.study(template=template, replicates=40, stop_when={"failed_in_a_row": 3}, seed=1, workers=1)
    (row,) = study.table()
    # Runs that had started when the rule was met are counted.
    assert 3 <= row["runs"] <= 5 and row["successes"] == 0
    assert row["stopped_early"] == 40 - row["runs"] and row["waiting"] == 0
    assert {run["error"] for run in study.runs()} == {"target-not-reached"}
    with pytest.raises(ValueError, match="keep=True"):
        study.save_all("nowhere")


def test_a_run_past_its_time_did_not_reach_its_packing() -> None:
    template = mixes.without(mixes.endless(), "seed") | {"timeout_s": 0.3}
    (run,) = packstone.study(template=template, seed=1).runs()
    assert (run["outcome"], run["error"]) == ("target_not_reached", "timed-out")


def test_refused_studies_tell_all_faults() -> None:
    with pytest.raises(packstone.PackstoneError) as refused:
        packstone.study(STUDY, grid={"/mix/volume_fraction": [0.2, 3]})
    assert refused.value.kind == "validation-error"
    assert [fault.pointer for fault in refused.value.errors] == ["/grid/~1mix~1volume_fraction/1"]
    with pytest.raises(TypeError, match="no executor"):
        packstone.study(STUDY, executor=object())


def test_an_interrupt_ends_the_runs_of_this_process() -> None:
    def interrupt(_: packstone.LocalStudy) -> None:
        _thread.interrupt_main()

    # The second point would run for ever.
    jobs = [mixes.quick(), mixes.endless()]
    with pytest.raises(KeyboardInterrupt):
        packstone.study(list=jobs, workers=2, progress=interrupt)


def check_executor(executor: object) -> None:
    """A study on an executor has the packings of one in this process."""
    here = packstone.study(STUDY, keep=True)
    there = packstone.study(STUDY, keep=True, executor=executor, workers=2)
    assert untimed(here.table()) == untimed(there.table())
    assert here.packings.keys() == there.packings.keys()
    for place, packing in here.packings.items():
        assert np.array_equal(packing.grains, there.packings[place].grains), place
        assert not math.isnan(there.packings[place].summary["volume_fraction_effective"])


def test_processes_have_the_same_bits() -> None:
    with concurrent.futures.ProcessPoolExecutor(2) as executor:
        check_executor(executor)


@pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="dask.distributed is not installed")
# Its own code warns of deprecations.
@pytest.mark.filterwarnings("default", "ignore::packstone.PackstoneWarning")
def test_dask_has_the_same_bits() -> None:
    from distributed import Client, LocalCluster

    cluster = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)  # type: ignore[no-untyped-call]
    with cluster, Client(cluster) as dask:  # type: ignore[no-untyped-call]
        check_executor(dask)


@pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="ray is not installed")
@pytest.mark.filterwarnings("default", "ignore::packstone.PackstoneWarning")
def test_ray_has_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import ray

    # Its workers import from the current folder before they look for what is installed.
    monkeypatch.chdir(tmp_path)
    ray.init(num_cpus=2, include_dashboard=False, logging_level=logging.ERROR)
    try:
        check_executor(ray)
    finally:
        ray.shutdown()
