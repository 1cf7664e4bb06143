"""The notebooks of the Python package as pages: their text and code as they are stored, without outputs."""

import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[2] / "python" / "notebooks"
# The page of each notebook, by the path of the notebook from the root of the repository.
NOTEBOOK_PAGES = {
    f"python/notebooks/{path.name}": f"tutorial/python-{path.stem.replace('_', '-')}.md"
    for path in sorted(FOLDER.glob("*.ipynb"))
}


def notebook_page(notebook: str) -> str:
    """The cells of a notebook as Markdown; the first begins with its title."""
    cells = json.loads(notebook)["cells"]
    return "\n\n".join("".join(cell["source"]) if cell["cell_type"] == "markdown" else _code(cell) for cell in cells)


def _code(cell: dict[str, Any]) -> str:
    return "```python\n" + "".join(cell["source"]) + "\n```"
