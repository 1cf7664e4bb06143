//! The checks T1 to T10 and T12 of a lattice, run on every one that is made: a pass over its tetrahedra, one over
//! its surface, and what the topology says. (T11 and T14 are tests of the code; T13 is in `spheres`.)

use std::num::NonZeroUsize;

use super::measured::{Cell, Closure, Measured, MeasuredTet, Mesh};
use super::nodes::Nodes;
use super::report::Checks;
use super::tessellation::{Point, boundary_facets, edge_parameter, point, triangle_area};
use super::topology::{self, Topology};
use crate::arrays::Each as _;
use crate::elementary::cbrt;
use crate::export::pieces::{in_order, slots};
use crate::export::steps::{PIECES_PER_REPORT, Steps};
use crate::export::{ExportError, go_on};
use crate::memory::filled;

/// Largest relative error of an identity, for its rounding: a hundred times what was seen in a model of a million
/// nodes.
pub(super) const TOLERANCE: f64 = 1.0e-12;

/// Sums and extremes of a lattice, and what they come to.
pub(super) struct Checked {
    pub(super) cells: Vec<Cell>,
    pub(super) checks: Checks,
    /// Volume inside the surface, by its triangles.
    pub(super) volume_mm3: f64,
    pub(super) surface_triangles: u64,
}

/// A sum that keeps what addition loses (Neumaier).
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    sum: f64,
    lost: f64,
}

impl Sum {
    fn add(&mut self, x: f64) {
        let sum = self.sum + x;
        self.lost += if self.sum.abs() >= x.abs() { (self.sum - sum) + x } else { (x - sum) + self.sum };
        self.sum = sum;
    }

    fn get(self) -> f64 {
        self.sum + self.lost
    }
}

/// Tetrahedra that one thread measures at a time.
const TETS_PER_PIECE: usize = 256;

/// Checks a lattice. Threads share what is measured of its tetrahedra; sums are taken in the order of tetrahedra, so
/// that they do not depend on the threads.
pub(super) fn check(
    mesh: &Mesh<'_>,
    topology: &Topology,
    threads: NonZeroUsize,
    steps: &Steps<'_>,
) -> Result<Checked, ExportError> {
    let Mesh { nodes, tets, neighbors } = *mesh;
    let mut cells = filled(nodes.len(), Cell::default())?;
    let mut closures = filled(nodes.len(), Closure::default())?;
    let mut checks = Checks { edge_parameter_min: f64::INFINITY, ..Checks::default() };
    let mut sums = Sums::default();
    let pieces = tets.len().div_ceil(TETS_PER_PIECE);
    let measure = |piece: usize, measured: &mut Measured| {
        measured.tets.clear();
        measured.checks = Checks::default();
        let first = piece * TETS_PER_PIECE;
        (first..tets.len().min(first + TETS_PER_PIECE)).for_each(|t| measured.add(mesh, t));
        Ok(())
    };
    in_order(&mut slots(threads, pieces, Measured::default), pieces, measure, |piece, measured| {
        if piece.is_multiple_of(PIECES_PER_REPORT) {
            steps.report(piece * TETS_PER_PIECE);
        }
        go_on(steps.control)?;
        checks.take(&measured.checks);
        for tet in &measured.tets {
            sums.add(tet);
            tet.add_to(&mut cells, &mut closures);
        }
        Ok::<(), ExportError>(())
    })?;
    let surface = Surface::add(nodes, tets, neighbors, &mut closures);
    checks.closure_error = closures.iter().map(|c| c.vector.norm() / c.area).fold(0.0, f64::max);
    checks.cells_not_positive =
        cells.iter().filter(|cell| cell.volume_mm3.is_nan() || cell.volume_mm3 <= 0.0).count() as u64;
    checks.smallest_cell_mm3 = cells.iter().map(|cell| cell.volume_mm3).fold(f64::INFINITY, f64::min);
    sums.conclude(nodes, &cells, surface.volume_mm3, &mut checks);
    count(nodes, tets.len(), topology, &surface, &mut checks);
    edge_parameters(nodes, topology, &mut checks);
    judge(&checks)?;
    Ok(Checked { cells, checks, volume_mm3: surface.volume_mm3, surface_triangles: surface.triangles })
}

/// Sums over all tetrahedra.
#[derive(Default)]
struct Sums {
    volume: Sum,
    unsigned: Sum,
    projected: Sum,
    moment: [Sum; 3],
    fabric: [Sum; 6],
}

impl Sums {
    fn add(&mut self, tet: &MeasuredTet) {
        self.unsigned.add(tet.unsigned);
        self.projected.add(tet.projected);
        for (sum, part) in self.fabric.iter_mut().zip(tet.fabric) {
            sum.add(part);
        }
        self.volume.add(tet.volume);
        for (sum, part) in self.moment.iter_mut().zip(tet.moment.iter()) {
            sum.add(*part);
        }
    }

    fn conclude(&self, nodes: &Nodes<'_>, cells: &[Cell], volume: f64, checks: &mut Checks) {
        let mut cell_volume = Sum::default();
        let mut moment = [Sum::default(); 3];
        for (cell, p) in cells.iter().zip(&nodes.points_mm) {
            cell_volume.add(cell.volume_mm3);
            for a in 0..3 {
                moment[a].add(cell.volume_mm3 * p[a] + cell.first_moment_mm4[a]);
            }
        }
        let miss = |sum: f64| (sum - volume).abs() / volume;
        // Both the tetrahedra and the cells fill what the surface encloses.
        checks.cell_volume_error = miss(cell_volume.get()).max(miss(self.volume.get()));
        let off2: f64 = (0..3).map(|a| ((moment[a].get() - self.moment[a].get()) / volume).powi(2)).sum();
        checks.center_of_mass_error = off2.sqrt() / cbrt(volume);
        checks.unsigned_excess = (self.unsigned.get() - volume) / volume;
        checks.projected_volume_error = miss(self.projected.get());
        checks.fabric = self.fabric.each(|sum| sum.get() / (3.0 * volume));
        checks.fabric_trace_error = (checks.fabric[..3].iter().sum::<f64>() - 1.0).abs();
    }
}

/// What the triangles of the surface enclose.
struct Surface {
    triangles: u64,
    nodes: u64,
    volume_mm3: f64,
}

impl Surface {
    fn add(nodes: &Nodes<'_>, tets: &[[u32; 4]], neighbors: &[[u32; 4]], closures: &mut [Closure]) -> Self {
        let mut volume = Sum::default();
        let mut triangles = 0;
        let mut met = vec![false; nodes.len()];
        // From a point near the middle, for the sake of rounding.
        let mut apex = Point::zeros();
        let far = nodes.points_mm.iter().flatten().copied().fold(0.0, f64::max);
        apex.fill(far / 2.0);
        for face in topology::boundary(tets, neighbors) {
            triangles += 1;
            for node in face {
                met[node as usize] = true;
            }
            let corners = face.each(|node| point(nodes.points_mm[node as usize]));
            volume.add(triangle_area(corners).dot(&(corners[0] - apex)) / 3.0);
            for (node, part) in boundary_facets(nodes, face) {
                let vector = triangle_area(part);
                closures[node as usize].add(vector, vector.norm());
            }
        }
        let nodes = met.iter().filter(|&&met| met).count() as u64;
        Self { triangles, nodes, volume_mm3: volume.get() }
    }
}

fn count(nodes: &Nodes<'_>, tets: usize, topology: &Topology, surface: &Surface, checks: &mut Checks) {
    let rings = topology.rings;
    checks.rings_closed = rings.closed;
    checks.rings_open = rings.open;
    checks.rings_other = rings.other;
    // A node that no tetrahedron has would be no part of the ball.
    let unmet = nodes.len() as i64 - topology.nodes_met() as i64;
    let (edges, faces) = (topology.edge_ends.len() as i64, i64::from(topology.faces));
    checks.euler_volume = nodes.len() as i64 - edges + faces - tets as i64 - unmet;
    checks.euler_surface = surface.nodes as i64 - rings.open as i64 + surface.triangles as i64;
}

fn edge_parameters(nodes: &Nodes<'_>, topology: &Topology, checks: &mut Checks) {
    for [a, b] in topology.edges() {
        let [a, b] = [a as usize, b as usize];
        let along = point(nodes.points_mm[b]) - point(nodes.points_mm[a]);
        let length = along.norm();
        let (r, s) = (nodes.reach_mm(a, &along), nodes.reach_mm(b, &-along));
        let parameter = edge_parameter(length, r, s);
        checks.edge_parameter_min = checks.edge_parameter_min.min(parameter);
        checks.edge_parameter_max = checks.edge_parameter_max.max(parameter);
        checks.overlapping_edges += u64::from(length < (r + s) * (1.0 - TOLERANCE));
    }
}

/// Refuses a lattice for which an identity does not hold.
fn judge(checks: &Checks) -> Result<(), ExportError> {
    let errors = [
        (
            "the 24 pieces of a tetrahedron do not add up to its volume (check T1",
            checks.tetrahedron_volume_error,
        ),
        (
            "the cells of all nodes do not add up to the volume of the specimen (check T3",
            checks.cell_volume_error,
        ),
        ("the cells have another centre of mass than the specimen (check T3", checks.center_of_mass_error),
        ("the facets around a node do not close its cell (check T4", checks.closure_error),
        ("the projected area of a facet exceeds its area (check T8", checks.projected_area_error),
        (
            "a third of the sum of projected area times edge length is not the volume (check T8",
            checks.projected_volume_error,
        ),
        ("the trace of the fabric tensor is not 1 (check T12", checks.fabric_trace_error),
    ];
    for (what, error) in errors {
        if error.is_nan() || error > TOLERANCE {
            return Err(ExportError::CheckFailed(format!("{what}, relative error {error:e})")));
        }
    }
    let counts = [
        (
            "edges are not surrounded by one closed ring or one open chain of facets (check T5",
            checks.rings_other,
        ),
        ("faces have different points in their two tetrahedra (check T9", checks.nonconforming_faces),
        (
            "faces have a node inside the circumsphere of a tetrahedron, so the mesh is not a Delaunay tetrahedralisation (check T10",
            checks.delaunay_violations,
        ),
    ];
    for (what, count) in counts {
        if count > 0 {
            return Err(ExportError::CheckFailed(format!("{what}, {count} found)")));
        }
    }
    if (checks.euler_volume, checks.euler_surface) != (1, 2) {
        return Err(ExportError::CheckFailed(format!(
            "the tetrahedra do not fill a ball: their Euler characteristic is {}, that of the surface {}, not 1 and 2 \
             (check T6)",
            checks.euler_volume, checks.euler_surface
        )));
    }
    if !(checks.edge_parameter_min > 0.0 && checks.edge_parameter_max < 1.0) {
        return Err(ExportError::CheckFailed(format!(
            "points of edges lie at parameters from {} to {}, not between 0 and 1 (check T7)",
            checks.edge_parameter_min, checks.edge_parameter_max
        )));
    }
    Ok(())
}
