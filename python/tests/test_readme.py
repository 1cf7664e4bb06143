"""The examples of the README, run as they stand there."""

from __future__ import annotations

import ast
import asyncio
import inspect
import re
from pathlib import Path
from typing import Any

import pytest
from live_server import REPOSITORY, LiveServer


def test_the_examples_of_the_readme(
    server: LiveServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PACKSTONE_URL", server.url)
    monkeypatch.chdir(tmp_path)
    readme = REPOSITORY / "python/README.md"
    text = readme.read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    assert len(blocks) == text.count("```python") > 0
    names: dict[str, Any] = {}
    for block in blocks:
        code = compile(block, str(readme), "exec", flags=ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)
        # A block that awaits is a coroutine.
        awaited = eval(code, names)
        if inspect.iscoroutine(awaited):
            asyncio.run(awaited)
    assert len(list((tmp_path / "packings").glob("*.npy"))) > 10
    grains = ("packings/a16.vtp", "packings/a16.html")
    exports = ("a16.vti", "section.png", "surfaces.zip", "lattice.zip", "grading.svg", "success.svg")
    for name in (*grains, *exports):
        assert (tmp_path / name).stat().st_size > 100, name
