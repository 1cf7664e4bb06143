//! Surface meshes of a packing for finite elements: every grain a polyhedron with the volume of the grain, the specimen
//! its faces.
//!
//! [`msh`] and [`stl`] write the triangles made here, [`geo`] is a script that leaves meshing to Gmsh. Polyhedra of
//! grains that do not touch do not touch either; [`tetrahedra`] fills them by a program that the caller gives. Methods:
//! `sphere` (geodesic polyhedra), `bodies` (ellipsoids as their images), `polyhedron` and `facets`, `surface`
//! (refinement), `surfaces` (all of a packing, on several threads), `size` (length of edges), `walls`, `grain`
//! (volume), `estimate` (triangles and bytes beforehand).

mod bodies;
mod cache;
mod curved;
#[cfg(test)]
mod ellipsoid_tests;
mod estimate;
mod facets;
pub mod geo;
mod grain;
mod loss;
pub mod msh;
mod near;
mod options;
mod outline;
mod polyhedron;
#[cfg(test)]
mod polyhedron_tests;
pub(super) mod report_check;
mod shell;
mod size;
mod solid;
mod sphere;
pub mod stl;
mod surface;
mod surfaces;
mod template_surface;
#[cfg(test)]
mod tests;
pub mod tetrahedra;
mod walls;

use std::io::Write;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::control::{Control, Progress, Step, Unattended};
use crate::distance::DistanceRule;
use crate::export::estimate::{Expected, ExportEstimate, MeshEstimate};
use crate::export::kind::{Export, Made};
use crate::export::{ExportError, Model};
use crate::plan::{Limits, Plan};
use crate::request::decode::Object;
use crate::request::{Distance, FieldError, PackingRequest, Specimen};
use bodies::MeshModel;
pub use cache::SurfaceCache;
pub use options::{FaceChoice, SurfaceOptions, VolumeCorrection};
use report_check::check_mesh;
use surface::Surface;
use surfaces::Mesh;
pub use tetrahedra::{MeshOptions, TetrahedronOptions, TetrahedronReport};

/// Names of the file formats, the default first.
pub(super) const FORMATS: [&str; 6] = ["msh", "geo", "stl", "inp", "vtu", "med"];

/// Grains between two looks at whether to stop.
const GRAINS_PER_LOOK: usize = 64;

/// A mesh: its file format, and the options of that.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "format", rename_all = "snake_case")]
pub enum MeshRequest {
    /// A Gmsh file (MSH 4.1): surfaces to be filled, or surfaces and tetrahedra.
    Msh(MeshOptions),
    /// Grains and specimen as a Gmsh script for the `OpenCASCADE` kernel.
    Geo(geo::GeoOptions),
    /// Surfaces as STL, a file for each phase in a zip.
    Stl(SurfaceOptions),
    /// Tetrahedra as keywords for Abaqus and `CalculiX`.
    Inp(MeshOptions),
    /// Tetrahedra as an unstructured grid of VTK.
    Vtu(MeshOptions),
    /// Tetrahedra as MED, where Gmsh has it.
    Med(MeshOptions),
}

/// The figures of a mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "format", rename_all = "snake_case")]
pub enum MeshReport {
    /// Of a Gmsh file.
    Msh(SurfaceReport),
    /// Of a Gmsh script.
    Geo(geo::GeoReport),
    /// Of STL files.
    Stl(SurfaceReport),
    /// Of keywords for Abaqus and `CalculiX`.
    Inp(SurfaceReport),
    /// Of a grid of VTK.
    Vtu(SurfaceReport),
    /// Of a MED file.
    Med(SurfaceReport),
}

impl MeshRequest {
    /// The options of its tetrahedra, where it has any: such a mesh needs [`Model::mesher`].
    pub fn tetrahedra(&self) -> Option<&TetrahedronOptions> {
        match self {
            Self::Msh(options) | Self::Inp(options) | Self::Vtu(options) | Self::Med(options) => {
                options.tetrahedra.as_ref()
            }
            Self::Geo(_) | Self::Stl(_) => None,
        }
    }

    /// The options of its surfaces, where they are triangles.
    pub(in crate::export) fn surfaces(&self) -> Option<&SurfaceOptions> {
        match self {
            Self::Msh(options) | Self::Inp(options) | Self::Vtu(options) | Self::Med(options) => {
                Some(&options.surfaces)
            }
            Self::Stl(options) => Some(options),
            Self::Geo(_) => None,
        }
    }

    /// Whether `max_segments` is what `segments` implies.
    pub(in crate::export) fn has_default_max_segments(&self) -> bool {
        self.surfaces().is_none_or(SurfaceOptions::has_default_max_segments)
    }

    fn estimate_packed(&self, model: &Model<'_>) -> Result<ExportEstimate, ExportError> {
        let Some(options) = self.surfaces() else {
            return Ok(ExportEstimate::of_bytes(geo::bytes_of_model(model)));
        };
        let options =
            &self.tetrahedra().map_or_else(|| options.clone(), |own| own.of_surfaces(options, None));
        let specimen = model.specimen;
        let model = &MeshModel::new(model)?;
        let estimate = self.in_format(specimen, estimate::of_model(model, options, &Unattended)?.0);
        Ok(ExportEstimate { mesh: Some(estimate), ..ExportEstimate::of_bytes(estimate.bytes) })
    }

    /// With warnings of what is likely to go wrong.
    fn estimate_planned(&self, request: &PackingRequest, plan: &Plan) -> ExportEstimate {
        let Some(options) = self.surfaces() else {
            return ExportEstimate::of_bytes(geo::bytes_of_plan(request.mix.grain_kind(), plan.grains));
        };
        let options =
            &self.tetrahedra().map_or_else(|| options.clone(), |own| own.of_surfaces(options, None));
        let rule = DistanceRule::new(&request.distance, &request.specimen);
        let triangles = estimate::of_plan(&request.specimen, &rule, &plan.classes, options);
        let estimate = self.in_format(&request.specimen, triangles);
        let mut warnings = Vec::new();
        let fixed = !matches!(request.distance, Distance::Maximize { .. });
        if fixed
            && options.size_field
            && plan.classes.iter().any(|class| rule.gap_mm(class.d_min_mm, class.d_min_mm) <= 0.0)
        {
            warnings.push(
                "grains may touch: their surfaces are meshed finely around every contact, and elements between them are \
                 flat; a distance between grains avoids both"
                    .into(),
            );
        }
        if estimate.bytes > options.max_bytes {
            warnings.push(format!(
                "the mesh is likely to have {:.1} million triangles in {} MB, more than its limit of {} MB",
                estimate.triangles as f64 / 1e6,
                estimate.bytes / 1_000_000,
                options.max_bytes / 1_000_000
            ));
        }
        ExportEstimate { mesh: Some(estimate), warnings, ..ExportEstimate::of_bytes(estimate.bytes) }
    }

    fn in_format(&self, specimen: &Specimen, estimate: MeshEstimate) -> MeshEstimate {
        match (self.tetrahedra(), self) {
            (Some(options), _) => tetrahedra::estimated(estimate.triangles, specimen, options, self.format()),
            (None, Self::Stl(_)) => estimate.as_stl(),
            (None, _) => estimate,
        }
    }
}

impl Export for MeshRequest {
    type Report = MeshReport;

    const NAME: &'static str = "mesh";
    const FORMATS: &'static [&'static str] = &FORMATS;

    fn from_object(object: &mut Object<'_>) -> Option<Self> {
        let format = match object.optional("format") {
            Some(at) => at.choice(&FORMATS.map(|name| (name, name)))?,
            None => FORMATS[0],
        };
        match format {
            "geo" => geo::GeoOptions::read(object).map(Self::Geo),
            "stl" => SurfaceOptions::read(object).map(Self::Stl),
            "inp" => MeshOptions::read(object, true).map(Self::Inp),
            "vtu" => MeshOptions::read(object, true).map(Self::Vtu),
            "med" => MeshOptions::read(object, true).map(Self::Med),
            _ => MeshOptions::read(object, false).map(Self::Msh),
        }
    }

    fn format(&self) -> &'static str {
        match self {
            Self::Msh(_) => "msh",
            Self::Geo(_) => "geo",
            Self::Stl(_) => "stl",
            Self::Inp(_) => "inp",
            Self::Vtu(_) => "vtu",
            Self::Med(_) => "med",
        }
    }

    fn media_type(&self) -> &'static str {
        match self {
            Self::Msh(_) => "application/vnd.gmsh.msh",
            Self::Geo(_) | Self::Inp(_) => "text/plain",
            Self::Stl(_) => "application/zip",
            Self::Vtu(_) => "application/vnd.vtk.unstructuredgrid+xml",
            Self::Med(_) => "application/x-hdf5",
        }
    }

    fn file_extension(&self) -> &'static str {
        match self {
            Self::Stl(_) => "zip",
            _ => self.format(),
        }
    }

    fn name_parts(&self) -> Vec<&'static str> {
        match self {
            Self::Stl(_) => vec![self.format()],
            _ if self.tetrahedra().is_some() => vec!["tetrahedra"],
            _ => Vec::new(),
        }
    }

    /// Four times the segments come with those. The name says that there are tetrahedra; they are of the first order
    /// where it does not say which.
    fn is_implied(&self, option: &str, value: &Value) -> bool {
        match option {
            "max_segments" => self.has_default_max_segments(),
            "elements" => true,
            "order" => value.as_u64() == Some(1),
            _ => false,
        }
    }

    fn check(&self, specimen: &Specimen, _: &Limits) -> Result<(), ExportError> {
        check(specimen)
    }

    fn estimate(&self, of: &Expected<'_>) -> Result<ExportEstimate, ExportError> {
        check(of.specimen())?;
        match *of {
            Expected::Packed(model) => self.estimate_packed(model),
            Expected::Planned(request, plan) => Ok(self.estimate_planned(request, plan)),
        }
    }

    fn needs_mesher(&self) -> bool {
        self.tetrahedra().is_some()
    }

    fn check_report(&self, made: &Made<'_>, report: &MeshReport) -> Result<(), String> {
        check_mesh(made.specimen, self, made.volume_fraction, report)
    }

    fn write(
        &self,
        model: &Model<'_>,
        limits: &Limits,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<MeshReport, ExportError> {
        let mut write = |options: &MeshOptions| match &options.tetrahedra {
            Some(own) => {
                tetrahedra::write(model, &options.surfaces, own, self.format(), limits, control, out)
            }
            None => msh::write(model, &options.surfaces, limits, control, out),
        };
        match self {
            Self::Msh(options) => write(options).map(MeshReport::Msh),
            Self::Inp(options) => write(options).map(MeshReport::Inp),
            Self::Vtu(options) => write(options).map(MeshReport::Vtu),
            Self::Med(options) => write(options).map(MeshReport::Med),
            Self::Geo(options) => geo::write(model, options, limits, control, out).map(MeshReport::Geo),
            Self::Stl(options) => stl::write(model, options, limits, control, out).map(MeshReport::Stl),
        }
    }

    fn companion(&self, file_name: &str) -> Option<(&'static str, String)> {
        let is_filled_by_gmsh = matches!(self, Self::Msh(options) if options.tetrahedra.is_none());
        is_filled_by_gmsh.then(|| ("geo", msh::script(file_name)))
    }
}

impl MeshReport {
    /// The figures of the surfaces and of what fills them; none of a script.
    pub(in crate::export) fn surfaces(&self) -> Option<&SurfaceReport> {
        match self {
            Self::Msh(report)
            | Self::Stl(report)
            | Self::Inp(report)
            | Self::Vtu(report)
            | Self::Med(report) => Some(report),
            Self::Geo(_) => None,
        }
    }

    /// What is missing of the mesh, in words.
    pub fn warnings(&self) -> &[String] {
        match self {
            Self::Msh(report)
            | Self::Stl(report)
            | Self::Inp(report)
            | Self::Vtu(report)
            | Self::Med(report) => &report.warnings,
            Self::Geo(report) => &report.warnings,
        }
    }
}

/// What a mesh came out as.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SurfaceReport {
    /// Grains.
    pub grains: u64,
    /// Vertices.
    pub nodes: u64,
    /// Triangles, those of the specimen's faces too.
    pub triangles: u64,
    /// Shortest edge.
    pub shortest_edge_mm: f64,
    /// Longest edge.
    pub longest_edge_mm: f64,
    /// Volume inside the specimen's faces.
    pub specimen_volume_mm3: f64,
    /// The same over that of the specimen, minus one.
    pub specimen_volume_error: f64,
    /// Volume of the polyhedra.
    pub aggregate_volume_mm3: f64,
    /// The same over that of the grains, minus one; 0 where there are no grains. With the correction `scaled` it is
    /// what the gaps left no room for.
    pub aggregate_volume_error: f64,
    /// Grains whose gaps left no room for their volume, where that was asked for.
    pub grains_short_of_volume: u64,
    /// What is missing of the mesh, in words.
    #[serde(default)]
    pub warnings: Vec<String>,
    /// The tetrahedra, where there are any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub tetrahedra: Option<TetrahedronReport>,
}

/// Judges what can be judged before there are grains.
fn check(specimen: &Specimen) -> Result<(), ExportError> {
    if specimen.is_periodic() {
        return Err(ExportError::Unavailable(
            "a surface mesh needs whole grains, and those of a periodic box cross its faces: pack the box with walls, or ask \
             for voxels"
                .into(),
        ));
    }
    Ok(())
}

/// Refuses a mesh, and says how to get below the limit.
fn too_large(
    model: &MeshModel<'_>,
    options: &SurfaceOptions,
    estimate: Option<MeshEstimate>,
    limits: &Limits,
) -> ExportError {
    let most = options.max_bytes.min(limits.max_memory_bytes);
    let size = match estimate {
        Some(MeshEstimate { triangles, bytes, .. }) => {
            format!("about {:.1} million triangles, {} MB", triangles as f64 / 1e6, bytes.div_ceil(1_000_000))
        }
        None => format!("more than {} MB", limits.max_memory_bytes / 1_000_000),
    };
    let raise = if most == options.max_bytes { ", or raise max_bytes" } else { "" };
    let knob = if options.size_mm.is_some() {
        "raise size_mm or min_size_mm"
    } else {
        "lower segments or max_segments, give min_size_mm"
    };
    ExportError::TooLarge(FieldError {
        pointer: if options.size_mm.is_some() { "/size_mm" } else { "/segments" }.into(),
        detail: format!(
            "a mesh of these {} grains has {size}: at most {} MB may be made; {knob}, set size_field to false, pack with a \
             distance between grains (the narrower gaps are, the more triangles they take){raise}",
            model.bodies.len(),
            most / 1_000_000
        ),
    })
}

/// Mean diameter of the grains by surface, which is what most triangles are on; without grains, the shortest
/// length of the specimen.
fn surface_mean_mm(model: &MeshModel<'_>) -> f64 {
    let [x, y, z] = model.specimen.bounds_mm();
    let shortest = x.min(y).min(z);
    let of_power = |n: i32| model.bodies.diameters().map(|d| d.powi(n)).sum::<f64>();
    if model.bodies.len() == 0 { shortest } else { (of_power(3) / of_power(2)).min(shortest) }
}

fn report_of(model: &MeshModel<'_>, shell: &Surface) -> SurfaceReport {
    let (shortest_edge_mm, longest_edge_mm) = shell.edges_mm();
    let volume = shell.volume_mm3();
    SurfaceReport {
        grains: model.bodies.len() as u64,
        nodes: shell.points.len() as u64,
        triangles: shell.triangles.len() as u64,
        shortest_edge_mm,
        longest_edge_mm,
        specimen_volume_mm3: volume,
        specimen_volume_error: volume / model.specimen.volume_mm3() - 1.0,
        aggregate_volume_mm3: 0.0,
        aggregate_volume_error: 0.0,
        grains_short_of_volume: 0,
        warnings: Vec::new(),
        tetrahedra: None,
    }
}

impl SurfaceReport {
    fn add(&mut self, grain: &Surface, full: bool) {
        let (shortest, longest) = grain.edges_mm();
        self.nodes += grain.points.len() as u64;
        self.triangles += grain.triangles.len() as u64;
        self.shortest_edge_mm = self.shortest_edge_mm.min(shortest);
        self.longest_edge_mm = self.longest_edge_mm.max(longest);
        self.aggregate_volume_mm3 += grain.volume_mm3();
        self.grains_short_of_volume += u64::from(!full);
    }

    fn finish(&mut self, model: &MeshModel<'_>) {
        let exact: f64 = (0..model.bodies.len()).map(|row| model.bodies.volume_mm3(row)).sum();
        if exact > 0.0 {
            self.aggregate_volume_error = self.aggregate_volume_mm3 / exact - 1.0;
        }
        self.warnings = loss::warnings(self.aggregate_volume_error, self.grains_short_of_volume);
    }
}

fn report_progress(control: &dyn Control, done: usize, total: usize) {
    let counted = Progress::counted(Step::Export, done, total, "grains", "meshing surfaces");
    control.report(&Progress { fraction: 0.8 * counted.fraction, ..counted });
}
