//! What the interface document says of the request of a study, which [`super::request`] reads.

use std::borrow::Cow;

use packstone_engine::request::MAX_SEED;
use serde_json::{Value, json};
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{
    AdditionalProperties, AllOfBuilder, ArrayBuilder, Object, ObjectBuilder, OneOfBuilder, Ref, Schema,
    SchemaType, Type,
};
use utoipa::{PartialSchema, ToSchema};

use super::request::Values;
use super::{MAX_JOBS, StopWhen, Study};
use crate::jobs::JobRequest;
use crate::jobs::schema;

/// Places in a template: JSON pointers other than the empty one.
const POINTER: &str = "^(/([^~]|~[01])*)+$";
const EXAMPLE: &str = r#"{
    "name": "A16, success against volume fraction", "seed": 1,
    "template": {
        "specimen": {"type": "box", "size_mm": [40, 40, 40]},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4, "volume_fraction": 0.4}
    },
    "grid": {
        "/mix/volume_fraction": {"from": 0.40, "to": 0.44, "step": 0.02},
        "/method": [{"type": "rsa"}, {"type": "edmd"}]
    },
    "replicates": 2,
    "stop_when": {"failed_in_a_row": 2}
}"#;

/// The type of a field that may be `null`, which is the same as its absence.
fn optional(of: Type) -> SchemaType {
    SchemaType::from_iter([of, Type::Null])
}

fn number(maximum: u64, minimum: u64, about: &str) -> ObjectBuilder {
    let number = ObjectBuilder::new().schema_type(optional(Type::Integer)).description(Some(about));
    number.minimum(Some(minimum)).maximum(Some(maximum))
}

/// Places with values for each.
fn axes(about: &str) -> Object {
    ObjectBuilder::new()
        .schema_type(optional(Type::Object))
        .description(Some(about))
        .property_names(Some(Schema::from(
            ObjectBuilder::new().schema_type(Type::String).pattern(Some(POINTER)).build(),
        )))
        .additional_properties(Some(RefOr::<Schema>::from(Ref::from_schema_name(Values::name()))))
        .build()
}

/// The fields of a request.
fn fields() -> ObjectBuilder {
    let list = ArrayBuilder::new()
        .schema_type(optional(Type::Array))
        .items(Ref::from_schema_name(JobRequest::name()))
        .min_items(Some(1))
        .max_items(Some(MAX_JOBS))
        .description(Some("The points as jobs of their own."));
    let template = ObjectBuilder::new()
        .schema_type(optional(Type::Object))
        .description(Some("A job, but for the fields that `grid` and `zip` set."));
    let grid = "JSON pointers (RFC 6901) into the template, each with its values: every combination is a point, and the \
                last pointer varies fastest.";
    let zip = "JSON pointers into the template whose values run together: lists of the same length. They vary faster \
               than the grid.";
    let seed = "What the seeds of the jobs derive from; drawn at submission and recorded when absent.";
    let replicates = number(MAX_JOBS as u64, 1, "Jobs of every point, with seeds of their own.");
    let stop_when = OneOfBuilder::new()
        .item(ObjectBuilder::new().schema_type(Type::Null))
        .item(Ref::from_schema_name(StopWhen::name()))
        .description(Some("When a point needs no more runs; what of it still waits is cancelled then."));
    let shared = ObjectBuilder::new()
        .schema_type(optional(Type::Boolean))
        .default(Some(json!(false)))
        .description(Some("Whether other users of the server may read the study with its jobs."));
    ObjectBuilder::new()
        .schema_type(Type::Object)
        .property("name", schema::name())
        .property("labels", schema::labels(optional(Type::Object)))
        .property("seed", number(MAX_SEED, 0, seed))
        .property("list", list)
        .property("template", template)
        .property("grid", axes(grid))
        .property("zip", axes(zip))
        .property("replicates", replicates.default(Some(json!(1))))
        .property("stop_when", stop_when)
        .property("shared", shared)
        .property("webhook_url", schema::webhook_url())
        .additional_properties(Some(AdditionalProperties::<Schema>::FreeForm(false)))
}

impl PartialSchema for Study {
    /// A study has a list or a template, and places to put values into only with the latter.
    fn schema() -> RefOr<Schema> {
        let of = |of: Type| ObjectBuilder::new().schema_type(of);
        let absent = || of(Type::Null);
        let list = ObjectBuilder::new()
            .property("list", of(Type::Array))
            .required("list")
            .property("template", absent())
            .property("grid", absent())
            .property("zip", absent());
        let template = ObjectBuilder::new()
            .property("template", of(Type::Object))
            .required("template")
            .property("list", absent());
        let request = AllOfBuilder::new()
            .item(fields())
            .item(OneOfBuilder::new().item(list).item(template))
            .description(Some(
                "Many jobs at once: a `list` of them, or a `template` with values for some of its fields.",
            ))
            .examples([serde_json::from_str::<Value>(EXAMPLE).unwrap_or_default()]);
        Schema::from(request.build()).into()
    }
}

impl ToSchema for Study {
    fn name() -> Cow<'static, str> {
        "StudyRequest".into()
    }

    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        schemas.push((Values::name().into_owned(), Values::schema()));
        schemas.push((StopWhen::name().into_owned(), StopWhen::schema()));
        schemas.push((JobRequest::name().into_owned(), JobRequest::schema()));
        JobRequest::schemas(schemas);
    }
}

impl PartialSchema for Values<'_> {
    fn schema() -> RefOr<Schema> {
        let number = || ObjectBuilder::new().schema_type(Type::Number);
        let about = "Numbers at equal steps: `from`, `from + step`, ... as far as `to`, both ends included, to 12 \
                     significant digits of the larger term.";
        let mut range = ObjectBuilder::new().schema_type(Type::Object).description(Some(about));
        for name in ["from", "to", "step"] {
            range = range.property(name, number()).required(name);
        }
        let list = ArrayBuilder::new().items(ObjectBuilder::new().schema_type(SchemaType::AnyValue));
        let values = OneOfBuilder::new()
            .item(list.description(Some("Any values, one by one.")))
            .item(range.additional_properties(Some(AdditionalProperties::<Schema>::FreeForm(false))))
            .description(Some("The values of one field."));
        Schema::from(values.build()).into()
    }
}

impl ToSchema for Values<'_> {
    fn name() -> Cow<'static, str> {
        "AxisValues".into()
    }
}
