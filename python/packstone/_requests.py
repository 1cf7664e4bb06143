"""Writes requests and options as JSON, for the service and for the native module alike."""

from __future__ import annotations

import json
import numbers
import sys
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .builders import JobFields


def job_body(job: Mapping[str, Any] | None, fields: JobFields) -> dict[str, Any]:
    """Returns the request of a job. A field that is given by name replaces that of the mapping."""
    return whole({**(job or {}), **fields})


def study_body(study: Mapping[str, Any] | None, **fields: Any) -> dict[str, Any]:
    """Returns the request of a study. A field that is given by name and is not `None` replaces that of the mapping."""
    body = {**(study or {}), **{field: value for field, value in fields.items() if value is not None}}
    if isinstance(body.get("template"), Mapping):
        body["template"] = whole(body["template"])
    if isinstance(body.get("list"), Sequence):
        body["list"] = [whole(job) if isinstance(job, Mapping) else job for job in body["list"]]
    for axes in ("grid", "zip"):
        if isinstance(body.get(axes), Mapping):
            body[axes] = {pointer: _axis(pointer, values) for pointer, values in body[axes].items()}
    return body


def whole(job: Mapping[str, Any]) -> dict[str, Any]:
    """A job in which short forms of fields are written out: ``method="rsa"``, ``distance=0.5``."""
    return {name: _field(name, value) for name, value in job.items()}


def _field(name: str, value: Any) -> Any:
    if name in ("method", "distance", "segregation") and isinstance(value, str):
        return {"type": value}
    if name == "distance" and _is_number(value):
        return {"type": "constant", "gap_mm": value}
    if name == "specimen" and _is_number(value):
        return {"type": "box", "size_mm": [value] * 3}
    if name == "specimen" and not isinstance(value, (Mapping, str)) and hasattr(value, "__len__"):
        return {"type": "box", "size_mm": list(value)}
    return value


def _axis(pointer: str, values: Any) -> Any:
    name = pointer.removeprefix("/")
    if isinstance(values, Sequence) and not isinstance(values, str) and name in ("method", "distance", "specimen"):
        return [_field(name, value) for value in values]
    return values


def _is_number(value: Any) -> bool:
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def encoded(value: object) -> str:
    """Writes a value as JSON. NumPy's numbers and arrays become numbers and lists, times those of RFC 3339."""
    return json.dumps(value, allow_nan=False, default=_plain)


def rfc3339(at: datetime | str | None) -> str | None:
    """Writes a time in RFC 3339. A time without a zone is local."""
    return at.astimezone().isoformat() if isinstance(at, datetime) else at


def named(options: Mapping[str, Any]) -> dict[str, Any]:
    """Returns options under their names, where an underscore follows a word of Python: ``for_`` is the option `for`."""
    return {name.removesuffix("_"): value for name, value in options.items()}


def parameters(options: Mapping[str, Any]) -> dict[str, Any]:
    """Returns options of an export as parameters of a query: objects and lists as JSON."""
    nested = (Mapping, list, tuple)
    options = named(options)
    return {name: encoded(value) if isinstance(value, nested) else value for name, value in options.items()}


def _plain(value: Any) -> object:
    # A value of NumPy exists only where NumPy has been imported.
    numpy = sys.modules.get("numpy")
    if numpy is not None and isinstance(value, (numpy.ndarray, numpy.generic)):
        return value.tolist()
    if isinstance(value, datetime):
        return rfc3339(value)
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, Sequence):
        return list(value)
    raise TypeError(f"{type(value).__name__} {value!r} cannot be written as JSON")
