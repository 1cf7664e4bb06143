"""Writes ``packstone/gallery.json`` of the folders in ``examples/gallery``: python gallery_file.py

The wheel has files of the package only; a test compares the two.
"""

from __future__ import annotations

import json
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = sorted(path.parent for path in (ROOT / "examples/gallery").glob("*/request.json"))
FILE = ROOT / "python/packstone/gallery.json"


def text() -> str:
    """The content of the file: name, title and request of each example."""
    gallery = {
        folder.name: {
            "title": (folder / "README.md").read_text().splitlines()[0].removeprefix("# "),
            "request": json.loads((folder / "request.json").read_text()),
        }
        for folder in FOLDERS
    }
    lines = (f"  {json.dumps(name)}: {json.dumps(entry)}" for name, entry in gallery.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


if __name__ == "__main__":
    FILE.write_text(text())
