"""Shows the progress of a wait: a bar of tqdm if it is installed, else one line on standard error."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import Protocol


class Bar(Protocol):
    """A display of the progress."""

    def show(self, fraction: float, note: str) -> None:
        """Shows a fraction between 0 and 1 with a note beside it."""

    def close(self) -> None:
        """Ends the display and leaves its last state."""


class Progress:
    """A display that a `with` statement opens and closes."""

    def __init__(self, title: str) -> None:
        self._bar = _bar(title)

    def show(self, fraction: float, note: str) -> None:
        """Shows a fraction between 0 and 1 with a note beside it."""
        self._bar.show(min(max(fraction, 0.0), 1.0), note)

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.close()


def note(state: str, eta_s: float | None) -> str:
    """Returns the words beside a bar: the state, and the remaining time if it is known."""
    return state if eta_s is None else f"{state}, about {duration(eta_s)} left"


def duration(seconds: float) -> str:
    """Writes a duration for people, as ``45 s`` or ``3 min 20 s``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def _bar(title: str) -> Bar:
    try:
        return _TqdmBar(title)
    except ImportError:
        return _Line(title)


class _TqdmBar:
    """A bar of tqdm, in notebooks too. The remaining time is the server's estimate, not that of tqdm."""

    def __init__(self, title: str) -> None:
        from tqdm.auto import tqdm

        self._tqdm = tqdm(total=100.0, desc=title, bar_format="{desc}: {percentage:3.0f}%|{bar}| {elapsed}{postfix}")

    def show(self, fraction: float, note: str) -> None:
        self._tqdm.set_postfix_str(note, refresh=False)
        self._tqdm.n = 100 * fraction
        self._tqdm.refresh()

    def close(self) -> None:
        self._tqdm.close()


class _Line:
    """One line on standard error, which a terminal shows updated, and a line for each state elsewhere."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._last = ""

    def show(self, fraction: float, note: str) -> None:
        text = f"{self._title}: {fraction:4.0%} {note}".rstrip()
        if text == self._last:
            return
        if sys.stderr.isatty():
            sys.stderr.write("\r" + text.ljust(len(self._last)))
        else:
            sys.stderr.write(text + "\n")
        sys.stderr.flush()
        self._last = text

    def close(self) -> None:
        if self._last and sys.stderr.isatty():
            sys.stderr.write("\n")
            sys.stderr.flush()
