//! Schemas of requests that no derive makes: arrays whose items are bounded, and fields with a second spelling.

use serde_json::json;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{
    Array, ArrayBuilder, ArrayItems, ObjectBuilder, OneOfBuilder, Schema, SchemaType, Type,
};

use super::{GrainShape, MAX_LENGTH_MM, MAXIMIZE, MIN_LENGTH_MM, MIN_SHARE, PlainShape};
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
             the run and is its normal end. Either this or `proportions` is required, except for the grading \
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

/// The points of a grading curve by sieves.
pub(crate) fn points() -> Array {
    let passing = ObjectBuilder::new().schema_type(Type::Number).minimum(Some(0)).maximum(Some(1)).build();
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
        .description(Some("The points of the curve, at least two."))
        .examples([json!([[2.0, 0.0], [8.0, 0.6], [16.0, 1.0]])])
        .build()
}

/// An explicit list of diameters.
pub(crate) fn diameters_mm() -> Array {
    ArrayBuilder::new()
        .items(length())
        .min_items(Some(1))
        .description(Some("Diameter of every grain, in any order."))
        .examples([json!([12.0, 10.0, 8.0])])
        .build()
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
