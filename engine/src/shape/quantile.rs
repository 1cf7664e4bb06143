//! Laws of one ratio by their quantile functions, with nodes for integrals over them.

use super::ratios::{MIN_BETA_PARAMETER, MIN_RATIO, RatioDistribution, RatioLaw};
use crate::arrays::Each as _;
use crate::elementary::{asin, cos, exp, ln, sin};

/// Steps of the tabulated distribution function of a beta law.
const STEPS: usize = 4096;
/// Standard deviations from the mean that are looked at.
const REACH: f64 = 14.0;
/// Steps that make one node for integrals.
const STEPS_PER_NODE: usize = 16;
/// Panels of three Gauss points for integrals over a smooth law.
pub(super) const PANELS: usize = 16;

/// The quantile function of a law.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Quantiles {
    Constant(f64),
    Uniform { min: f64, max: f64 },
    Table(Table),
    Beta(Beta),
}

/// Weighted values; the weights are cumulative.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Table {
    values: Vec<f64>,
    cumulative: Vec<f64>,
}

/// The beta law as a piecewise linear distribution function.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Beta {
    /// Bounds of the steps.
    edges: Vec<f64>,
    /// Share of the grains up to the end of each step.
    cumulative: Vec<f64>,
}

/// Cumulative weights of `n` values, 1 each where there are none.
pub(super) fn cumulative(weights: &[f64], n: usize) -> Vec<f64> {
    let mut sum = 0.0;
    (0..n)
        .map(|i| {
            sum += weights.get(i).copied().unwrap_or(if weights.is_empty() { 1.0 } else { 0.0 });
            sum
        })
        .collect()
}

/// Index of the value that a uniform number selects by cumulative weights; 0 where there is none.
pub(super) fn select(cumulative: &[f64], u: f64) -> usize {
    let total = cumulative.last().copied().unwrap_or(0.0);
    cumulative.partition_point(|sum| *sum <= u * total).min(cumulative.len().saturating_sub(1))
}

/// Gauss points of 0..1 with their weights, three on each panel (Abramowitz and Stegun, table 25.4).
pub(super) fn gauss_points() -> impl Iterator<Item = (f64, f64)> {
    const NODE: f64 = 0.774_596_669_241_483_4;
    let width = 1.0 / PANELS as f64;
    (0..PANELS).flat_map(move |panel| {
        [(-NODE, 5.0 / 18.0), (0.0, 8.0 / 18.0), (NODE, 5.0 / 18.0)]
            .each(|(node, weight)| ((panel as f64 + f64::midpoint(1.0, node)) * width, weight * width))
    })
}

impl Quantiles {
    pub(super) fn new(law: &RatioLaw) -> Self {
        match law {
            RatioLaw::Constant(value) => Self::Constant(*value),
            RatioLaw::Distributed(RatioDistribution::Uniform { min, max }) => {
                Self::Uniform { min: *min, max: *max }
            }
            RatioLaw::Distributed(RatioDistribution::Beta { mean, standard_deviation }) => {
                Self::Beta(Beta::new(*mean, *standard_deviation))
            }
            RatioLaw::Distributed(RatioDistribution::Table { values, weights }) => {
                Self::Table(Table { values: values.clone(), cumulative: cumulative(weights, values.len()) })
            }
        }
    }

    /// The value at which the distribution function is `u`, `0 <= u < 1`.
    pub(super) fn at(&self, u: f64) -> f64 {
        match self {
            Self::Constant(value) => *value,
            Self::Uniform { min, max } => (min + (max - min) * u).min(*max),
            Self::Table(table) => table.values.get(select(&table.cumulative, u)).copied().unwrap_or(1.0),
            Self::Beta(beta) => beta.at(u),
        }
    }

    /// Values with weights that sum to 1, so that sums over them are means over the law.
    pub(super) fn nodes(&self) -> Vec<(f64, f64)> {
        match self {
            Self::Constant(value) => vec![(*value, 1.0)],
            Self::Uniform { .. } => gauss_points().map(|(u, weight)| (self.at(u), weight)).collect(),
            Self::Table(Table { values, cumulative }) => {
                let total = cumulative.last().copied().unwrap_or(1.0);
                let before = std::iter::once(&0.0).chain(cumulative);
                let shares = cumulative.iter().zip(before).map(|(to, from)| (to - from) / total);
                values.iter().copied().zip(shares).collect()
            }
            Self::Beta(beta) => beta.nodes(),
        }
    }

    /// Smallest and largest value.
    pub(super) fn range(&self) -> (f64, f64) {
        match self {
            Self::Constant(value) => (*value, *value),
            Self::Uniform { min, max } => (*min, *max),
            Self::Table(Table { values, .. }) | Self::Beta(Beta { edges: values, .. }) => {
                values.iter().fold((1.0, 0.0), |(least, most), &x| (x.min(least), x.max(most)))
            }
        }
    }
}

impl Beta {
    /// The law with this mean and standard deviation, cut off below [`MIN_RATIO`].
    ///
    /// With `x = sin² t` its density is `sin^(2p-1) t cos^(2q-1) t`, which is finite for parameters from 1/2.
    fn new(mean: f64, deviation: f64) -> Self {
        let sum = mean * (1.0 - mean) / (deviation * deviation) - 1.0;
        let [p, q] = [mean * sum, (1.0 - mean) * sum].each(|parameter| parameter.max(MIN_BETA_PARAMETER));
        let angle = |x: f64| asin(x.clamp(MIN_RATIO, 1.0).sqrt());
        let (from, to) = (angle(mean - REACH * deviation), angle(mean + REACH * deviation));
        let step = (to - from) / STEPS as f64;
        let logs: Vec<f64> = (0..STEPS)
            .map(|i| {
                let t = from + step * (i as f64 + 0.5);
                (2.0 * p - 1.0) * ln(sin(t)) + (2.0 * q - 1.0) * ln(cos(t))
            })
            .collect();
        let peak = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let total: f64 = logs.iter().map(|log| exp(log - peak)).sum();
        let mut sum = 0.0;
        let cumulative = logs.iter().map(|log| {
            sum += exp(log - peak) / total;
            sum
        });
        let edge = |i: usize| {
            let sine = sin(from + step * i as f64);
            (sine * sine).clamp(MIN_RATIO, 1.0)
        };
        Self { cumulative: cumulative.collect(), edges: (0..=STEPS).map(edge).collect() }
    }

    fn at(&self, u: f64) -> f64 {
        let i = select(&self.cumulative, u);
        let before = if i == 0 { 0.0 } else { self.cumulative[i - 1] };
        let part = ((u - before) / (self.cumulative[i] - before)).clamp(0.0, 1.0);
        self.edges[i] + (self.edges[i + 1] - self.edges[i]) * part
    }

    fn nodes(&self) -> Vec<(f64, f64)> {
        let mut before = 0.0;
        let mut nodes = Vec::with_capacity(STEPS / STEPS_PER_NODE);
        for (sums, edges) in self
            .cumulative
            .chunks(STEPS_PER_NODE)
            .zip(self.edges.windows(STEPS_PER_NODE + 1).step_by(STEPS_PER_NODE))
        {
            let (mut moment, start) = (0.0, before);
            for (sum, pair) in sums.iter().zip(edges.windows(2)) {
                moment += (sum - before) * f64::midpoint(pair[0], pair[1]);
                before = *sum;
            }
            let mass = before - start;
            if mass > 0.0 {
                nodes.push((moment / mass, mass));
            }
        }
        nodes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moments(law: &Quantiles) -> (f64, f64) {
        let n = 200_000;
        let values: Vec<f64> = (0..n).map(|i| law.at((f64::from(i) + 0.5) / f64::from(n))).collect();
        let mean = values.iter().sum::<f64>() / f64::from(n);
        let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / f64::from(n);
        (mean, variance.sqrt())
    }

    #[test]
    fn a_beta_law_has_the_moments_asked_for() {
        for (mean, deviation) in [(0.7, 0.1), (0.5, 0.08), (0.9, 0.1), (0.6, 0.001), (0.95, 0.03)] {
            let (found, spread) = moments(&Quantiles::Beta(Beta::new(mean, deviation)));
            assert!((found - mean).abs() < 2e-4, "{found} for {mean}");
            assert!((spread / deviation - 1.0).abs() < 2e-3, "{spread} for {deviation}");
        }
    }

    #[test]
    fn a_beta_law_has_its_closed_form_where_that_is_simple() {
        // Parameters 2 and 1: F(x) = x², here above 0.1.
        let (mean, deviation) = (2.0 / 3.0, (1.0 / 18.0_f64).sqrt());
        let law = Quantiles::Beta(Beta::new(mean, deviation));
        for u in [0.0, 0.1, 0.37, 0.5, 0.9, 0.999] {
            let known = f64::sqrt(0.01 + 0.99 * u);
            assert!((law.at(u) - known).abs() < 2e-4, "{} for {known}", law.at(u));
        }
    }

    #[test]
    fn nodes_are_the_law() {
        let table = RatioLaw::Distributed(RatioDistribution::Table {
            values: vec![0.3, 0.9, 0.5],
            weights: vec![1.0, 0.0, 3.0],
        });
        let laws = [
            Quantiles::Constant(0.4),
            Quantiles::Uniform { min: 0.2, max: 0.7 },
            Quantiles::Beta(Beta::new(0.7, 0.1)),
            Quantiles::new(&table),
        ];
        for law in laws {
            let nodes = law.nodes();
            assert!((nodes.iter().map(|(_, weight)| weight).sum::<f64>() - 1.0).abs() < 1e-12);
            let mean: f64 = nodes.iter().map(|(value, weight)| value * weight).sum();
            assert!((mean - moments(&law).0).abs() < 1e-5, "{mean} for {}", moments(&law).0);
        }
        assert_eq!(Quantiles::new(&table).at(0.999), 0.5);
    }
}
