"""The notebooks, executed as they are stored."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pytest
from live_server import REPOSITORY
from nbclient import NotebookClient

FOLDER = REPOSITORY / "python/notebooks"
# What each notebook saves.
FILES = {
    "first_packing": ("first/a16.vtp", "first/a16.html", "first/a16.csv", "first/a16.npy"),
    "mesh_and_voxels": ("model/a16.msh", "model/a16.raw", "model/a16.vti", "model/slice.json"),
    "study": ("study/success.svg", "study/table.csv", "study/packings/RSA-0.34-0.npy"),
}


def test_every_notebook_is_executed() -> None:
    assert {path.stem for path in FOLDER.glob("*.ipynb")} == set(FILES)


@pytest.mark.parametrize("name", FILES)
def test_the_notebook_is_stored_without_outputs(name: str) -> None:
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=nbformat.NO_CONVERT)
    nbformat.validate(notebook)
    assert (notebook.nbformat, notebook.nbformat_minor) == (4, 5)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert cell.outputs == [] and cell.execution_count is None, cell.id


@pytest.mark.parametrize("name", FILES)
def test_the_notebook_runs(name: str, tmp_path: Path) -> None:
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    # A cell that raises ends the execution with its traceback.
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": tmp_path}}).execute()
    for file in FILES[name]:
        assert (tmp_path / file).stat().st_size > 100, file
