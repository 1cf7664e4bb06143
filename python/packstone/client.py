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

S = TypeVar("S", Job, Study)
JobOrder = Literal["created", "-created", "priority", "-priority", "finished", "-finished"]

DEFAULT_URL = "http://127.0.0.1:8080"


class Client:
    """A connection to a Packstone server.

    The defaults of `url` and `api_key` are the environment variables ``PACKSTONE_URL`` and
    ``PACKSTONE_API_KEY``; without them, the server of this machine. If a connection breaks or the server is
    busy, the request is repeated for `retry_s` with growing pauses. Several threads may share a client. A
    client can be pickled, and so can its jobs and studies; the pickle never contains the API key, which the copy takes
    from ``PACKSTONE_API_KEY``. A pickled :class:`Packing` holds its grains and needs no server.
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
        """Submits a job: a mapping as in ``POST /v1/jobs``, its fields as arguments, or both.

        An argument replaces the field of the mapping: ``submit(mix_design, seed=2)``. A submission that is
        repeated after a broken connection makes one job. With an `idempotency_key` of your own that holds for
        a script that is started again, too. Warnings of the server are issued as :class:`PackstoneWarning`.
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
        """Returns what a job amounts to: expected grains, volume fractions, memory, time, warnings.

        Nothing is stored. Raises :class:`PackstoneError` of the kind ``infeasible-mix`` if the grains do not
        fit.
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
        """Yields the jobs that match all arguments.

        `name` is a part of the name. `sort` is ``-created``, newest first, if it is not given; ``priority`` and
        ``finished`` sort by the priority and by the end, and ``-`` reverses the order. They are fetched page by page.
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

        At least one of `state`, `labels` and `before` must be given; `before` is the time before which they ended.
        Jobs of studies are left to their study. With `dry_run` the jobs are only counted.
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
        """Submits a study: a mapping as in ``POST /v1/studies``, its fields as arguments, or both.

        A study is a `list` of jobs, or a `template` and a `grid` of JSON pointers into it with their values.
        Each combination of values is a point::

            client.study(
                template=job,
                grid={"/mix/volume_fraction": packstone.steps(0.55, 0.70, 0.005),
                      "/method": [{"type": "rsa"}, {"type": "edmd"}]},
                replicates=20,
            )

        `webhook_url` is sent a signed message when the study is finished, if the server sends webhooks.
        The values of `zip` vary together. The study is accepted as a whole or not at all.
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

    def capabilities(self) -> dict[str, Any]:
        """Returns the methods, formats and limits of the server."""
        return document(self._transport.request("GET", "/v1/capabilities"))

    def key(self) -> dict[str, Any]:
        """Returns name, owner, role and quotas of the API key of this client, and what is used of the quotas."""
        return document(self._transport.request("GET", "/v1/key"))

    def _submitted(self, kind: type[S], path: str, body: Mapping[str, Any], key: str | None) -> S:
        headers = {"idempotency-key": key or uuid4().hex}
        response = self._transport.request("POST", path, body=body, headers=headers, repeatable=True)
        submitted = kind(self._transport, document(response), response.headers.get("etag"))
        submitted._warn()
        return submitted


def _label_params(labels: Mapping[str, str] | None) -> list[str] | None:
    return [f"{key}={value}" for key, value in (labels or {}).items()] or None
