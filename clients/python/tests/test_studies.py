"""Studies: many packings from one request."""

from __future__ import annotations

from pathlib import Path
from uuid import uuid4

import mixes
import packstone
import pytest
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


def test_the_table_has_a_row_per_point(study: packstone.Study) -> None:
    rows = study.table()
    expected = [(phi, method) for phi in (0.2, 0.25, 0.3) for method in ("rsa", "edmd")]
    assert [(row[PHI], row[METHOD]) for row in rows] == expected
    assert all(row["runs"] == row["successes"] == 2 and row["success_rate"] == 1 for row in rows)
    grains = {phi: {row["grains"] for row in rows if row[PHI] == phi} for phi in (0.2, 0.25, 0.3)}
    assert all(len(same) == 1 for same in grains.values()), "both methods pack the same grains"
    table = study.to_dataframe()
    assert table.shape == (6, len(rows[0]))
    assert table.set_index([PHI, METHOD]).loc[(0.25, "edmd"), "successes"] == 2


def test_the_jobs_of_a_study_are_jobs(client: packstone.Client, study: packstone.Study) -> None:
    jobs = list(study.jobs())
    assert len(jobs) == 12 and all(isinstance(job, packstone.Job) for job in jobs)
    assert len({job.seed for job in jobs}) == 6, "a seed per volume fraction and replicate"
    assert {job.id for job in client.jobs(study=study.id)} == {job.id for job in jobs}
    assert list(study.jobs(state="failed")) == []
    assert jobs[0].result().to_numpy().shape[1] == 4


def test_plots_of_a_study(study: packstone.Study, tmp_path: Path) -> None:
    svg = study.plot("success", tmp_path / "success.svg")
    assert svg.startswith(("<svg", "<?xml")) and svg._repr_svg_() == svg
    assert (tmp_path / "success.svg").read_text(encoding="utf-8") == svg
    against_grains = study.plot("time", x="grains", log_x=True)
    assert against_grains != study.plot("time")
    with pytest.raises(packstone.PackstoneError) as refused:
        study.plot("success", x="/mix/nothing")
    assert [fault.parameter for fault in refused.value.errors] == ["x"]


def test_plots_of_a_job(study: packstone.Study, tmp_path: Path) -> None:
    job = next(study.jobs())
    for kind in packstone.jobs.JOB_PLOT_KINDS:
        assert "</svg>" in job.plot(kind, tmp_path / f"{kind}.svg"), kind
    assert len(list(tmp_path.iterdir())) == 4


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
