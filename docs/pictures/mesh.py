"""Renders a filled mesh as docs/meshes.md shows it: python mesh.py FILLED.msh OUT.png

FILLED.msh is what Gmsh saved after filling a packing. Needs the wheels gmsh, vtk, numpy and pillow. The
tetrahedra behind the cut stay whole; aggregates are brown, the matrix is grey.
"""

import sys

import gmsh
import numpy as np
import vtk
from PIL import Image
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray

COLOURS = [(0.78, 0.79, 0.80), (0.66, 0.47, 0.30)]


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


def main(source, target):
    grid = read(source)
    low, high = np.reshape(grid.GetBounds(), (3, 2)).T
    middle = (low + high) / 2
    # The half towards the camera is taken off, tetrahedron by tetrahedron.
    half = vtk.vtkBox()
    half.SetBounds(low[0] - 1, high[0] + 1, low[1] - 1, middle[1], low[2] - 1, high[2] + 1)
    rest = vtk.vtkExtractGeometry()
    rest.SetInputData(grid)
    rest.SetImplicitFunction(half)
    rest.ExtractInsideOff()
    rest.ExtractBoundaryCellsOn()
    surface = vtk.vtkGeometryFilter()
    surface.SetInputConnection(rest.GetOutputPort())
    colours = vtk.vtkLookupTable()
    colours.SetNumberOfTableValues(2)
    for phase, colour in enumerate(COLOURS):
        colours.SetTableValue(phase, *colour)
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputConnection(surface.GetOutputPort())
    mapper.SetLookupTable(colours)
    mapper.SetScalarRange(0, 1)
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    look = actor.GetProperty()
    look.SetEdgeVisibility(True)
    look.SetEdgeColor(0.3, 0.3, 0.3)
    look.SetLineWidth(0.8)
    look.SetInterpolationToFlat()
    look.SetAmbient(0.25)
    renderer = vtk.vtkRenderer()
    renderer.SetBackground(1, 1, 1)
    renderer.AddActor(actor)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(8)
    window.SetSize(860, 760)
    window.AddRenderer(renderer)
    camera = renderer.GetActiveCamera()
    camera.SetFocalPoint(*middle)
    camera.SetPosition(middle[0] + 1.2, middle[1] - 5, middle[2] + 1.5)
    camera.SetViewUp(0, 0, 1)
    renderer.ResetCamera()
    camera.Zoom(1.25)
    window.Render()
    image = vtk.vtkWindowToImageFilter()
    image.SetInput(window)
    writer = vtk.vtkPNGWriter()
    writer.SetFileName(target)
    writer.SetInputConnection(image.GetOutputPort())
    writer.Write()
    # A few colours do, and keep the file small.
    Image.open(target).convert("RGB").quantize(32).save(target, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
