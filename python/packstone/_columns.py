"""Names and labels for the columns of study tables.

The server names a column by the JSON pointer of a field, as ``/mix/volume_fraction``, and its values may be
objects. Tables of pandas need names that are identifiers, and values that can be grouped.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

Labels = Mapping[str, Mapping[Any, Any] | Sequence[Any] | Callable[[Any], Any]]


def names(columns: Sequence[str], taken: Collection[str]) -> dict[str, str]:
    """Returns an identifier for each column.

    It is the last part of the pointer, as ``volume_fraction``; the field itself for a tag, as ``method`` for
    ``/method/type``; and the whole pointer with underscores if the short name occurs more than once or is
    `taken`.
    """
    short = {column: _short(column) for column in columns}
    shorts = list(short.values())
    return {
        column: name if shorts.count(name) == 1 and name not in taken else _identifier("_".join(_parts(column)))
        for column, name in short.items()
    }


def label(value: Any) -> Any:
    """Returns a value that can be hashed: text for an object or a list, any other value as it is."""
    if isinstance(value, Mapping):
        return _object(value)
    if isinstance(value, (list, tuple)):
        return ", ".join(str(label(item)) for item in value)
    return value


def labelled(
    values: Sequence[Any], labels: Mapping[Any, Any] | Sequence[Any] | Callable[[Any], Any] | None
) -> list[Any]:
    """Returns the label of each value.

    `labels` is a function of the value; a mapping from the automatic label to a better one; or a sequence,
    one label for each distinct value in the order of the first appearance.
    """
    plain = [label(value) for value in values]
    if labels is None:
        return plain
    if callable(labels):
        return [labels(value) for value in values]
    if isinstance(labels, Mapping):
        return [labels.get(text, text) for text in plain]
    distinct = list(dict.fromkeys(plain))
    if len(labels) != len(distinct):
        raise ValueError(f"{len(labels)} labels for {len(distinct)} values: {', '.join(map(str, distinct))}")
    better = dict(zip(distinct, labels, strict=True))
    return [better[text] for text in plain]


def pointer(key: str, given: Mapping[str, str]) -> str:
    """Returns the column that a pointer or a short name means."""
    if key in given:
        return key
    for column, name in given.items():
        if name == key:
            return column
    known = ", ".join(f"{column} ({name})" for column, name in given.items())
    raise ValueError(f"{key!r} is not a column of the study: must be one of {known}")


def _object(value: Mapping[str, Any]) -> str:
    """The distinguishing part of a tagged object, as ``A16`` or ``edmd growth_rate=0.1``."""
    if not value:
        return "{}"
    rest = dict(value)
    kind = rest.pop("type", None)
    if kind == "standard" and set(rest) == {"name"}:
        return str(rest["name"])
    words = [] if kind is None else [str(kind)]
    words += [f"{name}={_text(item)}" for name, item in rest.items()]
    return " ".join(words)


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))


def _parts(column: str) -> list[str]:
    parts = [part.replace("~1", "/").replace("~0", "~") for part in column.split("/") if part]
    return parts or [column or "value"]


def _short(column: str) -> str:
    parts = _parts(column)
    if len(parts) > 1 and parts[-1] == "type":
        return _identifier(parts[-2])
    if len(parts) > 1 and parts[-1].isdecimal():
        return _identifier("_".join(parts[-2:]))
    return _identifier(parts[-1])


def _identifier(text: str) -> str:
    name = re.sub(r"\W", "_", text)
    return f"_{name}" if name[:1].isdecimal() else name
