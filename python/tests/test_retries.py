"""Broken connections and busy servers."""

from __future__ import annotations

from email.utils import format_datetime
from datetime import datetime, timedelta, timezone
from pathlib import Path
from threading import Thread
from uuid import uuid4

import mixes
import packstone
import pytest
from faulty_proxy import Answered, AnswerLost, FaultyProxy, Refused
from live_server import LiveServer


def test_a_submission_whose_answer_is_lost_makes_one_job(
    client: packstone.Client, proxy: FaultyProxy, pauses: list[float]
) -> None:
    series = uuid4().hex
    proxy.faults.extend([AnswerLost(), AnswerLost()])
    with packstone.Client(proxy.url) as unlucky:
        job = unlucky.submit(mixes.quick(), labels={"series": series})
    assert [found.id for found in client.jobs(labels={"series": series})] == [job.id]
    keys = [seen.headers["idempotency-key"] for seen in proxy.seen]
    assert len(keys) == 3 and len(set(keys)) == 1
    assert len(pauses) == 2 and pauses[0] < pauses[1]


def test_submissions_have_keys_of_their_own(client: packstone.Client) -> None:
    assert client.submit(mixes.quick()).id != client.submit(mixes.quick()).id
    key = uuid4().hex
    first = client.submit(mixes.quick(), idempotency_key=key)
    assert client.submit(mixes.quick(), idempotency_key=key).id == first.id


@pytest.mark.parametrize("status", [429, 503, 507])
def test_a_busy_server_says_when_to_come_back(
    proxy: FaultyProxy, pauses: list[float], status: int
) -> None:
    soon = datetime.now(timezone.utc) + timedelta(seconds=30)
    for field in ("7", format_datetime(soon, usegmt=True), "in a while"):
        proxy.faults.append(Answered(status, {"Retry-After": field}))
    with packstone.Client(proxy.url) as client:
        job = client.submit(mixes.quick())
        assert pauses[0] == 7 and 20 < pauses[1] <= 30 and pauses[2] < 1
        pauses.clear()
        # What was refused was not done, so that even this may be sent again.
        job.wait()
        proxy.faults.append(Answered(status, {"Retry-After": "3"}))
        with pytest.raises(packstone.PackstoneError) as refused:
            job.retry()
    assert refused.value.kind == "conflict" and pauses == [3]


def test_a_busy_server_is_not_waited_for_beyond_the_limit(proxy: FaultyProxy, pauses: list[float]) -> None:
    problem = b'{"type": "/problems/queue-full", "title": "The queue is full", "status": 429, "detail": "5 wait"}'
    proxy.faults.append(Answered(429, {"Retry-After": "30", "Content-Type": "application/problem+json"}, problem))
    with packstone.Client(proxy.url, retry_s=29) as client, pytest.raises(packstone.PackstoneError) as refused:
        client.submit(mixes.quick())
    assert refused.value.kind == "queue-full" and str(refused.value) == "The queue is full: 5 wait"
    assert pauses == [] and len(proxy.seen) == 1


@pytest.mark.parametrize("status", [502, 504])
def test_what_a_gateway_lost_is_repeated_where_that_is_safe(
    proxy: FaultyProxy, pauses: list[float], status: int
) -> None:
    with packstone.Client(proxy.url) as client:
        proxy.faults.append(Answered(status))
        job = client.submit(mixes.endless())
        proxy.faults.append(Answered(status))
        with pytest.raises(packstone.PackstoneError, match=f"answered {status}") as unsure:
            job.cancel()
        assert unsure.value.status == status and unsure.value.kind is None
        assert len(pauses) == 1
        job.cancel().wait()


def test_what_may_have_been_done_is_not_done_again(proxy: FaultyProxy, pauses: list[float]) -> None:
    with packstone.Client(proxy.url) as client:
        job = client.submit(mixes.endless())
        proxy.seen.clear()
        proxy.faults.append(Refused())
        with pytest.raises(packstone.ConnectionFailed, match=f"no answer from {proxy.url}"):
            job.cancel()
        assert len(proxy.seen) == 1 and pauses == []
        job.cancel().wait()


def test_questions_are_asked_again(proxy: FaultyProxy, pauses: list[float]) -> None:
    with packstone.Client(proxy.url) as client:
        job = client.submit(mixes.quick())
        proxy.faults.extend([Refused(), AnswerLost(), Refused()])
        assert job.wait().succeeded
    assert len(pauses) == 3


def test_a_server_that_is_not_there() -> None:
    with packstone.Client("http://127.0.0.1:9", retry_s=0) as client:
        with pytest.raises(packstone.ConnectionFailed, match="no answer from http://127.0.0.1:9: "):
            client.submit(mixes.quick())


def test_a_wait_outlives_a_crash_of_the_server(tmp_path: Path) -> None:
    with (
        LiveServer(tmp_path, "--workers", "1") as first,
        packstone.Client(first.url) as client,
        packstone.Client(first.url) as other,
    ):
        job = client.submit(mixes.endless())
        waiting = Thread(target=job.wait)
        waiting.start()
        first.kill()
        with LiveServer(tmp_path, "--workers", "1", listen=first.address):
            other.job(job.id).cancel()
            waiting.join(timeout=120)
    assert job.state == "cancelled"


def test_something_else_answers(proxy: FaultyProxy) -> None:
    with packstone.Client(proxy.url) as client:
        proxy.faults.append(Answered(200, {"Content-Type": "text/html"}, b"<html>Welcome!</html>"))
        with pytest.raises(packstone.PackstoneError, match="answered text/html, not a JSON object"):
            client.capabilities()
        proxy.faults.append(Answered(301, {"Location": "https://lab/packstone"}))
        with pytest.raises(packstone.PackstoneError, match="redirects to https://lab/packstone"):
            client.capabilities()
