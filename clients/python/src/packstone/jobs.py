"""A packing job on the server."""

from __future__ import annotations

from os import PathLike
from typing import Any, Literal, get_args

from ._resource import Resource
from .errors import JobCancelled, error_of
from .results import Result
from .svg import Svg

State = Literal["queued", "running", "succeeded", "failed", "cancelled"]
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
