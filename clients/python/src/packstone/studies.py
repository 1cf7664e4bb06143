"""A study on the server: many packings from one request, and the table of what became of them."""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal

from ._listing import pages
from ._resource import Resource
from .jobs import Job, State
from .svg import Svg

if TYPE_CHECKING:
    import pandas as pd

StudyState = Literal["open", "finished"]
StudyPlotKind = Literal["success", "time", "distance", "curve", "volume_fraction", "event_time"]


def steps(first: float, last: float, by: float) -> dict[str, float]:
    """Evenly spaced values for an axis of a study, both ends included.

    The server counts them out so that ``steps(0.55, 0.70, 0.005)`` has 0.585 and no 0.5850000000000001.
    """
    return {"from": first, "to": last, "step": by}


class Study(Resource):
    """A study, as last seen; :meth:`refresh` and :meth:`wait` look again."""

    @property
    def finished(self) -> bool:
        """Whether all its jobs have ended, as last seen."""
        return self.finished_at is not None

    @property
    def counts(self) -> dict[State, int]:
        """Its jobs by state: queued, running, succeeded, failed, cancelled."""
        return dict(self.data["counts"])

    @property
    def points(self) -> int:
        """How many combinations of values it has."""
        return int(self.data["points"])

    @property
    def columns(self) -> list[str]:
        """JSON pointers into the job that distinguish the points; empty for a list of jobs."""
        return list(self.data["columns"])

    def jobs(self, state: State | None = None) -> Iterator[Job]:
        """Its jobs, fetched page by page; those in one state if one is named."""
        for item in pages(self._transport, f"{self.path}/jobs", {"state": state}):
            yield Job(self._transport, item)

    def table(self) -> list[dict[str, Any]]:
        """One row per point: its values, runs, success rate with its 95 % interval, times, medians."""
        response = self._transport.request("GET", f"{self.path}/table", params={"format": "json"})
        rows: list[dict[str, Any]] = response.json()["rows"]
        return rows

    def to_dataframe(self) -> pd.DataFrame:
        """The table with one column per value; needs pandas."""
        import pandas as pd

        return pd.DataFrame(self.table())

    def plot(
        self,
        kind: StudyPlotKind,
        path: str | PathLike[str] | None = None,
        *,
        x: str | None = None,
        log_x: bool | None = None,
    ) -> Svg:
        """A plot of the table, saved where `path` says.

        ``success`` and ``time`` per success, ``distance`` reached, ``volume_fraction`` or ``event_time``
        against `x`, a column or ``grains``; ``curve``: distance against packing time.
        """
        params = {"kind": kind, "x": x, "log_x": None if log_x is None else str(log_x).lower()}
        response = self._transport.request(
            "GET", f"{self.path}/plot.svg", params=params, headers={"accept": "image/svg+xml"}
        )
        svg = Svg(response.text)
        if path is not None:
            svg.save(path)
        return svg

    def cancel(self) -> Study:
        """Cancels what has not ended; what runs ends a little later, so wait for that."""
        self._act("cancel")
        return self

    def retry(self, *, cancelled: bool = False) -> Study:
        """Puts the jobs that failed back into the queue, and those that were cancelled if wished."""
        self._act("retry", {"state": "failed,cancelled" if cancelled else "failed"})
        return self

    @property
    def _title(self) -> str:
        return f"study {self.id}" if self.name is None else f"study {self.name!r} ({self.id})"

    def __str__(self) -> str:
        counts = self.counts
        ended = counts["succeeded"] + counts["failed"] + counts["cancelled"]
        words = f"{self._title}: {ended} of {sum(counts.values())} jobs ended, {counts['succeeded']} succeeded"
        eta_s = self.progress.get("eta_s")
        if eta_s is not None and not self.finished:
            words += f", about {eta_s:.0f} s left"
        return words

    def __repr__(self) -> str:
        return f"<Study {self.id} {'finished' if self.finished else 'unfinished'}>"
