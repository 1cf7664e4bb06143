//! A Gmsh script: the specimen and its grains as solids of the `OpenCASCADE` kernel, true spheres, meshed by
//! Gmsh.
//!
//! The matrix is bounded by the surfaces of the specimen and of the grains as they stand, so that no Boolean
//! operation, whose cost grows with the square of the number of grains, has to be computed. It knows the
//! script's language; it must never know triangles.

use std::f64::consts::PI;
use std::io::Write;

use serde::{Deserialize, Serialize};

use crate::control::Control;
use crate::export::{ExportError, Model, go_on};
use crate::plan::Limits;
use crate::request::Specimen;
use crate::request::decode::Object;

/// Options of the script.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = GeoOptions))]
#[serde(deny_unknown_fields)]
pub struct Options {
    /// Segments of a grain's circumference.
    #[cfg_attr(feature = "openapi", schema(default = 16, required = false, minimum = 6, maximum = 256))]
    pub segments: u32,
}

impl Default for Options {
    fn default() -> Self {
        Self { segments: 16 }
    }
}

impl Options {
    /// Reads the options out of a request; faults go where the object's go.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        let (least, most) = super::SEGMENTS;
        match object.optional("segments") {
            Some(at) => at.integer(least.into(), most.into()).map(|n| Self { segments: n as u32 }),
            None => Some(Self::default()),
        }
    }
}

/// What was written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = GeoReport))]
pub struct Report {
    /// Grains.
    pub grains: u64,
    /// Longest edges that Gmsh is told to make.
    pub longest_edge_mm: f64,
}

/// Judges what can be judged before there are grains.
///
/// # Errors
/// [`ExportError::Unavailable`] for a periodic box.
pub fn check(specimen: &Specimen, _: &Options, _: &Limits) -> Result<(), ExportError> {
    super::check(specimen)
}

/// Writes the script.
///
/// # Errors
/// See [`ExportError`].
pub fn write(
    model: &Model<'_>,
    options: &Options,
    _: &Limits,
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<Report, ExportError> {
    super::check(model.specimen)?;
    let mut out = std::io::BufWriter::with_capacity(1 << 16, out);
    let spheres = model.spheres;
    let grains = spheres.len();
    let edge_mm = PI * super::surface_mean_mm(model) / f64::from(options.segments);
    writeln!(
        out,
        "// {grains} grains. Lengths in mm. Volume 1: matrix, volumes 2 to {}: grains, largest first.",
        grains + 1
    )?;
    writeln!(out, "SetFactory(\"OpenCASCADE\");")?;
    let faces = match *model.specimen {
        Specimen::Box { size_mm: [x, y, z], .. } => {
            writeln!(out, "Box(1) = {{0, 0, 0, {x}, {y}, {z}}};")?;
            // In the order in which the kernel numbers them.
            ["x_min", "x_max", "y_min", "y_max", "z_min", "z_max"].as_slice()
        }
        Specimen::Cylinder { diameter_mm, height_mm } => {
            let radius = diameter_mm / 2.0;
            writeln!(out, "Cylinder(1) = {{{radius}, {radius}, 0, 0, 0, {height_mm}, {radius}}};")?;
            ["side", "z_max", "z_min"].as_slice()
        }
    };
    for row in 0..grains {
        if row % super::GRAINS_PER_LOOK == 0 {
            go_on(control)?;
            super::report_progress(control, row, grains);
        }
        let [x, y, z] = spheres.center(row);
        writeln!(out, "Sphere({}) = {{{x}, {y}, {z}, {}}};", row + 2, spheres.d_mm[row] / 2.0)?;
    }
    let count = faces.len();
    // Loops are numbered above those that the kernel made with the solids.
    let outer = grains + 2;
    writeln!(out, "Delete {{ Volume{{1}}; }}")?;
    writeln!(out, "Surface Loop({outer}) = {{1:{count}}};")?;
    writeln!(out, "loops() = {{{outer}}};")?;
    if grains > 0 {
        writeln!(out, "For i In {{1:{grains}}}")?;
        writeln!(
            out,
            "  Surface Loop({outer} + i) = {{{count} + i}};\n  loops() += {{{outer} + i}};\nEndFor"
        )?;
    }
    writeln!(out, "Volume(1) = {{loops()}};")?;
    writeln!(out, "Physical Volume(\"matrix\", 1) = {{1}};")?;
    if grains > 0 {
        writeln!(out, "Physical Volume(\"aggregates\", 2) = {{2:{}}};", grains + 1)?;
        writeln!(out, "Physical Surface(\"itz\", 3) = {{{}:{}}};", count + 1, count + grains)?;
    }
    for (tag, name) in (1..).zip(faces) {
        writeln!(out, "Physical Surface(\"{name}\", {}) = {{{tag}}};", tag + 3)?;
    }
    writeln!(out, "Mesh.MeshSizeFromCurvature = {};", options.segments)?;
    writeln!(out, "Mesh.MeshSizeMax = {edge_mm};")?;
    out.flush()?;
    super::report_progress(control, grains, grains);
    Ok(Report { grains: grains as u64, longest_edge_mm: edge_mm })
}
