"""Reads voxel models and cuts of a packing with the programs that they are for, and compares them with its reports.

    python read_slices_and_voxels.py DIRECTORY

DIRECTORY holds a subdirectory per packing with voxels.vti, voxels.raw, voxels.inp (or no voxels) and slice-AXIS.svg,
.png, .json, .geo, each with a report NAME.EXTENSION.json. Prints one line and exits 0 when all agree; says what differs and exits 1 otherwise.
"""

import json
import math
import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import gmsh
import meshio
import numpy as np
from PIL import Image
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow
from vtkmodules.vtkIOXML import vtkXMLImageDataReader

from provenance import PROVENANCE

SEGMENTS = 24
SVG = "{http://www.w3.org/2000/svg}"


def expect(holds, what, *figures):
    """Ends the program unless something holds."""
    if not holds:
        sys.exit(f"{what}: {', '.join(map(repr, figures))}")


def report_of(path):
    """What the program said beside a file."""
    return json.loads(path.with_name(path.name + ".json").read_text())


def read_raw(path):
    """Labels of a headerless file as its report describes them: z, y, x."""
    report = report_of(path)
    labels = np.fromfile(path, dtype=np.dtype(report["dtype"])).reshape(report["shape"][::-1])
    outside = report["outside_label"]
    inside = labels != outside if outside is not None else np.ones(labels.shape, dtype=bool)
    expect(inside.sum() == report["inside_voxels"], path, inside.sum(), report["inside_voxels"])
    aggregate = ((labels != 0) & inside).sum()
    expect(aggregate == report["aggregate_voxels"], path, aggregate, report["aggregate_voxels"])
    fraction = aggregate / inside.sum()
    expect(abs(fraction - report["volume_fraction_labels"]) < 1e-12, path, fraction)
    expect(abs(report["volume_fraction_labels"] / report["volume_fraction"] - 1) < 0.03, path, report)
    return labels


def fields_of(data_set):
    """Field data by name; each array has one value."""
    data = data_set.GetFieldData()
    names = [data.GetArrayName(i) for i in range(data.GetNumberOfArrays())]
    return {name: data.GetAbstractArray(name).GetValue(0) for name in names}


def check_vti(path, labels):
    """VTK sees the labels, their place, and shares that add up to the volume."""
    report = report_of(path)
    messages = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(messages)
    reader = vtkXMLImageDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    expect(not messages.GetOutput(), path, messages.GetOutput())
    image = reader.GetOutput()
    expect(fields_of(image) == PROVENANCE, path, fields_of(image))
    expect([n - 1 for n in image.GetDimensions()] == report["shape"], path, image.GetDimensions())
    expect(list(image.GetSpacing()) == report["spacing_mm"], path, image.GetSpacing())
    expect(list(image.GetOrigin()) == report["origin_mm"], path, image.GetOrigin())
    cells = image.GetCellData()
    seen = vtk_to_numpy(cells.GetArray("label")).reshape(labels.shape)
    expect(seen.dtype == labels.dtype and np.array_equal(seen, labels), path, seen.dtype)
    shares = vtk_to_numpy(cells.GetArray("fraction")).astype(np.float64)
    expect(shares.min() >= 0 and shares.max() == 1, path, shares.min(), shares.max())
    voxel = math.prod(report["spacing_mm"])
    fraction = shares.sum() * voxel / report["specimen_volume_mm3"]
    expect(abs(fraction / report["volume_fraction_samples"] - 1) < 1e-6, path, fraction)
    expect(abs(fraction / report["volume_fraction"] - 1) < 1e-3, path, fraction, report["volume_fraction"])


def check_inp(path, labels):
    """meshio sees hexahedra of positive volume that fill the specimen, phase by phase, and the sets of its faces."""
    report = report_of(path)
    mesh = meshio.read(path)
    volumes = {}
    for name in ["matrix", "aggregates"]:
        expect(name in mesh.cell_sets, path, name, list(mesh.cell_sets))
        volumes[name] = 0.0
        for block, members in zip(mesh.cells, mesh.cell_sets[name]):
            expect(block.type == "hexahedron", path, block.type)
            corners = mesh.points[block.data[np.asarray(members, dtype=int)]]
            if len(corners):
                a, b, c = (corners[:, i] - corners[:, 0] for i in (1, 3, 4))
                each = np.einsum("ij,ij->i", np.cross(a, b), c)
                expect(each.min() > 0, path, each.min())
                volumes[name] += each.sum()
    fraction = volumes["aggregates"] / sum(volumes.values())
    expect(abs(fraction - report["volume_fraction_labels"]) < 1e-12, path, fraction)
    expect((labels == 1).sum() == report["aggregate_voxels"], path, (labels == 1).sum())
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    for name, nodes in mesh.point_sets.items():
        if name != "side":
            axis = "xyz".index(name[0])
            expected = (low if name.endswith("min") else high)[axis]
            on_face = np.flatnonzero(mesh.points[:, axis] == expected)
            expect(np.array_equal(np.sort(nodes), on_face), path, name)
    expect(len(mesh.point_sets) in (3, 6), path, list(mesh.point_sets))
    # meshio reads no surfaces.
    surfaces = set(re.findall(r"\*SURFACE, TYPE=ELEMENT, NAME=(\w+)", path.read_text()))
    expect(surfaces == {"itz", *mesh.point_sets}, path, surfaces)


def numbers_of_ellipse(ellipse):
    """Centre, semi-axes, and the angle and centre of the rotation of an ellipse that is drawn."""
    turned = re.fullmatch(r"rotate\((\S+) (\S+) (\S+)\)", ellipse.get("transform")).groups()
    return [float(x) for x in (*(ellipse.get(k) for k in ("cx", "cy", "rx", "ry")), *turned)]


def check_svg(path, cut):
    """The drawing is well-formed, of full scale, and has every circle in its place."""
    root = ElementTree.parse(path).getroot()
    _, _, *size = map(float, root.get("viewBox").split())
    expect([f"{x:g}mm" for x in size] == [f"{float(root.get(k)[:-2]):g}mm" for k in ("width", "height")], path, size)
    group = next(g for g in root.iter(f"{SVG}g") if g.get("id") == "aggregates")
    outline = cut["outline"]
    if outline["type"] == "disc":
        left, top = (c + s * outline["radius_mm"] for c, s in zip(outline["center_mm"], (-1, 1)))
    else:
        left, top = outline["u_mm"][0], outline["v_mm"][1]
    if "polygons" in cut:
        drawn = [[tuple(map(float, pair.split(","))) for pair in p.get("points").split()] for p in group]
        expected = [[(u - left, top - v) for u, v in row[-1]] for row in cut["polygons"]["rows"]]
        expect([len(p) for p in drawn] == [len(p) for p in expected], path, len(drawn), len(expected))
        for one, other in zip(drawn, expected):
            expect(np.abs(np.array(one) - np.array(other)).max() < 1e-4, path, one, other)
        return
    if "ellipses" in cut:
        drawn = np.array([numbers_of_ellipse(e) for e in group]).reshape(-1, 7)
    else:
        drawn = np.array([[float(c.get(k)) for k in ("cx", "cy", "r")] for c in group]).reshape(-1, 3)
    if "ellipses" in cut:
        rows = np.array(cut["ellipses"]["rows"]).reshape(-1, 8)
        u, v, a, b, angle = rows[:, :5].T
        expected = np.column_stack([u - left, top - v, a, b, -angle, u - left, top - v])
    else:
        rows = np.array(cut["circles"]["rows"]).reshape(-1, 6)
        expected = np.column_stack([rows[:, 0] - left, top - rows[:, 1], rows[:, 2]])
    expect(drawn.shape == expected.shape and np.abs(drawn - expected).max() < 1e-4, path, len(drawn), len(rows))


def check_png(path, cut):
    """The mean grey of the picture is the area fraction."""
    with Image.open(path) as image:
        pixels = np.asarray(image).astype(np.float64)
        dpi = image.info["dpi"]
    report = report_of(path)
    grey, opacity = (pixels[..., 0], pixels[..., 1] / 255) if pixels.ndim == 3 else (pixels, np.ones(pixels.shape))
    expect(list(grey.shape[::-1]) == report["image"]["pixels"], path, grey.shape)
    share = ((255 - grey) / 127 * opacity).sum() / opacity.sum()
    expect(abs(share - cut["area_fraction"]) < 1e-3, path, share, cut["area_fraction"])
    expect(abs(dpi[0] * report["image"]["pixel_mm"][0] / 25.4 - 1) < 1e-3, path, dpi)


def check_geo(path, cut):
    """Gmsh meshes the cut; the groups are there, share their nodes, and have the areas of the circles."""
    gmsh.initialize(["gmsh", "-v", "2"])
    gmsh.onelab.setNumber("Segments per circumference", [SEGMENTS])
    gmsh.open(str(path))
    gmsh.model.mesh.generate(2)
    errors = gmsh.logger.getLastError()
    expect(not errors, path, errors)
    groups = {gmsh.model.getPhysicalName(d, tag): (d, tag) for d, tag in gmsh.model.getPhysicalGroups()}
    edges = ["side"] if cut["outline"]["type"] == "disc" else [f"{a}_{e}" for a in cut["plane"] for e in ("min", "max")]
    if "side" in groups and cut["outline"]["type"] != "disc":
        edges = ["side", "z_min", "z_max"]
    expect(set(groups) == {"matrix", "aggregates", "itz", *edges}, path, sorted(groups))

    areas, nodes, least_gamma = {}, {}, 1.0
    for name, (dimension, tag) in groups.items():
        nodes[name] = set(gmsh.model.mesh.getNodesForPhysicalGroup(dimension, tag)[0])
        areas[name] = 0.0
        for entity in gmsh.model.getEntitiesForPhysicalGroup(dimension, tag):
            for kind, tags, _ in zip(*gmsh.model.mesh.getElements(dimension, entity)):
                measure = "volume"
                expect(kind in (1, 2), path, kind)
                areas[name] += sum(gmsh.model.mesh.getElementQualities(tags, measure))
                if kind == 2:
                    least_gamma = min(least_gamma, *gmsh.model.mesh.getElementQualities(tags, "gamma"))
    # The edges of a periodic cut divide sections in parts of any width.
    if "polyhedra" in path.parts[-2] and "periodic" not in path.parts[-2]:
        expect(least_gamma > 0.05, path, least_gamma)
    # What both phases have in common is the interface, but for its ends on the outline.
    shared = nodes["matrix"] & nodes["aggregates"]
    expect(nodes["itz"] == shared, path, len(nodes["itz"]), len(shared))
    total = areas["matrix"] + areas["aggregates"]
    # Polygons of at least so many sides lie in their circles, in that of a disc too.
    polygon = math.sin(2 * math.pi / SEGMENTS) / (2 * math.pi / SEGMENTS)
    expect(polygon - 1e-6 <= total / cut["area_mm2"] <= 1 + 1e-9, path, total, cut["area_mm2"])
    found, exact = areas["aggregates"], cut["aggregate_area_mm2"]
    if cut["circle_count"]:
        # Polygons of the area of the circles; those that the edges of a periodic cut clip have it nearly.
        expect(abs(found / exact - 1) < (2e-3 if "periodic" in str(path) else 1e-9), path, found, exact)
    expect(polygon - 1e-6 <= found / exact <= 1 + 2e-3, path, found, exact)
    if cut["outline"]["type"] == "rectangle":
        (u0, u1), (v0, v1) = cut["outline"]["u_mm"], cut["outline"]["v_mm"]
        around = sum(areas[edge] for edge in edges)
        expect(abs(around / (2 * (u1 - u0 + v1 - v0)) - 1) < 1e-9, path, around)
    gmsh.finalize()


def main(directory):
    packings = sorted(path for path in directory.iterdir() if path.is_dir())
    for packing in packings:
        if (packing / "voxels.raw").exists():
            labels = read_raw(packing / "voxels.raw")
            check_vti(packing / "voxels.vti", labels)
            check_inp(packing / "voxels.inp", read_raw(packing / "coarse.raw"))
        for axis in "xyz":
            cut = json.loads((packing / f"slice-{axis}.json").read_text())
            sections = cut.get("polygons") or cut.get("ellipses") or cut["circles"]
            area = sections["columns"].index("area_mm2")
            expect(abs(sum(row[area] for row in sections["rows"]) / cut["area_mm2"] - cut["area_fraction"]) < 1e-12, axis)
            check_svg(packing / f"slice-{axis}.svg", cut)
            check_png(packing / f"slice-{axis}.png", cut)
            check_geo(packing / f"slice-{axis}.geo", cut)
    print(f"{len(packings)} packings agree in vti, raw, inp, svg, png, json and geo")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
