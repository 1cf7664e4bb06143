"""Submitting jobs, waiting for them, finding them again."""

from __future__ import annotations

import pickle
import sys
import warnings
from concurrent.futures import ProcessPoolExecutor
from datetime import datetime, timedelta, timezone
from multiprocessing import get_context
from types import MappingProxyType
from typing import Any
from uuid import uuid4

import mixes
import numpy as np
import packstone
import pytest
from faulty_proxy import FaultyProxy
from grains import grains_of
from live_server import LiveServer


def test_a_job_is_submitted_waited_for_and_found_again(client: packstone.Client) -> None:
    job = client.submit(mixes.quick(), name="first", labels={"series": "TB-7"})
    assert (job.name, job.labels, job.seed) == ("first", {"series": "TB-7"}, 1)
    assert job.wait() is job
    assert job.succeeded and job.finished and job.error is None
    assert job.finished_at is not None and job.created_at < job.finished_at
    again = client.job(job.id)
    assert again.data == job.data
    assert again.request["mix"]["volume_fraction"] == 0.3
    assert str(again) == f"job 'first' ({job.id}): succeeded"


def test_fields_by_name_replace_those_of_the_mapping(client: packstone.Client) -> None:
    job = client.submit(mixes.quick(seed=1), seed=2)
    assert job.seed == 2
    by_name = client.submit(specimen=mixes.quick()["specimen"], mix=mixes.quick()["mix"], seed=3)
    assert by_name.request["specimen"]["size_mm"] == [40, 40, 40]


def test_numbers_and_arrays_of_numpy_are_taken(client: packstone.Client) -> None:
    job = client.submit(
        seed=np.int64(5),
        specimen=MappingProxyType({"type": "box", "size_mm": np.full(3, 40.0)}),
        mix={"grading": {"type": "diameters", "diameters_mm": np.array([12.5, 10.0])}},
    )
    assert job.seed == 5
    assert job.request["mix"]["grading"]["diameters_mm"] == [12.5, 10]
    with pytest.raises(ValueError, match="JSON"):
        client.submit(mixes.quick(), timeout_s=float("nan"))
    with pytest.raises(TypeError, match="cannot be written as JSON"):
        client.submit(mixes.quick() | {"name": object()})


def test_a_plan_stores_nothing(client: packstone.Client) -> None:
    series = uuid4().hex
    plan = client.plan(mixes.quick(), labels={"series": series})
    assert plan["grains"] > 10 and plan["volume_fraction_effective"] < 0.3
    assert list(client.jobs(labels={"series": series})) == []


def test_listings_go_on_from_page_to_page(client: packstone.Client) -> None:
    series = uuid4().hex
    submitted = [client.submit(mixes.quick(seed), labels={"series": series}).id for seed in range(5)]
    listed = client.jobs(labels={"series": series}, page_size=2)
    assert [job.id for job in listed] == submitted[::-1]
    first = next(client.jobs(labels={"series": series}))
    assert first.request["seed"] == 4, "a listing leaves the request out; it is fetched when it is needed"
    first.wait()
    finished = client.jobs(labels={"series": series}, state="succeeded")
    assert first.id in [job.id for job in finished]


def test_progress_is_told_to_the_end(client: packstone.Client) -> None:
    job = client.submit(mixes.endless())
    told: list[tuple[packstone.jobs.State, float]] = []

    def note(seen: packstone.Job) -> None:
        told.append((seen.state, seen.progress.get("fraction", 0.0)))
        if seen.state == "running" and len(told) > 3 and not seen.data["cancel_requested"]:
            assert "running" in str(seen)
            seen.cancel()

    job.wait(progress=note)
    states = [state for state, _ in told]
    assert states[-1] == "cancelled" and "running" in states
    fractions = [fraction for _, fraction in told]
    assert fractions == sorted(fractions)


def test_a_job_that_has_ended_is_told_once(client: packstone.Client) -> None:
    job = client.submit(mixes.quick()).wait()
    told: list[str] = []
    job.wait(progress=lambda seen: told.append(seen.state))
    assert told == ["succeeded"]


def test_a_wait_may_be_limited_and_the_job_goes_on(client: packstone.Client) -> None:
    job = client.submit(mixes.endless())
    with pytest.raises(packstone.WaitTimeout, match="has not ended within 0.01 s"):
        job.wait(0.01)
    with pytest.raises(TimeoutError):
        job.result(timeout=0.01)
    assert not job.refresh().finished
    job.cancel().wait()
    with pytest.raises(packstone.JobCancelled, match="endless"):
        job.result()


def test_retry_and_delete(client: packstone.Client) -> None:
    job = client.submit(mixes.endless())
    job.cancel().wait()
    assert job.retry().state == "queued" and job.data["attempt"] > 1
    job.cancel().wait().delete()
    with pytest.raises(packstone.PackstoneError) as gone:
        client.job(job.id)
    assert gone.value.kind == "not-found" and gone.value.status == 404


def test_waiting_is_one_request_that_is_held_back(proxy: FaultyProxy) -> None:
    with packstone.Client(proxy.url) as client:
        job = client.submit(mixes.quick()).wait()
    assert job.succeeded
    assert [seen.method for seen in proxy.seen] == ["POST", "GET"]
    assert proxy.seen[1].headers["prefer"] == "wait=60"


def test_waiting_does_not_spin_where_no_answer_is_held_back(
    server: LiveServer, proxy: FaultyProxy, monkeypatch: pytest.MonkeyPatch
) -> None:
    proxy.dropped_fields = {"prefer"}
    pauses: list[float] = []
    with packstone.Client(server.url) as direct, packstone.Client(proxy.url) as client:
        job = client.submit(mixes.endless())

        def pause(duration_s: float) -> None:
            pauses.append(duration_s)
            if len(pauses) == 3:
                direct.job(job.id).cancel().wait()

        monkeypatch.setattr("packstone._resource.sleep", pause)
        job.wait()
    assert job.state == "cancelled" and pauses == [1.0, 1.0, 1.0]


def test_listings_are_filtered_and_sorted(client: packstone.Client) -> None:
    series = {"lab:series": f"{uuid4().hex}=1"}
    before = datetime.now(timezone.utc) - timedelta(seconds=1)
    submitted = [client.submit(mixes.quick(seed), name=f"mix {seed}", labels=series).id for seed in range(3)]

    def found(**filters: Any) -> list[str]:
        return [job.id for job in client.jobs(labels=series, **filters)]

    assert found(sort="created") == submitted and found() == submitted[::-1]
    assert found(name="mix 1") == [submitted[1]]
    assert found(created_after=before, sort="created") == submitted
    assert found(created_before=before) == []
    assert found(method="edmd") == []


def test_finished_jobs_are_deleted_by_a_filter(client: packstone.Client) -> None:
    labels = {"series": "deleted together"}
    jobs = [client.submit(mixes.quick(seed), labels=labels).wait() for seed in range(2)]
    assert client.delete_jobs(labels=labels, dry_run=True) == 2
    assert client.delete_jobs(labels=labels, state="failed") == 0
    before = datetime(2000, 1, 1, tzinfo=timezone.utc)
    assert client.delete_jobs(labels=labels, before=before) == 0
    assert client.delete_jobs(labels=labels, state="succeeded") == 2
    with pytest.raises(packstone.PackstoneError) as gone:
        client.job(jobs[0].id)
    assert gone.value.kind == "not-found"
    with pytest.raises(packstone.PackstoneError, match="at least one of state, label and before"):
        client.delete_jobs()


def test_a_job_is_changed_while_it_waits(client: packstone.Client) -> None:
    job = client.submit(mixes.endless(), labels={"series": "a", "lab": "b"})
    later = datetime(2100, 1, 1, tzinfo=timezone.utc)
    job.update(name="renamed", labels={"series": None, "day": "c"}, expires_at=later, shared=True)
    assert job.data["shared"] is True
    assert (job.name, job.labels) == ("renamed", {"lab": "b", "day": "c"})
    assert str(job.data["expires_at"]).startswith("2100-01-01T00:00:00")
    seen = client.job(job.id)
    assert seen.update(expires_at=None).data["expires_at"] is None
    job.cancel().wait()


def test_what_has_changed_meanwhile_is_left_alone(client: packstone.Client) -> None:
    job = client.submit(mixes.quick()).wait()
    stale = client.job(job.id)
    job.update(name="renamed")
    with pytest.raises(packstone.PackstoneError) as refused:
        stale.delete(if_unchanged=True)
    assert (refused.value.kind, refused.value.status) == ("precondition-failed", 412)
    with pytest.raises(packstone.PackstoneError, match="."):
        stale.update(name="other", if_unchanged=True)
    with pytest.raises(ValueError, match="was read from a listing: call refresh"):
        next(client.jobs(name="renamed")).delete(if_unchanged=True)
    stale.refresh().delete(if_unchanged=True)


def test_a_bar_shows_the_progress(client: packstone.Client, capsys: pytest.CaptureFixture[str]) -> None:
    client.submit(mixes.quick(), name="bar").wait(progress=True)
    shown = capsys.readouterr().err
    assert "job 'bar'" in shown and "100%" in shown and "succeeded" in shown


def test_a_line_shows_the_progress_without_tqdm(
    client: packstone.Client, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    job = client.submit(mixes.quick(), name="line").wait(progress=True)
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == f"job 'line' ({job.id}): 100% succeeded"


def test_jobs_travel_between_processes(client: packstone.Client) -> None:
    job = client.submit(mixes.quick())
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        grains = pool.submit(grains_of, job).result()
    assert grains == len(job.result().grains)
    for thing in (client, job):
        assert repr(pickle.loads(pickle.dumps(thing))) == repr(thing)


def test_notebooks_show_a_job(client: packstone.Client) -> None:
    job = client.submit(mixes.quick(), name="<b>", labels={"series": "a&b"})
    html = job.wait()._repr_html_()
    assert "&lt;b&gt;" in html and "series: a&amp;b" in html and "volume_fraction_effective" in html
    failed = client.submit(mixes.unreachable()).wait()
    assert failed.error is not None and str(failed.error["title"]) in failed._repr_html_()
    assert job.summary["grains"] > 10 and failed.summary == {}


def test_warnings_of_the_server_are_warnings(client: packstone.Client) -> None:
    # One grain takes the place of 0.04: a coarse mix that has to be allowed.
    mix = packstone.Mix("A16", 0.005, d_min_mm=8, allow_coarse=True)
    with pytest.warns(packstone.PackstoneWarning) as seen:
        job = client.submit(specimen=packstone.Box(30), mix=mix, seed=1)
        job.wait()
    assert job.warnings and {str(warning.message) for warning in seen} >= set(job.warnings)
    assert all(warning.filename == __file__ for warning in seen), "the line of the caller"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        job.wait()
    with pytest.warns(packstone.PackstoneWarning):
        assert client.plan(specimen=packstone.Box(30), mix=mix)["warnings"]


@pytest.mark.filterwarnings("ignore::packstone.PackstoneWarning")
def test_a_run_is_ended_with_what_it_has_reached(client: packstone.Client) -> None:
    job = client.submit(mixes.dense())

    def finish(seen: packstone.Job) -> None:
        if seen.progress.get("step") == "edmd" and not seen.data["finish_requested"]:
            seen.finish()

    job.wait(60, progress=finish)
    assert job.succeeded and job.partial is not None and job.partial["reason"] == "finished"
    assert "finished" in job._repr_html_()
    packing = job.result()
    assert packing.partial is not None and packing.partial == job.partial
    reached = (np.pi / 6 * packing.diameters**3).sum() / 14.4**3
    assert packing.partial["volume_fraction_reached"] == pytest.approx(reached) and reached < 0.7
    assert job.finish().finished, "asked once more it is the same"
    complete = client.submit(mixes.quick()).wait()
    assert complete.partial is None and complete.result().partial is None
    with pytest.raises(packstone.PackstoneError, match="has its result") as refused:
        complete.finish()
    assert refused.value.kind == "conflict"


@pytest.mark.filterwarnings("ignore::packstone.PackstoneWarning")
def test_a_time_limit_keeps_what_is_reached_here_and_there(client: packstone.Client) -> None:
    for packing in (
        packstone.pack(mixes.dense(), timeout_s=2, on_limit="keep"),
        client.submit(mixes.dense(), timeout_s=2, on_limit="keep").result(),
    ):
        assert packing.partial is not None and packing.partial["reason"] == "timed_out"
        assert packing.partial["size_scale"] < 1
    study = client.study(template=mixes.without(mixes.dense(), "seed") | {"timeout_s": 2, "on_limit": "keep"}).wait()
    (row,), (run,) = study.table(), study.runs()
    assert (row["runs"], row["successes"], row["partial"]) == (1, 0, 1)
    assert run["partial"] == "timed_out" and run["volume_fraction_reached"] == row["volume_fraction_reached_median"]


def test_a_failure_says_what_can_succeed(client: packstone.Client) -> None:
    calls: list[Any] = [packstone.pack, lambda job: client.submit(job).result()]
    for call in calls:
        with pytest.raises(packstone.TargetNotReached) as failed:
            call(mixes.unreachable())
        patches = [change["patch"] for change in failed.value.problem["changes"]]
        assert {"on_limit": "keep"} in patches and {"method": {"type": "growth", "attempts_per_grain": None}} in patches
        assert failed.value.problem["can_retry"] is False
