//! Laws of the axis ratios of grains: the elongation `Ei = b/a` and the flatness `Fi = c/b`.
//!
//! These types are the fields of a request. [`AxisRatios::validate`] judges their numbers;
//! [`RatioSampler`](super::RatioSampler) draws from them.

use serde::Serialize;

/// Smallest ratio of two axes of a grain, `c/a` too. Thinner grains are no aggregate, and each of them would be a
/// neighbour of hundreds of others.
pub const MIN_RATIO: f64 = 0.1;
/// Most values of a table, and most weights.
pub const MAX_TABLE_VALUES: usize = 1000;
/// Most triples of measured axes.
pub const MAX_MEASURED_GRAINS: usize = 10_000;
/// Smallest elongation where an index is the target, so that every index can be met with `c/a` of at least
/// [`MIN_RATIO`].
pub const MIN_TARGET_ELONGATION: f64 = 0.4;
/// Elongation where an index is the target and none is given: uniform, with the mean 0.7 of rock fragments (Fujiwara,
/// Kamimoto and Tsukamoto, Nature 272, 602, 1978, DOI 10.1038/272602a0). The width is chosen, not measured.
pub const DEFAULT_TARGET_ELONGATION: RatioLaw =
    RatioLaw::Distributed(RatioDistribution::Uniform { min: 0.5, max: 0.9 });

/// Largest weight and largest length of a measured axis.
const MAX_NUMBER: f64 = 1.0e6;
/// Smallest standard deviation of a beta law.
const MIN_DEVIATION: f64 = 0.001;
/// Smallest parameter of a beta law; below it most grains would have a ratio of nearly 0 or 1.
pub(super) const MIN_BETA_PARAMETER: f64 = 0.5;
/// What rounding may take from a ratio that is a quotient or a product.
const ROUNDING: f64 = 1.0e-9;

/// A number or a distribution of numbers, for one ratio of axes.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(untagged)]
pub enum RatioLaw {
    /// The same for all grains, 0.1 to 1.
    Constant(f64),
    /// Different from grain to grain.
    Distributed(RatioDistribution),
}

/// How a ratio of axes is distributed over the grains, by their number.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum RatioDistribution {
    /// Uniform between two bounds.
    Uniform {
        /// Lower bound.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.1, maximum = 1))]
        min: f64,
        /// Upper bound.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.1, maximum = 1))]
        max: f64,
    },
    /// The beta distribution on 0..1 with this mean and standard deviation, cut off below 0.1.
    Beta {
        /// Mean.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.15, maximum = 0.99))]
        mean: f64,
        /// Standard deviation.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.001, maximum = 0.36))]
        standard_deviation: f64,
    },
    /// One of these values: what was measured.
    Table {
        /// The values, 0.1 to 1 each.
        #[cfg_attr(feature = "openapi", schema(min_items = 1, max_items = 1000))]
        values: Vec<f64>,
        /// The share of the grains that has each value, in any unit; equal when absent.
        #[cfg_attr(feature = "openapi", schema(required = false, max_items = 1000))]
        #[serde(skip_serializing_if = "Vec::is_empty")]
        weights: Vec<f64>,
    },
}

/// How the ratios of the axes `a >= b >= c` are distributed over the grains.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum AxisRatios {
    /// The same for all grains. `b_over_a` and `c_over_a` are accepted in place of both.
    Constant {
        /// Elongation `Ei = b/a`.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.1, maximum = 1))]
        elongation: f64,
        /// Flatness `Fi = c/b`.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.1, maximum = 1))]
        flatness: f64,
    },
    /// Elongation and flatness, independent of one another. `c/a` is at least 0.1: where a beta distribution leads
    /// below, the grain has the flatness that makes it 0.1.
    Independent {
        /// Elongation `Ei = b/a`.
        elongation: RatioLaw,
        /// Flatness `Fi = c/b`.
        flatness: RatioLaw,
    },
    /// Uniform over the triangle `k <= c/a <= b/a <= 1`, with the means `(2 + k)/3` of `b/a` and `(1 + 2k)/3` of `c/a`.
    Triangle {
        /// Smallest ratio of two axes.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.1, maximum = 1))]
        k: f64,
    },
    /// Those of grains that were measured.
    Measured {
        /// The three axes of every grain, in any order and unit.
        #[cfg_attr(feature = "openapi", schema(min_items = 1, max_items = 10_000))]
        axes: Vec<[f64; 3]>,
        /// How many grains each triple stands for, in any unit; equal when absent.
        #[cfg_attr(feature = "openapi", schema(required = false, max_items = 10_000))]
        #[serde(skip_serializing_if = "Vec::is_empty")]
        weights: Vec<f64>,
    },
    /// Grains with this flakiness index of EN 933-3: the share of the mass from 4 to 100 mm that passes slots of half
    /// the upper sieve of its fraction. The flatness is uniform, 0.2 about a mean that is computed.
    Flakiness {
        /// The index, 0 to 1.
        #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1))]
        index: f64,
        /// Elongation `Ei = b/a`, 0.4 to 1; uniform from 0.5 to 0.9 when absent.
        #[cfg_attr(feature = "openapi", schema(required = false))]
        elongation: RatioLaw,
    },
    /// Grains with this shape index of EN 933-4: the share of the mass of grains that are more than three times as
    /// long as thick. The flatness is uniform, 0.2 about a mean that is computed.
    ShapeIndex {
        /// The index, 0 to 1.
        #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1))]
        index: f64,
        /// Elongation `Ei = b/a`, 0.4 to 1; uniform from 0.5 to 0.9 when absent.
        #[cfg_attr(feature = "openapi", schema(required = false))]
        elongation: RatioLaw,
    },
}

/// A number of a law that is out of its bounds.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {detail}")]
pub struct RatioFault {
    /// JSON pointer to the field, from the law.
    pub field: String,
    /// What is wrong: the value found and the bound it breaks.
    pub detail: String,
}

/// Collects faults.
#[derive(Default)]
struct Faults(Vec<RatioFault>);

impl Faults {
    fn add(&mut self, field: &str, detail: String) {
        self.0.push(RatioFault { field: field.into(), detail });
    }

    fn range(&mut self, field: &str, value: f64, min: f64, max: f64) {
        if !(value >= min && value <= max) {
            self.add(field, format!("{value} is out of range: must be at least {min} and at most {max}"));
        }
    }

    fn weights(&mut self, field: &str, weights: &[f64], values: usize) {
        if weights.is_empty() {
            return;
        }
        if weights.len() != values {
            self.add(field, format!("has {} weights for {values} values: must have as many", weights.len()));
            return;
        }
        for (i, &weight) in weights.iter().enumerate() {
            self.range(&format!("{field}/{i}"), weight, 0.0, MAX_NUMBER);
        }
        if weights.iter().sum::<f64>() <= 0.0 {
            self.add(field, "the weights sum to 0: one at least must be greater".into());
        }
    }

    fn count(&mut self, field: &str, what: &str, count: usize, max: usize) -> bool {
        if count == 0 {
            self.add(field, format!("has 0 {what}: must have at least 1"));
        } else if count > max {
            self.add(field, format!("has {count} {what}: must have at most {max}"));
        }
        (1..=max).contains(&count)
    }
}

/// Largest standard deviation of a beta law with this mean: that at which a parameter is the smallest allowed.
fn largest_deviation(mean: f64) -> f64 {
    let rest = 1.0 - mean;
    (mean * rest / (1.0 + MIN_BETA_PARAMETER / mean.min(rest))).sqrt()
}

impl RatioLaw {
    fn check(&self, field: &str, least: f64, faults: &mut Faults) {
        let at = |name: &str| format!("{field}/{name}");
        match self {
            Self::Constant(value) => faults.range(field, *value, least, 1.0),
            Self::Distributed(RatioDistribution::Uniform { min, max }) => {
                faults.range(&at("min"), *min, least, 1.0);
                faults.range(&at("max"), *max, least, 1.0);
                if min > max {
                    faults.add(&at("min"), format!("{min} is out of range: must be at most max {max}"));
                }
            }
            Self::Distributed(RatioDistribution::Beta { mean, standard_deviation }) => {
                let before = faults.0.len();
                // In hundredths, so that messages have no rounding.
                faults.range(&at("mean"), *mean, (100.0 * least + 5.0).round() / 100.0, 0.99);
                if faults.0.len() == before {
                    // Rounded down, so that the bound that is named is accepted.
                    let most = (largest_deviation(*mean) * 1e4).floor() / 1e4;
                    faults.range(&at("standard_deviation"), *standard_deviation, MIN_DEVIATION, most);
                }
            }
            Self::Distributed(RatioDistribution::Table { values, weights }) => {
                if faults.count(&at("values"), "values", values.len(), MAX_TABLE_VALUES) {
                    for (i, &value) in values.iter().enumerate() {
                        faults.range(&format!("{field}/values/{i}"), value, least, 1.0);
                    }
                    faults.weights(&at("weights"), weights, values.len());
                }
            }
        }
    }

    /// The smallest value of a law that has no tail.
    fn least(&self) -> Option<f64> {
        match self {
            Self::Constant(value) => Some(*value),
            Self::Distributed(RatioDistribution::Uniform { min, .. }) => Some(*min),
            Self::Distributed(RatioDistribution::Beta { .. }) => None,
            Self::Distributed(RatioDistribution::Table { values, .. }) => {
                Some(values.iter().copied().fold(1.0, f64::min))
            }
        }
    }
}

impl AxisRatios {
    /// Judges all numbers by their bounds.
    ///
    /// # Errors
    /// All faults, each with its field, the value found and the bound it breaks.
    pub fn validate(&self) -> Result<(), Vec<RatioFault>> {
        let mut faults = Faults::default();
        match self {
            Self::Constant { elongation, flatness } => {
                faults.range("/elongation", *elongation, MIN_RATIO, 1.0);
                faults.range("/flatness", *flatness, MIN_RATIO, 1.0);
                thickness(&mut faults, elongation * flatness);
            }
            Self::Independent { elongation, flatness } => {
                elongation.check("/elongation", MIN_RATIO, &mut faults);
                flatness.check("/flatness", MIN_RATIO, &mut faults);
                if let (Some(elongation), Some(flatness)) = (elongation.least(), flatness.least()) {
                    thickness(&mut faults, elongation * flatness);
                }
            }
            Self::Triangle { k } => faults.range("/k", *k, MIN_RATIO, 1.0),
            Self::Measured { axes, weights } => {
                if faults.count("/axes", "triples", axes.len(), MAX_MEASURED_GRAINS) {
                    for (i, triple) in axes.iter().enumerate() {
                        measured(&mut faults, i, triple);
                    }
                    faults.weights("/weights", weights, axes.len());
                }
            }
            Self::Flakiness { index, elongation } | Self::ShapeIndex { index, elongation } => {
                faults.range("/index", *index, 0.0, 1.0);
                elongation.check("/elongation", MIN_TARGET_ELONGATION, &mut faults);
            }
        }
        if faults.0.is_empty() { Ok(()) } else { Err(faults.0) }
    }
}

/// Reports a smallest `c/a` that is too small, unless the ratios have faults of their own.
fn thickness(faults: &mut Faults, c_over_a: f64) {
    if faults.0.is_empty() && c_over_a < MIN_RATIO * (1.0 - ROUNDING) {
        faults.add(
            "",
            format!(
                "the smallest elongation times flatness, c/a, is {c_over_a:.4}: must be at least {MIN_RATIO}"
            ),
        );
    }
}

fn measured(faults: &mut Faults, i: usize, triple: &[f64; 3]) {
    if !triple.iter().all(|axis| *axis > 0.0 && *axis <= MAX_NUMBER) {
        faults.add(
            &format!("/axes/{i}"),
            format!("{triple:?} is out of range: axes must be positive and at most 1e6"),
        );
        return;
    }
    let longest = triple.iter().copied().fold(0.0, f64::max);
    let least = triple.iter().copied().fold(f64::INFINITY, f64::min);
    if least < MIN_RATIO * (1.0 - ROUNDING) * longest {
        faults.add(
            &format!("/axes/{i}"),
            format!("{triple:?} has c/a = {:.4}: must be at least {MIN_RATIO}", least / longest),
        );
    }
}
