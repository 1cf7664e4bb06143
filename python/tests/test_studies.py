"""Studies: many packings from one request."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any
from uuid import uuid4

import mixes
import numpy as np
import packstone
import pytest
from packstone._sources import PACKING_PLOT_KINDS
from faulty_proxy import AnswerLost, FaultyProxy

PHI, METHOD = "/mix/volume_fraction", "/method/type"
TEMPLATE = mixes.without(mixes.quick(), "seed") | {"method": {"type": "rsa"}}
GRID = {PHI: packstone.steps(0.2, 0.3, 0.05), METHOD: ["rsa", "edmd"]}


@pytest.fixture(scope="session")
def study(session_client: packstone.Client) -> packstone.Study:
    """A study that has ended: three volume fractions, two methods, two seeds."""
    return session_client.study(
        name="small", seed=1, labels={"series": "TB-8"}, template=TEMPLATE, grid=GRID, replicates=2
    ).wait(timeout=300)


def test_a_study_runs_to_its_end(client: packstone.Client, study: packstone.Study) -> None:
    assert study.finished and study.finished_at is not None
    assert (study.name, study.labels, study.seed) == ("small", {"series": "TB-8"}, 1)
    assert (study.points, study.columns) == (6, [PHI, METHOD])
    assert study.counts == {"queued": 0, "running": 0, "succeeded": 12, "failed": 0, "cancelled": 0}
    assert str(study) == f"study 'small' ({study.id}): 12 of 12 jobs ended, 12 succeeded"
    again = client.open_study(study.id)
    assert again.data == study.data
    assert again.request["replicates"] == 2


def test_a_study_is_shared_with_its_jobs(client: packstone.Client) -> None:
    study = client.study(template=TEMPLATE, grid={PHI: [0.2]}, shared=True).wait(timeout=300)
    assert study.data["shared"] is True
    assert [job.data["shared"] for job in study.jobs()] == [True]
    study.update(shared=False)
    assert [job.data["shared"] for job in client.open_study(study.id).jobs()] == [False]


def test_the_table_has_a_row_per_point(study: packstone.Study) -> None:
    rows = study.table()
    expected = [(phi, method) for phi in (0.2, 0.25, 0.3) for method in ("rsa", "edmd")]
    assert [(row[PHI], row[METHOD]) for row in rows] == expected
    assert all(row["runs"] == row["successes"] == 2 and row["success_rate"] == 1 for row in rows)
    grains = {phi: {row["grains"] for row in rows if row[PHI] == phi} for phi in (0.2, 0.25, 0.3)}
    assert all(len(same) == 1 for same in grains.values()), "both methods pack the same grains"
    table = study.to_dataframe()
    assert table.shape == (6, len(rows[0]))
    assert list(table.columns[:2]) == ["volume_fraction", "method"]
    assert table.attrs["pointers"] == {PHI: "volume_fraction", METHOD: "method"}
    assert table.set_index(["volume_fraction", "method"])["successes"].to_dict()[0.25, "edmd"] == 2


def test_tables_with_objects_group_and_pivot(client: packstone.Client) -> None:
    gradings = [packstone.Grading.standard("A16"), packstone.Grading.fuller(16)]
    study = client.study(template=TEMPLATE, grid={"/mix/grading": gradings, PHI: [0.2, 0.25]}).wait()
    table = study.to_dataframe()
    assert list(table["grading"].unique()) == ["A16", "fuller d_max_mm=16 exponent=0.5"]
    pivot = table.pivot_table(index="volume_fraction", columns="grading", values="success_rate")
    assert pivot["A16"].to_dict()[0.25] == 1
    assert table.groupby("grading").successes.sum().tolist() == [2, 2]
    named = study.to_dataframe(labels={"/mix/grading": ["A", "Fuller"]}, names={PHI: "phi"})
    assert list(named["grading"]) == ["A", "A", "Fuller", "Fuller"] and list(named["phi"][:2]) == [0.2, 0.25]
    by_value = study.to_dataframe(labels={"grading": lambda value: value["type"]})
    assert set(by_value["grading"]) == {"standard", "fuller"}
    by_text = study.to_dataframe(labels={"grading": {"A16": "coarse"}})
    assert set(by_text["grading"]) == {"coarse", "fuller d_max_mm=16 exponent=0.5"}
    with pytest.raises(ValueError, match="3 labels for 2 values: A16, fuller"):
        study.to_dataframe(labels={"grading": ["A", "B", "C"]})
    with pytest.raises(ValueError, match="'nothing' is not a column of the study: must be one of /mix/grading"):
        study.to_dataframe(names={"nothing": "x"})


def test_the_table_of_runs_has_a_row_per_run(study: packstone.Study) -> None:
    runs = study.runs_dataframe()
    assert len(runs) == 12 and runs["started_at"].is_monotonic_increasing
    assert runs.groupby(["volume_fraction", "method"]).size().tolist() == [2] * 6
    assert runs.groupby("volume_fraction")["seed"].nunique().tolist() == [2, 2, 2]
    assert set(runs["replicate"]) == {0, 1} and set(runs["state"]) == {"succeeded"}
    assert runs["elapsed_s"].ge(0).all() and runs["error"].isna().all()
    dense = runs[runs.volume_fraction == 0.3].volume_fraction_effective
    assert dense.min() > runs[runs.volume_fraction == 0.2].volume_fraction_effective.max()
    for job in study.jobs():
        row = runs[runs["id"] == job.id].to_dict("records")[0]
        assert row["method"] == job.request["method"]["type"] and row["seed"] == job.seed
        assert row["volume_fraction"] == job.request["mix"]["volume_fraction"]


def test_the_table_of_runs_says_what_failed_runs_reached(client: packstone.Client) -> None:
    template = mixes.without(mixes.unreachable(), "seed")
    study = client.study(template=template, grid={"/mix/volume_fraction": [0.2, 0.5]}).wait()
    done, failed = study.runs()
    assert (done["error"], failed["error"]) == (None, "target-not-reached")
    assert 0.2 < failed["volume_fraction_reached"] < 0.4


def test_a_column_with_the_name_of_a_figure_keeps_its_values(client: packstone.Client) -> None:
    study = client.study(template=TEMPLATE, grid={"/mix/d_min_mm": [4, 6]}).wait()
    runs = study.runs()
    assert [run["d_min_mm"] for run in runs] == [4, 6]
    assert runs[0]["result_d_min_mm"] >= 4 and runs[1]["result_d_min_mm"] >= 6


def test_all_packings_are_saved_by_their_values(study: packstone.Study, tmp_path: Path) -> None:
    saved = study.save_all(tmp_path / "new" / "all", "npy", "{method}/{volume_fraction:.3f}-{seed}", parallel=3)
    assert len(set(saved)) == 12 and {path.parent.name for path in saved} == {"rsa", "edmd"}
    for path, job in zip(saved, study.jobs(), strict=True):
        fraction, method = job.request["mix"]["volume_fraction"], job.request["method"]["type"]
        assert path == tmp_path / "new" / "all" / method / f"{fraction:.3f}-{job.seed}.npy"
        assert np.array_equal(np.load(path), job.result().grains)


def test_names_of_saved_files(
    client: packstone.Client, study: packstone.Study, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = next(study.jobs())
    saved = study.save_all(tmp_path, "csv", progress=True)
    assert saved[0].name == f"0.2-rsa-{first.seed}.csv"
    assert "12 of 12 files" in capsys.readouterr().err
    with pytest.raises(ValueError, match="are both named 0.2.csv: add a field such as {seed}"):
        study.save_all(tmp_path / "none", "csv", "{volume_fraction}")
    with pytest.raises(ValueError, match="names 'colour': must be one of id, name, point"):
        study.save_all(tmp_path / "none", "csv", "{colour}")
    unknown: Any = "ply"
    with pytest.raises(ValueError, match="'ply' is not a format of packings"):
        study.save_all(tmp_path / "none", unknown)
    assert not (tmp_path / "none").exists()
    wild = client.study(list=[mixes.quick(seed) | {"name": "../../x y"} for seed in (1, 2)]).wait()
    names = [path.relative_to(tmp_path).as_posix() for path in wild.save_all(tmp_path, "csv", "{name}_{seed}")]
    assert names == ["x_y_1.csv", "x_y_2.csv"]
    assert [path.name for path in wild.save_all(tmp_path, "csv")] == ["0-x_y-1.csv", "1-x_y-2.csv"]


def test_notebooks_show_a_study(study: packstone.Study) -> None:
    assert "succeeded</th><td" in study._repr_html_() and "study &#x27;small&#x27;" in study._repr_html_()
    assert repr(study) == f"<Study {study.id} 12 of 12 jobs ended, 12 succeeded>"
    assert pickle.loads(pickle.dumps(study)).table() == study.table()


def test_the_jobs_of_a_study_are_jobs(client: packstone.Client, study: packstone.Study) -> None:
    jobs = list(study.jobs())
    assert [job.created_at for job in jobs] == sorted(job.created_at for job in jobs)
    assert [(job.data["replicate"], job.data["point"]) for job in jobs] == [(r, p) for r in (0, 1) for p in range(6)]
    assert len(jobs) == 12 and all(isinstance(job, packstone.Job) for job in jobs)
    assert len({job.seed for job in jobs}) == 6, "a seed per volume fraction and replicate"
    assert {job.id for job in client.jobs(study=study.id)} == {job.id for job in jobs}
    assert list(study.jobs(state="failed")) == []
    assert jobs[0].result().grains.shape[1] == 4


def test_plots_of_a_study(study: packstone.Study, tmp_path: Path) -> None:
    svg = study.plot("success", tmp_path / "success.svg")
    assert svg.startswith(("<svg", "<?xml")) and svg._repr_svg_() == svg
    assert (tmp_path / "success.svg").read_text(encoding="utf-8") == svg
    against_grains = study.plot("time", x="grains", log_x=True)
    assert against_grains != study.plot("time")
    with pytest.raises(packstone.PackstoneError) as refused:
        study.plot("success", x="/mix/nothing")
    assert [fault.parameter for fault in refused.value.errors] == ["x"]


def test_plots_of_a_job(client: packstone.Client, tmp_path: Path) -> None:
    document = mixes.quick()
    # Grains enough for a pair correlation function.
    document["mix"]["d_min_mm"] = 2
    job = client.submit(document).wait()
    available = set(PACKING_PLOT_KINDS) - {"distance", "zingg", "flakiness"}
    for kind in available:
        assert "</svg>" in job.plot(kind, tmp_path / f"{kind}.svg"), kind
    assert {path.stem for path in tmp_path.iterdir()} == available
    titled, untitled = (job.plot("grading", title=title) for title in (True, False))
    assert "Grading curve" in titled and len(untitled) < len(titled)
    with pytest.raises(packstone.PackstoneError) as refused:
        job.plot("distance")
    assert refused.value.status == 422 and "`growth`" in str(refused.value)
    with pytest.raises(packstone.PackstoneError) as refused:
        job.plot("zingg")
    assert refused.value.status == 422 and "ellipsoids" in str(refused.value)


def test_a_study_is_found_by_its_labels(client: packstone.Client) -> None:
    series = uuid4().hex
    submitted = [
        client.study(labels={"series": series}, template=TEMPLATE, grid={PHI: [0.2]}).id for _ in range(3)
    ]
    found = list(client.studies(labels={"series": series}, page_size=2))
    assert [study.id for study in found] == submitted[::-1]
    for study in found:
        study.wait()
    assert found[0].request["grid"] == {PHI: [0.2]}
    assert len(list(client.studies(labels={"series": series}, state="finished"))) == 3
    assert list(client.studies(labels={"series": series}, state="open")) == []


def test_a_list_of_jobs_and_a_document(client: packstone.Client) -> None:
    listed = client.study(list=[mixes.quick(1), mixes.quick(2)]).wait()
    assert listed.counts["succeeded"] == 2 and sorted(job.seed for job in listed.jobs()) == [1, 2]
    document = {"name": "file", "template": TEMPLATE, "grid": {PHI: [0.2]}}
    study = client.study(document, name="by name").wait()
    assert study.name == "by name" and study.points == 1


def test_progress_cancel_retry_and_delete(client: packstone.Client) -> None:
    template = mixes.without(mixes.endless(), "seed")
    study = client.study(template=template, grid={"/mix/d_min_mm": [2, 2.5, 3]}, stop_when={"failed_in_a_row": 2})
    told: list[str] = []

    def note(seen: packstone.Study) -> None:
        told.append(str(seen))
        if seen.counts["running"] and not seen.counts["cancelled"]:
            seen.cancel()

    assert study.wait(progress=note) is study
    assert study.counts["cancelled"] == 3 and told[-1].endswith("3 of 3 jobs ended, 0 succeeded")
    assert not study.retry(cancelled=True).finished
    with pytest.raises(packstone.WaitTimeout, match="has not ended within 0.01 s"):
        study.wait(0.01)
    with pytest.raises(packstone.PackstoneError) as refused:
        study.delete()
    assert refused.value.kind == "conflict"
    jobs = [job.id for job in study.jobs()]
    study.cancel().wait().delete()
    with pytest.raises(packstone.PackstoneError, match="there is no study"):
        client.open_study(study.id)
    with pytest.raises(packstone.PackstoneError, match="there is no job"):
        client.job(jobs[0])


def test_news_of_quick_jobs_is_gathered(client: packstone.Client, monkeypatch: pytest.MonkeyPatch) -> None:
    pauses: list[float] = []
    monkeypatch.setattr("packstone._resource.sleep", pauses.append)
    told: list[int] = []
    study = client.study(template=TEMPLATE, grid=GRID, replicates=5)
    study.wait(progress=lambda seen: told.append(seen.progress["done"]))
    assert told == sorted(told) and told[-1] == 30
    # Between any two questions, of which the first brings the news that were told second.
    assert len(pauses) == len(told) - 2 and all(0 <= pause <= 0.25 for pause in pauses)


def test_faults_name_the_place_in_the_study(client: packstone.Client) -> None:
    with pytest.raises(packstone.PackstoneError) as refused:
        client.study(template=TEMPLATE, grid={PHI: [0.2, 1.5]})
    assert [fault.pointer for fault in refused.value.errors] == ["/grid/~1mix~1volume_fraction/1"]
    with pytest.raises(packstone.PackstoneError) as refused:
        client.study(list=[mixes.quick(), mixes.quick() | {"colour": "red"}])
    assert [fault.pointer for fault in refused.value.errors] == ["/list/1/colour"]


def test_a_study_whose_answer_is_lost_is_one_study(
    client: packstone.Client, proxy: FaultyProxy, pauses: list[float]
) -> None:
    series = uuid4().hex
    proxy.faults.append(AnswerLost())
    with packstone.Client(proxy.url) as unlucky:
        study = unlucky.study(labels={"series": series}, template=TEMPLATE, grid=GRID).wait()
    assert [found.id for found in client.studies(labels={"series": series})] == [study.id]
    assert len(pauses) == 1
