"""What a service says of itself and of an API key.

Written by ``tests/typed_documents.py`` of the schemas of the same names in ``openapi.yaml``, which describes each
field. Lengths are in mm. A field that may be missing is `NotRequired`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypedDict

if TYPE_CHECKING:
    from typing_extensions import NotRequired


class Capabilities(TypedDict):
    """What this server can do, and how much of it."""

    version: str
    engine: EngineInfo
    specimens: list[str]
    gradings: list[str]
    standard_gradings: list[StandardInfo]
    distances: list[str]
    shapes: list[str]
    shape_presets: list[PresetInfo]
    methods: list[str]
    formats: list[FormatInfo]
    exports: list[ExportInfo]
    webhooks: bool
    limits: LimitsInfo


class EngineInfo(TypedDict):
    """What computed a result."""

    version: str
    rng: str


class ExportFormatInfo(TypedDict):
    """A file format of an export."""

    name: str
    media_type: str
    options: list[str]
    programs: list[str]
    needs_program: bool


class ExportInfo(TypedDict):
    """A type of exports."""

    type: Literal["mesh", "voxels", "slice", "deck", "ldpm", "certificates", "shapes", "quality", "properties"]
    formats: list[ExportFormatInfo]


class FormatInfo(TypedDict):
    """A format of results."""

    name: Literal["json", "csv", "vtk", "vtp", "npy", "view", "html"]
    media_type: str


class KeyInfo(TypedDict):
    """The API key of a request."""

    name: str | None
    owner: str | None
    role: Literal["metrics", "worker", "read", "submit", "admin"]
    max_requests_per_second: float | None
    request_burst: int | None
    quotas: Quotas
    used: KeyUsage


class KeyUsage(TypedDict):
    """What the jobs of an owner take."""

    queued: int
    running: int
    stored_bytes: int


class LimitsInfo(TypedDict):
    """Bounds of this server."""

    max_grains: int
    max_memory_bytes: int
    max_model_bytes: int
    min_length_mm: float
    max_length_mm: float
    max_seed: int
    max_body_bytes: int
    max_queued: int
    max_run_s: float | None
    expire_after_days: float | None
    workers: int
    max_attempts: int
    max_priority: int
    max_threads: int
    max_timeout_s: float
    max_name_chars: int
    max_labels: int
    max_study_jobs: int
    max_wait_s: int
    max_downloads: int
    max_postprocess: int
    max_kept_exports: int
    export_cache_bytes: int


class PresetInfo(TypedDict):
    """A shape of grains that a name stands for."""

    name: str
    about: str
    source: str
    doi: str | None
    shape: dict[str, Any]


class Quotas(TypedDict):
    """Bounds of what the jobs of one owner may take, whichever of the owner's keys brought them; `null` where there
    is no bound but those of the server.
    """

    max_queued: int | None
    max_running: int | None
    max_grains: int | None
    max_stored_bytes: int | None


class StandardInfo(TypedDict):
    """A grading of a standard."""

    standard: Literal[
        "DIN 1045-2",
        "ASTM C33",
        "AASHTO M 43",
        "EN 12620",
        "EN 196-1",
        "IS 383",
        "BS 882",
        "GB/T 14685",
        "AREMA",
    ]
    name: str
    limits: list[list[float]]
