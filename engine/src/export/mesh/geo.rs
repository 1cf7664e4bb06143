//! A Gmsh script: the specimen and its grains as solids of the `OpenCASCADE` kernel, spheres, meshed by Gmsh.
//!
//! The matrix is bounded by the surfaces of the specimen and of the grains as they are, so that no Boolean operation,
//! whose cost grows with the square of the number of grains, has to be computed. Spheres are a little larger than their
//! grains, so that Gmsh's triangles, whose corners lie on them, enclose the volume of the grains.

use std::f64::consts::PI;
use std::io::Write;

use serde::{Deserialize, Serialize};

use super::near::Near;
use super::options::VolumeCorrection;
use super::shell::walls;
use crate::control::Control;
use crate::export::{ExportError, Model, go_on};
use crate::plan::Limits;
use crate::request::Specimen;
use crate::request::decode::Object;

/// What Gmsh's triangles of a sphere lack in volume, times the square of the segments of its circumference. Equilateral
/// triangles would lack `(3/8) (2 pi)^2 = 14.8`; measured with Gmsh 4.15, 6 to 48 segments.
const LACKING: f64 = 14.3;
/// Gmsh's meshes of a kernel's sphere have no fewer segments than that, whatever is asked for.
const FEWEST_SEGMENTS: f64 = 20.2;
/// Share of the gap to a neighbour or a wall that a grain may be enlarged by.
const GAP_SHARE: f64 = 0.25;

/// Options of the script.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct GeoOptions {
    /// Segments of a grain's circumference; Gmsh makes at least 20 on its spheres.
    #[cfg_attr(feature = "openapi", schema(default = 16, required = false, minimum = 6, maximum = 256))]
    pub segments: u32,
    /// Whether spheres are enlarged so that Gmsh's triangles, which cut them short, have their volume.
    #[cfg_attr(feature = "openapi", schema(default = "scaled", required = false))]
    pub volume_correction: VolumeCorrection,
}

impl Default for GeoOptions {
    fn default() -> Self {
        Self { segments: 16, volume_correction: VolumeCorrection::default() }
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
        Some(Self { segments: segments?, volume_correction: volume_correction? })
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
    /// Volume that Gmsh's polyhedra are expected to have over that of the spheres, minus one; meshes of spheres that stand
    /// free come out within 0.3 % of that, those of an A16 packing 0.7 % below.
    #[serde(default)]
    pub expected_volume_error: f64,
    /// Grains whose gaps left no room for the volume of their spheres, where that was asked for.
    #[serde(default)]
    pub grains_short_of_volume: u64,
}

/// Judges what can be judged before there are grains.
///
/// # Errors
/// [`ExportError::Unavailable`] for a periodic box.
pub fn check(specimen: &Specimen, _: &GeoOptions, _: &Limits) -> Result<(), ExportError> {
    super::check(specimen)
}

/// Writes the script.
///
/// # Errors
/// See [`ExportError`].
pub fn write(
    model: &Model<'_>,
    options: &GeoOptions,
    _: &Limits,
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<GeoReport, ExportError> {
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
    let near = Near::new(spheres, model.specimen.bounds_mm());
    let mut volumes = Volumes::default();
    for row in 0..grains {
        if row % super::GRAINS_PER_LOOK == 0 {
            go_on(control)?;
            super::report_progress(control, row, grains);
        }
        let [x, y, z] = spheres.center(row);
        let radius = radius_mm(model, &near, row, edge_mm, options, &mut volumes);
        writeln!(out, "Sphere({}) = {{{x}, {y}, {z}, {radius}}};", row + 2)?;
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
    Ok(GeoReport {
        grains: grains as u64,
        longest_edge_mm: edge_mm,
        expected_volume_error: if grains == 0 { 0.0 } else { volumes.meshed / volumes.exact - 1.0 },
        grains_short_of_volume: volumes.short,
    })
}

/// Length of the script: 80 bytes a grain and a frame.
pub(super) fn expected_bytes(grains: f64) -> u64 {
    (1000.0 + 80.0 * grains) as u64
}

/// Sums over grains, of the cubes of diameters.
#[derive(Default)]
struct Volumes {
    exact: f64,
    meshed: f64,
    short: u64,
}

/// The radius that a grain's sphere gets so that Gmsh's polyhedron has its volume, as far as gaps leave room.
fn radius_mm(
    model: &Model<'_>,
    near: &Near,
    row: usize,
    edge_mm: f64,
    options: &GeoOptions,
    volumes: &mut Volumes,
) -> f64 {
    let (center, diameter) = (model.spheres.center(row), model.spheres.d_mm[row]);
    let radius = diameter / 2.0;
    let segments = f64::from(options.segments).max(PI * diameter / edge_mm).max(FEWEST_SEGMENTS);
    let lacking = LACKING / (segments * segments);
    let wanted = radius * (1.0 - lacking).powf(-1.0 / 3.0);
    let mut given = radius;
    if options.volume_correction == VolumeCorrection::Scaled {
        let reach = (wanted - radius) / GAP_SHARE;
        let mut least_gap = reach;
        near.for_each(Some(row), center, radius, reach, |_, gap| least_gap = least_gap.min(gap.max(0.0)));
        for (wall, _) in walls(model.specimen, center) {
            least_gap = least_gap.min((wall.gap(center) - radius).max(0.0));
        }
        given = wanted.min(radius + GAP_SHARE * least_gap);
        volumes.short += u64::from(given < wanted * (1.0 - 1e-12));
    }
    volumes.exact += diameter.powi(3);
    volumes.meshed += (2.0 * given).powi(3) * (1.0 - lacking);
    given
}
