"""The exceptions and the warning of this package.

A server refuses a request with a problem document (RFC 9457), a job that failed keeps one, and the engine in this
process refuses with the same. Each becomes a :class:`PackstoneError`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Fault:
    """One fault of a request, with its place in the body, the query or the header."""

    detail: str
    """The value that was found, and the bound that it breaks."""
    pointer: str | None = None
    """JSON pointer (RFC 6901) into the body; empty for the body itself."""
    parameter: str | None = None
    """Name of the query parameter."""
    header: str | None = None
    """Name of the header field."""

    @property
    def place(self) -> str:
        """The place for a message."""
        if self.pointer == "":
            return "the body"
        return self.pointer or self.parameter or self.header or "the request"

    def __str__(self) -> str:
        return f"{self.place}: {self.detail}"


class PackstoneWarning(UserWarning):
    """A request was accepted, but its result may not be what the user expects."""


class PackstoneError(Exception):
    """A refused request, or the failure of a packing, a job or an export."""

    problem: Mapping[str, Any]
    """The problem document; empty if there is none. Some kinds have additional members."""

    def __init__(self, message: str, problem: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.problem = dict(problem or {})

    @property
    def kind(self) -> str | None:
        """The kind of the problem, as ``validation-error``. The server explains each at ``/problems/{kind}``."""
        uri = self.problem.get("type")
        return uri.rsplit("/", 1)[-1] if isinstance(uri, str) else None

    @property
    def status(self) -> int | None:
        """The HTTP status of the problem."""
        status = self.problem.get("status")
        return status if isinstance(status, int) else None

    @property
    def detail(self) -> str:
        """What went wrong, in one sentence."""
        return str(self.problem.get("detail", self))

    @property
    def errors(self) -> list[Fault]:
        """All faults of the request, each with its place."""
        known = ("detail", "pointer", "parameter", "header")
        faults = self.problem.get("errors", [])
        return [Fault(**{name: fault[name] for name in known if name in fault}) for fault in faults]


class ConnectionFailed(PackstoneError):
    """The server did not answer, although the request was repeated."""


class WaitTimeout(PackstoneError, TimeoutError):
    """A wait reached its time limit. The job, study or export goes on."""


class JobCancelled(PackstoneError):
    """The job was cancelled and has no result."""


class TargetNotReached(PackstoneError):
    """The method stopped before all grains had their position, size and distance (``target-not-reached``).

    This says something about the mix; it is not a fault of the request. ``problem`` has the figures reached.
    """

    @property
    def volume_fraction_asked(self) -> float | None:
        """The target: volume of all grains over that of the specimen."""
        return _number(self.problem.get("volume_fraction_asked"))

    @property
    def volume_fraction_reached(self) -> float | None:
        """The volume fraction at the end of the run."""
        return _number(self.problem.get("volume_fraction_reached"))

    @property
    def distance_mm_asked(self) -> float | None:
        """The target of the constant distance, in mm, if the grains were grown."""
        return _number(self.problem.get("distance_mm_asked"))

    @property
    def distance_mm_reached(self) -> float | None:
        """The constant distance at the end of the run, in mm, if the grains were grown."""
        return _number(self.problem.get("distance_mm_reached"))


def error_of(problem: Mapping[str, Any]) -> PackstoneError:
    """Returns the exception for a problem document."""
    message = _message(problem)
    error = PackstoneError(message, problem)
    return TargetNotReached(message, problem) if error.kind == "target-not-reached" else error


def _message(problem: Mapping[str, Any]) -> str:
    """Returns the title and all faults as text."""
    title = str(problem.get("title", "Problem"))
    faults = PackstoneError("", problem).errors
    if len(faults) > 1:
        return "\n  ".join([f"{title}:", *map(str, faults)])
    return f"{title}: {problem.get('detail', 'no detail')}"


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, (int, float)) else None
