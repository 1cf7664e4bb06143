"""Requests to the server: the one place that knows about connections, retries and problem documents.

It must never know what a job or a study is.
"""

from __future__ import annotations

import email.utils
import json
import logging
import random
from collections.abc import Callable, Mapping, Sequence
from time import monotonic, sleep, time
from typing import IO, Any, TypeVar
from urllib.parse import urlsplit

import httpx
import numpy as np

from .errors import ConnectionFailed, PackstoneError, error_of

logger = logging.getLogger("packstone")

T = TypeVar("T")
Params = Mapping[str, str | int | float | bool | Sequence[str] | None]

CONNECT_TIMEOUT_S = 10.0
FIRST_DELAY_S = 0.2
LONGEST_DELAY_S = 5.0
# Refusals before anything was done, whatever the request.
REFUSED_FOR_NOW = frozenset({429, 503})
# What is asked for takes longer to make than an answer is held back.
BEING_MADE = "format-not-ready"
# Of a proxy that does not know what became of the request.
UNKNOWN_FOR_NOW = frozenset({502, 504})
# The server cannot have seen the request.
NEVER_SENT = (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout)
# To try again would end in the same way.
FAULTS_OF_THE_CALLER = (httpx.UnsupportedProtocol, httpx.LocalProtocolError)


class Transport:
    """Sends requests, again where that is safe, and raises what the server refuses."""

    def __init__(self, url: str, api_key: str | None, *, agent: str, timeout_s: float, retry_s: float) -> None:
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.netloc:
            raise ValueError(f"{url!r} is no address of a server: must be like http://localhost:8080")
        self.url = url.rstrip("/")
        self._timeout_s = timeout_s
        self._retry_s = retry_s
        headers = {"user-agent": agent, "accept": "application/json"}
        if api_key:
            headers["authorization"] = f"Bearer {api_key.strip()}"
        self._http = httpx.Client(base_url=self.url, headers=headers)

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def request(
        self,
        method: str,
        path: str,
        *,
        params: Params | None = None,
        body: object = None,
        headers: Mapping[str, str] | None = None,
        wait_s: int = 0,
        repeatable: bool | None = None,
    ) -> httpx.Response:
        """The answer to a request, which the server may hold back for `wait_s`.

        `repeatable` says that the request has the same effect however often it arrives, as all but a POST
        have.
        """
        fields = dict(headers or {})
        content = None
        if body is not None:
            content = encoded(body)
            fields["content-type"] = "application/json"
        if wait_s:
            fields["prefer"] = f"wait={wait_s}"
        safe = method != "POST" if repeatable is None else repeatable
        request = self._http.build_request(
            method,
            path,
            params=_given(params),
            content=content,
            headers=fields,
            timeout=httpx.Timeout(self._timeout_s, connect=CONNECT_TIMEOUT_S, read=self._timeout_s + wait_s),
        )

        def attempt() -> httpx.Response:
            response = self._http.send(request)
            _check(response, safe)
            return response

        return self._persist(attempt, _Patience(self._retry_s), safe)

    def download(self, path: str, sink: IO[bytes], *, params: Params | None = None) -> None:
        """Writes what is at an address into an empty file, going on after breaks where they were."""
        patience = _Patience(self._retry_s)
        etag: str | None = None

        def attempt() -> None:
            nonlocal etag
            # The bytes of the resource itself, since parts of it are counted in them.
            headers = {"accept": "*/*", "accept-encoding": "identity"}
            have = sink.tell()
            if have and etag:
                headers |= {"range": f"bytes={have}-", "if-range": etag}
            timeout = httpx.Timeout(self._timeout_s, connect=CONNECT_TIMEOUT_S)
            with self._http.stream(
                "GET", path, params=_given(params), headers=headers, timeout=timeout
            ) as response:
                if response.status_code >= 300:
                    response.read()
                _check(response, True)
                if response.status_code != 206:
                    sink.seek(0)
                    sink.truncate()
                etag = response.headers.get("etag")
                for block in response.iter_raw():
                    sink.write(block)
                    patience.renew()

        self._persist(attempt, patience, True)

    def _persist(self, attempt: Callable[[], T], patience: _Patience, safe: bool) -> T:
        """What `attempt` returns, once it succeeds."""
        while True:
            try:
                return attempt()
            except _Again as again:
                error, least_s = again.error, again.after_s
                if error.kind == BEING_MADE:
                    # No failure: the server is at it, however long that takes.
                    logger.info("%s; asking again in %.1f s", error, least_s)
                    patience.renew()
                    sleep(least_s)
                    continue
            except httpx.TransportError as broken:
                reason = str(broken) or type(broken).__name__
                error, least_s = ConnectionFailed(f"no answer from {self.url}: {reason}"), 0.0
                error.__cause__ = broken
                unsure = not safe and not isinstance(broken, NEVER_SENT)
                if unsure or isinstance(broken, FAULTS_OF_THE_CALLER):
                    raise error
            delay_s = patience.next_delay_s(least_s)
            if delay_s is None:
                raise error
            logger.warning("%s; trying again in %.1f s", error, delay_s)
            sleep(delay_s)


class _Again(Exception):
    """A refusal that may be none after a while."""

    def __init__(self, error: PackstoneError, after_s: float) -> None:
        super().__init__(str(error))
        self.error = error
        self.after_s = after_s


class _Patience:
    """How long failures are met by trying again: counted from the first of them in a row."""

    def __init__(self, limit_s: float) -> None:
        self._limit_s = limit_s
        self.renew()

    def renew(self) -> None:
        """Something went well."""
        self._until: float | None = None
        self._backoff_s = FIRST_DELAY_S

    def next_delay_s(self, least_s: float) -> float | None:
        """Time to wait before the next attempt, at least what the server asks for; none if too long."""
        now = monotonic()
        if self._until is None:
            self._until = now + self._limit_s
        # Drawn, so that the clients of a server that comes back do not all come back at once.
        delay_s = max(least_s, self._backoff_s * random.uniform(0.5, 1.0))
        self._backoff_s = min(2 * self._backoff_s, LONGEST_DELAY_S)
        return delay_s if now + delay_s <= self._until else None


def document(response: httpx.Response) -> dict[str, Any]:
    """The JSON object of an answer."""
    try:
        value = response.json()
    except ValueError:
        value = None
    if not isinstance(value, dict):
        media_type = response.headers.get("content-type", "nothing")
        raise PackstoneError(f"{response.url} answered {media_type}, not a JSON object: is it Packstone?")
    return value


def encoded(value: object) -> bytes:
    """The value as JSON; numpy's numbers and arrays are taken as the lists and numbers they hold."""
    return json.dumps(value, allow_nan=False, default=_plain).encode()


def _plain(value: object) -> object:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, Sequence):
        return list(value)
    raise TypeError(f"{type(value).__name__} {value!r} has no form in JSON")


def _given(params: Params | None) -> dict[str, str | int | float | bool | Sequence[str]]:
    return {name: value for name, value in (params or {}).items() if value is not None}


def _check(response: httpx.Response, safe: bool) -> None:
    """Raises what the server refuses."""
    status = response.status_code
    if status < 300 or status == 304:
        return
    if status < 400:
        to = response.headers.get("location", "elsewhere")
        raise PackstoneError(f"{response.url} redirects to {to}: use that address")
    error = _refusal(response)
    for_now = status in REFUSED_FOR_NOW or error.kind == BEING_MADE
    if for_now or (safe and status in UNKNOWN_FOR_NOW):
        raise _Again(error, _retry_after_s(response))
    raise error


def _refusal(response: httpx.Response) -> PackstoneError:
    try:
        problem = response.json()
    except ValueError:
        problem = None
    if isinstance(problem, dict) and "type" in problem:
        return error_of(problem)
    # Of something between the client and Packstone.
    return PackstoneError(
        f"{response.url} answered {response.status_code} {response.reason_phrase}",
        {"status": response.status_code},
    )


def _retry_after_s(response: httpx.Response) -> float:
    """`Retry-After`, which is a number of seconds or a date."""
    field = response.headers.get("retry-after", "").strip()
    if field.isdecimal():
        return float(field)
    try:
        return max(0.0, email.utils.parsedate_to_datetime(field).timestamp() - time())
    except ValueError:
        return 0.0
