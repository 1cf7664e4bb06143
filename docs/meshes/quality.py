"""How good tetrahedra come out against the clearance between grains: the tables of docs/meshes.md.

    cargo build --release -p packstone-engine --example mesh
    python quality.py EXAMPLE [--size 80] [--clearances 1,0.5,0.25,0.1] [--options '{"size_field": false}']

EXAMPLE is the program built above. Packs A16 above 2 mm, 50 % of the mixture, into a cube with each clearance, lets Gmsh fill it
with its default options, and prints one row of a Markdown table for each. Times are CPU seconds, for the machine may have others to serve.
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


def job(size, clearance):
    return {
        "seed": 1,
        "specimen": {"type": "box", "size_mm": [size] * 3},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2, "volume_fraction": 0.5},
        "distance": {"type": "constant", "gap_mm": clearance},
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
    arguments.add_argument("example")
    arguments.add_argument("--size", type=float, default=80)
    arguments.add_argument("--clearances", default="1,0.5,0.25,0.1")
    arguments.add_argument("--options", default="{}")
    asked = arguments.parse_args()
    print("| clearance | triangles | tetrahedra | smallest gamma | below 0.03 | below 0.1 | below 0.2 | mean | Gmsh |")
    print("|---|---|---|---|---|---|---|---|---|")
    for clearance in map(float, asked.clearances.split(",")):
        with tempfile.TemporaryDirectory() as folder:
            request, target = Path(folder, "job.json"), Path(folder, "packing.msh")
            request.write_text(json.dumps(job(asked.size, clearance)))
            made = subprocess.run([asked.example, request, "msh", target, asked.options], capture_output=True, text=True)
            if made.returncode:
                sys.exit(made.stderr)
            gammas, triangles, took = quality(target)
        below = " | ".join(str(int((gammas < bound).sum())) for bound in (0.03, 0.1, 0.2))
        print(
            f"| {clearance:g} mm | {triangles} | {len(gammas)} | {gammas.min():.3f} | {below} | {gammas.mean():.3f} | {took:.0f} s |",
            flush=True,
        )


if __name__ == "__main__":
    main()
