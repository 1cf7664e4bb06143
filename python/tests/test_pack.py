"""Packing in this process, against the service."""

from __future__ import annotations

import json
import pickle
import re
import signal
import subprocess
import sys
import threading
import warnings
from _thread import interrupt_main
from collections.abc import Iterator
from datetime import datetime, timezone
from pathlib import Path
from types import MappingProxyType
from typing import Any

import mixes
import numpy as np
import packstone
import pytest
from live_server import REPOSITORY, binary
from packstone._sources import PACKING_PLOT_KINDS, FileFormat
from packstone.options import ExportType, FileOptions

MIXES = {"spheres": mixes.quick(), "grown": mixes.grown(), "ellipsoids": mixes.ellipsoids(), "mixed": mixes.mixed()}


class Twins:
    """The same request, packed in this process and by a service."""

    def __init__(self, client: packstone.Client, job: mixes.Json) -> None:
        self.job = client.submit(job)
        self.here = packstone.pack(job)
        self.there = self.job.result()


@pytest.fixture(scope="module", params=MIXES)
def twins(request: pytest.FixtureRequest, session_client: packstone.Client) -> Twins:
    return Twins(session_client, MIXES[request.param])


@pytest.fixture(scope="module")
def packing() -> Iterator[packstone.Packing]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", packstone.PackstoneWarning)
        yield packstone.pack(mixes.quick())


def test_the_bits_are_those_of_the_service(twins: Twins) -> None:
    here, there = twins.here, twins.there
    assert np.array_equal(here.grains, there.grains) and len(here) == len(there) > 50
    assert here.summary == there.summary and here.check == there.check
    assert here.report["engine"] == there.report["engine"]
    assert here.request == there.request
    assert np.array_equal(here.to_dataframe(), there.to_dataframe())
    assert here.templates() == there.templates()


# Files that name neither the job nor its times.
@pytest.mark.parametrize("format", ["csv", "npy", "view"])
def test_tables_are_those_of_the_service(twins: Twins, tmp_path: Path, format: FileFormat) -> None:
    saved = twins.here.save(tmp_path / "new" / f"a.{format}")
    assert saved.read_bytes() == twins.here.read(format) == twins.there.read(format)


EXPORTS: list[tuple[ExportType, dict[str, Any]]] = [
    ("mesh", {"format": "msh", "segments": 8}),
    ("mesh", {"format": "geo", "segments": 32}),
    ("mesh", {"format": "stl", "segments": 8}),
    ("voxels", {"format": "raw", "cells": 20}),
    ("voxels", {"format": "inp", "cells": 8}),
    ("slice", {"format": "svg", "axis": "x", "at_mm": 10}),
    ("slice", {"format": "png", "pixels": 64}),
    ("slice", {"format": "json"}),
    ("slice", {"format": "geo"}),
    ("ldpm", {"format": "chrono", "spacing": 2}),
    ("certificates", {"format": "csv"}),
    ("certificates", {"format": "json"}),
    ("shapes", {"format": "csv"}),
    ("shapes", {"format": "json"}),
    ("quality", {"format": "json"}),
]


@pytest.mark.parametrize(
    ("type", "options"), EXPORTS, ids=lambda value: value if isinstance(value, str) else value["format"]
)
def test_exports_are_those_of_the_service(
    twins: Twins, tmp_path: Path, type: ExportType, options: dict[str, Any]
) -> None:
    ended: list[Any] = []
    for packing, name in ((twins.here, "here"), (twins.there, "there")):
        try:
            report = packing.export(type, tmp_path / "new" / name, **options)
        except packstone.PackstoneError as error:
            # Not every shape has every export.
            ended.append((error.kind, [fault.detail for fault in error.errors]))
        else:
            ended.append((report, (tmp_path / "new" / name).read_bytes()))
    assert ended[0] == ended[1]


def test_files_that_name_the_job_are_those_of_the_service_but_for_the_name(twins: Twins) -> None:
    here, there = json.loads(twins.here.read("json")), json.loads(twins.there.read("json"))
    for document in (here, there):
        for named_or_timed in ("job_id", "timings_s", "statistics", "growth_curve"):
            document.pop(named_or_timed, None)
    assert here == there
    for format in ("vtp", "vtk", "vti"):
        options: FileOptions = {"cells": 10} if format == "vti" else {}
        texts = [packing.read(format, **options) for packing in (twins.here, twins.there)]
        assert texts[0].startswith(texts[1][:12]) and len(texts[0]) > 1000


def test_plots_are_those_of_the_service(twins: Twins, tmp_path: Path) -> None:
    # The distance is plotted against the time that the run took.
    for kind in set(PACKING_PLOT_KINDS) - {"distance"}:
        ended: list[Any] = []
        for packing in (twins.here, twins.there):
            try:
                path = tmp_path / "new" / "plot.svg"
                ended.append(str(packing.plot(kind, path, title=False, theme="dark", overwrite=True)))
            except packstone.PackstoneError as error:
                ended.append((error.kind, error.detail))
        assert ended[0] == ended[1], kind
    assert twins.here.plot("grading", title=False) == (twins.there.plot("grading", title=False))


def test_fields_by_name_replace_those_of_the_mapping(packing: packstone.Packing) -> None:
    assert packing.request["seed"] == 1
    assert packstone.pack(mixes.quick(), seed=2).request["seed"] == 2
    job = mixes.quick(seed=5)
    by_name = packstone.pack(specimen=job["specimen"], mix=job["mix"], distance=job["distance"], seed=np.int64(5))
    assert np.array_equal(by_name.grains, packstone.pack(job).grains)


def test_values_of_other_libraries_are_taken() -> None:
    packing = packstone.pack(
        seed=np.int64(5),
        specimen=MappingProxyType({"type": "box", "size_mm": np.full(3, 40.0)}),
        mix={"grading": {"type": "diameters", "diameters_mm": np.array([12.5, 10.0])}},
        expires_at=datetime(2100, 1, 1, tzinfo=timezone.utc),
    )
    assert list(packing.diameters) == [12.5, 10]
    with pytest.raises(ValueError, match="JSON"):
        packstone.pack(mixes.quick(), timeout_s=float("nan"))
    with pytest.raises(TypeError, match="cannot be written as JSON"):
        packstone.pack(mixes.quick() | {"name": object()})


PLACED = {"volume_fraction_of": "placed_grains"}


def faulty(**changes: Any) -> mixes.Json:
    job = mixes.quick() | changes
    job["mix"] = job["mix"] | {"volume_fraction": 1.4}
    return job


@pytest.mark.parametrize(
    "job",
    [
        mixes.quick(seed=-1),
        faulty(),
        faulty(colour="red", specimen={"type": "box", "size_mm": [40, -1, 40]}),
        {},
        mixes.quick() | {"method": {"type": "magic"}},
        mixes.quick() | {"postprocess": {"type": "voxels", "cells": 0}},
        mixes.quick() | {"mix": mixes.quick()["mix"] | {"volume_fraction": 0.99, **PLACED}},
    ],
    ids=["seed", "fraction", "several", "empty", "method", "postprocess", "infeasible"],
)
def test_what_the_service_refuses_is_refused_in_the_same_words(client: packstone.Client, job: mixes.Json) -> None:
    refusals: list[Any] = []
    for call in (client.plan, packstone.plan, packstone.pack):
        with pytest.raises(packstone.PackstoneError) as refused:
            call(job)
        error = refused.value
        refusals.append((error.kind, str(error), error.detail, error.errors))
    assert refusals[0] == refusals[1] == refusals[2]


def test_a_limit_of_grains_is_kept() -> None:
    with pytest.raises(packstone.PackstoneError, match="10") as refused:
        packstone.pack(mixes.quick(), max_grains=10)
    assert refused.value.kind == "too-large"
    with pytest.raises(packstone.PackstoneError):
        packstone.plan(mixes.quick(), max_grains=10)


def test_a_forecast_is_the_plan_of_the_service(client: packstone.Client) -> None:
    here, there = packstone.plan(mixes.quick()), client.plan(mixes.quick())
    assert here.keys() == there.keys()
    for name in ("grains", "volume_fraction_effective", "warnings"):
        assert here[name] == there[name]


def test_a_packing_that_is_not_reached_tells_how_far_it_came(client: packstone.Client) -> None:
    with pytest.raises(packstone.TargetNotReached) as here:
        packstone.pack(mixes.unreachable())
    with pytest.raises(packstone.TargetNotReached) as there:
        client.submit(mixes.unreachable()).result()
    assert here.value.volume_fraction_reached == there.value.volume_fraction_reached
    assert here.value.volume_fraction_asked == there.value.volume_fraction_asked
    assert here.value.problem["placed"] == there.value.problem["placed"]
    assert (here.value.kind, here.value.detail) == (there.value.kind, there.value.detail)


def test_exports_and_plots_that_cannot_be_are_refused(packing: packstone.Packing, tmp_path: Path) -> None:
    with pytest.raises(packstone.PackstoneError, match="cells") as refused:
        packing.save(tmp_path / "a.vti", cells=0)
    assert refused.value.kind == "validation-error"
    with pytest.raises(packstone.PackstoneError) as refused:
        packing.read("raw", cells=8000)
    assert refused.value.kind == "too-large"
    with pytest.raises(packstone.PackstoneError):
        packing.plot("zingg")
    unknown: Any = "ball"
    with pytest.raises(packstone.PackstoneError):
        packing.export(unknown, tmp_path / "a")
    with pytest.raises(ValueError, match="cells: the format 'csv' has no options"):
        packing.save(tmp_path / "a.csv", cells=8)
    with pytest.raises(ValueError, match="'stl' does not name one export: use export"):
        packing.save(tmp_path / "a.stl")
    assert list(tmp_path.iterdir()) == []


def test_grains_are_views_of_one_array(packing: packstone.Packing) -> None:
    assert packing.grains is packing.grains and packing.grains.dtype == np.float64
    assert packing.positions.shape == (len(packing), 3) and packing.diameters.shape == (len(packing),)
    for view in (packing.positions, packing.diameters):
        assert np.shares_memory(view, packing.grains)
    with pytest.raises(ValueError, match="read-only"):
        packing.positions[0] = 0


def test_a_packing_can_be_pickled(packing: packstone.Packing) -> None:
    before = packstone.pack(mixes.ellipsoids())
    assert before.grains.flags.f_contiguous
    for original in (packing, before):
        copy = pickle.loads(pickle.dumps(original))
        assert np.array_equal(copy.grains, original.grains)
        assert (copy.report, copy.request, repr(copy)) == (original.report, original.request, repr(original))
        assert copy.read("vtp") == original.read("vtp")


def test_progress_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    told: list[dict[str, Any]] = []
    packstone.pack(mixes.long(), progress=told.append)
    fractions = [seen["fraction"] for seen in told]
    assert fractions == sorted(fractions) and len(told) > 1
    assert {"step", "eta_s", "message"} <= told[0].keys()
    packstone.pack(mixes.quick(), progress=True)
    shown = capsys.readouterr().err
    assert "packing" in shown and "100%" in shown


def test_what_progress_raises_ends_the_run() -> None:
    class Enough(Exception):
        pass

    def enough(seen: dict[str, Any]) -> None:
        raise Enough(seen["step"])

    with pytest.raises(Enough):
        packstone.pack(mixes.endless(), progress=enough)


def test_other_threads_run_while_a_packing_is_made() -> None:
    caller = threading.main_thread().ident
    assert caller is not None
    pause = threading.Event()
    ended = threading.Event()
    seen = 0

    def interrupt() -> None:
        nonlocal seen
        # Where the GIL is held, this thread does not run while the other is in the engine, let alone so often.
        while seen < 20 and not ended.is_set():
            seen += sys._current_frames()[caller].f_code is packstone.pack.__code__
            pause.wait(0.005)
        if not ended.is_set():
            interrupt_main()

    other = threading.Thread(target=interrupt)
    other.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            packstone.pack(mixes.endless())
    finally:
        ended.set()
        other.join()
    assert seen == 20


INTERRUPTED = """
import json, sys, packstone
packstone.pack(json.loads(sys.argv[1]), checkpoint=sys.argv[2], progress=lambda seen: print(seen["step"], flush=True))
"""


def test_an_interrupted_run_is_continued(tmp_path: Path) -> None:
    checkpoint = tmp_path / "run.checkpoint"
    command = [sys.executable, "-c", INTERRUPTED, json.dumps(mixes.long()), str(checkpoint)]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as run:
        assert run.stdout is not None and run.stderr is not None
        while run.stdout.readline() not in ("edmd\n", ""):
            pass
        run.send_signal(signal.SIGINT)
        said = run.stderr.read()
    assert run.returncode == -signal.SIGINT and said.endswith("KeyboardInterrupt\n"), said
    assert checkpoint.exists()
    continued = packstone.pack(mixes.long(), checkpoint=checkpoint)
    counted = continued.report["statistics"].get("edmd")
    assert counted is not None and counted["resumes"] == 1
    assert np.array_equal(continued.grains, packstone.pack(mixes.long()).grains)
    assert not checkpoint.exists()


def test_a_checkpoint_of_another_request_is_refused(tmp_path: Path) -> None:
    checkpoint = tmp_path / "run.checkpoint"
    checkpoint.write_bytes(b"of something else")
    with pytest.raises(packstone.PackstoneError, match="remove the file or name another checkpoint"):
        packstone.pack(mixes.quick(), checkpoint=checkpoint)
    assert checkpoint.exists()


def test_warnings_are_issued_at_the_line_of_the_caller() -> None:
    # One grain takes the place of 0.04: a coarse mix that has to be allowed.
    mix = packstone.Mix("A16", 0.005, d_min_mm=8, allow_coarse=True)
    for call in (packstone.pack, packstone.plan):
        with pytest.warns(packstone.PackstoneWarning) as seen:
            call(specimen=packstone.Box(30), mix=mix, seed=1)
        assert all(warning.filename == __file__ for warning in seen), call


def test_other_libraries_take_the_grains(packing: packstone.Packing) -> None:
    assert packing.to_pyvista().n_points == len(packing)
    assert packing.to_pyvista("surfaces", resolution=8).n_cells > 8 * len(packing)


def test_the_version_is_that_of_the_service() -> None:
    stated = re.search(r'^version = "(.+)"$', (REPOSITORY / "python/Cargo.toml").read_text(), re.MULTILINE)
    said = subprocess.run([binary(), "--version"], capture_output=True, text=True, check=True).stdout
    assert stated is not None and said.split()[:2] == ["packstone", stated[1]]


def release_profile(manifest: str) -> list[str]:
    """How a manifest builds a release, without comments."""
    text = re.sub(r"^#.*\n", "", (REPOSITORY / manifest).read_text(), flags=re.MULTILINE)
    return re.findall(r"^\[profile\.release.*\n(?:[a-z].*\n)+", text, re.MULTILINE)


def test_the_wheel_is_built_as_the_command() -> None:
    profile = release_profile("Cargo.toml")
    assert len(profile) > 20 and release_profile("python/Cargo.toml") == profile


def test_the_command_is_that_of_the_service(tmp_path: Path) -> None:
    command = Path(sys.executable).with_name("packstone")
    said = [subprocess.run([program, "--version"], capture_output=True, check=True) for program in (command, binary())]
    # Then follow the commit and the digest of the build.
    assert said[0].stdout.split()[:2] == said[1].stdout.split()[:2] == [b"packstone", packstone.__version__.encode()]
    job = tmp_path / "job.json"
    job.write_text(json.dumps(mixes.quick()))
    subprocess.run([command, "run", job, "--format", "npy", "--out", tmp_path], check=True, capture_output=True)
    assert np.array_equal(np.load(tmp_path / "result.npy"), packstone.pack(mixes.quick()).grains)
    job.write_text("{}")
    assert subprocess.run([command, "plan", job], capture_output=True, check=False).returncode == 3
