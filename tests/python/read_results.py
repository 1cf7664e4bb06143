"""Reads every form of one result with the readers that users have, and compares them with its JSON.

    python read_results.py DIRECTORY

DIRECTORY holds result.json, .csv, .vtk, .vtp and .npy of one packing. Prints one line and exits 0 when all agree to the
last bit; says what differs and exits 1 otherwise.
"""

import csv
import json
import sys
from pathlib import Path

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow
from vtkmodules.vtkIOLegacy import vtkPolyDataReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader


def read_vtk(reader, path):
    """The points, arrays and number of vertex cells that a VTK reader sees, which must not complain."""
    messages = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(messages)
    reader.SetFileName(str(path))
    reader.Update()
    complaint = messages.GetOutput()
    if complaint:
        sys.exit(f"{path.name}: the reader complains: {complaint}")
    data = reader.GetOutput()
    point_data = data.GetPointData()
    arrays = {
        point_data.GetArrayName(i): vtk_to_numpy(point_data.GetArray(i)) for i in range(point_data.GetNumberOfArrays())
    }
    return vtk_to_numpy(data.GetPoints().GetData()), arrays, data.GetNumberOfVerts()


def check_fields(path, result):
    """VTK finds in the field data of an XML file where the packing comes from."""
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput().GetFieldData()
    names = [data.GetArrayName(i) for i in range(data.GetNumberOfArrays())]
    found = {name: data.GetAbstractArray(name).GetValue(0) for name in names}
    expected = {
        "engine_version": result["engine"]["version"],
        "seed": result["request"]["seed"],
        "volume_fraction_mixture": result["summary"]["volume_fraction_mixture"],
        "volume_fraction_effective": result["summary"]["volume_fraction_effective"],
    }
    if "name" in result["request"]:
        expected["name"] = result["request"]["name"]
    if found != expected:
        sys.exit(f"{path.name}: field data {found}, expected {expected}")


def equal(what, found, expected):
    """Ends the program unless two arrays are of one shape and equal in every number."""
    if found.shape != expected.shape:
        sys.exit(f"{what}: {found.shape} numbers, expected {expected.shape}")
    if not np.array_equal(found, expected):
        at = np.argwhere(found != expected)[0]
        sys.exit(f"{what}: differs at {at}: {found[tuple(at)]!r}, expected {expected[tuple(at)]!r}")


def expected_classes(summary, diameters):
    """The size class of every grain, counted from fine to coarse."""
    uppers = np.array([size_class["d_max_mm"] for size_class in summary["classes"]])
    classes = np.searchsorted(uppers, diameters, side="right")
    # A grain of exactly the largest diameter belongs to the last class.
    return np.minimum(classes, len(uppers) - 1)


def main(directory):
    result = json.loads((directory / "result.json").read_text())
    spheres = np.array(result["grains"]["rows"], dtype=np.float64).reshape(-1, 4)
    points, diameters = spheres[:, :3], spheres[:, 3]
    if len(spheres) != result["summary"]["grains"]:
        sys.exit("json: another number of spheres than the summary says")

    npy = np.load(directory / "result.npy", allow_pickle=False)
    equal("npy", npy, spheres)

    with (directory / "result.csv").open(newline="") as lines:
        header, *rows = csv.reader(lines)
    if header != ["x_mm", "y_mm", "z_mm", "d_mm"]:
        sys.exit(f"csv: another header line: {header}")
    equal("csv", np.array([[float(x) for x in row] for row in rows]).reshape(-1, 4), spheres)

    legacy = vtkPolyDataReader()
    # As ParaView and PyVista do: by default this reader takes the first of several scalar arrays only.
    for reader, name in [(vtkXMLPolyDataReader(), "result.vtp"), (legacy, "result.vtk")]:
        seen, arrays, vertices = read_vtk(reader, directory / name)
        if seen.dtype != np.float64:
            sys.exit(f"{name}: points of {seen.dtype}")
        equal(f"{name} points", seen, points)
        equal(f"{name} diameter", arrays["diameter"], diameters)
        equal(f"{name} radius", arrays["radius"], diameters / 2)
        equal(f"{name} id", arrays["id"], np.arange(len(spheres)))
        equal(f"{name} sieve_class", arrays["sieve_class"], expected_classes(result["summary"], diameters))
        # Without a vertex per point ParaView shows nothing until a glyph filter is applied.
        if vertices != len(spheres):
            sys.exit(f"{name}: {vertices} vertices for {len(spheres)} points")
    check_fields(directory / "result.vtp", result)
    print(f"{len(spheres)} spheres agree in json, csv, npy, vtp and vtk")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
