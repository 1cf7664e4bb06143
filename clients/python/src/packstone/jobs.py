"""A packing job on the server."""

from __future__ import annotations

import io
from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import Any, Literal, get_args

from ._listing import pages
from ._resource import Resource
from ._transport import document
from .derived import Derived
from .errors import JobCancelled, error_of
from .results import Result
from .svg import Svg

State = Literal["queued", "running", "succeeded", "failed", "cancelled"]
SliceForm = Literal["svg", "png", "json", "geo"]
JobPlotKind = Literal["grading", "distance", "radial", "profile"]
JOB_PLOT_KINDS: tuple[JobPlotKind, ...] = get_args(JobPlotKind)


class Job(Resource):
    """A packing to compute, as last seen; :meth:`refresh` and :meth:`wait` look again."""

    @property
    def state(self) -> State:
        """Where it stands."""
        state: State = self.data["state"]
        return state

    @property
    def finished(self) -> bool:
        """Whether it has ended, as last seen."""
        return self.state not in ("queued", "running")

    @property
    def succeeded(self) -> bool:
        """Whether there is a packing, as last seen."""
        return self.state == "succeeded"

    @property
    def error(self) -> dict[str, Any] | None:
        """The problem document that ended it, if one did."""
        error = self.data["error"]
        return None if error is None else dict(error)

    def result(self, timeout: float | None = None) -> Result:
        """The packing, once it is there.

        Raises :class:`PackingNotReached` when the method could not, :class:`JobCancelled` when somebody
        cancelled the job, :class:`PackstoneError` when something else ended it, and :class:`WaitTimeout`
        past `timeout` in s.
        """
        self.wait(timeout)
        if self.succeeded:
            return Result(self._transport, self.path)
        if self.error is not None:
            raise error_of(self.error)
        raise JobCancelled(f"{self._title} was cancelled")

    def derive(self, type: str, /, **options: Any) -> Derived:
        """Has something made of the packing, and kept with the job: ``msh``, ``vti``, ``slice``, ``ldpm``, ...

        The same options give the same model, however often they are asked for. `wait` for it, `save` its file.
        """
        body = {"type": type, **options}
        response = self._transport.request("POST", f"{self.path}/derived", body=body, repeatable=True)
        return Derived(self._transport, document(response), response.headers.get("etag"))

    def derived(self) -> Iterator[Derived]:
        """What is made of the packing, newest first, fetched page by page."""
        for item in pages(self._transport, f"{self.path}/derived", {}):
            yield Derived(self._transport, item)

    def slice(
        self,
        path: str | PathLike[str] | None = None,
        *,
        form: SliceForm | None = None,
        axis: Literal["x", "y", "z"] | None = None,
        at_mm: float | None = None,
        **options: Any,
    ) -> bytes:
        """A plane cut through the packing, saved where `path` says, whose suffix names the form if none is named.

        ``svg``, ``png``, ``json`` with the circles, or ``geo``, a script for Gmsh; ``svg`` if nothing says. In
        the middle if `at_mm` is left out.
        """
        suffix = "" if path is None else Path(path).suffix.removeprefix(".").lower()
        named = form or suffix or "svg"
        if named not in get_args(SliceForm):
            raise ValueError(f"{named!r} is no form of cuts: must be one of {', '.join(get_args(SliceForm))}")
        buffer = io.BytesIO()
        params = {"axis": axis, "at_mm": at_mm, **options}
        self._transport.download(f"{self.path}/slice.{named}", buffer, params=params)
        if path is not None:
            Path(path).write_bytes(buffer.getvalue())
        return buffer.getvalue()

    def cancel(self) -> Job:
        """Cancels it; one that runs ends a little later, so wait for that."""
        self._act("cancel")
        return self

    def retry(self) -> Job:
        """Puts it back into the queue after it failed or was cancelled."""
        self._act("retry")
        return self

    def plot(self, kind: JobPlotKind, path: str | PathLike[str] | None = None) -> Svg:
        """A plot of the packing, saved where `path` says.

        ``grading``: the curve asked for and the one reached; ``distance``: the largest distance against
        time; ``radial``: the pair correlation; ``profile``: the volume fraction against the depth.
        """
        response = self._transport.request(
            "GET", f"{self.path}/plot.svg", params={"kind": kind}, headers={"accept": "image/svg+xml"}
        )
        svg = Svg(response.text)
        if path is not None:
            svg.save(path)
        return svg

    @property
    def _title(self) -> str:
        return f"job {self.id}" if self.name is None else f"job {self.name!r} ({self.id})"

    def __str__(self) -> str:
        words = f"{self._title}: {self.state}"
        if self.state == "running" and self.progress:
            progress = self.progress
            words += f", {progress['fraction']:.0%}, {progress['phase']}"
            if progress["eta_s"] is not None:
                words += f", about {progress['eta_s']:.0f} s left"
        return words

    def __repr__(self) -> str:
        return f"<Job {self.id} {self.state}>"
