//! The plan of a mix whose grains have shapes or grow by moves: whether its largest grain fits, what no arrangement
//! reaches, and how much time and memory its grains take. What they reach is told by the [`model`](super::model).

use std::cell::Cell;

use super::invalid;
use crate::distance::DistanceRule;
use crate::elementary::{exp, powf};
use crate::error::PlanError;
use crate::methods::monte_carlo::time_to;
use crate::mix::{GradedMix, ShapeSampler};
use crate::request::{GrainKind, PackingRequest, Specimen};
use crate::shape::{Ellipsoid, ScaledPolyhedron, SizeMeasure};
use crate::sorting;

/// Densest packing known of equal ellipsoids (Donev, Stillinger, Chaikin and Torquato, Phys. Rev. Lett. 92, 255506,
/// 2004, DOI 10.1103/PhysRevLett.92.255506: 0.7707), rounded up.
pub(super) const EQUAL_ELLIPSOIDS: f64 = 0.772;
/// Densest packing of equal polyhedra: some fill space.
pub(super) const EQUAL_POLYHEDRA: f64 = 1.0;
/// Relative error of lengths that were searched for.
const ROUNDING: f64 = 1.0e-5;
/// Times of grains of other shapes, by the product of their surface and mean width over those of spheres less 1, `e`,
/// and by the share of polyhedra (`docs/estimates.md`).
mod time {
    /// Growth by moves, of spheres, in microseconds per grain and [`time_to`].
    pub(super) const MOVES_US: f64 = 2.7;
    /// It takes longer by this much per `e`, and for polyhedra by this much and this power of their share.
    pub(super) const MOVES_FORM: f64 = 9.2;
    pub(super) const MOVES_ANGULAR: f64 = 4.3;
    pub(super) const MOVES_ANGULAR_POWER: f64 = 0.6;
    /// Without a target grains grow until nothing moves: that factor, by one run.
    pub(super) const TO_JAMMING: f64 = 8.0e4;
    /// Random addition, of spheres and of far other shapes beside, in microseconds per grain at the reach,
    pub(super) const RANDOM_US: [f64; 2] = [4.55, 2225.0];
    /// how fast that falls off below it (exponent per share of it),
    pub(super) const FALL_OFF: f64 = 10.34;
    /// and the share of the reach that is left at least.
    pub(super) const RANDOM_LEFT: f64 = 0.005;
    /// Grains that are finer than those that end the addition are timed as at this share of the reach.
    pub(super) const EASY: f64 = 0.6;
    /// A draw of a place that fails, of spheres and of far other shapes beside, in microseconds.
    pub(super) const DRAW_US: [f64; 2] = [0.65, 2.2];
    /// Up to this number of grains the time is the same: a cycle has a least number of moves.
    pub(super) const FEW: f64 = 150.0;
    /// Times of random addition are those of this number of grains; more take longer each, by this power of their
    /// number.
    pub(super) const GRAINS: f64 = 8000.0;
    pub(super) const GRAINS_POWER: f64 = 0.1;
    /// Time of a template of polyhedra in s.
    pub(super) const TEMPLATE_S: f64 = 0.003;
}

/// What the estimates of growth by moves are worth for grains of a kind.
pub(super) fn extrapolation(kind: GrainKind) -> Option<&'static str> {
    match kind {
        GrainKind::Spheres => Some("spheres that grow by moves, taken as round ellipsoids"),
        GrainKind::Ellipsoids | GrainKind::Polyhedra => None,
        GrainKind::Mixed => Some("ellipsoids and polyhedra, taken as their mean"),
    }
}

/// Time of growth by moves in s, to a share of the volume fraction that it reaches or until the grains jam; `form` is
/// the surface times the mean width over those of spheres, `angular` the share of polyhedra.
pub(super) fn moves_s(form: f64, angular: f64, share: Option<f64>, grains: f64) -> f64 {
    let of_angular = time::MOVES_ANGULAR * powf(angular, time::MOVES_ANGULAR_POWER);
    let us = time::MOVES_US * (1.0 + time::MOVES_FORM * (form - 1.0) + of_angular);
    let steps = share.map_or(time::TO_JAMMING, |share| time_to(share.min(1.0)));
    us * 1e-6 * grains.max(time::FEW) * steps
}

/// The same of random addition of shaped grains. `ending_share` of the grains are at least as large as those that end
/// it; finer ones find places easily. Where it is not expected to succeed, its last grain has `last_draws` draws.
pub(super) fn random_s(form: f64, share: f64, (grains, ending_share): (f64, f64), last_draws: f64) -> f64 {
    let [round, other] = time::RANDOM_US;
    let us = round + other * (1.0 - exp(1.0 - form));
    let crowded = |share: f64| exp(time::FALL_OFF * (share - 1.0)) / (1.0 - share + time::RANDOM_LEFT);
    let share = share.min(1.0);
    let easily = crowded(share.min(time::EASY));
    let [draw, of_form] = time::DRAW_US;
    of_grains_s(us, grains) * (ending_share * crowded(share) + (1.0 - ending_share) * easily)
        + last_draws * 1e-6 * (draw + of_form * (1.0 - exp(1.0 - form)))
}

/// Time in s that grains which are added at random take at so many microseconds each.
fn of_grains_s(us: f64, grains: f64) -> f64 {
    us * 1e-6 * grains * powf(grains / time::GRAINS, time::GRAINS_POWER)
}

/// Time in s of making so many templates of polyhedra.
pub(super) fn templates_s(templates: usize) -> f64 {
    time::TEMPLATE_S * templates as f64
}

/// Refuses a mix of which no grain of the largest size fits into the specimen, with its distances.
pub(super) fn check_largest(
    request: &PackingRequest,
    mix: &GradedMix,
    shapes: &ShapeSampler,
    rule: &DistanceRule,
) -> Result<(), PlanError> {
    let size = mix.d_max_mm;
    let specimen = &request.specimen;
    let sieve_mm = shapes.measure().is_sieve().then_some(size);
    let ellipsoid_fits = |grain: &Ellipsoid| fits(grain, specimen, rule);
    let mut parts: Vec<u16> = mix.coarsest_classes().map(|class| class.part).collect();
    if parts.is_empty() {
        // An explicit list.
        parts.push(0);
    }
    let polyhedron_fits = |grain: &ScaledPolyhedron<'_>| may_fit(grain, sieve_mm, specimen, rule);
    if parts.iter().all(|&part| shapes.any(part, size, ellipsoid_fits, polyhedron_fits)) {
        return Ok(());
    }
    let shortest = specimen.lengths().into_iter().min_by(|(_, a), (_, b)| a.total_cmp(b));
    let (pointer, length) = shortest.unwrap_or_default();
    let measure = match shapes.measure() {
        SizeMeasure::Sieve => "sieve size",
        SizeMeasure::Equivalent => "equivalent diameter",
    };
    let detail = if specimen.is_periodic() {
        let least_of = |part: u16| {
            let least = Cell::new(f64::INFINITY);
            let note = |needed_mm: f64| {
                least.set(least.get().min(needed_mm));
                // All are looked at.
                false
            };
            let ellipsoid = |grain: &Ellipsoid| note(thinnest_mm(grain, rule));
            let polyhedron = |grain: &ScaledPolyhedron<'_>| note(thinnest_of_polyhedron_mm(grain, rule));
            shapes.any(part, size, ellipsoid, polyhedron);
            least.get()
        };
        let least_mm = parts.iter().map(|&part| least_of(part)).fold(0.0, f64::max);
        // Rounded up, so that the bound can be taken as it is.
        let bound = (least_mm * 1.0e4).ceil() / 1.0e4;
        format!(
            "{length} mm is too small: every grain of the largest {measure}, {size} mm, meets its own image, however it \
             is turned: must be at least {bound} mm"
        )
    } else {
        format!(
            "{length} mm is too small: no grain of the largest {measure}, {size} mm, fits with its distances, and one \
             must"
        )
    };
    Err(invalid(&pointer, detail))
}

/// The thickness of an ellipsoid and its gap: the least distance of two that lie side by side.
fn thinnest_mm(grain: &Ellipsoid, rule: &DistanceRule) -> f64 {
    let d = grain.equivalent_diameter_mm();
    2.0 * grain.semi_axes_mm().z + rule.gap_mm(d, d)
}

/// The diameter of the inscribed sphere of a polyhedron and its gap: two are never closer side by side.
fn thinnest_of_polyhedron_mm(grain: &ScaledPolyhedron<'_>, rule: &DistanceRule) -> f64 {
    let d = grain.equivalent_diameter_mm();
    2.0 * grain.template.inner_radius() * grain.scale_mm + rule.gap_mm(d, d)
}

/// Whether an ellipsoid fits into a specimen in some orientation. Exact for a box with walls; elsewhere `true` may be
/// wrong.
fn fits(grain: &Ellipsoid, specimen: &Specimen, rule: &DistanceRule) -> bool {
    let [a, b, c]: [f64; 3] = grain.semi_axes_mm().into();
    let d = grain.equivalent_diameter_mm();
    let wall = rule.wall_gap_mm(d);
    let domain = specimen.domain();
    // From its own image it keeps a gap along every edge.
    if domain.is_periodic() {
        return domain.bounds_mm.iter().all(|length| thinnest_mm(grain, rule) <= *length);
    }
    // No shadow is narrower than b in its longer direction.
    if let Some(lateral) = domain.lateral() {
        return b <= lateral.radius_mm - wall && c <= domain.bounds_mm[2] / 2.0 - wall;
    }
    // The squared half-widths of the box around a turned ellipsoid are the diagonal of a matrix with the eigenvalues
    // a², b², c²: all that these majorize (Schur and Horn).
    let mut room = domain.bounds_mm.map(|length| (length / 2.0 - wall).max(0.0).powi(2));
    sorting::ascending(&mut room);
    c * c <= room[0] && b * b + c * c <= room[0] + room[1] && a * a + b * b + c * c <= room.iter().sum()
}

/// Whether a polyhedron may fit into a specimen in some orientation; `true` may be wrong.
///
/// Its inscribed sphere must fit between opposite walls, its length into the diagonal of a box, and, where its sieve
/// size is known, it must pass the opening of the two shorter sides, through which it would leave along the longest.
fn may_fit(
    grain: &ScaledPolyhedron<'_>,
    sieve_mm: Option<f64>,
    specimen: &Specimen,
    rule: &DistanceRule,
) -> bool {
    let d = grain.equivalent_diameter_mm();
    let thin = |room: f64| 2.0 * grain.template.inner_radius() * grain.scale_mm <= room;
    let walls = 2.0 * rule.wall_gap_mm(d);
    let domain = specimen.domain();
    if domain.is_periodic() {
        return domain.bounds_mm.into_iter().all(|length| thinnest_of_polyhedron_mm(grain, rule) <= length);
    }
    if domain.lateral().is_some() {
        return thin(domain.bounds_mm.into_iter().fold(f64::INFINITY, f64::min) - walls);
    }
    let mut room = domain.bounds_mm.map(|length| (length - walls) * (1.0 + ROUNDING));
    sorting::ascending(&mut room);
    let diagonal = room.iter().map(|length| length.max(0.0).powi(2)).sum::<f64>().sqrt();
    thin(room[0])
        && grain.template.length() * grain.scale_mm <= diagonal
        && sieve_mm.is_none_or(|sieve| sieve <= room[1])
}

#[cfg(test)]
#[path = "shapes_tests.rs"]
mod tests;
