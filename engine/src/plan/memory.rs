//! Memory of a run at its peak: of the program, and of the grains by number, form, and how crowded they are.
//!
//! Fitted to peaks of runs on one thread (`docs/estimates.md`, "Memory").

use super::UNLIKELY;
use super::estimate::{Case, MethodEstimates};
use super::model::OPERATION_S;
use crate::elementary::exp;
use crate::mix::ShapeSampler;

/// Bytes of the program: what `packstone run` uses of its 44 MB is in memory.
const PROGRAM: f64 = 22.5e6;

/// Memory of a run of spheres, fitted to peaks of `packstone run` on one thread: Fuller's curve 2..16 mm, B16
/// above 0.5 mm with up to 2e6 grains, and equal spheres, each placed at random and grown
/// (`docs/development/measurements-spheres.md`).
mod spheres {
    /// Bytes per grain in a loose specimen.
    pub(super) const BYTES_PER_GRAIN: f64 = 220.0;
    /// Bytes per grain for the voxels of a crowded one, of equal grains and per spread: 270 bytes in all for equal
    /// spheres near saturation, 610 to 1570 for Fuller's curve from 0.60 to 0.66.
    pub(super) const BYTES_PER_CROWDED_GRAIN: f64 = 60.0;
    pub(super) const BYTES_PER_CROWDED_SPREAD: f64 = 4000.0;
    /// Bytes per grain while grains grow from a loose start.
    pub(super) const BYTES_PER_GROWING_GRAIN: f64 = 345.0;
    /// Bytes per grain of the state of growth where the memory of its random start exceeds it: 500 to 910 bytes in all
    /// for Fuller's curve from 0.65 to 0.70.
    pub(super) const BYTES_BESIDE_START: f64 = 140.0;
}

/// The same of grains of other shapes, and of growth by moves. `e` is the product of their surface and mean width over
/// those of spheres, less 1.
mod shaped {
    /// Bytes per grain,
    pub(super) const BYTES: f64 = 800.0;
    /// and for every corner of it.
    pub(super) const BYTES_PER_CORNER: f64 = 48.0;
    /// Longer and flatter grains have more cells and neighbours: bytes per grain and `e` of random addition.
    pub(super) const PLACED_FORM: f64 = 5000.0;
    /// Bytes per grain and square of `e` of growth up to the share `FAR` of the reach, and the factor at the reach.
    pub(super) const GROWN_FORM: f64 = 5000.0;
    pub(super) const FAR: f64 = 0.6;
    pub(super) const AT_REACH: f64 = 1.7;
    /// Random addition that is slow splits voxels: bytes per second, bytes per second and `e`,
    pub(super) const SPLIT: f64 = 2.0e6;
    pub(super) const SPLIT_FORM: f64 = 20.0e6;
    /// and the most of it.
    pub(super) const MOST_SPLIT: f64 = 67.0e6;
    /// Where random addition is unlikely to succeed, it splits voxels to the end, those of round grains most finely:
    /// bytes, more bytes of round grains, and the `e` over which these fall off.
    pub(super) const ALL_SPLIT: f64 = 62.0e6;
    pub(super) const ALL_SPLIT_ROUND: f64 = 50.0e6;
    pub(super) const ROUND: f64 = 0.15;
}

/// Memory of a run in bytes, by the methods that it may take.
pub(super) fn bytes(case: &Case<'_>, methods: &MethodEstimates) -> u64 {
    let of_grains = if case.mix.shapes.is_some() || case.grows_by_moves() {
        of_shaped(case, methods)
    } else {
        of_spheres(case, methods)
    };
    (PROGRAM + of_grains) as u64
}

/// Memory of spheres that are added at random or grow by events. What is added at random, or what growth starts from,
/// takes more the nearer its volume fraction is to what random addition reaches.
fn of_spheres(case: &Case<'_>, methods: &MethodEstimates) -> f64 {
    let grows = methods.grows(&case.request.method);
    let placed = if grows { case.growth().start_fraction.min(case.filled) } else { case.filled };
    let crowding = placed / case.features.rsa_limit(None);
    let crowded = (crowding.min(1.0) - 0.75).max(0.0);
    let of_voxels =
        spheres::BYTES_PER_CROWDED_GRAIN + spheres::BYTES_PER_CROWDED_SPREAD * case.features.spread();
    let placed = spheres::BYTES_PER_GRAIN + of_voxels * (crowded / 0.25).powi(2);
    case.grains
        * if grows {
            spheres::BYTES_PER_GROWING_GRAIN.max(placed + spheres::BYTES_BESIDE_START)
        } else {
            placed
        }
}

/// Memory of grains of other shapes, or that grow by moves.
fn of_shaped(case: &Case<'_>, methods: &MethodEstimates) -> f64 {
    let e = case.features.form() - 1.0;
    let per_grain = shaped::BYTES + shaped::BYTES_PER_CORNER * case.mix.shapes.as_ref().map_or(0.0, corners);
    if methods.grows(&case.request.method) {
        let share = case.share_of_moves().unwrap_or(1.0).min(1.0);
        let near = ((share - shaped::FAR) / (1.0 - shaped::FAR)).max(0.0);
        let at_reach = 1.0 + (shaped::AT_REACH - 1.0) * near;
        return case.grains * (per_grain + shaped::GROWN_FORM * e * e * at_reach);
    }
    let split = if methods.rsa.success_probability < UNLIKELY {
        shaped::ALL_SPLIT + shaped::ALL_SPLIT_ROUND * exp(-e / shaped::ROUND)
    } else {
        let seconds = methods.rsa.operations * OPERATION_S;
        ((shaped::SPLIT + shaped::SPLIT_FORM * e) * seconds).min(shaped::MOST_SPLIT)
    };
    case.grains * (per_grain + shaped::PLACED_FORM * e) + split
}

/// Mean number of the corners of templates; 0 where there are none.
fn corners(shapes: &ShapeSampler) -> f64 {
    let (templates, corners) = shapes
        .templates()
        .fold((0.0, 0.0), |(n, corners), of| (n + 1.0, corners + of.vertices().len() as f64));
    if templates > 0.0 { corners / templates } else { 0.0 }
}
