//! How much of a law of sizes lies between two diameters.
//!
//! The density of the mass is integrated by Simpson's rule in the logarithm of the diameter, on steps of a hundredth of
//! the law's width.

use crate::elementary::{exp, ln, powf};
use crate::request::{By, Distribution, DistributionLaw};

/// Steps across the width of a law.
const STEPS_PER_WIDTH: f64 = 100.0;
/// A density below this share of its largest counts as none: its logarithm.
const NEGLIGIBLE: f64 = -75.0;

/// Share of the mass of a law that lies between two diameters.
pub(super) fn share(distribution: &Distribution, from: f64, to: f64) -> f64 {
    let Distribution { d_min_mm, d_max_mm, .. } = *distribution;
    integral(distribution, from.max(d_min_mm), to.min(d_max_mm)) / integral(distribution, d_min_mm, d_max_mm)
}

/// The logarithm of the mass in a unit of `ln d`, up to a constant that is the same for all diameters.
fn ln_mass(distribution: &Distribution, d: f64) -> f64 {
    let grains = match distribution.law {
        DistributionLaw::Lognormal { median_mm, sigma } => {
            let z = (ln(d) - ln(median_mm)) / sigma;
            -z * z / 2.0
        }
        // A density in d is one in ln d over d.
        DistributionLaw::Normal { mean_mm, standard_deviation_mm } => {
            let z = (d - mean_mm) / standard_deviation_mm;
            ln(d) - z * z / 2.0
        }
        DistributionLaw::Weibull { scale_mm, shape } => shape * ln(d / scale_mm) - powf(d / scale_mm, shape),
    };
    match distribution.by {
        By::Mass => grains,
        By::Number => grains + 3.0 * ln(d),
    }
}

fn integral(distribution: &Distribution, from: f64, to: f64) -> f64 {
    let top = ln_mass(distribution, distribution.mode_mm());
    let (low, high) = distribution.span_mm();
    let (from, to) = (ln(from.max(low)), ln(to.min(high)));
    if from >= to {
        return 0.0;
    }
    let width = match distribution.law {
        DistributionLaw::Lognormal { sigma, .. } => sigma,
        DistributionLaw::Normal { standard_deviation_mm, .. } => standard_deviation_mm / high,
        DistributionLaw::Weibull { shape, .. } => 1.0 / shape,
    };
    let pairs = (0.5 * (to - from) * STEPS_PER_WIDTH / width.min(1.0)).ceil().max(8.0);
    let step = 0.5 * (to - from) / pairs;
    let density = |number: f64| {
        let below_top = ln_mass(distribution, exp(from + step * number)) - top;
        if below_top < NEGLIGIBLE { 0.0 } else { exp(below_top) }
    };
    let (mut odd, mut even) = (0.0, 0.0);
    for pair in 0..pairs as usize {
        let number = 2.0 * pair as f64;
        odd += density(number + 1.0);
        even += if pair == 0 { 0.0 } else { density(number) };
    }
    step / 3.0 * (density(0.0) + 4.0 * odd + 2.0 * even + density(2.0 * pairs))
}
