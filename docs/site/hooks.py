"""What MkDocs calls to make the pages that are not written by hand (mkdocs.yml).

- reference/http.md and reference/objects.md from openapi.yaml, a file of the repository;
- reference/commands.md and viewer/first.html by the binary `packstone`, which the variable PACKSTONE names; without it
  the one in target/release, or on the path;
- tutorial/python-*.md from the notebooks in python/notebooks and tasks/*.md from those in examples/notebooks, none of
  which is executed, and python/overview.md from python/README.md;
- a page for each file of the repository outside of docs that a page links to, unless Cargo.toml states the address of
  the repository, where the links then lead.
"""

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from command_reference import command_page
from http_reference import object_page, route_page
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from notebooks import NOTEBOOK_PAGES, notebook_page, pictures
from outside import README_PAGES, Outside, moved

ROOT = Path(__file__).resolve().parents[2]
# The packing of the first tutorial, which its page shows in a frame.
JOB = ROOT / "docs" / "tutorial" / "first.json"
VIEWER = "viewer/first.html"
MOST_VIEWER_BYTES = 300_000

outside = Outside(ROOT)


def binary() -> str:
    """The program `packstone`."""
    given = os.environ.get("PACKSTONE")
    built = ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / "release" / "packstone"
    found = given or (str(built) if built.exists() else shutil.which("packstone"))
    if found is None or shutil.which(found) is None:
        raise PluginError(f"no binary {found or built}: name it with PACKSTONE, or cargo build --release")
    return str(Path(found).resolve()) if "/" in found else found


def viewer(program: str) -> bytes:
    """The page with the viewer and the packing of JOB."""
    with tempfile.TemporaryDirectory() as folder:
        command = [program, "run", str(JOB), "--format", "html", "--out", folder]
        subprocess.run(command, check=True, capture_output=True)
        page = (Path(folder) / "result.html").read_bytes()
    if len(page) > MOST_VIEWER_BYTES:
        raise PluginError(f"{VIEWER} has {len(page)} bytes, {MOST_VIEWER_BYTES} at most: take a smaller packing")
    return page


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the files that are made."""
    program = binary()
    contract = (ROOT / "openapi.yaml").read_text()
    made: dict[str, str | bytes] = {
        "reference/http.md": route_page(contract),
        "reference/objects.md": object_page(contract),
        "reference/commands.md": command_page(program),
        VIEWER: viewer(program),
    }
    texts: dict[str, str] = {}
    for path, place in README_PAGES.items():
        texts[place] = moved((ROOT / path).read_text(), path, place)
    for path, place in NOTEBOOK_PAGES.items():
        notebook, name = (ROOT / path).read_text(), Path(path).name
        folder, stem = os.path.dirname(place), Path(place).stem
        made[f"{folder}/{name}"] = notebook
        made |= {f"{folder}/{stem}-{file}": content for file, content in pictures(notebook).items()}
        # The links to the download and to the pictures are ones of the site.
        title, text = moved(notebook_page(notebook), path, place).split("\n", 1)
        text = re.sub(r"\]\([^)]*/(output-\d+\.png)\)", rf"]({stem}-\1)", text)
        texts[place] = f"{title}\n\n[Download the notebook]({name})\n{text}"
    texts |= {file.src_uri: file.content_string for file in files.documentation_pages()}
    for place, text in texts.items():
        made |= outside.pages_for(place, text)
    made |= {place: texts[place] for place in (*README_PAGES.values(), *NOTEBOOK_PAGES.values())}
    for path, content in made.items():
        files.append(File.generated(config, path, content=content))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Makes links that lead out of docs lead to pages of the site, and checks that frames have a page."""
    for frame in re.findall(r'<iframe[^>]* src="([^"]+)"', markdown):
        # As a browser resolves it: against the address of the page.
        target = os.path.normpath(os.path.join(os.path.dirname(page.url), frame))
        if files.get_file_from_path(target) is None:
            raise PluginError(f"{page.file.src_uri}: the frame {frame} shows {target}, which does not exist")
    if page.file.src_uri.startswith(("reference/", "files/")):
        return markdown
    return outside.rewrite(page.file.src_uri, markdown)
