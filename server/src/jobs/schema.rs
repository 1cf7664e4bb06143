//! What the interface document says of those parts of a job's request that no derive describes.

use packstone_engine::export::ExportRequest;
use serde_json::{Value, json};
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{
    ArrayBuilder, Object, ObjectBuilder, OneOfBuilder, Ref, Schema, SchemaFormat, SchemaType, Type,
};
use utoipa::{PartialSchema, ToSchema};

use super::request::{MAX_LABEL_KEY_CHARS, MAX_LABEL_VALUE_CHARS, MAX_LABELS, MAX_NAME_CHARS, Postprocess};
use crate::exports::MAX_POSTPROCESS;
use crate::webhooks::MAX_URL_CHARS;

/// Characters that may not be in names and labels, as part of a class of a pattern.
const CONTROL: &str = "\\u0000-\\u001f\\u007f-\\u009f";

/// The example of the interface document.
pub(super) fn example() -> Value {
    serde_json::from_str(include_str!("../../../examples/a16.json")).unwrap_or_default()
}

/// What the interface document says of labels.
pub(super) fn job_labels() -> Object {
    labels(Type::Object.into())
}

/// What the interface document says of names.
pub(crate) fn name() -> Object {
    ObjectBuilder::new()
        .schema_type(SchemaType::from_iter([Type::String, Type::Null]))
        .description(Some("A name for people."))
        .min_length(Some(1))
        .max_length(Some(MAX_NAME_CHARS))
        .pattern(Some(format!("^[^{CONTROL}]*$")))
        .build()
}

/// What the interface document says of the URL of a webhook.
pub(crate) fn webhook_url() -> Object {
    let about = "http or https URL, without user information and fragment, to which a signed message is sent when the \
                 job ends or the study is finished (Standard Webhooks). It is answered in `webhook.url` to its owner; \
                 requests and results do not contain it, because it may contain a token.";
    ObjectBuilder::new()
        .schema_type(SchemaType::from_iter([Type::String, Type::Null]))
        .description(Some(about))
        .format(Some(SchemaFormat::Custom("uri".into())))
        .max_length(Some(MAX_URL_CHARS))
        .pattern(Some("^[Hh][Tt][Tt][Pp][Ss]?:[!-~]*$"))
        .write_only(true)
        .examples([json!("https://hooks.example.org/packstone")])
        .build()
}

/// What the interface document says of labels, which are of that type.
pub(crate) fn labels(of: SchemaType) -> Object {
    let text = |pattern: String| ObjectBuilder::new().schema_type(Type::String).pattern(Some(pattern));
    let key = format!("^[^={CONTROL}]{{1,{MAX_LABEL_KEY_CHARS}}}$");
    let value = format!("^[^{CONTROL}]{{0,{MAX_LABEL_VALUE_CHARS}}}$");
    let about = format!(
        "Keys and values to find it by: at most {MAX_LABELS}; a key has 1 to {MAX_LABEL_KEY_CHARS} characters and no \
         equals sign, a value at most {MAX_LABEL_VALUE_CHARS} characters."
    );
    ObjectBuilder::new()
        .schema_type(of)
        .description(Some(about))
        .examples([json!({"series": "TB-7"})])
        .max_properties(Some(MAX_LABELS))
        .property_names(Some(Schema::from(text(key).build())))
        .additional_properties(Some(Schema::from(text(value).build())))
        .build()
}

impl PartialSchema for Postprocess {
    fn schema() -> RefOr<Schema> {
        let one = || RefOr::<Schema>::from(Ref::from_schema_name(ExportRequest::name()));
        let list = ArrayBuilder::new().items(one()).max_items(Some(MAX_POSTPROCESS));
        let list = list.description(Some("A list of them.")).build();
        let either = OneOfBuilder::new().item(one()).item(Schema::from(list));
        let about = "What to make of a packing once it is there, in the form in which it was asked for.";
        Schema::from(either.description(Some(about)).build()).into()
    }
}

impl ToSchema for Postprocess {
    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        schemas.push((ExportRequest::name().into_owned(), ExportRequest::schema()));
        ExportRequest::schemas(schemas);
    }
}
