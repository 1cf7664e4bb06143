"""Renders a packing from its .vtp as the pictures of the documentation are: python render.py IN.vtp OUT.png

Needs the wheel `vtk`. Grains are spheres coloured by sieve class; a quarter of the specimen is cut away.
"""

import sys

import vtk


def main(source: str, target: str) -> None:
    reader = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(source)
    reader.Update()
    points = reader.GetOutput()
    bounds = points.GetBounds()
    middle = [(bounds[2 * axis] + bounds[2 * axis + 1]) / 2 for axis in range(3)]

    sphere = vtk.vtkSphereSource()
    sphere.SetRadius(0.5)
    sphere.SetThetaResolution(20)
    sphere.SetPhiResolution(20)

    # Grains whose centre lies in the quarter towards the camera are left out.
    corner = vtk.vtkBox()
    corner.SetBounds(middle[0], 1e9, -1e9, middle[1], middle[2], 1e9)
    outside = vtk.vtkExtractPolyDataGeometry()
    outside.SetInputConnection(reader.GetOutputPort())
    outside.SetImplicitFunction(corner)
    outside.ExtractInsideOff()

    mapper = vtk.vtkGlyph3DMapper()
    mapper.SetInputConnection(outside.GetOutputPort())
    mapper.SetSourceConnection(sphere.GetOutputPort())
    mapper.SetScaleArray("diameter")
    mapper.SetScaleModeToScaleByMagnitude()
    mapper.SetScalarModeToUsePointFieldData()
    mapper.SelectColorArray("sieve_class")
    classes = points.GetPointData().GetArray("sieve_class").GetRange()
    colours = vtk.vtkLookupTable()
    palette = [(0.86, 0.78, 0.62), (0.72, 0.58, 0.42), (0.55, 0.55, 0.58), (0.36, 0.42, 0.50), (0.62, 0.36, 0.28), (0.30, 0.30, 0.32)]
    count = int(classes[1]) + 1
    colours.SetNumberOfTableValues(count)
    for i in range(count):
        colours.SetTableValue(i, *palette[i % len(palette)])
    mapper.SetLookupTable(colours)
    mapper.SetScalarRange(0, count - 1)

    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().SetSpecular(0.15)
    outline = vtk.vtkOutlineFilter()
    outline.SetInputConnection(reader.GetOutputPort())
    outline_mapper = vtk.vtkPolyDataMapper()
    outline_mapper.SetInputConnection(outline.GetOutputPort())
    frame = vtk.vtkActor()
    frame.SetMapper(outline_mapper)
    frame.GetProperty().SetColor(0.4, 0.4, 0.4)

    renderer = vtk.vtkRenderer()
    renderer.SetBackground(1, 1, 1)
    renderer.AddActor(actor)
    renderer.AddActor(frame)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(8)
    window.SetSize(900, 860)
    window.AddRenderer(renderer)
    camera = renderer.GetActiveCamera()
    camera.SetFocalPoint(*middle)
    camera.SetPosition(middle[0] + 4, middle[1] - 5, middle[2] + 3.2)
    camera.SetViewUp(0, 0, 1)
    renderer.ResetCamera()
    camera.Zoom(1.08)
    window.Render()

    image = vtk.vtkWindowToImageFilter()
    image.SetInput(window)
    writer = vtk.vtkPNGWriter()
    writer.SetFileName(target)
    writer.SetInputConnection(image.GetOutputPort())
    writer.Write()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
