//! What is known about a lattice: its counts, and the figure of every check.

use serde::{Deserialize, Serialize};

use super::options::{BoundaryNodes, LatticeOptions};

/// What is known about a lattice.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = LatticeReport))]
pub struct LatticeReport {
    /// Nodes, and how they were laid.
    pub nodes: NodeReport,
    /// Edges.
    pub edges: u64,
    /// Tetrahedra.
    pub tetrahedra: u64,
    /// Facets between cells: twelve in every tetrahedron.
    pub facets: u64,
    /// Share of the area of the facets that lies inside grains rather than between them; measured to 0.01 on some
    /// thousand tetrahedra.
    #[serde(default)]
    pub facet_area_in_grains: f64,
    /// Triangles on the surface.
    pub surface_triangles: u64,
    /// Volume inside the surface's triangles.
    pub volume_mm3: f64,
    /// The same over the volume of the specimen: 1 for a box, less for a cylinder, whose surface becomes a
    /// polyhedron.
    pub volume_over_specimen: f64,
    /// What the checks found.
    pub checks: Checks,
}

/// Nodes of a lattice.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = LatticeNodes))]
pub struct NodeReport {
    /// All of them.
    pub total: u64,
    /// Of these, at vertices of the specimen.
    pub on_vertices: u64,
    /// On its edges.
    pub on_edges: u64,
    /// On its faces.
    pub on_faces: u64,
    /// In grains.
    pub grains: u64,
    /// Diameter of the smallest grain, by which the options are multiplied.
    pub d_min_mm: f64,
    /// Distance asked for between nodes on the surface.
    pub spacing_mm: f64,
    /// Smallest distance of two nodes on the surface, where two are near; `null` where none are.
    pub smallest_spacing_mm: Option<f64>,
    /// Whether as many `random` nodes were placed as asked for, rather than no place was found for more.
    pub complete: bool,
}

/// What the checks of a lattice found. Errors are relative, and of the size of rounding in every model that is made.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = LatticeChecks))]
pub struct Checks {
    /// T1: largest difference of a tetrahedron's volume and the sum of its 24 pieces, over the cube of its longest
    /// edge.
    pub tetrahedron_volume_error: f64,
    /// T2: pieces of negative volume, which stick out of their tetrahedron. A tetrahedron falls into 24 pieces, each
    /// between a node, an edge point, a face point and the tetrahedron's own point; in flat tetrahedra the last may lie
    /// outside. Volumes are counted with their sign, so that sums stay exact; programs that count them as positive have
    /// too much mass by `unsigned_excess`.
    pub inverted_pieces: u64,
    /// T2: tetrahedra with such a piece. A few per million tetrahedra are usual and harmless; many mean that nodes of
    /// the surface are crowded: choose a smaller `surface_radius` or a larger `spacing`.
    pub inverted_tetrahedra: u64,
    /// T2: by how much all pieces exceed the volume when each is counted as positive, over the volume.
    pub unsigned_excess: f64,
    /// T3: difference of the sum of all cells and the volume inside the surface, over that volume.
    pub cell_volume_error: f64,
    /// T3: distance of the cells' centre of mass and that of the tetrahedra, over the cube root of the volume.
    pub center_of_mass_error: f64,
    /// T3: smallest volume of a cell.
    pub smallest_cell_mm3: f64,
    /// T3: cells without a positive volume.
    pub cells_not_positive: u64,
    /// T4: largest sum of a cell's outward area vectors, over the sum of their lengths.
    pub closure_error: f64,
    /// T5: edges inside, with a closed ring of facets.
    pub rings_closed: u64,
    /// T5: edges on the surface, with one open chain of facets.
    pub rings_open: u64,
    /// T5: edges with anything else; always 0.
    pub rings_other: u64,
    /// T6: nodes - edges + faces - tetrahedra; 1 for a ball.
    pub euler_volume: i64,
    /// T6: nodes - edges + triangles of the surface; 2 for a sphere.
    pub euler_surface: i64,
    /// T7: smallest parameter of the point of an edge, 0 at its first node and 1 at its second.
    pub edge_parameter_min: f64,
    /// T7: largest such parameter.
    pub edge_parameter_max: f64,
    /// T7: edges whose spheres overlap, which only those of surface nodes can.
    pub overlapping_edges: u64,
    /// T8: largest excess of a projected area over its area, over the area.
    pub projected_area_error: f64,
    /// T8: difference of a third of the sum of signed projected area times length and the volume, over the volume.
    pub projected_volume_error: f64,
    /// T8: facets whose signed projected area is not positive: the facet faces backwards along its edge, and its
    /// springs would have a negative area. 0 is what a solver needs. Where it is not 0, choose a smaller
    /// `surface_radius`.
    pub facets_not_positive: u64,
    /// T9: faces whose points differ in any bit between their two tetrahedra; always 0.
    pub nonconforming_faces: u64,
    /// T10: faces across which the neighbour's node lies inside the circumsphere, exactly; always 0.
    pub delaunay_violations: u64,
    /// T12: fabric tensor, the sum of projected area times length times n n over three times the volume: xx, yy, zz,
    /// xy, yz, zx.
    pub fabric: [f64; 6],
    /// T12: difference of its trace and 1.
    pub fabric_trace_error: f64,
    /// T13: pairs of grains that overlap; always 0.
    pub overlapping_grains: u64,
    /// T13: grains that reach beyond the specimen; always 0.
    pub grains_outside: u64,
    /// T13: pairs of a surface node and a grain that is nearer than half the fictitious diameter. Only vertices, which
    /// are given, can come so near.
    pub crowded_nodes: u64,
    /// T13: smallest clear distance of a surface node and a grain; `null` where none is near.
    pub smallest_node_clearance_mm: Option<f64>,
}

impl Checks {
    /// Takes what further tetrahedra have shown.
    pub(super) fn take(&mut self, measured: &Self) {
        self.tetrahedron_volume_error = self.tetrahedron_volume_error.max(measured.tetrahedron_volume_error);
        self.projected_area_error = self.projected_area_error.max(measured.projected_area_error);
        self.inverted_pieces += measured.inverted_pieces;
        self.inverted_tetrahedra += measured.inverted_tetrahedra;
        self.facets_not_positive += measured.facets_not_positive;
        self.nonconforming_faces += measured.nonconforming_faces;
        self.delaunay_violations += measured.delaunay_violations;
    }
}

impl NodeReport {
    pub(super) fn new(nodes: &super::nodes::Nodes<'_>, options: &LatticeOptions) -> Self {
        let random = options.boundary_nodes == BoundaryNodes::Random;
        let factor = if random { options.fictitious_diameter } else { options.spacing };
        Self {
            total: nodes.len() as u64,
            on_vertices: nodes.on_vertices as u64,
            on_edges: nodes.on_edges as u64,
            on_faces: (nodes.boundary - nodes.on_vertices - nodes.on_edges) as u64,
            grains: (nodes.len() - nodes.boundary) as u64,
            d_min_mm: nodes.d_min_mm,
            spacing_mm: factor * nodes.d_min_mm,
            smallest_spacing_mm: None,
            complete: nodes.complete,
        }
    }
}
