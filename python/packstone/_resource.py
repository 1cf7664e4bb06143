"""Common parts of jobs, studies and exports: a document of the server, and a wait for its changes.

A wait uses long polling: the server holds the answer back until the document changes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from datetime import datetime
from time import monotonic, sleep
from typing import Any, TypeVar

from . import _warnings
from ._progress import Progress, note
from ._transport import LONGEST_WAIT_S, Params, Transport, document
from .errors import WaitTimeout

R = TypeVar("R", bound="Changing")

# Shortest time between two requests. A study of short jobs changes all the time.
NEWS_EVERY_S = 0.25
# Pause after an answer that came at once: from a server that is about to stop, or through a proxy that drops `Prefer`.
PAUSE_S = 1.0


class Changing(ABC):
    """A document of the server that changes until the work behind it has ended."""

    def __init__(self, transport: Transport, data: dict[str, Any], etag: str | None = None) -> None:
        self._transport = transport
        self._warned: set[str] = set()
        self._take(data, etag)

    data: dict[str, Any]
    """The document as the server sent it last."""

    @property
    def created_at(self) -> datetime:
        """The time of the submission."""
        return _time(self.data["created_at"])

    @property
    def finished_at(self) -> datetime | None:
        """The time of the end; `None` before it."""
        return self._time_of("finished_at")

    def _time_of(self, field: str) -> datetime | None:
        at = self.data.get(field)
        return None if at is None else _time(at)

    @property
    def progress(self) -> dict[str, Any]:
        """The progress as the server sent it last; empty before the start."""
        return dict(self.data["progress"] or {})

    @property
    def fraction(self) -> float:
        """The fraction of the work that is done, between 0 and 1."""
        return 1.0 if self.finished else float(self.progress.get("fraction") or 0.0)

    @property
    def eta_s(self) -> float | None:
        """The server's estimate of the remaining time, in s; `None` if it has none."""
        eta_s = None if self.finished else self.progress.get("eta_s")
        return None if eta_s is None else float(eta_s)

    @property
    def warnings(self) -> list[str]:
        """What is doubtful about the request or the result, one sentence each."""
        return _warnings.texts(self.data)

    @property
    @abstractmethod
    def finished(self) -> bool:
        """Whether the work has ended, in any way, when the document was last read."""

    @property
    def path(self) -> str:
        """The address on the server."""
        return str(self.data["links"]["self"])

    def refresh(self: R) -> R:
        """Reads the document again."""
        response = self._transport.request("GET", self.path)
        self._take(document(response), response.headers.get("etag"))
        return self

    def wait(
        self: R, timeout: float | None = None, progress: bool | Callable[[R], object] | None = None
    ) -> R:
        """Waits for the end of the work and returns this object.

        ``progress=True`` shows a bar (of tqdm if it is installed) with the remaining time. A function is called
        with this object at first and after every change: ``progress=print``. After `timeout` in s this raises
        :class:`WaitTimeout`; the work goes on. Warnings of the server are issued as :class:`PackstoneWarning`.
        """
        if progress is True:
            with Progress(self._title) as bar:
                self._wait(timeout, lambda seen: bar.show(seen.fraction, seen._note()))
        else:
            self._wait(timeout, progress or None)
        self._warn()
        return self

    def _wait(self: R, timeout: float | None, told: Callable[[R], object] | None) -> None:
        until = None if timeout is None else monotonic() + timeout
        if told is not None:
            if self._etag is None and not self.finished:
                self.refresh()
            told(self)
        while not self.finished:
            left_s = None if until is None else until - monotonic()
            if left_s is not None and left_s <= 0:
                raise WaitTimeout(f"{self} has not ended within {timeout:g} s")
            poll_s = LONGEST_WAIT_S if left_s is None else max(1, min(LONGEST_WAIT_S, int(left_s)))
            asked_at = monotonic()
            news = self._poll(poll_s, until_end=told is None)
            if news and told is not None:
                told(self)
            if self.finished:
                break
            took_s = monotonic() - asked_at
            if news:
                sleep(max(0.0, NEWS_EVERY_S - took_s))
            elif took_s < min(PAUSE_S, poll_s / 2):
                sleep(PAUSE_S)

    def _poll(self, wait_s: int, *, until_end: bool) -> bool:
        """Reads the document, which the server may hold back for `wait_s`. Returns whether there is news.

        News is the end of the work, and every other change if not `until_end`.
        """
        headers = {}
        if not until_end and self._etag is not None:
            headers["if-none-match"] = self._etag
        response = self._transport.request("GET", self.path, headers=headers, wait_s=wait_s)
        if response.status_code == 304:
            return False
        self._take(document(response), response.headers.get("etag"))
        return not until_end or self.finished

    def _take(self, data: dict[str, Any], etag: str | None) -> None:
        self.data, self._etag = data, etag

    def _warn(self) -> None:
        """Issues the warnings that were not issued before."""
        new = [text for text in self.warnings if text not in self._warned]
        self._warned.update(new)
        _warnings.warn(new)

    def _note(self) -> str:
        """A few words beside a progress bar."""
        return note(self._state_words(), self.eta_s)

    @property
    @abstractmethod
    def _title(self) -> str:
        """What this is, for a message or a bar."""

    @abstractmethod
    def _state_words(self) -> str:
        """The state in a few words."""


class Resource(Changing):
    """A job or a study."""

    _request: dict[str, Any] | None = None

    @property
    def id(self) -> str:
        """The ID on the server."""
        return str(self.data["id"])

    @property
    def name(self) -> str | None:
        """The name for people."""
        name = self.data["name"]
        return None if name is None else str(name)

    @property
    def labels(self) -> dict[str, str]:
        """The labels, by which listings find it."""
        return dict(self.data["labels"])

    @property
    def seed(self) -> int:
        """The seed of all its random numbers."""
        return int(self.data["seed"])

    @property
    def request(self) -> dict[str, Any]:
        """The request with the defaults filled in. It is fetched when it is first needed."""
        if self._request is None:
            self._request = self._fetch_request()
        return dict(self._request)

    @abstractmethod
    def _fetch_request(self) -> dict[str, Any]:
        """Reads the request from the server."""

    def delete(self, *, if_unchanged: bool = False) -> None:
        """Removes it from the server with its results. It must have ended.

        With `if_unchanged` the server refuses (``precondition-failed``) if it has changed since it was read.
        """
        self._transport.request("DELETE", self.path, headers=self._condition(if_unchanged))

    def _condition(self, if_unchanged: bool) -> dict[str, str]:
        if not if_unchanged:
            return {}
        if self._etag is None:
            raise ValueError(f"{self} was read from a listing: call refresh() before a change with if_unchanged")
        return {"if-match": self._etag}

    def _act(self, action: str, params: Params | None = None, *, if_unchanged: bool = False) -> None:
        response = self._transport.request(
            "POST", f"{self.path}/{action}", params=params, headers=self._condition(if_unchanged)
        )
        self._take(document(response), response.headers.get("etag"))


def _time(text: str) -> datetime:
    # Python 3.10 does not read `Z`, nor a number of decimals other than three or six.
    whole, _, rest = text.removesuffix("Z").partition(".")
    return datetime.fromisoformat(f"{whole}.{rest[:6]:0<6}+00:00")
