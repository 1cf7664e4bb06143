"""Many jobs in the order in which they end."""

from __future__ import annotations

import mixes
import packstone
import pytest


def test_jobs_come_as_they_end(client: packstone.Client) -> None:
    slow = client.submit(mixes.endless(), priority=10)
    quick = [client.submit(mixes.quick(seed)) for seed in range(3)]
    ended: list[str] = []
    for job in packstone.as_completed([slow, *quick]):
        assert job.finished
        ended.append(job.id)
        if len(ended) == 3:
            slow.cancel()
    assert sorted(ended[:3]) == sorted(job.id for job in quick)
    assert ended[3:] == [slow.id]


def test_more_jobs_than_are_asked_for_at_once(
    client: packstone.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("packstone.completion.MOST_POLLS", 1)
    monkeypatch.setattr("packstone.completion.TURN_S", 1)
    # It has the only poll at first, and one of the two workers, and ends last.
    slow = client.submit(mixes.endless())
    quick = [client.submit(mixes.quick(seed)) for seed in range(10)]
    ended: list[str] = []
    for job in packstone.as_completed([slow, *quick]):
        ended.append(job.id)
        if len(ended) == 10:
            slow.cancel()
    assert sorted(ended[:10]) == sorted(job.id for job in quick)
    assert ended[10:] == [slow.id]


def test_jobs_that_have_ended_and_no_jobs_at_all(client: packstone.Client) -> None:
    job = client.submit(mixes.quick()).wait()
    assert list(packstone.as_completed([job])) == [job]
    assert list(packstone.as_completed([])) == []


def test_a_limit_of_time(client: packstone.Client) -> None:
    slow = client.submit(mixes.endless())
    quick = client.submit(mixes.quick()).wait()
    completed = packstone.as_completed([slow, quick], timeout=0.01)
    assert next(completed) is quick
    with pytest.raises(packstone.WaitTimeout, match="1 of 1 jobs have not ended within 0.01 s"):
        next(completed)
    slow.cancel().wait()


def test_a_job_that_is_gone_is_an_error(client: packstone.Client) -> None:
    job = client.submit(mixes.quick())
    client.job(job.id).wait().delete()
    with pytest.raises(packstone.PackstoneError, match="there is no job"):
        list(packstone.as_completed([job]))
