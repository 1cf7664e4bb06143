"""What the server refuses, and what becomes of jobs, as exceptions."""

from __future__ import annotations

import pickle

import mixes
import packstone
import pytest


def test_every_fault_is_named_at_its_place(client: packstone.Client) -> None:
    job = mixes.quick()
    job["mix"]["volume_fraction"] = 1.4
    job["specimen"]["size_mm"] = [40, -1, 40]
    with pytest.raises(packstone.PackstoneError) as refused:
        client.submit(job | {"colour": "red"})
    error = refused.value
    assert (error.kind, error.status) == ("validation-error", 422)
    pointers = {fault.pointer for fault in error.errors}
    assert pointers == {"/mix/volume_fraction", "/specimen/size_mm/1", "/colour"}
    first, *others = str(error).splitlines()
    assert first == "Invalid argument:" and isinstance(error, ValueError)
    assert any(line.startswith("  mix.volume_fraction: 1.4 ") for line in others)
    assert len(others) == 3


def test_a_single_fault_is_one_line(client: packstone.Client) -> None:
    with pytest.raises(packstone.PackstoneError, match=r"^Invalid argument: seed: -1 ") as refused:
        client.submit(mixes.quick(seed=-1))
    assert refused.value.detail.startswith("seed: -1")
    assert [fault.place for fault in refused.value.errors] == ["seed"]
    assert [fault.pointer for fault in refused.value.errors] == ["/seed"]


def test_errors_name_arguments_in_this_process_too() -> None:
    job: mixes.Json = mixes.quick() | {"sed": 3}
    job["specimen"]["size_mm"] = [40, -1, 40]
    with pytest.raises(ValueError, match=r"specimen\.size_mm\[1\]: -1 is out of range") as refused:
        packstone.pack(job)
    assert isinstance(refused.value, packstone.InvalidRequest)
    assert str(refused.value).endswith("; did you mean seed?") and "\n  sed: unknown field" in str(refused.value)
    template = mixes.without(mixes.quick(), "seed")
    with pytest.raises(ValueError, match=r'grid\["/mix/volume_fraction"\]\[1\]: ') as refused:
        packstone.study(template=template, grid={"/mix/volume_fraction": [0.2, 3]})
    # What the server or a run cannot do is no fault of an argument.
    with pytest.raises(packstone.TargetNotReached) as missed:
        packstone.pack(mixes.unreachable())
    assert not isinstance(missed.value, ValueError)


def test_faults_of_a_query_name_the_parameter(client: packstone.Client) -> None:
    with pytest.raises(packstone.PackstoneError) as refused:
        list(client.jobs(page_size=0))
    assert [fault.parameter for fault in refused.value.errors] == ["limit"]
    assert str(refused.value.errors[0]).startswith("limit: ")


def test_a_mix_that_cannot_fit_is_refused_by_a_plan(client: packstone.Client) -> None:
    job = mixes.quick()
    job["mix"] |= {"volume_fraction": 0.99, "volume_fraction_of": "placed_grains"}
    with pytest.raises(packstone.PackstoneError) as refused:
        client.plan(job)
    assert refused.value.kind == "infeasible-mix"


def test_a_packing_that_is_not_reached_tells_how_far_it_came(client: packstone.Client) -> None:
    job = client.submit(mixes.unreachable())
    with pytest.raises(packstone.TargetNotReached, match="[Nn]ot reached") as ended:
        job.result()
    error = ended.value
    assert error.kind == "target-not-reached"
    assert error.volume_fraction_asked == pytest.approx(0.5, abs=0.01)
    assert error.volume_fraction_reached is not None and 0.2 < error.volume_fraction_reached < 0.4
    assert error.distance_mm_reached is None
    assert error.problem["placed"] < error.problem["grains"]
    assert job.state == "failed" and job.error == error.problem


def test_another_end_is_not_target_not_reached(client: packstone.Client) -> None:
    job = client.submit(mixes.endless(), timeout_s=0.001)
    with pytest.raises(packstone.PackstoneError) as ended:
        job.result()
    assert ended.value.kind == "timed-out"
    assert not isinstance(ended.value, packstone.TargetNotReached)


def test_errors_travel_between_processes(client: packstone.Client) -> None:
    with pytest.raises(packstone.PackstoneError) as refused:
        client.job("none")
    copy = pickle.loads(pickle.dumps(refused.value))
    assert (type(copy), str(copy), copy.kind) == (packstone.PackstoneError, str(refused.value), "not-found")
