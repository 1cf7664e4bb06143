//! The forms that gradings have: pieces of curves, powers of the diameter, and distributions of sizes.
//!
//! Each grading of a request is one of a few [`Form`]s. The sampler ([`crate::mix`]) draws from it and the check
//! ([`crate::check`]) judges by it; each computes from its numbers by formulas of its own.
//!
//! Sources: Fuller and Thompson (1907), Transactions of the ASCE 59, 67 to 143; the modified Andreasen curve of Funk
//! and Dinger (1994), 10.1007/978-1-4615-3118-0; Bolomey (1935), Travaux 19, 228 to 232; Faury (1944), Le béton, Dunod;
//! Dreux and Festa (1998), Nouveau guide du béton, Eyrolles; Rosin and Rammler (1933), Journal of the Institute of Fuel
//! 7, 29 to 36; Weibull (1951), 10.1115/1.4010337.

use std::borrow::Cow;

use serde::Serialize;

use super::{Between, Grading, SizeClass, standard};
use crate::elementary::{exp, ln, powf};

/// Share of the law below and above the bounds that are set where a request names none.
const TAIL: f64 = 0.001;
/// Quantile of the standard normal distribution at `1 - TAIL`.
const NORMAL_QUANTILE: f64 = 3.090_232_306_167_813;
/// Standard deviations from the mean beyond which less than 1e-40 of a normal law lies.
const NORMAL_SPAN: f64 = 14.0;
/// Logarithm of the same for a Weibull law.
const WEIBULL_SPAN: f64 = 92.0;
/// Standard deviations from the mean beyond which less than 1e-9 of a normal law lies.
const NORMAL_TAIL: f64 = 6.0;
/// Exponent `(d / scale)^shape` above which less than 1e-9 of Weibull's law lies.
const WEIBULL_TAIL: f64 = 20.8;

/// Diameter at which Faury's curve has no mass left, in mm: cement is the finest part of it.
const FAURY_FINEST_MM: f64 = 0.0065;
/// Power of the diameter in which Faury's curve is drawn as straight lines.
const FAURY_POWER: f64 = 0.2;
/// Largest size up to which the curve of Dreux and Gorisse bends at half of it, in mm.
const DREUX_HALF_MM: f64 = 20.0;
/// Lower end of the gravel, in mm: above [`DREUX_HALF_MM`] the curve bends in the middle between it and the largest
/// size, on a logarithmic scale.
const DREUX_GRAVEL_MM: f64 = 5.0;

/// What the shares of a distribution of sizes count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum By {
    /// The mass of the grains.
    #[default]
    Mass,
    /// The number of the grains.
    Number,
}

/// A law of sizes without its bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DistributionLaw {
    /// The logarithm of the diameter is normal.
    Lognormal {
        /// Median, in mm.
        median_mm: f64,
        /// Standard deviation of `ln d`.
        sigma: f64,
    },
    /// The diameter is normal.
    Normal {
        /// Mean, in mm.
        mean_mm: f64,
        /// Standard deviation, in mm.
        standard_deviation_mm: f64,
    },
    /// `1 - exp(-(d / scale)^shape)` is finer than `d`.
    Weibull {
        /// Diameter that 63.2 % are finer than, in mm.
        scale_mm: f64,
        /// Exponent.
        shape: f64,
    },
}

/// A law of sizes between two bounds; what lies outside of them is left out, and the rest is the whole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distribution {
    /// The law.
    pub law: DistributionLaw,
    /// What it counts.
    pub by: By,
    /// Smallest diameter, in mm.
    pub d_min_mm: f64,
    /// Largest diameter, in mm.
    pub d_max_mm: f64,
}

impl DistributionLaw {
    /// The diameters that 0.1 % and 99.9 % are finer than. The first is not positive where a normal law has more than
    /// that below 0.
    pub(super) fn usual_bounds_mm(self) -> (f64, f64) {
        match self {
            Self::Lognormal { median_mm, sigma } => {
                let factor = exp(NORMAL_QUANTILE * sigma);
                (median_mm / factor, median_mm * factor)
            }
            Self::Normal { mean_mm, standard_deviation_mm } => {
                let half = NORMAL_QUANTILE * standard_deviation_mm;
                (mean_mm - half, mean_mm + half)
            }
            Self::Weibull { scale_mm, shape } => {
                let at = |finer: f64| scale_mm * powf(-ln(1.0 - finer), 1.0 / shape);
                (at(TAIL), at(1.0 - TAIL))
            }
        }
    }

    /// Whether 1e-9 of the law or more may lie above one diameter and below another.
    pub(super) fn reaches_mm(self, low: f64, high: f64) -> bool {
        match self {
            Self::Lognormal { median_mm, sigma } => {
                ln(low / median_mm) <= NORMAL_TAIL * sigma && ln(high / median_mm) >= -NORMAL_TAIL * sigma
            }
            Self::Normal { mean_mm, standard_deviation_mm } => {
                let half = NORMAL_TAIL * standard_deviation_mm;
                low <= mean_mm + half && high >= mean_mm - half
            }
            Self::Weibull { scale_mm, shape } => shape * ln(low / scale_mm) <= ln(WEIBULL_TAIL),
        }
    }
}

impl Distribution {
    /// Power of the diameter by which a mass exceeds what the law counts.
    pub(crate) fn mass_power(&self) -> f64 {
        match self.by {
            By::Mass => 0.0,
            By::Number => 3.0,
        }
    }

    /// The diameter between the bounds at which the mass has its largest density in `ln d`, in mm.
    pub(crate) fn mode_mm(&self) -> f64 {
        let power = self.mass_power();
        let mode = match self.law {
            DistributionLaw::Lognormal { median_mm, sigma } => median_mm * exp(power * sigma * sigma),
            DistributionLaw::Normal { mean_mm, standard_deviation_mm } => {
                let variance = standard_deviation_mm * standard_deviation_mm;
                0.5 * (mean_mm + (mean_mm * mean_mm + 4.0 * (1.0 + power) * variance).sqrt())
            }
            DistributionLaw::Weibull { scale_mm, shape } => {
                scale_mm * powf((shape + power) / shape, 1.0 / shape)
            }
        };
        mode.clamp(self.d_min_mm, self.d_max_mm)
    }

    /// The part of the range outside of which no mass is left that a sum of it would show, in mm.
    pub(crate) fn span_mm(&self) -> (f64, f64) {
        let power = self.mass_power();
        let (low, high) = match self.law {
            DistributionLaw::Lognormal { median_mm, sigma } => {
                let (middle, half) = (power * sigma * sigma, NORMAL_SPAN * sigma);
                (median_mm * exp(middle - half), median_mm * exp(middle + half))
            }
            DistributionLaw::Normal { mean_mm, standard_deviation_mm } => {
                let half = NORMAL_SPAN * standard_deviation_mm;
                (mean_mm - half, mean_mm + half)
            }
            DistributionLaw::Weibull { scale_mm, shape } => {
                let total = shape + power;
                let most = WEIBULL_SPAN + 8.0 * total / shape;
                (scale_mm * exp(-WEIBULL_SPAN / total), scale_mm * powf(most, 1.0 / shape))
            }
        };
        (low.max(self.d_min_mm), high.min(self.d_max_mm))
    }
}

/// A grading in the form in which it is drawn and judged. Shares are those of the mass.
#[derive(Clone, Debug, PartialEq)]
pub enum Form<'a> {
    /// Straight lines between points.
    Points {
        /// Diameters in mm with the share that passes, from fine to coarse.
        points: Cow<'a, [[f64; 2]]>,
        /// The lines are straight in this power of the diameter; in its logarithm where there is none.
        power: Option<f64>,
    },
    /// `finer + (1 - finer) (d^exponent - d_min^exponent) / (d_max^exponent - d_min^exponent)` passes `d`.
    Power {
        /// Smallest diameter, in mm; 0 where the curve has none.
        d_min_mm: f64,
        /// Largest diameter, in mm.
        d_max_mm: f64,
        /// Exponent.
        exponent: f64,
        /// Share that passes the smallest diameter.
        finer: f64,
    },
    /// A law of sizes.
    Distribution(Distribution),
    /// Size classes, in each of which the curve is linear in `ln d`.
    Classes(&'a [SizeClass]),
    /// Single sizes: diameters in mm with their shares, from fine to coarse.
    Sizes(Vec<[f64; 2]>),
    /// An explicit list of diameters, in mm.
    List(&'a [f64]),
}

impl Form<'_> {
    /// Smallest and largest diameter that the grading describes, in mm.
    pub(crate) fn range_mm(&self) -> (f64, f64) {
        let span = |values: &mut dyn Iterator<Item = f64>| {
            values.fold((f64::INFINITY, 0.0_f64), |(low, high), d| (low.min(d), high.max(d)))
        };
        match self {
            Self::Points { points, .. } => span(&mut points.iter().map(|point| point[0])),
            Self::Power { d_min_mm, d_max_mm, .. } => (*d_min_mm, *d_max_mm),
            Self::Distribution(distribution) => (distribution.d_min_mm, distribution.d_max_mm),
            Self::Classes(classes) => span(&mut classes.iter().flat_map(|c| [c.d_min_mm, c.d_max_mm])),
            Self::Sizes(sizes) => span(&mut sizes.iter().map(|size| size[0])),
            Self::List(list) => span(&mut list.iter().copied()),
        }
    }
}

impl Grading {
    /// The form of the grading.
    pub(crate) fn form(&self) -> Form<'_> {
        let distribution = |law, by: By, d_min_mm: f64, d_max_mm: f64| {
            Form::Distribution(Distribution { law, by, d_min_mm, d_max_mm })
        };
        match *self {
            Self::Standard { standard, name, curve } => {
                let grading = standard::find(standard, name);
                let points = grading.map(|grading| grading.points(curve.unwrap_or_default()));
                Form::Points { points: Cow::Owned(points.unwrap_or_default()), power: None }
            }
            Self::Sieves { ref points, between, .. } => {
                let power = match between {
                    Between::Log => None,
                    Between::Linear => Some(1.0),
                };
                Form::Points { points: Cow::Borrowed(points), power }
            }
            Self::Fuller { d_max_mm, exponent } => {
                Form::Power { d_min_mm: 0.0, d_max_mm, exponent, finer: 0.0 }
            }
            Self::Andreasen { d_min_mm, d_max_mm, exponent } => {
                Form::Power { d_min_mm, d_max_mm, exponent, finer: 0.0 }
            }
            Self::Bolomey { d_max_mm, a_percent } => {
                Form::Power { d_min_mm: 0.0, d_max_mm, exponent: 0.5, finer: a_percent / 100.0 }
            }
            Self::Faury { d_max_mm, a_percent, b_percent, mould_radius_mm } => {
                let middle = faury_percent(d_max_mm, a_percent, b_percent, mould_radius_mm) / 100.0;
                let points = vec![[FAURY_FINEST_MM, 0.0], [0.5 * d_max_mm, middle], [d_max_mm, 1.0]];
                Form::Points { points: Cow::Owned(points), power: Some(FAURY_POWER) }
            }
            Self::DreuxGorisse { d_min_mm, d_max_mm, k_percent } => {
                let bend = dreux_bend_mm(d_max_mm);
                let middle = dreux_percent(d_max_mm, k_percent) / 100.0;
                let points = vec![[d_min_mm, 0.0], [bend, middle], [d_max_mm, 1.0]];
                Form::Points { points: Cow::Owned(points), power: None }
            }
            Self::Lognormal { median_mm, sigma, by, d_min_mm, d_max_mm } => {
                distribution(DistributionLaw::Lognormal { median_mm, sigma }, by, d_min_mm, d_max_mm)
            }
            Self::Normal { mean_mm, standard_deviation_mm, by, d_min_mm, d_max_mm } => {
                let law = DistributionLaw::Normal { mean_mm, standard_deviation_mm };
                distribution(law, by, d_min_mm, d_max_mm)
            }
            Self::Weibull { scale_mm, shape, by, d_min_mm, d_max_mm } => {
                distribution(DistributionLaw::Weibull { scale_mm, shape }, by, d_min_mm, d_max_mm)
            }
            Self::RosinRammler { characteristic_mm, exponent, d_min_mm, d_max_mm } => {
                let law = DistributionLaw::Weibull { scale_mm: characteristic_mm, shape: exponent };
                distribution(law, By::Mass, d_min_mm, d_max_mm)
            }
            Self::Classes { ref classes } => Form::Classes(classes),
            Self::Monodisperse { diameter_mm } => Form::Sizes(vec![[diameter_mm, 1.0]]),
            Self::Sizes { ref sizes, by } => {
                let cubes = |d: f64| if by == By::Number { d * d * d } else { 1.0 };
                let all: f64 = sizes.iter().map(|size| size.share * cubes(size.diameter_mm)).sum();
                let share = |d: f64, share: f64| [d, share * cubes(d) / all];
                Form::Sizes(sizes.iter().map(|size| share(size.diameter_mm, size.share)).collect())
            }
            Self::Diameters { ref diameters_mm } => Form::List(diameters_mm),
        }
    }
}

/// What passes half of the largest size by Faury's curve, in percent: `A + 17 D^(1/5) + B / (R / D - 0.75)`.
pub(super) fn faury_percent(d_max_mm: f64, a: f64, b: f64, mould_radius_mm: Option<f64>) -> f64 {
    let wall = mould_radius_mm.map_or(0.0, |radius_mm| b / (radius_mm / d_max_mm - 0.75));
    a + 17.0 * powf(d_max_mm, FAURY_POWER) + wall
}

/// Diameter at which the curve of Dreux and Gorisse bends, in mm.
pub(super) fn dreux_bend_mm(d_max_mm: f64) -> f64 {
    if d_max_mm <= DREUX_HALF_MM { 0.5 * d_max_mm } else { (DREUX_GRAVEL_MM * d_max_mm).sqrt() }
}

/// What passes it, in percent: `50 - sqrt(D) + K`.
pub(super) fn dreux_percent(d_max_mm: f64, k: f64) -> f64 {
    50.0 - d_max_mm.sqrt() + k
}
