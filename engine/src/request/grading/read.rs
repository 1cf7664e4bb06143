//! Reads gradings out of JSON.

use super::read_law::{
    read_andreasen, read_bolomey, read_by, read_dreux_gorisse, read_faury, read_lognormal, read_normal,
    read_rosin_rammler, read_weibull,
};
use super::standard::{self, LimitCurve, Standard, StandardGrading};
use super::{Between, EXPONENT, Grading, SUM_TOLERANCE, SizeClass, SizeShare, number};
use crate::request::decode::{At, Bound, Object, bounded};
use crate::request::lengths::{LENGTH, length};
use crate::request::sieves::{SieveCurve, read_sieves};
use crate::request::{MAX_CURVE_POINTS, MIN_SHARE};
use crate::sorting;

const FRACTION: Bound = Bound::closed(MIN_SHARE, 1.0, "");
/// The most by which the rounded mass fractions of a table exceed 1, as in tables that are read (`importer`).
const TABLE_TOLERANCE: f64 = 0.01;
const SHARE: Bound = Bound::closed(1.0e-9, 1.0e9, "");

/// Reads the fields of one type of grading.
type Read = for<'a> fn(&mut Object<'a>) -> Option<Grading>;

/// Every type of grading.
const TYPES: [(&str, Read); 15] = [
    ("standard", read_standard),
    ("fuller", read_fuller),
    ("andreasen", read_andreasen),
    ("bolomey", read_bolomey),
    ("faury", read_faury),
    ("dreux_gorisse", read_dreux_gorisse),
    ("lognormal", read_lognormal),
    ("normal", read_normal),
    ("weibull", read_weibull),
    ("rosin_rammler", read_rosin_rammler),
    ("sizes", read_sizes),
    ("sieves", read_curve),
    ("classes", read_classes),
    ("monodisperse", read_monodisperse),
    ("diameters", read_diameters),
];

impl Grading {
    /// The names of all types of gradings in requests.
    pub fn types() -> impl Iterator<Item = &'static str> {
        TYPES.iter().map(|(name, _)| *name)
    }
}

/// Reads a grading.
///
/// `None` means that faults were reported.
pub(in crate::request) fn read_grading(at: &At<'_>) -> Option<Grading> {
    let mut object = at.object()?;
    let read = object.variant(&TYPES)?;
    let grading = read(&mut object);
    object.finish();
    grading
}

fn read_monodisperse(object: &mut Object<'_>) -> Option<Grading> {
    length(object, "diameter_mm").map(|diameter_mm| Grading::Monodisperse { diameter_mm })
}

fn read_curve(object: &mut Object<'_>) -> Option<Grading> {
    let curve = object.required("points").and_then(|at| read_sieves(&at));
    let completed = match object.optional("completed_mm") {
        Some(at) => read_completed(&at, curve.as_ref()),
        None => Some(Vec::new()),
    };
    let between = match object.optional("between") {
        Some(at) => at.choice(&[("log", Between::Log), ("linear", Between::Linear)]),
        None => Some(Between::Log),
    };
    let (SieveCurve { points, mut completed_mm }, completed, between) = (curve?, completed?, between?);
    completed_mm.extend(completed);
    sorting::by_number(&mut completed_mm, |&mm| mm);
    Some(Grading::Sieves { points, completed_mm, between })
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

fn read_classes(object: &mut Object<'_>) -> Option<Grading> {
    let at = &object.required("classes")?;
    let items = bounded(at, "classes", MAX_CURVE_POINTS)?;
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
    if total > 1.0 + TABLE_TOLERANCE {
        let total = (total * 1e6).round() / 1e6;
        at.fault(format!(
            "the mass fractions sum to {total}: must be at most 1, or 1.01 where a table is rounded"
        ));
        return None;
    }
    if total > 1.0 + SUM_TOLERANCE {
        for class in &mut classes {
            class.mass_fraction /= total;
        }
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
    Some(Grading::Classes { classes })
}

fn read_diameters(object: &mut Object<'_>) -> Option<Grading> {
    let at = object.required("diameters_mm")?;
    let items = at.list()?;
    if items.is_empty() {
        at.fault("has 0 diameters: must have at least 1");
        return None;
    }
    // One bad unit in a long list would repeat itself a million times.
    let diameters_mm: Option<Vec<f64>> = items.iter().map(|item| item.number(LENGTH)).collect();
    Some(Grading::Diameters { diameters_mm: diameters_mm? })
}

fn read_standard(object: &mut Object<'_>) -> Option<Grading> {
    let grading = read_named(object);
    let curve_at = object.optional("curve");
    let curve = match &curve_at {
        Some(at) => at
            .choice(&[
                ("lower", LimitCurve::Lower),
                ("middle", LimitCurve::Middle),
                ("upper", LimitCurve::Upper),
            ])
            .map(Some),
        None => Some(None),
    };
    let ((grading, _), curve) = (grading?, curve?);
    match (curve, curve_at) {
        (Some(_), Some(at)) if grading.is_curve() => {
            at.fault(format!("{} is one curve and no band: leave this field out", grading.name));
            None
        }
        (curve, _) => Some(Grading::Standard {
            standard: grading.standard,
            name: grading.name,
            curve: curve.or((!grading.is_curve()).then(LimitCurve::default)),
        }),
    }
}

/// Reads which grading of a standard is meant, with the place of its name.
pub(in crate::request) fn read_named<'a>(
    object: &mut Object<'a>,
) -> Option<(&'static StandardGrading, At<'a>)> {
    let standard_at = object.optional("standard");
    let name_at = object.required("name");
    let standard = match &standard_at {
        Some(at) => at.choice(&Standard::NAMES),
        None => Some(Standard::default()),
    };
    let (standard, name_at) = (standard?, name_at?);
    let names: Vec<_> = standard::of_standard(standard).map(|grading| (grading.name, grading)).collect();
    if standard_at.is_none()
        && let Some(name) = name_at.value().as_str()
        && standard::find(standard, name).is_none()
        && let Some((other, _)) = Standard::NAMES.iter().find(|of| standard::find(of.1, name).is_some())
    {
        name_at.fault(format!(
            "{name:?} is a grading of another standard: name it as `standard`, for example {other:?} (without one it is \
             DIN 1045-2)"
        ));
        return None;
    }
    let grading = name_at.choice(&names)?;
    Some((grading, name_at))
}

fn read_fuller(object: &mut Object<'_>) -> Option<Grading> {
    let d_max = length(object, "d_max_mm");
    let exponent = number(object, "exponent", EXPONENT);
    Some(Grading::Fuller { d_max_mm: d_max?, exponent: exponent? })
}

fn read_sizes(object: &mut Object<'_>) -> Option<Grading> {
    let sizes = object.required("sizes").and_then(|at| read_size_shares(&at));
    let by = read_by(object);
    Some(Grading::Sizes { sizes: sizes?, by: by? })
}

fn read_size_shares(at: &At<'_>) -> Option<Vec<SizeShare>> {
    let items = bounded(at, "sizes", MAX_CURVE_POINTS)?;
    let mut sizes = Vec::with_capacity(items.len());
    for (row, item) in items.iter().enumerate() {
        let mut object = item.object()?;
        let diameter = length(&mut object, "diameter_mm");
        let share = number(&mut object, "share", SHARE);
        object.finish();
        sizes.push((SizeShare { diameter_mm: diameter?, share: share? }, row));
    }
    sorting::by_number(&mut sizes, |(size, _)| size.diameter_mm);
    for pair in sizes.windows(2) {
        let (size, row) = pair[1];
        if size.diameter_mm == pair[0].0.diameter_mm {
            items.at(row).fault(format!("the size {} mm stands twice: must stand once", size.diameter_mm));
            return None;
        }
    }
    Some(sizes.into_iter().map(|(size, _)| size).collect())
}
