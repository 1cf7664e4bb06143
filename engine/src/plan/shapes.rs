//! The plan of a mix whose grains have shapes or grow by moves: whether its largest grain fits, what no arrangement
//! reaches, and what the methods are likely to reach in which time.
//!
//! What is known: ellipsoids 1.5:1.2:1 by Fuller's curve 2..16 mm in a cube of 80 mm, some 8000 grains, which random
//! addition packs to 0.63 and the dense method to 0.74 in the times of the tables below; and polyhedra of 21 faces and
//! 37 corners, stretched by the same ratios, in the same cube, which they pack to 0.57 and 0.68. Other mixes are taken
//! to reach no more, and no more than spheres of their sizes.

use std::cell::Cell;

use super::estimate::{MethodEstimate, MethodEstimates};
use super::invalid;
use super::model::LIKELY;
use crate::distance::DistanceRule;
use crate::elementary::{exp, ln, powf};
use crate::error::PlanError;
use crate::mix::{GradedMix, ShapeSampler};
use crate::request::{GrainKind, PackingRequest, Specimen};
use crate::shape::{Ellipsoid, ScaledPolyhedron, SizeMeasure};
use crate::sorting;

/// Densest packing known of equal ellipsoids (Donev, Stillinger, Chaikin and Torquato, Phys. Rev. Lett. 92, 255506,
/// 2004, DOI 10.1103/PhysRevLett.92.255506: 0.7707), rounded up.
pub(super) const EQUAL_ELLIPSOIDS: f64 = 0.772;
/// Densest packing of equal polyhedra: some fill space.
pub(super) const EQUAL_POLYHEDRA: f64 = 1.0;
/// Width of the range of volume fractions in which success turns into failure.
const WIDTH: f64 = 0.01;
/// Relative error of lengths that were searched for.
const ROUNDING: f64 = 1.0e-5;
/// Grains of the mixes that were measured.
const MEASURED_GRAINS: f64 = 8000.0;

/// What the methods were found to do with the grains of a kind.
pub(super) struct Known {
    /// Volume fraction, coating included, that random addition reached.
    random_reach: f64,
    /// The same of the dense method.
    pub(super) dense_reach: f64,
    /// Time of random addition, in s, by volume fraction.
    random_times_s: &'static [(f64, f64)],
    /// Time of the dense method, in s, by volume fraction.
    dense_times_s: &'static [(f64, f64)],
    /// Memory per grain, in bytes, while grains grow.
    bytes_per_growing_grain: f64,
    /// The same where random addition places all of them.
    bytes_per_placed_grain: f64,
    /// More for every corner of a grain.
    bytes_per_corner: f64,
    /// What the estimates are worth.
    pub(super) extrapolation: &'static str,
}

const ELLIPSOIDS: Known = Known {
    random_reach: 0.63,
    dense_reach: 0.74,
    random_times_s: &[(0.50, 0.15), (0.55, 0.4), (0.60, 1.2), (0.63, 2.6)],
    dense_times_s: &[(0.50, 0.2), (0.60, 0.8), (0.65, 1.1), (0.70, 2.3), (0.73, 5.6), (0.75, 14.0)],
    bytes_per_growing_grain: 750.0,
    bytes_per_placed_grain: 1050.0,
    bytes_per_corner: 0.0,
    extrapolation: "shaped grains, taken to reach at most what ellipsoids 1.5:1.2:1 by Fuller's curve do",
};

const POLYHEDRA: Known = Known {
    random_reach: 0.57,
    dense_reach: 0.68,
    random_times_s: &[(0.50, 0.7), (0.55, 3.3), (0.57, 7.0)],
    dense_times_s: &[(0.50, 1.0), (0.55, 2.0), (0.60, 3.6), (0.65, 8.0), (0.68, 30.0)],
    bytes_per_growing_grain: 800.0,
    bytes_per_placed_grain: 800.0,
    bytes_per_corner: 48.0,
    extrapolation: "shaped grains, taken to reach at most what polyhedra of 21 faces, stretched by \
                    1.5:1.2:1, by Fuller's curve do",
};

/// Half polyhedra by volume; mixes with fewer of them are faster. What they reach was not searched for.
const MIXED: Known =
    Known { dense_times_s: &[(0.50, 0.7), (0.55, 1.4), (0.60, 2.3), (0.65, 5.0), (0.68, 19.0)], ..POLYHEDRA };

/// Spheres by the same moves, which take 0.57 of the time (`docs/development/measurements-spheres.md`, "Spheres by
/// moves").
const SPHERES: Known = Known {
    dense_times_s: &[(0.50, 0.11), (0.60, 0.46), (0.65, 0.63), (0.70, 1.3), (0.73, 3.2), (0.75, 8.0)],
    extrapolation: "spheres that grow by moves, taken to reach at most what ellipsoids 1.5:1.2:1 by Fuller's curve do",
    ..ELLIPSOIDS
};

/// What is known of growth by moves of grains of a kind.
pub(super) fn known(kind: GrainKind) -> &'static Known {
    match kind {
        GrainKind::Spheres => &SPHERES,
        GrainKind::Ellipsoids => &ELLIPSOIDS,
        GrainKind::Polyhedra => &POLYHEDRA,
        GrainKind::Mixed => &MIXED,
    }
}

/// Memory per grain, in bytes: of spheres that grow by moves where there are no shapes.
pub(super) fn bytes_per_grain(shapes: Option<&ShapeSampler>, grows: bool) -> f64 {
    let known = known(shapes.map_or(GrainKind::Spheres, ShapeSampler::kind));
    let per_grain = if grows { known.bytes_per_growing_grain } else { known.bytes_per_placed_grain };
    let (templates, corners) = shapes
        .into_iter()
        .flat_map(ShapeSampler::templates)
        .fold((0.0, 0.0), |(n, corners), template| (n + 1.0, corners + template.vertices().len() as f64));
    per_grain + known.bytes_per_corner * if templates > 0.0 { corners / templates } else { 0.0 }
}

/// The estimates of spheres of the same sizes, limited to what is known of growth by moves.
pub(super) fn limited(spheres: MethodEstimates, known: &Known, filled: f64, grains: f64) -> MethodEstimates {
    let limit = |of_spheres: MethodEstimate, most: f64, times: &[(f64, f64)]| {
        let reach = of_spheres.volume_fraction_with_coating_reach.min(most);
        // The logistic function that is LIKELY at the reach.
        let at_reach = ln(LIKELY / (1.0 - LIKELY));
        let probability = 1.0 / (1.0 + exp((filled - reach) / WIDTH - at_reach));
        MethodEstimate {
            success_probability: probability.min(of_spheres.success_probability),
            time_s: time_s(times, filled.min(reach)) * grains / MEASURED_GRAINS,
            volume_fraction_with_coating_reach: reach,
        }
    };
    MethodEstimates {
        rsa: limit(spheres.rsa, known.random_reach, known.random_times_s),
        growth: limit(spheres.growth, known.dense_reach, known.dense_times_s),
    }
}

/// Time at a volume fraction: exponential between the points and beyond them.
fn time_s(points: &[(f64, f64)], filled: f64) -> f64 {
    let i = points.partition_point(|(fraction, _)| *fraction < filled).clamp(1, points.len() - 1);
    let [(from, before), (to, after)] = [points[i - 1], points[i]];
    before * powf(after / before, (filled - from) / (to - from))
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
