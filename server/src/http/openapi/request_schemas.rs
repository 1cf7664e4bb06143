//! The schemas of requests, made as strict in the document as the service is.
//!
//! What reads requests refuses unknown fields, takes `null` for absent, and bounds the items of
//! arrays; the derives can say none of it.

use packstone_engine::request::{MAX_LENGTH_MM, MIN_LENGTH_MM};
use serde_json::{Map, Value, json};

use crate::exports::MAX_POSTPROCESS;

use crate::jobs::request::{MAX_LABEL_KEY_CHARS, MAX_LABEL_VALUE_CHARS, MAX_LABELS};

const EXAMPLE: &str = include_str!("../../../../examples/a16.json");
const STUDY_EXAMPLE: &str = r#"{
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
/// Schemas of which requests are made.
pub(crate) const REQUEST_SCHEMAS: [&str; 16] = [
    "StudyRequest",
    "StopWhen",
    "AxisRange",
    "JobRequest",
    "Mix",
    "MixProportions",
    "MixAddition",
    "SizeClass",
    "Specimen",
    "Grading",
    "Distance",
    "Method",
    "EdmdStop",
    "ExportRequest",
    "Segregation",
    "GradientField",
];
/// Characters that may not be in names and labels, as part of a class of a pattern.
const CONTROL: &str = "\\u0000-\\u001f\\u007f-\\u009f";

/// Makes the schemas of requests as strict as the service.
pub(crate) fn polish(document: &mut Value) {
    let Some(schemas) = document["components"]["schemas"].as_object_mut() else { return };
    join_options(schemas, "Method");
    join_options(schemas, "MeshRequest");
    join_options(schemas, "ExportRequest");
    for name in REQUEST_SCHEMAS {
        if let Some(schema) = schemas.get_mut(name) {
            objects_of(schema).into_iter().for_each(close);
        }
    }
    bound_items(schemas);
    if let (Some(schema), Ok(example)) =
        (schemas.get_mut("JobRequest"), serde_json::from_str::<Value>(EXAMPLE))
    {
        schema["examples"] = json!([example]);
    }
    choose_points(schemas);
    schemas.sort_keys();
}

/// A study has a list or a template, and places to put values into only with the latter.
fn choose_points(schemas: &mut Map<String, Value>) {
    let Some(schema) = schemas.get_mut("StudyRequest") else { return };
    let absent = json!({"type": "null"});
    schema["oneOf"] = json!([
        {
            "required": ["list"],
            "properties": {"list": {"type": "array"}, "template": absent, "grid": absent, "zip": absent}
        },
        {"required": ["template"], "properties": {"template": {"type": "object"}, "list": absent}},
    ]);
    if let Ok(example) = serde_json::from_str::<Value>(STUDY_EXAMPLE) {
        schema["examples"] = json!([example]);
    }
}

/// Puts the options of a variant, as of `edmd`, beside its `type`: the derive makes an `allOf` of the two, of which
/// neither part could refuse unknown fields without refusing the other's. Options that have variants themselves, as those
/// of meshes by `format`, give a variant each, of which the first is that of an absent `format`.
fn join_options(schemas: &mut Map<String, Value>, name: &str) {
    let Some(mut schema) = schemas.get(name).cloned() else { return };
    let Some(variants) = schema["oneOf"].as_array_mut() else { return };
    let (mut all, mut joined_in) = (Vec::new(), Vec::new());
    for variant in std::mem::take(variants) {
        let reference =
            variant["allOf"][0]["$ref"].as_str().and_then(|reference| reference.rsplit('/').next());
        let Some((name, mut options)) = reference.and_then(|name| Some((name, schemas.get(name)?.clone())))
        else {
            all.push(variant);
            continue;
        };
        joined_in.push(name.to_owned());
        let options = objects_of(&mut options);
        let several = options.len() > 1;
        for (index, options) in options.into_iter().enumerate() {
            let mut joined = variant["allOf"][1].clone();
            put_beside(&mut joined, options);
            if let Some(required) = joined["required"].as_array_mut().filter(|_| several && index == 0) {
                required.retain(|name| name != "format");
            }
            let told = if several { options.get("description") } else { variant.get("description") };
            if let Some(description) = told {
                joined["description"] = description.clone();
            }
            all.push(joined);
        }
    }
    *variants = all;
    schemas.insert(name.to_owned(), schema);
    for name in joined_in {
        schemas.shift_remove(&name);
    }
}

/// Adds the fields of `options` before those of `tag`.
fn put_beside(tag: &mut Value, options: &Map<String, Value>) {
    let mut fields = options.get("properties").and_then(Value::as_object).cloned().unwrap_or_default();
    if let Some(own) = tag["properties"].as_object_mut() {
        fields.append(own);
        *own = fields;
    }
    let required = options.get("required").and_then(Value::as_array).cloned().unwrap_or_default();
    if let Some(own) = tag["required"].as_array_mut() {
        own.extend(required);
    }
}

/// The object that a schema describes, or those of its variants where it has no fields itself.
pub(crate) fn objects_of(schema: &mut Value) -> Vec<&mut Map<String, Value>> {
    if schema.get("oneOf").is_some() && schema.get("properties").is_none() {
        schema["oneOf"].as_array_mut().into_iter().flatten().filter_map(Value::as_object_mut).collect()
    } else {
        schema.as_object_mut().into_iter().collect()
    }
}

/// Says of an object that it has no other fields, and that optional ones may be `null`.
fn close(object: &mut Map<String, Value>) {
    let required: Vec<String> = object
        .get("required")
        .and_then(Value::as_array)
        .map(|names| names.iter().filter_map(Value::as_str).map(str::to_owned).collect())
        .unwrap_or_default();
    let properties = object.get_mut("properties").and_then(Value::as_object_mut);
    for (name, property) in properties.into_iter().flatten() {
        if !required.contains(name) {
            allow_null(property);
        }
    }
    object.insert("additionalProperties".into(), false.into());
}

fn allow_null(property: &mut Value) {
    let Some(object) = property.as_object_mut() else { return };
    if let Some(reference) = object.shift_remove("$ref") {
        object.shift_insert(0, "anyOf".into(), json!([{"$ref": reference}, {"type": "null"}]));
    } else if let Some(Value::String(of)) = object.get("type").cloned() {
        object.insert("type".into(), json!([of, "null"]));
    }
}

fn bound_items(schemas: &mut Map<String, Value>) {
    let length = json!({"type": "number", "minimum": MIN_LENGTH_MM, "maximum": MAX_LENGTH_MM});
    let passing = json!({"type": "number", "minimum": 0, "maximum": 1});
    for request in ["JobRequest", "StudyRequest"] {
        if let Some(labels) = at(schemas, request, "labels") {
            labels["maxProperties"] = json!(MAX_LABELS);
            let key = format!("^[^={CONTROL}]{{1,{MAX_LABEL_KEY_CHARS}}}$");
            labels["propertyNames"] = json!({ "pattern": key });
            let value = format!("^[^{CONTROL}]{{0,{MAX_LABEL_VALUE_CHARS}}}$");
            labels["additionalProperties"] = json!({"type": "string", "pattern": value});
        }
        if let Some(name) = at(schemas, request, "name") {
            name["pattern"] = json!(format!("^[^{CONTROL}]*$"));
        }
    }
    if let Some(schema) = schemas.get_mut("Postprocess") {
        schema["oneOf"][1]["maxItems"] = json!(MAX_POSTPROCESS);
    }
    for axes in ["grid", "zip"] {
        if let Some(axes) = at(schemas, "StudyRequest", axes) {
            axes["propertyNames"] = json!({"pattern": "^(/([^~]|~[01])*)+$"});
        }
    }
    if let Some(size) = at(schemas, "Specimen", "size_mm") {
        size["items"] = length.clone();
        size["minItems"] = json!(3);
        size["maxItems"] = json!(3);
    }
    if let Some(points) = at(schemas, "Grading", "points") {
        points["items"] =
            json!({"type": "array", "prefixItems": [length, passing], "minItems": 2, "maxItems": 2});
    }
    if let Some(diameters) = at(schemas, "Grading", "diameters_mm") {
        diameters["items"] = length;
    }
}

/// A property of a schema, or of the variant that has it.
fn at<'a>(schemas: &'a mut Map<String, Value>, schema: &str, property: &str) -> Option<&'a mut Value> {
    objects_of(schemas.get_mut(schema)?)
        .into_iter()
        .find_map(|object| object.get_mut("properties")?.get_mut(property))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn optional_fields_may_be_null_and_others_may_not_be_there() {
        let mut document = json!({"components": {"schemas": {"Mix": {
            "type": "object", "required": ["grading"],
            "properties": {"grading": {"$ref": "#/g"}, "volume_fraction_of": {"$ref": "#/b", "default": "all_aggregate"}, "n": {"type": "number"}}
        }}}});
        polish(&mut document);
        assert_eq!(
            document["components"]["schemas"]["Mix"],
            json!({
                "type": "object", "required": ["grading"],
                "properties": {
                    "grading": {"$ref": "#/g"},
                    "volume_fraction_of": {"anyOf": [{"$ref": "#/b"}, {"type": "null"}], "default": "all_aggregate"},
                    "n": {"type": ["number", "null"]}
                },
                "additionalProperties": false
            })
        );
    }
}
