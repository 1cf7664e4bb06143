//! The schemas of requests, made as strict in the document as their readers are.
//!
//! What reads requests refuses unknown fields and takes `null` for absent; the derives cannot say it of variants. The
//! rules here know no schema by its name: they hold for a request and for all that it contains.

use serde_json::{Map, Value, json};
use utoipa::ToSchema;

/// Replaces the schemas of the request `T` and of what it contains by strict ones.
pub(crate) fn apply<T: ToSchema>(schemas: &mut Map<String, Value>) {
    let mut found = vec![(T::name().into_owned(), T::schema())];
    T::schemas(&mut found);
    let mut contained = Map::new();
    for (name, schema) in found {
        contained.insert(name, serde_json::to_value(schema).unwrap_or_default());
    }
    let joined_in = strict(&mut contained);
    schemas.append(&mut contained);
    for name in joined_in {
        schemas.shift_remove(&name);
    }
}

/// Makes schemas strict; the names of those that others contain now.
fn strict(schemas: &mut Map<String, Value>) -> Vec<String> {
    let names: Vec<String> = schemas.keys().cloned().collect();
    let mut joined_in: Vec<String> = Vec::new();
    // Those that are joined into others may have been joined themselves before.
    for name in names.iter().rev() {
        joined_in.extend(join_options(schemas, name));
    }
    for name in &joined_in {
        schemas.shift_remove(name);
    }
    for schema in schemas.values_mut() {
        objects_of(schema).into_iter().filter(|object| object.contains_key("properties")).for_each(close);
    }
    joined_in
}

/// Puts the options of a variant, as of `edmd`, beside its `type`: the derive makes an `allOf` of the two, of which
/// neither part could refuse unknown fields without refusing the other's. Options that have variants themselves, as
/// those of meshes by `format`, give a variant each, of which the first is that of an absent `format`. The names of the
/// options that were joined.
fn join_options(schemas: &mut Map<String, Value>, name: &str) -> Vec<String> {
    let Some(mut schema) = schemas.get(name).cloned() else { return Vec::new() };
    let Some(variants) = schema.get_mut("oneOf").and_then(Value::as_array_mut) else { return Vec::new() };
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
    joined_in
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn optional_fields_may_be_null_and_others_may_not_be_there() {
        let mix = json!({
            "type": "object", "required": ["grading"],
            "properties": {
                "grading": {"$ref": "#/g"},
                "volume_fraction_of": {"$ref": "#/b", "default": "all_aggregate"},
                "n": {"type": "number"}
            }
        });
        let mut schemas = Map::from_iter([("Mix".to_owned(), mix)]);
        assert_eq!(strict(&mut schemas), [""; 0]);
        assert_eq!(
            schemas["Mix"],
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
