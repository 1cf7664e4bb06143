"""The client, which submits jobs and studies and finds them again."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast
from urllib.parse import quote
from uuid import uuid4

from . import _html, _warnings
from ._listing import ITEMS_PER_PAGE, pages
from ._native import __version__
from ._requests import job_body, rfc3339, study_body
from ._transport import KEY_VARIABLE, Transport, document
from .jobs import FinishedState, Job, State
from .packings import Packing
from .studies import Study, StudyState

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from .builders import JobFields
    from .results import JobPlan
    from .services import Capabilities, KeyInfo

S = TypeVar("S", Job, Study)
JobOrder = Literal["created", "-created", "priority", "-priority", "finished", "-finished"]

DEFAULT_URL = "http://127.0.0.1:8080"


class Client:
    """A connection to a Packstone server.

    If a connection breaks or the server is busy, a request is repeated with growing pauses. Several threads may share a
    client. A client can be pickled, and so can its jobs and studies; the pickle never contains the API key, which the
    copy takes from ``PACKSTONE_API_KEY``. A pickled :class:`Packing` holds its grains and needs no server.

    Parameters
    ----------
    url
        The address, that of the environment variable ``PACKSTONE_URL`` if it is not given, or the server of this
        machine.
    api_key
        The API key, that of ``PACKSTONE_API_KEY`` if it is not given.
    timeout_s
        Longest wait for an answer in s.
    retry_s
        For how long a request is repeated in s.

    Examples
    --------
    >>> with packstone.Client(client.url) as lab:
    ...     packing = lab.pack(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1)
    ...     print(len(packing))
    45
    """

    def __init__(
        self,
        url: str | None = None,
        api_key: str | None = None,
        *,
        timeout_s: float = 60.0,
        retry_s: float = 60.0,
    ) -> None:
        self._transport = Transport(
            url or os.environ.get("PACKSTONE_URL") or DEFAULT_URL,
            api_key or os.environ.get(KEY_VARIABLE),
            agent=f"packstone-python/{__version__}",
            timeout_s=timeout_s,
            retry_s=retry_s,
        )

    @property
    def url(self) -> str:
        """The address of the server."""
        return self._transport.url

    def close(self) -> None:
        """Closes the connections, as the end of a ``with`` statement does. A later request is a `RuntimeError`."""
        self._transport.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Client of {self._transport.url}>"

    def _repr_html_(self) -> str:
        rows = {"server": self._transport.url, "API key": "yes" if self._transport.has_key else "no"}
        return _html.card("Packstone client", rows)

    def submit(
        self,
        job: Mapping[str, Any] | None = None,
        /,
        *,
        idempotency_key: str | None = None,
        **fields: Unpack[JobFields],
    ) -> Job:
        """Submits a job and returns it at once; :meth:`Job.result` waits for its packing.

        A submission that is repeated after a broken connection makes one job. Warnings of the server are issued as
        :class:`PackstoneWarning`.

        Parameters
        ----------
        job
            A mapping as in ``POST /v1/jobs``.
        idempotency_key
            A key of your own, by which a script that is started again makes no second job either.
        **fields
            Fields of the job, see :class:`JobFields`, which replace those of `job`: ``submit(mix_design, seed=2)``.

        Examples
        --------
        >>> job = client.submit(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), seed=1, name="core")
        >>> job.wait().state
        'succeeded'
        >>> client.job(job.id).name
        'core'
        """
        return self._submitted(Job, "/v1/jobs", job_body(job, fields), idempotency_key)

    def pack(
        self,
        job: Mapping[str, Any] | None = None,
        /,
        *,
        timeout: float | None = None,
        progress: bool = False,
        **fields: Unpack[JobFields],
    ) -> Packing:
        """Lets the server pack, and returns the packing, as :func:`packstone.pack` does in this process.

        It is ``submit(job).result()``: :meth:`submit` returns at once with the :class:`Job`.

        Parameters
        ----------
        job
            A mapping as in ``POST /v1/jobs``.
        timeout
            Longest wait in s; the job goes on after it.
        progress
            Whether a bar is shown.
        **fields
            Fields of the job, which replace those of the mapping.
        """
        return self.submit(job, **fields).result(timeout, progress)

    def plan(self, job: Mapping[str, Any] | None = None, /, **fields: Unpack[JobFields]) -> JobPlan:
        """Returns what a job amounts to: expected grains, volume fractions, memory, time, warnings. Nothing is stored.

        Parameters
        ----------
        job
            A mapping as in ``POST /v1/jobs``.
        **fields
            Fields of the job, which replace those of `job`.

        Raises
        ------
        InvalidRequest
            If the request is refused, or of the kind ``infeasible-mix`` if the grains do not fit.

        Examples
        --------
        >>> round(client.plan(specimen=60, mix=packstone.Mix("A16", 0.5, d_min_mm=4))["grains"])
        393
        """
        response = self._transport.request("POST", "/v1/plans", body=job_body(job, fields), repeatable=True)
        plan = cast("JobPlan", document(response))
        _warnings.warn(_warnings.texts(plan))
        return plan

    def job(self, id: str) -> Job:
        """Returns the job of that ID."""
        response = self._transport.request("GET", f"/v1/jobs/{quote(id, safe='')}")
        return Job(self._transport, document(response), response.headers.get("etag"))

    def jobs(
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
    ) -> Iterator[Job]:
        """Yields the jobs that match all arguments. They are fetched page by page.

        Parameters
        ----------
        state
            Their state.
        labels
            Labels that they have.
        study
            The ID of their study.
        name
            A part of their name.
        method
            The method that they request.
        created_after, created_before
            Bounds of the time of their submission.
        sort
            ``-created``, newest first, if it is not given; ``priority`` and ``finished`` sort by the priority and by
            the end, and ``-`` reverses the order.
        page_size
            Jobs of each request to the server.

        Examples
        --------
        >>> job = client.submit(specimen=40, mix=packstone.Mix("A16", 0.2, d_min_mm=4), labels={"series": "TB-7"})
        >>> [found.id for found in client.jobs(labels={"series": "TB-7"})] == [job.id]
        True
        """
        params = {
            "state": state,
            "label": _label_params(labels),
            "study": study,
            "name": name,
            "method": method,
            "created_after": rfc3339(created_after),
            "created_before": rfc3339(created_before),
            "sort": sort,
        }
        for item in pages(self._transport, "/v1/jobs", params, page_size):
            yield Job(self._transport, item)

    def delete_jobs(
        self,
        *,
        state: FinishedState | None = None,
        labels: Mapping[str, str] | None = None,
        before: datetime | str | None = None,
        dry_run: bool = False,
    ) -> int:
        """Deletes the finished jobs that match all arguments, with their results, and returns how many those were.

        At least one of `state`, `labels` and `before` must be given. Jobs of studies are left to their study.

        Parameters
        ----------
        state
            Their state.
        labels
            Labels that they have.
        before
            The time before which they ended.
        dry_run
            Whether the jobs are only counted.

        Examples
        --------
        >>> client.delete_jobs(labels={"series": "none"}, dry_run=True)
        0
        """
        params = {
            "state": state,
            "label": _label_params(labels),
            "before": rfc3339(before),
            "dry_run": dry_run,
        }
        deleted = 0
        while True:
            answer = document(self._transport.request("DELETE", "/v1/jobs", params=params))
            deleted += int(answer["deleted"])
            if not answer["more"]:
                return deleted

    def study(
        self,
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
        labels: Mapping[str, str] | None = None,
        shared: bool | None = None,
        webhook_url: str | None = None,
        idempotency_key: str | None = None,
    ) -> Study:
        """Submits a study: a `list` of jobs, or a `template` with a `grid` of JSON pointers into it and their values.

        The study is accepted as a whole or not at all. Each combination of values of the grid is a point.

        Parameters
        ----------
        study
            A mapping as in ``POST /v1/studies``; arguments replace its fields.
        template
            The job of which each point is a variant.
        grid
            JSON pointers into the template with their values, or with :func:`steps`.
        zip
            The same, whose values vary together.
        list
            In place of a template: the jobs of all points.
        replicates
            The number of runs of each point.
        stop_when
            A rule that ends a point, as ``{"failed_in_a_row": 3}``.
        seed
            The seed from which those of the jobs follow.
        name, labels
            A name for people, and labels by which listings find it.
        shared
            Whether other users of the server may read it.
        webhook_url
            Where a signed message is sent when the study is finished, if the server sends webhooks.
        idempotency_key
            As that of :meth:`submit`.

        Examples
        --------
        >>> job = {"specimen": 40, "mix": packstone.Mix("A16", 0.2, d_min_mm=4), "distance": 0.2}
        >>> study = client.study(template=job, grid={"/method": ["rsa", "edmd"]}, replicates=2, seed=1)
        >>> [row["successes"] for row in study.wait().table()]
        [2, 2]
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
            labels=labels,
            shared=shared,
            webhook_url=webhook_url,
        )
        return self._submitted(Study, "/v1/studies", body, idempotency_key)

    def open_study(self, id: str) -> Study:
        """Returns the study of that ID."""
        response = self._transport.request("GET", f"/v1/studies/{quote(id, safe='')}")
        return Study(self._transport, document(response), response.headers.get("etag"))

    def studies(
        self,
        *,
        state: StudyState | None = None,
        labels: Mapping[str, str] | None = None,
        page_size: int = ITEMS_PER_PAGE,
    ) -> Iterator[Study]:
        """Yields the studies that match all arguments, newest first. They are fetched page by page."""
        params = {"state": state, "label": _label_params(labels)}
        for item in pages(self._transport, "/v1/studies", params, page_size):
            yield Study(self._transport, item)

    def capabilities(self) -> Capabilities:
        """Returns the methods, formats and limits of the server."""
        return cast("Capabilities", document(self._transport.request("GET", "/v1/capabilities")))

    def key(self) -> KeyInfo:
        """Returns name, owner, role and quotas of the API key of this client, and what is used of the quotas."""
        return cast("KeyInfo", document(self._transport.request("GET", "/v1/key")))

    def _submitted(self, kind: type[S], path: str, body: Mapping[str, Any], key: str | None) -> S:
        headers = {"idempotency-key": key or uuid4().hex}
        response = self._transport.request("POST", path, body=body, headers=headers, repeatable=True)
        submitted = kind(self._transport, document(response), response.headers.get("etag"))
        submitted._warn()
        return submitted


def _label_params(labels: Mapping[str, str] | None) -> list[str] | None:
    return [f"{key}={value}" for key, value in (labels or {}).items()] or None
