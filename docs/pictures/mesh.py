"""Renders a filled mesh as docs/meshes.md shows it: python mesh.py FILLED.msh OUT.png

FILLED.msh is what Gmsh saved after filling a packing. Needs the wheels gmsh, vtk, numpy and pillow. The part in front of
the cut is removed along a plane, so that the cut shows the sections of the tetrahedra; aggregates are brown, the matrix
is grey.
"""

import sys

import gmsh
import numpy as np
import vtk
from PIL import Image
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy

COLOURS = [(0.86, 0.86, 0.85), (0.76, 0.55, 0.36)]
WIDTH, HEIGHT = 1600, 1450
# Rendered larger and averaged, which no multisampling matches for thin lines.
SCALE = 2


def read(source):
    """The tetrahedra and their phase as a VTK grid."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.merge(source)
    tags, places, _ = gmsh.model.mesh.getNodes()
    row_of = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    row_of[tags] = np.arange(len(tags))
    cells, phases = [], []
    for _, group in gmsh.model.getPhysicalGroups(3):
        phase = gmsh.model.getPhysicalName(3, group) == "aggregates"
        for entity in gmsh.model.getEntitiesForPhysicalGroup(3, group):
            _, _, nodes = gmsh.model.mesh.getElements(3, entity)
            corners = row_of[nodes[0].astype(np.int64)].reshape(-1, 4)
            cells.append(corners)
            phases.append(np.full(len(corners), float(phase)))
    gmsh.finalize()
    cells, phases = np.concatenate(cells), np.concatenate(phases)
    points = vtk.vtkPoints()
    points.SetData(numpy_to_vtk(places.reshape(-1, 3).copy(), deep=True))
    array = vtk.vtkCellArray()
    array.SetData(4, numpy_to_vtkIdTypeArray(cells.ravel(), deep=True))
    grid = vtk.vtkUnstructuredGrid()
    grid.SetPoints(points)
    grid.SetCells(vtk.VTK_TETRA, array)
    phase = numpy_to_vtk(phases, deep=True)
    phase.SetName("phase")
    grid.GetCellData().SetScalars(phase)
    return grid


def section(grid, plane):
    """The sections of the tetrahedra with a plane, as polygons."""
    cutter = vtk.vtkCutter()
    cutter.SetInputData(grid)
    cutter.SetCutFunction(plane)
    cutter.GenerateTrianglesOff()
    cutter.Update()
    return cutter.GetOutput()


def outside(grid, plane):
    """The outer surface of the tetrahedra behind the plane."""
    surface = vtk.vtkGeometryFilter()
    surface.SetInputData(grid)
    clip = vtk.vtkClipPolyData()
    clip.SetInputConnection(surface.GetOutputPort())
    clip.SetClipFunction(plane)
    clip.Update()
    return clip.GetOutput()


def actor_of(surface, line_width):
    colours = vtk.vtkLookupTable()
    colours.SetNumberOfTableValues(2)
    for phase, colour in enumerate(COLOURS):
        colours.SetTableValue(phase, *colour)
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputData(surface)
    mapper.SetLookupTable(colours)
    mapper.SetScalarRange(0, 1)
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    style = actor.GetProperty()
    style.SetEdgeVisibility(True)
    style.SetEdgeColor(0.35, 0.33, 0.32)
    style.SetLineWidth(line_width)
    style.LightingOff()
    return actor


def main(source, target):
    grid = read(source)
    low, high = np.reshape(grid.GetBounds(), (3, 2)).T
    middle = (low + high) / 2
    plane = vtk.vtkPlane()
    plane.SetOrigin(*middle)
    plane.SetNormal(0, 1, 0)
    renderer = vtk.vtkRenderer()
    renderer.SetBackground(1, 1, 1)
    renderer.AddActor(actor_of(section(grid, plane), 1.0 * SCALE))
    shell = actor_of(outside(grid, plane), 0.5 * SCALE)
    shell.GetProperty().SetColor(0.7, 0.7, 0.7)
    shell.GetMapper().ScalarVisibilityOff()
    renderer.AddActor(shell)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(SCALE * WIDTH, SCALE * HEIGHT)
    window.AddRenderer(renderer)
    camera = renderer.GetActiveCamera()
    camera.SetFocalPoint(*middle)
    camera.SetPosition(middle[0] + 1.4, middle[1] - 5, middle[2] + 1.5)
    camera.SetViewUp(0, 0, 1)
    camera.ParallelProjectionOn()
    renderer.ResetCamera()
    camera.Zoom(1.25)
    window.Render()
    image = vtk.vtkWindowToImageFilter()
    image.SetInput(window)
    image.Update()
    pixels = image.GetOutput()
    width, height, _ = pixels.GetDimensions()
    rows = vtk_to_numpy(pixels.GetPointData().GetScalars()).reshape(height, width, 3)[::-1]
    picture = Image.fromarray(rows.copy()).resize((WIDTH, HEIGHT), Image.LANCZOS)
    # Few colours keep the file small.
    picture.quantize(64, dither=Image.Dither.NONE).save(target, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
