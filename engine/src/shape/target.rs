//! The law of flatness that gives a set of grains a flakiness index or a shape index.
//!
//! The flatness `k = c/b` is uniform about a mean `m`, with a half-width of [`HALF_WIDTH`] or what the bounds of the
//! flatness leave. Grains get flatter in every respect as `m` falls, so that the index is a monotone function of `m`,
//! and bisection finds it. With diameters read as sieve sizes a grain counts by its volume over that of the sphere of
//! its sieve size, `4 sqrt(2) f(k) / (b/a) / 2` with `f(k) = k / (1 + k²)^(3/2)`; the elongation is a factor, which
//! drops out of the flakiness index.

use super::indices::{FLAKINESS_FRACTIONS_MM, NON_CUBICAL};
use super::{Form, SizeMeasure};
use crate::elementary::ln;

/// Half of the width of the law of flatness.
const HALF_WIDTH: f64 = 0.2;
/// Smallest flatness: with it all grains are flaky, and more than three times as long as thick.
pub(super) const MIN_FLATNESS: f64 = 0.25;
/// Steps of the tabulated integrals over the flatness.
const STEPS: usize = 1500;
const BISECTIONS: usize = 60;

/// Bounds of the uniform law of flatness with mean `m`.
fn bounds(m: f64) -> (f64, f64) {
    let half = HALF_WIDTH.min(m - MIN_FLATNESS).min(1.0 - m).max(0.0);
    (m - half, m + half)
}

/// The bounds for which `share`, which falls with the mean flatness, is `index`.
fn bisect(index: f64, share: impl Fn(f64, f64) -> f64) -> (f64, f64) {
    let (mut flat, mut round) = (MIN_FLATNESS, 1.0);
    for _ in 0..BISECTIONS {
        let middle = f64::midpoint(flat, round);
        let (low, high) = bounds(middle);
        if share(low, high) > index { flat = middle } else { round = middle }
    }
    bounds(f64::midpoint(flat, round))
}

/// Share of the mass from 4 to 100 mm that is flaky where all grains have this flatness, by the mass fraction
/// `passing` each sieve.
///
/// A grain of sieve size `D` has the thickness `2c = D x / 2`, `x = 2 sqrt(2) k / sqrt(1 + k²)`, so it passes slots
/// that are wider, `D < 2 slot / x`. Without grains in this range the size is taken to be uniform in `ln D` in
/// fractions `1 : 1.25`, which gives `ln(1.25 / x) / ln 1.25` between 0 and 1.
pub(super) fn flaky_share(flatness: f64, passing: &dyn Fn(f64) -> f64) -> f64 {
    let x = 2.0 * std::f64::consts::SQRT_2 * flatness / (1.0 + flatness * flatness).sqrt();
    let [first, .., last] = FLAKINESS_FRACTIONS_MM;
    let all = passing(last[1]) - passing(first[0]);
    if all > 1e-9 {
        let flaky = |[low, high, slot]: [f64; 3]| passing((2.0 * slot / x).clamp(low, high)) - passing(low);
        FLAKINESS_FRACTIONS_MM.into_iter().map(flaky).sum::<f64>() / all
    } else {
        (ln(1.25 / x) / ln(1.25)).clamp(0.0, 1.0)
    }
}

/// Bounds of the uniform law of flatness with this flakiness index.
pub(super) fn flatness_for_flakiness(
    index: f64,
    measure: SizeMeasure,
    passing: &dyn Fn(f64) -> f64,
) -> (f64, f64) {
    let step = (1.0 - MIN_FLATNESS) / STEPS as f64;
    let (mut masses, mut flaky) = (vec![0.0], vec![0.0]);
    for i in 0..STEPS {
        let flatness = MIN_FLATNESS + step * (i as f64 + 0.5);
        let mass = measure.volume_ratio(Form { elongation: 1.0, flatness });
        masses.push(masses[i] + mass);
        flaky.push(flaky[i] + mass * flaky_share(flatness, passing));
    }
    let interpolated = |sums: &[f64], flatness: f64| {
        let at = (flatness - MIN_FLATNESS) / step;
        let i = (at.max(0.0) as usize).min(STEPS - 1);
        sums[i] + (sums[i + 1] - sums[i]) * (at - i as f64)
    };
    bisect(index, |low, high| {
        let mass = interpolated(&masses, high) - interpolated(&masses, low);
        if high - low < step {
            return flaky_share(low, passing);
        }
        (interpolated(&flaky, high) - interpolated(&flaky, low)) / mass
    })
}

/// Bounds of the uniform law of flatness with this shape index, by the elongations and their shares of the number.
pub(super) fn flatness_for_shape_index(
    index: f64,
    measure: SizeMeasure,
    elongations: &[(f64, f64)],
) -> (f64, f64) {
    // Of the mass of a grain as a function of its flatness.
    let integral = |flatness: f64| match measure {
        SizeMeasure::Sieve => -1.0 / (1.0 + flatness * flatness).sqrt(),
        SizeMeasure::Equivalent => flatness,
    };
    let factor = |elongation: f64| match measure {
        SizeMeasure::Sieve => 1.0 / elongation,
        SizeMeasure::Equivalent => 1.0,
    };
    let all: f64 = elongations.iter().map(|(elongation, share)| share * factor(*elongation)).sum();
    bisect(index, |low, high| {
        let long = elongations.iter().map(|(elongation, share)| {
            let bound = 1.0 / (NON_CUBICAL * elongation);
            let part = if high - low < 1e-9 {
                f64::from(low < bound)
            } else {
                let to = bound.clamp(low, high);
                (integral(to) - integral(low)) / (integral(high) - integral(low))
            };
            share * factor(*elongation) * part
        });
        long.sum::<f64>() / all
    })
}
