//! In what two documents differ, for a person who must tell them apart.

use packstone_engine::request::decode::pointer_segment;
use serde_json::{Map, Value};

/// More differences than this make another document.
const SHOWN: usize = 5;

/// A line for every field in which two documents differ, with both values: `pointer is .. in ours and .. in theirs`.
pub(super) fn differences(of: &Value, in_ours: &str, theirs: &Value, in_theirs: &str) -> Vec<String> {
    let mut found = Vec::new();
    let names = Names { ours: in_ours, theirs: in_theirs };
    find("", of, theirs, &names, &mut found);
    let more = found.len().saturating_sub(SHOWN);
    found.truncate(SHOWN);
    if more > 0 {
        found.push(format!("and {more} more"));
    }
    found
}

struct Names<'a> {
    ours: &'a str,
    theirs: &'a str,
}

fn find(pointer: &str, ours: &Value, theirs: &Value, names: &Names<'_>, found: &mut Vec<String>) {
    match (ours, theirs) {
        (Value::Object(in_ours), Value::Object(in_theirs)) => {
            let fields = in_ours.keys().chain(in_theirs.keys().filter(|name| !in_ours.contains_key(*name)));
            for name in fields {
                let of = |object: &Map<String, Value>| object.get(name).cloned().unwrap_or_default();
                let at = format!("{pointer}/{}", pointer_segment(name));
                find(&at, &of(in_ours), &of(in_theirs), names, found);
            }
        }
        _ if ours != theirs => found.push(format!(
            "{pointer} is {} in {} and {} in {}",
            shown(ours),
            names.ours,
            shown(theirs),
            names.theirs
        )),
        _ => {}
    }
}

fn shown(value: &Value) -> String {
    match value {
        Value::Null => "absent".into(),
        Value::Array(items) if items.len() > 3 => format!("a list of {}", items.len()),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn differences_name_field_and_values() {
        let job =
            json!({"seed": 1, "mix": {"volume_fraction": 0.5, "d_min_mm": 2.0, "gap_mm": [1, 2, 3, 4]}});
        let checkpoint = json!({"seed": 1, "mix": {"volume_fraction": 0.6, "gap_mm": [1, 2, 3]}, "distance": {"gap_mm": 1}});
        assert_eq!(
            differences(&job, "the job", &checkpoint, "the checkpoint"),
            [
                "/mix/volume_fraction is 0.5 in the job and 0.6 in the checkpoint",
                "/mix/d_min_mm is 2.0 in the job and absent in the checkpoint",
                "/mix/gap_mm is a list of 4 in the job and [1,2,3] in the checkpoint",
                "/distance is absent in the job and {\"gap_mm\":1} in the checkpoint",
            ]
        );
    }

    #[test]
    fn of_many_the_first_are_shown() {
        let list = |x: i32| json!({"a": x, "b": x, "c": x, "d": x, "e": x, "f/g": x, "h": x});
        let found = differences(&list(1), "one", &list(2), "two");
        assert_eq!(found.len(), 6);
        assert_eq!(found[5], "and 2 more");
    }
}
