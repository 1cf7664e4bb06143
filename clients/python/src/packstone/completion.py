"""Many jobs at once, in the order in which they end."""

from __future__ import annotations

import queue
import threading
from collections import deque
from collections.abc import Iterable, Iterator
from time import monotonic

from .errors import WaitTimeout
from .jobs import Job

# Jobs asked for at once. The server starts the oldest first, so that those which run are among the oldest.
MOST_POLLS = 32
# How long the server may hold an answer back: where there are more jobs than polls each has its turn.
POLL_S, TURN_S = 20, 5


def as_completed(jobs: Iterable[Job], timeout: float | None = None) -> Iterator[Job]:
    """Yields the jobs as they end, each once, whichever way it ends.

    Past `timeout` in s it raises :class:`WaitTimeout`; the jobs go on. With more than 32 jobs that have not
    ended, the oldest are listened to and the others asked in turn.
    """
    until = None if timeout is None else monotonic() + timeout
    waiting: list[Job] = []
    for job in jobs:
        if job.finished:
            yield job
        else:
            waiting.append(job)
    if not waiting:
        return
    # Ids begin with the time of submission.
    polls = _Polls(sorted(waiting, key=lambda job: job.id))
    try:
        for ended in range(len(waiting)):
            left_s = None if until is None else max(0.0, until - monotonic())
            try:
                yield polls.next(left_s)
            except queue.Empty:
                left = len(waiting) - ended
                raise WaitTimeout(f"{left} of {len(waiting)} jobs have not ended within {timeout:g} s") from None
    finally:
        polls.stop()


class _Polls:
    """Threads that wait for jobs, each for one at a time."""

    def __init__(self, jobs: list[Job]) -> None:
        self._waiting = deque(jobs)
        self._ended: queue.SimpleQueue[Job | BaseException] = queue.SimpleQueue()
        self._stopped = False
        polls = min(MOST_POLLS, len(jobs))
        self._poll_s = TURN_S if polls < len(jobs) else POLL_S
        for _ in range(polls):
            # Daemons, since a program that ends must not wait for the end of a poll.
            threading.Thread(target=self._run, name="packstone-poll", daemon=True).start()

    def next(self, timeout: float | None) -> Job:
        """The next job that ends."""
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
                job.wait(self._poll_s)
            except WaitTimeout:
                self._waiting.append(job)
            except BaseException as error:
                self._ended.put(error)
                return
            else:
                self._ended.put(job)
