//! The lattice discrete particle model of a finished packing (Cusatis, Pelessone and Mencarelli 2011,
//! doi:10.1016/j.cemconcomp.2011.02.011).
//!
//! Grains but for air voids (`voids`) and nodes on the surface of the specimen ([`Nodes`]) are joined by a Delaunay
//! tetrahedralisation; each tetrahedron falls into facets between the cells of its nodes (`tessellation`); every
//! lattice is checked (`measured`, `checks`, `clearances`) and then written (`chrono`, `vtu`). Facets are many and
//! follow from the nodes: they are computed wherever they are needed, never kept.

mod checks;
mod chrono;
mod clearances;
mod inside;
mod measured;
mod nodes;
mod obstacles;
mod options;
mod report;
mod sample;
mod surface;
mod tessellation;
mod topology;
mod voids;
mod vtu;

#[cfg(test)]
mod tests;

use std::io::Write;
use std::num::NonZeroUsize;
use std::sync::Arc;

use serde_json::Value;

pub use measured::Cell;
pub use nodes::Nodes;
pub use options::{BoundaryNodes, LatticeFormat, LatticeOptions};
pub use report::{Checks, LatticeReport, NodeReport};

use crate::arrays::Each as _;
use crate::control::{Control, Part};
use crate::export::estimate::{Expected, ExportEstimate};
use crate::export::kind::Export;
use crate::export::steps::Steps;
use crate::export::{ExportError, Model, Provenance};
use crate::geometry::delaunay::{Delaunay, DelaunayError, delaunay};
use crate::grain::PlacedGrains;
use crate::memory;
use crate::plan::Limits;
use crate::request::decode::Object;
use crate::request::{FieldError, Specimen};
use measured::Mesh;
use tessellation::point;
use topology::Topology;
use vtu::Vtu;

/// Memory per node at the peak, in bytes: tetrahedra and their neighbours, lists of what meets at nodes, cells.
const BYTES_PER_NODE: f64 = 600.0;

/// A lattice, checked.
#[derive(Debug)]
pub struct Lattice<'a> {
    nodes: Nodes<'a>,
    tets: Vec<[u32; 4]>,
    neighbors: Vec<[u32; 4]>,
    topology: Topology,
    cells: Vec<Cell>,
    report: LatticeReport,
}

impl Export for LatticeOptions {
    type Report = LatticeReport;

    const NAME: &'static str = "ldpm";
    const FORMATS: &'static [&'static str] = &["chrono", "tets", "facets", "cells"];

    fn from_object(object: &mut Object<'_>) -> Option<Self> {
        Self::read(object)
    }

    fn format(&self) -> &'static str {
        self.format.name()
    }

    fn media_type(&self) -> &'static str {
        self.format.media_type()
    }

    fn file_extension(&self) -> &'static str {
        self.format.extension()
    }

    fn name_parts(&self) -> Vec<&'static str> {
        vec![Self::NAME, self.format.name()]
    }

    /// Half of the fictitious diameter comes with it.
    fn is_implied(&self, option: &str, value: &Value) -> bool {
        option == "surface_radius"
            && value.as_f64().is_some_and(|radius| radius * 2.0 == self.fictitious_diameter)
    }

    /// Judges what can be judged before there are grains.
    ///
    /// # Errors
    /// [`ExportError::Unavailable`] in a periodic box.
    fn check(&self, specimen: &Specimen, _: &Limits) -> Result<(), ExportError> {
        if specimen.is_periodic() {
            return Err(ExportError::Unavailable(
                "a lattice needs a surface to lay nodes on, and a periodic box has none: pack with \"boundary\": \"walls\""
                    .into(),
            ));
        }
        Ok(())
    }

    fn estimate(&self, of: &Expected<'_>) -> Result<ExportEstimate, ExportError> {
        let bytes = expected_bytes(of.specimen(), self, of.grains(), of.d_min_mm());
        Ok(ExportEstimate::of_bytes(bytes))
    }

    /// Makes a lattice of a packing and writes the file that is asked for.
    ///
    /// # Errors
    /// [`ExportError`].
    fn write(
        &self,
        model: &Model<'_>,
        limits: &Limits,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<LatticeReport, ExportError> {
        // By measured times: text takes long, and so do the many arrays of facets.
        let made = match self.format {
            LatticeFormat::Chrono => 0.15,
            LatticeFormat::Facets | LatticeFormat::Cells => 0.4,
            LatticeFormat::Tets => 0.9,
        };
        let solid = voids::without_voids(model);
        let of_solid = solid.as_ref().map(|grains| Model { grains: grains.into(), ..*model });
        let model = of_solid.as_ref().unwrap_or(model);
        let lattice = Lattice::make(model, self, limits, &Part::new(control, 0.0, made))?;
        let threads = limits.export_threads;
        lattice.write(self, model.provenance, threads, &Part::new(control, made, 1.0), out)?;
        Ok(lattice.report)
    }
}

impl<'a> Lattice<'a> {
    /// Makes a lattice of a packing.
    ///
    /// # Errors
    /// [`ExportError`], but for [`ExportError::Write`].
    pub fn make(
        model: &Model<'a>,
        options: &LatticeOptions,
        limits: &Limits,
        control: &dyn Control,
    ) -> Result<Self, ExportError> {
        let (specimen, grains) = (model.specimen, &Arc::new(PlacedGrains::new(model.grains)?));
        options.check(specimen, limits)?;
        if grains.is_empty() {
            return Err(ExportError::Unavailable("a lattice needs grains, and this packing has none".into()));
        }
        check_spacing(specimen, grains, options)?;
        check_memory(specimen, grains, options, limits)?;
        let nodes = nodes::lay(specimen, grains, options, control)?;
        let Delaunay { nodes: tets, neighbors } = delaunay(&nodes.points_mm, &Part::new(control, 0.02, 0.4))?;
        let topology = Topology::new(nodes.len(), &tets, &neighbors, control)?;
        check_radii(&nodes, &topology)?;
        let (total, message) = (tets.len(), "cells, facets and their checks");
        let steps = Steps { control: &Part::new(control, 0.5, 1.0), total, unit: "tetrahedra", message };
        let mesh = Mesh { nodes: &nodes, tets: &tets, neighbors: &neighbors };
        let mut checked = checks::check(&mesh, &topology, limits.export_threads, &steps)?;
        let mut node_report = NodeReport::new(&nodes, options);
        let clear = options.fictitious_diameter * nodes.d_min_mm / 2.0;
        let spans = [clear, node_report.spacing_mm];
        let (checks, of_nodes) = (&mut checked.checks, &mut node_report);
        clearances::check(specimen, grains, &nodes, spans, control, checks, of_nodes)?;
        let facet_area_in_grains = inside::share_of_facets(specimen, grains, &nodes, &tets, control)?;
        let report = LatticeReport {
            nodes: node_report,
            edges: topology.edge_ends.len() as u64,
            tetrahedra: tets.len() as u64,
            facets: 12 * tets.len() as u64,
            facet_area_in_grains,
            surface_triangles: checked.surface_triangles,
            volume_mm3: checked.volume_mm3,
            volume_over_specimen: checked.volume_mm3 / specimen.volume_mm3(),
            checks: checked.checks,
        };
        let lattice = Self { nodes, tets, neighbors, topology, cells: checked.cells, report };
        lattice.check_surface(specimen)?;
        Ok(lattice)
    }

    /// Writes the file that is asked for; VTK files state the provenance. The bytes do not depend on the threads.
    ///
    /// # Errors
    /// [`ExportError::Stopped`] and [`ExportError::Write`]; [`ExportError::Unavailable`] for a grid of more points
    /// than it can number.
    pub fn write(
        &self,
        options: &LatticeOptions,
        provenance: Option<&Provenance>,
        threads: NonZeroUsize,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<(), ExportError> {
        let (total, message) = (self.tets.len(), "writing the lattice");
        let steps = Steps { control, total, unit: "tetrahedra", message };
        let vtu = Vtu { lattice: self, provenance, steps: &steps, threads };
        match options.format {
            LatticeFormat::Chrono => chrono::write(self, options, threads, &steps, out),
            LatticeFormat::Tets => vtu.write_tets(out),
            LatticeFormat::Facets => vtu.write_facets(out),
            LatticeFormat::Cells => vtu.write_cells(out),
        }
    }

    /// Its nodes.
    pub fn nodes(&self) -> &Nodes<'a> {
        &self.nodes
    }

    /// Its tetrahedra, as numbers of nodes.
    pub fn tetrahedra(&self) -> &[[u32; 4]] {
        &self.tets
    }

    /// What its cells enclose, by node.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// What is known about it.
    pub fn report(&self) -> &LatticeReport {
        &self.report
    }

    /// Nodes on the surface, by Euler's formula for its triangles, which was checked.
    fn surface_nodes(&self) -> u64 {
        self.report.surface_triangles / 2 + 2
    }

    /// Whether the surface is the specimen's: made of nodes that were laid on it, and a box's with its volume.
    fn check_surface(&self, specimen: &Specimen) -> Result<(), ExportError> {
        let grains = topology::boundary(&self.tets, &self.neighbors)
            .flatten()
            .filter(|&node| node as usize >= self.nodes.boundary)
            .count();
        if grains > 0 {
            return Err(ExportError::Unavailable(format!(
                "nodes {} mm apart are too few to enclose the grains of this specimen: choose a smaller \"spacing\"",
                self.report.nodes.spacing_mm
            )));
        }
        let error = (self.report.volume_over_specimen - 1.0).abs();
        if specimen.domain().lateral().is_none() && error > checks::TOLERANCE {
            return Err(ExportError::CheckFailed(format!(
                "the surface does not enclose the volume of the box (check T3, relative error {error:e})"
            )));
        }
        Ok(())
    }
}

/// Length of the file of a lattice, within a factor of 1.5: by the tetrahedra that grains and nodes on the surface have
/// on average, and the bytes of each in a format.
fn expected_bytes(specimen: &Specimen, options: &LatticeOptions, grains: f64, d_min_mm: f64) -> u64 {
    let boundary = nodes::expected_on_boundary(specimen, options, d_min_mm);
    let tetrahedra = 6.5 * grains + 2.8 * boundary;
    let per_tetrahedron = match options.format {
        LatticeFormat::Chrono => 1300.0,
        LatticeFormat::Tets => 42.0,
        LatticeFormat::Facets => 1650.0,
        LatticeFormat::Cells => 620.0,
    };
    (4000.0 + per_tetrahedron * tetrahedra) as u64
}

/// Refuses to make a prism of fewer than six sides of a cylinder.
fn check_spacing(
    specimen: &Specimen,
    grains: &PlacedGrains<'_>,
    options: &LatticeOptions,
) -> Result<(), ExportError> {
    let spacing_mm = options.spacing * grains.d_min_mm();
    match specimen.domain().lateral() {
        Some(lateral) if spacing_mm > lateral.radius_mm => Err(ExportError::Unavailable(format!(
            "nodes {spacing_mm} mm apart make no cylinder of {} mm: choose a smaller \"spacing\"",
            2.0 * lateral.radius_mm
        ))),
        _ => Ok(()),
    }
}

/// Refuses surface nodes so large that the points of their edges, half way between the bodies at both ends, would lie
/// beyond one of the ends.
fn check_radii(nodes: &Nodes<'_>, topology: &Topology) -> Result<(), ExportError> {
    let of_surface = |node: u32| (node as usize) < nodes.boundary;
    for [a, b] in topology.edges() {
        let [p, q] = [a, b].each(|node| point(nodes.points_mm[node as usize]));
        let along = q - p;
        let length_mm = along.norm();
        let (first, second) = (nodes.reach_mm(a as usize, &along), nodes.reach_mm(b as usize, &-along));
        let reach_mm = if of_surface(a) && of_surface(b) { first } else { (first - second).abs() };
        if reach_mm >= length_mm && (of_surface(a) || of_surface(b)) {
            let radius_mm = if of_surface(a) { first } else { second };
            return Err(ExportError::Unavailable(format!(
                "surface nodes of radius {radius_mm} mm are too large for an edge of {length_mm} mm from such a node to \
                 the next node: choose a smaller \"surface_radius\" (half the fictitious diameter when absent)"
            )));
        }
    }
    Ok(())
}

fn check_memory(
    specimen: &Specimen,
    grains: &PlacedGrains<'_>,
    options: &LatticeOptions,
    limits: &Limits,
) -> Result<(), ExportError> {
    let boundary = nodes::expected_on_boundary(specimen, options, grains.d_min_mm());
    let grains = grains.len() as f64;
    let bytes = (boundary + grains) * BYTES_PER_NODE;
    if bytes <= limits.max_memory_bytes as f64 {
        // What comes in small pieces is asked for as one.
        return Ok(memory::probe(bytes as usize)?);
    }
    let (pointer, advice) =
        if boundary > grains { ("/spacing", "choose a larger spacing") } else { ("", "pack fewer grains") };
    Err(ExportError::TooLarge(FieldError {
        pointer: pointer.into(),
        detail: format!(
            "a lattice of about {boundary:.0} nodes on the surface and {grains:.0} grains takes {:.1} GB of memory, and {:.1} GB may be used: {advice}",
            bytes / 1e9,
            limits.max_memory_bytes as f64 / 1e9
        ),
    }))
}

impl From<DelaunayError> for ExportError {
    fn from(error: DelaunayError) -> Self {
        match error {
            DelaunayError::Stopped => ExportError::Stopped,
            DelaunayError::OutOfMemory { bytes } => ExportError::OutOfMemory { bytes },
            other => ExportError::Unavailable(other.to_string()),
        }
    }
}
