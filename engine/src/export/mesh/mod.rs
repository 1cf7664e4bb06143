//! Surface meshes of a packing for finite elements: every grain an inscribed polyhedron, the specimen its
//! faces.
//!
//! [`msh`] and [`stl`] write the triangles made here, [`geo`] leaves them to Gmsh. Polyhedra lie inside their
//! spheres, so that grains which do not touch stay apart. Nothing here knows tetrahedra, files or HTTP.

pub mod geo;
pub mod msh;
mod near;
mod outline;
mod shell;
mod size;
mod sphere;
pub mod stl;
mod surface;
#[cfg(test)]
mod tests;

use std::f64::consts::PI;
use std::io::Write;

use serde::{Deserialize, Serialize};

use crate::control::{Control, Phase, Progress};
use crate::export::{ExportError, Model, go_on};
use crate::plan::Limits;
use crate::request::decode::{At, Object};
use crate::request::{FieldError, Specimen};
use near::Near;
use shell::{Division, Shell, walls};
use size::{EDGE_PER_GAP, Facing, Other};
use surface::{Shape, Surface, cross, dot};

/// Bounds of both numbers of segments.
const SEGMENTS: (u32, u32) = (6, 256);
/// Share of the gap between two grains, or a grain and a wall, that a correction of volumes may use up.
const GAP_SHARE: f64 = 0.5;
/// Memory of a triangle with its half of a vertex, in bytes, with what growing vectors hold in reserve.
const BYTES_PER_TRIANGLE: u64 = 72;
/// Grains between two looks at whether to stop.
const GRAINS_PER_LOOK: usize = 64;

/// A mesh: its file format, and the options of that.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "format", rename_all = "snake_case")]
pub enum MeshRequest {
    /// Surfaces as a Gmsh file (MSH 4.1), to be filled with tetrahedra.
    Msh(SurfaceOptions),
    /// Spheres and specimen as a Gmsh script for the `OpenCASCADE` kernel.
    Geo(geo::Options),
    /// Surfaces as STL, a file for each phase in a zip.
    Stl(SurfaceOptions),
}

/// The figures of a mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "format", rename_all = "snake_case")]
pub enum MeshReport {
    /// Of a Gmsh file.
    Msh(SurfaceReport),
    /// Of a Gmsh script.
    Geo(geo::Report),
    /// Of STL files.
    Stl(SurfaceReport),
}

impl MeshRequest {
    /// Reads `format` and its options out of a request; faults go where the object's go.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        let format = match object.optional("format") {
            Some(at) => at.choice(&[("msh", "msh"), ("geo", "geo"), ("stl", "stl")])?,
            None => "msh",
        };
        match format {
            "geo" => geo::Options::read(object).map(Self::Geo),
            "stl" => SurfaceOptions::read(object).map(Self::Stl),
            _ => SurfaceOptions::read(object).map(Self::Msh),
        }
    }

    /// Name of the file format, and file extension of what is no archive.
    pub fn format(&self) -> &'static str {
        match self {
            Self::Msh(_) => "msh",
            Self::Geo(_) => "geo",
            Self::Stl(_) => "stl",
        }
    }

    /// Media type of the file, without parameters.
    pub fn media_type(&self) -> &'static str {
        match self {
            Self::Msh(_) => "application/vnd.gmsh.msh",
            Self::Geo(_) => "text/plain",
            Self::Stl(_) => "application/zip",
        }
    }

    /// File extension.
    pub fn file_extension(&self) -> &'static str {
        match self {
            Self::Stl(_) => "zip",
            _ => self.format(),
        }
    }

    /// Judges what can be judged before there are grains.
    ///
    /// # Errors
    /// [`ExportError::Unavailable`] for a periodic box.
    pub fn check(&self, specimen: &Specimen) -> Result<(), ExportError> {
        check(specimen)
    }

    /// Writes the file.
    ///
    /// # Errors
    /// See [`ExportError`].
    pub fn write(
        &self,
        model: &Model<'_>,
        limits: &Limits,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<MeshReport, ExportError> {
        match self {
            Self::Msh(options) => msh::write(model, options, limits, control, out).map(MeshReport::Msh),
            Self::Geo(options) => geo::write(model, options, limits, control, out).map(MeshReport::Geo),
            Self::Stl(options) => stl::write(model, options, limits, control, out).map(MeshReport::Stl),
        }
    }
}

/// How finely surfaces are meshed.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = MeshOptions))]
#[serde(deny_unknown_fields)]
pub struct SurfaceOptions {
    /// Segments of a grain's circumference; met in steps of 5.2.
    #[cfg_attr(feature = "openapi", schema(default = 16, required = false, minimum = 6, maximum = 256))]
    pub segments: u32,
    /// Whether edges become shorter where surfaces come close to one another, in proportion to their
    /// clearance.
    #[cfg_attr(feature = "openapi", schema(default = true, required = false))]
    pub size_field: bool,
    /// Segments of a circumference that the size field may ask for; four times `segments` when absent.
    #[cfg_attr(feature = "openapi", schema(required = false, minimum = 6, maximum = 256))]
    pub max_segments: u32,
    /// Whether polyhedra are enlarged to the volume of their spheres.
    #[cfg_attr(feature = "openapi", schema(default = "none", required = false))]
    pub volume_correction: VolumeCorrection,
}

/// Whether polyhedra are enlarged to the volume of their spheres.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum VolumeCorrection {
    /// Inscribed: vertices on the spheres, a few percent too little volume.
    None,
    /// Scaled about their centres, by as much as leaves at least half of every clearance.
    Scaled,
}

impl Default for SurfaceOptions {
    fn default() -> Self {
        Self { segments: 16, size_field: true, max_segments: 64, volume_correction: VolumeCorrection::None }
    }
}

impl SurfaceOptions {
    /// Reads the options out of a request; faults go where the object's go.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        let number = |at: Option<&At<'_>>| match at {
            Some(at) => at.integer(SEGMENTS.0.into(), SEGMENTS.1.into()).map(|n| Some(n as u32)),
            None => Some(None),
        };
        let segments = number(object.optional("segments").as_ref());
        let size_field = object.optional("size_field").map_or(Some(true), |at| at.boolean());
        let most_at = object.optional("max_segments");
        let most = number(most_at.as_ref());
        let corrections = [("none", VolumeCorrection::None), ("scaled", VolumeCorrection::Scaled)];
        let volume_correction = object
            .optional("volume_correction")
            .map_or(Some(VolumeCorrection::None), |at| at.choice(&corrections));
        let segments = segments?.unwrap_or(Self::default().segments);
        let max_segments = most?.unwrap_or((4 * segments).min(SEGMENTS.1));
        if let Some(at) = most_at.filter(|_| max_segments < segments) {
            at.fault(format!(
                "{max_segments} is out of range: must be at least segments, which is {segments}"
            ));
            return None;
        }
        Some(Self { segments, size_field: size_field?, max_segments, volume_correction: volume_correction? })
    }
}

/// What a mesh came out as.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = MeshReport))]
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
    /// The same over that of the spheres, minus one; 0 where there are no grains.
    pub aggregate_volume_error: f64,
    /// Grains that could not be enlarged to the volume of their spheres, where that was asked for.
    pub grains_short_of_volume: u64,
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

/// The meshed surfaces of a packing.
#[derive(Debug)]
struct Mesh {
    /// The specimen's.
    shell: Shell,
    /// Vertices of the grains, one grain after the other.
    points: Vec<[f64; 3]>,
    /// Triangles of the grains, their corners counted within the grain.
    triangles: Vec<[u32; 3]>,
    /// Ends of the grains in `points` and `triangles`.
    ends: Vec<(usize, usize)>,
}

/// What to work with.
struct Work<'a> {
    model: &'a Model<'a>,
    options: &'a SurfaceOptions,
    limits: &'a Limits,
    near: Near<'a>,
}

impl Mesh {
    /// Meshes a packing, and tells what came out.
    fn new(
        model: &Model<'_>,
        options: &SurfaceOptions,
        limits: &Limits,
        control: &dyn Control,
    ) -> Result<(Self, SurfaceReport), ExportError> {
        check(model.specimen)?;
        let spheres = model.spheres;
        let work = Work { model, options, limits, near: Near::new(spheres, model.specimen.bounds_mm()) };
        let template = sphere::sphere(f64::from(options.segments));
        let at_least = template.triangles.len() as u64 * spheres.len() as u64 * BYTES_PER_TRIANGLE;
        if at_least > limits.max_memory_bytes {
            return Err(work.too_large(at_least));
        }
        let edge_mm = PI * surface_mean_mm(model) / f64::from(options.segments);
        let division = Division {
            edge_mm,
            floor_mm: edge_mm * f64::from(options.segments) / f64::from(options.max_segments),
            size_field: options.size_field,
        };
        let most = (limits.max_memory_bytes / BYTES_PER_TRIANGLE) as usize;
        let shell = Shell::new(model.specimen, spheres, division, most)
            .ok_or_else(|| work.too_large(limits.max_memory_bytes + 1))?;
        let mut mesh = Self { shell, points: Vec::new(), triangles: Vec::new(), ends: Vec::new() };
        let mut report = report_of(model, &mesh.shell.surface);
        for row in 0..spheres.len() {
            if row % GRAINS_PER_LOOK == 0 {
                go_on(control)?;
                report_progress(control, row, spheres.len());
            }
            let left = most.saturating_sub(mesh.shell.surface.triangles.len() + mesh.triangles.len());
            let (grain, full) = work
                .grain(row, &template, left)
                .ok_or_else(|| work.too_large(limits.max_memory_bytes + 1))?;
            report.add(&grain, full);
            let center = spheres.center(row);
            mesh.points.extend(grain.points.iter().map(|p| [0, 1, 2].map(|a| center[a] + p[a])));
            mesh.triangles.extend_from_slice(&grain.triangles);
            mesh.ends.push((mesh.points.len(), mesh.triangles.len()));
        }
        report.finish(model);
        Ok((mesh, report))
    }

    /// Number of grains.
    fn grains(&self) -> usize {
        self.ends.len()
    }

    /// Vertices and triangles of a grain.
    fn grain(&self, row: usize) -> (&[[f64; 3]], &[[u32; 3]]) {
        let from = if row == 0 { (0, 0) } else { self.ends[row - 1] };
        let to = self.ends[row];
        (&self.points[from.0..to.0], &self.triangles[from.1..to.1])
    }

    /// Vertices of all grains.
    fn grain_points(&self) -> &[[f64; 3]] {
        &self.points
    }

    /// Number of the triangles of all grains.
    fn grain_triangles(&self) -> usize {
        self.triangles.len()
    }
}

impl Work<'_> {
    /// The surface of a grain about its centre, and whether it has the volume asked for; `None` when that
    /// would take more than `most_triangles`.
    fn grain(&self, row: usize, template: &Surface, most_triangles: usize) -> Option<(Surface, bool)> {
        let spheres = self.model.spheres;
        let (center, diameter) = (spheres.center(row), spheres.d_mm[row]);
        // By a trifle, so that rounding brings no vertex out of the sphere.
        let radius = diameter / 2.0 * (1.0 - 4.0 * f64::EPSILON);
        let reach = PI * diameter / f64::from(self.options.segments) / EDGE_PER_GAP;
        let floor_mm = PI * diameter / f64::from(self.options.max_segments);
        let mut least_gap = reach;
        let mut facing = Vec::new();
        self.near.for_each(Some(row), center, diameter / 2.0, reach, |other, gap| {
            least_gap = least_gap.min(gap);
            let theirs = spheres.center(other);
            let toward: [f64; 3] = std::array::from_fn(|a| theirs[a] - center[a]);
            let at = sphere::unit(toward).map(|x| x * radius);
            facing.push(Facing {
                other: Other::Sphere { center: toward, radius: spheres.d_mm[other] / 2.0 },
                at,
                floor_mm,
            });
        });
        for (wall, foot) in walls(self.model.specimen, center) {
            let gap = wall.gap(center) - diameter / 2.0;
            if gap < reach {
                least_gap = least_gap.min(gap);
                let toward: [f64; 3] = std::array::from_fn(|a| foot[a] - center[a]);
                let at = sphere::unit(toward).map(|x| x * radius);
                facing.push(Facing { other: wall.about(center), at, floor_mm });
            }
        }
        let mut surface = template.clone();
        surface.points.iter_mut().for_each(|p| *p = p.map(|x| x * radius));
        if surface.triangles.len() > most_triangles {
            return None;
        }
        if self.options.size_field && !surface.refine(&mut Ball { radius, facing }, most_triangles) {
            return None;
        }
        let full = self.options.volume_correction == VolumeCorrection::None
            || correct(&mut surface, diameter, GAP_SHARE / 2.0 * least_gap.max(0.0));
        Some((surface, full))
    }

    fn too_large(&self, bytes: u64) -> ExportError {
        let more = if bytes > self.limits.max_memory_bytes + 1 { "about" } else { "more than" };
        ExportError::TooLarge(FieldError {
            pointer: "/segments".into(),
            detail: format!(
                "{} segments make a mesh of {} grains that takes {more} {} MB: at most {} MB may be used; lower segments or \
                 max_segments",
                self.options.segments,
                self.model.spheres.len(),
                bytes / 1_000_000,
                self.limits.max_memory_bytes / 1_000_000
            ),
        })
    }
}

/// Scales a polyhedron about the centre to the volume of its sphere, by no more than lets its vertices go
/// `most_mm` beyond it; returns whether that was enough.
fn correct(surface: &mut Surface, diameter: f64, most_mm: f64) -> bool {
    let wanted = (PI / 6.0 * diameter.powi(3) / surface.volume_mm3()).cbrt();
    let most = 1.0 + 2.0 * most_mm / diameter;
    let scale = wanted.min(most);
    surface.points.iter_mut().for_each(|p| *p = p.map(|x| x * scale));
    wanted <= most
}

/// A grain about its centre, and what it faces.
struct Ball {
    radius: f64,
    facing: Vec<Facing>,
}

impl Shape for Ball {
    fn between(&mut self, a: u32, b: u32, points: &[[f64; 3]]) -> [f64; 3] {
        let (p, q) = (points[a as usize], points[b as usize]);
        sphere::unit(std::array::from_fn(|i| p[i] + q[i])).map(|x| x * self.radius)
    }

    fn length_mm(&self, centroid: [f64; 3], longest_mm: f64) -> f64 {
        self.facing.iter().map(|facing| facing.length_mm(centroid, longest_mm)).fold(f64::INFINITY, f64::min)
    }

    /// Whether the surface is dented along ab: d lies above the plane of abc, and by more than rounding.
    fn is_wrong(&self, [a, b]: [u32; 2], [c, d]: [u32; 2], points: &[[f64; 3]]) -> bool {
        let from_a = |p: u32| [0, 1, 2].map(|i| points[p as usize][i] - points[a as usize][i]);
        dot(cross(from_a(b), from_a(c)), from_a(d)) > 1e-12 * self.radius.powi(3)
    }
}

/// Mean diameter of the grains by surface, which is what most triangles are on; without grains, the shortest
/// length of the specimen.
fn surface_mean_mm(model: &Model<'_>) -> f64 {
    let [x, y, z] = model.specimen.bounds_mm();
    let shortest = x.min(y).min(z);
    let of_power = |n: i32| model.spheres.d_mm.iter().map(|d| d.powi(n)).sum::<f64>();
    if model.spheres.is_empty() { shortest } else { (of_power(3) / of_power(2)).min(shortest) }
}

fn report_of(model: &Model<'_>, shell: &Surface) -> SurfaceReport {
    let (shortest_edge_mm, longest_edge_mm) = shell.edges_mm();
    let volume = shell.volume_mm3();
    SurfaceReport {
        grains: model.spheres.len() as u64,
        nodes: shell.points.len() as u64,
        triangles: shell.triangles.len() as u64,
        shortest_edge_mm,
        longest_edge_mm,
        specimen_volume_mm3: volume,
        specimen_volume_error: volume / model.specimen.volume_mm3() - 1.0,
        aggregate_volume_mm3: 0.0,
        aggregate_volume_error: 0.0,
        grains_short_of_volume: 0,
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

    fn finish(&mut self, model: &Model<'_>) {
        let exact: f64 = model.spheres.d_mm.iter().map(|d| PI / 6.0 * d.powi(3)).sum();
        if exact > 0.0 {
            self.aggregate_volume_error = self.aggregate_volume_mm3 / exact - 1.0;
        }
    }
}

fn report_progress(control: &dyn Control, done: usize, total: usize) {
    control.report(&Progress {
        phase: Phase::Export,
        fraction: 0.8 * done as f64 / total.max(1) as f64,
        done: done as u64,
        total: total as u64,
        unit: "grains",
        message: "meshing surfaces".into(),
        growth: None,
    });
}
