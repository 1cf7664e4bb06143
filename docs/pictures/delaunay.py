"""Renders the picture of docs/delaunay.md:

    cargo run --release -p packstone-engine --features examples --example delaunay print 1200 | python delaunay.py OUT.png

Needs the wheels `numpy` and `vtk`. Whole tetrahedra are left out where the corner is cut away; what the cut shows is coloured by
the distance of the tetrahedron from the surface, the hull is pale.
"""

import sys

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk


def main(target: str) -> None:
    head, tail = sys.stdin.read().split("\n\n")
    points = np.array([line.split() for line in head.splitlines()], dtype=float)
    tets = np.array([line.split() for line in tail.splitlines()], dtype=int)
    size = points.max(axis=0)
    centres = points[tets].mean(axis=1)
    kept = ~((centres[:, 0] > 0.5 * size[0]) & (centres[:, 1] < 0.5 * size[1]) & (centres[:, 2] > 0.45 * size[2]))

    grid = vtk.vtkUnstructuredGrid()
    coordinates = vtk.vtkPoints()
    coordinates.SetData(numpy_to_vtk(points, deep=True))
    grid.SetPoints(coordinates)
    for tet in tets[kept]:
        grid.InsertNextCell(vtk.VTK_TETRA, 4, tet.tolist())
    depth = np.minimum(centres, size - centres).min(axis=1)[kept]
    array = numpy_to_vtk(depth, deep=True)
    array.SetName("depth")
    grid.GetCellData().SetScalars(array)

    surface = vtk.vtkDataSetSurfaceFilter()
    surface.SetInputData(grid)
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputConnection(surface.GetOutputPort())
    colours = vtk.vtkColorTransferFunction()
    for at, rgb in ((0.0, (0.90, 0.88, 0.82)), (0.08, (0.83, 0.70, 0.50)), (0.35, (0.36, 0.42, 0.50))):
        colours.AddRGBPoint(at * size[0], *rgb)
    mapper.SetLookupTable(colours)
    mapper.SetScalarRange(0, 0.35 * size[0])
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().EdgeVisibilityOn()
    actor.GetProperty().SetEdgeColor(0.25, 0.25, 0.25)
    actor.GetProperty().SetLineWidth(1.0)
    actor.GetProperty().SetAmbient(0.25)
    actor.GetProperty().SetDiffuse(0.75)

    renderer = vtk.vtkRenderer()
    renderer.SetBackground(1, 1, 1)
    renderer.AddActor(actor)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(4)
    window.SetSize(640, 620)
    window.AddRenderer(renderer)
    camera = renderer.GetActiveCamera()
    camera.SetFocalPoint(*(size / 2))
    camera.SetPosition(*(size / 2 + np.array([4, -5, 3.2])))
    camera.SetViewUp(0, 0, 1)
    renderer.ResetCamera()
    camera.Zoom(1.0)
    window.Render()

    image = vtk.vtkWindowToImageFilter()
    image.SetInput(window)
    writer = vtk.vtkPNGWriter()
    writer.SetCompressionLevel(9)
    writer.SetFileName(target)
    writer.SetInputConnection(image.GetOutputPort())
    writer.Write()


if __name__ == "__main__":
    main(sys.argv[1])
