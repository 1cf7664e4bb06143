//! What a request says about the shapes of grains and about their orientation.
//!
//! Types, bounds and JSON form only; the laws of the axis ratios are those of [`crate::shape::ratios`].

use serde::Serialize;

use super::decode::{At, Bound, Items, Object};
use super::presets::ShapePreset;
use super::{Axis, MAX_LENGTH_MM, MAX_SEED, Mix, MixPart};
use crate::shape::polyhedron::DrawnTemplates;
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

/// Most templates of all shapes of a mix, so that they are drawn and measured in a moment.
pub const MAX_TEMPLATES: u32 = 128;
/// Number of templates of a shape that names none.
pub const DEFAULT_TEMPLATES: u32 = 32;
/// Fewest half-spaces that cut a template.
pub const MIN_FACES: u32 = 6;
/// Most half-spaces that cut a template.
pub const MAX_FACES: u32 = 60;
const DEFAULT_FACES: u32 = 24;
const DEFAULT_DISPLACEMENT: f64 = 0.2;

/// Any number; its bounds are those of the law.
const ANY: Bound = Bound::closed(f64::MIN, f64::MAX, "");
const RATIO: Bound = Bound::closed(MIN_RATIO, 1.0, "");
const ABOVE: Bound = Bound::closed(0.0, MAX_LENGTH_MM, "mm");
/// Beyond it a cube may be crumpled to a sheet.
const DISPLACEMENT: Bound = Bound::closed(0.0, 0.4, "");
/// At 0.5 a grain would be a sphere.
const ROUNDING: Bound = Bound::closed(0.0, 0.4, "");
const SHARE: Bound = Bound::positive(1.0, "");
const CONCENTRATION: Bound = Bound::closed(-MAX_CONCENTRATION, MAX_CONCENTRATION, "");
/// Shares typed by hand (three thirds as 0.333) may miss 1 by this much.
const SUM_TOLERANCE: f64 = 2.0e-3;

/// The shape of the grains.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(untagged)]
pub enum GrainShape {
    /// Grains of one shape.
    Plain(PlainShape),
    /// Grains of several shapes.
    Mixture(ShapeMixture),
}

/// Grains of several shapes.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum ShapeMixture {
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
    #[cfg_attr(feature = "openapi", schema(value_type = super::schema::PlainShapeInput))]
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
        /// The preset that these ratios are of, where the request named one.
        #[cfg_attr(
            feature = "openapi",
            schema(required = false, nullable, value_type = super::schema::ShapePresetName)
        )]
        #[serde(skip_serializing_if = "Option::is_none")]
        preset: Option<&'static str>,
    },
    /// Angular grains: convex polyhedra. Each grain is one of some templates, in its own size.
    Polyhedron {
        /// How templates are made.
        #[cfg_attr(feature = "openapi", schema(default = "cuts", required = false))]
        template: TemplateShape,
        /// Half-spaces that cut a template out of a ball; of `cuts` alone, 24 when absent. Some of them may leave no
        /// face.
        #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 6, maximum = 60))]
        #[serde(skip_serializing_if = "Option::is_none")]
        faces: Option<u32>,
        /// How far the corners of a cube are displaced along each axis, at most, as a share of its edge; of
        /// `deformed_cuboid` alone, 0.2 when absent.
        #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0, maximum = 0.4))]
        #[serde(skip_serializing_if = "Option::is_none")]
        displacement: Option<f64>,
        /// The ratios by which templates are stretched, drawn for each template; 1 when absent. Laws with a target
        /// index are for ellipsoids alone.
        #[cfg_attr(
            feature = "openapi",
            schema(required = false, value_type = super::schema::AxisRatiosInput)
        )]
        ratios: AxisRatios,
        /// Radius by which edges and corners are rounded, over the equivalent diameter of the grain.
        #[cfg_attr(feature = "openapi", schema(default = 0, required = false, minimum = 0, maximum = 0.4))]
        rounding: f64,
        /// Number of templates; when absent 32, and 1 of a Platonic solid. All shapes of a mix have 128 at most.
        #[cfg_attr(feature = "openapi", schema(required = false, minimum = 1, maximum = 128))]
        template_count: u32,
        /// Seed of the templates, which do not depend on the seed of the job.
        #[cfg_attr(
            feature = "openapi",
            schema(default = 0, required = false, maximum = 9_007_199_254_740_991_u64)
        )]
        template_seed: u64,
        /// The templates, once they are drawn.
        #[serde(skip)]
        drawn: DrawnTemplates,
    },
}

/// How the templates of angular grains are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum TemplateShape {
    /// A ball cut by half-spaces at nearly equal distances from its centre.
    #[default]
    Cuts,
    /// The convex hull of the displaced corners of a cube (Titscher and Unger 2015, figure 12b).
    DeformedCuboid,
    /// A cell of a Poisson-Voronoi tessellation.
    Voronoi,
    /// The Platonic solid of four triangles.
    Tetrahedron,
    /// The Platonic solid of six squares.
    Cube,
    /// The Platonic solid of eight triangles.
    Octahedron,
    /// The Platonic solid of twelve pentagons.
    Dodecahedron,
    /// The Platonic solid of twenty triangles.
    Icosahedron,
}

impl TemplateShape {
    /// Whether every draw is the same body, but for the ratios by which it is stretched.
    #[must_use]
    pub fn is_platonic(self) -> bool {
        !matches!(self, Self::Cuts | Self::DeformedCuboid | Self::Voronoi)
    }
}

/// What the grains of a mix are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GrainKind {
    /// All grains are spheres.
    Spheres,
    /// Ellipsoids, spheres among them.
    Ellipsoids,
    /// Convex polyhedra, sharp or rounded.
    Polyhedra,
    /// Ellipsoids, spheres among them, and convex polyhedra.
    Mixed,
}

impl GrainKind {
    /// What they are called, in the plural.
    #[must_use]
    pub fn noun(self) -> &'static str {
        match self {
            Self::Spheres => "spheres",
            Self::Ellipsoids => "ellipsoids",
            Self::Polyhedra => "polyhedra",
            Self::Mixed => "ellipsoids and polyhedra",
        }
    }
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
    #[cfg_attr(feature = "openapi", schema(value_type = super::schema::GrainShapeInput))]
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
    /// What the grains are.
    #[must_use]
    pub fn kind(&self) -> GrainKind {
        match self {
            Self::Sphere {} => GrainKind::Spheres,
            Self::Ellipsoid { .. } => GrainKind::Ellipsoids,
            Self::Polyhedron { .. } => GrainKind::Polyhedra,
        }
    }

    /// Number of its templates.
    fn templates(&self) -> u32 {
        match self {
            Self::Polyhedron { template_count, .. } => *template_count,
            Self::Sphere {} | Self::Ellipsoid { .. } => 0,
        }
    }
}

impl GrainShape {
    /// Whether all grains are spheres.
    #[must_use]
    pub fn is_sphere(&self) -> bool {
        self.parts().iter().all(|(_, shape)| shape.kind() == GrainKind::Spheres)
    }

    /// Shares of the volume with their shapes.
    #[must_use]
    pub fn parts(&self) -> Vec<(f64, &PlainShape)> {
        match self {
            Self::Plain(shape) => vec![(1.0, shape)],
            Self::Mixture(ShapeMixture::Mixture { of }) => {
                of.iter().map(|part| (part.share, &part.shape)).collect()
            }
        }
    }
}

/// The shapes of a mix, or of one of its aggregates, as its fields say them.
#[derive(Default)]
pub(super) struct MixShapes {
    pub(super) of_all: Option<GrainShape>,
    pub(super) by_size: Vec<ShapeClass>,
}

/// Reads `shape` and `shapes` of a mix or of an aggregate.
///
/// `None` means that faults were reported.
pub(super) fn read_mix_shapes(object: &mut Object<'_>) -> Option<MixShapes> {
    let shape_at = object.optional("shape");
    let shape = shape_at.as_ref().map(read_shape);
    let by_size = match object.optional("shapes") {
        Some(at) if shape_at.is_some() => {
            at.fault("there is a shape for all sizes too: leave one of the two out");
            None
        }
        Some(at) => read_classes(&at),
        None => Some(Vec::new()),
    };
    let of_all = match shape {
        None => None,
        Some(read) => Some(read?),
    };
    Some(MixShapes { of_all, by_size: by_size? })
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

/// Judges the number of templates of all shapes of a mix.
pub(super) fn judge_templates(at: &At<'_>, mix: &Mix) -> Option<()> {
    let parts = mix.parts();
    let shapes = parts.iter().filter_map(MixPart::grain_shapes).flatten();
    let templates: u32 =
        shapes.flat_map(|(_, shape)| shape.parts()).map(|(_, shape)| shape.templates()).sum();
    if templates > MAX_TEMPLATES {
        at.fault(format!(
            "the shapes have {templates} templates together: must have at most {MAX_TEMPLATES}; lower template_count"
        ));
        return None;
    }
    Some(())
}

/// The kinds of shapes, by their names.
#[derive(Clone, Copy)]
enum Kind {
    Sphere,
    Ellipsoid,
    Polyhedron,
    Preset,
    Mixture,
}

const PLAIN: [(&str, Kind); 4] = [
    ("sphere", Kind::Sphere),
    ("ellipsoid", Kind::Ellipsoid),
    ("polyhedron", Kind::Polyhedron),
    ("preset", Kind::Preset),
];

fn read_shape(at: &At<'_>) -> Option<GrainShape> {
    let mut object = at.object()?;
    let [sphere, ellipsoid, polyhedron, preset] = PLAIN;
    let shape = match object.variant(&[sphere, ellipsoid, polyhedron, preset, ("mixture", Kind::Mixture)])? {
        Kind::Mixture => object
            .required("of")
            .and_then(|at| read_mixture(&at))
            .map(|of| GrainShape::Mixture(ShapeMixture::Mixture { of })),
        plain => read_plain_fields(plain, &mut object).map(GrainShape::Plain),
    };
    object.finish();
    shape
}

fn read_plain(at: &At<'_>) -> Option<PlainShape> {
    let mut object = at.object()?;
    let kind = object.variant(&PLAIN)?;
    let shape = read_plain_fields(kind, &mut object);
    object.finish();
    shape
}

fn read_plain_fields(kind: Kind, object: &mut Object<'_>) -> Option<PlainShape> {
    match kind {
        Kind::Ellipsoid => read_ellipsoid(object),
        Kind::Polyhedron => read_polyhedron(object),
        Kind::Preset => object.required("name").and_then(|at| read_preset(&at)).map(ShapePreset::shape),
        Kind::Sphere | Kind::Mixture => Some(PlainShape::Sphere {}),
    }
}

/// Reads an ellipsoid, with the preset that a stored request names beside its law.
fn read_ellipsoid(object: &mut Object<'_>) -> Option<PlainShape> {
    let ratios = object.required("ratios").and_then(|at| read_ratios(&at));
    let preset_at = object.optional("preset");
    let preset = match &preset_at {
        Some(at) => read_preset(at).map(Some),
        None => Some(None),
    };
    let (ratios, preset) = (ratios?, preset?);
    if let (Some(at), Some(preset)) = (&preset_at, preset)
        && preset.ratios() != ratios
    {
        at.fault(format!("the ratios are not those of the preset {:?}: leave it out", preset.name));
        return None;
    }
    Some(PlainShape::Ellipsoid { ratios, preset: preset.map(|preset| preset.name) })
}

fn read_preset(at: &At<'_>) -> Option<&'static ShapePreset> {
    at.choice(&ShapePreset::ALL.map(|preset| (preset.name, preset.name))).and_then(ShapePreset::of_name)
}

fn read_polyhedron(object: &mut Object<'_>) -> Option<PlainShape> {
    let template = match object.optional("template") {
        None => Some(TemplateShape::Cuts),
        Some(at) => at.choice(&[
            ("cuts", TemplateShape::Cuts),
            ("deformed_cuboid", TemplateShape::DeformedCuboid),
            ("voronoi", TemplateShape::Voronoi),
            ("tetrahedron", TemplateShape::Tetrahedron),
            ("cube", TemplateShape::Cube),
            ("octahedron", TemplateShape::Octahedron),
            ("dodecahedron", TemplateShape::Dodecahedron),
            ("icosahedron", TemplateShape::Icosahedron),
        ]),
    };
    let only_of = |at: &At<'_>, name: &str| -> Option<()> {
        at.fault(format!("is a field of the template {name:?} alone: leave it out"));
        None
    };
    // Where the template is in doubt, its fields are judged by their bounds all the same.
    let faces = match object.optional("faces") {
        Some(at) if template.is_some_and(|template| template != TemplateShape::Cuts) => {
            only_of(&at, "cuts").map(|()| None)
        }
        Some(at) => at.integer(MIN_FACES.into(), MAX_FACES.into()).map(|faces| Some(faces as u32)),
        None => Some((template == Some(TemplateShape::Cuts)).then_some(DEFAULT_FACES)),
    };
    let displacement = match object.optional("displacement") {
        Some(at) if template.is_some_and(|template| template != TemplateShape::DeformedCuboid) => {
            only_of(&at, "deformed_cuboid").map(|()| None)
        }
        Some(at) => at.number(DISPLACEMENT).map(Some),
        None => Some((template == Some(TemplateShape::DeformedCuboid)).then_some(DEFAULT_DISPLACEMENT)),
    };
    let ratios = match object.optional("ratios") {
        Some(at) => read_template_ratios(&at),
        None => Some(AxisRatios::Constant { elongation: 1.0, flatness: 1.0 }),
    };
    let rounding = match object.optional("rounding") {
        Some(at) => at.number(ROUNDING),
        None => Some(0.0),
    };
    let count = match object.optional("template_count") {
        Some(at) => at.integer(1, MAX_TEMPLATES.into()).map(|count| count as u32),
        None if template.is_some_and(TemplateShape::is_platonic) => Some(1),
        None => Some(DEFAULT_TEMPLATES),
    };
    let seed = match object.optional("template_seed") {
        Some(at) => at.integer(0, MAX_SEED as i64).map(|seed| seed as u64),
        None => Some(0),
    };
    Some(PlainShape::Polyhedron {
        template: template?,
        faces: faces?,
        displacement: displacement?,
        ratios: ratios?,
        rounding: rounding?,
        template_count: count?,
        template_seed: seed?,
        drawn: DrawnTemplates::default(),
    })
}

/// Reads the law by which templates are stretched.
fn read_template_ratios(at: &At<'_>) -> Option<AxisRatios> {
    if let Some(name @ ("flakiness" | "shape_index")) = at.value().get("type").and_then(|name| name.as_str())
    {
        at.fault_below(
            "/type",
            format!(
                "{name:?} is a law of ellipsoids alone: must be one of \"constant\", \"independent\", \"triangle\", \
                 \"measured\" for polyhedra, whose flakiness index and shape index the result reports"
            ),
        );
        return None;
    }
    read_ratios(at)
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
        at.fault(format!("the shares sum to {}: must sum to 1", rounded(sum)));
        return None;
    }
    Some(parts)
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

/// Reads how grains are oriented.
pub(super) fn read_orientation(at: &At<'_>) -> Option<Orientation> {
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

/// A sum of numbers typed by hand, without the digits that rounding leaves.
pub(super) fn rounded(sum: f64) -> f64 {
    (sum * 1.0e9).round() / 1.0e9
}

/// All of the values, or none after each was read: every fault is to be reported.
pub(super) fn all<T>(values: impl Iterator<Item = Option<T>>) -> Option<Vec<T>> {
    let values: Vec<Option<T>> = values.collect();
    values.into_iter().collect()
}

/// The items of an array of 1 to `max`.
pub(super) fn bounded<'a>(at: &At<'a>, what: &str, max: usize) -> Option<Items<'a>> {
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
