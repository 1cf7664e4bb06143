"""Writes files so that each is there as a whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any
from uuid import uuid4

from . import _native
from ._requests import encoded
from ._transport import Params, Transport


@contextmanager
def replacing(path: str | PathLike[str]) -> Iterator[Path]:
    """Yields the path of a new file, which takes the place of `path` at the end of the ``with`` statement.

    Missing folders are created. After an exception the new file is removed, and `path` is as it was.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # In the same folder, because a rename is atomic within one file system only.
    part = path.with_name(f".{path.name}.{uuid4().hex}.part")
    try:
        yield part
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


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
    with replacing(path) as part, part.open("xb") as sink:
        transport.download(address, sink, params=params, timeout=timeout)
    return Path(path)


def write_companion(path: Path, type: str, options: Mapping[str, Any]) -> None:
    """Writes the script that opens an export beside it, where its program needs one."""
    companion = _native.companion(type, encoded(options), path.name)
    if companion is not None:
        ending, text = companion
        write(path.with_name(f"{path.name}.{ending}"), text.encode())


def refuse_existing(path: str | PathLike[str], overwrite: bool) -> None:
    """Raises a `FileExistsError` if there is such a file and it is not to be replaced."""
    if not overwrite and Path(path).exists():
        raise FileExistsError(f"{path} exists: choose another name, or pass overwrite=True")


def write(path: str | PathLike[str], content: bytes) -> Path:
    """Writes a file and returns its path. Missing folders are created."""
    with replacing(path) as part:
        part.write_bytes(content)
    return Path(path)
