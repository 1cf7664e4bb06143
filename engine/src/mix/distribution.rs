//! Laws of sizes: how much mass lies between two diameters, and intervals narrow enough to draw from.
//!
//! The range of `ln d` is divided until the density of the mass changes little in each interval. There it is integrated
//! by Gauss-Legendre with three points (Abramowitz and Stegun, table 25.4), to 1e-10 of the whole. In the same
//! intervals the mass is taken as linear in `ln d` when grains are drawn: what passes a diameter then misses the law by
//! less than 2e-4.

use super::CLASSES_PER_OCTAVE;
use crate::elementary::{exp, ln};
use crate::request::{Distribution, DistributionLaw};

/// Largest change of the logarithm of the density in an interval.
const CHANGE: f64 = 0.1;
/// The same where the density over its largest has a logarithm below [`LOW`].
const CHANGE_BELOW: f64 = 0.3;
/// Largest part of the law by which what passes a diameter may miss it: with a change of `c`, mass that is taken as
/// linear misses by at most `c / 8` of the mass of the interval.
const MISS: f64 = 1.5e-4;
const LOW: f64 = -14.0;
/// Logarithm of the density over its largest below which an interval is not divided further.
const NEGLIGIBLE: f64 = -60.0;

/// Logarithm of the density of the mass in `ln d`, up to a constant.
fn ln_density(distribution: &Distribution, d: f64) -> f64 {
    let count = match distribution.law {
        DistributionLaw::Lognormal { median_mm, sigma } => -0.5 * (ln(d / median_mm) / sigma).powi(2),
        DistributionLaw::Normal { mean_mm, standard_deviation_mm } => {
            ln(d) - 0.5 * ((d - mean_mm) / standard_deviation_mm).powi(2)
        }
        DistributionLaw::Weibull { scale_mm, shape } => {
            let exponent = shape * ln(d / scale_mm);
            exponent - exp(exponent)
        }
    };
    count + distribution.mass_power() * ln(d)
}

/// The intervals between two diameters in which there is mass, each with its mass over that which one interval of
/// length 1 in `ln d` would have at the mode.
pub(super) fn intervals(distribution: &Distribution, from: f64, to: f64) -> Vec<[f64; 3]> {
    let roughly = divided(distribution, distribution.d_min_mm, distribution.d_max_mm, f64::INFINITY);
    let all: f64 = roughly.iter().map(|interval| interval[2]).sum();
    divided(distribution, from, to, MISS * all)
}

/// [`intervals`] in which what passes a diameter misses the law by at most `miss`, in the unit of their mass.
fn divided(distribution: &Distribution, from: f64, to: f64, miss: f64) -> Vec<[f64; 3]> {
    const NODE: f64 = 0.774_596_669_241_483_4;
    let (low, high) = distribution.span_mm();
    let (low, high) = (low.max(from), high.min(to));
    if low >= high {
        return Vec::new();
    }
    let most = ln_density(distribution, distribution.mode_mm());
    let relative = |ln_d: f64| ln_density(distribution, exp(ln_d)) - most;
    // The mode divides the range: on either side the density rises or falls.
    let mut edges = vec![low];
    let mode = distribution.mode_mm();
    if low < mode && mode < high {
        edges.push(mode);
    }
    edges.push(high);
    let mut found = Vec::new();
    for pair in edges.windows(2) {
        let longest = std::f64::consts::LN_2 / CLASSES_PER_OCTAVE;
        // Intervals that wait, the finest last: diameters, their logarithms and densities.
        let end = |d: f64| (d, ln(d), relative(ln(d)));
        let mut waiting = vec![(end(pair[0]), end(pair[1]))];
        while let Some((a, b)) = waiting.pop() {
            let densest = a.2.max(b.2);
            let change = (b.2 - a.2).abs();
            let most = if densest > LOW { CHANGE } else { CHANGE_BELOW };
            let missed = exp(densest) * (b.1 - a.1) * change / 8.0;
            let is_even = (change <= most && missed <= miss) || densest < NEGLIGIBLE;
            let ln_middle = 0.5 * (a.1 + b.1);
            let middle = exp(ln_middle);
            let can_be_divided = a.0 < middle && middle < b.0;
            if can_be_divided && (b.1 - a.1 > longest || !is_even) {
                let middle = (middle, ln_middle, relative(ln_middle));
                waiting.extend([(middle, b), (a, middle)]);
                continue;
            }
            let half = 0.5 * (b.1 - a.1);
            let density = |node: f64| exp(relative(ln_middle + half * node));
            let mass = half * (8.0 * density(0.0) + 5.0 * (density(-NODE) + density(NODE))) / 9.0;
            found.push([a.0, b.0, mass]);
        }
    }
    found
}

/// Mass between two diameters, in the unit of [`intervals`].
pub(super) fn mass(distribution: &Distribution, from: f64, to: f64) -> f64 {
    intervals(distribution, from, to).iter().map(|interval| interval[2]).sum()
}

#[cfg(test)]
#[path = "distribution_tests.rs"]
mod tests;
