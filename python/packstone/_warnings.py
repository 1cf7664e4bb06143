"""Warns about doubtful requests and results at the line of the caller."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterable, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeVar

from .errors import PackstoneWarning

T = TypeVar("T")

PACKAGE = str(Path(__file__).parent)
_collected: ContextVar[list[str] | None] = ContextVar("packstone_warnings", default=None)


def texts(document: Mapping[str, Any]) -> list[str]:
    """Returns the warnings that a document of the engine contains, each as one sentence."""
    found = document.get("warnings") or []
    return [str(item.get("detail", item)) if isinstance(item, Mapping) else str(item) for item in found]


def text_of_points(detail: str, points: int, point: int, count: int) -> str:
    """Returns a warning about `points` of the `count` points of a study, of which `point` is the first."""
    if count == 1:
        return detail
    if points == 1:
        return f"{detail} (point {point})"
    return f"{detail} ({'all ' if points == count else f'{points} of '}{count} points)"


def warn(messages: Iterable[str]) -> None:
    """Issues each message as a :class:`PackstoneWarning` of the first caller outside of this package."""
    collected = _collected.get()
    if collected is not None:
        collected.extend(messages)
        return
    level, frame = 1, sys._getframe()
    while frame.f_code.co_filename.startswith(PACKAGE) and frame.f_back is not None:
        level, frame = level + 1, frame.f_back
    for message in messages:
        warnings.warn(message, PackstoneWarning, stacklevel=level)


def collecting(call: Callable[[], T]) -> tuple[T, list[str]]:
    """Returns what `call` returns, and the messages that it would have issued.

    A call in a thread of its own has no caller: the thread that waits for it issues the messages.
    """
    messages: list[str] = []
    token = _collected.set(messages)
    try:
        return call(), messages
    finally:
        _collected.reset(token)
