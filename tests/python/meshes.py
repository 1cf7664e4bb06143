"""Meshes what the engine wrote with Gmsh, and reads its STL with VTK and meshio.

    python meshes.py DIRECTORY

DIRECTORY holds one folder per packing, with packing.msh and its script.geo, packing.geo, packing.zip and expected.json; of polyhedra also grains.vtp, grains.vtk and grains.json. Prints one line per packing and exits 0 when all is well; says what is wrong and exits 1 otherwise.
"""

import json
import math
import sys
import zipfile
from collections import Counter
from pathlib import Path

import gmsh
import meshio
import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkFiltersCore import vtkFeatureEdges, vtkMassProperties, vtkTriangleFilter
from vtkmodules.vtkIOGeometry import vtkSTLReader
from vtkmodules.vtkIOLegacy import vtkPolyDataReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

TRIANGLE, TETRAHEDRON = 2, 4


def groups(dimension):
    """Entities of the physical groups, by name."""
    return {
        gmsh.model.getPhysicalName(dimension, tag): list(gmsh.model.getEntitiesForPhysicalGroup(dimension, tag))
        for _, tag in gmsh.model.getPhysicalGroups(dimension)
    }


def aggregate_groups(expected):
    """Names of the groups that the grains are in."""
    return list(expected.get("aggregates_by_group", ["aggregates"]))


def elements(dimension, entities, kind):
    """Tags and nodes of the elements of one kind on entities."""
    tags, nodes = [], []
    for entity in entities:
        kinds, tags_of, nodes_of = gmsh.model.mesh.getElements(dimension, entity)
        for k, t, n in zip(kinds, tags_of, nodes_of):
            if k != kind:
                sys.exit(f"element type {k} on entity {entity} of dimension {dimension}")
            tags.append(t)
            nodes.append(n)
    return np.concatenate(tags), np.concatenate(nodes).reshape(-1, dimension + 1)


def faces_of(tetrahedra):
    """The faces of tetrahedra as sorted rows."""
    corners = ([0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3])
    return np.sort(np.concatenate([tetrahedra[:, three] for three in corners]), axis=1)


def check_gmsh(path, expected, least_gamma, rounding, of_aggregates=None):
    """Fills a file with tetrahedra as the documentation tells, and looks at what came out."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.merge(str(path))
    if path.suffix == ".msh":
        gmsh.model.mesh.createGeometry(gmsh.model.getEntities(3))
        gmsh.option.setNumber("Mesh.Algorithm3D", 10)
    gmsh.logger.start()
    gmsh.model.mesh.generate(3)
    complaints = [line for line in gmsh.logger.get() if line.startswith(("Warning", "Error"))]
    gmsh.logger.stop()
    if complaints:
        sys.exit(f"{path}: Gmsh complains: {complaints}")

    volumes, surfaces = groups(3), groups(2)
    if "aggregates_by_group" in expected:
        by_group = {name: volumes.pop(name, []) for name in expected["aggregates_by_group"]}
        if {name: len(entities) for name, entities in by_group.items()} != expected["aggregates_by_group"]:
            sys.exit(f"{path}: {by_group}, expected {expected['aggregates_by_group']}")
        volumes["aggregates"] = sum(by_group.values(), [])
    if set(volumes) != {"matrix", "aggregates"} or set(surfaces) != {"itz", *expected["faces"]}:
        sys.exit(f"{path}: groups {sorted(volumes)} and {sorted(surfaces)}")
    # Polyhedra of the kernel have a surface for each face.
    surplus = len(surfaces["itz"]) - expected["grains"]
    if len(volumes["aggregates"]) != expected["grains"] or surplus < 0 or (surplus and path.name != "packing.geo"):
        sys.exit(f"{path}: {len(volumes['aggregates'])} volumes of aggregate")

    seen, of_phase, gammas = {}, {}, []
    for phase, entities in volumes.items():
        tags, nodes = elements(3, entities, TETRAHEDRON)
        of_phase[phase] = nodes
        seen[phase] = float(np.sum(gmsh.model.mesh.getElementQualities(tags, "volume")))
        gammas.append(gmsh.model.mesh.getElementQualities(tags, "gamma"))
    gammas = np.concatenate(gammas)
    tolerances = {"aggregates": of_aggregates or rounding, "specimen": rounding}
    for name, volume in [("aggregates", seen["aggregates"]), ("specimen", sum(seen.values()))]:
        if not math.isclose(volume, expected[f"{name}_mm3"], rel_tol=tolerances[name]):
            sys.exit(f"{path}: {name} of {volume} mm3, expected {expected[f'{name}_mm3']}")
    if gammas.min() < least_gamma:
        sys.exit(f"{path}: smallest gamma {gammas.min():.4f}")
    if np.mean(gammas < 0.05) > expected["most_flat"]:
        sys.exit(f"{path}: {np.sum(gammas < 0.05)} of {len(gammas)} tetrahedra have a gamma below 0.05")

    # Conforming: the faces that both phases have are the triangles of the itz, the others those of the specimen.
    matrix, aggregates = (Counter(map(tuple, faces_of(of_phase[phase]))) for phase in ("matrix", "aggregates"))
    shared = {face for face, met in aggregates.items() if met == 1}
    outer = {face for face, met in matrix.items() if met == 1} - shared
    for name, faces, entities in [
        ("itz", shared, surfaces["itz"]),
        ("faces", outer, [e for face in expected["faces"] for e in surfaces[face]]),
    ]:
        _, nodes = elements(2, entities, TRIANGLE)
        if set(map(tuple, np.sort(nodes, axis=1))) != faces:
            sys.exit(f"{path}: {name} are not the boundary of the tetrahedra")
    for face, (axis, at) in expected["planes"].items():
        _, nodes = elements(2, surfaces[face], TRIANGLE)
        places = [gmsh.model.mesh.getNode(node)[0][axis] for node in np.unique(nodes)]
        if not np.allclose(places, at, atol=1e-9):
            sys.exit(f"{path}: {face} lies at {places[0]}")

    # What Gmsh saves must have its tetrahedra and groups when others read it.
    saved = path.with_name("saved-" + path.stem + ".msh")
    gmsh.write(str(saved))
    gmsh.finalize()
    read = meshio.read(saved)
    count = sum(len(block.data) for block in read.cells if block.type == "tetra")
    if count != len(gammas) or not {"matrix", "itz", *aggregate_groups(expected)} <= set(read.field_data):
        sys.exit(f"{path}: {count} of {len(gammas)} tetrahedra came back from the saved mesh")
    return f"{len(gammas)} tetrahedra, smallest gamma {gammas.min():.3f}"


def check_geo(path, expected):
    """Fills the solids of the kernel, which has seams and poles, where triangles come out as they may.

    The specimen's surface is as coarse; the volume of the grains is that of the report.
    """
    of_geo = {**expected, "aggregates_mm3": expected["aggregates_of_geo_mm3"]}
    return check_gmsh(path, of_geo, least_gamma=0.03, rounding=0.15, of_aggregates=0.002)


def check_as_written(path, expected):
    """Reads the file as it was written, without Gmsh: its triangles, groups, and the volume inside the specimen."""
    read = meshio.read(path)
    names = {"matrix", "itz", "edges", *aggregate_groups(expected), *expected["faces"]}
    if set(read.field_data) != names:
        sys.exit(f"{path}: meshio finds the groups {sorted(read.field_data)}")
    tag = {name: int(read.field_data[name][0]) for name in names}
    inside = {"faces": 0.0, "itz": 0.0}
    lines = 0
    for block, groups_of in zip(read.cells, read.cell_data["gmsh:physical"]):
        if block.type == "line":
            lines += len(block.data)
            if set(groups_of) != {tag["edges"]}:
                sys.exit(f"{path}: lines in the groups {set(groups_of)}")
        elif block.type == "triangle":
            a, b, c = np.moveaxis(read.points[block.data], 1, 0)
            on = "itz" if groups_of[0] == tag["itz"] else "faces"
            inside[on] += float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
    for on, volume in [("itz", expected["aggregates_mm3"]), ("faces", expected["specimen_mm3"])]:
        if not math.isclose(inside[on], volume, rel_tol=1e-9):
            sys.exit(f"{path}: {inside[on]} mm3 within {on}, expected {volume}")
    if not lines:
        sys.exit(f"{path}: no lines along the edges")


def check_stl(path, expected):
    """Reads both surfaces with two readers; they must be closed, and have their volume inside."""
    with zipfile.ZipFile(path) as archive:
        parts = [f"{name}.stl" for name in aggregate_groups(expected)]
        if archive.namelist() != [*parts, "matrix.stl"] or archive.testzip():
            sys.exit(f"{path}: {archive.namelist()}")
        archive.extractall(path.parent)
    aggregates = expected["aggregates_mm3"]
    volumes = expected.get("volumes_by_group", {"aggregates": aggregates})
    for name, volume in {**volumes, "matrix": expected["specimen_mm3"] - aggregates}.items():
        source = path.parent / f"{name}.stl"
        reader = vtkSTLReader()
        reader.SetFileName(str(source))
        edges = vtkFeatureEdges()
        edges.SetInputConnection(reader.GetOutputPort())
        edges.FeatureEdgesOff()
        edges.Update()
        if edges.GetOutput().GetNumberOfCells():
            sys.exit(f"{source}: {edges.GetOutput().GetNumberOfCells()} edges of one triangle or of more than two")
        properties = vtkMassProperties()
        properties.SetInputConnection(reader.GetOutputPort())
        properties.Update()
        mesh = meshio.read(source)
        a, b, c = np.moveaxis(mesh.points[mesh.cells_dict["triangle"]].astype(np.float64), 1, 0)
        signed = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
        if not math.isclose(signed, volume, rel_tol=1e-4):
            sys.exit(f"{source}: {signed} mm3 inside, expected {volume}")
        if reader.GetOutput().GetNumberOfCells() != len(mesh.cells_dict["triangle"]):
            sys.exit(f"{source}: VTK and meshio count differently")


def check_surfaces(folder):
    """Reads the grains as polygons: closed, with the volume of the grains, and with the number and size of each."""
    expected = json.loads((folder / "grains.json").read_text())
    for reader, name in [(vtkXMLPolyDataReader(), "grains.vtp"), (vtkPolyDataReader(), "grains.vtk")]:
        path = folder / name
        reader.SetFileName(str(path))
        reader.Update()
        surfaces = reader.GetOutput()
        cells = surfaces.GetCellData()
        ids = vtk_to_numpy(cells.GetArray("id"))
        grains = len(expected["diameters_mm"])
        if surfaces.GetNumberOfPolys() != len(ids) or set(ids) != set(range(grains)):
            sys.exit(f"{path}: {surfaces.GetNumberOfPolys()} polygons of the grains {sorted(set(ids))}")
        if expected["sharp"] and len(ids) != expected["faces"]:
            sys.exit(f"{path}: {len(ids)} polygons, and {expected['faces']} faces")
        for array, values in [("diameter", expected["diameters_mm"]), ("template", expected["templates"])]:
            if not np.array_equal(vtk_to_numpy(cells.GetArray(array)), np.array(values)[ids]):
                sys.exit(f"{path}: other values of {array}")
        if not (vtk_to_numpy(cells.GetArray("sieve")) > 0).all():
            sys.exit(f"{path}: no sieve sizes")
        edges = vtkFeatureEdges()
        edges.SetInputData(surfaces)
        edges.FeatureEdgesOff()
        edges.Update()
        if edges.GetOutput().GetNumberOfCells():
            sys.exit(f"{path}: {edges.GetOutput().GetNumberOfCells()} edges of one polygon or of more than two")
        triangles = vtkTriangleFilter()
        triangles.SetInputData(surfaces)
        properties = vtkMassProperties()
        properties.SetInputConnection(triangles.GetOutputPort())
        properties.Update()
        share = properties.GetVolume() / expected["volume_mm3"]
        if not 1 - 1e-9 < share < 1 + 1e-9:
            sys.exit(f"{path}: {share} of the volume")


def main(directory):
    for folder in sorted(path for path in directory.iterdir() if path.is_dir()):
        expected = json.loads((folder / "expected.json").read_text())
        check_as_written(folder / "packing.msh", expected)
        least_gamma = expected["least_gamma"]
        msh = check_gmsh(folder / "packing.msh", expected, least_gamma, rounding=1e-9)
        script = check_gmsh(folder / "script.geo", expected, least_gamma, rounding=1e-9)
        if script != msh:
            sys.exit(f"{folder}: {msh}, but by the script {script}")
        geo = check_geo(folder / "packing.geo", expected)
        check_stl(folder / "packing.zip", expected)
        surfaces = ""
        if (folder / "grains.vtp").exists():
            check_surfaces(folder)
            surfaces = "; surfaces in vtp and vtk"
        print(f"{folder.name}: msh {msh}; geo {geo}; stl closed{surfaces}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
