"""Exports of packings: meshes, voxel models, cross-sections, lattice models."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import meshio
import mixes
import numpy as np
import packstone
import pytest
from faulty_proxy import Answered, FaultyProxy
from live_server import LiveServer


@pytest.fixture(scope="module")
def job(session_client: packstone.Client) -> packstone.Job:
    return session_client.submit(mixes.quick()).wait()


def test_an_export_is_started_waited_for_and_saved(job: packstone.Job, tmp_path: Path) -> None:
    seen: list[str] = []
    export = job.export("voxels", format="raw", cells=20, label="phase")
    export.wait(timeout=60, progress=lambda export: seen.append(export.state))
    assert export.succeeded and export.finished and export.error is None and seen[-1] == "succeeded"
    assert (export.type, export.format, export.kept) == ("voxels", "raw", True)
    assert export.options["cells"] == 20 and export.options["samples"] == 4
    saved = export.save(tmp_path / "new" / "labels.raw")
    labels = np.fromfile(saved, dtype=export.report["dtype"])
    assert labels.size == np.prod(export.report["shape"])
    fraction = export.report["volume_fraction"]
    assert fraction == pytest.approx(job.result().summary["volume_fraction_effective"])
    assert labels.mean() == pytest.approx(fraction, rel=0.2)
    assert export.read() == saved.read_bytes()
    assert job.export("voxels", format="raw", cells=20).path == export.path, "the same is made once"
    assert [found.path for found in job.exports()].count(export.path) == 1
    assert str(export) == f"voxels (raw) of job {job.id}: succeeded"
    assert "volume_fraction" in export._repr_html_()


def test_voxels_are_written_for_a_program(job: packstone.Job, tmp_path: Path) -> None:
    for packing in [job.result(), packstone.pack(mixes.quick())]:
        report = packing.export("voxels", tmp_path / "a.npy", for_="automesh", cells=12, overwrite=True)
        labels = np.load(tmp_path / "a.npy")
        assert labels.shape == tuple(report["shape"]) and labels.dtype == np.uint8
        assert report.get("matrix_label") == 1 and set(np.unique(labels)) == {1, 2}
        materials = {"matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2}}
        with pytest.raises(packstone.PackstoneError, match="aggregate"):
            packing.export("voxels", tmp_path / "none.zip", for_="fans", cells=12, materials=materials)
        materials["aggregate"] = {"youngs_modulus_gpa": 70, "poissons_ratio": 0.2}
        packing.export("voxels", tmp_path / "a.zip", for_="fans", cells=12, materials=materials, overwrite=True)
    assert job.export("voxels", for_="damask", cells=12).wait(60).format == "vti"


def test_properties_decks_and_tetrahedra_are_made_here_and_there(job: packstone.Job, tmp_path: Path) -> None:
    materials = {
        "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2},
        "aggregate": {"youngs_modulus_gpa": 70, "poissons_ratio": 0.2},
    }
    here, there = packstone.pack(mixes.quick()), job.result()
    with pytest.raises(packstone.PackstoneError, match='"youngs_modulus_gpa": 25'):
        here.export("properties", tmp_path / "none.json", cells=12)
    moduli = []
    for place, packing in [("here", here), ("there", there)]:
        report = packing.export("properties", tmp_path / f"{place}.json", cells=12, materials=materials)
        stiffness = report.get("stiffness")
        assert stiffness is not None and stiffness == json.loads((tmp_path / f"{place}.json").read_text())["stiffness"]
        moduli.append(stiffness["isotropic"]["youngs_modulus_gpa"])
        deck = packing.export("deck", tmp_path / f"{place}.zip", cells=12, load="shear_xy", materials=materials)
        assert (deck["load"], deck["elements"]) == ("shear_xy", "voxels")
        if shutil.which("gmsh") is not None:
            # Both are on this machine, and find the same Gmsh.
            mesh = packing.export("mesh", tmp_path / f"{place}.inp", format="inp", segments=8, order=2)
            tetrahedra = mesh.get("tetrahedra")
            assert tetrahedra is not None and tetrahedra["mesher"].startswith("Gmsh 4.")
            assert "*ELEMENT, TYPE=C3D10" in (tmp_path / f"{place}.inp").read_text()
    assert moduli[0] == moduli[1] and 25 < moduli[0] < 70


def test_a_result_is_saved_as_an_export(job: packstone.Job, tmp_path: Path) -> None:
    result = job.result()
    saved = result.save(tmp_path / "a.vti", cells=10, fractions=True)
    assert saved.read_bytes() == result.read("vti", cells=10, fractions=True)
    assert saved.read_bytes().startswith(b"<?xml")
    archive = job.export("mesh", format="stl", segments=8, keep=False).save(tmp_path / "surfaces.zip")
    assert archive.read_bytes().startswith(b"PK")
    mesh = meshio.read(result.save(tmp_path / "a.msh", segments=8))
    assert mesh.cells_dict["triangle"].shape[1] == 3


def test_every_way_to_a_mesh_writes_its_script(job: packstone.Job, tmp_path: Path) -> None:
    here, there = packstone.pack(mixes.quick()), job.result()
    here.save(tmp_path / "1.msh", segments=8)
    there.save(tmp_path / "2.msh", segments=8)
    here.export("mesh", tmp_path / "3.msh", segments=8)
    there.export("mesh", tmp_path / "4.msh", format="msh", segments=8)
    job.export("mesh", format="msh", segments=8).save(tmp_path / "5.msh")
    study: mixes.Json = {"template": mixes.without(mixes.quick(), "seed"), "seed": 1}
    (of_study,) = packstone.study(study, keep=True).save_all(tmp_path, "msh", "6", segments=8)
    assert of_study == tmp_path / "6.msh"
    for number in range(1, 7):
        script = (tmp_path / f"{number}.msh.geo").read_text()
        assert script.startswith(f'Merge "{number}.msh";\nCreateGeometry'), script
    assert job.export("mesh", format="msh", segments=8).data["links"]["script"]
    # What its program opens as it is has no script.
    here.export("mesh", tmp_path / "7.zip", format="stl", segments=8)
    here.save(tmp_path / "8.vti", cells=8)
    assert {path.suffix for path in tmp_path.iterdir()} == {".msh", ".geo", ".zip", ".vti"}
    assert len(list(tmp_path.iterdir())) == 6 + 6 + 2


@pytest.mark.parametrize("suffix", ["geo", "inp", "stl", "zip"])
def test_a_suffix_of_several_exports_is_refused(job: packstone.Job, tmp_path: Path, suffix: str) -> None:
    with pytest.raises(ValueError, match=f"'{suffix}' does not name one export: use export"):
        job.result().save(tmp_path / f"a.{suffix}")


def test_a_cross_section_is_a_picture_or_a_table(job: packstone.Job, tmp_path: Path) -> None:
    section = json.loads(job.slice(tmp_path / "new" / "x.json", axis="x", at_mm=10))
    assert json.loads((tmp_path / "new" / "x.json").read_text()) == section
    assert section["axis"] == "x" and section["at_mm"] == 10 and 0 < section["area_fraction"] < 1
    assert job.slice(format="png", pixels=64).startswith(b"\x89PNG")
    assert b"<svg" in job.slice()
    with pytest.raises(ValueError, match="'gif' is not a format of cross-sections: must be one of svg, png, json, geo"):
        job.slice(tmp_path / "a.gif")


def test_a_job_names_its_exports_beforehand(client: packstone.Client) -> None:
    exports: list[dict[str, Any]] = [{"type": "voxels", "format": "raw", "cells": 8}, {"type": "slice"}]
    job = client.submit(mixes.quick(), postprocess=exports).wait()
    assert sorted(export.wait(60).type for export in job.exports()) == ["slice", "voxels"]
    export = next(job.exports())
    export.delete()
    left = [found.path for found in job.exports()]
    assert len(left) == 1 and export.path not in left


@pytest.mark.parametrize(
    ("type", "options", "kind", "parameter"),
    [
        ("voxels", {"cells": 0}, "validation-error", "cells"),
        ("voxels", {"colour": "red"}, "validation-error", "colour"),
        ("voxels", {"format": "ply"}, "validation-error", "format"),
        ("voxels", {"format": "raw", "cells": 8000}, "too-large", "cells"),
    ],
)
def test_what_cannot_be_made_is_refused(
    job: packstone.Job, type: Any, options: dict[str, Any], kind: str, parameter: str
) -> None:
    with pytest.raises(packstone.PackstoneError) as refused:
        job.export(type, **options)
    assert refused.value.kind == kind
    assert refused.value.errors[0].parameter == parameter


def test_an_unknown_type_is_refused(job: packstone.Job) -> None:
    unknown: Any = "ball"
    with pytest.raises(packstone.PackstoneError) as refused:
        job.export(unknown)
    assert refused.value.status is not None and 400 <= refused.value.status < 500


def test_a_file_that_is_being_made_is_waited_for(proxy: FaultyProxy, pauses: list[float]) -> None:
    with packstone.Client(proxy.url, retry_s=0.001) as client:
        result = client.submit(mixes.quick()).result()
        made = Answered(202, {"retry-after": "2", "content-type": "application/json"}, b"{}")
        proxy.faults.extend([made, made])
        proxy.seen.clear()
        assert len(result.read("raw", cells=10)) == 1000
        assert pauses == [2.0, 2.0], "as long as the server says, and longer than failures are repeated"
        assert proxy.seen[0].headers["prefer"] == "wait=60"
        proxy.faults.append(made)
        with pytest.raises(packstone.WaitTimeout, match="is not made within 1 s"):
            result.read("raw", cells=11, timeout=1)


def test_a_file_is_fetched_from_where_the_server_says(server: LiveServer, job: packstone.Job) -> None:
    storage, front = FaultyProxy(server.address), FaultyProxy(server.address)
    with packstone.Client(front.url, api_key="secret") as client:
        export = client.job(job.id).export("voxels", format="raw", cells=20).wait(timeout=60)
        whole = export.read()
        front.faults.append(Answered(307, {"Location": f"{storage.url}{export.data['links']['file']}"}))
        assert export.read() == whole
    assert "authorization" in front.seen[-1].headers
    assert len(storage.seen) == 1 and "authorization" not in storage.seen[0].headers
    for proxy in (storage, front):
        proxy.stop()
