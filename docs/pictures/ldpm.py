"""Renders the picture of docs/ldpm.md from cells.vtu: python ldpm.py OUT.png CELLS.vtu [CELLS.vtu ...]

Needs the wheels `vtk` and `pillow`. One view for each file: cells of grains by diameter, cells of the surface grey. Cells
in the octant towards the camera are left out; their grains are drawn as spheres.
"""

import sys

import numpy as np
import vtk
from PIL import Image
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

WIDTH, HEIGHT = 900, 900
# Rendered larger and averaged, so that lines and edges are smooth.
SCALE = 2


def cells(source: str) -> vtk.vtkUnstructuredGrid:
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(source)
    reader.Update()
    return reader.GetOutput()


def colours() -> vtk.vtkLookupTable:
    table = vtk.vtkLookupTable()
    table.SetNumberOfTableValues(256)
    low, high = np.array([0.93, 0.83, 0.62]), np.array([0.45, 0.22, 0.14])
    for i in range(256):
        table.SetTableValue(i, *(low + (high - low) * i / 255))
    table.SetBelowRangeColor(0.84, 0.86, 0.89, 1.0)
    table.UseBelowRangeColorOn()
    return table


def view(grid: vtk.vtkUnstructuredGrid) -> vtk.vtkRenderer:
    data = grid.GetCellData()
    diameter = vtk_to_numpy(data.GetArray("diameter"))
    center = vtk_to_numpy(data.GetArray("center_of_mass"))
    bounds = np.array(grid.GetBounds()).reshape(3, 2)
    middle = bounds.mean(axis=1)
    # The camera is at large x, small y, large z.
    left_out = (center[:, 0] > middle[0]) & (center[:, 1] < middle[1]) & (center[:, 2] > middle[2])
    low, high = diameter[diameter > 0].min(), diameter.max()

    renderer = vtk.vtkRenderer()
    renderer.SetBackground(1, 1, 1)
    light = vtk.vtkLightKit()
    light.SetKeyLightIntensity(1.0)
    light.SetKeyToFillRatio(1.8)
    light.SetKeyToHeadRatio(2.5)
    light.AddLightsToRenderer(renderer)
    table = colours()

    kept = vtk.vtkExtractCells()
    kept.SetInputData(grid)
    ids = vtk.vtkIdList()
    for cell in np.flatnonzero(~left_out):
        ids.InsertNextId(int(cell))
    kept.SetCellList(ids)
    surface = vtk.vtkGeometryFilter()
    surface.SetInputConnection(kept.GetOutputPort())
    normals = vtk.vtkPolyDataNormals()
    normals.SetInputConnection(surface.GetOutputPort())
    normals.SplittingOn()
    normals.SetFeatureAngle(10)
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputConnection(normals.GetOutputPort())
    mapper.SetScalarModeToUseCellFieldData()
    mapper.SelectColorArray("diameter")
    mapper.SetLookupTable(table)
    mapper.SetScalarRange(low, high)
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().EdgeVisibilityOn()
    actor.GetProperty().SetEdgeColor(0.42, 0.42, 0.44)
    actor.GetProperty().SetLineWidth(0.6 * SCALE)
    renderer.AddActor(actor)

    grains = np.flatnonzero(left_out & (diameter > 0))
    points = vtk.vtkPoints()
    # A cell's centre of mass is near its grain's centre; good enough for a picture.
    points.SetData(numpy_to_vtk(center[grains].copy(), deep=True))
    spheres = vtk.vtkPolyData()
    spheres.SetPoints(points)
    sizes = numpy_to_vtk(diameter[grains].copy(), deep=True)
    sizes.SetName("diameter")
    spheres.GetPointData().AddArray(sizes)
    ball = vtk.vtkSphereSource()
    ball.SetRadius(0.5)
    ball.SetThetaResolution(64)
    ball.SetPhiResolution(64)
    glyphs = vtk.vtkGlyph3DMapper()
    glyphs.SetInputData(spheres)
    glyphs.SetSourceConnection(ball.GetOutputPort())
    glyphs.SetScaleArray("diameter")
    glyphs.SetScaleModeToScaleByMagnitude()
    glyphs.SetScalarModeToUsePointFieldData()
    glyphs.SelectColorArray("diameter")
    glyphs.SetLookupTable(table)
    glyphs.SetScalarRange(low, high)
    balls = vtk.vtkActor()
    balls.SetMapper(glyphs)
    renderer.AddActor(balls)

    camera = renderer.GetActiveCamera()
    camera.SetFocalPoint(*middle)
    camera.SetPosition(*(middle + np.array([1.0, -1.5, 1.1]) * np.ptp(bounds, axis=1).max()))
    camera.SetViewUp(0, 0, 1)
    renderer.ResetCamera()
    camera.Zoom(1.12)
    return renderer


def main(target: str, sources: list[str]) -> None:
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(SCALE * WIDTH * len(sources), SCALE * HEIGHT)
    for i, source in enumerate(sources):
        renderer = view(cells(source))
        renderer.SetViewport(i / len(sources), 0, (i + 1) / len(sources), 1)
        window.AddRenderer(renderer)
    window.Render()
    picture = vtk.vtkWindowToImageFilter()
    picture.SetInput(window)
    picture.Update()
    pixels = picture.GetOutput()
    width, height, _ = pixels.GetDimensions()
    rows = vtk_to_numpy(pixels.GetPointData().GetScalars()).reshape(height, width, 3)[::-1]
    picture = Image.fromarray(rows.copy()).resize((WIDTH * len(sources), HEIGHT), Image.LANCZOS)
    # A palette makes a third of the bytes.
    picture.quantize(128).save(target, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
