"""Reads meshes of tetrahedra with meshio, VTK and Gmsh, and looks at what a solver needs of them.

    python tetrahedra.py FOLDER

FOLDER holds result.json, and of the same packing and options inp.inp, inp2.inp (second order), vtu.vtu and msh.msh with
their reports beside them (`.report.json`). Exits 0 when all is well; says what is wrong and exits 1 otherwise.
"""

import json
import math
import sys
from pathlib import Path

import gmsh
import meshio
import numpy as np

folder = Path(sys.argv[1])
result = json.loads((folder / "result.json").read_text())
size = result["request"]["specimen"]["size_mm"]
diameters = np.array([row[3] for row in result["grains"]["rows"]])
grains_mm3 = math.pi / 6 * diameters**3
failures = []


def expect(holds, what):
    if not holds:
        failures.append(what)


def volumes(points, cells):
    a, b, c, d = (points[cells[:, corner]] for corner in range(4))
    return np.einsum("ij,ij->i", b - a, np.cross(c - a, d - a)) / 6


def blocks(path):
    """The keyword blocks of a deck: the line and the lines of data."""
    found = []
    for line in path.read_text().splitlines():
        if line.startswith("**"):
            continue
        if line.startswith("*"):
            found.append((line, []))
        else:
            found[-1][1].append(line)
    return found


def numbers(lines):
    return [int(number) for line in lines for number in line.split(",")]


for name, kind in [("inp", "C3D4"), ("inp2", "C3D10")]:
    deck = blocks(folder / f"{name}.inp")
    report = json.loads((folder / f"{name}.inp.report.json").read_text())
    of_tetrahedra = report["tetrahedra"]
    keywords = [line for line, _ in deck]
    faces = ["x_min", "x_max", "y_min", "y_max", "z_min", "z_max"]
    expect(
        keywords
        == ["*NODE", f"*ELEMENT, TYPE={kind}, ELSET=matrix", f"*ELEMENT, TYPE={kind}, ELSET=aggregates"]
        + [f"*NSET, NSET={face}" for face in faces]
        + ["*NSET, NSET=grain_surfaces"]
        + [f"*SURFACE, TYPE=ELEMENT, NAME={face}" for face in faces],
        f"{name}: keywords {keywords}",
    )
    points = np.array([[float(x) for x in line.split(",")[1:]] for line in deck[0][1]])
    expect([int(line.split(",")[0]) for line in deck[0][1]] == list(range(1, len(points) + 1)), f"{name}: numbers of nodes")
    sets = [np.array([numbers([line]) for line in lines]) for _, lines in deck[1:3]]
    cells = np.concatenate(sets)[:, 1:] - 1
    own = [volumes(points, cells_of[:, 1:] - 1) for cells_of in sets]
    expect(min(v.min() for v in own) > 0, f"{name}: a volume is not positive")
    total = sum(v.sum() for v in own)
    expect(abs(total / math.prod(size) - 1) < 1e-9, f"{name}: the union has {total} mm3 of {math.prod(size)}")
    expect(abs(own[1].sum() / grains_mm3.sum() - 1) < 1e-3, f"{name}: aggregates {own[1].sum()}, grains {grains_mm3.sum()}")
    expect(len(cells) == of_tetrahedra["elements"] and len(points) == of_tetrahedra["nodes"], f"{name}: counts")
    # Each side inside is that of two tetrahedra, each side outside lies on a face of the box: with positive volumes
    # that fill the box, none overlap.
    sides = np.sort(np.concatenate([cells[:, three] for three in ([0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0])]), axis=1)
    _, counts = np.unique(sides, axis=0, return_counts=True)
    expect(set(counts) <= {1, 2}, f"{name}: a side of {counts.max()} tetrahedra")
    outer = 0
    for place, face in enumerate(faces):
        axis, at = divmod(place, 2)
        plane = size[axis] * at
        nodes = np.array(numbers(deck[3 + place][1])) - 1
        expect(set(nodes) == set(np.flatnonzero(points[:, axis] == plane)), f"{name}: nodes of {face}")
        of_face = [line.split(",") for line in deck[10 + place][1]]
        outer += len(of_face)
        corners = {"S1": (0, 1, 2), "S2": (0, 3, 1), "S3": (1, 3, 2), "S4": (2, 3, 0)}
        on_plane = [points[cells[int(element) - 1, list(corners[side.strip()])], axis] for element, side in of_face]
        expect(np.all(np.array(on_plane) == plane), f"{name}: sides of {face}")
    expect(outer == (counts == 1).sum(), f"{name}: {outer} sides on faces, {(counts == 1).sum()} of one tetrahedron")
    on_grains = np.array(numbers(deck[9][1])) - 1
    both = np.intersect1d(np.unique(sets[0][:, 1:]), np.unique(sets[1][:, 1:])) - 1
    expect(np.array_equal(on_grains, both), f"{name}: grain_surfaces are not the nodes of both phases")
    if kind == "C3D10":
        edges = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
        middles = [np.abs(points[cells[:, 4 + n]] - (points[cells[:, a]] + points[cells[:, b]]) / 2).max() for n, (a, b) in enumerate(edges)]
        expect(max(middles) < 1e-12, f"{name}: mid nodes {middles}")
    read = meshio.read(folder / f"{name}.inp")
    expect(sum(len(block.data) for block in read.cells) == len(cells), f"{name}: meshio")
    expect(of_tetrahedra["largest_grain_volume_error"] < 1e-3, f"{name}: {of_tetrahedra}")
    expect(abs(of_tetrahedra["specimen_volume_error"]) < 1e-9, f"{name}: {of_tetrahedra}")
    expect(of_tetrahedra["smallest_gamma"] >= 0.05, f"{name}: gamma {of_tetrahedra['smallest_gamma']}")

grid = meshio.read(folder / "vtu.vtu")
cells, grain = grid.cells_dict["tetra"], grid.cell_data_dict["grain"]["tetra"]
phase = grid.cell_data_dict["phase"]["tetra"]
expect(np.array_equal(phase > 0, grain > 0), "vtu: phases and grains")
of_grain = np.bincount(grain, volumes(grid.points, cells), len(diameters) + 1)[1:]
expect(np.abs(of_grain / grains_mm3 - 1).max() < 1e-3, f"vtu: volumes of grains {np.abs(of_grain / grains_mm3 - 1).max()}")

gmsh.initialize(["gmsh", "-v", "0"])
gmsh.open(str(folder / "msh.msh"))
tags, _ = gmsh.model.mesh.getElementsByType(4)
report = json.loads((folder / "msh.msh.report.json").read_text())["tetrahedra"]
gamma = np.array(gmsh.model.mesh.getElementQualities(tags, "gamma")).min()
expect(len(tags) == report["elements"], f"msh: {len(tags)} tetrahedra of {report['elements']}")
expect(abs(gamma - report["smallest_gamma"]) < 1e-9, f"msh: Gmsh finds a gamma of {gamma}, the report {report}")
groups = {gmsh.model.getPhysicalName(3, tag) for _, tag in gmsh.model.getPhysicalGroups(3)}
expect(groups == {"matrix", "aggregates"}, f"msh: {groups}")

for failure in failures:
    print(failure)
sys.exit(bool(failures))
