//! Draws the forms of grains by the laws of their axis ratios.

use rand_xoshiro::Xoshiro256PlusPlus;

use super::quantile::{Quantiles, cumulative, gauss_points, select};
use super::ratios::{AxisRatios, MIN_RATIO, RatioFault};
use super::target::{flatness_for_flakiness, flatness_for_shape_index};
use super::{Form, SizeMeasure};
use crate::arrays::Each as _;
use crate::rng::uniform;

/// Draws forms by a law of the axis ratios.
#[derive(Clone, Debug, PartialEq)]
pub struct RatioSampler {
    law: Law,
    mean_volume_ratio: f64,
    least_volume_ratio: f64,
}

#[derive(Clone, Debug, PartialEq)]
enum Law {
    Independent { elongation: Quantiles, flatness: Quantiles },
    Triangle { k: f64 },
    Measured { forms: Vec<Form>, cumulative: Vec<f64> },
}

impl RatioSampler {
    /// A sampler of `ratios` for grains whose size is drawn by `measure`.
    ///
    /// `passing` is the mass fraction that passes a sieve, a diameter in mm; a law with a target index depends on it.
    /// With sizes by equivalent diameter the index is met approximately, because the sieve sizes differ from them.
    ///
    /// # Errors
    /// Those of [`AxisRatios::validate`].
    pub fn new(
        ratios: &AxisRatios,
        measure: SizeMeasure,
        passing: &dyn Fn(f64) -> f64,
    ) -> Result<Self, Vec<RatioFault>> {
        ratios.validate().map(|()| Self::of_valid(ratios, measure, passing))
    }

    /// The same for ratios that were judged before.
    pub(crate) fn of_valid(ratios: &AxisRatios, measure: SizeMeasure, passing: &dyn Fn(f64) -> f64) -> Self {
        let law = match ratios {
            AxisRatios::Constant { elongation, flatness } => Law::Independent {
                elongation: Quantiles::Constant(*elongation),
                flatness: Quantiles::Constant(*flatness),
            },
            AxisRatios::Independent { elongation, flatness } => Law::Independent {
                elongation: Quantiles::new(elongation),
                flatness: Quantiles::new(flatness),
            },
            AxisRatios::Triangle { k } => Law::Triangle { k: *k },
            AxisRatios::Measured { axes, weights } => Law::Measured {
                forms: axes.iter().map(|triple| Form::of_axes(*triple)).collect(),
                cumulative: cumulative(weights, axes.len()),
            },
            AxisRatios::Flakiness { index, elongation } => {
                let (min, max) = flatness_for_flakiness(*index, measure, passing);
                Law::Independent {
                    elongation: Quantiles::new(elongation),
                    flatness: Quantiles::Uniform { min, max },
                }
            }
            AxisRatios::ShapeIndex { index, elongation } => {
                let elongation = Quantiles::new(elongation);
                let (min, max) = flatness_for_shape_index(*index, measure, &elongation.nodes());
                Law::Independent { elongation, flatness: Quantiles::Uniform { min, max } }
            }
        };
        let (mean_volume_ratio, least_volume_ratio) = match measure {
            SizeMeasure::Sieve => (law.mean_over_sieve(), law.least_over_sieve()),
            SizeMeasure::Equivalent => (1.0, 1.0),
        };
        Self { law, mean_volume_ratio, least_volume_ratio }
    }

    /// Draws the form of one grain.
    pub fn draw(&self, rng: &mut Xoshiro256PlusPlus) -> Form {
        match &self.law {
            Law::Independent { elongation, flatness } => {
                let elongation = elongation.at(uniform(rng));
                thick_enough(elongation, flatness.at(uniform(rng)))
            }
            Law::Triangle { k } => {
                let mut ratio = || k + (1.0 - k) * uniform(rng);
                Form::of_axes([1.0, ratio(), ratio()])
            }
            Law::Measured { forms, cumulative } => {
                forms.get(select(cumulative, uniform(rng))).copied().unwrap_or(Form::SPHERE)
            }
        }
    }

    /// Mean over the grains, by number, of the volume over that of the sphere whose diameter is the size of the grain:
    /// `E[(d_eq / D_s)³]` for sieve sizes, 1 for equivalent diameters.
    #[must_use]
    pub fn mean_volume_ratio(&self) -> f64 {
        self.mean_volume_ratio
    }

    /// Whether all grains have one form.
    pub(crate) fn is_constant(&self) -> bool {
        match &self.law {
            Law::Independent { elongation: Quantiles::Constant(_), flatness: Quantiles::Constant(_) } => true,
            Law::Measured { forms, .. } => forms.len() == 1,
            Law::Independent { .. } | Law::Triangle { .. } => false,
        }
    }

    /// The least value of the same ratio.
    #[must_use]
    pub fn least_volume_ratio(&self) -> f64 {
        self.least_volume_ratio
    }
}

/// The form of a grain whose `c/a` is at least [`MIN_RATIO`].
fn thick_enough(elongation: f64, flatness: f64) -> Form {
    Form { elongation, flatness: flatness.max(MIN_RATIO / elongation).min(1.0) }
}

impl Law {
    /// `E[(d_eq / D_s)³]`.
    fn mean_over_sieve(&self) -> f64 {
        match self {
            Self::Independent { elongation, flatness } => {
                let (elongations, flatnesses) = (elongation.nodes(), flatness.nodes());
                let ratio =
                    |elongation, flatness| thick_enough(elongation, flatness).volume_over_sieve_sphere();
                let mean = |nodes: &[(f64, f64)], f: &dyn Fn(f64) -> f64| -> f64 {
                    nodes.iter().map(|(value, weight)| weight * f(*value)).sum()
                };
                if elongation.range().0 * flatness.range().0 >= MIN_RATIO {
                    // The ratio is a function of the flatness over the elongation.
                    return mean(&elongations, &|e| 1.0 / e) * mean(&flatnesses, &|f| ratio(1.0, f));
                }
                mean(&elongations, &|e| mean(&flatnesses, &|f| ratio(e, f)))
            }
            Self::Triangle { k } => {
                // b/a has the density 2 t over t = 0..1, c/a is uniform below it.
                let mut sum = 0.0;
                for (t, weight) in gauss_points() {
                    for (s, of_s) in gauss_points() {
                        let form = Form::of_axes([1.0, k + (1.0 - k) * t, k + (1.0 - k) * t * s]);
                        sum += 2.0 * t * weight * of_s * form.volume_over_sieve_sphere();
                    }
                }
                sum
            }
            Self::Measured { forms, cumulative } => {
                let total = cumulative.last().copied().unwrap_or(1.0);
                let before = std::iter::once(&0.0).chain(cumulative);
                let shares = cumulative.iter().zip(before).map(|(to, from)| (to - from) / total);
                forms.iter().zip(shares).map(|(form, share)| share * form.volume_over_sieve_sphere()).sum()
            }
        }
    }

    /// The least `(d_eq / D_s)³`. It falls with the elongation, and has its least value over the flatness at an end.
    fn least_over_sieve(&self) -> f64 {
        let least = |elongation: f64, flatnesses: [f64; 2]| {
            flatnesses
                .each(|flatness| Form { elongation, flatness }.volume_over_sieve_sphere())
                .into_iter()
                .fold(f64::INFINITY, f64::min)
        };
        match self {
            Self::Independent { elongation, flatness } => {
                let (low, high) = flatness.range();
                least(elongation.range().1, [low, high])
            }
            Self::Triangle { k } => least(1.0, [*k, 1.0]),
            Self::Measured { forms, .. } => {
                forms.iter().map(Form::volume_over_sieve_sphere).fold(f64::INFINITY, f64::min)
            }
        }
    }
}

#[cfg(test)]
#[path = "sampler_tests.rs"]
mod tests;
