//! Requests in the form of revision 1, which data directories made before version 0.2 hold.
//!
//! Revision 2 renamed fields; no field changed its meaning.

use serde_json::{Map, Value};

/// Renames the fields of a request of revision 1 to those of the present revision, in place.
///
/// Numbers are moved, never converted, so that the request means the same packing, bit for bit. A request of the
/// present revision stays as it is. Fields of a job beside the packing are left alone, but for `postprocess`.
///
/// ```
/// use packstone_engine::request::upgrade;
/// use serde_json::json;
///
/// let mut request = json!({"distance": {"type": "constant", "mm": 0.5, "wall_mm": 1.0}});
/// upgrade(&mut request);
/// assert_eq!(request, json!({"distance": {"type": "constant", "gap_mm": 0.5, "wall_gap_mm": 1.0}}));
/// ```
pub fn upgrade(request: &mut Value) {
    let Some(request) = request.as_object_mut() else { return };
    if let Some(distance) = object(request, "distance") {
        rename(distance, "mm", "gap_mm");
        rename(distance, "wall_mm", "wall_gap_mm");
    }
    if let Some(mix) = object(request, "mix") {
        rename(mix, "content", "proportions");
        rename(mix, "basis", "volume_fraction_of");
        replace(mix, "volume_fraction_of", &[("mixture", "all_aggregate"), ("effective", "placed_grains")]);
        if let Some(grading) = object(mix, "grading") {
            rename(grading, "mm", "diameters_mm");
        }
    }
    rename(request, "placement", "segregation");
    if let Some(segregation) = object(request, "segregation") {
        replace(segregation, "type", &[("random", "none")]);
    }
    match request.get_mut("postprocess") {
        Some(Value::Array(exports)) => exports.iter_mut().for_each(upgrade_export),
        Some(export) => upgrade_export(export),
        None => {}
    }
}

/// Renames the fields of an export of revision 1: `type` named the file format of meshes and voxels, `form` that of
/// slices, `file` that of lattices.
pub fn upgrade_export(export: &mut Value) {
    let Some(export) = export.as_object_mut() else { return };
    let of_type = match export.get("type").and_then(Value::as_str) {
        Some("msh" | "geo" | "stl") => "mesh",
        Some("vti" | "raw" | "inp") => "voxels",
        Some("slice") => {
            rename(export, "form", "format");
            return;
        }
        Some("ldpm") => {
            rename(export, "file", "format");
            return;
        }
        _ => return,
    };
    // The order of the fields is part of what names a stored export: `type` comes first, then `format`.
    let mut upgraded = Map::new();
    upgraded.insert("type".into(), Value::from(of_type));
    for (name, value) in std::mem::take(export) {
        let name = if name == "type" { "format".to_owned() } else { name };
        upgraded.insert(name, value);
    }
    *export = upgraded;
}

fn object<'a>(of: &'a mut Map<String, Value>, name: &str) -> Option<&'a mut Map<String, Value>> {
    of.get_mut(name)?.as_object_mut()
}

/// Gives a field another name, at its place.
fn rename(of: &mut Map<String, Value>, from: &str, to: &str) {
    if !of.contains_key(from) || of.contains_key(to) {
        return;
    }
    *of = std::mem::take(of)
        .into_iter()
        .map(|(name, value)| if name == from { (to.to_owned(), value) } else { (name, value) })
        .collect();
}

fn replace(of: &mut Map<String, Value>, name: &str, values: &[(&str, &str)]) {
    let Some(value) = of.get_mut(name) else { return };
    if let Some((_, to)) = values.iter().find(|(from, _)| value == from) {
        *value = Value::from(*to);
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_request_of_the_first_revision_is_renamed_throughout() {
        let mut request = json!({
            "seed": 1,
            "mix": {"grading": {"type": "diameters", "mm": [4.1]}, "basis": "effective", "content": {"air": 0.1}},
            "distance": {"type": "maximize", "wall_mm": 0.300_000_000_000_000_04},
            "placement": {"type": "random"},
            "postprocess": [{"type": "msh", "segments": 8}, {"type": "slice", "form": "svg"}, {"type": "ldpm", "file": "tets"}]
        });
        upgrade(&mut request);
        let expected = json!({
            "seed": 1,
            "mix": {
                "grading": {"type": "diameters", "diameters_mm": [4.1]},
                "volume_fraction_of": "placed_grains",
                "proportions": {"air": 0.1}
            },
            "distance": {"type": "maximize", "wall_gap_mm": 0.300_000_000_000_000_04},
            "segregation": {"type": "none"},
            "postprocess": [
                {"type": "mesh", "format": "msh", "segments": 8},
                {"type": "slice", "format": "svg"},
                {"type": "ldpm", "format": "tets"}
            ]
        });
        assert_eq!(request.to_string(), expected.to_string());
    }

    #[test]
    fn a_request_of_this_revision_stays_as_it_is() {
        let mut request = json!({
            "mix": {"grading": {"type": "diameters", "diameters_mm": [4]}, "volume_fraction_of": "all_aggregate"},
            "distance": {"type": "constant", "gap_mm": 1},
            "postprocess": {"type": "voxels", "format": "raw", "cells": 8}
        });
        let before = request.to_string();
        upgrade(&mut request);
        assert_eq!(request.to_string(), before);
    }
}
