//! Triangles of a cut: the script of `geo`, meshed by a program that the caller gives, read back and checked.
//!
//! The program is given the lengths of edges and the order of the elements. Circles and ellipses are enlarged to
//! polygons of their area, as far as the gaps allow; mid nodes are the middles of edges, so that elements of both
//! orders have the same shape.

use std::io::{self, Write};

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::geo;
use super::sizes::Sizes;
use super::{Cut, Figure, Outline, SliceFormat};
use crate::arrays::Each as _;
use crate::control::{Control, Part};
use crate::elementary::hypot;
use crate::export::groups::AggregateGroups;
use crate::export::mesher::{self, MeshDimension, MesherFiles, MesherInput};
use crate::export::solid::msh::Bodies;
use crate::export::solid::{ElementKind, PhaseMeasures, PhaseRole, PlaneState, SolidMesh};
use crate::export::{ExportError, Model, Provenance};
use crate::plan::Limits;
use crate::request::decode::{Bound, Object};
use crate::request::{FieldError, MAX_LENGTH_MM};

/// Bounds of the segments of a circumference.
const SEGMENTS: (i64, i64) = (6, 256);
/// Segments of a circumference where nothing else is requested.
const DEFAULT_SEGMENTS: u32 = 20;
/// Triangles around and in a section, over the square of its segments: measured (`docs/voxels.md`).
const PER_SECTION: f64 = 0.55;
/// Nodes for each triangle, of the first order and of the second.
const NODES_PER_TRIANGLE: [f64; 2] = [0.55, 2.1];
/// Largest error of the area of a rectangle.
const AREA_ERROR: f64 = 1e-9;
/// The aggregate may lack or exceed this share of its area before it is told, and before the mesh is refused.
const TOLD: f64 = 0.005;
const REFUSED: f64 = 0.02;
/// Options of Gmsh that do not depend on the mesh. Frontal-Delaunay (Rebay 1993, DOI 10.1006/jcph.1993.1097) on one
/// thread gives the same triangles in each run.
const OPTIONS: [&str; 4] = [
    "Mesh.Algorithm = 6",
    "General.NumThreads = 1",
    "Mesh.MshFileVersion = 4.1",
    "Mesh.SecondOrderLinear = 1",
];

/// What a cut consists of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum SliceElements {
    /// Triangles of an installed Gmsh.
    #[default]
    Triangles,
}

/// How a cut is divided into triangles.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct TriangleOptions {
    /// The elements of the formats `msh`, `inp` and `vtu`; others have none.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub elements: SliceElements,
    /// 1: triangles with 3 nodes; 2: with 6, whose mid nodes are the middles of the edges.
    #[cfg_attr(feature = "openapi", schema(default = 1, required = false, minimum = 1, maximum = 2))]
    pub order: u32,
    /// What is assumed across the plane: `stress` is plane stress (CPS3, CPS6), `strain` plane strain (CPE3, CPE6).
    #[cfg_attr(feature = "openapi", schema(default = "stress", required = false))]
    pub plane: PlaneState,
    /// Segments of the circumference of each section. Default: 20.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 6, maximum = 256))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub segments: Option<u32>,
    /// No edge is asked to be longer, in mm. Default: a twenty-fifth of the longer edge of the cut.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 1e6)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_size_mm: Option<f64>,
}

/// The figures of the triangles of a cut.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct TriangleReport {
    /// Triangles.
    pub elements: u64,
    /// Their name in Abaqus and CalculiX.
    pub element_type: String,
    /// Nodes, mid nodes among them.
    pub nodes: u64,
    /// Two for each node.
    pub degrees_of_freedom: u64,
    /// Least gamma (Gmsh's quality by the corners: 1 regular, 0 flat).
    pub smallest_gamma: f64,
    /// Triangles of a gamma below 0.03.
    pub elements_below_gamma_0_03: u64,
    /// The phases, the matrix first; volumes are of a thickness of 1 mm.
    pub phases: Vec<PhaseMeasures>,
    /// Area of all triangles over that of the cut, minus one. A disc has a polygonal edge.
    pub area_error: f64,
    /// Area of the triangles of the aggregate over that of its sections, minus one; 0 where there are none.
    pub aggregate_area_error: f64,
    /// The program that made them, with its version.
    pub mesher: String,
    /// The options that it was given.
    pub mesher_options: Vec<String>,
    /// What is missing of the mesh, in words.
    #[serde(default)]
    pub warnings: Vec<String>,
}

impl TriangleOptions {
    /// Names of the options beside `elements`.
    pub(in crate::export) const NAMES: [&str; 4] = ["order", "plane", "segments", "max_size_mm"];

    /// Reads the options, `elements` among them.
    pub(super) fn read(object: &mut Object<'_>) -> Option<Self> {
        let elements = match object.optional("elements") {
            Some(at) => at.choice(&[("triangles", SliceElements::Triangles)]),
            None => Some(SliceElements::Triangles),
        };
        let read = Self::read_sizes(object);
        elements.and(read)
    }

    /// Reads the options, where something else has said that there are triangles.
    pub(in crate::export) fn read_sizes(object: &mut Object<'_>) -> Option<Self> {
        let order = object.optional("order").map_or(Some(1), |at| at.integer(1, 2).map(|order| order as u32));
        let plane = object.optional("plane").map_or(Some(PlaneState::Stress), |at| {
            at.choice(&PlaneState::ALL.map(|state| (state.name(), state)))
        });
        let segments = match object.optional("segments") {
            Some(at) => at.integer(SEGMENTS.0, SEGMENTS.1).map(|count| Some(count as u32)),
            None => Some(None),
        };
        let max_size_mm = match object.optional("max_size_mm") {
            Some(at) => at.number(Bound::positive(MAX_LENGTH_MM, "mm")).map(Some),
            None => Some(None),
        };
        Some(Self {
            elements: SliceElements::Triangles,
            order: order?,
            plane: plane?,
            segments: segments?,
            max_size_mm: max_size_mm?,
        })
    }

    fn kind(&self) -> ElementKind {
        if self.order == 2 { ElementKind::Triangle6(self.plane) } else { ElementKind::Triangle3(self.plane) }
    }

    fn sizes(&self, outline: &Outline) -> Sizes {
        let standard = Sizes::of(outline);
        Sizes {
            segments: self.segments.unwrap_or(DEFAULT_SEGMENTS),
            longest_mm: self.max_size_mm.unwrap_or(standard.longest_mm),
        }
    }

    /// Length of the file of a cut with this number of sections.
    pub(super) fn expected_bytes(&self, size_mm: [f64; 2], sections: f64) -> u64 {
        let [u_mm, v_mm] = [[0.0, size_mm[0]], [0.0, size_mm[1]]];
        let sizes = self.sizes(&Outline::Rectangle { u_mm, v_mm });
        let by_size = size_mm[0] * size_mm[1] / (0.75_f64.sqrt() / 2.0 * sizes.longest_mm.powi(2));
        let segments = f64::from(sizes.segments);
        let triangles = by_size + PER_SECTION * segments * segments * sections;
        let nodes = NODES_PER_TRIANGLE[usize::from(self.order == 2)] * triangles;
        SolidMesh::inp_bytes(self.kind(), nodes as u64, triangles as u64)
    }

    /// Refuses a mesh that is likely to be larger than it may be.
    pub(super) fn check(&self, size_mm: [f64; 2], sections: f64, limits: &Limits) -> Result<(), ExportError> {
        let bytes = self.expected_bytes(size_mm, sections);
        if bytes <= limits.max_memory_bytes {
            return Ok(());
        }
        let pointer = if self.max_size_mm.is_some() { "/max_size_mm" } else { "/segments" };
        let detail = format!(
            "the triangles of the cut take {} MB: at most {} MB may be made; give a larger max_size_mm or fewer segments",
            bytes.div_ceil(1_000_000),
            limits.max_memory_bytes / 1_000_000
        );
        Err(ExportError::TooLarge(FieldError::new(pointer, detail)))
    }
}

/// The triangles of a cut, with their figures and files.
pub(in crate::export) struct MeshedCut {
    pub(in crate::export) mesh: SolidMesh,
    pub(in crate::export) report: TriangleReport,
    files: Box<dyn MesherFiles>,
}

impl MeshedCut {
    /// Writes a file that has triangles.
    pub(super) fn write(
        &self,
        format: SliceFormat,
        provenance: Option<&Provenance>,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<(), ExportError> {
        let control = &Part::new(control, 0.8, 1.0);
        match format {
            SliceFormat::Inp => self.mesh.write_inp(&self.head(), control, out),
            SliceFormat::Vtu => self.mesh.write_vtu(provenance, control, out),
            _ => Ok(io::copy(&mut self.files.open("msh")?, out).map(|_| ())?),
        }
    }

    /// The lines at the head of a file.
    fn head(&self) -> Vec<String> {
        let report = &self.report;
        vec![
            format!("Packstone {}: units mm; a plane model of a thickness of 1 mm", crate::VERSION),
            format!(
                "{} triangles by {}; smallest gamma {:.3}",
                report.elements, report.mesher, report.smallest_gamma
            ),
            "sets of elements: the phases; sets of nodes and surfaces: the edges of the cut".into(),
        ]
    }
}

/// Divides a cut into triangles.
///
/// # Errors
/// [`ExportError::TooLarge`], those of the mesher, and [`ExportError::Unavailable`] where the model has no mesher or
/// where too much of the aggregate's area is missing.
pub(in crate::export) fn mesh_of(
    model: &Model<'_>,
    cut: &Cut,
    options: &TriangleOptions,
    limits: &Limits,
    control: &dyn Control,
) -> Result<MeshedCut, ExportError> {
    let mesher = mesher::of_model(model)?;
    let version = mesher.version()?;
    let size_mm = cut.outline.bounds_mm().each(|[low, high]| high - low);
    options.check(size_mm, cut.sections.len() as f64, limits)?;
    let groups = AggregateGroups::of(model);
    let mut gmsh_options: Vec<String> = OPTIONS.map(str::to_owned).into();
    gmsh_options.push(format!("Mesh.ElementOrder = {}", options.order));
    let mut script = Vec::new();
    let sizes = options.sizes(&cut.outline);
    geo::write(cut, sizes, &groups, &mut script)?;
    for option in &gmsh_options {
        writeln!(script, "{option};")?;
    }
    let script = String::from_utf8(script).map_err(|error| ExportError::CheckFailed(error.to_string()))?;
    let input = MesherInput {
        dimension: MeshDimension::Plane,
        surfaces: None,
        script: &script,
        sizes: None,
        also: None,
    };
    let files = mesher.fill(input, &Part::new(control, 0.0, 0.7))?;
    let mut mesh = mesher::read(&*files, Bodies::Triangles(options.plane), &Part::new(control, 0.7, 0.8))?;
    groups.name_phases(model, &mut mesh.phases);
    let measures = mesh.check(control).map_err(mesher::unusable)?;
    name_grains(&mut mesh, cut)?;
    let area_error = measures.volume_mm3 / cut.outline.area_mm2() - 1.0;
    let lacks = match cut.outline {
        Outline::Rectangle { .. } => AREA_ERROR,
        // Of a regular polygon, with something for edges of other lengths.
        Outline::Disc { .. } => {
            let angle = std::f64::consts::TAU / f64::from(sizes.segments);
            1.2 * (1.0 - crate::elementary::sin(angle) / angle)
        }
    };
    if !(-lacks..=AREA_ERROR).contains(&area_error) {
        return Err(ExportError::Mesher(format!(
            "Gmsh's triangles have an area of {} mm² where the cut has {} mm²",
            measures.volume_mm3,
            cut.outline.area_mm2()
        )));
    }
    let is_aggregate =
        |set: &str| mesh.phases.iter().any(|own| own.name == set && own.role != PhaseRole::Matrix);
    let aggregate_mm2: f64 =
        measures.phases.iter().filter(|phase| is_aggregate(&phase.name)).map(|phase| phase.volume_mm3).sum();
    let exact_mm2 = cut.aggregate_area_mm2();
    let aggregate_area_error = if exact_mm2 > 0.0 { aggregate_mm2 / exact_mm2 - 1.0 } else { 0.0 };
    let mut warnings = Vec::new();
    if aggregate_area_error.abs() > TOLD {
        let words = format!(
            "the triangles of the aggregate have {:.2} % {} area than its sections: the gaps leave no room for more; \
             more segments help",
            100.0 * aggregate_area_error.abs(),
            if aggregate_area_error < 0.0 { "less" } else { "more" }
        );
        if aggregate_area_error.abs() > REFUSED {
            return Err(ExportError::Unavailable(words));
        }
        warnings.push(words);
    }
    let report = TriangleReport {
        elements: measures.elements,
        element_type: mesh.kind.abaqus_name().to_owned(),
        nodes: measures.nodes,
        degrees_of_freedom: 2 * measures.nodes,
        smallest_gamma: measures.smallest_gamma.unwrap_or_default(),
        elements_below_gamma_0_03: measures.elements_below_gamma_0_03,
        phases: measures.phases,
        area_error,
        aggregate_area_error,
        mesher: version,
        mesher_options: gmsh_options,
        warnings,
    };
    Ok(MeshedCut { mesh, report, files })
}

/// Gives each triangle the grain of its section: by the number of its surface where the script has named each, else
/// by the place of the first triangle of the surface, because the kernel numbers again what it clips.
fn name_grains(mesh: &mut SolidMesh, cut: &Cut) -> Result<(), ExportError> {
    let surfaces = mesh.grain_of.iter().copied().max().unwrap_or(0) as usize;
    let is_clipped = cut.sections.iter().any(|section| section.clipped);
    if surfaces != cut.sections.len() && !is_clipped {
        return Err(ExportError::Mesher(format!(
            "Gmsh left {surfaces} surfaces of grains where the cut has {}",
            cut.sections.len()
        )));
    }
    let mut grains: Vec<Option<u32>> = vec![None; surfaces + 1];
    for element in 0..mesh.len() {
        let surface = mesh.grain_of[element] as usize;
        if surface == 0 {
            continue;
        }
        let grain = if let Some(grain) = grains[surface] {
            grain
        } else {
            let section = if is_clipped {
                let corners = &mesh.element(element)[..3];
                let sum: Vector3<f64> = corners.iter().map(|node| mesh.nodes_mm[*node as usize]).sum();
                let place = [sum.x / 3.0, sum.y / 3.0];
                let gauge = |section: &super::Section| {
                    gauge(&section.figure, [0, 1].each(|axis| place[axis] - section.center_mm[axis]))
                };
                cut.sections.iter().min_by(|a, b| gauge(a).total_cmp(&gauge(b)))
            } else {
                cut.sections.get(surface - 1)
            };
            let grain = section.map_or(0, |section| section.grain as u32 + 1);
            grains[surface] = Some(grain);
            grain
        };
        mesh.grain_of[element] = grain;
    }
    Ok(())
}

/// By what factor a section about its centre has to be scaled so that a point lies on it: at most 1 within.
fn gauge(figure: &Figure, [u, v]: [f64; 2]) -> f64 {
    match figure {
        Figure::Circle { radius_mm } => hypot(u, v) / radius_mm,
        Figure::Ellipse(ellipse) => {
            let ([a, b], [c, s]) = (ellipse.semi_axes_mm, ellipse.long);
            hypot((c * u + s * v) / a, (c * v - s * u) / b)
        }
        Figure::Polygon(polygon) => {
            let corners = &polygon.corners_mm;
            let of_side = |side: usize| {
                let ([p, q], [r, t]) = (corners[side], corners[(side + 1) % corners.len()]);
                let normal = [t - q, p - r];
                (normal[0] * u + normal[1] * v) / (normal[0] * p + normal[1] * q)
            };
            (0..corners.len()).map(of_side).fold(0.0, f64::max)
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "triangle_tests.rs"]
mod tests;
