"""Where the runs of a study are executed: threads of this process, or an executor of the user's."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from typing_extensions import Self


class Submits(Protocol):
    """Starts calls elsewhere, as the executors of ``concurrent.futures`` do."""

    def submit(self, call: Callable[..., Any], /, *args: Any) -> Future[Any]:
        """Starts a call."""
        ...


class Runner:
    """Runs calls on an executor, a bounded number of them at once; a `with` statement closes what it made itself."""

    def __init__(self, executor: object, workers: int | None) -> None:
        self.stopped = threading.Event()
        self._own: ThreadPoolExecutor | None = None
        count = workers or os.cpu_count() or 1
        if executor is None:
            # Threads do as well as processes: packings run without Python's lock, and need not be copied.
            self._own = ThreadPoolExecutor(count, "packstone-study")
            self._executor: Submits = self._own
        else:
            self._executor, known = _executor_of(executor)
            count = workers or known or count
        self.most_at_once = 2 * count
        """Calls that are started and not ended: enough that no worker waits, few where a stop rule ends a point."""

    @property
    def is_here(self) -> bool:
        """Whether the calls run in threads of this process, which see :attr:`stopped`."""
        return self._own is not None

    def submit(self, call: Callable[..., Any], *args: Any) -> Future[Any]:
        """Starts a call."""
        return self._executor.submit(call, *args)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._own is not None:
            self.stopped.set()
            self._own.shutdown(cancel_futures=True)


def _executor_of(executor: Any) -> tuple[Submits, int | None]:
    """The executor, and the number of its workers if it tells."""
    if hasattr(executor, "get_executor"):  # dask.distributed.Client
        return executor.get_executor(pure=False), sum(executor.ncores().values()) or None
    if hasattr(executor, "remote") and hasattr(executor, "cluster_resources"):  # the module `ray`
        return _Ray(executor), int(executor.cluster_resources().get("CPU", 0)) or None
    if isinstance(executor, Executor) or callable(getattr(executor, "submit", None)):
        return executor, getattr(executor, "_max_workers", None)
    raise TypeError(
        f"{type(executor).__name__} is no executor: must have a method submit, as those of concurrent.futures, or be "
        "a dask.distributed.Client or the module ray"
    )


class _Ray:
    """Ray with the interface of an executor."""

    def __init__(self, ray: Any) -> None:
        self._ray = ray

    def submit(self, call: Callable[..., Any], /, *args: Any) -> Future[Any]:
        """Starts a call as a task of Ray."""
        future: Future[Any] = self._ray.remote(call).remote(*args).future()
        return future
