"""What was saved is read again."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import mixes
import numpy as np
import pytest
from live_server import binary

import packstone
from packstone._sources import FileFormat
from packstone._tabular import ELLIPSOIDS, MIXED, POLYHEDRA
from packstone.local import Local

meshio = pytest.importorskip("meshio")
pd = pytest.importorskip("pandas")
pyvista = pytest.importorskip("pyvista")

MATERIALS = {
    "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2},
    "aggregate": {"youngs_modulus_gpa": 70, "poissons_ratio": 0.2},
}
# Every export but those that need Gmsh, and what is read of its file.
EXPORTS: list[tuple[str, str, dict[str, Any], Any]] = [
    ("mesh", "msh", {"segments": 8}, meshio.Mesh),
    ("mesh", "geo", {}, "gmsh a.geo"),
    ("mesh", "stl", {"segments": 8}, dict),
    ("voxels", "vti", {"cells": 10}, pyvista.ImageData),
    ("voxels", "inp", {"cells": 10}, meshio.Mesh),
    ("voxels", "npy", {"cells": 10}, np.ndarray),
    ("voxels", "vtk", {"for_": "amitex"}, pyvista.ImageData),
    ("voxels", "zip", {"for_": "fans", "cells": 10}, "make_h5.py"),
    ("slice", "svg", {}, packstone.Svg),
    ("slice", "png", {}, "matplotlib.pyplot.imread"),
    ("slice", "json", {}, dict),
    ("slice", "geo", {}, "gmsh a.geo"),
    ("deck", "zip", {"cells": 10}, "packstone solve a.zip"),
    ("ldpm", "chrono", {}, packstone.Lattice),
    ("ldpm", "tets", {}, pyvista.UnstructuredGrid),
    ("ldpm", "facets", {}, pyvista.UnstructuredGrid),
    ("ldpm", "cells", {}, pyvista.UnstructuredGrid),
    ("certificates", "csv", {}, pd.DataFrame),
    ("certificates", "json", {}, dict),
    ("shapes", "csv", {}, pd.DataFrame),
    ("shapes", "json", {}, dict),
    ("quality", "json", {}, dict),
    ("properties", "json", {"cells": 10}, dict),
    ("properties", "vti", {"cells": 10}, pyvista.ImageData),
]
ENDINGS = {"stl": "zip", "chrono": "zip", "tets": "vtu", "facets": "vtu", "cells": "vtu"}


@pytest.fixture(scope="module")
def packing() -> packstone.Packing:
    return packstone.pack(mixes.quick() | {"materials": MATERIALS})


@pytest.mark.parametrize("job", [mixes.quick(), mixes.ellipsoids(), mixes.mixed()])
def test_a_result_is_the_same_packing(job: mixes.Json, tmp_path: Path) -> None:
    packing = packstone.pack(job)
    again = packstone.load(packing.save(tmp_path / "a.json"))
    assert isinstance(again, packstone.Packing)
    assert np.array_equal(again.grains, packing.grains) and again.columns == packing.columns
    assert again.report == packing.report and again.request == packing.request
    assert again.templates() == packing.templates()
    formats: tuple[FileFormat, ...] = ("json", "vtp", "html")
    for format in formats:
        assert again.read(format) == packing.read(format), format
    assert again.read("raw", cells=10) == packing.read("raw", cells=10)


def test_the_stored_form_of_a_service_is_a_packing(packing: packstone.Packing, tmp_path: Path) -> None:
    assert isinstance(packing._source, Local)
    (tmp_path / "blob").write_bytes(packing._source.__getstate__())
    assert np.array_equal(packstone.load(tmp_path / "blob").grains, packing.grains)
    (tmp_path / "blob").write_bytes((tmp_path / "blob").read_bytes()[:-1])
    with pytest.raises(ValueError, match="blob cannot be read: a stored result of"):
        packstone.load(tmp_path / "blob")


ELLIPSOID = {"type": "ellipsoid", "ratios": {"type": "constant", "elongation": 0.8, "flatness": 0.6}}
POLYHEDRON = {"type": "polyhedron", "template_count": 3}


def of_two(shape: mixes.Json | None) -> mixes.Json:
    """Two aggregates of a shape."""
    grading = {"type": "sieves", "points": [[4, 0], [12, 1]]}
    part = {"share": 0.5, "grading": grading} | ({} if shape is None else {"shape": shape})
    return mixes.quick() | {"mix": {"volume_fraction": 0.3, "aggregates": [part, part]}}


@pytest.mark.parametrize("format", ["csv", "npy"])
@pytest.mark.parametrize(
    ("job", "columns"),
    [
        (mixes.ellipsoids(), ELLIPSOIDS),
        (mixes.mixed(), MIXED),
        (of_two(None), ("x_mm", "y_mm", "z_mm", "d_mm", "aggregate")),
        (of_two(ELLIPSOID), (*ELLIPSOIDS, "aggregate")),
        (of_two(POLYHEDRON), (*POLYHEDRA, "aggregate")),
    ],
)
def test_a_table_is_a_packing_with_the_grains_alone(
    format: Any, job: mixes.Json, columns: tuple[str, ...], tmp_path: Path
) -> None:
    packing = packstone.pack(job)
    table = packstone.load(packing.save(tmp_path / f"a.{format}"))
    assert isinstance(table, packstone.Packing)
    assert np.array_equal(table.grains, packing.grains) and table.columns == packing.columns == columns
    assert len(table) == len(packing)
    for again in ("csv", "npy"):
        saved = table.save(tmp_path / f"again.{again}")
        assert np.array_equal(packstone.load(saved).grains, packing.grains)
    assert table.read("csv").splitlines()[0] == packing.read("csv").splitlines()[0]
    with pytest.raises(ValueError, match=rf"a.{format} is a table of grains, .* `packstone export a.csv --spec"):
        table.save(tmp_path / "a.vti")


@pytest.mark.parametrize(("type", "format", "options", "read"), EXPORTS)
def test_every_export_is_read_or_names_its_reader(
    packing: packstone.Packing, tmp_path: Path, type: Any, format: Any, options: dict[str, Any], read: Any
) -> None:
    path = tmp_path / f"a.{ENDINGS.get(format, format)}"
    packing.export(type, path, format=format, **options)
    if isinstance(read, str):
        with pytest.raises(ValueError, match=rf"^{path.name} is .*{read}"):
            packstone.load(path)
    else:
        assert isinstance(packstone.load(path), read)


@pytest.mark.skipif(shutil.which("gmsh") is None, reason="needs Gmsh, which makes tetrahedra and triangles")
@pytest.mark.parametrize(("type", "format"), [("mesh", "inp"), ("mesh", "vtu"), ("slice", "inp"), ("slice", "vtu")])
def test_what_gmsh_fills_is_read(packing: packstone.Packing, tmp_path: Path, type: Any, format: Any) -> None:
    packing.export(type, tmp_path / f"a.{format}", format=format, segments=8)
    mesh = packstone.load(tmp_path / f"a.{format}")
    assert isinstance(mesh, meshio.Mesh if format == "inp" else pyvista.UnstructuredGrid)


def test_the_folder_of_a_deck(packing: packstone.Packing, tmp_path: Path) -> None:
    packing.export("deck", tmp_path / "deck.zip", cells=8)
    with zipfile.ZipFile(tmp_path / "deck.zip") as archive:
        archive.extractall(tmp_path / "deck")
    with pytest.raises(ValueError, match="deck is a deck of a solver: `packstone solve deck`"):
        packstone.load(tmp_path / "deck")
    with pytest.raises(ValueError, match="materials.inp is a part of a deck without a mesh"):
        packstone.load(tmp_path / "deck/materials.inp")
    assert len(packstone.load(tmp_path / "deck/mesh.inp").points) == 9**3
    # As `packstone solve` leaves it.
    (tmp_path / "deck/solution.json").write_text('{"load": "uniaxial_z"}')
    assert packstone.load(tmp_path / "deck") == {"load": "uniaxial_z"}


def test_a_lattice_and_surfaces_are_whole(packing: packstone.Packing, tmp_path: Path) -> None:
    report = packing.export("ldpm", tmp_path / "lattice.zip")
    lattice = packstone.load(tmp_path / "lattice.zip")
    assert len(lattice.nodes) == report["nodes"]["total"] and len(lattice.facets) == report["facets"]
    assert np.allclose(lattice.particles[:, 1:], packing.grains)
    assert lattice.tets.max() == len(lattice.nodes) - 1 and lattice.edges.shape == (report["edges"], 2)
    assert repr(lattice).startswith(f"<Lattice of {len(packing)} grains: ")
    packing.export("mesh", tmp_path / "surfaces.zip", format="stl", segments=8)
    surfaces = packstone.load(tmp_path / "surfaces.zip")
    assert set(surfaces) == {"aggregates", "matrix"}
    assert surfaces["aggregates"].volume == pytest.approx((np.pi / 6 * packing.diameters**3).sum(), rel=1e-4)


def test_tables_of_grains_for_paraview_are_objects_of_pyvista(packing: packstone.Packing, tmp_path: Path) -> None:
    for format in ("vtp", "vtk"):
        points = packstone.load(packing.save(tmp_path / f"a.{format}"))
        assert isinstance(points, pyvista.PolyData) and points.n_points == len(packing)
    assert isinstance(packstone.load(packing.save(tmp_path / "a.html")), packstone.View)
    with pytest.raises(ValueError, match=r"a.view is the form of the viewer: .*Packing.view"):
        packstone.load(packing.save(tmp_path / "a.view"))


def test_the_folder_of_a_run(tmp_path: Path) -> None:
    (tmp_path / "job.json").write_text(json.dumps(mixes.quick()))
    formats = ["--format", "json", "--format", "csv", "--format", "npy"]
    exports = ["--export", "voxels:format=raw,cells=10", "--export", "voxels:format=npy,cells=10", "--picture"]
    run(tmp_path, "run", "job.json", "--out", "all", *formats, *exports)
    packing = packstone.pack(mixes.quick())
    assert np.array_equal(packstone.load(tmp_path / "all").grains, packing.grains)
    assert packstone.load(tmp_path / "all").check == packing.check
    raw = packstone.load(tmp_path / "all/result.cells-10.raw")
    assert np.array_equal(raw, packstone.load(tmp_path / "all/result.cells-10.npy"))
    report = packstone.load(tmp_path / "all/result.cells-10.raw.report.json")
    assert report["shape"] == list(raw.shape)
    (tmp_path / "all/result.cells-10.raw.report.json").unlink()
    with pytest.raises(ValueError, match="numpy.fromfile"):
        packstone.load(tmp_path / "all/result.cells-10.raw")
    assert packstone.load(tmp_path / "job.json") == mixes.quick()
    run(tmp_path, "run", "job.json", "--out", "table", "--format", "npy")
    assert np.array_equal(packstone.load(tmp_path / "table").grains, packing.grains)


STUDY: mixes.Json = {
    "template": mixes.without(mixes.quick(), "seed"),
    "grid": {"/mix/volume_fraction": [0.2, 0.3]},
    "replicates": 2,
    "seed": 11,
}


def test_the_folder_of_a_study(tmp_path: Path) -> None:
    (tmp_path / "study.json").write_text(json.dumps(STUDY))
    run(tmp_path, "study", "study.json", "--out", "runs", "--format", "json")
    study = packstone.load(tmp_path / "runs")
    here = packstone.study(STUDY, keep=True)
    assert isinstance(study, packstone.LocalStudy) and study.packings.keys() == here.packings.keys()
    for place, packing in study.packings.items():
        assert np.array_equal(packing.grains, here.packings[place].grains)
    assert [row["success_rate"] for row in study.table()] == [1, 1]
    assert [row["seed"] for row in study.runs()] == [row["seed"] for row in here.runs()]
    assert study.plot("success").startswith("<svg")
    with (tmp_path / "runs/runs.jsonl").open("r+b") as log:
        log.seek(60)
        byte = log.read(1)[0]
        log.seek(60)
        log.write(bytes([byte ^ 1]))
    with pytest.raises(ValueError, match="runs.jsonl is damaged: the checksum of line 1 is wrong"):
        packstone.load(tmp_path / "runs")


def test_a_study_is_saved_as_the_command_does(tmp_path: Path) -> None:
    study = packstone.study(STUDY, keep=True)
    saved = study.save(tmp_path / "saved")
    again = packstone.load(saved)
    assert again.table() == study.table() and again.runs() == study.runs()
    assert np.array_equal(again.packings[1, 1].grains, study.packings[1, 1].grains)
    with pytest.raises(FileExistsError, match="saved holds a study: choose another folder, or pass overwrite=True"):
        study.save(saved)
    study.save(saved, overwrite=True)
    # The command goes on with it, and finds nothing to do.
    (tmp_path / "study.json").write_text(json.dumps(STUDY))
    run(tmp_path, "study", "study.json", "--out", "saved", "--resume")
    assert packstone.load(saved).table() == study.table()


def test_a_saved_study_keeps_the_errors_of_its_runs(tmp_path: Path) -> None:
    template = mixes.without(mixes.unreachable(), "seed")
    study = packstone.study(template=template, replicates=2, seed=1)
    again = packstone.load(study.save(tmp_path / "saved"))
    assert [run["error"] for run in again.runs()] == ["target-not-reached"] * 2
    (tmp_path / "study.json").write_text(json.dumps({"template": template, "replicates": 2, "seed": 1}))
    run(tmp_path, "study", "study.json", "--out", "saved", "--resume")


def test_the_command_takes_a_table_with_its_job(tmp_path: Path) -> None:
    packing = packstone.pack(mixes.ellipsoids())
    packstone.load(packing.save(tmp_path / "a.npy")).save(tmp_path / "a.csv")
    (tmp_path / "job.json").write_text(json.dumps(packing.request))
    run(tmp_path, "export", "a.csv", "--specimen", "job.json", "voxels:format=npy,cells=10", "--out", "made")
    assert np.array_equal(packstone.load(tmp_path / "made/result.cells-10.npy"), packing.voxels(10))


def test_a_folder_of_packings_is_a_dictionary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = packstone.study(STUDY, keep=True)
    paths = study.save_all(tmp_path / "kept", "npy")
    packings = packstone.load(tmp_path / "kept")
    assert set(packings) == {path.stem for path in paths}
    # Other tables beside them are left to those who ask for them, and need no library here.
    (tmp_path / "kept/notes.csv").write_text("name,value\n")
    monkeypatch.setitem(sys.modules, "pandas", None)
    assert packstone.load(tmp_path / "kept").keys() == packings.keys()
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="empty holds no packing as json, csv or npy and no study, but nothing"):
        packstone.load(tmp_path / "empty")


@pytest.mark.parametrize(
    ("name", "content", "reader"),
    [
        ("a.pkl", b"", "pickle.load"),
        ("a.xlsx", b"", "packstone.Mix.read"),
        ("a.frd", b"", "cgx"),
        ("model.dat", b"", "packstone solve"),
        ("ldpm-data-nodes.dat", b"", "numpy.loadtxt"),
        ("a.packstone", b"PACKSTCK", "packstone.pack"),
        ("a.doc", b"", "must be one of json, csv"),
        ("a.json", b"{", "is damaged or is not JSON"),
        ("a.zip", b"PK", "is damaged"),
    ],
)
def test_other_files_name_their_reader(tmp_path: Path, name: str, content: bytes, reader: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=reader):
        packstone.load(tmp_path / name)


def test_a_missing_file_is_missing(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        packstone.load(tmp_path / "none.json")


def run(folder: Path, *args: str) -> None:
    """Runs the command in a folder."""
    ended = subprocess.run([binary(), *args], cwd=folder, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
