//! Gradings: the share of the mass that passes each diameter, and how gradings and cut-offs are read out of JSON.

mod law;
mod read;
mod read_law;
pub mod standard;

use std::borrow::Cow;

use serde::Serialize;

use super::decode::{At, Bound, Object};
use super::lengths::LENGTH;
#[cfg(feature = "openapi")]
use super::schema;
use super::sieves::{MOST_UNDERSIZE, complete_below};
use super::{DEFAULT_D_MIN_MM, MIN_FULLER_EXPONENT};

pub use law::{By, Distribution, DistributionLaw, Form};
pub(super) use read::{read_grading, read_named};
pub use standard::{LimitCurve, Standard};

/// The exponent of a curve that is a power of the diameter.
const EXPONENT: Bound = Bound::closed(MIN_FULLER_EXPONENT, 1.0, "");
/// Mass fractions typed by hand (three thirds as 0.333) may miss 1 by this much.
const SUM_TOLERANCE: f64 = 1.0e-9;

/// The cumulative mass fraction passing each diameter, in one of its usual forms.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Grading {
    /// A grading of a standard: a curve, or one between the limits of a band.
    Standard {
        /// The standard.
        #[cfg_attr(feature = "openapi", schema(default = "DIN 1045-2", required = false))]
        #[serde(skip_serializing_if = "is_default")]
        standard: Standard,
        /// The name of the grading in it.
        #[cfg_attr(feature = "openapi", schema(schema_with = schema::standard_name))]
        name: &'static str,
        /// Which curve of a band; the middle one when absent. A grading that is one curve has none.
        #[cfg_attr(feature = "openapi", schema(required = false, nullable))]
        #[serde(skip_serializing_if = "Option::is_none")]
        curve: Option<LimitCurve>,
    },
    /// Fuller's curve `F(d) = (d / d_max)^exponent`.
    Fuller {
        /// Largest diameter.
        #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
        d_max_mm: f64,
        /// Exponent; 0.5 is Fuller's own.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.01, maximum = 1))]
        exponent: f64,
    },
    /// The modified Andreasen curve (Funk and Dinger 1994): `F(d) = (d^q - d_min^q) / (d_max^q - d_min^q)`.
    Andreasen {
        /// Smallest diameter.
        #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
        d_min_mm: f64,
        /// Largest diameter.
        #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
        d_max_mm: f64,
        /// Exponent `q`; 0.22 to 0.37 in use.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.01, maximum = 1))]
        exponent: f64,
    },
    /// Bolomey's curve (1935): `F(d) = A + (1 - A) (d / d_max)^0.5`, of aggregate and cement together.
    Bolomey {
        /// Largest diameter.
        #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
        d_max_mm: f64,
        /// `A` in percent; 6 to 14 in use, more for crushed grains and fluid concrete.
        #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 50))]
        a_percent: f64,
    },
    /// Faury's curve (1944) of aggregate and cement together: straight lines in `d^(1/5)` from 0 at 0.0065 mm over
    /// `A + 17 D^(1/5) + B / (R / D - 0.75)` percent at `D / 2` to all at `D = d_max`.
    Faury {
        /// Largest diameter.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.1, maximum = 1e6))]
        d_max_mm: f64,
        /// `A` in percent; 16 to 38 in use.
        #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 60))]
        a_percent: f64,
        /// `B` in percent; 1 to 2 in use.
        #[cfg_attr(feature = "openapi", schema(default = 1.5, required = false, minimum = 0, maximum = 10))]
        b_percent: f64,
        /// Mean radius `R` of the mould, its volume over the area of its walls; without one there are no walls.
        #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 1e-6, maximum = 1e6))]
        #[serde(skip_serializing_if = "Option::is_none")]
        mould_radius_mm: Option<f64>,
    },
    /// The curve of Dreux and Gorisse (Dreux and Festa 1998): straight lines in `ln d` from 0 at `d_min` over
    /// `50 - sqrt(D) + K` percent at the bend to all at `D = d_max`. The bend lies at `D / 2` up to 20 mm, above at
    /// `(5 mm D)^0.5`.
    DreuxGorisse {
        /// Diameter at which the curve begins.
        #[cfg_attr(
            feature = "openapi",
            schema(default = 0.08, required = false, minimum = 1e-6, maximum = 1e6)
        )]
        d_min_mm: f64,
        /// Largest diameter.
        #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
        d_max_mm: f64,
        /// Correction `K` in percent: -10 to 12 in use, with those for the sand and for pumping.
        #[cfg_attr(feature = "openapi", schema(minimum = -30, maximum = 40))]
        k_percent: f64,
    },
    /// A lognormal law. The bounds that are absent are the quantiles of 0.1 % and 99.9 %; a stored request names them.
    Lognormal {
        /// Median of the diameter.
        #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
        median_mm: f64,
        /// Standard deviation of `ln d`.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.01, maximum = 3))]
        sigma: f64,
        /// Whether shares of mass or of number follow the law.
        #[cfg_attr(feature = "openapi", schema(default = "mass", required = false))]
        by: By,
        /// Smallest diameter.
        #[cfg_attr(feature = "openapi", schema(required = false, minimum = 1e-6, maximum = 1e6))]
        d_min_mm: f64,
        /// Largest diameter.
        #[cfg_attr(feature = "openapi", schema(required = false, minimum = 1e-6, maximum = 1e6))]
        d_max_mm: f64,
    },
    /// A normal law, cut off at its bounds, which are those of the lognormal law where they are absent.
    Normal {
        /// Mean of the diameter.
        #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
        mean_mm: f64,
        /// Standard deviation of the diameter: at least 0.001 of the mean.
        #[cfg_attr(feature = "openapi", schema(minimum = 1e-9, maximum = 1e6))]
        standard_deviation_mm: f64,
        /// Whether shares of mass or of number follow the law.
        #[cfg_attr(feature = "openapi", schema(default = "mass", required = false))]
        by: By,
        /// Smallest diameter.
        #[cfg_attr(feature = "openapi", schema(required = false, minimum = 1e-6, maximum = 1e6))]
        d_min_mm: f64,
        /// Largest diameter.
        #[cfg_attr(feature = "openapi", schema(required = false, minimum = 1e-6, maximum = 1e6))]
        d_max_mm: f64,
    },
    /// Weibull's law: `1 - exp(-(d / scale)^shape)` is finer than `d`.
    Weibull {
        /// Diameter that 63.2 % are finer than.
        #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
        scale_mm: f64,
        /// Exponent.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.2, maximum = 100))]
        shape: f64,
        /// Whether shares of mass or of number follow the law.
        #[cfg_attr(feature = "openapi", schema(default = "mass", required = false))]
        by: By,
        /// Smallest diameter.
        #[cfg_attr(feature = "openapi", schema(required = false, minimum = 1e-6, maximum = 1e6))]
        d_min_mm: f64,
        /// Largest diameter.
        #[cfg_attr(feature = "openapi", schema(required = false, minimum = 1e-6, maximum = 1e6))]
        d_max_mm: f64,
    },
    /// The law of Rosin and Rammler (1933): Weibull's, by mass.
    RosinRammler {
        /// Diameter that 63.2 % of the mass passes.
        #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
        characteristic_mm: f64,
        /// Exponent.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.2, maximum = 100))]
        exponent: f64,
        /// Smallest diameter.
        #[cfg_attr(feature = "openapi", schema(required = false, minimum = 1e-6, maximum = 1e6))]
        d_min_mm: f64,
        /// Largest diameter.
        #[cfg_attr(feature = "openapi", schema(required = false, minimum = 1e-6, maximum = 1e6))]
        d_max_mm: f64,
    },
    /// Single sizes and how much there is of each.
    Sizes {
        /// The sizes; a stored request has them from fine to coarse.
        #[cfg_attr(feature = "openapi", schema(value_type = schema::OneOrMore<SizeShare>))]
        sizes: Vec<SizeShare>,
        /// Whether the shares are those of the mass or of the number.
        #[cfg_attr(feature = "openapi", schema(default = "mass", required = false))]
        by: By,
    },
    /// Sieves of the user's: `[diameter in mm, passing]`, in any order, all passings from 0 to 1 or all in percent. A
    /// stored request has them from the finest to the coarsest, from 0 to 1, the last passing 1.
    Sieves {
        /// The points of the curve, at least two.
        #[cfg_attr(feature = "openapi", schema(schema_with = schema::points))]
        points: Vec<[f64; 2]>,
        /// The sieves among the points that were added when the curve was read, in mm: the next coarser one of the
        /// series, which all mass passes, where 90 % or more pass the coarsest; and the next finer one, which nothing
        /// passes, where up to 20 % pass the finest and the cut-off lies below it. Need not be given.
        #[cfg_attr(feature = "openapi", schema(required = false, value_type = schema::OneOrMore<f64>))]
        #[serde(skip_serializing_if = "Vec::is_empty")]
        completed_mm: Vec<f64>,
        /// How the passing runs between two sieves.
        #[cfg_attr(feature = "openapi", schema(default = "log", required = false))]
        #[serde(skip_serializing_if = "is_default")]
        between: Between,
    },
    /// Size classes with their share of the mass; what they leave to 1 is finer than all of them. Shares that exceed 1
    /// in sum by up to 0.01, as rounded tables do, are divided by their sum.
    Classes {
        /// The classes, which must not overlap.
        #[cfg_attr(feature = "openapi", schema(value_type = schema::OneOrMore<SizeClass>))]
        classes: Vec<SizeClass>,
    },
    /// Equal spheres.
    Monodisperse {
        /// Their diameter.
        #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
        diameter_mm: f64,
    },
    /// An explicit list; its volume is the mix's.
    Diameters {
        /// Diameter of every grain, in any order.
        #[cfg_attr(feature = "openapi", schema(schema_with = schema::diameters_mm))]
        diameters_mm: Vec<f64>,
    },
}

/// How the passing of a sieve curve runs between two sieves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Between {
    /// Linear in the logarithm of the diameter, as gradings are drawn.
    #[default]
    Log,
    /// Linear in the diameter.
    Linear,
}

/// Whether a field has the value that an absent one has.
fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// One size class of a mix.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct SizeClass {
    /// Lower bound of the diameter.
    #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
    pub d_min_mm: f64,
    /// Upper bound of the diameter.
    #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
    pub d_max_mm: f64,
    /// Share of the whole aggregate's mass.
    #[cfg_attr(feature = "openapi", schema(minimum = 1e-9, maximum = 1))]
    pub mass_fraction: f64,
}

/// One size of a mix of single sizes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct SizeShare {
    /// Diameter of the grains.
    #[cfg_attr(feature = "openapi", schema(minimum = 1e-6, maximum = 1e6))]
    pub diameter_mm: f64,
    /// Share of the mass or of the number. Shares count by their ratios: they need not sum to 1, and numbers of grains
    /// are shares as well.
    #[cfg_attr(feature = "openapi", schema(minimum = 1e-9, maximum = 1e9))]
    pub share: f64,
}

impl Grading {
    /// The cut-off where a request names none: that of curves that go down to dust.
    pub(super) fn default_d_min_mm(&self) -> Option<f64> {
        let goes_to_dust = matches!(
            self,
            Self::Standard { .. }
                | Self::Fuller { .. }
                | Self::Bolomey { .. }
                | Self::Faury { .. }
                | Self::DreuxGorisse { .. }
        );
        goes_to_dust.then_some(DEFAULT_D_MIN_MM)
    }

    /// What was added to the curve, a sentence for each sieve that matters, and the bounds of a law that are its usual
    /// ones, where grains between two diameters in mm are placed.
    pub(crate) fn completions(&self, cut_off_mm: f64, largest_mm: f64) -> Vec<String> {
        if let Form::Distribution(Distribution { law, by, d_min_mm, d_max_mm }) = self.form() {
            let usual = law.usual_bounds_mm();
            let of = match by {
                By::Mass => "the mass is",
                By::Number => "the grains are",
            };
            let sentence = |name, mm: f64, finer| {
                format!("the law is cut off at its {name}, {mm:.4} mm, which {finer} % of {of} finer than")
            };
            let low =
                (usual.0 == d_min_mm && cut_off_mm < d_min_mm).then(|| sentence("d_min_mm", d_min_mm, 0.1));
            let high =
                (usual.1 == d_max_mm && largest_mm > d_max_mm).then(|| sentence("d_max_mm", d_max_mm, 99.9));
            return low.into_iter().chain(high).collect();
        }
        let (points, completed_mm) = match self {
            Self::Sieves { points, completed_mm, .. } => (Cow::Borrowed(points), completed_mm.clone()),
            Self::Standard { standard, name, curve } => {
                let Some(grading) = standard::find(*standard, name) else { return Vec::new() };
                let points = grading.points(curve.unwrap_or_default());
                let is_added = |mm: &f64| grading.limits.iter().all(|limit| limit.0 != *mm);
                let added = points.iter().map(|point| point[0]).filter(is_added).collect();
                (Cow::Owned(points), added)
            }
            _ => return Vec::new(),
        };
        let sentence = |&sieve: &f64| {
            let (end, [d, passing], what) = if sieve == points[0][0] {
                ("starts", points[1], "nothing")
            } else {
                ("ends", points[points.len() - 2], "all mass")
            };
            format!(
                "the grading {end} with {:.4} % passing {d} mm: the sieve {sieve} mm was added, which {what} passes",
                100.0 * passing
            )
        };
        let is_placed = |&&sieve: &&f64| sieve != points[0][0] || cut_off_mm < points[1][0];
        completed_mm.iter().filter(is_placed).map(sentence).collect()
    }
}

/// Reads a number of an object that must have it.
fn number(object: &mut Object<'_>, name: &'static str, bound: Bound) -> Option<f64> {
    object.required(name)?.number(bound)
}

/// Reads the cut-off of a field that may be absent. Outside: whether it could be read. Inside: whether there is one.
#[allow(clippy::option_option)]
pub(super) fn read_d_min(at: Option<&At<'_>>) -> Option<Option<f64>> {
    match at {
        Some(at) => at.number(LENGTH).map(Some),
        None => Some(None),
    }
}

/// The cut-off must leave something to place, and must lie where the curve is known; a sieve curve that ends above it
/// is completed.
pub(super) fn check_d_min(grading: &mut Grading, given: Option<f64>, at: &At<'_>) -> Option<()> {
    let form = grading.form();
    let (low, high) = form.range_mm();
    let d_min = given.or(grading.default_d_min_mm()).unwrap_or(low);
    let has_sizes = matches!(form, Form::Sizes(_) | Form::List(_));
    let passing_below = passing_below(&form);
    if given.is_none() && d_min >= high && !has_sizes {
        at.fault(format!(
            "the default d_min_mm {DEFAULT_D_MIN_MM} is not below the largest diameter {high} mm: name a d_min_mm"
        ));
        return None;
    }
    if d_min > high || (d_min >= high && !has_sizes) {
        at.fault(format!("{d_min} is out of range: must be less than the largest diameter {high} mm"));
        return None;
    }
    if d_min < low && passing_below > 0.0 {
        let named = if given.is_none() { "the default d_min_mm " } else { "" };
        let mut remedy = String::new();
        if let Grading::Sieves { points, completed_mm, .. } = grading {
            if complete_below(points, completed_mm).is_some() {
                return Some(());
            }
            remedy = format!(
                "; or add the finer sieves to the points, down to one that nothing passes (up to a passing of \
                 {MOST_UNDERSIZE}, the next sieve of the series is added)"
            );
        }
        at.fault(format!(
            "{named}{d_min} is out of range: must be at least {low} mm, below which the grading says nothing{remedy}"
        ));
        return None;
    }
    Some(())
}

/// Mass fraction finer than all that the grading describes.
fn passing_below(form: &Form<'_>) -> f64 {
    match form {
        Form::Points { points, .. } => points[0][1],
        Form::Classes(classes) => {
            let rest = 1.0 - classes.iter().map(|c| c.mass_fraction).sum::<f64>();
            if rest > SUM_TOLERANCE { rest } else { 0.0 }
        }
        _ => 0.0,
    }
}
