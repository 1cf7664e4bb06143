"""Fills the meshes of grains of several shapes with Gmsh, and measures the flattest tetrahedra.

    python gamma.py PACKSTONE [SEEDS] [SHAPE...]

Packs A16 above 2 mm, 50 % of the mixture, with gaps of 1 mm, in a cube of 32 mm, exports `msh` and fills it with HXT as
the script beside the file does. Prints a line for each packing: gamma (inscribed over circumscribed radius, 1 for a
regular tetrahedron) of the flattest tetrahedron, and the number below 0.03, of the matrix and of the grains. Needs the
wheels `gmsh` and `numpy`.
"""

import json
import subprocess
import sys
import tempfile
import time

import gmsh
import numpy as np

LONG = {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.667}
FLAT = {"type": "constant", "b_over_a": 0.7071, "c_over_a": 0.5}
SHAPES = {
    "sphere": {"type": "sphere"},
    "ellipsoid": {"type": "ellipsoid", "ratios": LONG},
    "flat_ellipsoid": {"type": "ellipsoid", "ratios": FLAT},
    "fi20": {"type": "preset", "name": "fi20"},
    "fi50": {"type": "preset", "name": "fi50"},
    "si55": {"type": "preset", "name": "si55"},
    "cuboid": {"type": "polyhedron", "template": "deformed_cuboid"},
    "cuts": {"type": "polyhedron", "faces": 24, "ratios": LONG},
    "rounded_cuts": {"type": "polyhedron", "faces": 24, "rounding": 0.05, "ratios": LONG},
}
HXT = 10
FLAT_BELOW = 0.03
# Exit code of a packing that jams before its target.
NOT_REACHED = 4


def job(shape, seed):
    mix = {
        "grading": {"type": "standard", "name": "A16"},
        "d_min_mm": 2,
        "volume_fraction": 0.5,
        "shape": shape,
    }
    specimen = {"type": "box", "size_mm": [32, 32, 32]}
    return {"seed": seed, "specimen": specimen, "mix": mix, "distance": {"type": "constant", "gap_mm": 1.0}}


def gammas(entities):
    """Gamma of all tetrahedra of some volumes."""
    found = []
    for entity in entities:
        _, tags, _ = gmsh.model.mesh.getElements(3, entity)
        found.append(gmsh.model.mesh.getElementQualities(tags[0], "gamma"))
    return np.concatenate(found)


def fill(path):
    """Fills a mesh; gamma of the matrix and of the grains, and the time that Gmsh took."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.merge(path)
    gmsh.model.mesh.createGeometry(gmsh.model.getEntities(3))
    gmsh.option.setNumber("Mesh.Algorithm3D", HXT)
    began = time.process_time()
    gmsh.model.mesh.generate(3)
    took = time.process_time() - began
    grains = [volume for _, volume in gmsh.model.getEntities(3) if volume > 1]
    found = gammas([1]), gammas(grains)
    gmsh.finalize()
    return *found, took


def main(packstone, seeds="1", *names):
    for name in names or SHAPES:
        for seed in range(1, int(seeds) + 1):
            with tempfile.TemporaryDirectory() as folder:
                with open(f"{folder}/job.json", "w") as file:
                    json.dump(job(SHAPES[name], seed), file)
                command = [packstone, "run", "job.json", "--out", "made", "--export", "mesh:format=msh"]
                run = subprocess.run(command, cwd=folder, capture_output=True, text=True)
                if run.returncode == NOT_REACHED:
                    print(f"{name}, seed {seed}: {run.stderr.splitlines()[-1]}")
                    continue
                run.check_returncode()
                matrix, grains, took = fill(f"{folder}/made/result.msh")
            parts = [
                f"{part} {np.min(of):.3f} ({np.sum(of < FLAT_BELOW)} of {len(of)} below {FLAT_BELOW})"
                for part, of in (("matrix", matrix), ("grains", grains))
            ]
            print(f"{name}, seed {seed}: {', '.join(parts)}, {took:.0f} s", flush=True)


main(*sys.argv[1:])
