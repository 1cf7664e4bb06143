"""Notebooks as pages: those of the Python package, stored without outputs, and those of the tasks, stored with them."""

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
# The page of each notebook, by the path of the notebook from the root of the repository.
NOTEBOOK_PAGES = {
    **{
        f"python/notebooks/{path.name}": f"tutorial/python-{path.stem.replace('_', '-')}.md"
        for path in sorted((ROOT / "python/notebooks").glob("*.ipynb"))
    },
    **{
        f"examples/notebooks/{path.name}": f"tasks/{path.stem}.md"
        for path in sorted((ROOT / "examples/notebooks").glob("*.ipynb"))
    },
}


def notebook_page(notebook: str) -> str:
    """The cells of a notebook as Markdown, with what they print and show; the first begins with its title."""
    return "\n\n".join(_parts(json.loads(notebook)))


def pictures(notebook: str) -> dict[str, bytes]:
    """The pictures that the page shows, by the name of their files."""
    outputs = (output for cell in json.loads(notebook)["cells"] for output in cell.get("outputs", []))
    contents = (output.get("data", {}).get("image/png") for output in outputs)
    shown = [base64.b64decode(content) for content in contents if content is not None]
    return {_picture(number): content for number, content in enumerate(shown)}


def _picture(number: int) -> str:
    return f"output-{number}.png"


def _parts(notebook: dict[str, Any]) -> Iterator[str]:
    count = 0
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        yield source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```"
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if "image/png" in data:
                yield f"![What the cell shows]({_picture(count)})"
                count += 1
            else:
                text = "".join(output.get("text", data.get("text/plain", ""))).rstrip()
                yield f"```text\n{text}\n```"
