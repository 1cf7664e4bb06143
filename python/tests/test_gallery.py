"""The gallery: what the package carries, and the snippets of each README, run as they stand there."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import gallery_file
import numpy as np
import pytest
from live_server import REPOSITORY, LiveServer, binary

import packstone

NAMES = [folder.name for folder in gallery_file.FOLDERS]


def test_the_package_carries_the_gallery() -> None:
    assert len(NAMES) > 30
    assert gallery_file.FILE.read_text() == gallery_file.text(), f"run python {gallery_file.__file__}"
    assert list(packstone.examples()) == NAMES


def test_a_change_of_an_example_stays_with_its_copy() -> None:
    request = packstone.example("dice")
    request["specimen"]["size_mm"][0] = 1
    assert packstone.example("dice")["specimen"]["size_mm"][0] > 1


def test_an_unknown_example_names_its_neighbour() -> None:
    with pytest.raises(ValueError, match=r"name: 'dices' must be one of packstone.examples\(\); did you mean dice\?"):
        packstone.example("dices")


@pytest.mark.parametrize("name", NAMES)
def test_the_ways_of_a_readme_give_equal_packings(
    name: str, server: LiveServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    readme = (REPOSITORY / "examples/gallery" / name / "README.md").read_text()
    shell = re.findall(r"^```sh\n(.*?)^```", readme, re.DOTALL | re.MULTILINE)
    (python,) = re.findall(r"^```python\n(.*?)^```", readme, re.DOTALL | re.MULTILINE)
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/packstone").symlink_to(binary())
    (tmp_path / "examples").symlink_to(REPOSITORY / "examples")
    env = os.environ | {"PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}"}
    assert len(shell) == 2
    for block in shell:
        script = "set -euo pipefail\n" + block.replace("localhost:8080", server.address)
        ended = subprocess.run(["bash", "-c", script], cwd=tmp_path, env=env, capture_output=True, text=True, check=False)
        assert ended.returncode == 0, ended.stderr
    (tmp_path / f"{name}.csv").rename(tmp_path / "of-service.csv")
    monkeypatch.chdir(tmp_path)
    exec(compile(python, "README.md", "exec"), {"packstone": packstone})
    assert (tmp_path / f"{name}.csv").read_bytes() == (tmp_path / "of-service.csv").read_bytes()
    here, there = packstone.load(f"{name}.csv"), packstone.load(name)
    assert np.array_equal(np.asarray(here), np.asarray(there))
    assert (tmp_path / name / "result.png").exists()
