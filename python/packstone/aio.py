"""The client for programs that use asyncio.

    async with packstone.AsyncClient() as client:
        jobs = [await client.submit(mix, seed=seed) for seed in range(20)]
        async for job in client.as_completed(jobs):
            grains = await (await job.result()).grains()

The classes have the methods of :class:`Client`, :class:`Job`, :class:`Study`, :class:`Export` and
:class:`Packing` as coroutines. Each call runs the synchronous client in a thread of the asynchronous client, so that
retries, downloads and errors are the same. Long polls have threads of their own. A task that is cancelled stops
to wait at once; its request ends in its thread, a poll after 10 s at most.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from functools import partial
from os import PathLike
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from . import _warnings
from ._async_exporting import AsyncJobExports, AsyncPackingExports
from ._columns import Labels
from ._listing import ITEMS_PER_PAGE
from ._progress import Progress
from ._resource import NEWS_EVERY_S, PAUSE_S, Changing
from .client import Client, JobOrder
from .errors import WaitTimeout
from .exports import Export, ExportState
from .options import Axis, SliceFormat
from .jobs import FinishedState, Job, State
from ._sources import FileFormat, PackingPlotKind, Theme
from ._conversions import Neighbours, PyVistaKind
from .packings import Packing
from .studies import Study, StudyPlotKind, StudyState
from .picture import Picture
from .svg import Svg
from .view import View

if TYPE_CHECKING:
    import meshio
    import numpy as np
    import pandas as pd
    import trimesh
    from numpy.typing import NDArray
    from typing_extensions import Self, Unpack

    from .builders import JobFields
    from .jobs import JobChanges
    from .jupyter import Viewer
    from .options import FileOptions, SurfaceOptions
    from .packings import PackingReport
    from .reports import QualityReport
    from .results import CheckReport, JobPlan, Partial, RepresentativeVolume, Summary
    from .services import Capabilities, KeyInfo
    from .studies import StudyChanges

T = TypeVar("T")
C = TypeVar("C", bound=Changing)

# Longest time of a poll, in s: a program that ends waits for its threads.
POLL_S = 10
_END = object()


class _Threads:
    """The threads of a client: some for long polls, some for everything else."""

    def __init__(self, polls: int, calls: int) -> None:
        self._polls = ThreadPoolExecutor(polls, "packstone-poll")
        self._calls = ThreadPoolExecutor(calls, "packstone-call")

    async def call(self, function: Callable[[], T]) -> T:
        """Runs a function that sends a request, and issues its warnings here."""
        return await self._run(self._calls, function)

    async def poll(self, function: Callable[[], T]) -> T:
        """Runs a function that the server may hold up."""
        return await self._run(self._polls, function)

    async def each(self, items: Iterator[T]) -> AsyncIterator[T]:
        """Yields the items of an iterator that fetches them."""
        while (item := await self.call(lambda: next(items, _END))) is not _END:
            yield item  # type: ignore[misc]

    def close(self) -> None:
        """Starts no more calls."""
        self._polls.shutdown(wait=False, cancel_futures=True)
        self._calls.shutdown(wait=False, cancel_futures=True)

    @staticmethod
    async def _run(pool: ThreadPoolExecutor, function: Callable[[], T]) -> T:
        loop = asyncio.get_running_loop()
        value, messages = await loop.run_in_executor(pool, _warnings.collecting, function)
        _warnings.warn(messages)
        return value


class _AsyncChanging(Generic[C]):
    """The parts that jobs, studies and exports have in common."""

    def __init__(self, threads: _Threads, sync: C) -> None:
        self._threads = threads
        self.sync = sync
        """The synchronous object with the document as it was last read. Its properties need no request."""

    @property
    def path(self) -> str:
        """The address on the server."""
        return self.sync.path

    @property
    def data(self) -> dict[str, Any]:
        """The document as the server sent it last."""
        return self.sync.data

    @property
    def finished(self) -> bool:
        """Whether the work has ended."""
        return self.sync.finished

    @property
    def progress(self) -> dict[str, Any]:
        """The progress as the server sent it last; empty before the start."""
        return self.sync.progress

    @property
    def fraction(self) -> float:
        """The fraction of the work that is done, between 0 and 1."""
        return self.sync.fraction

    @property
    def eta_s(self) -> float | None:
        """The server's estimate of the remaining time, in s."""
        return self.sync.eta_s

    @property
    def warnings(self) -> list[str]:
        """What is doubtful about the request or the result, one sentence each."""
        return self.sync.warnings

    async def refresh(self) -> Self:
        """See :meth:`Job.refresh`."""
        await self._threads.call(self.sync.refresh)
        return self

    async def wait(
        self, timeout: float | None = None, progress: bool | Callable[[Self], object] | None = None
    ) -> Self:
        """See :meth:`Job.wait`. The function `progress` is called by the event loop."""
        if progress is True:
            with Progress(self.sync._title) as bar:
                await self._wait(timeout, lambda: bar.show(self.sync.fraction, self.sync._note()))
        else:
            await self._wait(timeout, partial(progress, self) if progress else None)
        self.sync._warn()
        return self

    async def _wait(self, timeout: float | None, told: Callable[[], object] | None) -> None:
        until = None if timeout is None else monotonic() + timeout
        if told is not None:
            if self.sync._etag is None and not self.finished:
                await self.refresh()
            told()
        while not self.finished:
            left_s = None if until is None else until - monotonic()
            if left_s is not None and left_s <= 0:
                raise WaitTimeout(f"{self.sync} has not ended within {timeout:g} s")
            poll_s = POLL_S if left_s is None else max(1, min(POLL_S, int(left_s)))
            asked_at = monotonic()
            news = await self._threads.poll(partial(self.sync._poll, poll_s, until_end=told is None))
            if news and told is not None:
                told()
            took_s = monotonic() - asked_at
            if self.finished:
                break
            if news:
                await asyncio.sleep(max(0.0, NEWS_EVERY_S - took_s))
            elif took_s < min(PAUSE_S, poll_s / 2):
                await asyncio.sleep(PAUSE_S)

    def __str__(self) -> str:
        return str(self.sync)

    def __repr__(self) -> str:
        return repr(self.sync).replace("<", "<Async", 1)

    def _repr_html_(self) -> str:
        html: str = self.sync._repr_html_()  # type: ignore[attr-defined]
        return html


class AsyncExport(_AsyncChanging[Export]):
    """See :class:`Export`."""

    @property
    def state(self) -> ExportState:
        """The state: ``queued``, ``running``, ``succeeded`` or ``failed``."""
        return self.sync.state

    @property
    def report(self) -> dict[str, Any]:
        """Figures of the file; empty until it is made."""
        return self.sync.report

    async def save(self, path: str | PathLike[str], timeout: float | None = None, *, overwrite: bool = False) -> Path:
        """See :meth:`Export.save`."""
        await self.wait(timeout)
        return await self._threads.call(partial(self.sync.save, path, overwrite=overwrite))

    async def read(self, timeout: float | None = None) -> bytes:
        """See :meth:`Export.read`."""
        await self.wait(timeout)
        return await self._threads.call(self.sync.read)

    async def delete(self) -> None:
        """See :meth:`Export.delete`."""
        await self._threads.call(self.sync.delete)


class AsyncPacking(AsyncPackingExports):
    """See :class:`Packing`."""

    def __init__(self, threads: _Threads, sync: Packing) -> None:
        self._threads = threads
        self.sync = sync
        """The synchronous packing."""

    async def report(self) -> PackingReport:
        """See :attr:`Packing.report`."""
        return await self._threads.call(lambda: self.sync.report)

    async def summary(self) -> Summary:
        """See :attr:`Packing.summary`."""
        return await self._threads.call(lambda: self.sync.summary)

    async def partial(self) -> Partial | None:
        """See :attr:`Packing.partial`."""
        return await self._threads.call(lambda: self.sync.partial)

    async def check(self) -> CheckReport:
        """See :attr:`Packing.check`."""
        return await self._threads.call(lambda: self.sync.check)

    async def request(self) -> dict[str, Any]:
        """See :attr:`Packing.request`."""
        return await self._threads.call(lambda: self.sync.request)

    async def columns(self) -> tuple[str, ...]:
        """See :attr:`Packing.columns`."""
        return await self._threads.call(lambda: self.sync.columns)

    async def grains(self) -> NDArray[np.float64]:
        """See :attr:`Packing.grains`."""
        return await self._threads.call(lambda: self.sync.grains)

    async def positions(self) -> NDArray[np.float64]:
        """See :attr:`Packing.positions`."""
        return await self._threads.call(lambda: self.sync.positions)

    async def diameters(self) -> NDArray[np.float64]:
        """See :attr:`Packing.diameters`."""
        return await self._threads.call(lambda: self.sync.diameters)

    async def to_dataframe(self) -> pd.DataFrame:
        """See :meth:`Packing.to_dataframe`."""
        return await self._threads.call(self.sync.to_dataframe)

    async def templates(self) -> list[dict[str, Any]]:
        """See :meth:`Packing.templates`."""
        return await self._threads.call(self.sync.templates)

    async def to_pyvista(self, kind: PyVistaKind = "points", **options: Any) -> Any:
        """See :meth:`Packing.to_pyvista`."""
        convert: Callable[..., Any] = self.sync.to_pyvista
        return await self._threads.call(partial(convert, kind, **options))

    async def to_trimesh(
        self, *, timeout: float | None = None, **options: Unpack[SurfaceOptions]
    ) -> trimesh.Trimesh:
        """See :meth:`Packing.to_trimesh`."""
        return await self._threads.call(partial(self.sync.to_trimesh, timeout=timeout, **options))

    async def to_meshio(self, *, timeout: float | None = None, **options: Unpack[SurfaceOptions]) -> meshio.Mesh:
        """See :meth:`Packing.to_meshio`."""
        return await self._threads.call(partial(self.sync.to_meshio, timeout=timeout, **options))

    async def voxels(
        self,
        cells: int | None = None,
        *,
        voxel_mm: float | None = None,
        label: Literal["phase", "grain"] | None = None,
        timeout: float | None = None,
    ) -> NDArray[Any]:
        """See :meth:`Packing.voxels`."""
        return await self._threads.call(
            partial(self.sync.voxels, cells, voxel_mm=voxel_mm, label=label, timeout=timeout)
        )

    async def neighbours(self, closer_than_mm: float | None = None, *, timeout: float | None = None) -> Neighbours:
        """See :meth:`Packing.neighbours`."""
        return await self._threads.call(partial(self.sync.neighbours, closer_than_mm, timeout=timeout))

    async def in_memory(self) -> Packing:
        """Returns the packing with its grains, without the server, with all properties of :class:`Packing`."""
        return await self._threads.call(lambda: Packing(self.sync._source.in_memory()))

    async def read(
        self, format: FileFormat, *, timeout: float | None = None, **options: Unpack[FileOptions]
    ) -> bytes:
        """See :meth:`Packing.read`."""
        return await self._threads.call(partial(self.sync.read, format, timeout=timeout, **options))

    async def save(
        self,
        path: str | PathLike[str],
        format: FileFormat | None = None,
        *,
        timeout: float | None = None,
        overwrite: bool = False,
        **options: Unpack[FileOptions],
    ) -> Path:
        """See :meth:`Packing.save`."""
        save = partial(self.sync.save, path, format, timeout=timeout, overwrite=overwrite, **options)
        return await self._threads.call(save)

    async def quality(self, *, timeout: float | None = None) -> QualityReport:
        """See :meth:`Packing.quality`."""
        return await self._threads.call(partial(self.sync.quality, timeout=timeout))

    async def plot(
        self,
        kind: PackingPlotKind,
        path: str | PathLike[str] | None = None,
        *,
        title: bool = True,
        theme: Theme = "light",
        overwrite: bool = False,
    ) -> Svg:
        """See :meth:`Packing.plot`."""

        def plot() -> Svg:
            return self.sync.plot(kind, path, title=title, theme=theme, overwrite=overwrite)

        return await self._threads.call(plot)

    async def picture(
        self, path: str | PathLike[str] | None = None, *, pixels: int = 800, overwrite: bool = False
    ) -> Picture:
        """See :meth:`Packing.picture`."""
        return await self._threads.call(partial(self.sync.picture, path, pixels=pixels, overwrite=overwrite))

    async def view(self, *, height_px: int = 640) -> View | Viewer:
        """See :meth:`Packing.view`."""
        return await self._threads.call(partial(self.sync.view, height_px=height_px))

    def __repr__(self) -> str:
        return repr(self.sync).replace("<", "<Async", 1)


class AsyncJob(_AsyncChanging[Job], AsyncJobExports):
    """See :class:`Job`."""

    @property
    def id(self) -> str:
        """The ID on the server."""
        return self.sync.id

    @property
    def state(self) -> State:
        """The state: ``queued``, ``running``, ``succeeded``, ``failed`` or ``cancelled``."""
        return self.sync.state

    @property
    def succeeded(self) -> bool:
        """Whether the job has a packing."""
        return self.sync.succeeded

    @property
    def error(self) -> dict[str, Any] | None:
        """The problem document if the job has failed."""
        return self.sync.error

    @property
    def summary(self) -> dict[str, Any]:
        """The main figures of the packing; empty before it succeeds."""
        return self.sync.summary

    @property
    def partial(self) -> dict[str, Any] | None:
        """See :attr:`Job.partial`."""
        return self.sync.partial

    async def request(self) -> dict[str, Any]:
        """See :attr:`Job.request`."""
        return await self._threads.call(lambda: self.sync.request)

    async def result(self, timeout: float | None = None, progress: bool = False) -> AsyncPacking:
        """See :meth:`Job.result`."""
        await self.wait(timeout, progress)
        return AsyncPacking(self._threads, self.sync.result())

    async def exports(self) -> AsyncIterator[AsyncExport]:
        """See :meth:`Job.exports`."""
        async for export in self._threads.each(self.sync.exports()):
            yield AsyncExport(self._threads, export)

    async def slice(
        self,
        path: str | PathLike[str] | None = None,
        *,
        format: SliceFormat | None = None,
        axis: Axis | None = None,
        at_mm: float | None = None,
        overwrite: bool = False,
        **options: Any,
    ) -> bytes:
        """See :meth:`Job.slice`."""
        cut = partial(self.sync.slice, path, format=format, axis=axis, at_mm=at_mm, overwrite=overwrite, **options)
        return await self._threads.call(cut)

    async def plot(
        self,
        kind: PackingPlotKind,
        path: str | PathLike[str] | None = None,
        *,
        title: bool = True,
        theme: Theme = "light",
        overwrite: bool = False,
    ) -> Svg:
        """See :meth:`Job.plot`."""

        def plot() -> Svg:
            return self.sync.plot(kind, path, title=title, theme=theme, overwrite=overwrite)

        return await self._threads.call(plot)

    async def update(self, *, if_unchanged: bool = False, **changes: Unpack[JobChanges]) -> AsyncJob:
        """See :meth:`Job.update`."""
        await self._threads.call(lambda: self.sync.update(if_unchanged=if_unchanged, **changes))
        return self

    async def cancel(self, *, if_unchanged: bool = False) -> AsyncJob:
        """See :meth:`Job.cancel`."""
        await self._threads.call(partial(self.sync.cancel, if_unchanged=if_unchanged))
        return self

    async def finish(self, *, if_unchanged: bool = False) -> AsyncJob:
        """See :meth:`Job.finish`."""
        await self._threads.call(partial(self.sync.finish, if_unchanged=if_unchanged))
        return self

    async def retry(self, *, if_unchanged: bool = False) -> AsyncJob:
        """See :meth:`Job.retry`."""
        await self._threads.call(partial(self.sync.retry, if_unchanged=if_unchanged))
        return self

    async def delete(self, *, if_unchanged: bool = False) -> None:
        """See :meth:`Job.delete`."""
        await self._threads.call(partial(self.sync.delete, if_unchanged=if_unchanged))


class AsyncStudy(_AsyncChanging[Study]):
    """See :class:`Study`."""

    @property
    def id(self) -> str:
        """The ID on the server."""
        return self.sync.id

    @property
    def counts(self) -> dict[State, int]:
        """The number of jobs in each state."""
        return self.sync.counts

    async def request(self) -> dict[str, Any]:
        """See :attr:`Study.request`."""
        return await self._threads.call(lambda: self.sync.request)

    async def jobs(self, state: State | None = None) -> AsyncIterator[AsyncJob]:
        """See :meth:`Study.jobs`."""
        async for job in self._threads.each(self.sync.jobs(state)):
            yield AsyncJob(self._threads, job)

    async def table(self) -> list[dict[str, Any]]:
        """See :meth:`Study.table`."""
        return await self._threads.call(self.sync.table)

    async def representative_volumes(self) -> list[RepresentativeVolume]:
        """See :meth:`Study.representative_volumes`."""
        return await self._threads.call(self.sync.representative_volumes)

    async def runs(
        self, *, labels: Labels | None = None, names: Mapping[str, str] | None = None
    ) -> list[dict[str, Any]]:
        """See :meth:`Study.runs`."""
        return await self._threads.call(partial(self.sync.runs, labels=labels, names=names))

    async def to_dataframe(
        self, *, labels: Labels | None = None, names: Mapping[str, str] | None = None
    ) -> pd.DataFrame:
        """See :meth:`Study.to_dataframe`."""
        return await self._threads.call(partial(self.sync.to_dataframe, labels=labels, names=names))

    async def runs_dataframe(
        self, *, labels: Labels | None = None, names: Mapping[str, str] | None = None
    ) -> pd.DataFrame:
        """See :meth:`Study.runs_dataframe`."""
        return await self._threads.call(partial(self.sync.runs_dataframe, labels=labels, names=names))

    async def save_all(
        self,
        directory: str | PathLike[str],
        format: FileFormat = "vtp",
        name: str | None = None,
        *,
        labels: Labels | None = None,
        names: Mapping[str, str] | None = None,
        parallel: int = 4,
        progress: bool = False,
        overwrite: bool = False,
        **options: Unpack[FileOptions],
    ) -> list[Path]:
        """See :meth:`Study.save_all`."""
        save = partial(self.sync.save_all, directory, format, name, labels=labels, names=names, **options)
        return await self._threads.call(partial(save, parallel=parallel, progress=progress, overwrite=overwrite))

    async def plot(
        self,
        kind: StudyPlotKind,
        path: str | PathLike[str] | None = None,
        *,
        x: str | None = None,
        log_x: bool | None = None,
        title: bool = True,
        theme: Theme = "light",
        overwrite: bool = False,
    ) -> Svg:
        """See :meth:`Study.plot`."""
        plot = partial(self.sync.plot, kind, path, x=x, log_x=log_x, title=title, theme=theme, overwrite=overwrite)
        return await self._threads.call(plot)

    async def update(self, *, if_unchanged: bool = False, **changes: Unpack[StudyChanges]) -> AsyncStudy:
        """See :meth:`Study.update`."""
        await self._threads.call(lambda: self.sync.update(if_unchanged=if_unchanged, **changes))
        return self

    async def cancel(self, *, if_unchanged: bool = False) -> AsyncStudy:
        """See :meth:`Study.cancel`."""
        await self._threads.call(partial(self.sync.cancel, if_unchanged=if_unchanged))
        return self

    async def retry(self, *, cancelled: bool = False, if_unchanged: bool = False) -> AsyncStudy:
        """See :meth:`Study.retry`."""
        await self._threads.call(partial(self.sync.retry, cancelled=cancelled, if_unchanged=if_unchanged))
        return self

    async def delete(self, *, if_unchanged: bool = False) -> None:
        """See :meth:`Study.delete`."""
        await self._threads.call(partial(self.sync.delete, if_unchanged=if_unchanged))


class AsyncClient:
    """See :class:`Client`. At most `polls` jobs are waited for at the same time; others have their turn later.

    Examples
    --------
    >>> import asyncio
    >>> async def grains():
    ...     async with packstone.AsyncClient(client.url) as lab:
    ...         packing = await lab.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
    ...         return await packing.grains()
    >>> asyncio.run(grains()).shape
    (45, 4)
    """

    def __init__(
        self,
        url: str | None = None,
        api_key: str | None = None,
        *,
        timeout_s: float = 60.0,
        retry_s: float = 60.0,
        polls: int = 32,
        calls: int = 8,
    ) -> None:
        self.sync = Client(url, api_key, timeout_s=timeout_s, retry_s=retry_s)
        """The synchronous client."""
        self._threads = _Threads(polls, calls)

    async def close(self) -> None:
        """Ends the threads and closes the connections."""
        self._threads.close()
        self.sync.close()

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    def __repr__(self) -> str:
        return repr(self.sync).replace("<", "<Async", 1)

    def _repr_html_(self) -> str:
        return self.sync._repr_html_()

    async def submit(
        self,
        job: Mapping[str, Any] | None = None,
        /,
        *,
        idempotency_key: str | None = None,
        **fields: Unpack[JobFields],
    ) -> AsyncJob:
        """See :meth:`Client.submit`."""
        submit = lambda: self.sync.submit(job, idempotency_key=idempotency_key, **fields)  # noqa: E731
        return AsyncJob(self._threads, await self._threads.call(submit))

    async def pack(
        self,
        job: Mapping[str, Any] | None = None,
        /,
        *,
        timeout: float | None = None,
        progress: bool = False,
        **fields: Unpack[JobFields],
    ) -> AsyncPacking:
        """See :meth:`Client.pack`."""
        return await (await self.submit(job, **fields)).result(timeout, progress)

    async def plan(self, job: Mapping[str, Any] | None = None, /, **fields: Unpack[JobFields]) -> JobPlan:
        """See :meth:`Client.plan`."""
        return await self._threads.call(lambda: self.sync.plan(job, **fields))

    async def job(self, id: str) -> AsyncJob:
        """See :meth:`Client.job`."""
        return AsyncJob(self._threads, await self._threads.call(partial(self.sync.job, id)))

    async def jobs(
        self,
        *,
        state: State | None = None,
        labels: Mapping[str, str] | None = None,
        study: str | None = None,
        name: str | None = None,
        method: str | None = None,
        created_after: datetime | str | None = None,
        created_before: datetime | str | None = None,
        sort: JobOrder | None = None,
        page_size: int = ITEMS_PER_PAGE,
    ) -> AsyncIterator[AsyncJob]:
        """See :meth:`Client.jobs`."""
        found = self.sync.jobs(
            state=state,
            labels=labels,
            study=study,
            name=name,
            method=method,
            created_after=created_after,
            created_before=created_before,
            sort=sort,
            page_size=page_size,
        )
        async for job in self._threads.each(found):
            yield AsyncJob(self._threads, job)

    async def delete_jobs(
        self,
        *,
        state: FinishedState | None = None,
        labels: Mapping[str, str] | None = None,
        before: datetime | str | None = None,
        dry_run: bool = False,
    ) -> int:
        """See :meth:`Client.delete_jobs`."""
        delete = partial(self.sync.delete_jobs, state=state, labels=labels, before=before, dry_run=dry_run)
        return await self._threads.call(delete)

    async def study(
        self, study: Mapping[str, Any] | None = None, /, *, idempotency_key: str | None = None, **fields: Any
    ) -> AsyncStudy:
        """See :meth:`Client.study`."""
        submit = partial(self.sync.study, study, idempotency_key=idempotency_key, **fields)
        return AsyncStudy(self._threads, await self._threads.call(submit))

    async def open_study(self, id: str) -> AsyncStudy:
        """See :meth:`Client.open_study`."""
        return AsyncStudy(self._threads, await self._threads.call(partial(self.sync.open_study, id)))

    async def studies(
        self,
        *,
        state: StudyState | None = None,
        labels: Mapping[str, str] | None = None,
        page_size: int = ITEMS_PER_PAGE,
    ) -> AsyncIterator[AsyncStudy]:
        """See :meth:`Client.studies`."""
        found = self.sync.studies(state=state, labels=labels, page_size=page_size)
        async for study in self._threads.each(found):
            yield AsyncStudy(self._threads, study)

    async def capabilities(self) -> Capabilities:
        """See :meth:`Client.capabilities`."""
        return await self._threads.call(self.sync.capabilities)

    async def key(self) -> KeyInfo:
        """See :meth:`Client.key`."""
        return await self._threads.call(self.sync.key)

    async def as_completed(
        self, jobs: Iterable[AsyncJob], timeout: float | None = None
    ) -> AsyncIterator[AsyncJob]:
        """Yields each job when it has ended, in any way.

        After `timeout` in s this raises :class:`WaitTimeout`; the jobs go on.
        """
        waits = [asyncio.ensure_future(job.wait()) for job in jobs]
        try:
            for ended in asyncio.as_completed(waits, timeout=timeout):
                yield await ended
        except (TimeoutError, asyncio.TimeoutError) as error:
            left = sum(not wait.done() for wait in waits)
            raise WaitTimeout(f"{left} of {len(waits)} jobs have not ended within {timeout:g} s") from error
        finally:
            for wait in waits:
                wait.cancel()
