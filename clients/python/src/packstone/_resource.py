"""What jobs, studies and models have in common: an address, a document as last seen, and a way to wait for more.

Waiting is long-polling: the server holds an answer back until there is news. It must never be a poll in a
loop.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from datetime import datetime
from time import monotonic, sleep
from typing import Any, TypeVar

from ._transport import Params, Transport, document
from .errors import WaitTimeout

R = TypeVar("R", bound="Changing")

# Longest that the server holds an answer back.
LONGEST_POLL_S = 60
# Least time between two questions, for a study of quick jobs has news all the time.
NEWS_EVERY_S = 0.25
# A server that is about to stop answers at once, and so does a proxy that drops `Prefer`: then this long a
# pause keeps the loop from spinning.
PAUSE_S = 1.0


class Changing(ABC):
    """Something of the server's that changes until it ends, as last seen."""

    def __init__(self, transport: Transport, data: dict[str, Any], etag: str | None = None) -> None:
        self._transport = transport
        self._etag = etag
        self.data = data
        """The document as the server sent it last."""

    @property
    def id(self) -> str:
        """Its name on the server."""
        return str(self.data["id"])

    @property
    def created_at(self) -> datetime:
        """When the server took it in."""
        return _time(self.data["created_at"])

    @property
    def finished_at(self) -> datetime | None:
        """When it ended."""
        at = self.data["finished_at"]
        return None if at is None else _time(at)

    @property
    def progress(self) -> dict[str, Any]:
        """How far it is, in the server's words; empty before it starts."""
        return dict(self.data["progress"] or {})

    @property
    @abstractmethod
    def finished(self) -> bool:
        """Whether it has ended, as last seen."""

    @property
    def path(self) -> str:
        """Where it is on the server."""
        return str(self.data["links"]["self"])

    def refresh(self: R) -> R:
        """Asks the server how it is now."""
        response = self._transport.request("GET", self.path)
        self._take(document(response), response.headers.get("etag"))
        return self

    def wait(self: R, timeout: float | None = None, progress: Callable[[R], object] | None = None) -> R:
        """Waits for the end, of whichever kind, and returns this.

        `progress` is called with this at first and whenever there is news: ``progress=print`` shows them.
        Past `timeout` in s (to about a second, or longer while the server gives no answer) it raises
        :class:`WaitTimeout`; what was waited for goes on.
        """
        until = None if timeout is None else monotonic() + timeout
        if progress is not None:
            if self._etag is None and not self.finished:
                self.refresh()
            progress(self)
        while not self.finished:
            left_s = None if until is None else until - monotonic()
            if left_s is not None and left_s <= 0:
                raise WaitTimeout(f"{self} has not ended within {timeout:g} s")
            poll_s = LONGEST_POLL_S if left_s is None else max(1, min(LONGEST_POLL_S, int(left_s)))
            asked_at = monotonic()
            news = self._poll(poll_s, until_end=progress is None)
            if news and progress is not None:
                progress(self)
            if self.finished:
                break
            took_s = monotonic() - asked_at
            if news:
                sleep(max(0.0, NEWS_EVERY_S - took_s))
            elif took_s < min(PAUSE_S, poll_s / 2):
                sleep(PAUSE_S)
        return self

    def _poll(self, wait_s: int, *, until_end: bool) -> bool:
        """Asks how it is, of which the answer may take `wait_s`; whether that was news.

        News is the end, or anything that differs from what was last seen if not `until_end`.
        """
        headers = {}
        if not until_end and self._etag is not None:
            headers["if-none-match"] = self._etag
        response = self._transport.request("GET", self.path, headers=headers, wait_s=wait_s)
        if response.status_code == 304:
            return False
        self._take(document(response), response.headers.get("etag"))
        return not until_end or self.finished

    def delete(self) -> None:
        """Removes it from the server with all that came of it; it must have ended."""
        self._transport.request("DELETE", self.path)

    def _act(self, action: str, params: Params | None = None) -> None:
        """Does something to it, and takes what has become of it."""
        response = self._transport.request("POST", f"{self.path}/{action}", params=params)
        self._take(document(response), response.headers.get("etag"))

    def _take(self, data: dict[str, Any], etag: str | None) -> None:
        self.data, self._etag = data, etag


class Resource(Changing):
    """Something that was submitted, as last seen."""

    @property
    def name(self) -> str | None:
        """Its name for people."""
        name = self.data["name"]
        return None if name is None else str(name)

    @property
    def labels(self) -> dict[str, str]:
        """Keys and values to find it by."""
        return dict(self.data["labels"])

    @property
    def seed(self) -> int:
        """What its randomness derives from."""
        return int(self.data["seed"])

    @property
    def request(self) -> dict[str, Any]:
        """What was asked for, with what the server has filled in."""
        if "request" not in self.data:
            # Listings leave it out.
            self.refresh()
        return dict(self.data["request"])


def _time(text: str) -> datetime:
    # Before Python 3.11 the letter is not understood, and no other number of digits than three or six.
    whole, _, rest = text.removesuffix("Z").partition(".")
    return datetime.fromisoformat(f"{whole}.{rest[:6]:0<6}+00:00")
