//! Reads the shapes of grains and their orientation.

use super::presets::ShapePreset;
use super::ratios::read_ratios;
use super::{
    DEFAULT_TEMPLATES, GrainShape, MAX_CONCENTRATION, MAX_FACES, MAX_MIXTURE_PARTS, MAX_SHAPE_CLASSES,
    MAX_TEMPLATES, MIN_FACES, MixturePart, Orientation, PlainShape, ShapeClass, ShapeMixture, TemplateShape,
};
use crate::request::decode::{At, Bound, Object, all, bounded, rounded};
use crate::request::{Axis, MAX_LENGTH_MM, MAX_SEED};
use crate::shape::polyhedron::DrawnTemplates;
use crate::shape::ratios::AxisRatios;
use crate::sorting;

const DEFAULT_FACES: u32 = 24;
const DEFAULT_DISPLACEMENT: f64 = 0.2;

const ABOVE: Bound = Bound::closed(0.0, MAX_LENGTH_MM, "mm");
/// Beyond it a cube may be crumpled to a sheet.
const DISPLACEMENT: Bound = Bound::closed(0.0, 0.4, "");
/// At 0.5 a grain would be a sphere.
const ROUNDING: Bound = Bound::closed(0.0, 0.4, "");
const SHARE: Bound = Bound::positive(1.0, "");
const CONCENTRATION: Bound = Bound::closed(-MAX_CONCENTRATION, MAX_CONCENTRATION, "");
/// Shares typed by hand (three thirds as 0.333) may miss 1 by this much.
const SUM_TOLERANCE: f64 = 2.0e-3;

/// The shapes of a mix, or of one of its aggregates, as its fields say them.
#[derive(Default)]
pub(in crate::request) struct MixShapes {
    pub(in crate::request) of_all: Option<GrainShape>,
    pub(in crate::request) by_size: Vec<ShapeClass>,
}

/// Reads `shape` and `shapes` of a mix or of an aggregate.
///
/// `None` means that faults were reported.
pub(in crate::request) fn read_mix_shapes(object: &mut Object<'_>) -> Option<MixShapes> {
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
    sorting::by_number(&mut classes, |class| -class.above_mm);
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

/// Reads how grains are oriented.
pub(in crate::request) fn read_orientation(at: &At<'_>) -> Option<Orientation> {
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
