//! The surfaces of the specimen and of all grains of a packing. Those of the grains are made on several threads.
//!
//! The surface of a grain depends on the packing and the options alone, and surfaces are put together in the order of
//! the grains, so that nothing depends on the threads.

use super::bodies::MeshModel;
use super::estimate;
use super::grain::Grains;
use super::loss;
use super::options::VolumeCorrection;
use super::shell::{Division, Shell};
use super::surface::Surface;
use super::{SurfaceOptions, SurfaceReport, check, report_of, report_progress, too_large};
use crate::arrays::Each as _;
use crate::control::Control;
use crate::export::pieces::{in_order, slots};
use crate::export::{ExportError, Model, go_on};
use crate::memory::{self, OutOfMemory, make_room, reserved};
use crate::plan::Limits;

/// Memory of a triangle with its half of a vertex, in bytes, with what growing vectors hold in reserve.
const BYTES_PER_TRIANGLE: u64 = 72;

/// Grains whose surfaces are one piece of the work.
const GRAINS_PER_PIECE: usize = 16;

/// The meshed surfaces of a packing.
#[derive(Debug)]
pub(super) struct Mesh {
    /// The specimen's.
    pub(super) shell: Shell,
    /// Vertices of the grains, one grain after the other.
    points: Vec<[f64; 3]>,
    /// Triangles of the grains, their corners counted within the grain.
    triangles: Vec<[u32; 3]>,
    /// Ends of the grains in `points` and `triangles`.
    pub(super) ends: Vec<(usize, usize)>,
}

/// What makes the surfaces of some grains, and those that it made last, each with whether it has its volume.
struct Maker<'a> {
    grains: Grains<'a>,
    made: Vec<(Surface, bool)>,
}

impl Mesh {
    /// Meshes a packing, and tells what came out.
    ///
    /// # Errors
    /// [`ExportError::Unavailable`] where the grains lack more of their volume than [`loss::MOST_LACKING`], though the
    /// volume was asked for.
    pub(super) fn new(
        model: &Model<'_>,
        options: &SurfaceOptions,
        limits: &Limits,
        control: &dyn Control,
    ) -> Result<(Self, SurfaceReport), ExportError> {
        Self::bounded(model, options, None, limits, control)
    }

    /// The same with no edge on the specimen longer than `shell_most_mm`.
    pub(super) fn bounded(
        model: &Model<'_>,
        options: &SurfaceOptions,
        shell_most_mm: Option<f64>,
        limits: &Limits,
        control: &dyn Control,
    ) -> Result<(Self, SurfaceReport), ExportError> {
        check(model.specimen)?;
        let mut model = MeshModel::new(model)?;
        model.shell_most_mm = shell_most_mm.unwrap_or(f64::INFINITY);
        let (mesh, report) = Self::of_model(&model, options, limits, control)?;
        let lacking = -report.aggregate_volume_error;
        if options.volume_correction == VolumeCorrection::Scaled && lacking > loss::MOST_LACKING {
            // Those of further numbers of segments are not kept.
            model.surfaces = None;
            let advice = loss::fitting_segments(options.segments, |segments| {
                let options = options.clone().with_segments(segments);
                let (_, report) = Self::of_model(&model, &options, limits, control).ok()?;
                Some(-report.aggregate_volume_error)
            });
            go_on(control)?;
            return Err(loss::refused(lacking, report.grains_short_of_volume, advice));
        }
        Ok((mesh, report))
    }

    /// The same whatever volume is missing.
    fn of_model(
        model: &MeshModel<'_>,
        options: &SurfaceOptions,
        limits: &Limits,
        control: &dyn Control,
    ) -> Result<(Self, SurfaceReport), ExportError> {
        let (estimate, shell, grains) = estimate::of_model(model, options, control)?;
        if estimate.bytes > options.max_bytes.min(limits.max_memory_bytes) {
            return Err(too_large(model, options, Some(estimate), limits));
        }
        // What comes in small pieces is asked for as one.
        memory::probe(estimate.triangles.saturating_mul(BYTES_PER_TRIANGLE) as usize)?;
        let most = (limits.max_memory_bytes / BYTES_PER_TRIANGLE) as usize;
        let refused = || too_large(model, options, None, limits);
        let shell = shell.or_else(|| Shell::new(model, Division::of(model, options), most));
        let shell = shell.ok_or_else(refused)?;
        let left = most.saturating_sub(shell.surface.triangles.len());
        // A closed surface has half as many points as triangles.
        let triangles = estimate.triangles as usize;
        let (points, triangles) = (reserved(triangles / 2)?, reserved(triangles)?);
        let mut report = report_of(model, &shell.surface);
        let count = model.bodies.len();
        let mut mesh = Self { shell, points, triangles, ends: reserved(count)? };
        let maker = || Maker { grains: grains.clone(), made: Vec::new() };
        let pieces = count.div_ceil(GRAINS_PER_PIECE);
        let mut makers = slots(limits.export_threads, pieces, maker);
        let make = |piece: usize, maker: &mut Maker<'_>| {
            let first = piece * GRAINS_PER_PIECE;
            for row in first..count.min(first + GRAINS_PER_PIECE) {
                maker.made.push(maker.grains.surface(row, left).ok_or_else(refused)?);
            }
            Ok(())
        };
        in_order(&mut makers, pieces, make, |_, maker| {
            go_on(control)?;
            for (grain, has_volume) in maker.made.drain(..) {
                if mesh.triangles.len() + grain.triangles.len() > left {
                    return Err(refused());
                }
                report.add(&grain, has_volume);
                mesh.add(&grain, model.bodies.center(mesh.ends.len()))?;
            }
            report_progress(control, mesh.ends.len(), count);
            Ok(())
        })?;
        report.finish(model);
        Ok((mesh, report))
    }

    fn add(&mut self, grain: &Surface, center: [f64; 3]) -> Result<(), OutOfMemory> {
        make_room(&mut self.points, grain.points.len())?;
        make_room(&mut self.triangles, grain.triangles.len())?;
        self.points.extend(grain.points.iter().map(|p| [0, 1, 2].each(|a| center[a] + p[a])));
        self.triangles.extend_from_slice(&grain.triangles);
        self.ends.push((self.points.len(), self.triangles.len()));
        Ok(())
    }

    /// Number of grains.
    pub(super) fn grains(&self) -> usize {
        self.ends.len()
    }

    /// Vertices and triangles of a grain.
    pub(super) fn grain(&self, row: usize) -> (&[[f64; 3]], &[[u32; 3]]) {
        let from = if row == 0 { (0, 0) } else { self.ends[row - 1] };
        let to = self.ends[row];
        (&self.points[from.0..to.0], &self.triangles[from.1..to.1])
    }

    /// Vertices of all grains.
    pub(super) fn grain_points(&self) -> &[[f64; 3]] {
        &self.points
    }

    /// Number of the triangles of all grains.
    pub(super) fn grain_triangles(&self) -> usize {
        self.triangles.len()
    }
}
