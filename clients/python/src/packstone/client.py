"""The client: where jobs and studies are submitted and found."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from types import TracebackType
from typing import Any, TypeVar
from urllib.parse import quote
from uuid import uuid4

from ._listing import ITEMS_PER_PAGE, pages
from ._transport import Transport, document
from .jobs import Job, State
from .studies import Study, StudyState

S = TypeVar("S", Job, Study)

DEFAULT_URL = "http://127.0.0.1:8080"


class Client:
    """A Packstone server.

    `url` and `api_key` are those of the environment (``PACKSTONE_URL``, ``PACKSTONE_API_KEY``) when left out;
    without either, the server of this machine. A broken connection or a server that is busy is met by
    trying again for `retry_s`, with growing pauses. May be used by several threads.
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
            api_key or os.environ.get("PACKSTONE_API_KEY"),
            agent=f"packstone-client/{version('packstone-client')}",
            timeout_s=timeout_s,
            retry_s=retry_s,
        )

    def close(self) -> None:
        """Closes the connections; a ``with`` statement does so by itself."""
        self._transport.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Client of {self._transport.url}>"

    def submit(
        self, job: Mapping[str, Any] | None = None, /, *, idempotency_key: str | None = None, **fields: Any
    ) -> Job:
        """Submits a job: a mapping as in ``POST /v1/jobs``, its fields by name, or both.

        A field by name replaces that of the mapping: ``submit(mix_design, seed=2)``. To send it again after
        a broken connection makes no second job; with an `idempotency_key` of your own that holds for a
        script that is started again, too.
        """
        return self._submitted(Job, "/v1/jobs", {**(job or {}), **fields}, idempotency_key)

    def dry_run(self, job: Mapping[str, Any] | None = None, /, **fields: Any) -> dict[str, Any]:
        """What a job would amount to: expected grains, volume fractions, memory, time, warnings.

        Raises :class:`PackstoneError` of the kind ``infeasible-mix`` when it cannot fit.
        """
        body = {**(job or {}), **fields}
        response = self._transport.request(
            "POST", "/v1/jobs", params={"dry_run": "true"}, body=body, repeatable=True
        )
        return document(response)

    def job(self, id: str) -> Job:
        """The job of that id."""
        response = self._transport.request("GET", f"/v1/jobs/{quote(id, safe='')}")
        return Job(self._transport, document(response), response.headers.get("etag"))

    def jobs(
        self,
        *,
        state: State | None = None,
        labels: Mapping[str, str] | None = None,
        study: str | None = None,
        page_size: int = ITEMS_PER_PAGE,
    ) -> Iterator[Job]:
        """The jobs on the server, newest first, fetched page by page; those that fit all that is named."""
        params = {
            "state": state,
            "label": _label_params(labels),
            "study": study,
        }
        for item in pages(self._transport, "/v1/jobs", params, page_size):
            yield Job(self._transport, item)

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
        idempotency_key: str | None = None,
    ) -> Study:
        """Submits a study: a mapping as in ``POST /v1/studies``, its fields by name, or both.

        Either a `list` of jobs, or a `template` and a `grid` of JSON pointers into it with their values, all
        of which are combined::

            client.study(
                template=job,
                grid={"/mix/volume_fraction": packstone.steps(0.55, 0.70, 0.005),
                      "/method": [{"type": "rsa"}, {"type": "edmd"}]},
                replicates=20,
            )

        The values of `zip` run together. It is taken in as a whole or not at all.
        """
        fields = {
            "template": template,
            "grid": grid,
            "zip": zip,
            "list": list,
            "replicates": replicates,
            "stop_when": stop_when,
            "seed": seed,
            "name": name,
            "labels": labels,
        }
        given = {field: value for field, value in fields.items() if value is not None}
        return self._submitted(Study, "/v1/studies", {**(study or {}), **given}, idempotency_key)

    def open_study(self, id: str) -> Study:
        """The study of that id, submitted earlier."""
        response = self._transport.request("GET", f"/v1/studies/{quote(id, safe='')}")
        return Study(self._transport, document(response), response.headers.get("etag"))

    def studies(
        self,
        *,
        state: StudyState | None = None,
        labels: Mapping[str, str] | None = None,
        page_size: int = ITEMS_PER_PAGE,
    ) -> Iterator[Study]:
        """The studies on the server, newest first, fetched page by page; those that fit all that is named."""
        params = {"state": state, "label": _label_params(labels)}
        for item in pages(self._transport, "/v1/studies", params, page_size):
            yield Study(self._transport, item)

    def capabilities(self) -> dict[str, Any]:
        """What the server can do, and how much of it."""
        return document(self._transport.request("GET", "/v1/capabilities"))

    def _submitted(self, kind: type[S], path: str, body: Mapping[str, Any], key: str | None) -> S:
        headers = {"idempotency-key": key or uuid4().hex}
        response = self._transport.request("POST", path, body=body, headers=headers, repeatable=True)
        return kind(self._transport, document(response), response.headers.get("etag"))


def _label_params(labels: Mapping[str, str] | None) -> list[str] | None:
    return [f"{key}:{value}" for key, value in (labels or {}).items()] or None
