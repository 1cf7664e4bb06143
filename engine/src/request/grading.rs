//! Reads gradings and cut-offs out of JSON, with all their bounds.

use super::decode::{At, Bound, Object};
use super::{
    DEFAULT_D_MIN_MM, Grading, MAX_CURVE_POINTS, MAX_LENGTH_MM, MIN_FULLER_EXPONENT, MIN_LENGTH_MM,
    MIN_SHARE, SizeClass, StandardCurve, standard,
};

use crate::sorting;

/// A diameter, a sieve or an edge.
pub(super) const LENGTH: Bound = Bound::closed(MIN_LENGTH_MM, MAX_LENGTH_MM, "mm");
const FRACTION: Bound = Bound::closed(MIN_SHARE, 1.0, "");
const EXPONENT: Bound = Bound::closed(MIN_FULLER_EXPONENT, 1.0, "");
const PASSING: Bound = Bound::closed(0.0, 1.0, "");
/// Mass fractions typed by hand (three thirds as 0.333) may miss 1 by this much.
const SUM_TOLERANCE: f64 = 1.0e-9;

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

/// The cut-off must leave something to place, and must lie where the curve is known.
pub(super) fn check_d_min(grading: &Grading, given: Option<f64>, at: &At<'_>) -> Option<()> {
    let (low, high) = described_range(grading);
    let d_min = match (grading, given) {
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
        at.fault(format!(
            "{d_min} is out of range: must be at least {low} mm, below which the grading says nothing"
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
        Grading::Sieves { points } => span(&mut points.iter().map(|p| p[0])),
        Grading::Classes { classes } => span(&mut classes.iter().flat_map(|c| [c.d_min_mm, c.d_max_mm])),
        Grading::Monodisperse { diameter_mm } => (*diameter_mm, *diameter_mm),
        Grading::Diameters { diameters_mm } => span(&mut diameters_mm.iter().copied()),
    }
}

/// Mass fraction finer than all that the grading describes.
fn passing_below(grading: &Grading) -> f64 {
    match grading {
        Grading::Standard { name } => standard::points(*name)[0][1],
        Grading::Sieves { points } => points[0][1],
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
            object.required("points").and_then(|at| read_sieves(&at)).map(|points| Grading::Sieves { points })
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

fn read_sieves(at: &At<'_>) -> Option<Vec<[f64; 2]>> {
    let items = at.array()?;
    if items.len() < 2 {
        at.fault(format!("has {} points: must have at least 2", items.len()));
        return None;
    }
    if items.len() > MAX_CURVE_POINTS {
        at.fault(format!("has {} points: must have at most {MAX_CURVE_POINTS}", items.len()));
        return None;
    }
    let mut points: Vec<[f64; 2]> = Vec::with_capacity(items.len());
    for item in items.iter() {
        let [d, passing] = item.array_of()?;
        let (d, passing) = (d.number(LENGTH)?, passing.number(PASSING)?);
        if let Some(&[d_before, passing_before]) = points.last() {
            if d <= d_before {
                item.fault(format!("sieves must rise: {d} mm follows {d_before} mm"));
                return None;
            }
            if passing < passing_before {
                item.fault(format!("passing must not fall: {passing} follows {passing_before}"));
                return None;
            }
        }
        points.push([d, passing]);
    }
    let (first, last) = (points[0][1], points[points.len() - 1][1]);
    if last < 1.0 {
        items.at(items.len() - 1).fault(format!(
            "passing {last} is out of range: all mass must pass the last sieve, so its passing must be 1"
        ));
        return None;
    }
    if first >= 1.0 {
        items.at(0).fault("passing 1 is out of range: the first sieve must hold some mass back, so its passing must be less than 1");
        return None;
    }
    Some(points)
}

fn read_classes(at: &At<'_>) -> Option<Vec<SizeClass>> {
    let items = at.array()?;
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
    let items = at.array()?;
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
