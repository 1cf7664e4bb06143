//! Meshes of tetrahedra: the surfaces of a packing, filled by a program that the caller gives, read back and checked.
//!
//! `options` says how long edges are, `script` what the program is given, `size_field` how edges grow away from the
//! surfaces. The tetrahedra keep the triangles of the surfaces, so that each grain keeps the volume of its polyhedron;
//! mid nodes are the middles of edges, so that elements of the second order have it too and none is turned inside out.

mod options;
mod script;
mod size_field;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;

use std::io::{self, Write};

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::bodies::MeshModel;
use super::options::SurfaceOptions;
use super::surfaces::Mesh;
use super::{SurfaceReport, check, estimate, msh};
use crate::arrays::Each as _;
use crate::control::{Control, Part, Unattended};
use crate::elementary::powf;
use crate::export::estimate::MeshEstimate;
use crate::export::groups::AggregateGroups;
use crate::export::mesher::{self, MeshDimension, MesherFiles, MesherInput};
use crate::export::solid::msh::Bodies;
use crate::export::solid::{ElementKind, PhaseMeasures, SolidMeasures, SolidMesh};
use crate::export::{ExportError, Model};
use crate::plan::Limits;
use crate::request::{FieldError, Specimen};

pub use options::{MeshElements, MeshOptions, TetrahedronOptions};

/// Tetrahedra for each triangle of the surfaces: measured, 3.0 to 4.7 (`docs/meshes.md`).
const PER_TRIANGLE: f64 = 3.5;
/// Tetrahedra in a cube of the length of their edges.
const PER_CUBE: f64 = 9.0;
/// Nodes for each tetrahedron, of the first order and of the second.
const NODES_PER_TETRAHEDRON: [f64; 2] = [0.2, 1.45];
/// The number of tetrahedra may miss its aim by so much without a second run.
const MISS: f64 = 0.1;
/// The number of tetrahedra falls with this power of the size: between those of surfaces and of volumes.
const POWER: f64 = 2.3;
/// Halvings of the size that is looked for.
const HALVINGS: usize = 12;
/// Largest error of the volume of the specimen, and of that of each grain, against the surfaces.
const VOLUME_ERROR: f64 = 1e-9;

/// The figures of the tetrahedra of a mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct TetrahedronReport {
    /// Tetrahedra.
    pub elements: u64,
    /// The number that was aimed at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub target_elements: Option<u64>,
    /// Runs of the program that made them: two where the first missed the aim.
    pub runs: u32,
    /// Nodes, mid nodes among them.
    pub nodes: u64,
    /// Three for each node.
    pub degrees_of_freedom: u64,
    /// Least gamma (Gmsh's quality by the corners: 1 regular, 0 flat).
    pub smallest_gamma: f64,
    /// Tetrahedra of a gamma below 0.03.
    pub elements_below_gamma_0_03: u64,
    /// The phases, the matrix first.
    pub phases: Vec<PhaseMeasures>,
    /// Volume of all tetrahedra over that of the specimen, minus one. A cylinder has a polygonal surface.
    pub specimen_volume_error: f64,
    /// Largest error of the volume of a grain: that of its tetrahedra over that of the grain, minus one, without the
    /// sign.
    pub largest_grain_volume_error: f64,
    /// The program that made them, with its version.
    pub mesher: String,
    /// The options that it was given.
    pub mesher_options: Vec<String>,
}

/// What a file of tetrahedra is written of.
pub(in crate::export) struct Filled {
    /// The tetrahedra.
    pub(in crate::export) mesh: SolidMesh,
    pub(in crate::export) report: SurfaceReport,
    files: Box<dyn MesherFiles>,
}

/// Fills the surfaces of a packing with tetrahedra.
///
/// # Errors
/// Those of surfaces, of the mesher, and [`ExportError::Unavailable`] where the model has no mesher.
pub(in crate::export) fn fill(
    model: &Model<'_>,
    surfaces: &SurfaceOptions,
    options: &TetrahedronOptions,
    also: Option<&'static str>,
    limits: &Limits,
    control: &dyn Control,
) -> Result<Filled, ExportError> {
    check(model.specimen)?;
    let mesher = mesher::of_model(model)?;
    let version = mesher.version()?;
    let mut size_mm = match options.target_elements {
        Some(target) => Some(size_for(model, surfaces, options, target)?),
        None => None,
    };
    let most_runs = if options.target_elements.is_some() { 2 } else { 1 };
    let mut run = 0;
    loop {
        run += 1;
        // By measured times: Gmsh takes most of them.
        let of_run = |share: f64| 0.95 * (f64::from(run - 1) + share) / f64::from(most_runs);
        let own = options.of_surfaces(surfaces, size_mm);
        let on_surfaces = Part::new(control, of_run(0.0), of_run(0.05));
        let (mesh, report) = Mesh::bounded(model, &own, options.tet_size_matrix_mm, limits, &on_surfaces)?;
        refuse_too_large(&report, model.specimen, options, surfaces, limits)?;
        let sizes = sizes(model, &mesh, options, control)?;
        let gmsh_options = script::options(options.order, sizes.is_some());
        let groups = AggregateGroups::of(model);
        let mut write = |out: &mut dyn Write| msh::write_mesh(&mesh, &groups, &Unattended, out);
        let input = MesherInput {
            dimension: MeshDimension::Solid,
            surfaces: Some(&mut write),
            script: &script::script(&gmsh_options),
            sizes: sizes.as_deref(),
            also,
        };
        let files = mesher.fill(input, &Part::new(control, of_run(0.05), of_run(0.95)))?;
        let solid =
            mesher::read(&*files, Bodies::Tetrahedra, &Part::new(control, of_run(0.95), of_run(1.0)))?;
        let count = solid.len() as f64;
        if let (Some(target), Some(size)) = (options.target_elements, &mut size_mm)
            && run < most_runs
            && (count / target as f64 - 1.0).abs() > MISS
        {
            *size *= powf(count / target as f64, 1.0 / POWER);
            continue;
        }
        let mut filled = Filled { mesh: solid, report, files };
        groups.name_phases(model, &mut filled.mesh.phases);
        let checking = Part::new(control, 0.95, 1.0);
        let measures = filled.mesh.check(&checking).map_err(mesher::unusable)?;
        filled.report.tetrahedra = Some(TetrahedronReport {
            elements: measures.elements,
            target_elements: options.target_elements,
            runs: run,
            nodes: measures.nodes,
            degrees_of_freedom: 3 * measures.nodes,
            smallest_gamma: measures.smallest_gamma.unwrap_or_default(),
            elements_below_gamma_0_03: measures.elements_below_gamma_0_03,
            specimen_volume_error: measures.volume_mm3 / model.specimen.volume_mm3() - 1.0,
            largest_grain_volume_error: filled.grain_volumes(model, &mesh, &measures)?,
            phases: measures.phases,
            mesher: version,
            mesher_options: gmsh_options,
        });
        if let Some(target) = options.target_elements
            && (count / target as f64 - 1.0).abs() > 2.0 * MISS
        {
            filled.report.warnings.push(format!(
                "the mesh has {count} tetrahedra where {target} were aimed at: the gaps and the sizes of the grains \
                 decide the least number"
            ));
        }
        return Ok(filled);
    }
}

/// A file of tetrahedra, by its format.
///
/// # Errors
/// Those of [`fill`].
pub(super) fn write(
    model: &Model<'_>,
    surfaces: &SurfaceOptions,
    options: &TetrahedronOptions,
    format: &str,
    limits: &Limits,
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<SurfaceReport, ExportError> {
    let also = (format == "med").then_some("med");
    let filled = fill(model, surfaces, options, also, limits, &Part::new(control, 0.0, 0.95))?;
    let control = &Part::new(control, 0.95, 1.0);
    match format {
        "inp" => filled.mesh.write_inp(&filled.head(), control, out)?,
        "vtu" => filled.mesh.write_vtu(model.provenance, control, out)?,
        ending => {
            io::copy(&mut filled.files.open(ending)?, out)?;
        }
    }
    Ok(filled.report)
}

/// Says how many tetrahedra surfaces of these triangles are filled with, and how long the file is.
pub(super) fn estimated(
    triangles: u64,
    specimen: &Specimen,
    options: &TetrahedronOptions,
    format: &str,
) -> MeshEstimate {
    let elements = options.target_elements.unwrap_or_else(|| {
        let by_size =
            options.tet_size_matrix_mm.map_or(0.0, |size| PER_CUBE * specimen.volume_mm3() / size.powi(3));
        (PER_TRIANGLE * triangles as f64).max(by_size) as u64
    });
    let per_tetrahedron = NODES_PER_TETRAHEDRON[usize::from(options.order == 2)];
    let nodes = ((per_tetrahedron * elements as f64) as u64).max(4);
    let kind = if options.order == 2 { ElementKind::Tetrahedron10 } else { ElementKind::Tetrahedron4 };
    let bytes = match format {
        "inp" => SolidMesh::inp_bytes(kind, nodes, elements),
        "vtu" => SolidMesh::vtu_bytes(kind, nodes, elements),
        // 8 bytes a number; triangles on the surfaces are elements too.
        _ => 32 * nodes + 8 * (1 + kind.nodes() as u64) * elements + 8 * (kind.nodes() as u64) * triangles,
    };
    MeshEstimate {
        triangles,
        bytes,
        tetrahedra: Some(elements),
        nodes: Some(nodes),
        degrees_of_freedom: Some(3 * nodes),
    }
}

/// Refuses a file that is likely to be longer than it may be.
fn refuse_too_large(
    report: &SurfaceReport,
    specimen: &Specimen,
    options: &TetrahedronOptions,
    surfaces: &SurfaceOptions,
    limits: &Limits,
) -> Result<(), ExportError> {
    let without_target = TetrahedronOptions { target_elements: None, ..options.clone() };
    let estimate = estimated(report.triangles, specimen, &without_target, "inp");
    let most = surfaces.max_bytes.min(limits.max_memory_bytes);
    if estimate.bytes <= most {
        return Ok(());
    }
    let raise = if most == surfaces.max_bytes { ", or raise max_bytes" } else { "" };
    Err(ExportError::TooLarge(FieldError {
        pointer: "/max_bytes".into(),
        detail: format!(
            "the mesh has about {:.1} million tetrahedra, {} MB: at most {} MB may be made; lower segments or max_segments, \
             give a larger tet_size_mm, or a lower target_elements{raise}",
            estimate.tetrahedra.unwrap_or(0) as f64 / 1e6,
            estimate.bytes.div_ceil(1_000_000),
            most / 1_000_000
        ),
    }))
}

/// The edges of surfaces by which a number of tetrahedra is likely to come out.
fn size_for(
    model: &Model<'_>,
    surfaces: &SurfaceOptions,
    options: &TetrahedronOptions,
    target: u64,
) -> Result<f64, ExportError> {
    let [x, y, z] = model.specimen.bounds_mm();
    let of_mesh = MeshModel::new(model)?;
    let (mut low, mut high) = (1e-3 * x.min(y).min(z), x.min(y).min(z));
    for _ in 0..HALVINGS {
        let middle = (low * high).sqrt();
        let own = options.of_surfaces(surfaces, Some(middle));
        let (estimate, _, _) = estimate::of_model(&of_mesh, &own, &Unattended)?;
        if PER_TRIANGLE * estimate.triangles as f64 > target as f64 { low = middle } else { high = middle }
    }
    Ok((low * high).sqrt())
}

/// The file of lengths of edges, where they are to grow.
fn sizes(
    model: &Model<'_>,
    mesh: &Mesh,
    options: &TetrahedronOptions,
    control: &dyn Control,
) -> Result<Option<Vec<u8>>, ExportError> {
    if options.tet_growth.is_none() && options.tet_size_matrix_mm.is_none() {
        return Ok(None);
    }
    let bounds_mm = model.specimen.bounds_mm();
    let growth = options.tet_growth.unwrap_or(options::DEFAULT_GROWTH);
    let most_mm = options.tet_size_matrix_mm.unwrap_or(bounds_mm[0].max(bounds_mm[1]).max(bounds_mm[2]));
    let field = size_field::SizeField::new(mesh, bounds_mm, growth, most_mm, control)?;
    field.to_bytes().map(Some)
}

/// The volume inside closed surfaces, about a point on them, in mm³.
fn volume_inside(points: &[[f64; 3]], triangles: &[[u32; 3]]) -> f64 {
    let origin = points.first().copied().map_or_else(Vector3::zeros, Vector3::from);
    let six: f64 = triangles
        .iter()
        .map(|corners| {
            let [a, b, c] = corners.each(|corner| Vector3::from(points[corner as usize]) - origin);
            a.dot(&b.cross(&c))
        })
        .sum();
    six / 6.0
}

impl Filled {
    /// The largest error of a grain's volume; refuses tetrahedra that leave a part of the specimen or of a grain out.
    fn grain_volumes(
        &self,
        model: &Model<'_>,
        surfaces: &Mesh,
        measures: &SolidMeasures,
    ) -> Result<f64, ExportError> {
        let missing = |what: &str, volume: f64, expected: f64| {
            ExportError::Mesher(format!(
                "Gmsh's tetrahedra {what} have a volume of {volume} mm³ where the surfaces have {expected} mm³"
            ))
        };
        let is_equal = |volume: f64, expected: f64| (volume / expected - 1.0).abs() <= VOLUME_ERROR;
        let shell = surfaces.shell.surface.volume_mm3();
        if !is_equal(measures.volume_mm3, shell) {
            return Err(missing("of the specimen", measures.volume_mm3, shell));
        }
        let bodies = &MeshModel::new(model)?.bodies;
        let mut volumes = vec![0.0; surfaces.grains()];
        for element in 0..self.mesh.len() {
            let grain = self.mesh.grain_of[element] as usize;
            if grain > 0 {
                let own = volumes.get_mut(grain - 1).ok_or_else(|| {
                    ExportError::Mesher(format!(
                        "Gmsh's mesh has more volumes than the {} grains",
                        surfaces.grains()
                    ))
                })?;
                *own += self.mesh.volume_mm3(element);
            }
        }
        let mut largest: f64 = 0.0;
        for (row, volume) in volumes.into_iter().enumerate() {
            let (points, triangles) = surfaces.grain(row);
            let expected = volume_inside(points, triangles);
            if !is_equal(volume, expected) {
                return Err(missing(&format!("of grain {row}"), volume, expected));
            }
            largest = largest.max((volume / bodies.volume_mm3(row) - 1.0).abs());
        }
        Ok(largest)
    }

    /// The lines at the head of a file.
    fn head(&self) -> Vec<String> {
        let mut head = vec![format!("Packstone {}: units mm", crate::VERSION)];
        if let Some(report) = &self.report.tetrahedra {
            head.push(format!(
                "{} tetrahedra by {}; smallest gamma {:.3}",
                report.elements, report.mesher, report.smallest_gamma
            ));
        }
        head.push(
            "sets of elements: the phases; sets of nodes and surfaces: the faces of the specimen".into(),
        );
        head
    }
}
