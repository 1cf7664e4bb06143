"""The types of documents and options, against ``openapi.yaml``, and what a type checker says of them."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, get_args, get_type_hints

import mixes
import pytest
import typed_documents
import yaml
from live_server import REPOSITORY
from packstone.options import OPTIONS, FileOptions, ExportType

import packstone
from packstone import options as of_exports


def test_the_types_of_documents_are_those_of_the_contract() -> None:
    for path, text in typed_documents.modules():
        assert path.read_text() == text, f"run python {Path(typed_documents.__file__).name}"


def schemas() -> dict[str, Any]:
    contract: dict[str, Any] = yaml.safe_load((REPOSITORY / "openapi.yaml").read_text())
    return dict(contract["components"]["schemas"])


def options_of(type: ExportType) -> dict[str, set[str]]:
    """The options of an export, with the words that each takes if it takes words."""
    known = schemas()
    found: dict[str, set[str]] = {}
    for request in known["ExportRequest"]["oneOf"]:
        parts = list(typed_documents.parts(known, request))
        fields = {name: field for part in parts for name, field in part.get("properties", {}).items()}
        if fields["type"]["enum"] == [type]:
            for name, field in fields.items():
                text = typed_documents.of(known, field)
                words = set(re.findall(r'"(\w+)"', text)) if "Literal" in text else set()
                found[name] = found.get(name, set()) | words
    return found


@pytest.mark.parametrize("type", OPTIONS)
def test_the_options_of_exports_are_those_of_the_contract(type: ExportType) -> None:
    wanted = options_of(type)
    formats = wanted.pop("format")
    del wanted["type"]
    typed = {name.removesuffix("_"): option for name, option in get_type_hints(OPTIONS[type]).items()}
    assert typed.keys() == wanted.keys()
    for name, words in wanted.items():
        if words and name != "axis":
            assert set(get_args(typed[name])) == words, name
    names = {"mesh": "Mesh", "voxels": "Voxel", "slice": "Slice", "deck": "Deck", "ldpm": "Ldpm", "shapes": "Shape"}
    names |= {"certificates": "Certificate", "quality": "Quality", "properties": "Property"}
    assert set(getattr(of_exports, f"{names[type]}Format").__args__) == formats


def test_the_options_of_files_are_those_of_their_exports() -> None:
    wanted = {name for type in ("mesh", "voxels", "slice") for name in OPTIONS[type].__annotations__}
    assert set(FileOptions.__annotations__) == wanted


def test_an_unknown_option_names_its_neighbour(client: packstone.Client, tmp_path: Path) -> None:
    packing, job = packstone.pack(mixes.quick()), client.submit(mixes.quick()).wait()
    unknown: Any = {"segmets": 8}
    calls: list[Any] = [
        lambda: packing.export("mesh", tmp_path / "a.msh", **unknown),
        lambda: packing.save(tmp_path / "a.msh", **unknown),
        lambda: packing.read("msh", **unknown),
        lambda: packing.to_meshio(**unknown),
        lambda: job.export("mesh", **unknown),
        lambda: job.result().save(tmp_path / "a.msh", **unknown),
    ]
    for call in calls:
        with pytest.raises(ValueError, match=r"segmets: unknown .*; did you mean segments\?"):
            call()
    assert list(tmp_path.iterdir()) == []


CHECKED = """
import packstone

packing = packstone.pack(specimen=40, mix=packstone.Mix("A16", 0.3))
triangles: int = packing.export("mesh", "a.msh", segments=8).get("triangles", 0)
cells: list[int] = packing.export("voxels", "a.vti", cells=10)["shape"]
fraction: float = packing.summary["volume_fraction_effective"]
packing.export("mesh", "a.msh", segmets=8)
packing.export("voxels", "a.vti", format="stl")
packing.save("a.msh", segmets=8)
packing.summary["volume_fracton"]
packing.to_pyvista("voxels", cells=10).dimensions
packstone.plan(specimen=40)["grians"]
"""


def test_a_type_checker_finds_what_is_misspelt(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(CHECKED)
    command = [sys.executable, "-m", "mypy", "--strict", "--output", "json", "program.py"]
    said = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False).stdout
    found = [json.loads(line) for line in said.splitlines() if line.startswith("{")]
    lines = sorted({error["line"] for error in found if error["severity"] == "error"})
    words = re.compile('segmets|fracton|grians|"stl"')
    misspelt = [number for number, line in enumerate(CHECKED.splitlines(), start=1) if words.search(line)]
    assert lines == misspelt and len(lines) == 5, said
