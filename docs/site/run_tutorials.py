"""Runs the commands of the tutorials and recipes as they stand there: python run_tutorials.py BINARY [PAGE...]

Every block fenced as `sh` of a page in docs/tutorial, docs/recipes or docs/coming-from, in one shell, in this order, in
a folder with the files that the page tells the reader to save. The port 8080 is replaced by a free one. Pages that need
CalculiX or Gmsh are skipped where it is missing.
"""

import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1]
# In their order in the site; a later one may use the file of an earlier one.
PAGES = [
    *(f"tutorial/{name}" for name in ("first-packing", "study", "cluster", "calculix")),
    *(f"recipes/{name}" for name in ("stiffness", "conductivity", "tetrahedra", "plane", "mesh-study", "own-input")),
    *(f"recipes/{name}" for name in ("abaqus", "fenicsx", "fft", "damask", "chrono", "pyvista")),
    "coming-from/index",
]
# The programs that pages need beside Packstone.
NEEDS = {
    "tutorial/calculix": ["ccx"],
    "recipes/tetrahedra": ["ccx", "gmsh"],
    "recipes/plane": ["ccx", "gmsh"],
    "recipes/mesh-study": ["ccx", "gmsh"],
    "recipes/own-input": ["ccx"],
    "recipes/fenicsx": ["gmsh"],
    "recipes/chrono": ["unzip"],
    "recipes/pyvista": ["gmsh"],
}
PATH = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
LONGEST_S = 900


def commands(page: Path) -> str:
    """The lines of all blocks fenced as `sh`, which may be indented."""
    blocks = re.findall(r"^( *)```sh\n(.*?)^ *```$", page.read_text(), re.DOTALL | re.MULTILINE)
    return "".join(re.sub(f"^{indent}", "", block, flags=re.MULTILINE) for indent, block in blocks)


def differences(page: Path) -> list[str]:
    """The files to be saved that a page shows otherwise than they are."""
    shown = re.findall(r"\[`(\S+\.json)`\]\(\1\):\n\n```json\n(.*?)```", page.read_text(), re.DOTALL)
    return [name for name, text in shown if (page.parent / name).read_text() != text]


def run(name: str, binary: Path) -> bool:
    """Runs the commands of one page, and says what it printed where a command fails."""
    with socket.socket() as listener, tempfile.TemporaryDirectory() as folder:
        listener.bind(("127.0.0.1", 0))
        port = listener.getsockname()[1]
        listener.close()
        page = DOCS / f"{name}.md"
        for file in [file for ending in ("json", "py", "csv", "inp") for file in page.parent.glob(f"*.{ending}")]:
            shutil.copy(file, folder)
        bin_folder = Path(folder) / "bin"
        bin_folder.mkdir()
        (bin_folder / "packstone").symlink_to(binary)
        script = "set -euo pipefail\ntrap 'running=$(jobs -p); [ -z \"$running\" ] || kill $running; wait' EXIT\n"
        script += commands(page).replace("localhost:8080", f"localhost:{port}")
        environment = {**os.environ, "PATH": f"{bin_folder}:{PATH}", "PACKSTONE_LISTEN": f"127.0.0.1:{port}"}
        ended = subprocess.run(["bash", "-c", script], cwd=folder, env=environment, check=False, text=True,
                               stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=LONGEST_S)
    if ended.returncode != 0:
        print(f"{name}: exit code {ended.returncode}\n{script}\n{ended.stdout}", file=sys.stderr)
    return ended.returncode == 0


def main() -> None:
    binary, names = Path(sys.argv[1]).resolve(), sys.argv[2:] or PAGES
    failed = []
    for name in names:
        different = differences(DOCS / f"{name}.md")
        if different:
            print(f"{name}.md shows {', '.join(different)} otherwise than the file is", file=sys.stderr)
            failed.append(name)
        elif missing := [program for program in NEEDS.get(name, []) if not shutil.which(program, path=PATH)]:
            print(f"SKIPPED {name}: no {', '.join(missing)}", file=sys.stderr)
        elif run(name, binary):
            print(f"{name}: its commands work")
        else:
            failed.append(name)
    if failed:
        sys.exit(f"run_tutorials.py: {', '.join(failed)}")


if __name__ == "__main__":
    main()
