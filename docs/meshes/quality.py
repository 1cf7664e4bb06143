"""Measures the quality of tetrahedra against the gap between grains: the table of docs/meshes.md.

    python quality.py PACKSTONE [--size 32] [--gaps 1,0.5,0.25,0.1] [--options segments=16,size_field=false]

PACKSTONE is the program. Packs A16 above 2 mm, 50 % of the mixture, into a cube with each gap, fills the mesh with Gmsh
and its default options, and prints one row of a Markdown table for each gap. Times are CPU seconds of Gmsh.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import gmsh
import numpy as np


def job(size, gap):
    return {
        "seed": 1,
        "specimen": {"type": "box", "size_mm": [size] * 3},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2, "volume_fraction": 0.5},
        "distance": {"type": "constant", "gap_mm": gap},
        "method": {"type": "edmd"},
    }


def quality(path):
    """Gamma of all tetrahedra, and the CPU time that Gmsh takes for them."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    start = time.process_time()
    gmsh.merge(str(path))
    gmsh.model.mesh.createGeometry(gmsh.model.getEntities(3))
    gmsh.model.mesh.generate(3)
    took = time.process_time() - start
    tags, _ = gmsh.model.mesh.getElementsByType(4)
    gammas = np.array(gmsh.model.mesh.getElementQualities(tags, "gamma"))
    triangles, _ = gmsh.model.mesh.getElementsByType(2)
    gmsh.finalize()
    return gammas, len(triangles), took


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("program")
    arguments.add_argument("--size", type=float, default=32)
    arguments.add_argument("--gaps", default="1,0.5,0.25,0.1")
    arguments.add_argument("--options", default="")
    given = arguments.parse_args()
    export = f"mesh:{given.options}" if given.options else "mesh"
    print("| gap | triangles | tetrahedra | smallest gamma | below 0.03 | below 0.1 | below 0.2 | mean | Gmsh |")
    print("|---|---|---|---|---|---|---|---|---|")
    for gap in map(float, given.gaps.split(",")):
        with tempfile.TemporaryDirectory() as folder:
            request = Path(folder, "job.json")
            request.write_text(json.dumps(job(given.size, gap)))
            command = [given.program, "run", request, "--out", folder, "--export", export]
            subprocess.run(command, check=True, capture_output=True)
            (mesh,) = Path(folder).glob("*.msh")
            gammas, triangles, took = quality(mesh)
        below = " | ".join(str((gammas < limit).sum()) for limit in (0.03, 0.1, 0.2))
        print(
            f"| {gap:g} mm | {triangles} | {len(gammas)} | {gammas.min():.3f} | {below} | "
            f"{gammas.mean():.3f} | {took:.0f} s |",
            flush=True,
        )


if __name__ == "__main__":
    main()
