//! How much of a law of sizes lies between two diameters.
//!
//! The density of the mass is integrated in the logarithm of the diameter by Gauss-Legendre with five points
//! (Abramowitz and Stegun, table 25.4) on panels of a sixteenth of the law's width.

use crate::elementary::{exp, ln, powf};
use crate::request::{By, Distribution, DistributionLaw};

/// Panels across the width of a law.
const PANELS_PER_WIDTH: f64 = 16.0;
/// Widths from the middle of a law to where nothing is left of it.
const WIDTHS: f64 = 16.0;
/// Exponents `(d / scale)^shape` between which all is of Weibull's law: their logarithms.
const WEIBULL_EXPONENTS: [f64; 2] = [-90.0, 5.0];

/// Share of the mass of a law that lies between two diameters.
pub(super) fn share(distribution: &Distribution, from: f64, to: f64) -> f64 {
    let Distribution { d_min_mm, d_max_mm, .. } = *distribution;
    let (low, high) = (from.max(d_min_mm), to.min(d_max_mm));
    // Relative to the largest density of the whole law, so that the three parts have one unit.
    let mut panels = Vec::new();
    let mut edges = vec![d_min_mm, low, high, d_max_mm];
    edges.dedup();
    for pair in edges.windows(2) {
        let is_inside = pair[0] >= low && pair[1] <= high;
        panels.extend(
            nodes(distribution, pair[0], pair[1]).map(|(ln_mass, weight)| (ln_mass, weight, is_inside)),
        );
    }
    let top = panels.iter().fold(f64::NEG_INFINITY, |top, node| top.max(node.0));
    let (mut inside, mut all) = (0.0, 0.0);
    for (ln_mass, weight, is_inside) in panels {
        let mass = weight * exp(ln_mass - top);
        all += mass;
        inside += if is_inside { mass } else { 0.0 };
    }
    if all > 0.0 { inside / all } else { 0.0 }
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

/// The nodes between two diameters: the logarithm of the mass and the weight of each.
fn nodes(distribution: &Distribution, from: f64, to: f64) -> impl Iterator<Item = (f64, f64)> {
    const NODES: [(f64, f64); 5] = [
        (-0.906_179_845_938_664, 0.236_926_885_056_189),
        (-0.538_469_310_105_683, 0.478_628_670_499_366),
        (0.0, 0.568_888_888_888_889),
        (0.538_469_310_105_683, 0.478_628_670_499_366),
        (0.906_179_845_938_664, 0.236_926_885_056_189),
    ];
    let (low, high, width) = match distribution.law {
        DistributionLaw::Lognormal { median_mm, sigma } => {
            // By number, the mass lies three variances farther.
            let farther = 3.0 * sigma * sigma;
            let half = WIDTHS * sigma;
            (median_mm * exp(-half), median_mm * exp(half + farther), sigma)
        }
        DistributionLaw::Normal { mean_mm, standard_deviation_mm } => {
            let half = WIDTHS * standard_deviation_mm;
            (mean_mm - half, mean_mm + half, standard_deviation_mm / (mean_mm + half).min(to))
        }
        DistributionLaw::Weibull { scale_mm, shape } => {
            let [low, high] = WEIBULL_EXPONENTS.map(|exponent| scale_mm * exp(exponent / shape));
            (low, high, 1.0 / shape)
        }
    };
    let (from, to) = (from.max(low), to.min(high));
    let length = if from < to { ln(to / from) } else { 0.0 };
    let panels = (length * PANELS_PER_WIDTH / width.min(1.0)).ceil();
    let distribution = *distribution;
    (0..panels as usize).flat_map(move |panel| {
        let half = 0.5 * length / panels;
        let middle = ln(from) + half * (2.0 * panel as f64 + 1.0);
        NODES.map(|(node, weight)| (ln_mass(&distribution, exp(middle + half * node)), half * weight))
    })
}
