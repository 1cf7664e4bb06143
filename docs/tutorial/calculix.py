"""Uniaxial compression of a packing by CalculiX: python calculix.py PACKING.msh FOLDER [--order 1]

PACKING.msh is the surface mesh that Packstone exports from a packing in a box. Gmsh fills it with tetrahedra, CalculiX
(`ccx`) solves the linear elastic problem, and the modulus of the specimen is printed beside the bounds of Voigt and
Reuss and of Hashin and Shtrikman (1963, doi:10.1016/0022-5096(63)90060-7). FOLDER gets the input `model.inp` and what
CalculiX writes, among it `model.frd` with the stresses. Needs the wheels gmsh and numpy.
"""

import argparse
import re
import subprocess
from pathlib import Path

import gmsh  # type: ignore[import-untyped]
import numpy as np
import numpy.typing as npt

# Young's modulus in MPa and Poisson's ratio: mortar, and quartzite.
MATERIALS = {"matrix": (25_000.0, 0.2), "aggregates": (60_000.0, 0.2)}
STRAIN = 1e-4
# Gmsh and CalculiX number the last two nodes of a tetrahedron of order 2 differently.
ORDER_OF_NODES = {1: [0, 1, 2, 3], 2: [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]}

Indices = npt.NDArray[np.int64]
Numbers = npt.NDArray[np.float64]


def fill(surface_mesh: Path, order: int) -> tuple[Numbers, dict[str, Indices], dict[str, float]]:
    """The nodes in mm, and for each material the nodes of its tetrahedra, counted from 0, and its volume in mm³."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.merge(str(surface_mesh))
    gmsh.model.mesh.createGeometry(gmsh.model.getEntities(3))
    gmsh.option.setNumber("Mesh.Algorithm3D", 10)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(order)
    tags, places, _ = gmsh.model.mesh.getNodes()
    row_of = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    row_of[tags] = np.arange(len(tags))
    nodes = places.reshape(-1, 3)
    elements, volumes = {}, {}
    for _, group in gmsh.model.getPhysicalGroups(3):
        name = gmsh.model.getPhysicalName(3, group)
        parts = [gmsh.model.mesh.getElements(3, entity)[2][0]
                 for entity in gmsh.model.getEntitiesForPhysicalGroup(3, group)]
        rows = row_of[np.concatenate(parts).astype(np.int64)]
        elements[name] = rows.reshape(-1, len(ORDER_OF_NODES[order]))[:, ORDER_OF_NODES[order]]
        a, b, c, d = (nodes[elements[name][:, corner]] for corner in range(4))
        volumes[name] = float(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a).sum() / 6)
    gmsh.finalize()
    return nodes, elements, volumes


def lines(numbers: Indices) -> str:
    """Numbers of nodes or elements, 12 to a line, as CalculiX reads them."""
    return "\n".join(", ".join(map(str, numbers[i:i + 12])) for i in range(0, len(numbers), 12))


def write_input(path: Path, nodes: Numbers, elements: dict[str, Indices]) -> None:
    """The input of CalculiX: three faces slide, the top face is moved down by STRAIN, the others are free."""
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    with path.open("w") as file:
        file.write("*NODE, NSET=all\n")
        for i, (x, y, z) in enumerate(nodes, start=1):
            file.write(f"{i}, {x:.9g}, {y:.9g}, {z:.9g}\n")
        first = 1
        for name, rows in elements.items():
            file.write(f"*ELEMENT, TYPE=C3D{rows.shape[1]}, ELSET={name}\n")
            for i, row in enumerate(rows + 1, start=first):
                file.write(f"{i}, {', '.join(map(str, row))}\n")
            first += len(rows)
            modulus, ratio = MATERIALS[name]
            file.write(f"*MATERIAL, NAME={name}\n*ELASTIC\n{modulus}, {ratio}\n")
            file.write(f"*SOLID SECTION, ELSET={name}, MATERIAL={name}\n")
        used = np.unique(np.concatenate([rows.ravel() for rows in elements.values()]))
        for name, axis, place in [("x_min", 0, low), ("y_min", 1, low), ("z_min", 2, low), ("z_max", 2, high)]:
            on_face = used[np.abs(nodes[used, axis] - place[axis]) < 1e-6]
            file.write(f"*NSET, NSET={name}\n{lines(on_face + 1)}\n")
        file.write("*STEP\n*STATIC, SOLVER=ITERATIVE CHOLESKY\n*BOUNDARY\n")
        file.write("x_min, 1, 1\ny_min, 2, 2\nz_min, 3, 3\n")
        file.write(f"z_max, 3, 3, {-STRAIN * (high[2] - low[2]):.9g}\n")
        file.write("*NODE PRINT, NSET=z_max, TOTALS=ONLY\nRF\n*NODE FILE\nU\n*EL FILE\nS\n*END STEP\n")


def modulus_of(folder: Path, nodes: Numbers) -> float:
    """The modulus in MPa from the force on the top face, which CalculiX prints."""
    numbers = re.findall(r"[-+]?\d\.\d+E[-+]\d+", (folder / "model.dat").read_text().split("total force")[1])
    width, depth, _ = np.ptp(nodes, axis=0)
    # The first number is the time.
    return -float(numbers[3]) / float(width * depth * STRAIN)


def bounds(fraction: float) -> dict[str, tuple[float, float]]:
    """The least and the largest modulus in MPa that a volume fraction of aggregate allows."""
    soft, stiff = MATERIALS["matrix"], MATERIALS["aggregates"]
    bulk = [modulus / (3 * (1 - 2 * ratio)) for modulus, ratio in (soft, stiff)]
    shear = [modulus / (2 * (1 + ratio)) for modulus, ratio in (soft, stiff)]
    shares = [1 - fraction, fraction]
    found = []
    for i, j in ((0, 1), (1, 0)):
        k, g = bulk[i], shear[i]
        mixed_k = k + shares[j] / (1 / (bulk[j] - k) + 3 * shares[i] / (3 * k + 4 * g))
        mixed_g = g + shares[j] / (1 / (shear[j] - g) + 6 * shares[i] * (k + 2 * g) / (5 * g * (3 * k + 4 * g)))
        found.append(9 * mixed_k * mixed_g / (3 * mixed_k + mixed_g))
    reuss = 1 / (shares[0] / soft[0] + shares[1] / stiff[0])
    voigt = shares[0] * soft[0] + shares[1] * stiff[0]
    return {"Reuss and Voigt": (reuss, voigt), "Hashin and Shtrikman": (found[0], found[1])}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else None)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--order", type=int, choices=sorted(ORDER_OF_NODES), default=2)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    nodes, elements, volumes = fill(options.mesh, options.order)
    fraction = volumes["aggregates"] / sum(volumes.values())
    print(f"{len(nodes)} nodes, {sum(map(len, elements.values()))} tetrahedra, aggregate {fraction:.4f} of the volume")
    write_input(options.folder / "model.inp", nodes, elements)
    with (options.folder / "ccx.log").open("w") as log:
        subprocess.run(["ccx", "model"], cwd=options.folder, check=True, stdout=log)
    for name, (least, largest) in bounds(fraction).items():
        print(f"bounds of {name}: {least / 1000:.2f} to {largest / 1000:.2f} GPa")
    print(f"modulus by CalculiX: {modulus_of(options.folder, nodes) / 1000:.2f} GPa")


if __name__ == "__main__":
    main()
