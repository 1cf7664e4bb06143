"""Opens the voxels of one packing with the programs that they are written for, and compares the numbers.

    python read_voxels_of_programs.py DIRECTORY

DIRECTORY holds labels.npy of a packing in a box (0 matrix, 1 and 2 aggregates) and, of the same voxels, damask.vti,
amitex.vtk, automesh.npy and fans.zip, each with a report NAME.EXTENSION.report.json. Prints one line and exits 0 when
all agree; says what differs and exits 1 otherwise.
"""

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import automesh
import damask
import h5py
import meshio
import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOLegacy import vtkStructuredPointsReader


def expect(holds, what, *figures):
    """Ends the program unless something holds."""
    if not holds:
        sys.exit(f"{what}: {', '.join(map(repr, figures))}")


def read_damask(path, labels, size_mm):
    """DAMASK's own reader: SI units, numbers from 0."""
    grid = damask.GeomGrid.load(path)
    expect(np.array_equal(grid.material, labels), path, "other materials")
    expect(np.issubdtype(grid.material.dtype, np.integer), path, grid.material.dtype)
    expect(np.allclose(grid.size, size_mm / 1000, rtol=1e-12), path, grid.size, size_mm)
    expect(np.allclose(grid.origin, 0), path, grid.origin)
    # DAMASK_grid takes these alone.
    text = path.read_text()
    expect('type="Int64" Name="material" format="binary"' in text and "compressor" not in text, path, text[:500])


def read_amitex(path, labels, size_mm):
    """VTK's reader, and the ten lines of the head that AMITEX asks for."""
    lines = path.read_bytes().split(b"\n", 10)
    expect(lines[8] == b"SCALARS MaterialId unsigned_char" and len(lines[10]) == labels.size, path, lines[:10])
    reader = vtkStructuredPointsReader()
    reader.SetFileName(str(path))
    reader.Update()
    image = reader.GetOutput()
    cells = np.array(image.GetDimensions()) - 1
    expect(tuple(cells) == labels.shape, path, cells, labels.shape)
    expect(np.allclose(cells * image.GetSpacing(), size_mm, rtol=1e-6), path, image.GetSpacing())
    numbers = vtk_to_numpy(image.GetCellData().GetArray("MaterialId")).reshape(cells, order="F")
    expect(np.array_equal(numbers, labels + 1), path, "other numbers")
    expect(np.array_equal(np.unique(numbers), np.arange(1, numbers.max() + 1)), path, np.unique(numbers))


def read_automesh(path, labels, size_mm):
    """The hexahedra that automesh makes: where they lie, and their blocks."""
    spacing = size_mm / labels.shape
    mesh = path.with_suffix(".inp")
    voxels = automesh.Voxels.from_npy(str(path))
    voxels.as_finite_elements([0], list(spacing), [0, 0, 0]).write_inp(str(mesh))
    read = meshio.read(mesh)
    found = np.zeros(labels.shape, dtype=int)
    for block, number in zip(read.cells, (1, 2, 3), strict=True):
        # Coordinates have seven digits.
        places = np.floor(read.points[block.data].mean(axis=1) / spacing + 1e-3).astype(int)
        found[tuple(places.T)] = number
    expect(np.array_equal(found, labels + 1), path, "other blocks")


def read_fans(path, labels, size_mm):
    """The HDF5 file that the script makes, as the reader of FANS takes it."""
    folder = path.with_suffix("")
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    subprocess.run([sys.executable, "make_h5.py"], cwd=folder, check=True)
    given = json.loads((folder / "input.json").read_text())
    of = given["microstructure"]
    expect(np.allclose(of["L"], size_mm), path, of)
    with h5py.File(folder / of["filepath"]) as file:
        data = file[of["datasetname"]]
        expect(data.attrs["permute_order"] == "zyx" and data.dtype == np.uint16, path, data.dtype)
        expect(np.array_equal(np.transpose(data[:]), labels), path, "other labels")
    (material,) = given["materials"]
    expect(material["phases"] == [0, 1, 2], path, material)
    # 25 GPa and 0.2, 70 GPa and 0.25, a pore: E / 3 (1 - 2 nu) and E / 2 (1 + nu) in MPa.
    properties = material["material_properties"]
    expect(np.allclose(properties["bulk_modulus"], [25e3 / 1.8, 70e3 / 1.5, 0]), path, properties)
    expect(np.allclose(properties["shear_modulus"], [25e3 / 2.4, 70e3 / 2.5, 0]), path, properties)


def main():
    """Reads all."""
    folder = Path(sys.argv[1])
    labels = np.load(folder / "labels.npy")
    report = json.loads((folder / "labels.npy.report.json").read_text())
    size_mm = np.array(report["shape"]) * report["spacing_mm"]
    expect(list(labels.shape) == report["shape"] and labels.dtype == np.uint8, "labels.npy", labels.shape)
    counts = [report["inside_voxels"] - report["aggregate_voxels"], *(a["voxels"] for a in report["aggregates"])]
    expect(np.array_equal(np.bincount(labels.ravel()), counts), "labels.npy", counts)
    read_damask(folder / "damask.vti", labels.astype(int), size_mm)
    read_amitex(folder / "amitex.vtk", labels.astype(int), size_mm)
    read_automesh(folder / "automesh.npy", labels.astype(int), size_mm)
    read_fans(folder / "fans.zip", labels.astype(int), size_mm)
    print(f"{labels.size} voxels agree in all files")


if __name__ == "__main__":
    main()
