"""Packs in this process, without a service."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _native, _warnings
from ._progress import Progress, note
from ._requests import encoded, job_body
from ._refusals import refusals
from ._sources import File
from .options import ExportType
from .packings import Packing

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from typing_extensions import Unpack

    from .builders import JobFields
    from .results import JobPlan
    from ._sources import PackingPlotKind, Theme


def pack(
    job: Mapping[str, Any] | None = None,
    /,
    *,
    checkpoint: str | os.PathLike[str] | None = None,
    progress: bool | Callable[[dict[str, Any]], object] | None = None,
    max_grains: int | None = None,
    **fields: Unpack[JobFields],
) -> Packing:
    """Packs in this process and returns the packing: the same bits as a service makes of the same request.

    Other threads of Python go on meanwhile. Ctrl-C ends the run at once. What is doubtful about the request or the
    packing is issued as :class:`PackstoneWarning`.

    Parameters
    ----------
    job
        A request as :meth:`Client.submit` takes it.
    checkpoint
        A file in which the run is kept from time to time and when it is stopped. A later call with the same request and
        path continues it and makes the same packing. The file is removed at the end.
    progress
        ``True`` shows a bar (of tqdm if it is installed) with the remaining time. A function is called at most 10 times
        a second with ``step``, ``fraction``, ``eta_s`` and ``message``; what it raises ends the run.
    max_grains
        The largest number of grains that is packed.
    **fields
        Fields of the request, see :class:`JobFields`, which replace those of `job`: ``pack(mix_design, seed=2)``.
        `threads` is the largest number of threads that compute the packing, which does not depend on it.

    Returns
    -------
    Packing
        The packing, with its check.

    Raises
    ------
    InvalidRequest
        If the request is refused; the message names each argument.
    TargetNotReached
        If the method could not reach the target.

    Examples
    --------
    >>> packing = packstone.pack(specimen=60, mix=packstone.Mix("A16", 0.5, d_min_mm=4), distance=0.5, seed=1)
    >>> packing
    <Packing of 392 grains: box of 60 x 60 x 60 mm, volume fraction 0.3201, distance 0.5 mm, seed 1>
    >>> packstone.pack(specimen=60, mix=packstone.Mix("A16", 50, d_min_mm=4))
    Traceback (most recent call last):
    packstone.errors.InvalidRequest: Invalid argument: mix.volume_fraction: 50 is out of range: must be at least ...
    """
    request = encoded(job_body(job, fields))
    with _shown(progress) as told, refusals():
        made = _native.pack(
            request,
            max_grains=max_grains,
            checkpoint=checkpoint,
            on_progress=told,
        )
    packing = Packing(Local(made))
    _warnings.warn(_warnings.texts(packing.report))
    return packing


def plan(
    job: Mapping[str, Any] | None = None,
    /,
    *,
    max_grains: int | None = None,
    **fields: Unpack[JobFields],
) -> JobPlan:
    """Returns what a job amounts to, as :meth:`Client.plan`: expected grains, volume fractions, memory, time, warnings.

    Nothing is packed.

    Parameters
    ----------
    job
        A request as :func:`pack` takes it.
    max_grains
        The largest number of grains that is packed.
    **fields
        Fields of the request, which replace those of `job`.

    Raises
    ------
    InvalidRequest
        If the request is refused, or of the kind ``infeasible-mix`` if the grains do not fit.

    Examples
    --------
    >>> round(packstone.plan(specimen=60, mix=packstone.Mix("A16", 0.5, d_min_mm=4))["grains"])
    393
    """
    with refusals():
        planned: JobPlan = json.loads(_native.plan(encoded(job_body(job, fields)), max_grains))
    _warnings.warn(_warnings.texts(planned))
    return planned


class Local:
    """A source of :class:`Packing`: a packing in the memory of this process."""

    def __init__(self, made: _native.Packing) -> None:
        self._made = made

    def __getstate__(self) -> bytes:
        return self._made.store()

    def __setstate__(self, stored: bytes) -> None:
        self._made = _native.Packing.restore(stored)

    @property
    def title(self) -> str:
        """The name of the request and the number of grains."""
        grains, name = f"{len(self._made)} grains", self.request().get("name")
        return grains if name is None else f"{name!r} ({grains})"

    def count(self) -> int:
        """The number of grains."""
        return len(self._made)

    def in_memory(self) -> Local:
        """This packing."""
        return self

    def report(self) -> dict[str, Any]:
        """The result without its grains and its request."""
        summary: dict[str, Any] = json.loads(self._made.summary())
        summary.pop("request", None)
        return summary

    def request(self) -> dict[str, Any]:
        """The request with the defaults filled in."""
        return dict(json.loads(self._made.summary())["request"])

    def columns(self) -> tuple[str, ...]:
        """The names of the columns of the grains."""
        return tuple(self._made.columns())

    def grains(self) -> NDArray[np.float64]:
        """The grains as an array."""
        return self._made.grains()

    def read(self, file: File, timeout: float | None) -> bytes:
        """The content of a file."""
        with refusals():
            if file.type is None:
                return self._made.table_bytes(file.format)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"packing.{file.format}"
            self.save(file, path, timeout)
            return path.read_bytes()

    def save(self, file: File, path: Path, timeout: float | None) -> None:
        """Writes a file."""
        if file.type is not None:
            self.export(file.type, {"format": file.format, **file.options}, path, timeout)
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        with refusals():
            self._made.table(file.format, path)

    def export(
        self, type: ExportType, options: Mapping[str, Any], path: Path, timeout: float | None
    ) -> dict[str, Any]:
        """Makes an export. It is not limited to a time."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with refusals():
            report: dict[str, Any] = json.loads(self._made.export(type, encoded(options), path))
        _warnings.warn(_warnings.texts(report))
        return report

    def plot(self, kind: PackingPlotKind, title: bool, theme: Theme) -> str:
        """A plot, drawn as a server draws it."""
        with refusals():
            return self._made.plot(kind, title, theme)

    def picture(self, pixels: int) -> bytes:
        """A picture, drawn as the command draws it."""
        with refusals():
            return self._made.picture(pixels)


@contextmanager
def _shown(
    progress: bool | Callable[[dict[str, Any]], object] | None,
) -> Iterator[Callable[[str], None] | None]:
    """Yields the function that takes the progress as JSON."""
    if not progress:
        yield None
    elif callable(progress):
        call = progress

        def tell(text: str) -> None:
            call(json.loads(text))

        yield tell
    else:
        with Progress("packing") as bar:

            def show(text: str) -> None:
                seen = json.loads(text)
                bar.show(seen["fraction"], note(seen["step"], seen["eta_s"]))

            yield show
            bar.show(1.0, "done")
