//! Schemas of requests that no derive makes: arrays whose items are bounded, and fields with a second spelling.

use serde_json::json;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{
    Array, ArrayBuilder, ArrayItems, Object, ObjectBuilder, OneOfBuilder, Schema, SchemaType, Type,
};

use super::{
    Aggregate, Grading, GrainShape, MAX_LENGTH_MM, MAXIMIZE, MIN_LENGTH_MM, MIN_SHARE, PlainShape,
    ShapeClass, standard,
};
use crate::shape::AxisRatios;

/// A length in mm.
fn length() -> RefOr<Schema> {
    let number = ObjectBuilder::new().schema_type(Type::Number);
    Schema::from(number.minimum(Some(MIN_LENGTH_MM)).maximum(Some(MAX_LENGTH_MM)).build()).into()
}

/// A volume fraction, or the word for the largest one.
pub(crate) fn volume_fraction() -> Schema {
    let number = ObjectBuilder::new()
        .schema_type(SchemaType::from_iter([Type::Number, Type::Null]))
        .minimum(Some(MIN_SHARE))
        .maximum(Some(1));
    let word = ObjectBuilder::new().schema_type(Type::String).enum_values(Some([MAXIMIZE]));
    let either = OneOfBuilder::new()
        .item(number)
        .item(word)
        .description(Some(
            "Volume of the aggregate over that of the specimen, or `\"maximize\"`: as dense as these grains get, with \
             their distances kept. Numbers of grains are drawn for the volume fraction that growth is expected to \
             reach, then all sizes are scaled by one factor, `summary.size_scale` of the result; `method.stop` bounds \
             the run and is its normal end. This, `count` or `proportions` is required, except for the grading \
             `diameters`, which prescribes the volume unless this is `\"maximize\"`.",
        ))
        .build();
    Schema::OneOf(either)
}

/// The edge lengths of a box.
pub(crate) fn size_mm() -> Array {
    ArrayBuilder::new()
        .items(length())
        .min_items(Some(3))
        .max_items(Some(3))
        .description(Some("Edge lengths in x, y, z."))
        .examples([json!([150.0, 150.0, 150.0])])
        .build()
}

/// The names of all gradings of standards.
pub(crate) fn standard_name() -> Object {
    let mut names: Vec<&str> = standard::GRADINGS.iter().map(|grading| grading.name).collect();
    names.sort_unstable();
    names.dedup();
    ObjectBuilder::new()
        .schema_type(Type::String)
        .enum_values(Some(names))
        .description(Some(
            "The name of the grading in the standard; `GET /v1/capabilities` lists them by standard.",
        ))
        .build()
}

/// The points of a grading curve by sieves.
pub(crate) fn points() -> Array {
    let passing = ObjectBuilder::new().schema_type(Type::Number).minimum(Some(0)).maximum(Some(100)).build();
    let point = ArrayBuilder::new()
        .prefix_items([length(), Schema::from(passing).into()])
        .items(ArrayItems::False)
        .min_items(Some(2))
        .max_items(Some(2))
        .build();
    ArrayBuilder::new()
        .items(RefOr::from(Schema::from(point)))
        .min_items(Some(2))
        .max_items(Some(1000))
        .description(Some(
            "The points of the curve, at least two, in any order: sieve in mm, and the share of the mass that passes \
             it, from 0 to 1; in percent where one is above 1 and the values up to 1 cannot be fractions.",
        ))
        .examples([json!([[2.0, 0.0], [8.0, 0.6], [16.0, 1.0]])])
        .build()
}

/// An explicit list of diameters.
pub(crate) fn diameters_mm() -> Schema {
    let list = ArrayBuilder::new().items(length()).min_items(Some(1)).build();
    let either = OneOfBuilder::new()
        .item(list)
        .item(length())
        .description(Some("Diameter of every grain, in any order; or that of the only one."))
        .examples([json!([12.0, 10.0, 8.0])])
        .build();
    Schema::OneOf(either)
}

/// A list, or the one element that stands in place of a list of one, as MATLAB and R write it.
#[derive(serde::Serialize, utoipa::ToSchema)]
#[serde(untagged)]
#[allow(dead_code)]
pub(crate) enum OneOrMore<T> {
    /// A list.
    List(Vec<T>),
    /// Its one element.
    One(T),
}

/// What a blend is to meet: a curve, or a band.
#[derive(serde::Serialize, utoipa::ToSchema)]
#[serde(untagged)]
#[allow(dead_code)]
pub(crate) enum TargetInput {
    /// A curve: any grading but `diameters`.
    Curve(Grading),
    /// A band by its limits.
    Band(BandInput),
    /// The band of a grading of a standard.
    StandardBand(StandardBandInput),
}

/// The limits of a band.
#[derive(serde::Serialize, utoipa::ToSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
#[allow(dead_code)]
pub(crate) enum BandInput {
    /// A band.
    Band {
        /// `[sieve in mm, least, most]` in any order, all from 0 to 1 or all in percent; between them the limits are
        /// linear in the logarithm of the diameter.
        #[schema(schema_with = limits)]
        points: Vec<[f64; 3]>,
    },
}

/// The band of a grading of a standard.
#[derive(serde::Serialize, utoipa::ToSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
#[allow(dead_code)]
pub(crate) enum StandardBandInput {
    /// A band.
    Band {
        /// The standard.
        #[schema(default = "DIN 1045-2", required = false)]
        standard: standard::Standard,
        /// The name of the grading in it, which must not be one curve.
        #[schema(schema_with = standard_name)]
        name: String,
    },
}

/// The limits of a band by sieves.
fn limits() -> Array {
    let passing = || {
        let number = ObjectBuilder::new().schema_type(Type::Number).minimum(Some(0)).maximum(Some(100));
        RefOr::from(Schema::from(number.build()))
    };
    let point = ArrayBuilder::new()
        .prefix_items([length(), passing(), passing()])
        .items(ArrayItems::False)
        .min_items(Some(3))
        .max_items(Some(3))
        .build();
    ArrayBuilder::new()
        .items(RefOr::from(Schema::from(point)))
        .min_items(Some(1))
        .max_items(Some(1000))
        .examples([json!([[0.5, 0.08, 0.20], [2.0, 0.21, 0.42], [8.0, 0.60, 0.76]])])
        .build()
}

/// An aggregate by its share of the volume, or by its mass in a cubic metre of concrete: all of a mix alike.
#[derive(serde::Serialize, utoipa::ToSchema)]
#[serde(untagged)]
#[allow(dead_code)]
pub(crate) enum AggregateInput {
    /// As results have it.
    ByShare(Aggregate),
    /// By mass.
    ByMass(AggregateByMass),
}

/// An aggregate by its mass in a cubic metre of concrete. The shares and the volume fraction of the mix follow from the
/// masses and the densities, so that `volume_fraction` must be absent. Beside `proportions` the air is what all parts
/// leave, and `aggregate_cement` must be absent.
#[derive(serde::Serialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[allow(dead_code)]
pub(crate) struct AggregateByMass {
    /// What it is called in results; no two aggregates of a mix share a name.
    #[schema(required = false, nullable, min_length = 1, max_length = 64)]
    name: Option<String>,
    /// Mass of it in a cubic metre of concrete, that below the cut-off too.
    #[schema(exclusive_minimum = 0, maximum = 10_000)]
    mass_kg_m3: f64,
    /// Density of the grains.
    #[schema(minimum = 100, maximum = 30_000)]
    density_kg_m3: f64,
    /// Which diameters, in which proportion by mass; all but `diameters`.
    grading: Grading,
    /// Cut-off of this aggregate; that of the mix when absent.
    #[schema(required = false, nullable, minimum = 1e-6, maximum = 1e6)]
    d_min_mm: Option<f64>,
    /// The shape of all its grains; spheres when absent.
    #[schema(required = false, value_type = GrainShapeInput)]
    shape: Option<GrainShape>,
    /// The shapes by size, in place of `shape`.
    #[schema(required = false, value_type = OneOrMore<ShapeClass>)]
    shapes: Vec<ShapeClass>,
}

/// The law of the axis ratios of grains; results name constant ratios by elongation and flatness.
#[derive(serde::Serialize, utoipa::ToSchema)]
#[serde(untagged)]
#[allow(dead_code)] // A schema only: the fields are read by hand.
pub(crate) enum AxisRatiosInput {
    /// As results have it.
    Law(AxisRatios),
    /// Constant ratios by the axes.
    ByAxes(ConstantByAxes),
}

/// Constant ratios of the axes `a >= b >= c`, another spelling of elongation and flatness.
#[derive(serde::Serialize, utoipa::ToSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
#[allow(dead_code)]
pub(crate) enum ConstantByAxes {
    /// The same for all grains.
    Constant {
        /// `b/a`.
        #[schema(minimum = 0.1, maximum = 1)]
        b_over_a: f64,
        /// `c/a`, at most `b/a`.
        #[schema(minimum = 0.1, maximum = 1)]
        c_over_a: f64,
    },
}

/// The shape of grains, or the name of one.
#[derive(serde::Serialize, utoipa::ToSchema)]
#[serde(untagged)]
#[allow(dead_code)]
pub(crate) enum GrainShapeInput {
    /// As results have it.
    Shape(GrainShape),
    /// By name.
    Preset(PresetShape),
}

/// A shape that is no mixture, or the name of one.
#[derive(serde::Serialize, utoipa::ToSchema)]
#[serde(untagged)]
#[allow(dead_code)]
pub(crate) enum PlainShapeInput {
    /// As results have it.
    Shape(PlainShape),
    /// By name.
    Preset(PresetShape),
}

/// A shape by its name; results have the law of its axis ratios.
#[derive(serde::Serialize, utoipa::ToSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
#[allow(dead_code)]
pub(crate) enum PresetShape {
    /// A shape that `GET /v1/capabilities` lists with its source.
    Preset {
        /// Its name.
        name: ShapePresetName,
    },
}

/// The presets of shapes, which `GET /v1/capabilities` lists with their sources.
#[derive(serde::Serialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
#[allow(dead_code)]
pub(crate) enum ShapePresetName {
    /// EN 12620, flakiness index 15 %.
    Fi15,
    /// EN 12620, flakiness index 20 %.
    Fi20,
    /// EN 12620, flakiness index 35 %.
    Fi35,
    /// EN 12620, flakiness index 50 %.
    Fi50,
    /// EN 12620, shape index 15 %.
    Si15,
    /// EN 12620, shape index 20 %.
    Si20,
    /// EN 12620, shape index 40 %.
    Si40,
    /// EN 12620, shape index 55 %.
    Si55,
    /// Rock fragments of impact experiments.
    ImpactFragments,
}
