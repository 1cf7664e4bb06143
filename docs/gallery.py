"""Makes docs/gallery.md and the small pictures from the folders of examples/gallery: python gallery.py PACKSTONE

Packs each request.json, which must take less than a second, writes thumb.png beside it from the picture of the command,
and lists all folders by the topic that ends their README.md. Needs Pillow.
"""

import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).resolve().parent
GALLERY = DOCS.parent / "examples" / "gallery"
TOPICS = ["gradings", "mixes", "shapes", "specimens", "methods and distances", "exports"]
LONGEST_S = 1
HEAD = """\
# Gallery

{count} jobs to start from. Each is a folder of [`examples/gallery`](../examples/gallery) with `request.json`, which is
packed in less than a second, and a README with its commands. The command carries them: it copies the request into a
folder of its name, packs it and draws a picture. Change the copy, and run it again:

```sh
packstone run --example standard-curve
packstone run standard-curve/request.json --out standard-curve --picture --force
```

The service takes the same file: `curl localhost:8080/v1/jobs --json @request.json`. So does the page: paste it under
*As a script*. The Python package carries the requests, too: `packstone.examples()` has their names, and
`packstone.pack(packstone.example("standard-curve"))` packs one. Each README shows all three ways; their packings are
equal, bit for bit.

[`gallery.py`](gallery.py) makes this page and its pictures from the folders.
"""


def packed(program, folder):
    """Packs the example, and returns the picture."""
    with tempfile.TemporaryDirectory() as place:
        began = time.monotonic()
        subprocess.run([program, "run", folder / "request.json", "--out", place], check=True, capture_output=True)
        taken = time.monotonic() - began
        if taken > LONGEST_S:
            sys.exit(f"{folder.name} takes {taken:.1f} s")
        command = [program, "run", folder / "request.json", "--out", place, "--force", "--picture"]
        subprocess.run(command, check=True, capture_output=True)
        with Image.open(Path(place) / "result.png") as picture:
            return picture.convert("RGB")


def main():
    program = str(Path(sys.argv[1]).resolve())
    rows = {topic: [] for topic in TOPICS}
    folders = sorted(path.parent for path in GALLERY.glob("*/request.json"))
    for folder in folders:
        picture = packed(program, folder)
        picture.thumbnail((260, 260), Image.Resampling.LANCZOS)
        picture.quantize(96, dither=Image.Dither.NONE).save(folder / "thumb.png", optimize=True)
        title, words, topic = re.fullmatch(
            r"# (.+?)\n\n(.+?)\n\n```sh\n.+?```\n\nTopic: (.+?)\.\n", (folder / "README.md").read_text(), re.DOTALL
        ).groups()
        link = f"../examples/gallery/{folder.name}"
        words = words.replace("\n", " ")
        rows[topic].append(f"| ![{title}]({link}/thumb.png) | [**{title}**]({link}) {words} |\n")
    page = HEAD.format(count=len(folders))
    for topic, lines in rows.items():
        page += f"\n## {topic.capitalize()}\n\n| | |\n|---|---|\n" + "".join(lines)
    (DOCS / "gallery.md").write_text(page)


if __name__ == "__main__":
    main()
