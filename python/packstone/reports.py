"""The figures of exports.

Written by ``tests/typed_documents.py`` of the schemas of the same names in ``openapi.yaml``, which describes each
field. Lengths are in mm. A field that may be missing is `NotRequired`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypedDict

if TYPE_CHECKING:
    from typing_extensions import NotRequired


class AggregateVoxels(TypedDict):
    """The voxels of one of several aggregates."""

    label: int
    name: str
    grains: int
    voxels: int


class BlockFigures(TypedDict):
    """Composition in blocks."""

    blocks: int
    edge_mm: list[float]
    fine_fraction_mean: float
    fine_variation: float
    fine_variation_independent: float
    fine_coarse_correlation: float | None
    fine_coarse_correlation_independent: float | None


class BondOrder(TypedDict):
    """Bond order of neighbours of like size."""

    references: int
    like_ratio: float
    reach_over_d: float
    bonds_per_grain: float
    q6: float
    q6_by_chance: float
    solid_like_share: float
    solid_like_share_away_from_walls: float | None
    share_by_coherent_bonds: list[float]


class CertificateReport(TypedDict):
    """The figures of the certificates."""

    closer_than_mm: float
    pairs: int
    walls: int
    min_separation_mm: float | None
    min_wall_separation_mm: float | None


class ClassPairFigures(TypedDict):
    """Near pairs of two size classes."""

    finer: int
    coarser: int
    share: float
    share_shuffled: float


class ConductionBounds(TypedDict):
    """Bounds of a conductivity or diffusivity, in its unit."""

    reuss: float
    hashin_shtrikman_lower: float
    hashin_shtrikman_upper: float
    voigt: float


class ConductionReport(TypedDict):
    """Conductivity of heat, or diffusivity."""

    matrix: list[list[float]]
    isotropic: float
    bounds: ConductionBounds
    error: PropertyError


class ContactFigures(TypedDict):
    """Pairs of near grains."""

    references: int
    contact_gap_mm: float
    contacts_per_grain: float
    without_contact_share: float
    near_gap_mm: float
    near_per_grain: float
    mark_correlation: float | None
    like_ratio: float
    like_share: float
    like_share_shuffled: float
    by_class: list[ClassPairFigures]
    by_ratio: list[RatioFigures]


class DeckPhase(TypedDict):
    """A solid phase of a deck."""

    name: str
    elements: int
    volume_mm3: float
    youngs_modulus_gpa: float
    poissons_ratio: float
    density_kg_m3: NotRequired[float | None]
    conductivity_w_m_k: NotRequired[float | None]
    expansion_1_k: NotRequired[float | None]


class DeckPlane(TypedDict):
    """The cut of a plane model. Its axes x and y are the other two of the specimen, in the order x, y, z."""

    axis: Literal["x", "y", "z"]
    at_mm: float
    state: Literal["stress", "strain"]
    thickness_mm: float


class DeckReport(TypedDict):
    """The figures of a deck."""

    solver: Literal["calculix", "abaqus"]
    load: Literal["uniaxial_x", "uniaxial_y", "uniaxial_z", "shear_xy", "shear_xz", "shear_yz", "temperature"]
    strain: NotRequired[float | None]
    temperature_change_k: NotRequired[float | None]
    elements: Literal["voxels", "tetrahedra", "triangles"]
    element_type: str
    lateral_faces: Literal["plane", "free"]
    plane: NotRequired[DeckPlane | None]
    size_mm: list[float]
    volume_mm3: float
    nodes: int
    number_of_elements: int
    degrees_of_freedom: int
    phases: list[DeckPhase]
    pore_elements: int
    loose_elements: int
    tetrahedra: NotRequired[TetrahedronReport | None]
    triangles: NotRequired[TriangleReport | None]
    warnings: NotRequired[list[str]]


class ElasticBounds(TypedDict):
    """Lower and upper bound of the moduli."""

    reuss: IsotropicModuli
    hashin_shtrikman_lower: IsotropicModuli
    hashin_shtrikman_upper: IsotropicModuli
    voigt: IsotropicModuli


class ExpansionReport(TypedDict):
    """Thermal expansion."""

    expansion_1_k: list[list[float]]
    isotropic_1_k: float
    error: PropertyError


class GapFigures(TypedDict):
    """Gaps to the nearest grain."""

    references: int
    smallest_mm: float
    median_mm: float
    median_excess: float


class GeoReport(TypedDict):
    """The figures of a script."""

    grains: int
    longest_edge_mm: float
    expected_volume_error: NotRequired[float]
    grains_short_of_volume: NotRequired[int]
    warnings: NotRequired[list[str]]


class IsotropicModuli(TypedDict):
    """An isotropic elastic material."""

    youngs_modulus_gpa: float
    poissons_ratio: float
    bulk_modulus_gpa: float
    shear_modulus_gpa: float


class LatticeChecks(TypedDict):
    """What the checks of a lattice found. Errors are relative, and of the size of rounding in every model that is
    made.
    """

    tetrahedron_volume_error: float
    inverted_pieces: int
    inverted_tetrahedra: int
    unsigned_excess: float
    cell_volume_error: float
    center_of_mass_error: float
    smallest_cell_mm3: float
    cells_not_positive: int
    closure_error: float
    rings_closed: int
    rings_open: int
    rings_other: int
    euler_volume: int
    euler_surface: int
    edge_parameter_min: float
    edge_parameter_max: float
    overlapping_edges: int
    projected_area_error: float
    projected_volume_error: float
    facets_not_positive: int
    nonconforming_faces: int
    delaunay_violations: int
    fabric: list[float]
    fabric_trace_error: float
    overlapping_grains: int
    grains_outside: int
    crowded_nodes: int
    smallest_node_clearance_mm: NotRequired[float | None]


class LatticeNodes(TypedDict):
    """Nodes of a lattice."""

    total: int
    on_vertices: int
    on_edges: int
    on_faces: int
    grains: int
    d_min_mm: float
    spacing_mm: float
    smallest_spacing_mm: NotRequired[float | None]
    complete: bool


class LatticeReport(TypedDict):
    """What is known about a lattice."""

    nodes: LatticeNodes
    edges: int
    tetrahedra: int
    facets: int
    facet_area_in_grains: NotRequired[float]
    surface_triangles: int
    volume_mm3: float
    volume_over_specimen: float
    checks: LatticeChecks


class MeshReport(TypedDict):
    """The figures of a mesh."""

    grains: int
    nodes: NotRequired[int]
    triangles: NotRequired[int]
    shortest_edge_mm: NotRequired[float]
    longest_edge_mm: float
    specimen_volume_mm3: NotRequired[float]
    specimen_volume_error: NotRequired[float]
    aggregate_volume_mm3: NotRequired[float]
    aggregate_volume_error: NotRequired[float]
    grains_short_of_volume: NotRequired[int]
    warnings: NotRequired[list[str]]
    tetrahedra: NotRequired[TetrahedronReport | None]
    format: Literal["msh"] | Literal["geo"] | Literal["stl"] | Literal["inp"] | Literal["vtu"] | Literal["med"]
    expected_volume_error: NotRequired[float]


class PhaseMeasures(TypedDict):
    """The elements of a phase."""

    name: str
    elements: int
    volume_mm3: float


class PropertyCell(TypedDict):
    """The cell and its voxels."""

    kind: Literal["periodic_box", "repeated_box", "mirrored_box"]
    size_mm: list[float]
    voxels: list[int]
    voxel_mm: list[float]
    cut_share: float
    voxels_of_three_bodies: int


class PropertyError(TypedDict):
    """How exact a property is."""

    iterations: list[int]
    solver: float
    voxels: float
    energy_against_work: float


class PropertyPhase(TypedDict):
    """A phase of the cell."""

    name: str
    share: float
    exact_share: float
    material: dict[str, Any]


class PropertyReport(TypedDict):
    """Effective properties of a packing."""

    cell: PropertyCell
    scheme: Literal["rotated", "hexahedra"]
    cut_voxels: Literal["mixed", "labels"]
    tolerance: float
    phases: list[PropertyPhase]
    stiffness: NotRequired[StiffnessReport | None]
    expansion: NotRequired[ExpansionReport | None]
    conductivity: NotRequired[ConductionReport | None]
    diffusivity: NotRequired[ConductionReport | None]


class QualityClass(TypedDict):
    """A size class: the grains of about a third of the volume."""

    d_min_mm: float
    d_max_mm: float
    grains: int
    volume_share: float


class QualityReport(TypedDict):
    """The quality of a packing. Lists by size class are in the order of `classes`, from fine to coarse."""

    grains: int
    d_min_mm: float
    d_max_mm: float
    classes: list[QualityClass]
    gaps: GapFigures | None
    contacts: ContactFigures | None
    bond_order: BondOrder | None
    walls: WallFigures | None
    blocks: BlockFigures | None


class RatioFigures(TypedDict):
    """Near pairs in a range of ratios of diameters."""

    ratio_min: float
    ratio_max: float
    share: float
    share_shuffled: float


class ShapeTableReport(TypedDict):
    """The figures of the table."""

    grains: int


class SliceImage(TypedDict):
    """Measures of a picture."""

    pixels: list[int]
    pixel_mm: list[float]


class SliceReport(TypedDict):
    """The figures of a cut."""

    axis: Literal["x", "y", "z"]
    at_mm: float
    plane: list[Literal["x", "y", "z"]]
    outline: dict[str, Any]
    area_mm2: float
    circle_count: int
    ellipse_count: NotRequired[int | None]
    polygon_count: NotRequired[int | None]
    aggregate_area_mm2: float
    area_fraction: float
    image: NotRequired[SliceImage | None]
    triangles: NotRequired[TriangleReport | None]


class StiffnessReport(TypedDict):
    """Elastic properties. Components are in the order xx, yy, zz, yz, xz, xy, shears those of engineering
    strains.
    """

    stiffness_gpa: list[list[float]]
    youngs_moduli_gpa: list[float] | None
    isotropic: IsotropicModuli
    universal_anisotropy: float | None
    bounds: ElasticBounds
    error: PropertyError


class SurfaceReport(TypedDict):
    """What a mesh came out as."""

    grains: int
    nodes: int
    triangles: int
    shortest_edge_mm: float
    longest_edge_mm: float
    specimen_volume_mm3: float
    specimen_volume_error: float
    aggregate_volume_mm3: float
    aggregate_volume_error: float
    grains_short_of_volume: int
    warnings: NotRequired[list[str]]
    tetrahedra: NotRequired[TetrahedronReport | None]


class TetrahedronReport(TypedDict):
    """The figures of the tetrahedra of a mesh."""

    elements: int
    target_elements: NotRequired[int | None]
    runs: int
    nodes: int
    degrees_of_freedom: int
    smallest_gamma: float
    elements_below_gamma_0_03: int
    phases: list[PhaseMeasures]
    specimen_volume_error: float
    largest_grain_volume_error: float
    mesher: str
    mesher_options: list[str]


class TriangleReport(TypedDict):
    """The figures of the triangles of a cut."""

    elements: int
    element_type: str
    nodes: int
    degrees_of_freedom: int
    smallest_gamma: float
    elements_below_gamma_0_03: int
    phases: list[PhaseMeasures]
    area_error: float
    aggregate_area_error: float
    mesher: str
    mesher_options: list[str]
    warnings: NotRequired[list[str]]


class VoxelReport(TypedDict):
    """What a user wants to know beside the file: where its numbers lie, and what became of the volume."""

    shape: list[int]
    spacing_mm: list[float]
    origin_mm: list[float]
    dtype: str | None
    matrix_label: NotRequired[int]
    outside_label: int | None
    inside_voxels: int
    aggregate_voxels: int
    grains_without_voxel: int
    volume_fraction: float
    volume_fraction_labels: float
    volume_fraction_samples: float
    aggregates: NotRequired[list[AggregateVoxels]]


class WallFigures(TypedDict):
    """Volume near the walls."""

    layers: list[WallLayer]
    core: WallLayer


class WallLayer(TypedDict):
    """A layer by the distance from the nearest wall."""

    from_mm: float
    to_mm: float
    volume_mm3: float
    volume_fraction: list[float]
