"""The examples of the docstrings, run as they stand there, and what each docstring has."""

from __future__ import annotations

import doctest
import importlib
import inspect
import pkgutil
from pathlib import Path
from typing import Any

import pytest

import packstone

MODULES = sorted(module.name for module in pkgutil.iter_modules(packstone.__path__))
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
# Made by functions, whose docstrings have the example.
MADE = {
    "AsyncExport", "AsyncJob", "AsyncPacking", "AsyncStudy", "Blend", "BlendedSieve", "ConnectionFailed",
    "Export", "Fault", "Grain", "JobCancelled", "Lattice", "MixBand", "MixCandidate", "MixCurve", "MixNote",
    "MixPart", "MixReading", "MixRecipe", "Neighbours", "PackstoneWarning", "Picture", "Specimen", "Svg", "View",
    "WaitTimeout",
}  # fmt: skip


@pytest.mark.parametrize("name", [name for name in MODULES if name not in ("_native", "jupyter")])
def test_examples_of_docstrings_run(
    name: str, client: packstone.Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(f"packstone.{name}")
    names = {"packstone": packstone, "client": client}
    tests = doctest.DocTestFinder().find(module, extraglobs=names)
    runner = doctest.DocTestRunner(optionflags=FLAGS)
    said: list[str] = []
    for test in tests:
        monkeypatch.chdir(tmp_path)
        (tmp_path / test.name).mkdir(exist_ok=True)
        monkeypatch.chdir(tmp_path / test.name)
        runner.run(test, out=said.append)
    assert runner.failures == 0, "".join(said)


def public() -> list[tuple[str, Any]]:
    """The functions and classes of the package."""
    return [(name, getattr(packstone, name)) for name in packstone.__all__]


@pytest.mark.parametrize(("name", "member"), [(name, member) for name, member in public() if name not in MADE])
def test_everything_that_is_called_has_an_example(name: str, member: Any) -> None:
    texts = [inspect.getdoc(member) or ""]
    if inspect.isclass(member):
        texts += [inspect.getdoc(function) or "" for _, function in inspect.getmembers(member, callable)]
    assert any(">>> " in text for text in texts), name


@pytest.mark.parametrize(("name", "member"), public())
def test_sections_name_the_arguments_that_there_are(name: str, member: Any) -> None:
    functions: list[tuple[str, Any]] = [(name, member)] if inspect.isfunction(member) else []
    if inspect.isclass(member):
        for kind in (inspect.isfunction, inspect.ismethod):
            functions += [(f"{name}.{method}", function) for method, function in inspect.getmembers(member, kind)]
    for place, function in functions:
        text = inspect.getdoc(member if place.endswith("__init__") else function) or ""
        if "Parameters\n----------\n" not in text:
            continue
        section = text.split("Parameters\n----------\n")[1].split("\n\n")[0]
        heads = [line for line in section.splitlines() if not line.startswith(" ")]
        named = {word.strip(" *") for head in heads for word in head.split(",")}
        parameters = set(inspect.signature(function).parameters) - {"self", "cls"}
        assert named == parameters, place
