"""The provenance that the tests of the engine state in every file (`engine/tests/provenance`)."""

PROVENANCE = {
    "job_id": "a job",
    "name": "a < b",
    "engine_version": "test",
    "result_sha256": "ab",
    "seed": 17,
    "volume_fraction_mixture": 0.5,
    "volume_fraction_effective": 0.25,
}
