"""Packing jobs on the server."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from datetime import datetime
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from . import _files, _html
from ._listing import pages
from ._remote import Remote
from ._requests import parameters
from ._exporting import JobExports
from ._transport import document
from .errors import JobCancelled, error_of
from .exports import Export
from .options import Axis, SliceFormat, check_options
from ._sources import PackingPlotKind, Theme
from .packings import Packing
from .svg import Svg

if TYPE_CHECKING:
    from typing_extensions import TypedDict, Unpack

    class JobChanges(TypedDict, total=False):
        """What :meth:`Job.update` changes."""

        name: str | None
        priority: int
        labels: Mapping[str, str | None]
        expires_at: datetime | str | None
        shared: bool
        webhook_url: str | None


State = Literal["queued", "running", "succeeded", "failed", "cancelled"]
FinishedState = Literal["succeeded", "failed", "cancelled"]


class Job(JobExports):
    """A packing job as it was when it was last read; :meth:`refresh` and :meth:`wait` read it again.

    Examples
    --------
    >>> job = client.submit(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
    >>> len(job.result())
    45
    >>> job.export("mesh", segments=8).wait().state
    'succeeded'
    """

    @property
    def state(self) -> State:
        """The state: ``queued``, ``running``, ``succeeded``, ``failed`` or ``cancelled``."""
        state: State = self.data["state"]
        return state

    @property
    def finished(self) -> bool:
        """Whether the job has ended."""
        return self.state not in ("queued", "running")

    @property
    def succeeded(self) -> bool:
        """Whether the job has a packing."""
        return self.state == "succeeded"

    @property
    def error(self) -> dict[str, Any] | None:
        """The problem document if the job has failed."""
        error = self.data["error"]
        return None if error is None else dict(error)

    @property
    def summary(self) -> dict[str, Any]:
        """The main figures of the packing: grains, volume fractions, distance. Empty before it succeeds."""
        result = self.data["result"]
        return {} if result is None else dict(result["summary"])

    @property
    def partial(self) -> dict[str, Any] | None:
        """How far the run came, if it ended before its target and kept its packing, else `None`."""
        partial = self.summary.get("partial")
        return None if partial is None else dict(partial)

    def result(self, timeout: float | None = None, progress: bool = False) -> Packing:
        """Waits for the packing and returns it: also a partial one, which :attr:`Packing.partial` tells.

        Parameters
        ----------
        timeout
            Longest wait in s; the job goes on after it.
        progress
            Whether a bar is shown.

        Raises
        ------
        TargetNotReached
            If the method could not reach the target.
        JobCancelled
            If the job was cancelled.
        WaitTimeout
            After `timeout`.
        PackstoneError
            If the job failed in another way.
        """
        self.wait(timeout, progress)
        if self.succeeded:
            return self._packing()
        if self.error is not None:
            raise error_of(self.error)
        raise JobCancelled(f"{self._title} was cancelled")

    def exports(self) -> Iterator[Export]:
        """Yields the exports of the packing, newest first. They are fetched page by page."""
        for item in pages(self._transport, f"{self.path}/exports", {}):
            yield Export(self._transport, item)

    def slice(
        self,
        path: str | PathLike[str] | None = None,
        *,
        format: SliceFormat | None = None,
        axis: Axis | None = None,
        at_mm: float | None = None,
        overwrite: bool = False,
        **options: Any,
    ) -> bytes:
        """Returns a cross-section of the packing, and saves it if there is a `path`.

        The format is that of the suffix if it is not named: ``svg`` (the default), ``png``, ``json`` with the
        circles, or ``geo``, a script for Gmsh. The cross-section lies in the middle if `at_mm` is absent.
        """
        check_options("slice", options)
        if path is not None:
            _files.refuse_existing(path, overwrite)
        suffix = "" if path is None else Path(path).suffix.removeprefix(".").lower()
        named = format or suffix or "svg"
        if named not in get_args(SliceFormat):
            known = ", ".join(get_args(SliceFormat))
            raise ValueError(f"{named!r} is not a format of cross-sections: must be one of {known}")
        buffer = io.BytesIO()
        params = {"format": named, "axis": axis, "at_mm": at_mm, **parameters(options)}
        self._transport.download(f"{self.path}/exports/slice", buffer, params=params)
        if path is not None:
            _files.write(path, buffer.getvalue())
        return buffer.getvalue()

    def plot(
        self,
        kind: PackingPlotKind,
        path: str | PathLike[str] | None = None,
        *,
        title: bool = True,
        theme: Theme = "light",
        overwrite: bool = False,
    ) -> Svg:
        """Returns a plot of the packing, and saves it if there is a `path`: see :meth:`Packing.plot`."""
        return self._packing().plot(kind, path, title=title, theme=theme, overwrite=overwrite)

    def update(self, *, if_unchanged: bool = False, **changes: Unpack[JobChanges]) -> Job:
        """Changes the name, the priority (of a queued job), the labels, the expiry, who may read it, or its webhook.

        Labels are merged with those of the job; ``None`` removes a name, a label, the expiry or the webhook. With
        `if_unchanged` the server refuses (``precondition-failed``) if the job has changed since it was read.
        """
        headers = {"content-type": "application/merge-patch+json", **self._condition(if_unchanged)}
        response = self._transport.request("PATCH", self.path, body={**changes}, headers=headers)
        self._take(document(response), response.headers.get("etag"))
        return self

    def cancel(self, *, if_unchanged: bool = False) -> Job:
        """Cancels the job. A running job ends a little later: :meth:`wait` waits for that."""
        self._act("cancel", if_unchanged=if_unchanged)
        return self

    def finish(self, *, if_unchanged: bool = False) -> Job:
        """Ends the run with the packing that it has reached, which :meth:`result` returns some seconds later.

        :attr:`partial` tells then how far the run came. Once asked, the same call changes nothing. Raises
        :class:`PackstoneError` of the kind ``conflict`` if nothing can be kept: the job waits, has placed no grain
        yet, or has ended.
        """
        self._act("finish", if_unchanged=if_unchanged)
        return self

    def retry(self, *, if_unchanged: bool = False) -> Job:
        """Puts a job that failed or was cancelled back into the queue."""
        self._act("retry", if_unchanged=if_unchanged)
        return self

    def _packing(self) -> Packing:
        return Packing(Remote(self._transport, self.path, self._title))

    def _fetch_request(self) -> dict[str, Any]:
        return document(self._transport.request("GET", f"{self.path}/request"))

    @property
    def _title(self) -> str:
        return f"job {self.id}" if self.name is None else f"job {self.name!r} ({self.id})"

    def _state_words(self) -> str:
        if self.state == "running" and self.progress:
            return str(self.progress["step"])
        return self.state

    def __str__(self) -> str:
        words = f"{self._title}: {self.state}"
        if self.state == "running" and self.progress:
            words += f", {self.fraction:.0%}, {self._note()}"
        return words

    def __repr__(self) -> str:
        return f"<Job {self.id} {self.state}>"

    def _repr_html_(self) -> str:
        rows: dict[str, object] = {
            "state": self.state,
            "remaining": None if self.finished else self._note(),
            "seed": self.seed,
            "labels": self.labels,
            "warnings": self.warnings,
            "partial": None if self.partial is None else self.partial["reason"],
            "error": None if self.error is None else str(error_of(self.error)),
        }
        rows |= {name: value for name, value in self.summary.items() if not isinstance(value, (dict, list))}
        return _html.card(self._title, rows, bar=None if self.finished else self.fraction)
