//! A Gmsh script: the specimen and its grains as solids of the `OpenCASCADE` kernel, spheres, meshed by Gmsh.
//!
//! The matrix is bounded by the surfaces of the specimen and of the grains as they are, so that no Boolean operation,
//! whose cost grows with the square of the number of grains, has to be computed. Spheres are a little larger than their
//! grains, so that Gmsh's triangles, whose corners lie on them, enclose the volume of the grains.

use std::f64::consts::PI;
use std::io::Write;

use serde::{Deserialize, Serialize};

use super::bodies::MeshModel;
use super::near::Near;
use super::options::VolumeCorrection;
use crate::control::Control;
use crate::export::groups::AggregateGroups;
use crate::export::{ExportError, Model, go_on};
use crate::packing::{GrainsRef, Spheres};
use crate::plan::Limits;
use crate::request::GrainKind;
use crate::request::Specimen;
use crate::request::decode::Object;

/// Share of the gap to a neighbour or a wall that a grain may be enlarged by.
const GAP_SHARE: f64 = 0.25;

/// Options of the script.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct GeoOptions {
    /// Segments of a grain's circumference; Gmsh makes the next even number of them, or more
    /// where the longest edge asks for it.
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
    /// Volume that Gmsh's polyhedra are expected to have over that of the spheres, minus one.
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

/// The grains, which must be spheres.
///
/// The kernel dilates a sphere to an ellipsoid, but a sphere of other scales along its axes is a surface of splines
/// there, whose polyhedra have no volume known beforehand.
pub(super) fn spheres<'a>(model: &Model<'a>) -> Result<&'a Spheres, ExportError> {
    match model.grains {
        GrainsRef::Spheres(spheres) => Ok(spheres),
        GrainsRef::Solids(solids) => Err(of_spheres_alone(solids.kind())),
    }
}

/// The refusal of other grains.
pub(super) fn of_spheres_alone(grains: GrainKind) -> ExportError {
    ExportError::Unavailable(format!(
        "the format geo of a surface mesh is for spheres alone, not for {}: ask for msh, which Gmsh fills, or for stl",
        grains.noun()
    ))
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
    let (spheres, model) = (spheres(of)?, &MeshModel::new(of)?);
    let mut out = std::io::BufWriter::with_capacity(1 << 16, out);
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
    let near = Near::new(&model.bodies, model.specimen.bounds_mm())?;
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
        let groups = AggregateGroups::of(of);
        if groups.is_empty() {
            writeln!(out, "Physical Volume(\"aggregates\", 2) = {{2:{}}};", grains + 1)?;
        }
        for (number, name) in groups.with_grains() {
            let volumes =
                (0..grains).filter(|row| groups.of_grain(*row) == number).map(|row| (row + 2).to_string());
            let tag = faces.len() + 4 + number;
            writeln!(
                out,
                "Physical Volume(\"{name}\", {tag}) = {{{}}};",
                volumes.collect::<Vec<_>>().join(",")
            )?;
        }
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
    model: &MeshModel<'_>,
    near: &Near,
    row: usize,
    edge_mm: f64,
    options: &GeoOptions,
    volumes: &mut Volumes,
) -> f64 {
    let (center, diameter) = (model.bodies.center(row), model.bodies.diameter(row));
    let radius = diameter / 2.0;
    let polyhedra = Polyhedra { segments: options.segments, edge_mm };
    let wanted = polyhedra.radius_for(radius);
    let mut given = radius;
    if options.volume_correction == VolumeCorrection::Scaled {
        let reach = (wanted - radius) / GAP_SHARE;
        let mut least_gap = reach;
        near.for_each(Some(row), center, radius, reach, |_, gap| least_gap = least_gap.min(gap.max(0.0)));
        for at_wall in model.walls(row) {
            least_gap = least_gap.min(at_wall.gap.max(0.0));
        }
        given = wanted.min(radius + GAP_SHARE * least_gap);
        volumes.short += u64::from(given < wanted * (1.0 - 1e-12));
    }
    volumes.exact += diameter.powi(3);
    volumes.meshed += 8.0 * polyhedra.cube_mm3(given);
    given
}

/// The polyhedra that Gmsh makes of spheres.
///
/// Gmsh divides the half circle between the poles of a sphere first, into the whole number of segments next above what
/// the sizes ask for, and the rest of the sphere has triangles of the same edges. So the circumference has an even
/// number `n` of segments, and the polyhedron lacks `c / n^2` of the volume of the sphere, with a `c` near the `(3/8)
/// (2 pi)^2 = 14.8` of equilateral triangles: 14.4 - 6 / n. Measured with Gmsh 4.15.2, 5 to 12 spheres for each `n`
/// from 10 to 64: within 3 % of `c`, from sphere to sphere within 3 % for `n` of 16 and 1 % from 24 on.
#[derive(Clone, Copy, Debug)]
struct Polyhedra {
    segments: u32,
    edge_mm: f64,
}

impl Polyhedra {
    /// Segments of the circumference of a sphere.
    fn segments(self, radius_mm: f64) -> f64 {
        let wanted = f64::from(self.segments).max(2.0 * PI * radius_mm / self.edge_mm);
        // A hundredth of a segment more is no reason for another.
        2.0 * (wanted / 2.0 - 0.01).ceil()
    }

    /// What a polyhedron of so many segments lacks of the volume of its sphere.
    fn lacking(segments: f64) -> f64 {
        let c = match segments {
            ..7.0 => 12.3,
            7.0..9.0 => 12.9,
            _ => 14.4 - 6.0 / segments,
        };
        c / (segments * segments)
    }

    /// Cube of the radius of the sphere that has the volume of the polyhedron of a sphere.
    fn cube_mm3(self, radius_mm: f64) -> f64 {
        radius_mm.powi(3) * (1.0 - Self::lacking(self.segments(radius_mm)))
    }

    /// Radius of the sphere whose polyhedron has the volume of a sphere, or comes nearest to it: where the number of
    /// segments changes, volumes leap.
    fn radius_for(self, radius_mm: f64) -> f64 {
        let mut segments = self.segments(radius_mm);
        loop {
            let enlarged = radius_mm * (1.0 - Self::lacking(segments)).powf(-1.0 / 3.0);
            let needed = self.segments(enlarged);
            if needed <= segments {
                return enlarged;
            }
            // With more segments the sphere need not be as large: perhaps not larger than has the fewer.
            let next = radius_mm * (1.0 - Self::lacking(needed)).powf(-1.0 / 3.0);
            if self.segments(next) < needed {
                let largest = (segments + 0.019) / (2.0 * PI) * self.edge_mm;
                let smallest = (segments + 0.021) / (2.0 * PI) * self.edge_mm;
                let error = |radius: f64| (self.cube_mm3(radius) - radius_mm.powi(3)).abs();
                return if error(largest) <= error(smallest) { largest } else { smallest };
            }
            segments = needed;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn circumferences_have_the_next_even_number_of_segments() {
        let of = |segments: u32, radius: f64| Polyhedra { segments, edge_mm: 1.0 }.segments(radius);
        let radius = |segments: f64| segments / (2.0 * PI);
        assert_eq!([of(15, 0.1), of(16, 0.1), of(17, 0.1)], [16.0, 16.0, 18.0]);
        assert_eq!([of(6, radius(19.9)), of(6, radius(20.01)), of(6, radius(20.03))], [20.0, 20.0, 22.0]);
    }

    #[test]
    fn enlarged_spheres_have_their_volume_but_for_leaps() {
        for segments in [6, 10, 16, 40, 256] {
            let polyhedra = Polyhedra { segments, edge_mm: 1.0 };
            let mut exact = 0;
            for step in 1..=1000 {
                let radius = 0.02 * f64::from(step);
                let enlarged = polyhedra.radius_for(radius);
                assert!(enlarged > radius);
                let error = polyhedra.cube_mm3(enlarged) / radius.powi(3) - 1.0;
                // Half of what two segments more change.
                let n = polyhedra.segments(radius);
                let leap = Polyhedra::lacking(n) - Polyhedra::lacking(n + 2.0);
                assert!(error.abs() <= 0.7 * leap + 1e-12, "{segments} {radius}: {error}");
                exact += u32::from(error.abs() < 1e-12);
            }
            assert!(exact > 900, "{segments}: {exact}");
        }
    }
}
