"""What is known about packings, plans and studies.

Written by ``tests/typed_documents.py`` of the schemas of the same names in ``openapi.yaml``, which describes each
field. Lengths are in mm. A field that may be missing is `NotRequired`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypedDict

if TYPE_CHECKING:
    from typing_extensions import NotRequired


class AggregateReport(TypedDict):
    """One aggregate of the result."""

    name: str | None
    share: float
    grains: int
    target_volume_mm3: float
    volume_mm3: float
    mass_kg: float | None
    classes: list[ClassReport]


class CheckReport(TypedDict):
    """What the independent check found. A packing that fails is never returned."""

    min_gap_mm: NotRequired[float | None]
    min_wall_gap_mm: NotRequired[float | None]
    min_excess_gap_mm: NotRequired[float | None]
    max_class_mass_error: float
    pairs_checked: int


class ClassPlan(TypedDict):
    """Expected grains of one size class."""

    d_min_mm: float
    d_max_mm: float
    grains: float
    volume_mm3: float


class ClassReport(TypedDict):
    """One size class of the result."""

    d_min_mm: float
    d_max_mm: float
    grains: int
    target_volume_mm3: float
    volume_mm3: float


class ComputationEstimate(TypedDict):
    """What a computation is likely to take."""

    memory_bytes: int
    cpu_s: float


class EdmdStatistics(TypedDict):
    """What event-driven molecular dynamics counted, over all parts of a run that was interrupted."""

    events: int
    grain_collisions: int
    wall_collisions: int
    list_rebuilds: int
    predictions: int
    stale_events: int
    swaps_tried: int
    swaps_accepted: int
    velocity_rescalings: int
    compression_cycles: int
    pinned_grains: int
    expansions: int
    resumes: int
    predictions_per_event: float
    events_per_s: float
    simulated_time_s: float
    growth_scale: float
    energy: float
    reduced_pressure: float
    stop: Literal["target", "stalled", "time_limit", "event_limit", "sweep_limit", "finished", "no_start"]


class EngineInfo(TypedDict):
    """What computed a result."""

    version: str
    rng: str


class ExportEstimate(TypedDict):
    """What an export is likely to come out as."""

    bytes: int
    mesh: NotRequired[MeshEstimate | None]
    computation: NotRequired[ComputationEstimate | None]
    warnings: NotRequired[list[str]]


class GradingFigures(TypedDict):
    """Figures of the aggregate of a mix, told by a dry run and by a blend."""

    fines: float
    fineness_modulus: float
    fineness_modulus_en_12620: float
    k_value: float
    specific_surface_m2_m3: float
    specific_surface_m2_kg: NotRequired[float | None]
    packing_model: dict[str, Any]
    packing_density: float
    packing_density_placed: NotRequired[float | None]
    paste: NotRequired[PasteFigures | None]


class GrowthPoint(TypedDict):
    """A point of the growth of grains."""

    packing_time_s: float
    simulated_time_s: NotRequired[float]
    events: int
    volume_fraction: float
    distance_mm: float | None
    reduced_pressure: NotRequired[float]


class JobPlan(TypedDict):
    """What a job amounts to, with the exports that its `postprocess` names."""

    grains: float
    specimen_volume_mm3: float
    volume_fraction_mixture: float
    volume_fraction_effective: float
    volume_fraction_with_coating: float
    memory_bytes: int
    estimated_time_s: float
    most_threads: int
    success_probability: float
    methods: MethodEstimates
    proposal: NotRequired[Proposal | None]
    extrapolations: list[str]
    classes: list[ClassPlan]
    curve: NotRequired[list[list[float]]]
    figures: NotRequired[GradingFigures | None]
    warnings: list[str]
    exports: list[PlannedExport]


class MeshEstimate(TypedDict):
    """What a surface mesh is likely to come out as."""

    triangles: int
    bytes: int
    tetrahedra: NotRequired[int | None]
    nodes: NotRequired[int | None]
    degrees_of_freedom: NotRequired[int | None]


class MethodEstimate(TypedDict):
    """What one method is likely to do with a mix."""

    success_probability: float
    operations: float
    time_s: float
    volume_fraction_with_coating_reach: float


class MethodEstimates(TypedDict):
    """The method that inserts grains at their size, and the method that grows them."""

    rsa: MethodEstimate
    growth: MethodEstimate


class MonteCarloStatistics(TypedDict):
    """What hard-particle Monte Carlo counted, over all parts of a run that was interrupted."""

    compression_cycles: int
    sweeps: int
    moves_tried: int
    moves_accepted: int
    pushes: int
    swaps_tried: int
    swaps_accepted: int
    list_rebuilds: int
    expansions: int
    resumes: int
    growth_scale: float
    stop: Literal["target", "stalled", "time_limit", "event_limit", "sweep_limit", "finished", "no_start"]


class Partial(TypedDict):
    """How far a run came that ended before its target. Sizes and distances of the packing are those stated here."""

    reason: Literal["time_limit", "event_limit", "stalled", "saturated", "timed_out", "finished"]
    volume_fraction_requested: float | None
    volume_fraction_reached: float
    distance_mm_requested: float | None
    distance_mm_reached: float | None
    size_scale: float
    grains_requested: int
    grains_placed: int


class PasteFigures(TypedDict):
    """How thick the paste lies between the grains of a concrete. Paste is all that is no aggregate coarser than
    0.063 mm: cement, water, air and fines.
    """

    volume_fraction: float
    excess_volume_fraction: float
    film_thickness_mm: float
    maximum_thickness_mm: float


class Plan(TypedDict):
    """What a request amounts to."""

    grains: float
    specimen_volume_mm3: float
    volume_fraction_mixture: float
    volume_fraction_effective: float
    volume_fraction_with_coating: float
    memory_bytes: int
    estimated_time_s: float
    most_threads: int
    success_probability: float
    methods: MethodEstimates
    proposal: NotRequired[Proposal | None]
    extrapolations: list[str]
    classes: list[ClassPlan]
    curve: NotRequired[list[list[float]]]
    figures: NotRequired[GradingFigures | None]
    warnings: list[str]


class PlannedExport(TypedDict):
    """An export and its estimated size."""

    export: dict[str, Any]
    estimate: ExportEstimate


class Proposal(TypedDict):
    """The most that is likely to succeed (with a probability of 0.9), all else as requested."""

    volume_fraction: float | None
    distance_mm: float | None
    specimen: dict[str, Any] | None


class Report(TypedDict):
    """What is known about a packing, but for its grains."""

    summary: Summary
    timings_s: Timings
    statistics: Statistics
    check: CheckReport
    warnings: NotRequired[list[str]]
    growth_curve: NotRequired[list[GrowthPoint]]
    segregation: NotRequired[SegregationReport | None]
    shapes: NotRequired[ShapeReport | None]


class RepresentativeVolume(TypedDict):
    """How a property scatters over packings of several volumes."""

    values: dict[str, Any]
    property: Literal[
        "youngs_modulus_gpa",
        "poissons_ratio",
        "bulk_modulus_gpa",
        "shear_modulus_gpa",
        "universal_anisotropy",
        "expansion_1_k",
        "conductivity_w_m_k",
        "diffusivity_m2_s",
    ]
    phase_variance: float | None
    alpha: float | None
    integral_range_mm3: float | None
    edge_mm: float | None
    volumes: list[ScatterOfVolume]


class RsaStatistics(TypedDict):
    """What random sequential addition counted."""

    attempts: int
    grains_by_subdivision: int
    voxels_tested: int


class ScatterOfVolume(TypedDict):
    """A property of packings of one volume."""

    point: int
    volume_mm3: float
    edge_mm: float
    count: int
    mean: float
    std: float | None
    realisations: int | None


class SegregationReport(TypedDict):
    """How far coarse and fine grains lie apart: along the requested field, and across it as a control."""

    along: Separation
    across: SeparationAcross
    permutations: int


class Separation(TypedDict):
    """Where the coarsest and the finest third of the mass lie on average: 0 is the lower end of the field, 1 the
    upper, in shares of the volume that the walls leave for the centre of a grain.
    """

    coarsest_third: float
    finest_third: float
    difference: float
    p_value: float


class SeparationAcross(TypedDict):
    """Separation along coordinate axes; that of the field itself is left out."""

    x: NotRequired[Separation | None]
    y: NotRequired[Separation | None]
    z: NotRequired[Separation | None]


class ShapeReport(TypedDict):
    """Shapes and orientation of grains that are not spheres. Means and shares are weighted by volume; the tensors
    are means by number.
    """

    flakiness_index: float | None
    shape_index: float | None
    elongation_mean: float
    flatness_mean: float
    sphericity_mean: float
    roundness_mean: NotRequired[float | None]
    zingg: ZinggShares
    surface_mm2: float
    long_axis_tensor: list[float]
    short_axis_tensor: list[float]


class Statistics(TypedDict):
    """What the algorithms counted."""

    rsa: NotRequired[RsaStatistics | None]
    edmd: NotRequired[EdmdStatistics | None]
    monte_carlo: NotRequired[MonteCarloStatistics | None]


class StudyTable(TypedDict):
    """What the runs of a study came to."""

    columns: list[str]
    rows: list[StudyTableRow]
    representative_volumes: NotRequired[list[RepresentativeVolume]]


class StudyTableRow(TypedDict):
    """The figures of the runs of a point. A figure is `null` where no run has it."""

    grains: float | None
    volume_fraction_effective: float | None
    volume_fraction_with_coating: float | None
    runs: int
    successes: int
    success_rate: float | None
    success_rate_low: float | None
    success_rate_high: float | None
    partial: int
    volume_fraction_reached_median: float | None
    time_s_total: float | None
    time_s_per_success: float | None
    time_s_median: float | None
    time_s_max: float | None
    distance_mm_median: float | None
    distance_mm_min: float | None
    distance_mm_max: float | None
    events_median: float | None
    event_us_median: float | None
    waiting: int
    void: int
    stopped_early: int
    youngs_modulus_gpa_mean: NotRequired[float | None]
    youngs_modulus_gpa_std: NotRequired[float | None]
    youngs_modulus_gpa_count: NotRequired[int]
    poissons_ratio_mean: NotRequired[float | None]
    poissons_ratio_std: NotRequired[float | None]
    poissons_ratio_count: NotRequired[int]
    bulk_modulus_gpa_mean: NotRequired[float | None]
    bulk_modulus_gpa_std: NotRequired[float | None]
    bulk_modulus_gpa_count: NotRequired[int]
    shear_modulus_gpa_mean: NotRequired[float | None]
    shear_modulus_gpa_std: NotRequired[float | None]
    shear_modulus_gpa_count: NotRequired[int]
    universal_anisotropy_mean: NotRequired[float | None]
    universal_anisotropy_std: NotRequired[float | None]
    universal_anisotropy_count: NotRequired[int]
    expansion_1_k_mean: NotRequired[float | None]
    expansion_1_k_std: NotRequired[float | None]
    expansion_1_k_count: NotRequired[int]
    conductivity_w_m_k_mean: NotRequired[float | None]
    conductivity_w_m_k_std: NotRequired[float | None]
    conductivity_w_m_k_count: NotRequired[int]
    diffusivity_m2_s_mean: NotRequired[float | None]
    diffusivity_m2_s_std: NotRequired[float | None]
    diffusivity_m2_s_count: NotRequired[int]
    properties_waiting: NotRequired[int]


class Summary(TypedDict):
    """The figures people ask for first."""

    grains: int
    method_used: Literal["rsa", "edmd", "rsa_then_edmd", "monte_carlo", "rsa_then_monte_carlo"] | None
    specimen_volume_mm3: float
    volume_fraction_mixture: float
    volume_fraction_effective: float
    volume_fraction_with_coating: float
    distance_mm: NotRequired[float | None]
    d_min_mm: float
    d_max_mm: float
    classes: list[ClassReport]
    aggregates: NotRequired[list[AggregateReport]]
    size_scale: NotRequired[float]
    volume_fraction_drawn: NotRequired[float]
    partial: NotRequired[Partial]


class Timings(TypedDict):
    """Wall-clock time of each phase, in s."""

    sampling: float
    rsa: float
    edmd: NotRequired[float | None]
    monte_carlo: NotRequired[float | None]
    check: float
    total: float


class ZinggShares(TypedDict):
    """Shares of the classes of form by Zingg (1935), which are divided at `b/a` = 2/3 and `c/b` = 2/3."""

    disc: float
    equant: float
    blade: float
    rod: float
