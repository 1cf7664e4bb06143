"""Sends requests to the server and repeats them where that is safe.

All connections, retries and problem documents of the package are handled here.
"""

from __future__ import annotations

import email.utils
import logging
import os
import random
import threading
from collections.abc import Callable, Mapping, Sequence
from time import monotonic, sleep, time
from typing import IO, TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit

from ._requests import encoded
from .errors import ConnectionFailed, PackstoneError, WaitTimeout, error_of

# `import packstone` takes half of its time without httpx, which a packing in process does not need: it is imported
# where it is used.
if TYPE_CHECKING:
    import httpx

logger = logging.getLogger("packstone")

T = TypeVar("T")
Params = Mapping[str, str | int | float | bool | Sequence[str] | None]

# The environment variable of the API key.
KEY_VARIABLE = "PACKSTONE_API_KEY"
CONNECT_TIMEOUT_S = 10.0
FIRST_DELAY_S = 0.2
LONGEST_DELAY_S = 5.0
# The server refused the request before it did anything.
REFUSED_FOR_NOW = frozenset({429, 503, 507})
# A proxy does not know what became of the request.
UNKNOWN_FOR_NOW = frozenset({502, 504})
# A file is not made yet. The answer is a document about its progress.
NOT_MADE_YET = 202
# Longest time that the server holds an answer back.
LONGEST_WAIT_S = 60
# Shortest pause between two requests for a file that is being made.
SHORTEST_PAUSE_S = 0.1


class Transport:
    """Sends requests, repeats them where that is safe, and raises what the server refuses.

    A transport can be pickled: the copy opens connections of its own. The pickle does not contain the API key, which
    the copy takes from ``PACKSTONE_API_KEY``.
    """

    def __init__(self, url: str, api_key: str | None, *, agent: str, timeout_s: float, retry_s: float) -> None:
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.netloc:
            raise ValueError(f"{url!r} is not the address of a server: must be like http://localhost:8080")
        self.url = url.rstrip("/")
        # The path below which the server lies; the links of a server that knows it begin with it.
        self._base_path = urlsplit(self.url).path
        self._timeout_s = timeout_s
        self._retry_s = retry_s
        self._headers = {"user-agent": agent, "accept": "application/json"}
        self._set_key(api_key)
        self._lacks_key = False
        self._closed = False
        self._forget_connections()

    def _set_key(self, api_key: str | None) -> None:
        if api_key:
            self._headers["authorization"] = f"Bearer {api_key.strip()}"

    def _forget_connections(self) -> None:
        self._lock = threading.Lock()
        self._open: httpx.Client | None = None
        self._process = os.getpid()

    def __getstate__(self) -> dict[str, Any]:
        own = ("_lock", "_open", "_process", "_headers")
        state = {name: value for name, value in vars(self).items() if name not in own}
        headers = {name: value for name, value in self._headers.items() if name != "authorization"}
        return {**state, "_headers": headers, "_had_key": self._lacks_key or self.has_key}

    def __setstate__(self, state: dict[str, Any]) -> None:
        had_key = state.pop("_had_key")
        vars(self).update(state)
        self._set_key(os.environ.get(KEY_VARIABLE) if had_key else None)
        self._lacks_key = had_key and not self.has_key
        self._forget_connections()

    def __del__(self) -> None:
        # A copy made by pickle has no owner that closes it.
        if getattr(self, "_open", None) is not None and self._process == os.getpid():
            self.close()

    @property
    def _http(self) -> httpx.Client:
        if self._process != os.getpid():
            # After a fork the connections belong to the parent process.
            self._forget_connections()
        import httpx

        with self._lock:
            if self._closed:
                raise RuntimeError(f"the client of {self.url} is closed")
            if self._lacks_key:
                raise ValueError(f"a pickle does not hold the API key: set {KEY_VARIABLE} where it is loaded")
            if self._open is None:
                self._open = httpx.Client(base_url=self.url, headers=self._headers)
            return self._open

    def _below(self, path: str) -> str:
        """The path of a link without the one of the server, which every request gets."""
        is_whole = self._base_path and path.startswith(f"{self._base_path}/")
        return path[len(self._base_path) :] if is_whole else path

    @property
    def has_key(self) -> bool:
        """Whether requests carry an API key."""
        return "authorization" in self._headers

    def close(self) -> None:
        """Closes the connections. A later request is an error, and so is one that waits for its repetition."""
        with self._lock:
            self._closed = True
            if self._open is not None:
                self._open.close()
                self._open = None

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
        """Returns the answer to a request. The server may hold the answer back for `wait_s`.

        `repeatable` says that the request has the same effect if it arrives more than once. The default is
        true for all methods but POST.
        """
        fields = dict(headers or {})
        content = None
        if body is not None:
            content = encoded(body).encode()
            fields.setdefault("content-type", "application/json")
        if wait_s:
            fields["prefer"] = f"wait={wait_s}"
        safe = method != "POST" if repeatable is None else repeatable
        request = self._http.build_request(
            method,
            self._below(path),
            params=given(params),
            content=content,
            headers=fields,
            timeout=self._limits(wait_s),
        )

        def attempt() -> httpx.Response:
            response = self._http.send(request)
            _check(response, safe)
            return response

        return self._persist(attempt, _Patience(self._retry_s), safe)

    def download(
        self, path: str, sink: IO[bytes], *, params: Params | None = None, timeout: float | None = None
    ) -> None:
        """Writes the file at an address into an empty file.

        A download that breaks off goes on where it was. If the server has to make the file first, this waits
        for it; after `timeout` in s it raises :class:`WaitTimeout`, and the server goes on.
        """
        until = None if timeout is None else monotonic() + timeout
        patience = _Patience(self._retry_s)
        etag: str | None = None

        def attempt() -> None:
            nonlocal etag
            left_s = LONGEST_WAIT_S if until is None else max(1, min(LONGEST_WAIT_S, int(until - monotonic())))
            # A range counts the bytes of the file itself, so that the answer must not be compressed.
            headers = {"accept": "*/*", "accept-encoding": "identity", "prefer": f"wait={left_s}"}
            have = sink.tell()
            if have and etag:
                headers |= {"range": f"bytes={have}-", "if-range": etag}
            limits = self._limits(left_s)
            # A server may name the file in its storage (307). Another host does not get the API key.
            with self._http.stream(
                "GET", self._below(path), params=given(params), headers=headers, timeout=limits, follow_redirects=True
            ) as response:
                if response.status_code >= 300 or response.status_code == NOT_MADE_YET:
                    response.read()
                _check(response, True)
                if response.status_code == NOT_MADE_YET:
                    raise _NotMadeYet(_retry_after_s(response))
                if response.status_code != 206:
                    sink.seek(0)
                    sink.truncate()
                etag = response.headers.get("etag")
                for block in response.iter_raw():
                    sink.write(block)
                    patience.renew()

        while True:
            try:
                return self._persist(attempt, patience, True)
            except _NotMadeYet as unfinished:
                if until is not None and monotonic() + unfinished.after_s > until:
                    raise WaitTimeout(f"{self.url}{path} is not made within {timeout:g} s") from None
                # This is not a failure, so that it does not count against the time for retries.
                patience.renew()
                sleep(max(unfinished.after_s, SHORTEST_PAUSE_S))

    def _limits(self, wait_s: int) -> httpx.Timeout:
        """The limits of time for a request whose answer the server may hold back for `wait_s`."""
        import httpx

        return httpx.Timeout(self._timeout_s, connect=CONNECT_TIMEOUT_S, read=self._timeout_s + wait_s)

    def _persist(self, attempt: Callable[[], T], patience: _Patience, safe: bool) -> T:
        """Returns what `attempt` returns as soon as it succeeds."""
        import httpx

        # The server has not seen the request.
        never_sent = (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout)
        # A repetition would fail in the same way.
        faults_of_the_caller = (httpx.UnsupportedProtocol, httpx.LocalProtocolError)
        while True:
            try:
                return attempt()
            except _Again as again:
                error, least_s = again.error, again.after_s
            except httpx.TransportError as broken:
                reason = str(broken) or type(broken).__name__
                error, least_s = ConnectionFailed(f"no answer from {self.url}: {reason}"), 0.0
                error.__cause__ = broken
                unsure = not safe and not isinstance(broken, never_sent)
                if unsure or isinstance(broken, faults_of_the_caller):
                    raise error
            delay_s = patience.next_delay_s(least_s)
            if delay_s is None:
                raise error
            logger.warning("%s; trying again in %.1f s", error, delay_s)
            sleep(delay_s)


class _NotMadeYet(Exception):
    """The server is still making a file."""

    def __init__(self, after_s: float) -> None:
        super().__init__(after_s)
        self.after_s = after_s


class _Again(Exception):
    """A refusal that may not last."""

    def __init__(self, error: PackstoneError, after_s: float) -> None:
        super().__init__(str(error))
        self.error = error
        self.after_s = after_s


class _Patience:
    """Decides how long a failing request is repeated. The time counts from the first failure of a series."""

    def __init__(self, limit_s: float) -> None:
        self._limit_s = limit_s
        self.renew()

    def renew(self) -> None:
        """Forgets the failures after a success."""
        self._until: float | None = None
        self._backoff_s = FIRST_DELAY_S

    def next_delay_s(self, least_s: float) -> float | None:
        """Returns the pause before the next attempt, at least `least_s`; `None` if the time is over."""
        now = monotonic()
        if self._until is None:
            self._until = now + self._limit_s
        # Random, so that the clients of a server that restarts do not all return at the same time.
        delay_s = max(least_s, self._backoff_s * random.uniform(0.5, 1.0))
        self._backoff_s = min(2 * self._backoff_s, LONGEST_DELAY_S)
        return delay_s if now + delay_s < self._until else None


def document(response: httpx.Response) -> dict[str, Any]:
    """Returns the JSON object of an answer."""
    try:
        value = response.json()
    except ValueError:
        value = None
    if not isinstance(value, dict):
        media_type = response.headers.get("content-type", "nothing")
        raise PackstoneError(f"{response.url} answered {media_type}, not a JSON object: is it Packstone?")
    return value


def given(params: Params | None) -> dict[str, str | int | float | bool | Sequence[str]] | None:
    """Returns the parameters that have a value; `None` if there are none, which leaves a query as it is."""
    spelled = {name: _spelled(value) for name, value in (params or {}).items() if value is not None}
    return spelled or None


def _spelled(value: str | int | float | bool | Sequence[str]) -> str | int | float | Sequence[str]:
    return str(value).lower() if isinstance(value, bool) else value


def _check(response: httpx.Response, safe: bool) -> None:
    """Raises an exception if the server has refused the request."""
    status = response.status_code
    if status < 300 or status == 304:
        return
    if status < 400:
        to = response.headers.get("location", "elsewhere")
        raise PackstoneError(f"{response.url} redirects to {to}: use that address")
    error = _refusal(response)
    if status in REFUSED_FOR_NOW or (safe and status in UNKNOWN_FOR_NOW):
        raise _Again(error, _retry_after_s(response))
    raise error


def _refusal(response: httpx.Response) -> PackstoneError:
    try:
        problem = response.json()
    except ValueError:
        problem = None
    if isinstance(problem, dict) and "type" in problem:
        return error_of(problem)
    # The answer came from something between the client and Packstone.
    return PackstoneError(
        f"{response.url} answered {response.status_code} {response.reason_phrase}",
        {"status": response.status_code},
    )


def _retry_after_s(response: httpx.Response) -> float:
    """Returns the seconds that `Retry-After` asks for. The field is a number of seconds or a date."""
    field = response.headers.get("retry-after", "").strip()
    if field.isdecimal():
        return float(field)
    try:
        return max(0.0, email.utils.parsedate_to_datetime(field).timestamp() - time())
    except ValueError:
        return 0.0
