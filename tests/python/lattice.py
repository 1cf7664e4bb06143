"""Reads the files of a lattice as other programs do, and recomputes from its nodes all that follows from them.

    python lattice.py DIRECTORY VOLUME_MM3

DIRECTORY holds chrono.zip, tets.vtu, facets.vtu and cells.vtu of one lattice; VOLUME_MM3 is what its cells must add up to.
Prints one line and exits 0 when all agree; says what differs and exits 1 otherwise.
"""

import json
import sys
import zipfile
from pathlib import Path

import meshio
import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray, vtk_to_numpy
from vtkmodules.util.vtkConstants import VTK_UNSIGNED_CHAR
from vtkmodules.vtkCommonCore import vtkIdList, vtkOutputWindow, vtkStringOutputWindow
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkFiltersCore import vtkMultiObjectMassProperties
from vtkmodules.vtkFiltersVerdict import vtkCellSizeFilter
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

from provenance import PROVENANCE

EDGES = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
# The workbench's order: face (opposite that node) and edge of each of the twelve facets.
FACETS = [(2, 0), (3, 0), (1, 1), (3, 1), (1, 2), (2, 2), (0, 3), (3, 3), (0, 4), (2, 4), (0, 5), (1, 5)]


def near(what, found, expected, tolerance):
    """Ends the program unless two arrays agree."""
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    if found.shape != expected.shape:
        sys.exit(f"{what}: {found.shape} numbers, expected {expected.shape}")
    worst = np.abs(found - expected).max(initial=0.0)
    if not worst <= tolerance:
        sys.exit(f"{what}: differs by {worst}, more than {tolerance}")


def read_dat(archive, suffix):
    """A file as ChBuilderLDPM reads it: lines that begin with a slash are skipped, all others are numbers."""
    lines = archive.read(f"ldpm-data-{suffix}.dat").decode("ascii").splitlines()
    return np.array([line.split() for line in lines if line[0] != "/"], dtype=float)


def half_way(start, centers, radii):
    """Half way from points to the surfaces of spheres."""
    to_center = centers - start
    distance = np.linalg.norm(to_center, axis=1)[:, None]
    return start + to_center / distance * (distance - radii[:, None]) / 2


def tessellate(points, radii, tets):
    """Points of edges, faces and tetrahedra, straight from the papers' formulas."""
    x, r = points[tets], radii[tets]
    edges = []
    for i, j in EDGES:
        along = x[:, j] - x[:, i]
        length = np.linalg.norm(along, axis=1)
        edges.append(x[:, i] + ((length + r[:, i] - r[:, j]) / (2 * length))[:, None] * along)
    faces = []
    for opposite in range(4):
        corners = [k for k in range(4) if k != opposite]
        parts = []
        for corner in corners:
            pair = tuple(k for k in corners if k != corner)
            parts.append(half_way(edges[EDGES.index(pair)], x[:, corner], r[:, corner]))
        faces.append(sum(parts) / 3)
    middle = sum(half_way(faces[k], x[:, k], r[:, k]) for k in range(4)) / 4
    return edges, faces, middle


def check_chrono(directory, volume):
    """The files that Project Chrono reads. Returns nodes, radii, tetrahedra and volumes of cells."""
    archive = zipfile.ZipFile(directory / "chrono.zip")
    if (bad := archive.testzip()) is not None:
        sys.exit(f"zip: {bad} is damaged")
    summary = json.loads(archive.read("summary.json"))
    report, options = summary["report"], summary["options"]
    points, particles = read_dat(archive, "nodes"), read_dat(archive, "particles")
    tets = read_dat(archive, "tets").astype(int)
    facets, vertices = read_dat(archive, "facets"), read_dat(archive, "facetsVertices")
    edges, surface = read_dat(archive, "edges").astype(int), read_dat(archive, "faceFacets")
    grains = len(particles)
    near("particles", particles[:, 1:4], points[len(points) - grains :], 0)
    radii = np.full(len(points), options["surface_radius"] * particles[:, 4].min())
    radii[len(points) - grains :] = particles[:, 4] / 2
    if len(facets) != 12 * len(tets) or len(vertices) != 3 * len(facets):
        sys.exit("facets: another number than twelve for each tetrahedron")

    rows = np.arange(len(facets))
    near("facets: tetrahedra", facets[:, 0], rows // 12, 0)
    near("facets: vertices", facets[:, 1:4], 3 * rows[:, None] + [0, 1, 2], 0)
    near("facets: material", facets[:, 18], 0 * rows, 0)
    edge_points, face_points, middle = tessellate(points, radii, tets)
    corners = vertices[facets[:, 1:4].astype(int)].reshape(len(tets), 12, 3, 3)
    facets = facets.reshape(len(tets), 12, 19)
    size = np.abs(points).max()
    cells = np.zeros(len(points))
    for k, (face, edge) in enumerate(FACETS):
        i, j = EDGES[edge]
        t, f, e = middle, face_points[face], edge_points[edge]
        near(f"facet {k}: vertices", corners[:, k], np.stack([t, f, e], axis=1), 1e-9 * size)
        along = points[tets[:, j]] - points[tets[:, i]]
        normal = along / np.linalg.norm(along, axis=1)[:, None]
        area = np.cross(f - t, e - t) / 2
        volumes = [
            np.abs(np.einsum("ij,ij->i", t - points[tets[:, n]], np.cross(f - points[tets[:, n]], e - points[tets[:, n]]))) / 6
            for n in (i, j)
        ]
        near(f"facet {k}: Vol", facets[:, k, 4], volumes[0] + volumes[1], 1e-8)
        near(f"facet {k}: pArea", facets[:, k, 5], np.abs(np.einsum("ij,ij->i", area, normal)), 1e-8)
        near(f"facet {k}: centre", facets[:, k, 6:9], (t + f + e) / 3, 1e-9 * size)
        frame = facets[:, k, 9:18].reshape(-1, 3, 3)
        near(f"facet {k}: normal", frame[:, 0], normal, 1e-9)
        near(f"facet {k}: frame", frame @ frame.transpose(0, 2, 1), np.broadcast_to(np.eye(3), frame.shape), 1e-8)
        near(f"facet {k}: frame's hand", np.linalg.det(frame), np.ones(len(tets)), 1e-8)
        # Which side is which follows from the order of nodes: edge, face, tetrahedron.
        third = next(n for n in range(4) if n not in (i, j, face))
        parity = np.linalg.det(np.eye(4)[[i, j, third, face]])
        for n, sign in ((i, parity), (j, -parity)):
            own = points[tets[:, n]]
            pieces = np.einsum("ij,ij->i", e - own, np.cross(f - own, t - own)) / 6
            np.add.at(cells, tets[:, n], sign * pieces)
    near("cells: sum", cells.sum(), volume, 1e-11 * volume)
    if cells.min() <= 0:
        sys.exit("cells: one without volume")

    unique = np.unique(np.sort(tets[:, EDGES].reshape(-1, 2), axis=1), axis=0)
    near("edges", edges, unique, 0)
    outward = np.cross(surface[:, 4:7] - surface[:, 1:4], surface[:, 7:10] - surface[:, 1:4]) / 2
    near("faceFacets: closed", outward.sum(axis=0), np.zeros(3), 1e-7 * np.abs(outward).sum())
    enclosed = np.einsum("ij,ij->", surface[:, 1:4], outward) / 3
    near("faceFacets: volume", enclosed, volume, 1e-8 * volume)
    near("faceFacets: nodes", surface[:, 1:4], points[surface[:, 0].astype(int)], 1e-9 * size)
    near("report: tetrahedra", [report["tetrahedra"], report["nodes"]["total"]], [len(tets), len(points)], 0)
    return points, radii, tets, cells, corners


def read_vtu(path):
    """The grid that VTK reads, which must not complain."""
    messages = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(messages)
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    if messages.GetOutput():
        sys.exit(f"{path.name}: the reader complains: {messages.GetOutput()}")
    grid = reader.GetOutput()
    if fields_of(grid) != PROVENANCE:
        sys.exit(f"{path.name}: field data {fields_of(grid)}")
    return grid


def field(array):
    """A value of field data; text is written as its codes."""
    codes = array.GetDataType() == VTK_UNSIGNED_CHAR
    return bytes(vtk_to_numpy(array)).decode() if codes else array.GetValue(0)


def fields_of(data_set):
    """Field data by name."""
    data = data_set.GetFieldData()
    return {data.GetArrayName(i): field(data.GetArray(i)) for i in range(data.GetNumberOfArrays())}


def arrays(data):
    """Arrays of point or cell data by name."""
    return {data.GetArrayName(i): vtk_to_numpy(data.GetArray(i)) for i in range(data.GetNumberOfArrays())}


def sizes(grid, name):
    """Areas or volumes of cells as VTK computes them."""
    sizer = vtkCellSizeFilter()
    sizer.SetInputData(grid)
    sizer.Update()
    return arrays(sizer.GetOutput().GetCellData())[name]


def enclosed_volumes(points, objects):
    """Volumes inside lists of triangles as VTK computes them. (Its filter for sizes of cells takes polyhedra for convex.)"""
    triangles = np.concatenate(objects).astype(np.int64)
    cells = vtkCellArray()
    cells.SetData(3, numpy_to_vtkIdTypeArray(triangles.ravel(), deep=True))
    surface = vtkPolyData()
    surface.SetPoints(points)
    surface.SetPolys(cells)
    ids = numpy_to_vtkIdTypeArray(np.repeat(np.arange(len(objects)), [len(o) for o in objects]), deep=True)
    ids.SetName("ObjectIds")
    surface.GetCellData().AddArray(ids)
    measure = vtkMultiObjectMassProperties()
    measure.SetInputData(surface)
    # Neighbours share their points, which its own search for objects would take for one.
    measure.SkipValidityCheckOn()
    measure.Update()
    return vtk_to_numpy(measure.GetOutput().GetFieldData().GetArray("ObjectVolumes"))


def check_grids(directory, points, radii, tets, cells, corners, volume):
    """The three unstructured grids."""
    grid = read_vtu(directory / "tets.vtu")
    near("tets.vtu: points", vtk_to_numpy(grid.GetPoints().GetData()), points, 0)
    near("tets.vtu: tetrahedra", vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, 4), tets, 0)
    data = arrays(grid.GetPointData())
    near("tets.vtu: radius", data["radius"], radii, 1e-12)
    near("tets.vtu: cell_volume", data["cell_volume"], cells, 1e-9)
    on_surface = len(points) - (data["grain"] >= 0).sum()
    near("tets.vtu: grain", data["grain"], np.maximum(np.arange(len(points)) - on_surface, -1), 0)
    near("tets.vtu: diameter", data["diameter"], np.where(data["grain"] < 0, 0, 2 * radii), 1e-12)
    volumes = sizes(grid, "Volume")
    near("tets.vtu: volume", arrays(grid.GetCellData())["volume"], volumes, 1e-9)
    near("tets.vtu: sum", volumes.sum(), volume, 1e-11 * volume)
    mesh = meshio.read(directory / "tets.vtu")
    near("tets.vtu in meshio", mesh.cells_dict["tetra"], tets, 0)

    grid = read_vtu(directory / "facets.vtu")
    shared = vtk_to_numpy(grid.GetPoints().GetData())
    triangles = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, 3)
    near("facets.vtu: corners", shared[triangles].reshape(corners.shape), corners, 1e-9 * np.abs(points).max())
    data = arrays(grid.GetCellData())
    near("facets.vtu: area", data["area"], sizes(grid, "Area"), 1e-9)
    near("facets.vtu: tetrahedron", data["tetrahedron"], np.arange(len(triangles)) // 12, 0)
    ends = points[data["nodes"]]
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    near("facets.vtu: normal", data["normal"], along / length[:, None], 1e-12)
    near("facets.vtu: tangents", np.cross(data["tangent_1"], data["tangent_2"]), data["normal"], 1e-12)
    # The identity of a facet: a third of projected area times distance is the volume at its two sides.
    near("facets.vtu: volume", data["volume"], data["projected_area"] * length / 3, 1e-9)
    near("facets.vtu: sum", data["volume"].sum(), volume, 1e-11 * volume)
    mesh = meshio.read(directory / "facets.vtu")
    near("facets.vtu in meshio", mesh.cells_dict["triangle"], triangles, 0)

    grid = read_vtu(directory / "cells.vtu")
    if grid.GetNumberOfCells() != len(points) or set(vtk_to_numpy(grid.GetCellTypes())) != {42}:
        sys.exit("cells.vtu: not one polyhedron for each node")
    shared = vtk_to_numpy(grid.GetPoints().GetData())
    data = arrays(grid.GetCellData())
    stream, seen, triangles = vtkIdList(), np.zeros(len(points)), []
    for cell in range(len(points)):
        grid.GetFaceStream(cell, stream)
        faces = np.array([stream.GetId(k) for k in range(1, stream.GetNumberOfIds())]).reshape(-1, 4)
        if len(faces) != stream.GetId(0) or (faces[:, 0] != 3).any():
            sys.exit(f"cells.vtu: cell {cell} is not of triangles")
        edges = np.concatenate([faces[:, [1, 2]], faces[:, [2, 3]], faces[:, [3, 1]]])
        # Closed and of one orientation: each edge once in each direction.
        if len(np.unique(edges, axis=0)) != len(edges) or set(map(tuple, edges)) != set(map(tuple, edges[:, ::-1])):
            sys.exit(f"cells.vtu: cell {cell} is not closed")
        used = grid.GetCell(cell).GetPointIds()
        ids = {used.GetId(k) for k in range(used.GetNumberOfIds())}
        if ids != set(faces[:, 1:].ravel()) or len(ids) != used.GetNumberOfIds():
            sys.exit(f"cells.vtu: cell {cell} has other points than its faces")
        a, b, c = (shared[faces[:, k]] - points[cell] for k in (1, 2, 3))
        seen[cell] = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
        triangles.append(faces[:, 1:])
    near("cells.vtu: volume", data["volume"], seen, 1e-9)
    near("cells.vtu: sum", seen.sum(), volume, 1e-11 * volume)
    near("cells.vtu: volume by VTK", enclosed_volumes(grid.GetPoints(), triangles), seen, 1e-9)
    near("cells.vtu: diameter", data["diameter"], np.where(data["grain"] < 0, 0, 2 * radii), 1e-12)
    center = (data["volume"][:, None] * data["center_of_mass"]).sum(axis=0) / volume
    of_tets = (volumes[:, None] * points[tets].mean(axis=1)).sum(axis=0) / volume
    near("cells.vtu: center of mass", center, of_tets, 1e-9)


def main(directory, volume):
    points, radii, tets, cells, corners = check_chrono(directory, volume)
    check_grids(directory, points, radii, tets, cells, corners, volume)
    print(f"{len(points)} nodes, {len(tets)} tetrahedra and {12 * len(tets)} facets agree")


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]))
