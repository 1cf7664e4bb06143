//! Laws of sizes: how much mass lies between two diameters, and classes narrow enough to draw from.
//!
//! The density of the mass in `ln d` is integrated by Gauss-Legendre with three points (Abramowitz and Stegun, table
//! 25.4) on intervals of a sixteenth of the law's width. In the same intervals the mass is taken as linear in `ln d`
//! when grains are drawn: what passes a diameter then misses the law by less than 2e-4.

use super::class::{Class, Law};
use super::{CLASSES_PER_OCTAVE, sieve};
use crate::elementary::{exp, ln};
use crate::request::{Distribution, DistributionLaw};

/// Parts into which the width of a law is divided.
const PARTS_PER_WIDTH: f64 = 16.0;

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

/// Longest interval of `ln d` in which the law is taken as simple.
fn step(distribution: &Distribution) -> f64 {
    let width = match distribution.law {
        DistributionLaw::Lognormal { sigma, .. } => sigma,
        DistributionLaw::Normal { standard_deviation_mm, .. } => {
            standard_deviation_mm / distribution.span_mm().1
        }
        DistributionLaw::Weibull { shape, .. } => 1.0 / shape,
    };
    (width / PARTS_PER_WIDTH).min(std::f64::consts::LN_2 / CLASSES_PER_OCTAVE)
}

/// The intervals between two diameters in which there is mass, each with its mass over that which one interval of
/// length 1 in `ln d` would have at the mode.
fn intervals(distribution: &Distribution, from: f64, to: f64) -> Vec<[f64; 3]> {
    const NODE: f64 = 0.774_596_669_241_483_4;
    let (low, high) = distribution.span_mm();
    let (low, high) = (low.max(from), high.min(to));
    if low >= high {
        return Vec::new();
    }
    let most = ln_density(distribution, distribution.mode_mm());
    let density = |ln_d: f64| exp(ln_density(distribution, exp(ln_d)) - most);
    let (first, all) = (ln(low), ln(high / low));
    let parts = (all / step(distribution)).ceil().max(1.0);
    let edge = |part: f64| if part == parts { high } else { low * exp(all * part / parts) };
    (0..parts as usize)
        .map(|part| {
            let part = part as f64;
            let (middle, half) = (first + all * (part + 0.5) / parts, 0.5 * all / parts);
            let ends = density(middle - half * NODE) + density(middle + half * NODE);
            let mass = half * (8.0 * density(middle) + 5.0 * ends) / 9.0;
            [if part == 0.0 { low } else { edge(part) }, edge(part + 1.0), mass]
        })
        .collect()
}

/// Mass between two diameters, in the unit of [`intervals`].
pub(super) fn mass(distribution: &Distribution, from: f64, to: f64) -> f64 {
    intervals(distribution, from, to).iter().map(|interval| interval[2]).sum()
}

/// The sieve classes of a law above a cut-off, from fine to coarse.
pub(super) fn classes(distribution: &Distribution, d_min: f64) -> Vec<Class> {
    let all = mass(distribution, distribution.d_min_mm, distribution.d_max_mm);
    let between = sieve::between(
        d_min.max(distribution.d_min_mm),
        distribution.d_max_mm,
        Law::Distribution(*distribution),
    );
    let with_mass = between.into_iter().map(|class| {
        let mass_fraction = mass(distribution, class.low_mm, class.high_mm) / all;
        Class { mass_fraction, ..class }
    });
    with_mass.filter(|class| class.mass_fraction > 0.0).collect()
}

/// The narrow classes of a class of the law.
pub(super) fn narrow(distribution: &Distribution, class: &Class) -> Vec<Class> {
    let intervals = intervals(distribution, class.low_mm, class.high_mm);
    let all: f64 = intervals.iter().map(|interval| interval[2]).sum();
    let with_mass = intervals.into_iter().filter(|interval| interval[2] > 0.0);
    with_mass
        .map(|[low_mm, high_mm, mass]| Class {
            law: Law::LogUniform,
            low_mm,
            high_mm,
            mass_fraction: class.mass_fraction * mass / all,
            ..*class
        })
        .collect()
}

/// [`Class::grains_per_volume`] of a class of a law.
pub(super) fn grains_per_volume(class: &Class) -> f64 {
    let parts = class.narrow();
    let grains: f64 = parts.iter().map(|part| part.mass_fraction * part.grains_per_volume()).sum();
    grains / parts.iter().map(|part| part.mass_fraction).sum::<f64>()
}

/// [`Class::mean_of`] of a class of a law.
pub(super) fn mean_of(class: &Class, f: &dyn Fn(f64) -> f64) -> f64 {
    let (mut weighted, mut weights) = (0.0, 0.0);
    for part in class.narrow() {
        let grains = part.mass_fraction * part.grains_per_volume();
        weighted += grains * part.mean_of(f);
        weights += grains;
    }
    weighted / weights
}

/// [`Class::diameter`] of a class of a law.
pub(super) fn diameter(class: &Class, u: f64) -> f64 {
    let parts = class.narrow();
    let grains = |part: &Class| part.mass_fraction * part.grains_per_volume();
    let mut rest = u * parts.iter().map(grains).sum::<f64>();
    for part in &parts {
        let here = grains(part);
        if rest < here {
            return part.diameter(rest / here);
        }
        rest -= here;
    }
    class.high_mm
}

#[cfg(test)]
#[path = "distribution_tests.rs"]
mod tests;
