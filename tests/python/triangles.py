"""Reads the triangles of a cut as others do, by meshio and as keywords, against the sections of the grains."""

import json
import math
import pathlib
import sys

import meshio
import numpy

folder = pathlib.Path(sys.argv[1])
[json_file] = folder.glob("result.slice.x*.json.report.json")
cut = json.loads((folder / "result.slice.x.json").read_text())
u0, u1 = cut["outline"]["u_mm"]
v0, v1 = cut["outline"]["v_mm"]
area = (u1 - u0) * (v1 - v0)
columns = cut["circles"]["columns"]
circles = [dict(zip(columns, row)) for row in cut["circles"]["rows"]]
by_grain = {}
for circle in circles:
    by_grain[circle["grain"]] = by_grain.get(circle["grain"], 0.0) + circle["area_mm2"]


def areas(points, triangles):
    a, b, c = (points[triangles[:, corner], :2] for corner in range(3))
    return ((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])) / 2


# Each triangle runs anticlockwise, they fill the cut, and those of a grain have the area of its sections.
grid = meshio.read(folder / "result.slice.x.order-2.plane-strain.vtu")
assert [block.type for block in grid.cells] == ["triangle6"]
triangles, grain, phase = grid.cells[0].data, grid.cell_data["grain"][0], grid.cell_data["phase"][0]
own = areas(grid.points, triangles)
assert own.min() > 0 and math.isclose(own.sum(), area, rel_tol=1e-9)
assert set(grain) - {0} == {number + 1 for number in by_grain}, "a section is missing"
for number, exact in by_grain.items():
    found = own[grain == number + 1].sum()
    # Sections at an edge are clipped polygons, whose area differs a little.
    assert math.isclose(found, exact, rel_tol=0.02, abs_tol=0.05), (number, found, exact)
assert numpy.array_equal(phase == 0, grain == 0)
for middle, (a, b) in zip((3, 4, 5), ((0, 1), (1, 2), (2, 0))):
    points = grid.points
    assert numpy.allclose(points[triangles[:, middle]], (points[triangles[:, a]] + points[triangles[:, b]]) / 2)

# The deck: elements of one type, the same areas by set, edges with their nodes and sides.
text = (folder / "result.slice.x.inp").read_text()
nodes, sets, elements, surfaces, block = {}, {}, {}, {}, None
for line in text.splitlines():
    if line.startswith("**"):
        continue
    if line.startswith("*"):
        parts = [part.strip() for part in line.split(",")]
        named = dict(part.split("=") for part in parts[1:])
        block = (parts[0], named.get("ELSET") or named.get("NSET") or named.get("NAME"))
        assert parts[0] != "*ELEMENT" or named["TYPE"] == "CPS3", line
        continue
    fields = [field.strip() for field in line.split(",")]
    if block[0] == "*NODE":
        nodes[int(fields[0])] = [float(x) for x in fields[1:]]
    elif block[0] == "*ELEMENT":
        elements[int(fields[0])] = (block[1], [int(node) for node in fields[1:]])
    elif block[0] in ("*NSET", "*ELSET"):
        sets.setdefault(block[1], []).extend(int(number) for number in fields)
    elif block[0] == "*SURFACE":
        surfaces.setdefault(block[1], []).append((int(fields[0]), int(fields[1][1:])))
points = numpy.array([nodes[number] for number in sorted(nodes)])
assert sorted(nodes) == list(range(1, len(nodes) + 1)) and not points[:, 2].any()
for name, axis, at, length in (("y_min", 0, u0, v1), ("y_max", 0, u1, v1), ("z_min", 1, v0, u1), ("z_max", 1, v1, u1)):
    assert set(sets[name]) == set(numpy.flatnonzero(abs(points[:, axis] - at) < 1e-9) + 1), name
    total = 0.0
    for element, side in surfaces[name]:
        corners = elements[element][1]
        ends = corners[side - 1], corners[side % 3]
        assert set(ends) <= set(sets[name]), name
        total += numpy.linalg.norm(points[ends[0] - 1] - points[ends[1] - 1])
    assert math.isclose(total, length, rel_tol=1e-9), (name, total)
linear = areas(points, numpy.array([elements[number][1] for number in sorted(elements)]) - 1)
of_set = {}
for number, (name, _) in elements.items():
    of_set[name] = of_set.get(name, 0.0) + linear[number - 1]
report = json.loads((folder / "result.slice.x.inp.report.json").read_text())
stated = {phase["name"]: phase["volume_mm3"] for phase in report["triangles"]["phases"]}
assert stated.keys() == of_set.keys() and all(math.isclose(stated[name], of_set[name]) for name in stated)
assert math.isclose(sum(of_set.values()) - of_set["matrix"], report["aggregate_area_mm2"], rel_tol=5e-3)
if len(of_set) > 2:
    assert set(of_set) == {"matrix", "aggregate_1_basalt", "aggregate_2_gravel"}, of_set
    assert sorted(sets["aggregates"]) == sorted(n for n, (name, _) in elements.items() if name != "matrix")

# Gmsh's own file, by meshio.
mesh = meshio.read(folder / "result.slice.x.msh")
own = numpy.concatenate([areas(mesh.points, block.data) for block in mesh.cells if block.type == "triangle"])
assert math.isclose(abs(own).sum(), area, rel_tol=1e-9)
assert {"matrix", "itz", "y_min", "z_max"} <= set(mesh.field_data), mesh.field_data
