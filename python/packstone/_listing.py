"""Reads listings page by page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ._transport import Params, Transport, document

# The most that the server puts on one page.
ITEMS_PER_PAGE = 500


def pages(transport: Transport, path: str, params: Params, limit: int = ITEMS_PER_PAGE) -> Iterator[dict[str, Any]]:
    """Yields the items of all pages. A page is fetched when its first item is needed."""
    cursor = None
    while True:
        page = document(transport.request("GET", path, params={**params, "limit": limit, "cursor": cursor}))
        yield from page["items"]
        cursor = page.get("next_cursor")
        if cursor is None:
            return
