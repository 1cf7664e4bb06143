"""The notebook and the MATLAB script of each task, run as they are: both print the same result."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import nbformat
import pytest
from live_server import REPOSITORY, LiveServer
from nbclient import NotebookClient

NOTEBOOKS = REPOSITORY / "examples/notebooks"
SCRIPTS = REPOSITORY / "clients/matlab"
TASKS = ("lattice", "mesh", "pack", "stiffness", "study", "voxels")
MOST_BYTES = 250_000


def stored(task: str) -> Any:
    """The notebook of a task."""
    return nbformat.read(NOTEBOOKS / f"{task}.ipynb", as_version=4)


def result(text: str) -> str:
    """What a notebook or a script says of its result."""
    found = re.findall(r"^result: (.*)$", text, re.MULTILINE)
    assert len(found) == 1, text
    return str(found[0])


def printed(notebook: Any) -> str:
    """What the cells of a notebook print."""
    outputs = (output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs)
    return "".join(output.text for output in outputs if output.output_type == "stream")


def test_every_task_has_a_notebook_and_a_script() -> None:
    assert sorted(path.stem for path in NOTEBOOKS.glob("*.ipynb")) == sorted(TASKS)
    scripts = {path.stem.removeprefix("packstone_") for path in SCRIPTS.glob("*.m")}
    assert scripts == {*TASKS, "api", "wait"}
    page = (REPOSITORY / "docs/tasks.md").read_text()
    for task in TASKS:
        assert f"notebooks/{task}.ipynb" in page and f"packstone_{task}.m" in page, task


@pytest.mark.parametrize("task", TASKS)
def test_the_notebook_is_stored_with_a_picture(task: str) -> None:
    path = NOTEBOOKS / f"{task}.ipynb"
    notebook = nbformat.read(path, as_version=nbformat.NO_CONVERT)
    nbformat.validate(notebook)
    assert (notebook.nbformat, notebook.nbformat_minor) == (4, 5)
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert all(output.output_type != "error" and output.get("name") != "stderr" for output in outputs)
    assert path.stat().st_size < MOST_BYTES


@pytest.mark.parametrize("task", TASKS)
def test_the_notebook_gives_the_result_that_it_is_stored_with(task: str, tmp_path: Path) -> None:
    notebook = stored(task)
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": tmp_path}}).execute()
    assert result(printed(notebook)) == result(printed(stored(task)))


@pytest.fixture(scope="module")
def octave() -> str:
    """GNU Octave; the pipeline requires it by the variable PACKSTONE_OCTAVE."""
    found = shutil.which("octave-cli")
    if found is None:
        assert "PACKSTONE_OCTAVE" not in os.environ, "no octave-cli on the path"
        pytest.skip("no octave-cli here: apt-get install octave")
    return found


def run(octave: str, server: LiveServer, folder: Path, *command: str | Path) -> str:
    """Runs Octave in a folder with the scripts on its path, and returns what it prints."""
    env = os.environ | {"PACKSTONE_URL": server.url}
    arguments = [octave, "--quiet", "--no-init-file", "--no-history", "--path", str(SCRIPTS), *command]
    ended = subprocess.run(arguments, cwd=folder, env=env, capture_output=True, text=True, check=False, timeout=120)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


@pytest.mark.parametrize("task", TASKS)
def test_the_script_gives_the_result_of_the_notebook(
    task: str, octave: str, server: LiveServer, tmp_path: Path
) -> None:
    said = run(octave, server, tmp_path, SCRIPTS / f"packstone_{task}.m")
    assert result(said) == result(printed(stored(task)))


def test_scripts_say_what_the_server_refused(octave: str, server: LiveServer, tmp_path: Path) -> None:
    (tmp_path / "refused.m").write_text(
        "request.specimen = struct('type', 'box', 'size_mm', [40 40]);\n"
        "request.mix = struct('grading', struct('type', 'standard', 'name', 'A8'), 'volume_fraction', 50);\n"
        "try\n    packstone_api('POST', '/v1/jobs', request);\ncatch fault\n    disp(fault.message);\nend\n"
        "try\n    packstone_wait('/v1/jobs/none');\ncatch fault\n    disp(fault.message);\nend\n"
        "setenv('PACKSTONE_URL', 'http://127.0.0.1:1');\n"
        "try\n    packstone_api('GET', '/v1/jobs');\ncatch fault\n    disp(fault.message);\nend\n"
    )
    said = run(octave, server, tmp_path, "refused.m").splitlines()
    assert said[0].startswith("/specimen/size_mm: has 2 items")
    assert said[1].startswith("/mix/volume_fraction: 50 is out of range")
    assert said[2] == 'there is no job "none"' and said[3].startswith("no answer from http://127.0.0.1:1")
