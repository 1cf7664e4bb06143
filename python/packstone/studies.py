"""Studies on the server: many packings from one request, and tables of their results."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from . import _files, _html, _tables, _warnings
from ._columns import Labels
from ._listing import pages
from ._progress import Progress
from ._remote import Remote
from ._resource import Resource
from ._transport import document
from .jobs import Job, State
from ._sources import FileFormat, Theme, file_of
from .packings import Packing
from .svg import Svg

if TYPE_CHECKING:
    import pandas as pd
    from typing_extensions import TypedDict, Unpack

    from .options import FileOptions
    from .results import RepresentativeVolume

    class StudyChanges(TypedDict, total=False):
        """What :meth:`Study.update` changes."""

        shared: bool
        webhook_url: str | None


StudyState = Literal["open", "finished"]
StudyPlotKind = Literal[
    "success", "time", "distance", "curve", "volume_fraction", "event_time",
    "youngs_modulus", "expansion", "conductivity", "diffusivity", "representative_volume",
]  # fmt: skip

# The columns of a table of runs that each run has.
RUN_COLUMNS = (
    "id", "name", "point", "replicate", "seed", "state", "attempt", "error", "elapsed_s",
    "started_at", "finished_at",
)  # fmt: skip
# The figures of a packing, and those that a run reached which missed its target.
SUMMARY_COLUMNS = ("volume_fraction_reached", "distance_mm_reached", "method_used")


def steps(first: float, last: float, by: float) -> dict[str, float]:
    """Returns an axis of a study with evenly spaced values, both ends included.

    The engine computes the values, so that ``steps(0.55, 0.70, 0.005)`` contains 0.585, not 0.5850000000000001.

    Parameters
    ----------
    first, last
        Both ends.
    by
        The step.

    Examples
    --------
    >>> packstone.steps(0.3, 0.5, 0.1)
    {'from': 0.3, 'to': 0.5, 'step': 0.1}
    """
    return {"from": first, "to": last, "step": by}


class Study(Resource):
    """A study as it was when it was last read; :meth:`refresh` and :meth:`wait` read it again.

    Examples
    --------
    >>> job = {"specimen": 40, "mix": packstone.Mix("A16", 0.2, d_min_mm=4)}
    >>> study = client.study(template=job, grid={"/mix/volume_fraction": packstone.steps(0.1, 0.3, 0.1)}, seed=1)
    >>> study.wait().to_dataframe()["success_rate"].tolist()
    [1.0, 1.0, 1.0]
    """

    @property
    def finished(self) -> bool:
        """Whether all jobs have ended."""
        return self.finished_at is not None

    @property
    def counts(self) -> dict[State, int]:
        """The number of jobs in each state: queued, running, succeeded, failed, cancelled."""
        return dict(self.data["counts"])

    @property
    def points(self) -> int:
        """The number of points, that is of combinations of values."""
        return int(self.data["points"])

    @property
    def warnings(self) -> list[str]:
        """What is doubtful about the points, each text once, with the number of points that it is about."""
        return [
            _warnings.text_of_points(found["detail"], found["points"], found["point"], self.points)
            for found in self.data.get("warnings") or []
        ]

    @property
    def columns(self) -> list[str]:
        """The JSON pointers of the fields that distinguish the points; empty for a list of jobs."""
        return list(self.data["columns"])

    def jobs(self, state: State | None = None) -> Iterator[Job]:
        """Yields the jobs, oldest first, or those in one state. They are fetched page by page."""
        for item in pages(self._transport, f"{self.path}/jobs", {"state": state, "sort": "created"}):
            yield Job(self._transport, item)

    def table(self) -> list[dict[str, Any]]:
        """Returns one row per point: its values, runs, success rate with its 95 % interval, times, medians.

        Where jobs compute ``properties``, each has its mean, standard deviation and count, as
        ``youngs_modulus_gpa_mean``. They follow the ends of the jobs: ``properties_waiting`` counts what is missing.
        """
        return self._table()[1]

    def representative_volumes(self) -> list[RepresentativeVolume]:
        """Returns how properties scatter over packings of several volumes, and the volume for an error of 1 %.

        One item per property and combination of the values that do not depend on the volume: fitted ``alpha`` and
        ``integral_range_mm3`` (Kanit et al. 2003), ``edge_mm``, and the ``volumes`` with mean, standard deviation and
        number of ``realisations``. Empty unless the study varies the volume of the specimen.
        """
        return list(self._fetch_table().get("representative_volumes", []))

    def to_dataframe(
        self, *, labels: Labels | None = None, names: Mapping[str, str] | None = None
    ) -> pd.DataFrame:
        """Returns the table with one row per point. Needs pandas.

        Columns have short names, as ``volume_fraction`` for ``/mix/volume_fraction`` and ``method`` for
        ``/method/type``. Values that are objects become text, as ``A16`` or ``edmd growth_rate=0.1``, so that
        ``groupby`` and ``pivot_table`` work. `names` gives other names by pointer. `labels` gives other values
        by pointer or name: a function of the value, a mapping from the text, or a list in the order of the values.
        The mapping from pointers to names is ``frame.attrs["pointers"]``.
        """
        return _tables.of_points(*self._table(), labels, names, RUN_COLUMNS)

    def runs(self, *, labels: Labels | None = None, names: Mapping[str, str] | None = None) -> list[dict[str, Any]]:
        """Returns one row per run: its ID, point, replicate, seed, values, state, times and figures.

        The figures are those of the packing (grains, volume fractions, distance), or what a run reached that
        missed its target. `labels` and `names` are those of :meth:`to_dataframe`.
        """
        return self._runs(labels, names)[1]

    def runs_dataframe(
        self, *, labels: Labels | None = None, names: Mapping[str, str] | None = None
    ) -> pd.DataFrame:
        """Returns the table with one row per run, see :meth:`runs`. Needs pandas."""
        import pandas as pd

        frame = pd.DataFrame(self.runs(labels=labels, names=names))
        for name in ("started_at", "finished_at"):
            if name in frame:
                frame[name] = pd.to_datetime(frame[name], utc=True)
        return frame

    def save_all(
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
        """Saves the packings of all jobs that have succeeded, and returns the paths, oldest job first.

        Parameters
        ----------
        directory
            The folder, which is created.
        format
            As that of :meth:`Packing.save`.
        name
            A pattern without suffix, as ``"{volume_fraction}-{seed}"``. Its fields are the columns of :meth:`runs`; the
            default names the values of the point and the seed. Characters that do not belong into file names become
            underscores. Two jobs of the same name are an error, before anything is saved.
        labels, names
            As those of :meth:`to_dataframe`.
        parallel
            The number of files that are fetched at the same time.
        progress
            Whether a bar is shown.
        overwrite
            Whether files of the same names are replaced; otherwise they are an error, before anything is saved.
        **options
            As those of :meth:`Packing.save`.
        """
        file_of(format, options)
        columns, rows = self._runs(labels, names)
        rows = [row for row in rows if row["state"] == "succeeded"]
        paths = _tables.paths(Path(directory), rows, columns, name, format)
        for path in paths:
            _files.refuse_existing(path, overwrite)
        jobs = [f"/v1/jobs/{row['id']}" for row in rows]
        Path(directory).mkdir(parents=True, exist_ok=True)

        def save(job: str, path: Path) -> Path:
            return Packing(Remote(self._transport, job, path.stem)).save(path, format, overwrite=overwrite, **options)

        saved: list[Path] = []
        bar = Progress(f"saving {self._title}") if progress else None
        with bar or nullcontext(), ThreadPoolExecutor(parallel, "packstone-save") as pool:
            for path in pool.map(save, jobs, paths):
                saved.append(path)
                if bar is not None:
                    bar.show(len(saved) / len(paths), f"{len(saved)} of {len(paths)} files")
        return saved

    def plot(
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
        """Returns a plot of the table, and saves it if there is a `path`. A plot for which no run has data is refused.

        Parameters
        ----------
        kind
            ``success`` rate, ``time`` per success, ``distance`` reached, ``volume_fraction`` or ``event_time``
            against `x`; ``curve``: distance against packing time. Of jobs that compute ``properties``:
            ``youngs_modulus``, ``expansion``, ``conductivity`` or ``diffusivity`` with each packing, and their
            ``representative_volume``.
        path
            A file for the SVG.
        x
            A column, ``grains`` or ``volume_fraction_effective``.
        log_x
            Whether the axis of `x` is logarithmic.
        title
            Whether the plot has a title.
        theme
            ``dark`` has light strokes without a ground.
        overwrite
            Whether a file of the same name is replaced.
        """
        response = self._transport.request(
            "GET",
            f"{self.path}/plots/{kind}",
            params={"x": x, "log_x": log_x, "title": title, "theme": theme},
            headers={"accept": "image/svg+xml"},
        )
        svg = Svg(response.text)
        if path is not None:
            svg.save(path, overwrite=overwrite)
        return svg

    def update(self, *, if_unchanged: bool = False, **changes: Unpack[StudyChanges]) -> Study:
        """Lets other users of the server read the study with its jobs, or no longer, or changes its webhook.

        `webhook_url` is sent a message when the study is finished the next time; ``None`` removes it. With
        `if_unchanged` the server refuses (``precondition-failed``) if the study has changed since it was read.
        """
        headers = {"content-type": "application/merge-patch+json", **self._condition(if_unchanged)}
        response = self._transport.request("PATCH", self.path, body={**changes}, headers=headers)
        self._take(document(response), response.headers.get("etag"))
        return self

    def cancel(self, *, if_unchanged: bool = False) -> Study:
        """Cancels the jobs that have not ended. Running jobs end a little later: :meth:`wait` waits for that."""
        self._act("cancel", if_unchanged=if_unchanged)
        return self

    def retry(self, *, cancelled: bool = False, if_unchanged: bool = False) -> Study:
        """Puts the failed jobs back into the queue, and with `cancelled` the cancelled jobs too."""
        params = {"state": "failed,cancelled" if cancelled else "failed"}
        self._act("retry", params, if_unchanged=if_unchanged)
        return self

    def _fetch_table(self) -> dict[str, Any]:
        response = self._transport.request("GET", f"{self.path}/table", params={"format": "json"})
        return dict(document(response))

    def _table(self) -> tuple[list[str], list[dict[str, Any]]]:
        table = self._fetch_table()
        return list(table["columns"]), list(table["rows"])

    def _runs(
        self, labels: Labels | None, names: Mapping[str, str] | None
    ) -> tuple[list[str], list[dict[str, Any]]]:
        """The names of the columns that distinguish the points, and the rows of :meth:`runs`."""
        columns, rows = self._table()
        named, values = _tables.values(columns, rows, labels, names, RUN_COLUMNS)
        found = []
        for job in self.jobs():
            point = {name: column[job.data["point"]] for name, column in values.items()}
            # The diameters of a packing may have the name of a field that the study varies.
            figures = {f"result_{name}" if name in point else name: value for name, value in _figures(job).items()}
            found.append({**_run(job), **point, **figures})
        return list(named.values()), found

    def _fetch_request(self) -> dict[str, Any]:
        response = self._transport.request("GET", self.path, params={"include": "request"})
        return dict(document(response)["request"])

    @property
    def _title(self) -> str:
        return f"study {self.id}" if self.name is None else f"study {self.name!r} ({self.id})"

    def _state_words(self) -> str:
        counts = self.counts
        ended = counts["succeeded"] + counts["failed"] + counts["cancelled"]
        return f"{ended} of {sum(counts.values())} jobs ended, {counts['succeeded']} succeeded"

    def __str__(self) -> str:
        return f"{self._title}: {self._note()}"

    def __repr__(self) -> str:
        return f"<Study {self.id} {self._state_words()}>"

    def _repr_html_(self) -> str:
        rows: dict[str, object] = {
            "points": self.points,
            **{str(state): jobs for state, jobs in self.counts.items()},
            "remaining": None if self.finished else self._note(),
            "columns": ", ".join(self.columns),
            "seed": self.seed,
            "labels": self.labels,
            "warnings": self.warnings,
        }
        return _html.card(self._title, rows, bar=None if self.finished else self.fraction)


def _run(job: Job) -> dict[str, Any]:
    data = job.data
    started = job._time_of("started_at")
    finished = job.finished_at
    elapsed_s = None if started is None or finished is None else (finished - started).total_seconds()
    run = {name: data.get(name) for name in RUN_COLUMNS}
    error = None if job.error is None else str(job.error["type"]).rsplit("/", 1)[-1]
    return run | {"error": error, "elapsed_s": elapsed_s}


def _figures(job: Job) -> dict[str, Any]:
    plain = {name: value for name, value in job.summary.items() if not isinstance(value, (dict, list))}
    reached = {name: job.error.get(name) for name in SUMMARY_COLUMNS if name in job.error} if job.error else {}
    if job.partial is not None:
        reached = {"partial": job.partial["reason"], "volume_fraction_reached": job.partial["volume_fraction_reached"]}
    return plain | reached
