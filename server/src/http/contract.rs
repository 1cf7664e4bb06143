//! The interface document as it is published: `openapi.yaml` at the root of the repository, and the same as JSON. A
//! build contains both.
//!
//! The tests make the document from the handlers and their types (`openapi`) and compare.

/// The document as YAML.
pub(crate) const YAML: &str = include_str!("../../../openapi.yaml");

/// The document as JSON.
pub(super) const JSON: &str = include_str!("openapi.json");

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use packstone_engine::export::ExportType;
    use serde_json::{Value, json};

    use super::*;
    use crate::http::openapi::document;
    use crate::http::openapi::strict::objects_of;
    use crate::http::problems::PROBLEM_JSON;

    /// The document that the code says, as YAML.
    fn yaml() -> String {
        let text = yaml_serde::to_string(&document()).unwrap();
        // A letter that older YAML reads as yes or no.
        let quoted = |line: &str| match line.trim_start() {
            "- y" | "- n" => line.replace("- y", "- 'y'").replace("- n", "- 'n'"),
            _ => line.to_owned(),
        };
        text.lines().map(|line| quoted(line) + "\n").collect()
    }

    #[test]
    fn the_published_document_is_what_the_code_says() {
        let yaml = yaml();
        let json = serde_json::to_string_pretty(&document()).unwrap();
        if std::env::var_os("UPDATE_OPENAPI").is_some() {
            let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
            std::fs::write(format!("{root}/openapi.yaml"), yaml).unwrap();
            std::fs::write(format!("{root}/server/src/http/openapi.json"), json).unwrap();
            return;
        }
        assert!(
            YAML == yaml && JSON == json,
            "the documents are not what the code says: run `UPDATE_OPENAPI=1 cargo test -p packstone-server --lib contract`"
        );
    }

    #[test]
    fn every_reference_leads_somewhere() {
        fn references<'a>(value: &'a Value, found: &mut Vec<&'a str>) {
            match value {
                Value::Object(members) => {
                    found.extend(members.get("$ref").and_then(Value::as_str));
                    members.values().for_each(|member| references(member, found));
                }
                Value::Array(items) => items.iter().for_each(|item| references(item, found)),
                _ => {}
            }
        }
        let document = document();
        let mut found = Vec::new();
        references(&document, &mut found);
        assert!(found.len() > 100, "{}", found.len());
        for reference in found {
            let pointer = reference.strip_prefix('#').unwrap();
            assert!(document.pointer(pointer).is_some(), "{reference}");
        }
    }

    #[test]
    fn finishing_loses_nothing() {
        let value = document();
        assert_eq!(value["components"]["schemas"]["JobRequest"]["additionalProperties"], false);
        assert_eq!(
            value["paths"]["/v1/jobs"]["post"]["responses"]["500"]["content"][PROBLEM_JSON]["schema"]["$ref"],
            "#/components/schemas/Problem"
        );
        assert_eq!(value["components"]["securitySchemes"]["api_key"]["scheme"], "bearer");
    }

    #[test]
    fn every_place_that_is_bounded_is_there() {
        let document = document();
        let schemas = &document["components"]["schemas"];
        assert_eq!(schemas["JobRequest"]["properties"]["labels"]["maxProperties"], 32);
        assert_eq!(schemas["JobRequest"]["properties"]["name"]["type"], json!(["string", "null"]));
        assert_eq!(schemas["Specimen"]["oneOf"][0]["properties"]["size_mm"]["maxItems"], 3);
        let methods = schemas["Method"]["oneOf"].as_array().map_or(&[][..], Vec::as_slice);
        assert!(methods.iter().any(|m| m["properties"]["type"]["enum"] == json!(["edmd"])
            && m["properties"]["initial_scale"]["minimum"] == 0.5));
        assert_eq!(schemas.get("GrowthOptions"), None, "its fields are those of the method");
        let exports = schemas["ExportRequest"]["oneOf"].as_array().map_or(&[][..], Vec::as_slice);
        for kind in ExportType::ALL {
            let of_type = |export: &&Value| export["properties"]["type"]["enum"] == json!([kind.name()]);
            for format in kind.formats() {
                for option in kind.option_names(format) {
                    let known = exports
                        .iter()
                        .filter(of_type)
                        .any(|export| export["properties"].get(option).is_some());
                    assert!(known, "{} {format} {option}", kind.name());
                }
            }
        }
        assert_eq!(schemas["Postprocess"]["oneOf"][1]["maxItems"], 8);
        let gradings = schemas["Grading"]["oneOf"].as_array().map_or(&[][..], Vec::as_slice);
        for (bounded, list) in [("points", "/items"), ("diameters_mm", "/oneOf/0/items")] {
            let found = gradings.iter().find_map(|g| g["properties"].get(bounded));
            assert!(found.is_some_and(|p| p.pointer(list).is_some()), "{bounded}");
        }
        let closed = [
            "StopWhen",
            "JobRequest",
            "Mix",
            "MixProportions",
            "MixAddition",
            "SizeClass",
            "Specimen",
            "Grading",
            "Distance",
            "Method",
            "GrowthStop",
            "PlainShape",
            "ShapeMixture",
            "MixturePart",
            "ShapeClass",
            "AxisRatios",
            "RatioDistribution",
            "Orientation",
            "ExportRequest",
            "Segregation",
            "GradientField",
        ];
        assert_eq!(schemas["StudyRequest"]["allOf"][0]["additionalProperties"], false);
        assert_eq!(schemas["AxisValues"]["oneOf"][1]["additionalProperties"], false);
        for name in closed {
            let mut schema = schemas[name].clone();
            for object in objects_of(&mut schema) {
                assert_eq!(object["additionalProperties"], false, "{name}");
            }
        }
    }
}
