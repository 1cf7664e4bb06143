"""Tables of studies: names and values of their columns, and names of files by run."""

from __future__ import annotations

import re
import string
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _columns
from ._columns import Labels

if TYPE_CHECKING:
    import pandas as pd


def of_points(
    columns: list[str],
    rows: list[dict[str, Any]],
    labels: Labels | None,
    names: Mapping[str, str] | None,
    of_runs: Sequence[str],
) -> pd.DataFrame:
    """Returns the table with one row per point, whose columns have short names and values that can be grouped."""
    import pandas as pd

    named, by_name = values(columns, rows, labels, names, of_runs)
    figures = [name for name in (rows[0] if rows else {}) if name not in columns]
    frame = pd.DataFrame({**by_name, **{name: [row.get(name) for row in rows] for name in figures}})
    frame.attrs["pointers"] = named
    return frame


def paths(
    directory: Path, rows: list[dict[str, Any]], columns: list[str], pattern: str | None, format: str
) -> list[Path]:
    """Returns the path of each run.

    `pattern` has the columns of the run as fields; the default has those of its point, and the seed.

    Raises a `ValueError` if two runs have the same path.
    """
    if pattern is None:
        pattern = "-".join(f"{{{field}}}" for field in [*(columns or ["point"]), "seed"])
    found = [directory / f"{_file_name(pattern, row)}.{format}" for row in rows]
    _check_distinct(found, rows, pattern)
    return found


def values(
    columns: list[str],
    rows: list[dict[str, Any]],
    labels: Labels | None,
    names: Mapping[str, str] | None,
    of_runs: Sequence[str],
) -> tuple[dict[str, str], dict[str, list[Any]]]:
    """The name of each column by its pointer, and the labelled values of the points by the name.

    `of_runs` are the columns that a table of runs has beside them.
    """
    figures = [name for name in (rows[0] if rows else {}) if name not in columns]
    # A list of jobs has the columns `point` and `name`, which a run has, too.
    taken = [*figures, *(name for name in of_runs if name not in columns)]
    named = _columns.names(columns, taken)
    for key, name in (names or {}).items():
        named[_columns.pointer(key, named)] = name
    by_pointer = {_columns.pointer(key, named): given for key, given in (labels or {}).items()}
    values = {
        named[column]: _columns.labelled([row[column] for row in rows], by_pointer.get(column)) for column in columns
    }
    return named, values


def _file_name(pattern: str, row: dict[str, Any]) -> str:
    try:
        return _FileNames().vformat(pattern, (), row)
    except (KeyError, IndexError) as error:
        raise ValueError(f"the pattern {pattern!r} names {error}: must be one of {', '.join(row)}") from None


class _FileNames(string.Formatter):
    """Formats a pattern so that each value is safe as a part of a file name."""

    def format_field(self, value: Any, format_spec: str) -> str:
        return re.sub(r"[^\w.+=,-]+", "_", format(value, format_spec)).strip("_.") or "_"


def _check_distinct(paths: list[Path], rows: list[dict[str, Any]], pattern: str) -> None:
    seen: dict[Path, dict[str, Any]] = {}
    for path, row in zip(paths, rows, strict=True):
        if path in seen:
            raise ValueError(
                f"{_run(seen[path])} and {_run(row)} are both named {path.name}: add a field such as {{seed}} or "
                f"{{replicate}} to the pattern {pattern!r}"
            )
        seen[path] = row


def _run(row: dict[str, Any]) -> str:
    """What a message calls a run."""
    return f"job {row['id']}" if "id" in row else f"replicate {row['replicate']} of point {row['point']}"
