//! A Gmsh script: the specimen and its grains as solids of the `OpenCASCADE` kernel, meshed by Gmsh.
//!
//! Ellipsoids are dilated and turned spheres (`dilated`); polyhedra are those that are meshed as `msh` (`polyhedron`,
//! `rounded`), by their corners, edges and faces. The matrix is bounded by the surfaces of the specimen and of the
//! grains as they are, so that no Boolean operation, whose cost grows with the square of the number of grains, has to
//! be computed. Spheres and ellipsoids are a little larger than their grains, so that Gmsh's triangles, whose corners
//! lie on them, enclose the volume of the grains.

mod dilated;
mod script;

use std::f64::consts::PI;
use std::io::{self, Write};

use serde::{Deserialize, Serialize};

use super::bodies::MeshModel;
use super::loss;
use super::options::{FaceChoice, SurfaceOptions, VolumeCorrection};
use crate::control::Control;
use crate::export::groups::AggregateGroups;
use crate::export::{ExportError, Model, go_on};
use crate::plan::Limits;
use crate::request::GrainKind;
use crate::request::decode::Object;
use script::Script;

/// Length of a script without grains.
const BYTES_OF_FRAME: f64 = 1000.0;
/// What a sphere adds to a script.
const BYTES_OF_SPHERE: f64 = 130.0;
/// What an ellipsoid adds.
const BYTES_OF_ELLIPSOID: f64 = 340.0;
/// What a face of a template adds, with its share of edges and corners: 280 of sharp grains, 650 of rounded ones, which
/// have more facets.
const BYTES_OF_FACE: f64 = 430.0;
/// Faces of a polyhedron that is not drawn yet, about.
const FACES: f64 = 24.0;

/// Options of the script.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct GeoOptions {
    /// Segments of a grain's circumference. Spheres and ellipsoids get the next even number of them, or more where the
    /// longest edge asks for it; polyhedra have edges of that length.
    #[cfg_attr(feature = "openapi", schema(default = 16, required = false, minimum = 6, maximum = 256))]
    pub segments: u32,
    /// Whether grains are enlarged so that Gmsh's triangles, which cut spheres and ellipsoids short, have their volume,
    /// and the polyhedra in place of rounded grains too.
    #[cfg_attr(feature = "openapi", schema(default = "scaled", required = false))]
    pub volume_correction: VolumeCorrection,
    /// Whether faces of polyhedra that are too narrow for the edges may be left out.
    #[cfg_attr(feature = "openapi", schema(default = "simplified", required = false))]
    pub faces: FaceChoice,
}

impl Default for GeoOptions {
    fn default() -> Self {
        Self { segments: 16, volume_correction: VolumeCorrection::default(), faces: FaceChoice::default() }
    }
}

impl GeoOptions {
    /// Reads the options out of a request; faults go where the object's go.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        let (least, most) = super::options::SEGMENTS;
        let segments = match object.optional("segments") {
            Some(at) => at.integer(least.into(), most.into()).map(|n| n as u32),
            None => Some(Self::default().segments),
        };
        let volume_correction = VolumeCorrection::read(object);
        let faces = FaceChoice::read(object);
        Some(Self { segments: segments?, volume_correction: volume_correction?, faces: faces? })
    }
}

/// The figures of a script.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct GeoReport {
    /// Grains.
    pub grains: u64,
    /// Longest edges that Gmsh is told to make.
    pub longest_edge_mm: f64,
    /// Volume that Gmsh's polyhedra are expected to have over that of the grains, minus one.
    #[serde(default)]
    pub expected_volume_error: f64,
    /// Grains whose gaps left no room for their volume, where that was asked for.
    #[serde(default)]
    pub grains_short_of_volume: u64,
    /// What is missing of the mesh, in words.
    #[serde(default)]
    pub warnings: Vec<String>,
}

/// Writes the script.
///
/// # Errors
/// See [`ExportError`].
pub fn write(
    of: &Model<'_>,
    options: &GeoOptions,
    _: &Limits,
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<GeoReport, ExportError> {
    super::check(of.specimen)?;
    let mut model = MeshModel::new(of)?;
    let report = write_whatever_lacks(of, &model, options, control, out)?;
    let lacking = -report.expected_volume_error;
    if options.volume_correction == VolumeCorrection::Scaled && lacking > loss::MOST_LACKING {
        // Surfaces of further numbers of segments are not kept.
        model.surfaces = None;
        let advice = loss::fitting_segments(Some(options.segments), |segments| {
            let options = GeoOptions { segments, ..options.clone() };
            let report = write_whatever_lacks(of, &model, &options, control, &mut io::sink()).ok()?;
            Some(-report.expected_volume_error)
        });
        go_on(control)?;
        return Err(loss::refused(lacking, report.grains_short_of_volume, advice));
    }
    Ok(report)
}

/// Writes the script, whatever volume is missing.
fn write_whatever_lacks(
    of: &Model<'_>,
    model: &MeshModel<'_>,
    options: &GeoOptions,
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<GeoReport, ExportError> {
    let grains = model.bodies.len();
    let edge_mm = PI * super::surface_mean_mm(model) / f64::from(options.segments);
    let surfaces = SurfaceOptions {
        size_field: false,
        volume_correction: options.volume_correction,
        faces: options.faces,
        ..SurfaceOptions::default().with_segments(options.segments)
    };
    let mut script = Script::new(model, &surfaces, edge_mm, out)?;
    let faces = script.specimen()?;
    let polyhedron = |row: usize| model.bodies.polyhedron(row);
    // The kernel numbers what belongs to a sphere itself, so that spheres come first.
    let (first, last): (Vec<_>, Vec<_>) = (0..grains).partition(|row| polyhedron(*row).is_none());
    for (done, row) in first.into_iter().chain(last).enumerate() {
        if done % super::GRAINS_PER_LOOK == 0 {
            go_on(control)?;
            super::report_progress(control, done, grains);
        }
        match polyhedron(row) {
            None => script.curved(row)?,
            Some(grain) => script.polyhedron(row, &grain)?,
        }
    }
    let surfaces = script.matrix()?;
    write_groups(&mut script.out, of, faces, surfaces.as_deref())?;
    script.out.flush()?;
    super::report_progress(control, grains, grains);
    let volume_error = if grains == 0 { 0.0 } else { script.meshed_mm3 / script.exact_mm3 - 1.0 };
    Ok(GeoReport {
        grains: grains as u64,
        longest_edge_mm: script.longest_mm,
        expected_volume_error: volume_error,
        grains_short_of_volume: script.short,
        warnings: loss::warnings(volume_error, script.short),
    })
}

/// The physical groups, of the faces in their order and of the surfaces of the grains.
fn write_groups(
    out: &mut impl Write,
    of: &Model<'_>,
    faces: &[&str],
    surfaces: Option<&str>,
) -> io::Result<()> {
    let grains = of.grains.len();
    writeln!(out, "Physical Volume(\"matrix\", 1) = {{1}};")?;
    let groups = AggregateGroups::of(of);
    if groups.is_empty() && grains > 0 {
        writeln!(out, "Physical Volume(\"aggregates\", 2) = {{2:{}}};", grains + 1)?;
    }
    for (number, name) in groups.with_grains() {
        let volumes =
            (0..grains).filter(|row| groups.of_grain(*row) == number).map(|row| (row + 2).to_string());
        let (tag, volumes) = (faces.len() + 4 + number, volumes.collect::<Vec<_>>().join(","));
        writeln!(out, "Physical Volume(\"{name}\", {tag}) = {{{volumes}}};")?;
    }
    if let Some(surfaces) = surfaces {
        writeln!(out, "Physical Surface(\"itz\", 3) = {{{surfaces}}};")?;
    }
    for (tag, name) in (1..).zip(faces) {
        writeln!(out, "Physical Surface(\"{name}\", {}) = {{{tag}}};", tag + 3)?;
    }
    Ok(())
}

/// Length of the script of a packing.
pub(super) fn bytes_of_model(model: &Model<'_>) -> u64 {
    let grains = model.grains;
    let of_curved = bytes_of_curved(grains.kind());
    let bytes = |grain: usize| match grains.template(grain) {
        None => of_curved,
        Some(template) => BYTES_OF_FACE * grains.templates()[template as usize].faces().len() as f64,
    };
    (BYTES_OF_FRAME + (0..grains.len()).map(bytes).sum::<f64>()) as u64
}

/// Length of the script of that many planned grains.
pub(super) fn bytes_of_plan(kind: GrainKind, grains: f64) -> u64 {
    let of_grain = if kind.has_templates() { BYTES_OF_FACE * FACES } else { bytes_of_curved(kind) };
    (BYTES_OF_FRAME + of_grain * grains) as u64
}

/// What a grain without a template adds.
fn bytes_of_curved(kind: GrainKind) -> f64 {
    if kind.has_axes() { BYTES_OF_ELLIPSOID } else { BYTES_OF_SPHERE }
}
