//! Gradings: the share of the mass that passes each diameter, and how gradings and cut-offs are read out of JSON.

use serde::Serialize;

use super::decode::{At, Bound, Object};
#[cfg(feature = "openapi")]
use super::schema;
use super::sieves::{MOST_UNDERSIZE, SieveCurve, complete_below, read_sieves};
use super::{
    DEFAULT_D_MIN_MM, MAX_CURVE_POINTS, MAX_LENGTH_MM, MIN_FULLER_EXPONENT, MIN_LENGTH_MM, MIN_SHARE,
    standard,
};
use crate::sorting;

/// A diameter, a sieve or an edge.
pub(super) const LENGTH: Bound = Bound::closed(MIN_LENGTH_MM, MAX_LENGTH_MM, "mm");
const FRACTION: Bound = Bound::closed(MIN_SHARE, 1.0, "");
const EXPONENT: Bound = Bound::closed(MIN_FULLER_EXPONENT, 1.0, "");
/// Mass fractions typed by hand (three thirds as 0.333) may miss 1 by this much.
const SUM_TOLERANCE: f64 = 1.0e-9;

/// The cumulative mass fraction passing each diameter, in one of its usual forms.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Grading {
    /// A standard curve of DIN 1045-2.
    Standard {
        /// Which one.
        name: StandardCurve,
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
        #[serde(skip_serializing_if = "Between::is_log")]
        between: Between,
    },
    /// Size classes with their share of the mass; what they leave to 1 is finer than all of them.
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

impl Between {
    #[allow(clippy::trivially_copy_pass_by_ref)] // Serde hands over a reference.
    fn is_log(&self) -> bool {
        *self == Self::Log
    }
}

/// The grading curves of DIN 1045-2.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[allow(missing_docs)]
pub enum StandardCurve {
    A8,
    B8,
    C8,
    A16,
    B16,
    C16,
    A32,
    B32,
    C32,
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

impl Grading {
    /// What was added to the curve when it was read, a sentence for each sieve.
    pub(crate) fn completions(&self) -> Vec<String> {
        let Self::Sieves { points, completed_mm, .. } = self else { return Vec::new() };
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
        completed_mm.iter().map(sentence).collect()
    }
}

/// Reads a length of an object that must have it.
pub(super) fn length(object: &mut Object<'_>, name: &'static str) -> Option<f64> {
    object.required(name)?.number(LENGTH)
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
    let (low, high) = described_range(grading);
    let d_min = match (&*grading, given) {
        (_, Some(d)) => d,
        (Grading::Standard { .. } | Grading::Fuller { .. }, None) => DEFAULT_D_MIN_MM,
        (_, None) => low,
    };
    let single = matches!(grading, Grading::Monodisperse { .. } | Grading::Diameters { .. });
    if given.is_none() && d_min >= high && !single {
        at.fault(format!(
            "the default d_min_mm {DEFAULT_D_MIN_MM} is not below the largest diameter {high} mm: name a d_min_mm"
        ));
        return None;
    }
    if d_min > high || (d_min >= high && !single) {
        at.fault(format!("{d_min} is out of range: must be less than the largest diameter {high} mm"));
        return None;
    }
    if d_min < low && !matches!(grading, Grading::Fuller { .. }) && !single && passing_below(grading) > 0.0 {
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
            "{d_min} is out of range: must be at least {low} mm, below which the grading says nothing{remedy}"
        ));
        return None;
    }
    Some(())
}

/// Smallest and largest diameter that a grading describes.
pub(super) fn described_range(grading: &Grading) -> (f64, f64) {
    let span = |values: &mut dyn Iterator<Item = f64>| {
        values.fold((f64::INFINITY, 0.0_f64), |(lo, hi), d| (lo.min(d), hi.max(d)))
    };
    match grading {
        Grading::Standard { name } => span(&mut standard::points(*name).iter().map(|p| p[0])),
        Grading::Fuller { d_max_mm, .. } => (0.0, *d_max_mm),
        Grading::Sieves { points, .. } => span(&mut points.iter().map(|p| p[0])),
        Grading::Classes { classes } => span(&mut classes.iter().flat_map(|c| [c.d_min_mm, c.d_max_mm])),
        Grading::Monodisperse { diameter_mm } => (*diameter_mm, *diameter_mm),
        Grading::Diameters { diameters_mm } => span(&mut diameters_mm.iter().copied()),
    }
}

/// Mass fraction finer than all that the grading describes.
fn passing_below(grading: &Grading) -> f64 {
    match grading {
        Grading::Standard { name } => standard::points(*name)[0][1],
        Grading::Sieves { points, .. } => points[0][1],
        Grading::Classes { classes } => {
            let rest = 1.0 - classes.iter().map(|c| c.mass_fraction).sum::<f64>();
            if rest > SUM_TOLERANCE { rest } else { 0.0 }
        }
        _ => 0.0,
    }
}

pub(super) fn read_grading(at: &At<'_>) -> Option<Grading> {
    #[derive(Clone, Copy)]
    enum Kind {
        Standard,
        Fuller,
        Sieves,
        Classes,
        Monodisperse,
        Diameters,
    }
    let mut object = at.object()?;
    let kind = object.variant(&[
        ("standard", Kind::Standard),
        ("fuller", Kind::Fuller),
        ("sieves", Kind::Sieves),
        ("classes", Kind::Classes),
        ("monodisperse", Kind::Monodisperse),
        ("diameters", Kind::Diameters),
    ])?;
    let grading = match kind {
        Kind::Standard => object
            .required("name")
            .and_then(|at| at.choice(&StandardCurve::NAMES))
            .map(|name| Grading::Standard { name }),
        Kind::Fuller => {
            let d_max = length(&mut object, "d_max_mm");
            let exponent = object.required("exponent").and_then(|at| at.number(EXPONENT));
            d_max.zip(exponent).map(|(d_max_mm, exponent)| Grading::Fuller { d_max_mm, exponent })
        }
        Kind::Sieves => {
            let curve = object.required("points").and_then(|at| read_sieves(&at));
            let completed = match object.optional("completed_mm") {
                Some(at) => read_completed(&at, curve.as_ref()),
                None => Some(Vec::new()),
            };
            let between = match object.optional("between") {
                Some(at) => at.choice(&[("log", Between::Log), ("linear", Between::Linear)]),
                None => Some(Between::Log),
            };
            match (curve, completed, between) {
                (Some(SieveCurve { points, mut completed_mm }), Some(completed), Some(between)) => {
                    completed_mm.extend(completed);
                    sorting::by_number(&mut completed_mm, |&mm| mm);
                    Some(Grading::Sieves { points, completed_mm, between })
                }
                _ => None,
            }
        }
        Kind::Classes => object
            .required("classes")
            .and_then(|at| read_classes(&at))
            .map(|classes| Grading::Classes { classes }),
        Kind::Monodisperse => {
            length(&mut object, "diameter_mm").map(|diameter_mm| Grading::Monodisperse { diameter_mm })
        }
        Kind::Diameters => object
            .required("diameters_mm")
            .and_then(|at| read_diameters(&at))
            .map(|diameters_mm| Grading::Diameters { diameters_mm }),
    };
    object.finish();
    grading
}

/// Reads the sieves that were added to a curve when it was first read.
fn read_completed(at: &At<'_>, curve: Option<&SieveCurve>) -> Option<Vec<f64>> {
    let items = at.list()?;
    let points = &curve?.points;
    let sieves: Vec<f64> = items.iter().map(|item| item.number(LENGTH)).collect::<Option<_>>()?;
    let is_end = |mm: &f64| {
        [(points[0], 0.0), (points[points.len() - 1], 1.0)]
            .iter()
            .any(|([d, passing], end)| d == mm && passing == end)
    };
    if sieves.len() > 2 || !sieves.iter().all(is_end) {
        at.fault(
            "names sieves that were added to the points: must be their finest, which nothing passes, or their \
             coarsest, which all mass passes; or leave this field out",
        );
        return None;
    }
    Some(sieves)
}

fn read_classes(at: &At<'_>) -> Option<Vec<SizeClass>> {
    let items = at.list()?;
    if items.is_empty() {
        at.fault("has 0 classes: must have at least 1");
        return None;
    }
    if items.len() > MAX_CURVE_POINTS {
        at.fault(format!("has {} classes: must have at most {MAX_CURVE_POINTS}", items.len()));
        return None;
    }
    let mut classes = Vec::with_capacity(items.len());
    for item in items.iter() {
        let mut object = item.object()?;
        let d_min = length(&mut object, "d_min_mm");
        let d_max = length(&mut object, "d_max_mm");
        let mass = object.required("mass_fraction").and_then(|at| at.number(FRACTION));
        object.finish();
        let class = SizeClass { d_min_mm: d_min?, d_max_mm: d_max?, mass_fraction: mass? };
        if class.d_min_mm >= class.d_max_mm {
            item.fault(format!("d_min_mm {} must be less than d_max_mm {}", class.d_min_mm, class.d_max_mm));
            return None;
        }
        classes.push(class);
    }
    let total: f64 = classes.iter().map(|c| c.mass_fraction).sum();
    if total > 1.0 + SUM_TOLERANCE {
        at.fault(format!("the mass fractions sum to {total}: must be at most 1"));
        return None;
    }
    let mut order: Vec<usize> = (0..classes.len()).collect();
    sorting::by_number(&mut order, |&i| classes[i].d_min_mm);
    for pair in order.windows(2) {
        let (lower, upper) = (&classes[pair[0]], &classes[pair[1]]);
        if upper.d_min_mm < lower.d_max_mm {
            items.at(pair[1]).fault(format!(
                "d_min_mm {} lies inside the class {}..{} mm: classes must not overlap",
                upper.d_min_mm, lower.d_min_mm, lower.d_max_mm
            ));
            return None;
        }
    }
    sorting::by_number(&mut classes, |class| class.d_min_mm);
    Some(classes)
}

fn read_diameters(at: &At<'_>) -> Option<Vec<f64>> {
    let items = at.list()?;
    if items.is_empty() {
        at.fault("has 0 diameters: must have at least 1");
        return None;
    }
    // One bad unit in a long list would repeat itself a million times.
    items.iter().map(|item| item.number(LENGTH)).collect()
}
impl StandardCurve {
    /// Every standard curve with its name in DIN 1045-2.
    pub const NAMES: [(&'static str, Self); 9] = [
        ("A8", Self::A8),
        ("B8", Self::B8),
        ("C8", Self::C8),
        ("A16", Self::A16),
        ("B16", Self::B16),
        ("C16", Self::C16),
        ("A32", Self::A32),
        ("B32", Self::B32),
        ("C32", Self::C32),
    ];
}
