//! Reads the request types out of JSON, with all their bounds.

use serde_json::Value;

use super::decode::{At, Bound, Faults, Object};
use super::edmd;
use super::monte_carlo;
use super::proportions::{MixProportions, read_proportions};
use super::segregation::read_segregation;
use super::shape::read_shapes;
use super::{
    Boundary, DEFAULT_D_MIN_MM, Distance, FieldError, Grading, MAX_CURVE_POINTS, MAX_LENGTH_MM, MAX_SEED,
    MIN_FULLER_EXPONENT, MIN_LENGTH_MM, MIN_SHARE, Method, Mix, PackingRequest, Segregation, SizeClass,
    SizeMeasure, Specimen, StandardCurve, VolumeFractionOf,
};
use crate::request::standard;

const LENGTH: Bound = Bound::closed(MIN_LENGTH_MM, MAX_LENGTH_MM, "mm");
const GAP: Bound = Bound::closed(0.0, MAX_LENGTH_MM, "mm");
const FRACTION: Bound = Bound::closed(MIN_SHARE, 1.0, "");
const EXPONENT: Bound = Bound::closed(MIN_FULLER_EXPONENT, 1.0, "");
const FACTOR: Bound = Bound::closed(0.0, 100.0, "");
const PASSING: Bound = Bound::closed(0.0, 1.0, "");
/// Mass fractions typed by hand (three thirds as 0.333) may miss 1 by this much.
const SUM_TOLERANCE: f64 = 1.0e-9;

impl PackingRequest {
    /// Reads a request that holds nothing but the fields of a packing.
    ///
    /// `seed` is used when the document names none.
    ///
    /// ```
    /// use packstone_engine::PackingRequest;
    /// use serde_json::json;
    ///
    /// let mut document = json!({
    ///     "specimen": {"type": "box", "size_mm": [100, 100, 100]},
    ///     "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "volume_fraction": 0.6},
    ///     "distance": {"type": "constant", "gap_mm": 0.5},
    /// });
    /// let request = PackingRequest::from_json(&document, 7).expect("every field is within its bounds");
    /// assert_eq!((request.seed, request.mix.d_min_mm), (7, Some(2.0)));
    ///
    /// document["distance"]["gap_mm"] = json!(-1);
    /// let faults = PackingRequest::from_json(&document, 7).unwrap_err();
    /// assert_eq!(faults[0].pointer, "/distance/gap_mm");
    /// ```
    ///
    /// # Errors
    /// All faults of the document, each with its pointer.
    pub fn from_json(value: &Value, seed: u64) -> Result<Self, Vec<FieldError>> {
        let faults = Faults::default();
        let request = At::root(value, &faults).object().and_then(|mut object| {
            let request = Self::from_object(&mut object, seed);
            object.finish();
            request
        });
        match request {
            Some(request) if faults.count() == 0 => Ok(request),
            _ => Err(faults.into_vec()),
        }
    }

    /// Judges a request that was built in code by the bounds of one that is read from JSON.
    ///
    /// [`crate::pack`] calls it, so a request outside the bounds is refused whatever its origin.
    ///
    /// # Errors
    /// All faults, each with its pointer.
    pub fn validate(&self) -> Result<(), Vec<FieldError>> {
        let whole = |detail: String| vec![FieldError { pointer: String::new(), detail }];
        let value =
            serde_json::to_value(self).map_err(|error| whole(format!("has no JSON form: {error}")))?;
        let read = Self::from_json(&value, self.seed)?;
        if read == *self {
            return Ok(());
        }
        // JSON has no such numbers; and what is absent is read as its default.
        Err(whole("has a number that is not finite, or leaves out mix.d_min_mm, which has a default".into()))
    }

    /// Reads the packing's fields from an object that may hold others, which the caller asks for.
    ///
    /// `None` means that faults were reported; the reverse does not hold, so ask the faults.
    pub fn from_object(object: &mut Object<'_>, seed: u64) -> Option<Self> {
        let seed = match object.optional("seed") {
            Some(at) => at.integer(0, MAX_SEED as i64).map(|s| s as u64),
            None => Some(seed),
        };
        let specimen = object.required("specimen").and_then(|at| read_specimen(&at));
        let mix = object.required("mix").and_then(|at| read_mix(&at));
        let distance_at = object.optional("distance");
        let distance = match &distance_at {
            Some(at) => read_distance(at),
            None => Some(Distance::None { wall_gap_mm: None }),
        };
        let method_at = object.optional("method");
        let method = match &method_at {
            Some(at) => read_method(at),
            None => Some(Method::Auto {}),
        };
        let segregation_at = object.optional("segregation");
        let segregation = match &segregation_at {
            Some(at) => read_segregation(at, specimen.as_ref()),
            None => Some(Segregation::None {}),
        };
        if let Some(mix) = &mix {
            let has_shapes = mix.grain_shapes().is_some();
            let fault = match (&method_at, &method) {
                (Some(at), Some(Method::Edmd { .. })) if has_shapes => Some((
                    at,
                    "\"edmd\" packs spheres alone: must be \"monte_carlo\", \"rsa\" or \"auto\" for grains with a shape",
                )),
                (Some(at), Some(Method::MonteCarlo { .. })) if !has_shapes => Some((
                    at,
                    "\"monte_carlo\" packs grains with a shape: must be \"edmd\", \"rsa\" or \"auto\" for spheres",
                )),
                _ => None,
            };
            if let Some((at, detail)) = fault {
                // Where the fault is: no other field of the object would be right with this type.
                at.object()?.required("type")?.fault(detail);
                return None;
            }
        }
        if let (Some(at), Some(Distance::Maximize { .. }), Some(Method::Rsa { .. })) =
            (&distance_at, &distance, &method)
        {
            // Where the fault is: no other field of the distance would be right with this method.
            at.object()?.required("type")?.fault(
                "\"maximize\" needs grains that grow: the method must be \"edmd\", \"monte_carlo\" or \"auto\", not \"rsa\"",
            );
            return None;
        }
        Some(Self {
            seed: seed?,
            specimen: specimen?,
            mix: mix?,
            distance: distance?,
            method: method?,
            segregation: segregation?,
        })
    }
}

impl Specimen {
    /// Reads the specimen of a request that was accepted before.
    ///
    /// # Errors
    /// All faults of the document, each with its pointer.
    pub fn from_json(value: &Value) -> Result<Self, Vec<FieldError>> {
        let faults = Faults::default();
        read_specimen(&At::root(value, &faults)).ok_or_else(|| faults.into_vec())
    }
}

fn length(object: &mut Object<'_>, name: &'static str) -> Option<f64> {
    object.required(name)?.number(LENGTH)
}

fn read_specimen(at: &At<'_>) -> Option<Specimen> {
    #[derive(Clone, Copy)]
    enum Kind {
        Box,
        Cylinder,
    }
    let mut object = at.object()?;
    let specimen = match object.variant(&[("box", Kind::Box), ("cylinder", Kind::Cylinder)])? {
        Kind::Box => {
            let size = object.required("size_mm").and_then(|at| {
                let [x, y, z] = at.array_of()?.map(|at| at.number(LENGTH));
                Some([x?, y?, z?])
            });
            let boundary = match object.optional("boundary") {
                Some(at) => at.choice(&[("walls", Boundary::Walls), ("periodic", Boundary::Periodic)]),
                None => Some(Boundary::Walls),
            };
            size.zip(boundary).map(|(size_mm, boundary)| Specimen::Box { size_mm, boundary })
        }
        Kind::Cylinder => {
            let diameter = length(&mut object, "diameter_mm");
            let height = length(&mut object, "height_mm");
            diameter.zip(height).map(|(diameter_mm, height_mm)| Specimen::Cylinder { diameter_mm, height_mm })
        }
    };
    object.finish();
    specimen
}

fn read_mix(at: &At<'_>) -> Option<Mix> {
    let mut object = at.object()?;
    let grading_at = object.required("grading");
    let grading = grading_at.as_ref().and_then(read_grading);
    let d_min_at = object.optional("d_min_mm");
    let d_min = d_min_at.as_ref().and_then(|at| at.number(LENGTH));
    // By its name, for a list with a fault in it is a list too.
    let is_list = grading_at.as_ref().is_some_and(|at| at.value()["type"] == "diameters");
    let (volume_fraction, proportions) = read_amount(&mut object, is_list);
    let volume_fraction_of = match object.optional("volume_fraction_of") {
        Some(at) => {
            let volume_fraction_of = at.choice(&[
                ("all_aggregate", VolumeFractionOf::AllAggregate),
                ("placed_grains", VolumeFractionOf::PlacedGrains),
            ]);
            if volume_fraction_of == Some(VolumeFractionOf::PlacedGrains) && proportions.is_some() {
                at.fault("`proportions` count all aggregate, that below the cut-off too: must be \"all_aggregate\"");
            }
            volume_fraction_of
        }
        None => Some(VolumeFractionOf::AllAggregate),
    };
    let allow_coarse = match object.optional("allow_coarse") {
        Some(at) => at.boolean(),
        None => Some(false),
    };
    let shapes = read_shapes(&mut object);
    let size = match object.optional("size") {
        Some(at) => at.choice(&[("sieve", SizeMeasure::Sieve), ("equivalent", SizeMeasure::Equivalent)]),
        None => Some(SizeMeasure::default()),
    };
    object.finish();
    let (grading, grading_at) = (grading?, grading_at?);
    // An unreadable cut-off is reported already; the default would only add a second fault.
    if d_min_at.is_none() || d_min.is_some() {
        check_d_min(&grading, d_min, d_min_at.as_ref().unwrap_or(&grading_at))?;
    }
    let d_min_mm = match (&grading, d_min) {
        (Grading::Standard { .. } | Grading::Fuller { .. }, None) => Some(DEFAULT_D_MIN_MM),
        (_, given) => given,
    };
    let shapes = shapes?;
    Some(Mix {
        grading,
        d_min_mm,
        volume_fraction,
        proportions,
        volume_fraction_of: volume_fraction_of?,
        allow_coarse: allow_coarse?,
        shape: shapes.of_all,
        shapes: shapes.by_size,
        size: size?,
        orientation: shapes.orientation,
    })
}

/// The amount of aggregate: exactly one of its two forms, and none beside an explicit list.
fn read_amount(object: &mut Object<'_>, is_list: bool) -> (Option<f64>, Option<MixProportions>) {
    let content_at = object.optional("proportions");
    if is_list {
        for at in object.optional("volume_fraction").iter().chain(&content_at) {
            at.fault("an explicit list of diameters prescribes the volume: leave this field out");
        }
        return (None, None);
    }
    let Some(content_at) = content_at else {
        return (object.required("volume_fraction").and_then(|at| at.number(FRACTION)), None);
    };
    if object.optional("volume_fraction").is_some() {
        content_at.fault("the mix has a volume_fraction too: leave one of the two out");
        return (None, None);
    }
    (None, read_proportions(&content_at))
}

/// The cut-off must leave something to place, and must lie where the curve is known.
fn check_d_min(grading: &Grading, given: Option<f64>, at: &At<'_>) -> Option<()> {
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
fn described_range(grading: &Grading) -> (f64, f64) {
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

fn read_grading(at: &At<'_>) -> Option<Grading> {
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
    order.sort_by(|&i, &j| classes[i].d_min_mm.total_cmp(&classes[j].d_min_mm));
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
    classes.sort_by(|a, b| a.d_min_mm.total_cmp(&b.d_min_mm));
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

fn read_distance(at: &At<'_>) -> Option<Distance> {
    #[derive(Clone, Copy)]
    enum Kind {
        None,
        Constant,
        Proportional,
        SmallerDiameter,
        Maximize,
    }
    let mut object = at.object()?;
    let kind = object.variant(&[
        ("none", Kind::None),
        ("constant", Kind::Constant),
        ("proportional", Kind::Proportional),
        ("smaller_diameter", Kind::SmallerDiameter),
        ("maximize", Kind::Maximize),
    ])?;
    let size = match kind {
        Kind::None | Kind::Maximize => Some(0.0),
        Kind::Constant => object.required("gap_mm").and_then(|at| at.number(GAP)),
        Kind::Proportional | Kind::SmallerDiameter => {
            object.required("factor").and_then(|at| at.number(FACTOR))
        }
    };
    let wall_at = object.optional("wall_gap_mm");
    let wall_gap_mm = wall_at.as_ref().and_then(|at| at.number(GAP));
    object.finish();
    let size = size?;
    if wall_at.is_some() && wall_gap_mm.is_none() {
        return None;
    }
    Some(match kind {
        Kind::None => Distance::None { wall_gap_mm },
        Kind::Constant => Distance::Constant { gap_mm: size, wall_gap_mm },
        Kind::Proportional => Distance::Proportional { factor: size, wall_gap_mm },
        Kind::SmallerDiameter => Distance::SmallerDiameter { factor: size, wall_gap_mm },
        Kind::Maximize => Distance::Maximize { wall_gap_mm },
    })
}

fn read_method(at: &At<'_>) -> Option<Method> {
    #[derive(Clone, Copy)]
    enum Kind {
        Auto,
        Rsa,
        Edmd,
        MonteCarlo,
    }
    let mut object = at.object()?;
    let kind = object.variant(&[
        ("auto", Kind::Auto),
        ("rsa", Kind::Rsa),
        ("edmd", Kind::Edmd),
        ("monte_carlo", Kind::MonteCarlo),
    ])?;
    let method = match kind {
        Kind::Auto => Some(Method::Auto {}),
        Kind::Rsa => match object.optional("attempts_per_grain") {
            Some(at) => {
                at.integer(1, 1_000_000_000_000).map(|n| Method::Rsa { attempts_per_grain: Some(n as u64) })
            }
            None => Some(Method::Rsa { attempts_per_grain: None }),
        },
        Kind::Edmd => edmd::read_options(&mut object).map(|options| Method::Edmd { options }),
        Kind::MonteCarlo => monte_carlo::read_stop(&mut object).map(|stop| Method::MonteCarlo { stop }),
    };
    object.finish();
    method
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

#[cfg(test)]
#[path = "read_tests.rs"]
mod tests;
