"""Raises what the native module refuses as the exceptions of this package."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager

from . import _native
from .errors import error_of


@contextmanager
def refusals() -> Iterator[None]:
    """Raises what the native module refuses as the exceptions of this package."""
    try:
        yield
    except _native.Refused as refused:
        raise error_of(json.loads(refused.args[0])) from None
