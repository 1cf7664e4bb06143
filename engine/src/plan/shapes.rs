//! The plan of a mix whose grains are no spheres: whether its largest grain fits, what no arrangement reaches, and
//! what the methods are likely to reach in which time.
//!
//! What is known: ellipsoids 1.5:1.2:1 by Fuller's curve 2..16 mm in a cube of 80 mm, some 8000 grains, which random
//! addition packs to 0.63 and the dense method to 0.74 in the times of the tables below. Other mixes are taken to reach
//! no more, and no more than spheres of their sizes.

use super::estimate::{MethodEstimate, MethodEstimates};
use super::invalid;
use super::model::LIKELY;
use crate::distance::DistanceRule;
use crate::error::PlanError;
use crate::mix::{GradedMix, ShapeSampler};
use crate::request::{PackingRequest, Specimen};
use crate::shape::{Ellipsoid, SizeMeasure};

/// Densest packing known of equal ellipsoids (Donev, Stillinger, Chaikin and Torquato, Phys. Rev. Lett. 92, 255506,
/// 2004, DOI 10.1103/PhysRevLett.92.255506: 0.7707), rounded up.
pub(super) const EQUAL_ELLIPSOIDS: f64 = 0.772;
/// Memory per grain, in bytes.
pub(super) const BYTES_PER_GRAIN: f64 = 600.0;
/// Volume fraction, coating included, that random addition reached.
const RANDOM_REACH: f64 = 0.63;
/// The same of the dense method.
pub(super) const DENSE_REACH: f64 = 0.74;
/// Width of the range of volume fractions in which success turns into failure.
const WIDTH: f64 = 0.01;
/// Grains of the mix that was measured.
const MEASURED_GRAINS: f64 = 8000.0;
/// Time of random addition, in s, by volume fraction.
const RANDOM_TIMES_S: [(f64, f64); 4] = [(0.50, 0.15), (0.55, 0.5), (0.60, 3.2), (0.63, 14.0)];
/// Time of the dense method, in s, by volume fraction.
const DENSE_TIMES_S: [(f64, f64); 5] = [(0.50, 0.3), (0.60, 1.2), (0.65, 5.0), (0.70, 18.0), (0.73, 50.0)];

/// The estimates of spheres of the same sizes, limited to what is known of ellipsoids.
pub(super) fn limited(spheres: MethodEstimates, filled: f64, grains: f64) -> MethodEstimates {
    let limit = |of_spheres: MethodEstimate, most: f64, times: &[(f64, f64)]| {
        let reach = of_spheres.volume_fraction_with_coating_reach.min(most);
        // The logistic function that is LIKELY at the reach.
        let at_reach = (LIKELY / (1.0 - LIKELY)).ln();
        let probability = 1.0 / (1.0 + ((filled - reach) / WIDTH - at_reach).exp());
        MethodEstimate {
            success_probability: probability.min(of_spheres.success_probability),
            time_s: time_s(times, filled.min(reach)) * grains / MEASURED_GRAINS,
            volume_fraction_with_coating_reach: reach,
        }
    };
    MethodEstimates {
        rsa: limit(spheres.rsa, RANDOM_REACH, &RANDOM_TIMES_S),
        growth: limit(spheres.growth, DENSE_REACH, &DENSE_TIMES_S),
    }
}

/// Time at a volume fraction: exponential between the points and beyond them.
fn time_s(points: &[(f64, f64)], filled: f64) -> f64 {
    let i = points.partition_point(|(fraction, _)| *fraction < filled).clamp(1, points.len() - 1);
    let [(from, before), (to, after)] = [points[i - 1], points[i]];
    before * (after / before).powf((filled - from) / (to - from))
}

/// What the estimates of grains that are no spheres are worth.
pub(super) const EXTRAPOLATION: &str =
    "grains that are no spheres, taken to reach at most what ellipsoids 1.5:1.2:1 by Fuller's curve do";

/// Refuses a mix of which no grain of the largest size fits into the specimen, with its distances.
pub(super) fn check_largest(
    request: &PackingRequest,
    mix: &GradedMix,
    shapes: &ShapeSampler,
    rule: &DistanceRule,
) -> Result<(), PlanError> {
    let size = mix.d_max_mm;
    if shapes.any(size, |grain| fits(grain, &request.specimen, rule)) {
        return Ok(());
    }
    let (pointer, length) = match request.specimen {
        Specimen::Box { size_mm, .. } => {
            let shortest = (0..3).min_by(|&i, &j| size_mm[i].total_cmp(&size_mm[j])).unwrap_or(0);
            (format!("/specimen/size_mm/{shortest}"), size_mm[shortest])
        }
        Specimen::Cylinder { diameter_mm, height_mm } if diameter_mm < height_mm => {
            ("/specimen/diameter_mm".to_owned(), diameter_mm)
        }
        Specimen::Cylinder { height_mm, .. } => ("/specimen/height_mm".to_owned(), height_mm),
    };
    let measure = match shapes.measure() {
        SizeMeasure::Sieve => "sieve size",
        SizeMeasure::Equivalent => "equivalent diameter",
    };
    let detail = format!(
        "{length} mm is too small: no grain of the largest {measure}, {size} mm, fits with its distances, and one must"
    );
    Err(invalid(&pointer, detail))
}

/// Whether an ellipsoid fits into a specimen in some orientation. Exact for a box with walls; elsewhere `true` may be
/// wrong.
fn fits(grain: &Ellipsoid, specimen: &Specimen, rule: &DistanceRule) -> bool {
    let [a, b, c]: [f64; 3] = grain.semi_axes_mm().into();
    let d = grain.equivalent_diameter_mm();
    let wall = rule.wall_gap_mm(d);
    match *specimen {
        // From its own image it keeps a gap along every edge.
        Specimen::Box { size_mm, .. } if specimen.is_periodic() => {
            size_mm.iter().all(|length| 2.0 * c + rule.gap_mm(d, d) <= *length)
        }
        // The squared half-widths of the box around a turned ellipsoid are the diagonal of a matrix with the
        // eigenvalues a², b², c²: all that these majorize (Schur and Horn).
        Specimen::Box { size_mm, .. } => {
            let mut room = size_mm.map(|length| (length / 2.0 - wall).max(0.0).powi(2));
            room.sort_by(f64::total_cmp);
            c * c <= room[0]
                && b * b + c * c <= room[0] + room[1]
                && a * a + b * b + c * c <= room.iter().sum()
        }
        // No shadow is narrower than b in its longer direction.
        Specimen::Cylinder { diameter_mm, height_mm } => {
            b <= diameter_mm / 2.0 - wall && c <= height_mm / 2.0 - wall
        }
    }
}

#[cfg(test)]
#[path = "shapes_tests.rs"]
mod tests;
