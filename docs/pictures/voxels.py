"""Makes the pictures of docs/voxels.md: python voxels.py DIRECTORY OUT

DIRECTORY has the files that `cargo run --release -p packstone-engine --features examples --example voxels DIRECTORY` wrote, of which
voxels.vti and slice-apart-0.5.geo are read. voxels.png and slice-mesh.png are written to OUT. Needs the wheels `vtk`,
`gmsh`, `matplotlib`, `pillow`.
"""

import sys
from pathlib import Path

import gmsh
import matplotlib
import numpy as np
import vtk
from PIL import Image
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.collections import PolyCollection  # noqa: E402

MATRIX = (0.90, 0.89, 0.86)
GRAINS = [
    (0.80, 0.62, 0.33),
    (0.68, 0.46, 0.28),
    (0.50, 0.54, 0.60),
    (0.28, 0.40, 0.54),
    (0.62, 0.29, 0.21),
    (0.36, 0.32, 0.29),
]
WIDTH, HEIGHT = 1500, 1480
# Rendered larger and averaged, so that edges are smooth.
SCALE = 2
# Brightness of faces by the axis of their normal: side, front, top.
BRIGHTNESS = (0.86, 0.95, 1.0)


def voxels(source: Path, target: Path) -> None:
    """The voxels of all grains, one octant removed, each grain in one of six colours."""
    reader = vtk.vtkXMLImageDataReader()
    reader.SetFileName(str(source))
    reader.Update()
    image = reader.GetOutput()
    labels = vtk_to_numpy(image.GetCellData().GetArray("label")).astype(np.int64)
    colours = np.where(labels == 0, 0, 1 + labels % len(GRAINS)).astype(np.uint8)
    n = [d - 1 for d in image.GetDimensions()]
    z, y, x = np.unravel_index(np.arange(labels.size), n[::-1])
    kept = ~((x >= n[0] // 2) & (y < n[1] // 2) & (z >= n[2] // 2))
    for name, values in (("colour", colours), ("kept", kept.astype(np.uint8))):
        array = numpy_to_vtk(values, deep=True)
        array.SetName(name)
        image.GetCellData().AddArray(array)
    threshold = vtk.vtkThreshold()
    threshold.SetInputData(image)
    threshold.SetInputArrayToProcess(0, 0, 0, vtk.vtkDataObject.FIELD_ASSOCIATION_CELLS, "kept")
    threshold.SetLowerThreshold(0.5)
    surface = vtk.vtkDataSetSurfaceFilter()
    surface.SetInputConnection(threshold.GetOutputPort())

    # Faces have the brightness of their direction instead of a light, so that the faces of the cut are as clear as the
    # outer ones.
    surface.Update()
    faces = surface.GetOutput()
    normals = vtk.vtkPolyDataNormals()
    normals.SetInputData(faces)
    normals.ComputePointNormalsOff()
    normals.ComputeCellNormalsOn()
    normals.ConsistencyOff()
    normals.SplittingOff()
    normals.Update()
    faces = normals.GetOutput()
    axis = np.abs(vtk_to_numpy(faces.GetCellData().GetNormals())).argmax(axis=1)
    palette = np.array([MATRIX, *GRAINS])
    rgb = palette[vtk_to_numpy(faces.GetCellData().GetArray("colour"))] * np.array(BRIGHTNESS)[axis][:, None]
    colour = numpy_to_vtk(np.round(255 * rgb).astype(np.uint8), deep=True)
    colour.SetName("rgb")
    faces.GetCellData().SetScalars(colour)
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputData(faces)
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().LightingOff()
    renderer = vtk.vtkRenderer()
    renderer.SetBackground(1, 1, 1)
    renderer.AddActor(actor)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(SCALE * WIDTH, SCALE * HEIGHT)
    window.AddRenderer(renderer)
    camera = renderer.GetActiveCamera()
    middle = image.GetCenter()
    camera.SetFocalPoint(*middle)
    camera.SetPosition(middle[0] + 4, middle[1] - 5, middle[2] + 3.2)
    camera.SetViewUp(0, 0, 1)
    renderer.ResetCamera()
    camera.Zoom(0.98)
    window.Render()
    picture = vtk.vtkWindowToImageFilter()
    picture.SetInput(window)
    picture.Update()
    pixels = picture.GetOutput()
    width, height, _ = pixels.GetDimensions()
    rows = vtk_to_numpy(pixels.GetPointData().GetScalars()).reshape(height, width, 3)[::-1]
    reduced = Image.fromarray(rows.copy()).resize((WIDTH, HEIGHT), Image.LANCZOS)
    reduced.quantize(64, dither=Image.Dither.NONE).save(target, optimize=True)


def mesh(source: Path, target: Path) -> None:
    """The triangles that Gmsh makes of a cut, by phase, with the interface."""
    gmsh.initialize(["gmsh", "-v", "2"])
    gmsh.open(str(source))
    gmsh.model.mesh.generate(2)
    tags, points, _ = gmsh.model.mesh.getNodes()
    place = dict(zip(tags, points.reshape(-1, 3)[:, :2]))
    figure, axes = plt.subplots(figsize=(7, 7), dpi=270)
    styles = {"matrix": (MATRIX, "#999", 0.25), "aggregates": (GRAINS[1], "#765", 0.25), "itz": ("none", "#a00", 0.8)}
    for dimension, group in sorted(gmsh.model.getPhysicalGroups(), reverse=True):
        name = gmsh.model.getPhysicalName(dimension, group)
        if name not in styles:
            continue
        polygons = []
        for entity in gmsh.model.getEntitiesForPhysicalGroup(dimension, group):
            for _, _, nodes in zip(*gmsh.model.mesh.getElements(dimension, entity)):
                polygons += [[place[node] for node in element] for element in nodes.reshape(-1, dimension + 1)]
        face, edge, width = styles[name]
        axes.add_collection(PolyCollection(polygons, facecolor=face, edgecolor=edge, linewidth=width, closed=dimension == 2))
    # Only a part, so that the triangles are visible.
    axes.set(xlim=(0, 24), ylim=(0, 24), aspect="equal")
    axes.axis("off")
    figure.savefig(target, bbox_inches="tight", pad_inches=0.02)
    gmsh.finalize()
    # A palette of 100 colours makes a third of the bytes.
    with Image.open(target) as picture:
        picture.convert("RGB").quantize(100).save(target, optimize=True)


if __name__ == "__main__":
    source, target = map(Path, sys.argv[1:3])
    voxels(source / "voxels.vti", target / "voxels.png")
    mesh(source / "slice-apart-0.5.geo", target / "slice-mesh.png")
