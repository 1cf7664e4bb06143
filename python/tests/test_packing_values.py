"""What a packing gives of its grains: arrays, figures, and the terms of other libraries."""

from __future__ import annotations

import os
import pickle
import sys
from pathlib import Path
from typing import Any

import mixes
import numpy as np
import pytest
from live_server import LiveServer
from packstone.view import View

import packstone

figures = pytest.importorskip("matplotlib.figure")

KEY = "packstone_" + 64 * "0"


@pytest.fixture(scope="module")
def spheres() -> packstone.Packing:
    return packstone.pack(mixes.quick())


@pytest.fixture(scope="module")
def ellipsoids() -> packstone.Packing:
    return packstone.pack(mixes.ellipsoids())


@pytest.fixture(scope="module")
def mixed() -> packstone.Packing:
    return packstone.pack(mixes.mixed())


def test_a_packing_is_an_array_and_a_collection(spheres: packstone.Packing) -> None:
    array = np.asarray(spheres)
    assert array is spheres.grains or np.shares_memory(array, spheres.grains)
    assert np.asarray(spheres, dtype=np.float32).dtype == np.float32
    changed = np.array(spheres)
    changed[0] = 0
    assert spheres.grains[0, 3] > 0
    with pytest.raises(ValueError, match="takes a copy"):
        spheres.__array__(np.float32, copy=False)
    grains = list(spheres)
    assert len(grains) == len(spheres) == len(array)
    assert np.array_equal(grains[3].position, array[3, :3]) and grains[3].diameter == array[3, 3]
    assert (grains[3].aggregate, grains[3].template, grains[3].sieve_size) == (0, -1, array[3, 3])


def test_figures_are_properties_and_stand_in_the_repr(spheres: packstone.Packing) -> None:
    assert spheres.seed == 1 and spheres.specimen == packstone.Box(40, boundary="walls")
    volume = (np.pi / 6 * spheres.diameters**3).sum()
    assert spheres.volume_fraction == pytest.approx(volume / 40**3)
    figures = "box of 40 x 40 x 40 mm, volume fraction 0.1922, distance 0.2 mm, seed 1"
    assert repr(spheres) == f"<Packing of 68 grains: {figures}>"
    named = packstone.pack(mixes.quick(), name="core", specimen=packstone.Cylinder(50, 50), distance="none")
    assert repr(named).startswith("<Packing of 'core' (")
    assert "cylinder of 50 mm, 50 mm high, " in repr(named) and ", distance 0 mm, seed 1>" in repr(named)
    assert named.specimen == packstone.Cylinder(50, 50)


def test_figures_of_a_service(client: packstone.Client, spheres: packstone.Packing) -> None:
    job = client.submit(mixes.quick())
    there = job.result()
    assert repr(there) == repr(spheres).replace("68 grains:", f"job {job.id}: 68 grains,")
    assert np.array_equal(there, spheres) and there.specimen == spheres.specimen
    again = client.pack(mixes.quick(), progress=False)
    assert np.array_equal(again, spheres)


def test_arrays_of_spheres(spheres: packstone.Packing) -> None:
    pytest.importorskip("scipy")
    assert np.array_equal(spheres.radii, spheres.diameters / 2)
    assert np.array_equal(spheres.sieve_sizes, spheres.diameters)
    assert np.array_equal(spheres.semi_axes, np.repeat(spheres.radii[:, None], 3, axis=1))
    assert np.array_equal(spheres.orientations.as_matrix()[5], np.eye(3))
    assert set(spheres.aggregate) == {0} and set(spheres.template) == {-1}
    assert np.issubdtype(spheres.template.dtype, np.integer) and spheres.templates() == []
    for array in (spheres.radii, spheres.semi_axes, spheres.aggregate):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_arrays_of_ellipsoids(ellipsoids: packstone.Packing) -> None:
    pytest.importorskip("scipy")
    a, b, c = ellipsoids.semi_axes.T
    assert np.allclose(b / a, 0.8) and np.allclose(8 * a * b * c, ellipsoids.diameters**3)
    assert (ellipsoids.sieve_sizes > 2 * c).all() and (ellipsoids.sieve_sizes <= 2 * b + 1e-9).all()
    matrices = ellipsoids.orientations.as_matrix()
    # The extent along z of an ellipsoid with these axes and this orientation: all lie in the box.
    reach = np.linalg.norm(matrices[:, 2, :] * ellipsoids.semi_axes, axis=1)
    z = ellipsoids.positions[:, 2]
    assert (z - reach > 0).all() and (z + reach < 40).all()


def test_arrays_of_several_shapes_and_aggregates(mixed: packstone.Packing) -> None:
    is_polyhedron = mixed.template >= 0
    assert np.isnan(mixed.semi_axes[is_polyhedron]).all() and not np.isnan(mixed.semi_axes[~is_polyhedron]).any()
    assert set(mixed.template) == {-1, 0, 1, 2} and len(mixed.templates()) == 3
    table = mixed.to_dataframe()
    assert table["template"].dtype == np.int64 and list(table["template"]) == mixed.template.tolist()
    grading = packstone.Grading.sieves([(4, 0), (12, 1)])
    parts = [packstone.Aggregate(0.5, grading), packstone.Aggregate(0.5, grading)]
    two = packstone.pack(mixes.quick(), mix=packstone.Mix(volume_fraction=0.3, aggregates=parts))
    assert set(two.aggregate) == {0, 1} and two.aggregate.dtype == np.int64


def test_neighbours_are_certified_pairs(spheres: packstone.Packing) -> None:
    near = spheres.neighbours(1.0)
    assert near.closer_than_mm == 1 and len(near) == len(near.gaps_mm) > 5
    first, second = near.pairs.T
    apart = spheres.positions[second] - spheres.positions[first]
    gaps = np.linalg.norm(apart, axis=1) - spheres.radii[first] - spheres.radii[second]
    assert np.allclose(gaps, near.gaps_mm, atol=1e-6) and (gaps < 1).all()
    assert np.allclose(np.einsum("ni,ni->n", near.normals, apart), np.linalg.norm(apart, axis=1))
    # None is missing.
    distances = np.linalg.norm(spheres.positions[:, None] - spheres.positions[None], axis=2)
    all_gaps = distances - spheres.radii[:, None] - spheres.radii[None]
    assert len(near) == (np.triu(all_gaps < 1, 1)).sum()
    assert near.counts(len(spheres)).sum() == 2 * len(near)
    walls = np.minimum(spheres.positions, 40 - spheres.positions).min(axis=1) - spheres.radii
    assert set(near.at_walls) == set(np.flatnonzero(walls < 1))
    assert repr(near) == f"<Neighbours closer than 1 mm: {len(near)} pairs, {len(near.at_walls)} at walls>"


@pytest.mark.parametrize("kind", ["grading", "section", "zingg"])
def test_plots_are_drawn_in_axes(kind: Any, mixed: packstone.Packing) -> None:
    ax = figures.Figure().subplots()
    assert mixed.plot(kind, ax=ax) is ax
    assert ax.has_data() and ax.get_xlabel() and ax.get_title().startswith(f"{len(mixed)} grains")
    if kind == "section":
        assert ax.get_xlim() == pytest.approx((0, 40))
        assert ax.get_images()[0].get_cmap().name == "gray"


def test_the_target_of_a_grading_is_met_at_the_sieves(spheres: packstone.Packing) -> None:
    ax = figures.Figure().subplots()
    spheres.plot(ax=ax, title=False)
    achieved, target = ax.get_lines()
    assert np.array_equal(target.get_xdata(), [4, 8, 16])
    assert np.asarray(target.get_ydata()) == pytest.approx(np.array([0, 37.5, 100]))
    assert np.max(achieved.get_ydata()) == pytest.approx(100) and ax.get_title() == ""


def test_the_distance_of_grown_grains_is_drawn(spheres: packstone.Packing) -> None:
    ax = figures.Figure().subplots()
    packstone.pack(mixes.long()).plot("distance", ax=ax)
    assert len(np.asarray(ax.get_lines()[0].get_xdata())) > 2
    with pytest.raises(ValueError, match="did not grow"):
        spheres.plot("distance", ax=ax)
    unknown: Any = "radial"
    with pytest.raises(ValueError, match=r"kind: 'radial' is not drawn in axes .*without ax, plot\('radial'\) is SVG"):
        spheres.plot(unknown, ax=ax)


@pytest.mark.parametrize(
    ("library", "call", "install"),
    [
        ("pyvista", lambda packing: packing.to_pyvista(), "packstone[pyvista]"),
        ("trimesh", lambda packing: packing.to_trimesh(), "packstone[trimesh]"),
        ("meshio", lambda packing: packing.to_meshio(), "packstone[meshio]"),
        ("pandas", lambda packing: packing.to_dataframe(), "packstone[dataframe]"),
        ("scipy.spatial.transform", lambda packing: packing.orientations, "packstone[scipy]"),
    ],
)
def test_a_missing_library_is_named(
    spheres: packstone.Packing, monkeypatch: pytest.MonkeyPatch, library: str, call: Any, install: str
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ImportError) as missing:
        call(spheres)
    assert f'pip install "{install}"' in str(missing.value)


def test_a_pickle_holds_the_grains_and_needs_no_server(tmp_path: Path, spheres: packstone.Packing) -> None:
    (tmp_path / "server").mkdir()
    with LiveServer(tmp_path / "server", "--workers", "1") as live, packstone.Client(live.url, KEY) as client:
        there = client.submit(mixes.quick()).result()
        pickled = pickle.dumps(there)
    assert KEY.encode() not in pickled
    copy = pickle.loads(pickled)
    assert np.array_equal(copy, spheres) and copy.read("raw", cells=10) == spheres.read("raw", cells=10)
    assert copy.request["seed"] == 1


def test_no_pickle_holds_the_key(client: packstone.Client, server: LiveServer, monkeypatch: pytest.MonkeyPatch) -> None:
    with packstone.Client(server.url, KEY) as keyed:
        job = keyed.submit(mixes.quick()).wait()
        study = keyed.study(template=mixes.without(mixes.quick(), "seed"), seed=1).wait()
        for thing in (keyed, job, study, job.export("slice")):
            pickled = pickle.dumps(thing)
            assert KEY.encode() not in pickled and b"Bearer" not in pickled, thing
        copy = pickle.loads(pickle.dumps(job))
    with pytest.raises(ValueError, match="a pickle does not hold the API key: set PACKSTONE_API_KEY where it is load"):
        copy.refresh()
    monkeypatch.setitem(os.environ, "PACKSTONE_API_KEY", KEY)
    assert pickle.loads(pickle.dumps(copy)).refresh().succeeded


def test_a_saved_notebook_keeps_a_picture(spheres: packstone.Packing, monkeypatch: pytest.MonkeyPatch) -> None:
    data, _ = spheres.view()._repr_mimebundle_()  # type: ignore[union-attr]  # pyright: ignore
    assert data["image/png"].startswith("iVBOR") and "application/vnd.jupyter.widget-view+json" in data
    monkeypatch.setattr("packstone.packings.find_spec", lambda name: None)
    view = spheres.view()
    assert isinstance(view, View)
    png = view._repr_png_()
    assert png is not None and png.startswith(b"\x89PNG")
    html = spheres._repr_html_()
    assert "data:image/png;base64," in html


def test_files_are_replaced_on_request_alone(
    spheres: packstone.Packing, client: packstone.Client, tmp_path: Path
) -> None:
    job = client.submit(mixes.quick()).wait()
    export = job.export("slice", format="svg").wait()
    study = packstone.study(template=mixes.without(mixes.quick(), "seed"), seed=1, keep=True)
    saves: list[Any] = [
        lambda **given: spheres.save(tmp_path / "a.csv", **given),
        lambda **given: spheres.export("voxels", tmp_path / "a.npy", format="npy", cells=8, **given),
        lambda **given: spheres.plot("grading", tmp_path / "a.svg", **given),
        lambda **given: spheres.view().save(tmp_path / "a.html", **given),  # pyright: ignore
        lambda **given: export.save(tmp_path / "b.svg", **given),
        lambda **given: job.slice(tmp_path / "b.png", **given),
        lambda **given: job.plot("grading", tmp_path / "c.svg", **given),
        lambda **given: study.save_all(tmp_path / "all", "npy", **given),
        lambda **given: study.to_csv(tmp_path / "table.csv", **given),
        lambda **given: study.plot("success", tmp_path / "d.svg", **given),
    ]
    if not hasattr(spheres.view(), "save"):
        del saves[3]
    for save in saves:
        save()
        with pytest.raises(FileExistsError, match="exists: choose another name, or pass overwrite=True"):
            save()
        save(overwrite=True)
