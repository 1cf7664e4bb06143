//! Words for the columns of a study's table: axis labels and names of series, with units.
//!
//! A column is a JSON pointer into a job request, as `/mix/d_min_mm`. The fields that a study usually varies have words
//! of their own here; any other field is named by its last segment, without underscores and with the unit of its
//! suffix.

use serde_json::Value;

use super::axis::plain;

/// A field of the request: its parent where the name alone is ambiguous, its words, its unit.
struct Field {
    parent: Option<&'static str>,
    name: &'static str,
    words: &'static str,
    unit: &'static str,
}

const fn field(
    parent: Option<&'static str>,
    name: &'static str,
    words: &'static str,
    unit: &'static str,
) -> Field {
    Field { parent, name, words, unit }
}

const FIELDS: [Field; 18] = [
    field(Some("mix"), "d_min_mm", "cut-off diameter", "mm"),
    field(None, "d_min_mm", "smallest diameter", "mm"),
    field(None, "d_max_mm", "largest diameter", "mm"),
    field(Some("grading"), "diameter_mm", "grain diameter", "mm"),
    field(None, "gap_mm", "gap", "mm"),
    field(None, "wall_gap_mm", "gap to the walls", "mm"),
    field(Some("distance"), "factor", "distance factor", ""),
    field(None, "attempts_per_grain", "attempts per grain", ""),
    field(Some("stop"), "time_s", "time limit", "s"),
    field(Some("stop"), "events", "event limit", ""),
    field(Some("stop"), "sweeps", "sweep limit", ""),
    field(None, "stall_dt_s", "stall limit", "s"),
    field(None, "initial_scale", "initial scale", ""),
    field(None, "growth_rate", "growth rate", "1/s"),
    field(None, "initial_velocity", "initial velocity", "mm/s"),
    field(None, "equal_mass", "equal masses", ""),
    field(None, "swap", "swap moves", ""),
    field(None, "volume_fraction", "volume fraction", ""),
];

/// Words for the values of `type` and of other enumerations, by the field that has them. A value without words adds
/// nothing to the other members of its object.
const VARIANTS: [(&str, &str, &str); 15] = [
    ("method", "auto", "automatic method"),
    ("method", "rsa", "RSA"),
    ("method", "growth", "growth"),
    ("method", "edmd", "EDMD"),
    ("method", "monte_carlo", "Monte Carlo"),
    ("distance", "none", "no minimum distance"),
    ("distance", "constant", ""),
    ("distance", "proportional", "distance proportional to the mean diameter"),
    ("distance", "smaller_diameter", "distance proportional to the smaller diameter"),
    ("distance", "maximize", "largest distance"),
    ("grading", "standard", ""),
    ("grading", "fuller", "Fuller"),
    ("segregation", "none", "no segregation"),
    ("volume_fraction_of", "all_aggregate", "all aggregate"),
    ("volume_fraction_of", "placed_grains", "placed grains"),
];

/// The label of an axis: the words for a column, with the unit.
pub(super) fn column_label(pointer: &str) -> String {
    let (words, unit) = words_and_unit(pointer);
    if unit.is_empty() { words } else { format!("{words} in {unit}") }
}

/// A value of a column, with as many words as it needs: `RSA, 20 000 attempts per grain`.
pub(super) fn value_label(pointer: &str, value: &Value) -> String {
    let (words, unit) = words_and_unit(pointer);
    match value {
        Value::String(text) => variant(pointer, text),
        Value::Object(members) => {
            let part = |(name, value): (&String, &Value)| value_label(&format!("{pointer}/{name}"), value);
            let parts: Vec<String> = members.iter().map(part).filter(|part| !part.is_empty()).collect();
            parts.join(", ")
        }
        Value::Bool(true) => format!("with {words}"),
        Value::Bool(false) | Value::Null => format!("without {words}"),
        // A count comes first, as in a sentence.
        _ if words.ends_with(" per grain") => format!("{} {words}", value_text(value)),
        _ if unit.is_empty() => format!("{words} {}", value_text(value)),
        _ => format!("{words} {} {unit}", value_text(value)),
    }
}

/// The words for a value of an enumeration; a text of the user as it is.
fn variant(pointer: &str, text: &str) -> String {
    let field = match segments(pointer) {
        (parent, "type") => parent,
        (_, name) => name,
    };
    let known = VARIANTS.iter().find(|(of, value, _)| *of == field && *value == text);
    match known {
        Some((_, _, words)) => (*words).to_owned(),
        None if pointer.ends_with("/type") => text.replace('_', " "),
        None => text.to_owned(),
    }
}

/// The last name in a pointer and the name before it, both without indices of lists.
fn segments(pointer: &str) -> (&str, &str) {
    let mut names = pointer.rsplit('/').filter(|name| name.parse::<usize>().is_err());
    let name = names.next().unwrap_or_default();
    (names.next().unwrap_or_default(), name)
}

fn words_and_unit(pointer: &str) -> (String, &'static str) {
    let (parent, name) = segments(pointer);
    let known = FIELDS.iter().find(|field| field.name == name && field.parent.is_none_or(|of| of == parent));
    if let Some(field) = known {
        return (field.words.to_owned(), field.unit);
    }
    let plain_name = |name: &str| name.replace("~1", "/").replace("~0", "~").replace('_', " ");
    let name = match name {
        // Such a name is that of many fields: its parent says which.
        "mm" | "factor" | "name" => format!("{parent}_{name}"),
        "type" => parent.to_owned(),
        _ => name.to_owned(),
    };
    for (suffix, unit) in [("_mm", "mm"), ("_s", "s")] {
        if let Some(name) = name.strip_suffix(suffix) {
            return (plain_name(name), unit);
        }
    }
    (plain_name(&name), "")
}

fn value_text(value: &Value) -> String {
    match value {
        Value::Number(number) => number.as_f64().map_or_else(|| number.to_string(), |n| plain(n, None)),
        Value::Array(items) if items.iter().all(|item| !item.is_array() && !item.is_object()) => {
            items.iter().map(value_text).collect::<Vec<_>>().join(" \u{D7} ")
        }
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn columns_have_plain_words_with_units() {
        for (pointer, label) in [
            ("/mix/volume_fraction", "volume fraction"),
            ("/mix/d_min_mm", "cut-off diameter in mm"),
            ("/mix/grading/d_max_mm", "largest diameter in mm"),
            ("/mix/grading/classes/2/d_min_mm", "smallest diameter in mm"),
            ("/distance/gap_mm", "gap in mm"),
            ("/distance/factor", "distance factor"),
            ("/specimen/size_mm/0", "size in mm"),
            ("/specimen/height_mm", "height in mm"),
            ("/method/attempts_per_grain", "attempts per grain"),
            ("/method/stop/time_s", "time limit in s"),
            ("/method/growth_rate", "growth rate in 1/s"),
            ("/labels/a~1b", "a/b"),
        ] {
            assert_eq!(column_label(pointer), label, "{pointer}");
        }
    }

    #[test]
    fn values_have_plain_words_with_units() {
        for (pointer, value, label) in [
            ("/specimen/size_mm", json!([80, 80, 160.5]), "size 80 \u{D7} 80 \u{D7} 160.5 mm"),
            ("/method", json!({"type": "edmd"}), "EDMD"),
            (
                "/method",
                json!({"type": "rsa", "attempts_per_grain": 20_000}),
                "RSA, 20\u{A0}000 attempts per grain",
            ),
            ("/method", json!({"type": "edmd", "stop": {"time_s": 60}}), "EDMD, time limit 60 s"),
            ("/method/type", json!("rsa"), "RSA"),
            ("/method/swap", json!(false), "without swap moves"),
            ("/method/attempts_per_grain", json!(1000), "1000 attempts per grain"),
            ("/mix/d_min_mm", json!(0.25), "cut-off diameter 0.25 mm"),
            ("/mix/grading", json!({"type": "standard", "name": "A16"}), "A16"),
            ("/mix/grading", json!({"type": "fuller", "d_max_mm": 8}), "Fuller, largest diameter 8 mm"),
            ("/mix/grading/name", json!("B16"), "B16"),
            ("/distance", json!({"type": "constant", "gap_mm": 0.5}), "gap 0.5 mm"),
            ("/distance", json!({"type": "maximize"}), "largest distance"),
            ("/labels/lab", json!("lab_7"), "lab_7"),
            ("/method/stop/time_s", json!(null), "without time limit"),
        ] {
            assert_eq!(value_label(pointer, &value), label, "{pointer} {value}");
        }
    }
}
