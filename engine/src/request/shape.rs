//! What a request says about the shapes of grains and about their orientation.
//!
//! Types, bounds and JSON form only; the laws of the axis ratios are those of [`crate::shape::ratios`].

use serde::Serialize;

use super::decode::{At, Bound, Items, Object};
use super::{Axis, MAX_LENGTH_MM};
use crate::shape::ratios::{
    AxisRatios, DEFAULT_TARGET_ELONGATION, MAX_MEASURED_GRAINS, MAX_TABLE_VALUES, MIN_RATIO,
    RatioDistribution, RatioLaw,
};

/// Most size classes with a shape of their own.
pub const MAX_SHAPE_CLASSES: usize = 16;
/// Most parts of a mixture of shapes.
pub const MAX_MIXTURE_PARTS: usize = 16;
/// Largest concentration of orientations about an axis, and largest away from it: axes then lie within some 6 degrees
/// of the axis or of the plane across it.
pub const MAX_CONCENTRATION: f64 = 100.0;

/// Any number; its bounds are those of the law.
const ANY: Bound = Bound::closed(f64::MIN, f64::MAX, "");
const RATIO: Bound = Bound::closed(MIN_RATIO, 1.0, "");
const ABOVE: Bound = Bound::closed(0.0, MAX_LENGTH_MM, "mm");
const SHARE: Bound = Bound::positive(1.0, "");
const CONCENTRATION: Bound = Bound::closed(-MAX_CONCENTRATION, MAX_CONCENTRATION, "");
/// Shares typed by hand (three thirds as 0.333) may miss 1 by this much.
const SUM_TOLERANCE: f64 = 2.0e-3;

/// The shape of the grains.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum GrainShape {
    /// Spheres.
    Sphere {},
    /// Ellipsoids with axes `a >= b >= c`.
    Ellipsoid {
        /// How the ratios of the axes are distributed.
        #[cfg_attr(feature = "openapi", schema(value_type = super::schema::AxisRatiosInput))]
        ratios: AxisRatios,
    },
    /// Grains of several shapes.
    Mixture {
        /// The shapes with their shares of the volume.
        #[cfg_attr(feature = "openapi", schema(min_items = 1, max_items = 16))]
        of: Vec<MixturePart>,
    },
}

/// A shape of a mixture.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct MixturePart {
    /// Share of the volume of the grains; the shares of a mixture sum to 1.
    #[cfg_attr(feature = "openapi", schema(exclusive_minimum = 0, maximum = 1))]
    pub share: f64,
    /// The shape.
    pub shape: PlainShape,
}

/// A shape that is no mixture.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum PlainShape {
    /// Spheres.
    Sphere {},
    /// Ellipsoids with axes `a >= b >= c`.
    Ellipsoid {
        /// How the ratios of the axes are distributed.
        #[cfg_attr(feature = "openapi", schema(value_type = super::schema::AxisRatiosInput))]
        ratios: AxisRatios,
    },
}

/// The shape of the grains above a size.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct ShapeClass {
    /// The size above which grains have this shape, up to the next class. The smallest of all classes is 0.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1e6))]
    pub above_mm: f64,
    /// The shape.
    pub shape: GrainShape,
}

/// How grains that are no spheres are oriented before a method moves them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Orientation {
    /// All orientations are equally likely.
    Uniform {},
    /// The short axis `n` of a grain has the density `exp(concentration (n . axis)²)` over the sphere (Dimroth-Watson),
    /// and the grain any turn about it. Flat grains in concrete that is cast along z lie flat: axis z and a
    /// concentration above 0.
    Axis {
        /// The axis of the specimen.
        axis: Axis,
        /// 0 is uniform; short axes gather about the axis above 0, about the plane across it below 0.
        #[cfg_attr(feature = "openapi", schema(minimum = -100, maximum = 100))]
        concentration: f64,
    },
}

impl Default for Orientation {
    fn default() -> Self {
        Self::Uniform {}
    }
}

impl Orientation {
    /// Whether all orientations are equally likely.
    #[allow(clippy::trivially_copy_pass_by_ref)] // Serde hands over a reference.
    #[must_use]
    pub fn is_uniform(&self) -> bool {
        matches!(self, Self::Uniform {})
    }
}

impl PlainShape {
    /// The law of the axis ratios; `None` for spheres.
    #[must_use]
    pub fn ratios(&self) -> Option<&AxisRatios> {
        match self {
            Self::Sphere {} => None,
            Self::Ellipsoid { ratios } => Some(ratios),
        }
    }
}

impl GrainShape {
    /// Whether all grains are spheres.
    #[must_use]
    pub fn is_sphere(&self) -> bool {
        self.parts().iter().all(|(_, ratios)| ratios.is_none())
    }

    /// Shares of the volume with the laws of the axis ratios; `None` for spheres.
    #[must_use]
    pub fn parts(&self) -> Vec<(f64, Option<&AxisRatios>)> {
        match self {
            Self::Sphere {} => vec![(1.0, None)],
            Self::Ellipsoid { ratios } => vec![(1.0, Some(ratios))],
            Self::Mixture { of } => of.iter().map(|part| (part.share, part.shape.ratios())).collect(),
        }
    }
}

/// The shapes of a mix as its fields say them.
pub(super) struct ShapeFields {
    pub(super) of_all: Option<GrainShape>,
    pub(super) by_size: Vec<ShapeClass>,
    pub(super) orientation: Orientation,
}

/// Reads `shape`, `shapes` and `orientation` of a mix.
///
/// `None` means that faults were reported.
pub(super) fn read_shapes(mix: &mut Object<'_>) -> Option<ShapeFields> {
    let shape_at = mix.optional("shape");
    let shape = shape_at.as_ref().map(read_shape);
    let shapes = match mix.optional("shapes") {
        Some(at) if shape_at.is_some() => {
            at.fault("the mix has a shape for all sizes too: leave one of the two out");
            None
        }
        Some(at) => read_classes(&at),
        None => Some(Vec::new()),
    };
    let orientation_at = mix.optional("orientation");
    let orientation = match &orientation_at {
        Some(at) => read_orientation(at),
        None => Some(Orientation::default()),
    };
    let shape = match shape {
        None => None,
        Some(read) => Some(read?),
    };
    let (shapes, orientation) = (shapes?, orientation?);
    let are_spheres = shape.as_ref().is_none_or(GrainShape::is_sphere)
        && shapes.iter().all(|class| class.shape.is_sphere());
    if let (true, false, Some(at)) = (are_spheres, orientation.is_uniform(), &orientation_at) {
        at.fault("spheres have no orientation: must be \"uniform\", or the mix must have a shape");
        return None;
    }
    Some(ShapeFields { of_all: shape, by_size: shapes, orientation })
}

fn read_classes(at: &At<'_>) -> Option<Vec<ShapeClass>> {
    let items = bounded(at, "classes", MAX_SHAPE_CLASSES)?;
    let mut classes: Vec<ShapeClass> = Vec::with_capacity(items.len());
    for item in items.iter() {
        let mut object = item.object()?;
        let above = object.required("above_mm").and_then(|at| at.number(ABOVE));
        let shape = object.required("shape").and_then(|at| read_shape(&at));
        object.finish();
        let class = ShapeClass { above_mm: above?, shape: shape? };
        if classes.iter().any(|other| other.above_mm == class.above_mm) {
            item.fault(format!("above_mm {} is that of another class: must differ", class.above_mm));
            return None;
        }
        classes.push(class);
    }
    classes.sort_by(|p, q| q.above_mm.total_cmp(&p.above_mm));
    let least = classes.last()?.above_mm;
    if least > 0.0 {
        at.fault(format!("grains up to {least} mm have no shape: the above_mm of one class must be 0"));
        return None;
    }
    Some(classes)
}

/// The kinds of shapes, by their names.
#[derive(Clone, Copy)]
enum Kind {
    Sphere,
    Ellipsoid,
    Mixture,
}

/// Reads the kind of a shape; those to come are refused by name.
fn read_kind(object: &mut Object<'_>, kinds: &[(&str, Kind)]) -> Option<Kind> {
    let at = object.required("type")?;
    if at.value() == "polyhedron" {
        let names: Vec<String> = kinds.iter().map(|(name, _)| format!("{name:?}")).collect();
        at.fault(format!("polyhedra are not available yet: must be one of {}", names.join(", ")));
        return None;
    }
    at.choice(kinds)
}

const PLAIN: [(&str, Kind); 2] = [("sphere", Kind::Sphere), ("ellipsoid", Kind::Ellipsoid)];

fn read_shape(at: &At<'_>) -> Option<GrainShape> {
    let mut object = at.object()?;
    let [sphere, ellipsoid] = PLAIN;
    let shape = match read_kind(&mut object, &[sphere, ellipsoid, ("mixture", Kind::Mixture)])? {
        Kind::Sphere => Some(GrainShape::Sphere {}),
        Kind::Ellipsoid => object
            .required("ratios")
            .and_then(|at| read_ratios(&at))
            .map(|ratios| GrainShape::Ellipsoid { ratios }),
        Kind::Mixture => {
            object.required("of").and_then(|at| read_mixture(&at)).map(|of| GrainShape::Mixture { of })
        }
    };
    object.finish();
    shape
}

fn read_mixture(at: &At<'_>) -> Option<Vec<MixturePart>> {
    let items = bounded(at, "shapes", MAX_MIXTURE_PARTS)?;
    let parts = all(items.iter().map(|item| {
        let mut object = item.object()?;
        let share = object.required("share").and_then(|at| at.number(SHARE));
        let shape = object.required("shape").and_then(|at| read_plain(&at));
        object.finish();
        Some(MixturePart { share: share?, shape: shape? })
    }))?;
    let sum: f64 = parts.iter().map(|part| part.share).sum();
    if (sum - 1.0).abs() > SUM_TOLERANCE {
        at.fault(format!("the shares sum to {sum}: must sum to 1"));
        return None;
    }
    Some(parts)
}

fn read_plain(at: &At<'_>) -> Option<PlainShape> {
    let mut object = at.object()?;
    let shape = match read_kind(&mut object, &PLAIN)? {
        Kind::Ellipsoid => object
            .required("ratios")
            .and_then(|at| read_ratios(&at))
            .map(|ratios| PlainShape::Ellipsoid { ratios }),
        _ => Some(PlainShape::Sphere {}),
    };
    object.finish();
    shape
}

/// Reads the law of the axis ratios, whose numbers are judged together at the end.
fn read_ratios(at: &At<'_>) -> Option<AxisRatios> {
    #[derive(Clone, Copy)]
    enum Kind {
        Constant,
        Independent,
        Triangle,
        Measured,
        Flakiness,
        ShapeIndex,
    }
    let mut object = at.object()?;
    let kind = object.variant(&[
        ("constant", Kind::Constant),
        ("independent", Kind::Independent),
        ("triangle", Kind::Triangle),
        ("measured", Kind::Measured),
        ("flakiness", Kind::Flakiness),
        ("shape_index", Kind::ShapeIndex),
    ])?;
    let ratios =
        match kind {
            Kind::Constant => read_constant(&mut object),
            Kind::Independent => {
                let elongation = object.required("elongation").and_then(|at| read_law(&at));
                let flatness = object.required("flatness").and_then(|at| read_law(&at));
                elongation
                    .zip(flatness)
                    .map(|(elongation, flatness)| AxisRatios::Independent { elongation, flatness })
            }
            Kind::Triangle => number(&mut object, "k").map(|k| AxisRatios::Triangle { k }),
            Kind::Measured => {
                let axes = object.required("axes").and_then(|at| {
                    let triples = bounded(&at, "triples", MAX_MEASURED_GRAINS)?;
                    all(triples.iter().map(|item| {
                        let [a, b, c] = item.array_of()?.map(|at| at.number(ANY));
                        Some([a?, b?, c?])
                    }))
                });
                let weights = read_weights(&mut object, MAX_MEASURED_GRAINS);
                axes.zip(weights).map(|(axes, weights)| AxisRatios::Measured { axes, weights })
            }
            Kind::Flakiness => read_target(&mut object)
                .map(|(index, elongation)| AxisRatios::Flakiness { index, elongation }),
            Kind::ShapeIndex => read_target(&mut object)
                .map(|(index, elongation)| AxisRatios::ShapeIndex { index, elongation }),
        };
    object.finish();
    let ratios = ratios?;
    match ratios.validate() {
        Ok(()) => Some(ratios),
        Err(faults) => {
            for fault in faults {
                at.fault_below(&fault.field, fault.detail);
            }
            None
        }
    }
}

/// Constant ratios by `elongation` and `flatness`, or by `b_over_a` and `c_over_a`.
fn read_constant(object: &mut Object<'_>) -> Option<AxisRatios> {
    let b_at = object.optional("b_over_a");
    let c_at = object.optional("c_over_a");
    if b_at.is_none() && c_at.is_none() {
        let (elongation, flatness) = (number(object, "elongation"), number(object, "flatness"));
        return Some(AxisRatios::Constant { elongation: elongation?, flatness: flatness? });
    }
    for name in ["elongation", "flatness"] {
        if let Some(at) = object.optional(name) {
            at.fault("the ratios are given by b_over_a and c_over_a too: leave one of the two pairs out");
            return None;
        }
    }
    let b = object.required("b_over_a").and_then(|at| at.number(RATIO));
    let c = object.required("c_over_a").and_then(|at| at.number(RATIO));
    let (b, c) = (b?, c?);
    if c > b {
        c_at?.fault(format!("{c} is out of range: must be at most b_over_a {b}"));
        return None;
    }
    Some(AxisRatios::Constant { elongation: b, flatness: c / b })
}

fn read_target(object: &mut Object<'_>) -> Option<(f64, RatioLaw)> {
    let index = number(object, "index");
    let elongation = match object.optional("elongation") {
        Some(at) => read_law(&at),
        None => Some(DEFAULT_TARGET_ELONGATION),
    };
    index.zip(elongation)
}

/// Reads the law of one ratio: a number or a distribution.
fn read_law(at: &At<'_>) -> Option<RatioLaw> {
    #[derive(Clone, Copy)]
    enum Kind {
        Uniform,
        Beta,
        Table,
    }
    if at.value().is_number() {
        return at.number(ANY).map(RatioLaw::Constant);
    }
    if !at.value().is_object() {
        at.fault("must be a number, or an object with the type \"uniform\", \"beta\" or \"table\"");
        return None;
    }
    let mut object = at.object()?;
    let kind = object.variant(&[("uniform", Kind::Uniform), ("beta", Kind::Beta), ("table", Kind::Table)])?;
    let law = match kind {
        Kind::Uniform => {
            let (min, max) = (number(&mut object, "min"), number(&mut object, "max"));
            min.zip(max).map(|(min, max)| RatioDistribution::Uniform { min, max })
        }
        Kind::Beta => {
            let (mean, deviation) = (number(&mut object, "mean"), number(&mut object, "standard_deviation"));
            mean.zip(deviation)
                .map(|(mean, standard_deviation)| RatioDistribution::Beta { mean, standard_deviation })
        }
        Kind::Table => {
            let values =
                object.required("values").and_then(|at| read_numbers(&at, "values", MAX_TABLE_VALUES));
            let weights = read_weights(&mut object, MAX_TABLE_VALUES);
            values.zip(weights).map(|(values, weights)| RatioDistribution::Table { values, weights })
        }
    };
    object.finish();
    law.map(RatioLaw::Distributed)
}

fn read_orientation(at: &At<'_>) -> Option<Orientation> {
    #[derive(Clone, Copy)]
    enum Kind {
        Uniform,
        Axis,
    }
    let mut object = at.object()?;
    let orientation = match object.variant(&[("uniform", Kind::Uniform), ("axis", Kind::Axis)])? {
        Kind::Uniform => Some(Orientation::Uniform {}),
        Kind::Axis => {
            let axis =
                object.required("axis").and_then(|at| at.choice(&Axis::ALL.map(|axis| (axis.name(), axis))));
            let concentration = object.required("concentration").and_then(|at| at.number(CONCENTRATION));
            axis.zip(concentration).map(|(axis, concentration)| Orientation::Axis { axis, concentration })
        }
    };
    object.finish();
    orientation
}

fn number(object: &mut Object<'_>, name: &'static str) -> Option<f64> {
    object.required(name)?.number(ANY)
}

/// Weights; none where the field is absent.
fn read_weights(object: &mut Object<'_>, max: usize) -> Option<Vec<f64>> {
    match object.optional("weights") {
        Some(at) => read_numbers(&at, "weights", max),
        None => Some(Vec::new()),
    }
}

fn read_numbers(at: &At<'_>, what: &str, max: usize) -> Option<Vec<f64>> {
    all(bounded(at, what, max)?.iter().map(|item| item.number(ANY)))
}

/// All of the values, or none after each was read: every fault is to be reported.
fn all<T>(values: impl Iterator<Item = Option<T>>) -> Option<Vec<T>> {
    let values: Vec<Option<T>> = values.collect();
    values.into_iter().collect()
}

/// The items of an array of 1 to `max`.
fn bounded<'a>(at: &At<'a>, what: &str, max: usize) -> Option<Items<'a>> {
    let items = at.array()?;
    if items.is_empty() {
        at.fault(format!("has 0 {what}: must have at least 1"));
        return None;
    }
    if items.len() > max {
        at.fault(format!("has {} {what}: must have at most {max}", items.len()));
        return None;
    }
    Some(items)
}

#[cfg(test)]
#[path = "shape_tests.rs"]
mod tests;
