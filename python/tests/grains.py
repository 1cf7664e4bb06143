"""A function for another process."""

from __future__ import annotations

import packstone


def grains_of(job: packstone.Job) -> int:
    """Waits for a job and returns its number of grains."""
    return len(job.result(timeout=60).grains)
