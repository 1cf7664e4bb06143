"""Files that come from the server."""

from __future__ import annotations

from pathlib import Path
from uuid import uuid4

from ._transport import Params, Transport


def save(transport: Transport, address: str, path: Path, params: Params | None = None) -> Path:
    """Writes what is at an address to a file, which is replaced once the new one is whole; returns its path."""
    # Beside it, since only within one file system a file takes another's place at once.
    part = path.with_name(f".{path.name}.{uuid4().hex}.part")
    try:
        with part.open("xb") as sink:
            transport.download(address, sink, params=params)
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return path
