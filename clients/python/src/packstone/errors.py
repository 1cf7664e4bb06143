"""What can go wrong, as exceptions.

A server refuses with a problem document (RFC 9457), and a job that failed keeps one: both become a
:class:`PackstoneError`. Nothing here knows HTTP.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Fault:
    """One fault of a request, at its place: in the body, in the query or among the header fields."""

    detail: str
    """What is wrong: the value found and the bound it breaks."""
    pointer: str | None = None
    """RFC 6901 pointer into the body; empty for the body itself."""
    parameter: str | None = None
    """Name of the query parameter."""
    header: str | None = None
    """Name of the header field."""

    @property
    def place(self) -> str:
        """Where it is, in words."""
        if self.pointer == "":
            return "the body"
        return self.pointer or self.parameter or self.header or "the request"

    def __str__(self) -> str:
        return f"{self.place}: {self.detail}"


class PackstoneError(Exception):
    """Something that Packstone refused, or that became of a job."""

    problem: Mapping[str, Any]
    """The problem document; empty where there is none. Some kinds have members of their own."""

    def __init__(self, message: str, problem: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.problem = dict(problem or {})

    @property
    def kind(self) -> str | None:
        """Which kind of problem, as ``validation-error`` or ``infeasible-mix``; the server explains each."""
        uri = self.problem.get("type")
        return uri.rsplit("/", 1)[-1] if isinstance(uri, str) else None

    @property
    def status(self) -> int | None:
        """HTTP status of the problem."""
        status = self.problem.get("status")
        return status if isinstance(status, int) else None

    @property
    def detail(self) -> str:
        """This occurrence in one sentence."""
        return str(self.problem.get("detail", self))

    @property
    def errors(self) -> list[Fault]:
        """Every fault of the request, each at its place."""
        known = ("detail", "pointer", "parameter", "header")
        faults = self.problem.get("errors", [])
        return [Fault(**{name: fault[name] for name in known if name in fault}) for fault in faults]


class ConnectionFailed(PackstoneError):
    """No answer came from the server, however often it was asked."""


class WaitTimeout(PackstoneError, TimeoutError):
    """A wait was over before what it waited for. The job or study goes on."""


class JobCancelled(PackstoneError):
    """The job was cancelled: it has no result."""


class PackingNotReached(PackstoneError):
    """The method came to its end before all grains were placed, or had their size and distance.

    It is an answer about the mix rather than a fault. ``problem`` tells how far the packing came.
    """

    @property
    def volume_fraction_asked(self) -> float | None:
        """Volume fraction that all grains would have, as placed."""
        return _number(self.problem.get("volume_fraction_asked"))

    @property
    def volume_fraction_reached(self) -> float | None:
        """Volume fraction at the end of the run."""
        return _number(self.problem.get("volume_fraction_reached"))

    @property
    def distance_mm_asked(self) -> float | None:
        """Constant distance asked for, in mm, where the grains were grown."""
        return _number(self.problem.get("distance_mm_asked"))

    @property
    def distance_mm_reached(self) -> float | None:
        """Constant distance at the end of the run, in mm, where the grains were grown."""
        return _number(self.problem.get("distance_mm_reached"))


def error_of(problem: Mapping[str, Any]) -> PackstoneError:
    """The exception that a problem document stands for."""
    message = _message(problem)
    error = PackstoneError(message, problem)
    return PackingNotReached(message, problem) if error.kind == "target-not-reached" else error


def _message(problem: Mapping[str, Any]) -> str:
    """The document for a person: its title, and every fault rather than the first of them."""
    title = str(problem.get("title", "Problem"))
    faults = PackstoneError("", problem).errors
    if len(faults) > 1:
        return "\n  ".join([f"{title}:", *map(str, faults)])
    return f"{title}: {problem.get('detail', 'no detail')}"


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, (int, float)) else None
