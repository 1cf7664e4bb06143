//! The smallest specimen for grains whose number is given.

use super::estimate::Case;
use super::model::LIKELY;
use crate::distance::DistanceRule;
use crate::elementary::log10;
use crate::mix::GradedMix;
use crate::request::{Method, PackingRequest, Specimen};

/// Share of the volume fraction of a random close packing (`rods`) that growth reaches without walls.
const BY_GROWTH: f64 = 0.97;
/// The same of random sequential addition: 0.36 of equal spheres.
const AT_RANDOM: f64 = 0.56;
/// Share that walls take, by their surface over the volume times the mean diameter of the grains: the smallest boxes in
/// which four of five runs packed 2, 10, 50 and 200 equal spheres have 0.15 to 0.20.
const WALLS: f64 = 0.20;
/// Volume fraction of a random close packing of equal spheres.
const EQUAL: f64 = 0.64;
/// Lengths over those of the request up to which a larger specimen is looked for.
const LARGEST: f64 = 8.0;
/// Ratio of the lengths of two specimens that are tried one after the other.
const STEP: f64 = 1.15;
/// Halvings of the last step.
const HALVINGS: usize = 6;

/// The smallest specimen with the proportions of that of the request in which its grains, whose number does not depend
/// on it, are packed with a probability of 0.9; `None` where the mix prescribes a volume fraction, or where no such
/// specimen is found. `admits` tells whether the grains of a case have room at all.
///
/// The forecast is fitted to thousands of grains. For few grains, and lists of any scatter, it is bounded by what a
/// random packing between walls is known to reach, which lets some specimens be longer than they need be.
pub(super) fn specimen(
    request: &PackingRequest,
    mix: &GradedMix,
    admits: impl Fn(&Case<'_>, &DistanceRule) -> bool,
) -> Option<Specimen> {
    if mix.has_requested_volume() {
        return None;
    }
    let (mut request, mut mix) = (request.clone(), mix.clone());
    let (whole, fractions) = (request.specimen, [mix.volume_fraction_mixture, mix.volume_fraction_effective]);
    let mut is_likely = |factor: f64| {
        let specimen = scaled(whole, factor);
        request.specimen = specimen;
        let volumes = whole.volume_mm3() / specimen.volume_mm3();
        mix.specimen_volume_mm3 = specimen.volume_mm3();
        [mix.volume_fraction_mixture, mix.volume_fraction_effective] = fractions.map(|phi| phi * volumes);
        let rule = DistanceRule::new(&request.distance, &specimen);
        let case = Case::of_mix(&request, &mix, &rule);
        admits(&case, &rule)
            && have_room(&case)
            && case.of_request(&case.methods()).success_probability >= LIKELY
    };
    let mut factor = 1.0;
    while !is_likely(factor) {
        factor *= STEP;
        if factor > LARGEST {
            return None;
        }
    }
    while is_likely(factor / STEP) {
        factor /= STEP;
    }
    let mut unlikely = factor / STEP;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (factor + unlikely);
        *(if is_likely(middle) { &mut factor } else { &mut unlikely }) = middle;
    }
    Some(scaled(whole, factor))
}

/// Whether a random packing between the walls of the specimen is known to reach the volume fraction: of all grains,
/// and of the largest ones alone, which few fine grains beside them must not hide.
fn have_room(case: &Case<'_>) -> bool {
    let by = if matches!(case.request.method, Method::Rsa { .. }) { AT_RANDOM } else { BY_GROWTH };
    let between_walls = |walls: f64| by * (1.0 - WALLS * walls);
    let features = &case.features;
    let whole = case.filled <= features.random_close() * between_walls(features.walls());
    let (share, walls) = case.largest();
    whole && share * case.filled <= EQUAL * between_walls(walls)
}

/// The specimen with all lengths times a factor, each rounded up to three digits.
fn scaled(specimen: Specimen, factor: f64) -> Specimen {
    let length = |mm: f64| {
        let per_mm = 10.0_f64.powi(2 - log10(mm * factor).floor() as i32);
        (mm * factor * per_mm).ceil() / per_mm
    };
    specimen.with_lengths(length)
}
