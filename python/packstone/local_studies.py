"""Studies that are run from this process, without a service."""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import nullcontext
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _files, _html, _native, _study_files, _tables, _warnings
from ._columns import Labels
from ._executors import Runner
from ._progress import Progress
from ._requests import encoded, study_body
from ._refusals import refusals
from .local import Local
from ._sources import FileFormat, Theme, file_of
from .packings import Packing
from .studies import StudyPlotKind
from .svg import Svg

if TYPE_CHECKING:
    import pandas as pd
    from typing_extensions import Unpack

    from .options import FileOptions
    from .results import RepresentativeVolume

# The columns of a table of runs that each run has.
RUN_COLUMNS = ("point", "replicate", "seed", "outcome", "error", "time_s")


def study(
    study: Mapping[str, Any] | None = None,
    /,
    *,
    template: Mapping[str, Any] | None = None,
    grid: Mapping[str, Any] | None = None,
    zip: Mapping[str, Any] | None = None,
    list: Sequence[Mapping[str, Any]] | None = None,
    replicates: int | None = None,
    stop_when: Mapping[str, Any] | None = None,
    seed: int | None = None,
    name: str | None = None,
    executor: object = None,
    workers: int | None = None,
    keep: bool = False,
    progress: bool | Callable[[LocalStudy], object] | None = None,
) -> LocalStudy:
    """Runs a study from this process and returns its table: the same packings as a service makes of the same study.

    Ctrl-C ends the study; its runs of this process end at once. What is doubtful about the points is issued as
    :class:`PackstoneWarning`.

    Parameters
    ----------
    study
        A study as :meth:`Client.study` takes it.
    template
        The job of which each point is a variant.
    grid
        JSON pointers into the template with their values; each combination is a point.
    zip
        The same, whose values vary together.
    list
        In place of a template: the jobs of all points.
    replicates
        The number of runs of each point.
    stop_when
        A rule that ends a point, as ``{"failed_in_a_row": 3}``.
    seed
        The seed from which those of the runs follow.
    name
        A name for people.
    executor
        Where the runs are executed: an executor of ``concurrent.futures``, a ``dask.distributed.Client``, or the module
        ``ray`` after ``ray.init()``. Without it, in threads of this process; packings run without Python's lock.
    workers
        The number of threads, that of the cores if it is not given; for how many runs the executor has room, if it does
        not tell.
    keep
        Whether :attr:`LocalStudy.packings` keeps the packings, not only their figures.
    progress
        ``True`` shows a bar; a function is called with the study after each run.

    Examples
    --------
    >>> job = {"specimen": 40, "mix": packstone.Mix("A16", 0.2, d_min_mm=4), "distance": 0.2}
    >>> study = packstone.study(template=job, grid={"/mix/volume_fraction": [0.2, 0.3]}, replicates=3, seed=1)
    >>> study
    <LocalStudy 1: 6 of 6 runs>
    >>> [row["success_rate"] for row in study.table()]
    [1.0, 1.0]
    """
    body = study_body(
        study,
        template=template,
        grid=grid,
        zip=zip,
        list=list,
        replicates=replicates,
        stop_when=stop_when,
        seed=seed,
        name=name,
    )
    with refusals():
        made = LocalStudy(_native.Study(encoded(body)), keep)
    made._request = {**body, "seed": made.seed}
    _warnings.warn(made.warnings)
    bar = Progress(f"study {made.name or made.seed}") if progress is True else None
    with bar or nullcontext(), Runner(executor, workers) as runner:
        for ended in made._run(runner):
            if bar is not None:
                bar.show(ended / made.jobs, f"{ended} of {made.jobs} runs")
            elif callable(progress):
                progress(made)
    return made


class LocalStudy:
    """A study that was run from this process: its table, its runs and its plots, as those of :class:`Study`."""

    def __init__(self, native: _native.Study, keep: bool) -> None:
        document = json.loads(native.runs())
        self._request: dict[str, Any] = {}
        self._native = native
        self._keep = keep
        self._runs = document["runs"]
        self._points = document["points"]
        self._records: dict[tuple[int, int], dict[str, Any]] = {}
        self.name: str | None = document["name"]
        """The name."""
        self.seed: int = document["seed"]
        """The seed, from which those of the runs follow."""
        self.columns: list[str] = document["columns"]
        """The JSON pointers of the fields that distinguish the points; ``point`` and ``name`` for a list of jobs."""
        self.packings: dict[tuple[int, int], Packing] = {}
        """The packings by point and replicate, if the study keeps them."""

    @classmethod
    def open(cls, directory: str | PathLike[str]) -> LocalStudy:
        """Reads a study from the folder that :meth:`save` or ``packstone study`` wrote.

        Parameters
        ----------
        directory
            The folder. Packings below ``results`` are read where they lie as ``json``, ``csv`` or ``npy``.

        Returns
        -------
        LocalStudy
            The study with its table, runs, plots and packings. It can be unfinished.

        Raises
        ------
        ValueError
            If the folder holds no study, or a damaged one.
        """
        directory = Path(directory)
        request, records = _study_files.read(directory)
        packings = _study_files.packings(directory)
        with refusals():
            study = cls(_native.Study(encoded(request)), bool(packings))
        study._request = request
        for record in records:
            place = (record.pop("point"), record.pop("replicate"))
            study._records[place] = record
            study._native.count(place[0], record["outcome"])
        study.packings = packings
        return study

    def save(self, directory: str | PathLike[str], *, overwrite: bool = False) -> Path:
        """Writes the study into a folder, as ``packstone study`` does, and returns its path.

        :func:`load` reads it again, and ``packstone study STUDY.json --out DIRECTORY --resume`` goes on with it. The
        packings that the study keeps are written as ``results/POINT-REPLICATE.json``.

        Parameters
        ----------
        directory
            The folder, which is created.
        overwrite
            Whether the files of another study are replaced.

        Raises
        ------
        FileExistsError
            If the folder holds a study.

        Examples
        --------
        >>> mix = packstone.Mix("A16", 0.2, d_min_mm=4)
        >>> study = packstone.study(template={"specimen": 40, "mix": mix}, replicates=2, seed=1, keep=True)
        >>> packstone.load(study.save("two")).packings[0, 1]
        <Packing of 46 grains: ...>
        """
        seeds = {(run["point"], run["replicate"]): run["request"]["seed"] for run in self._runs}
        records = [
            {"point": place[0], "replicate": place[1], "seed": seeds[place], **record}
            for place, record in sorted(self._records.items())
        ]
        directory = Path(directory)
        engine = next((kept.report["engine"] for kept in self.packings.values()), {"version": _native.__version__})
        _study_files.write(directory, engine, self._request, records, overwrite=overwrite)
        self.to_csv(directory / "table.csv", overwrite=overwrite)
        _files.write(directory / "table.json", self._native.table(self._ended(), "json").encode())
        for (point, replicate), packing in self.packings.items():
            packing.save(directory / "results" / f"{point}-{replicate}.json", overwrite=overwrite)
        return directory

    @property
    def points(self) -> int:
        """The number of points, that is of combinations of values."""
        return len(self._points)

    @property
    def jobs(self) -> int:
        """The number of runs that the study would have without a stop rule."""
        return len(self._runs)

    @property
    def warnings(self) -> list[str]:
        """What is doubtful about the points, each text once, with the number of points that it is about."""
        about: dict[str, list[int]] = {}
        for index, point in enumerate(self._points):
            for detail in point["warnings"]:
                about.setdefault(detail, []).append(index)
        return [_warnings.text_of_points(detail, len(of), of[0], self.points) for detail, of in about.items()]

    def table(self) -> list[dict[str, Any]]:
        """Returns one row per point: its values, runs, success rate with its 95 % interval, times, medians.

        Where jobs compute ``properties``, each has its mean, standard deviation and count.
        """
        return self._table()[1]

    def representative_volumes(self) -> list[RepresentativeVolume]:
        """Returns how properties scatter over several volumes, see :meth:`Study.representative_volumes`."""
        return list(self._fetch_table().get("representative_volumes", []))

    def to_dataframe(
        self, *, labels: Labels | None = None, names: Mapping[str, str] | None = None
    ) -> pd.DataFrame:
        """Returns the table with one row per point, see :meth:`Study.to_dataframe`. Needs pandas."""
        return _tables.of_points(*self._table(), labels, names, RUN_COLUMNS)

    def runs(self, *, labels: Labels | None = None, names: Mapping[str, str] | None = None) -> list[dict[str, Any]]:
        """Returns one row per run that ended: its point, replicate, seed, values, outcome, time in s and figures.

        The outcome is ``succeeded``, ``partial`` (ended before its target, and kept), ``target_not_reached``, or
        ``void`` for a run that does not count; ``error`` is the kind of the problem.
        `labels` and `names` are those of :meth:`to_dataframe`.
        """
        return self._rows(labels, names)[1]

    def runs_dataframe(
        self, *, labels: Labels | None = None, names: Mapping[str, str] | None = None
    ) -> pd.DataFrame:
        """Returns the table with one row per run, see :meth:`runs`. Needs pandas."""
        import pandas as pd

        return pd.DataFrame(self.runs(labels=labels, names=names))

    def save_all(
        self,
        directory: str | PathLike[str],
        format: FileFormat = "vtp",
        name: str | None = None,
        *,
        labels: Labels | None = None,
        names: Mapping[str, str] | None = None,
        overwrite: bool = False,
        **options: Unpack[FileOptions],
    ) -> list[Path]:
        """Saves the packings that the study has kept, and returns the paths, see :meth:`Study.save_all`."""
        if not self._keep:
            raise ValueError("the study has kept no packings: call study(..., keep=True)")
        file_of(format, options)
        columns, rows = self._rows(labels, names)
        rows = [row for row in rows if (row["point"], row["replicate"]) in self.packings]
        paths = _tables.paths(Path(directory), rows, columns, name, format)
        for path in paths:
            _files.refuse_existing(path, overwrite)
        for row, path in zip(rows, paths, strict=True):
            self.packings[row["point"], row["replicate"]].save(path, format, overwrite=overwrite, **options)
        return paths

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
        """Returns a plot of the table, and saves it if there is a `path`, see :meth:`Study.plot`."""
        with refusals():
            svg = Svg(self._native.plot(kind, self._ended(), x=x, log_x=log_x, title=title, theme=theme))
        if path is not None:
            svg.save(path, overwrite=overwrite)
        return svg

    def to_csv(self, path: str | PathLike[str], *, overwrite: bool = False) -> Path:
        """Writes the table as CSV, as a service and the command line do, and returns the path.

        Raises `FileExistsError` if the file exists, unless `overwrite`.
        """
        _files.refuse_existing(path, overwrite)
        return _files.write(path, self._native.table(self._ended(), "csv").encode())

    def _run(self, runner: Runner) -> Iterator[int]:
        """Executes the runs; yields the number of those that have ended or were cancelled, after each."""
        waiting = deque(self._runs)
        running: dict[Future[tuple[str, Packing | None]], dict[str, Any]] = {}
        stopped_points: set[int] = set()
        called_off = 0
        stop = runner.stopped if runner.is_here else None
        while waiting or running:
            while waiting and len(running) < runner.most_at_once:
                run = waiting.popleft()
                if run["point"] in stopped_points:
                    called_off += 1
                    continue
                call = runner.submit(_packed, encoded(run["request"]), self._keep, stop)
                running[call] = run
            ended, _ = wait(running, return_when=FIRST_COMPLETED)
            for call in ended:
                run = running.pop(call)
                record, packing = call.result()
                place = (run["point"], run["replicate"])
                self._records[place] = json.loads(record)
                if packing is not None:
                    self.packings[place] = packing
                if self._native.count(run["point"], self._records[place]["outcome"]):
                    stopped_points.add(run["point"])
                yield len(self._records) + called_off

    def _ended(self) -> str:
        """The records of the runs that have ended, as the native module takes them."""
        places = sorted(self._records)
        records = [{"point": at[0], "replicate": at[1], **self._records[at]} for at in places]
        return encoded(records)

    def _fetch_table(self) -> dict[str, Any]:
        return dict(json.loads(self._native.table(self._ended(), "json")))

    def _table(self) -> tuple[list[str], list[dict[str, Any]]]:
        table = self._fetch_table()
        return list(table["columns"]), list(table["rows"])

    def _rows(
        self, labels: Labels | None, names: Mapping[str, str] | None
    ) -> tuple[list[str], list[dict[str, Any]]]:
        """The names of the columns that distinguish the points, and the rows of :meth:`runs`."""
        named, values = _tables.values(*self._table(), labels, names, RUN_COLUMNS)
        seeds = {(run["point"], run["replicate"]): run["request"]["seed"] for run in self._runs}
        found = []
        for place, record in sorted(self._records.items()):
            point, replicate = place
            error = None if "error" not in record else str(record["error"]["type"]).rsplit("/", 1)[-1]
            row = {
                "point": point,
                "replicate": replicate,
                "seed": seeds[place],
                "outcome": record["outcome"],
                "error": error,
            }
            of_point = {name: column[point] for name, column in values.items()}
            facts = _figures(record["facts"])
            figures = {f"result_{name}" if name in of_point else name: value for name, value in facts.items()}
            found.append({**row, **of_point, **figures})
        return list(named.values()), found

    def __repr__(self) -> str:
        return f"<LocalStudy {self.name or self.seed}: {len(self._records)} of {self.jobs} runs>"

    def _repr_html_(self) -> str:
        rows: dict[str, object] = {
            "points": self.points,
            "runs": len(self._records),
            "columns": ", ".join(self.columns),
            "seed": self.seed,
            "warnings": self.warnings,
        }
        return _html.card(f"Study {self.name or self.seed}", rows)


def _figures(facts: dict[str, Any]) -> dict[str, Any]:
    """The figures of a run, each property as one of them."""
    values = facts.get("properties", {}).get("values", {})
    others = {name: value for name, value in facts.items() if name != "properties"}
    return others | {name: of["value"] for name, of in values.items()}


class _Ended(Exception):
    """The study has ended before this run."""


def _packed(request: str, keep: bool, stopped: threading.Event | None) -> tuple[str, Packing | None]:
    """Packs a run of a study, wherever the executor calls it; its record as JSON, and the packing if it is kept."""

    def end(_: str) -> None:
        if stopped is not None and stopped.is_set():
            raise _Ended

    with refusals():
        record, made = _native.run_of_study(request, None if stopped is None else end)
    return record, Packing(Local(made)) if keep and made is not None else None
