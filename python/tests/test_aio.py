"""The client for asyncio."""

from __future__ import annotations

import asyncio
import inspect
from pathlib import Path

import mixes
import packstone
import pytest
from live_server import LiveServer


def test_jobs_run_beside_one_another(server: LiveServer, tmp_path: Path) -> None:
    async def packings() -> None:
        async with packstone.AsyncClient(server.url) as client:
            jobs = await asyncio.gather(*(client.submit(mixes.quick(seed)) for seed in range(4)))
            ended = [job async for job in client.as_completed(jobs, timeout=60)]
            assert sorted(job.id for job in ended) == sorted(job.id for job in jobs)
            results = await asyncio.gather(*(job.result() for job in jobs))
            for job, result in zip(jobs, results, strict=True):
                assert len(await result.grains()) == job.summary["grains"]
            assert (await results[0].save(tmp_path / "new" / "a.csv")).exists()
            assert (await jobs[0].slice(format="png")).startswith(b"\x89PNG")
            export = await jobs[0].export("voxels", format="raw", cells=10)
            assert len(await export.read()) == 1000 and export.state == "succeeded"
            assert [found.path async for found in jobs[0].exports()].count(export.path) == 1
            again = await client.job(jobs[0].id)
            assert (await again.request())["seed"] == 0 and again.state == "succeeded"
            assert repr(again) == f"<AsyncJob {again.id} succeeded>"

    asyncio.run(packings())


def test_a_study_and_its_tables(server: LiveServer, tmp_path: Path) -> None:
    async def study() -> None:
        async with packstone.AsyncClient(server.url) as client:
            template = mixes.without(mixes.quick(), "seed")
            told: list[int] = []
            study = await client.study(template=template, replicates=3, seed=1)
            await study.wait(progress=lambda seen: told.append(seen.counts["succeeded"]))
            assert told[-1] == 3 and study.finished
            assert len(await study.runs()) == 3 and len(await study.table()) == 1
            assert len([job async for job in study.jobs("succeeded")]) == 3
            assert len(await study.save_all(tmp_path, "npy")) == 3
            assert study.id in [found.id async for found in client.studies(state="finished")]
            await study.delete()

    asyncio.run(study())


def test_a_wait_ends_when_its_task_is_cancelled(server: LiveServer) -> None:
    async def cancelled() -> None:
        async with packstone.AsyncClient(server.url) as client:
            job = await client.submit(mixes.endless())
            with pytest.raises(packstone.WaitTimeout):
                await job.wait(0.01)
            waiting = asyncio.create_task(job.wait())
            await asyncio.sleep(0)
            waiting.cancel()
            with pytest.raises(asyncio.CancelledError):
                await waiting
            await (await job.cancel()).wait()
            with pytest.raises(packstone.JobCancelled):
                await job.result()

    asyncio.run(cancelled())


def test_errors_and_warnings_are_those_of_the_client(server: LiveServer) -> None:
    async def refused() -> None:
        async with packstone.AsyncClient(server.url) as client:
            with pytest.raises(packstone.PackstoneError) as error:
                await client.submit(mixes.quick(seed=-1))
            assert error.value.errors[0].pointer == "/seed"
            mix = packstone.Mix("A16", 0.005, d_min_mm=8, allow_coarse=True)
            with pytest.warns(packstone.PackstoneWarning) as seen:
                await client.plan(specimen=packstone.Box(30), mix=mix)
            assert all(warning.filename == __file__ for warning in seen)

    asyncio.run(refused())


@pytest.mark.parametrize("name", ["Client", "Job", "Study", "Packing", "Export"])
def test_the_twins_have_the_same_methods(name: str) -> None:
    sync, twin = getattr(packstone, name), getattr(packstone, f"Async{name}")
    methods = {
        method: inspect.signature(function)
        for method, function in inspect.getmembers(sync, inspect.isfunction)
        if not method.startswith("_")
    }
    for method, signature in methods.items():
        assert hasattr(twin, method), method
        if (name, method) == ("Client", "study"):
            continue
        # Axes of matplotlib are for one thread.
        expected = [parameter for parameter in signature.parameters if parameter != "ax"]
        assert list(inspect.signature(getattr(twin, method)).parameters) == expected, method
