"""Listings that come in pages."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ._transport import Params, Transport, document

# As many as the server puts on one.
ITEMS_PER_PAGE = 500


def pages(transport: Transport, path: str, params: Params, limit: int = ITEMS_PER_PAGE) -> Iterator[dict[str, Any]]:
    """The items of all pages; the next page is fetched when its first item is asked for."""
    cursor = None
    while True:
        page = document(transport.request("GET", path, params={**params, "limit": limit, "cursor": cursor}))
        yield from page["items"]
        cursor = page["next_cursor"]
        if cursor is None:
            return
