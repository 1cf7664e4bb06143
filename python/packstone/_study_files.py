"""The folder of a study: its request, a line for each run that has ended, and packings.

``server/src/cli/study/run_log.rs`` and ``summed_lines.rs`` define the form.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _files
from ._requests import encoded

if TYPE_CHECKING:
    from .packings import Packing

# The members of a record that the table counts; the others are the place and the proof of a run.
COUNTED = ("outcome", "facts", "distance_curve", "error")
SUM = '{"crc32":"'


def read(directory: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Returns the request of a study, and the record of each run that has ended, with its point and replicate."""
    try:
        request = dict(json.loads((directory / "study.json").read_bytes())["request"])
        text = (directory / "runs.jsonl").read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise ValueError(f"{directory} holds no study: {error.filename} is missing") from None
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{directory / 'study.json'} is damaged: {error!r}") from None
    lines = text.split("\n")
    # A command that was killed may have left the start of a line.
    whole, _ = lines[:-1], lines[-1]
    found: dict[tuple[int, int], dict[str, Any]] = {}
    for number, line in enumerate(whole, start=1):
        if not line.startswith(SUM) or f"{zlib.crc32(line[20:].encode()):08x}" != line[10:18]:
            raise ValueError(f"{directory / 'runs.jsonl'} is damaged: the checksum of line {number} is wrong")
        record = json.loads(line)
        place = {"point": int(record["point"]), "replicate": int(record["replicate"])}
        counted = {name: record[name] for name in COUNTED if name in record}
        # The last line of a run counts, as where a folder was gone on with.
        found[place["point"], place["replicate"]] = {**place, **counted}
    return request, list(found.values())


def packings(directory: Path) -> dict[tuple[int, int], Packing]:
    """Returns the packings of a study by point and replicate."""
    from .loading import packings_in

    found: dict[tuple[int, int], Packing] = {}
    results = directory / "results"
    for name, packing in packings_in(results).items() if results.is_dir() else ():
        point, _, replicate = name.partition("-")
        if point.isdecimal() and replicate.isdecimal():
            found[int(point), int(replicate)] = packing
    return found


def write(
    directory: Path,
    engine: Mapping[str, Any],
    request: Mapping[str, Any],
    records: Sequence[Mapping[str, Any]],
    *,
    overwrite: bool,
) -> None:
    """Writes request and records; the folder must not hold a study unless `overwrite`."""
    if not overwrite and (directory / "study.json").exists():
        raise FileExistsError(f"{directory} holds a study: choose another folder, or pass overwrite=True")
    _files.write(directory / "study.json", encoded({"engine": engine, "request": request}).encode())
    _files.write(directory / "runs.jsonl", "".join(map(_line, records)).encode())


def _line(record: Mapping[str, Any]) -> str:
    members = json.dumps(record, separators=(",", ":"), ensure_ascii=False)[1:]
    return f'{SUM}{zlib.crc32(members.encode()):08x}",{members}\n'
