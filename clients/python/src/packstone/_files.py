"""Writes files that are downloaded from the server."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from uuid import uuid4

from ._transport import Params, Transport


def save(
    transport: Transport,
    address: str,
    path: str | PathLike[str],
    params: Params | None = None,
    timeout: float | None = None,
) -> Path:
    """Downloads a file and returns its path.

    Missing folders are created. A file of the same name is replaced when the download is complete.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # In the same folder, because a rename is atomic within one file system only.
    part = path.with_name(f".{path.name}.{uuid4().hex}.part")
    try:
        with part.open("xb") as sink:
            transport.download(address, sink, params=params, timeout=timeout)
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return path


def write(path: str | PathLike[str], content: bytes) -> Path:
    """Writes a file and returns its path. Missing folders are created."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path
