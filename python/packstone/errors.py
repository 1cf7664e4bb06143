"""The exceptions and the warning of this package.

A server refuses a request with a problem document (RFC 9457), a job that failed keeps one, and the engine in this
process refuses with the same. Each becomes a :class:`PackstoneError`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
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
        """The argument that is at fault, as ``mix.volume_fraction`` or ``specimen.size_mm[1]``."""
        if self.pointer == "":
            return "the request"
        if self.pointer is not None:
            return _argument(self.pointer)
        return self.parameter or self.header or "the request"

    def __str__(self) -> str:
        return f"{self.place}: {_nearest(self)}"


class PackstoneWarning(UserWarning):
    """A request was accepted, but its result may not be what the user expects."""


class PackstoneError(Exception):
    """A refused request, or the failure of a packing, a job or an export.

    Examples
    --------
    >>> try:
    ...     packstone.plan(specimen=(40, -1, 40), mix=packstone.Mix("A16", 0.5))
    ... except packstone.PackstoneError as error:
    ...     print(error.kind, [fault.place for fault in error.errors])
    validation-error ['specimen.size_mm[1]']
    """

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
        detail = self.problem.get("detail")
        return str(self) if detail is None else _in_arguments(str(detail), self.problem)

    @property
    def errors(self) -> list[Fault]:
        """All faults of the request, each with its place."""
        known = ("detail", "pointer", "parameter", "header")
        faults = self.problem.get("errors", [])
        return [Fault(**{name: fault[name] for name in known if name in fault}) for fault in faults]


class InvalidRequest(PackstoneError, ValueError):
    """An argument or a field of a request is refused; :attr:`errors` has the place and the bound of each fault.

    Examples
    --------
    >>> packstone.plan(specimen=40, mix=packstone.Mix("A16", 0.5, d_min_mm=-1))
    Traceback (most recent call last):
    packstone.errors.InvalidRequest: Invalid argument: mix.d_min_mm: -1 is out of range: ...
    """


class ConnectionFailed(PackstoneError):
    """The server did not answer, although the request was repeated."""


class WaitTimeout(PackstoneError, TimeoutError):
    """A wait reached its time limit. The job, study or export goes on."""


class JobCancelled(PackstoneError):
    """The job was cancelled and has no result."""


class TargetNotReached(PackstoneError):
    """The method stopped before all grains had their position, size and distance (``target-not-reached``).

    This says something about the mix; it is not a fault of the request. ``problem`` has the figures reached.

    Examples
    --------
    >>> mix = packstone.Mix(packstone.Grading.monodisperse(1), 0.5)
    >>> try:
    ...     packstone.pack(specimen=packstone.Box(12, boundary="periodic"), mix=mix, method="rsa", seed=1)
    ... except packstone.TargetNotReached as error:
    ...     print(round(error.volume_fraction_asked, 2), error.volume_fraction_reached < 0.4)
    0.5 True
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


# The kinds of problems that say that a request is wrong, not that the server or the run failed.
WRONG_REQUESTS = frozenset(
    {
        "malformed-json",
        "validation-error",
        "infeasible-mix",
        "coarse-mix",
        "too-large",
        "format-not-available",
        "payload-too-large",
        "idempotency-key-reused",
    }
)
UNKNOWN = re.compile(r"unknown (?:field|option): .* has ([\w, ]+)$")


def error_of(problem: Mapping[str, Any]) -> PackstoneError:
    """Returns the exception for a problem document."""
    message = _message(problem)
    kind = PackstoneError(message, problem).kind
    if kind == "target-not-reached":
        return TargetNotReached(message, problem)
    return InvalidRequest(message, problem) if kind in WRONG_REQUESTS else PackstoneError(message, problem)


def invalid(argument: str, detail: str) -> InvalidRequest:
    """Returns the exception for an argument that is refused before a request is made."""
    problem = {
        "type": "/problems/validation-error",
        "title": "Invalid field",
        "detail": f"{argument}: {detail}",
        "errors": [{"parameter": argument, "detail": detail}],
    }
    return InvalidRequest(_message(problem), problem)


def near(name: str, known: Iterable[str]) -> str:
    """A question that ends a message, if a known name is near to a name."""
    import difflib

    found = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {found[0]}?" if found else ""


def _message(problem: Mapping[str, Any]) -> str:
    """Returns the title and all faults as text."""
    title = str(problem.get("title", "Problem"))
    title = "Invalid argument" if title == "Invalid field" else title
    faults = PackstoneError("", problem).errors
    if len(faults) > 1:
        return "\n  ".join([f"{title}:", *map(str, faults)])
    if faults:
        return f"{title}: {faults[0]}"
    return f"{title}: {problem.get('detail', 'no detail')}"


def _in_arguments(detail: str, problem: Mapping[str, Any]) -> str:
    """The detail of a problem, in which the places of its faults are arguments."""
    for fault in PackstoneError("", problem).errors:
        if fault.pointer:
            detail = detail.replace(fault.pointer, fault.place, 1)
    return detail


def _argument(pointer: str) -> str:
    """A JSON pointer as Python writes the place: ``mix.aggregates[0].share``, ``grid["/mix/volume_fraction"][1]``."""
    place = ""
    for part in pointer.split("/")[1:]:
        name = part.replace("~1", "/").replace("~0", "~")
        if name.isdecimal():
            place += f"[{name}]"
        elif name.isidentifier():
            place += f".{name}"
        else:
            place += f'["{name}"]'
    return place.removeprefix(".")


def _nearest(fault: Fault) -> str:
    """The detail of a fault; of an unknown name with the known name that is near to it."""
    found = UNKNOWN.search(fault.detail)
    if found is None:
        return fault.detail
    name = (fault.pointer or fault.parameter or "").rsplit("/", 1)[-1]
    return fault.detail + near(name, found[1].split(", "))


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, (int, float)) else None
