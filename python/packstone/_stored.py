"""The form in which a packing is stored, made of a result as JSON, so that the engine can take the packing up again.

``engine/src/export/tables/stored.rs`` defines the form: a magic, the lengths of head and columns, the head as JSON, the
columns as 64-bit floats, and a CRC-32 of all.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Mapping
from typing import Any

MAGIC = b"PACKSTN3"
ALIGNMENT = 64


def is_stored(head: bytes) -> bool:
    """Whether a file that begins so is a stored packing."""
    return head.startswith(MAGIC)


def is_result(document: object) -> bool:
    """Whether a document of JSON is the result of a job, with its grains."""
    return isinstance(document, Mapping) and {"request", "engine", "summary", "grains"} <= document.keys()


def stored(result: Mapping[str, Any]) -> bytes:
    """Returns the stored form of a result: the same numbers to the last bit."""
    import numpy as np

    columns, rows = result["grains"]["columns"], result["grains"]["rows"]
    grains = np.array(rows, dtype="<f8").reshape(len(rows), len(columns))
    named: dict[str, Any] = {"columns": columns}
    if "templates" in result:
        named["templates"] = result["templates"]
    named["head"] = {name: value for name, value in result.items() if name not in ("grains", "templates")}
    head = json.dumps(named, allow_nan=False, separators=(",", ":")).encode()
    # Magic and two lengths come before the head.
    head += b" " * (-(24 + len(head)) % ALIGNMENT)
    content = MAGIC + struct.pack("<QQ", len(head), len(rows)) + head + grains.tobytes("F")
    return content + struct.pack("<I", zlib.crc32(content))
