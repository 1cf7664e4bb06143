"""Waits for many jobs and yields them in the order in which they end."""

from __future__ import annotations

import queue
import threading
from collections import deque
from collections.abc import Iterable, Iterator
from time import monotonic

from ._progress import Progress
from .errors import WaitTimeout
from .jobs import Job

# Number of jobs that are polled at the same time. The server starts the oldest first, so the oldest are polled first.
MOST_POLLS = 32
# Longest time of a poll, in s. If there are more jobs than polls, each job is polled for a shorter time in turn.
POLL_S, TURN_S = 20, 5


def as_completed(
    jobs: Iterable[Job], timeout: float | None = None, *, progress: bool = False
) -> Iterator[Job]:
    """Yields each job when it has ended, in any way. At most 32 jobs are polled at the same time, the oldest first.

    Parameters
    ----------
    jobs
        The jobs.
    timeout
        Longest wait in s, after which this raises :class:`WaitTimeout`; the jobs go on.
    progress
        Whether a bar is shown.

    Examples
    --------
    >>> mix = packstone.Mix("A16", 0.2, d_min_mm=4)
    >>> jobs = [client.submit(specimen=40, mix=mix, seed=seed) for seed in range(3)]
    >>> sorted(job.seed for job in packstone.as_completed(jobs))
    [0, 1, 2]
    """
    if not progress:
        yield from _completed(jobs, timeout)
        return
    listed = list(jobs)
    with Progress("jobs") as bar:
        bar.show(0.0, f"0 of {len(listed)} ended")
        for ended, job in enumerate(_completed(listed, timeout), start=1):
            bar.show(ended / len(listed), f"{ended} of {len(listed)} ended")
            yield job


def _completed(jobs: Iterable[Job], timeout: float | None) -> Iterator[Job]:
    until = None if timeout is None else monotonic() + timeout
    waiting: list[Job] = []
    for job in jobs:
        if job.finished:
            job._warn()
            yield job
        else:
            waiting.append(job)
    if not waiting:
        return
    # IDs begin with the time of the submission.
    polls = _Polls(sorted(waiting, key=lambda job: job.id))
    try:
        for ended in range(len(waiting)):
            left_s = None if until is None else max(0.0, until - monotonic())
            try:
                job = polls.next(left_s)
            except queue.Empty:
                left = len(waiting) - ended
                raise WaitTimeout(f"{left} of {len(waiting)} jobs have not ended within {timeout:g} s") from None
            job._warn()
            yield job
    finally:
        polls.stop()


class _Polls:
    """Threads that wait for jobs, each for one job at a time."""

    def __init__(self, jobs: list[Job]) -> None:
        self._waiting = deque(jobs)
        self._ended: queue.SimpleQueue[Job | BaseException] = queue.SimpleQueue()
        self._stopped = False
        polls = min(MOST_POLLS, len(jobs))
        self._poll_s = TURN_S if polls < len(jobs) else POLL_S
        for _ in range(polls):
            # Daemons, so that a program can end during a poll.
            threading.Thread(target=self._run, name="packstone-poll", daemon=True).start()

    def next(self, timeout: float | None) -> Job:
        """Returns the next job that ends."""
        ended = self._ended.get(timeout=timeout)
        if isinstance(ended, BaseException):
            raise ended
        return ended

    def stop(self) -> None:
        """Starts no more polls."""
        self._stopped = True

    def _run(self) -> None:
        while not self._stopped:
            try:
                job = self._waiting.popleft()
            except IndexError:
                return
            try:
                job._wait(self._poll_s, None)
            except WaitTimeout:
                self._waiting.append(job)
            except BaseException as error:
                self._ended.put(error)
                return
            else:
                self._ended.put(job)
