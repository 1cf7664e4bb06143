"""Packings of a service as arrays, tables and files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mixes
import numpy as np
import packstone
import pytest
from faulty_proxy import CutAfter, FaultyProxy
from packstone._tabular import MIXED
from packstone._sources import FileFormat


@pytest.fixture
def result(client: packstone.Client) -> packstone.Packing:
    return client.submit(mixes.quick()).result()


def test_arrays_tables_and_files_agree(result: packstone.Packing, tmp_path: Path) -> None:
    spheres = result.grains
    assert spheres.shape == (result.summary["grains"], 4) and spheres.dtype == np.float64
    assert (np.diff(spheres[:, 3]) <= 0).all(), "largest first"
    written = json.loads(result.save(tmp_path / "packing.json").read_text())
    assert np.array_equal(spheres, np.array(written["grains"]["rows"]))
    assert written["summary"] == result.summary == result.report["summary"]
    table = result.to_dataframe()
    assert list(table.columns) == ["x_mm", "y_mm", "z_mm", "d_mm"]
    assert np.array_equal(table.to_numpy(), spheres)


def test_the_aggregate_of_each_grain_is_a_column(client: packstone.Client) -> None:
    gravel = packstone.Aggregate(0.6, packstone.Grading.sieves([(4, 0), (12, 1)]), name="gravel")
    beads = packstone.Aggregate(0.4, packstone.Grading.monodisperse(5))
    mix = packstone.Mix(volume_fraction=0.3, aggregates=[gravel, beads])
    result = client.submit(mixes.quick() | {"mix": mix}).result()
    table = result.to_dataframe()
    assert list(table.columns) == ["x_mm", "y_mm", "z_mm", "d_mm", "aggregate"]
    counted = [aggregate["grains"] for aggregate in result.summary.get("aggregates", [])]
    assert counted == table.groupby("aggregate").size().to_list()
    assert (table["d_mm"][table["aggregate"] == 1] == 5).all()


@pytest.mark.parametrize(
    ("name", "format", "head"),
    [
        ("a.csv", None, b"x_mm,y_mm,z_mm,d_mm"),
        ("a.VTP", None, b"<?xml"),
        ("a.vtk", None, b"# vtk DataFile"),
        ("a.npy", None, b"\x93NUMPY"),
        ("a.txt", "csv", b"x_mm"),
    ],
)
def test_files_in_every_format(
    result: packstone.Packing, tmp_path: Path, name: str, format: FileFormat | None, head: bytes
) -> None:
    saved = result.save(tmp_path / name, format)
    assert saved == tmp_path / name
    assert saved.read_bytes().startswith(head)


def test_an_unknown_suffix_is_refused(result: packstone.Packing, tmp_path: Path) -> None:
    for name in ("a.ply", "a"):
        with pytest.raises(ValueError, match="is not a format of packings: must be one of json, csv"):
            result.save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_folders_are_created(result: packstone.Packing, tmp_path: Path) -> None:
    assert result.save(tmp_path / "no" / "folder" / "a.csv").exists()


def test_other_libraries_take_the_grains(result: packstone.Packing) -> None:
    for library in ("pyvista", "meshio", "trimesh"):
        pytest.importorskip(library)
    grains = result.grains
    points = result.to_pyvista()
    assert np.array_equal(points.points, grains[:, :3].astype(points.points.dtype))
    assert np.array_equal(points["diameter_mm"], grains[:, 3])
    surfaces = result.to_pyvista("surfaces", resolution=8)
    assert surfaces.n_cells > 8 * len(grains)
    top = (grains[:, 2] + grains[:, 3] / 2).max()
    assert surfaces.bounds[5] == pytest.approx(top, abs=1e-3)
    mesh = result.to_meshio(segments=8)
    assert mesh.cells_dict["triangle"].shape[1] == 3 and {"aggregates", "matrix"} <= set(mesh.cell_sets)
    assert result.to_pyvista("mesh", segments=8).n_points == len(mesh.points)
    volume = (np.pi / 6 * grains[:, 3] ** 3).sum()
    surface = result.to_trimesh(segments=8)
    assert surface.is_watertight and surface.volume == pytest.approx(volume, rel=1e-4)
    voxels = result.voxels(20)
    image = result.to_pyvista("voxels", cells=20)
    assert voxels.shape == (20, 20, 20) and image.dimensions == (21, 21, 21)
    assert voxels.mean() == pytest.approx(volume / 40**3, rel=0.1)
    # The first index counts along x.
    centre = (grains[0, :3] / 2).astype(int)
    assert result.voxels(20, label="grain")[tuple(centre)] == 1
    with pytest.raises(ValueError, match="kind: 'spheres' is unknown: must be one of points, surfaces, voxels, mesh"):
        result.to_pyvista("spheres")  # type: ignore[call-overload]  # pyright: ignore


def test_ellipsoids_have_axes_and_surfaces(client: packstone.Client) -> None:
    result = client.submit(mixes.ellipsoids()).result()
    grains = result.grains
    assert grains.shape == (result.summary["grains"], 12)
    table = result.to_dataframe()
    assert np.allclose(table["b_mm"] / table["a_mm"], 0.8) and np.allclose(table["c_mm"] / table["b_mm"], 0.6)
    assert np.allclose(table["d_mm"] ** 3, 8 * table["a_mm"] * table["b_mm"] * table["c_mm"])
    surfaces = result.to_pyvista("surfaces", resolution=24)
    volume = (np.pi / 6 * grains[:, 3] ** 3).sum()
    assert surfaces.volume == pytest.approx(volume, rel=0.05) and surfaces.volume < volume
    assert surfaces.bounds[0] >= 0 and surfaces.bounds[5] <= 40


def test_ellipsoids_and_polyhedra_have_columns_of_both(client: packstone.Client) -> None:
    result = client.submit(mixes.mixed()).result()
    table = result.to_dataframe()
    assert tuple(table.columns) == MIXED
    of_template = table["template"] >= 0
    assert 0 < of_template.sum() < len(table) and len(result.templates()) == 3
    assert (table["a_mm"][of_template] == 0).all() and (table["template"][~of_template] == -1).all()
    surfaces = result.to_pyvista("surfaces")
    assert set(surfaces.cell_data["id"]) == set(range(len(table)))


ELLIPSOID = {"type": "ellipsoid", "ratios": {"type": "constant", "elongation": 0.8, "flatness": 0.6}}
POLYHEDRON = {"type": "polyhedron", "template_count": 3}


@pytest.mark.parametrize("shapes", [[], [ELLIPSOID], [POLYHEDRON], [ELLIPSOID, POLYHEDRON], [POLYHEDRON, None]])
def test_several_aggregates_have_the_surfaces_of_their_shapes(client: packstone.Client, shapes: list[Any]) -> None:
    one, two = shapes[0] if shapes else None, shapes[-1] if shapes else None
    parts = [{"share": 0.6, "shape": one}, {"share": 0.4, "shape": two}]
    grading = {"type": "sieves", "points": [[4, 0], [12, 1]]}
    aggregates = [{**{name: value for name, value in part.items() if value}, "grading": grading} for part in parts]
    job = mixes.quick() | {"mix": {"volume_fraction": 0.3, "aggregates": aggregates}}
    here, there = packstone.pack(job), client.submit(job).result()
    assert here.columns == there.columns and here.columns[-1] == "aggregate"
    assert len(here.columns) == here.grains.shape[1]
    assert ("a_mm" in here.columns) == (ELLIPSOID in shapes or None in shapes)
    assert ("template" in here.columns) == (POLYHEDRON in shapes)
    assert list(here.to_dataframe().columns) == list(here.columns)
    for packing in (here, there):
        surfaces = packing.to_pyvista("surfaces", resolution=32)
        # Inscribed surfaces have less volume than the spheres of equal volume that the column d_mm states.
        volume = (np.pi / 6 * packing.diameters**3).sum()
        assert 0.85 * volume < surfaces.triangulate().volume < 1.001 * volume, packing.columns


def test_notebooks_show_a_picture(result: packstone.Packing, client: packstone.Client) -> None:
    png = result._repr_png_()
    assert png is not None and png.startswith(b"\x89PNG")
    assert "data:image/png;base64," in result._repr_html_() and "volume_fraction_effective" in result._repr_html_()
    assert repr(result).startswith("<Packing of job ")


def test_a_file_is_replaced_as_a_whole_or_not_at_all(client: packstone.Client, tmp_path: Path) -> None:
    job = client.submit(mixes.quick())
    result = job.result()
    path = tmp_path / "a.csv"
    path.write_text("of last week")
    with pytest.raises(FileExistsError, match="a.csv exists: choose another name, or pass overwrite=True"):
        result.save(path)
    job.delete()
    with pytest.raises(packstone.PackstoneError):
        result.save(path, overwrite=True)
    assert path.read_text() == "of last week"
    assert list(tmp_path.iterdir()) == [path]


def test_a_broken_download_goes_on_where_it_was(proxy: FaultyProxy, pauses: list[float]) -> None:
    with packstone.Client(proxy.url) as client:
        job = client.submit(mixes.quick())
        whole = job.result().grains
        result = job.result()
        proxy.seen.clear()
        proxy.faults.extend([CutAfter(100), CutAfter(50)])
        assert np.array_equal(result.grains, whole)
        assert result.grains is result.grains, "it is fetched once"
    ranges = [seen.headers["range"] for seen in proxy.seen]
    assert ranges == [None, "bytes=100-", "bytes=150-"]
    assert len(pauses) == 2
