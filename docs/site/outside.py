"""Links of the documentation to what is no page of it: files of the repository outside of docs, and folders."""

import posixpath
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

from notebooks import NOTEBOOK_PAGES

LINK = re.compile(r"\]\((?!https?://|#)([^)\s]+)\)")
# Larger files, and those that are no text, are copied as they are.
MOST_SHOWN_BYTES = 60_000
LANGUAGES = {".env": "ini", ".js": "javascript", ".json": "json", ".m": "matlab", ".py": "python", ".rs": "rust", ".service": "ini",
             ".sh": "bash", ".toml": "toml", ".yaml": "yaml"}
README_PAGES = {"python/README.md": "python/overview.md"}
# Files that have pages which are made of them.
PAGES = {"openapi.yaml": "reference/http.md", **README_PAGES, **NOTEBOOK_PAGES}


def moved(markdown: str, path: str, place: str) -> str:
    """The Markdown of a file of the repository with its links as they are in the page at `place`."""

    def link(found: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(path), found[1]))
        return f"]({posixpath.relpath(target, posixpath.join('docs', posixpath.dirname(place)))})"

    return LINK.sub(link, markdown)


class Outside:
    """Where such links lead."""

    def __init__(self, root: Path) -> None:
        self.root = root
        package = tomllib.loads((root / "Cargo.toml").read_text())["workspace"]["package"]
        self.repository: str | None = package.get("repository")

    def targets(self, source: str, markdown: str) -> Iterator[tuple[str, str]]:
        """The links of a page that this module is for, each with the path of its file from the root."""
        for link in LINK.findall(markdown):
            path = posixpath.normpath(posixpath.join("docs", posixpath.dirname(source), link.split("#")[0]))
            target = self.root / path
            if (not path.startswith("docs/") and target.exists()) or target.is_dir():
                yield link, path

    def pages_for(self, source: str, markdown: str) -> dict[str, str | bytes]:
        """The pages that the links of a page need, by their path in the site."""
        pages: dict[str, str | bytes] = {}
        if self.repository is None:
            for _, path in self.targets(source, markdown):
                self.add(path, pages)
        return pages

    def add(self, path: str, pages: dict[str, str | bytes]) -> None:
        """Adds the page of a file, or those of a folder with all that is in it."""
        if path in PAGES:
            return
        target, place = self.root / path, self.place(path)
        head = "---\nsearch:\n  exclude: true\n---\n\n"
        if target.is_dir():
            names = sorted(entry.name for entry in target.iterdir() if not entry.name.startswith((".", "__")))
            for name in names:
                self.add(f"{path}/{name}", pages)
            links = (posixpath.relpath(self.place(f"{path}/{name}"), posixpath.dirname(place)) for name in names)
            entries = "".join(f"- [{name}]({link})\n" for name, link in zip(names, links, strict=True))
            pages[place] = f"{head}# {path}/\n\n{entries}"
        elif place.endswith(".md"):
            language = LANGUAGES.get(target.suffix, "text")
            pages[place] = f"{head}# {path}\n\n``````{language}\n{target.read_text()}\n``````\n"
        else:
            pages[place] = target.read_bytes()

    def place(self, path: str) -> str:
        """The path in the site of a file or folder of the repository."""
        target = self.root / path
        if path in PAGES:
            return PAGES[path]
        if target.is_dir():
            return f"files/{path}/index.md"
        shown = target.suffix in LANGUAGES and target.stat().st_size <= MOST_SHOWN_BYTES
        return f"files/{path}.md" if shown else f"files/{path}"

    def rewrite(self, source: str, markdown: str) -> str:
        """The page with its links changed."""
        for link, path in set(self.targets(source, markdown)):
            if self.repository is None or path in PAGES:
                new = posixpath.relpath(self.place(path), posixpath.dirname(source) or ".")
            else:
                kind = "tree" if (self.root / path).is_dir() else "blob"
                new = f"{self.repository}/{kind}/HEAD/{path}"
            markdown = markdown.replace(f"]({link})", f"]({new})")
        return markdown
