#![allow(clippy::unwrap_used)]

use serde_json::{Value, json};

use super::*;
use crate::request::PackingRequest;

fn request(specimen: &Value, placement: &Value) -> Value {
    json!({
        "specimen": specimen, "segregation": placement,
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2},
    })
}

fn cube() -> Value {
    json!({"type": "box", "size_mm": [50, 50, 50]})
}

fn cylinder() -> Value {
    json!({"type": "cylinder", "diameter_mm": 50, "height_mm": 50})
}

fn gradient(field: &Value) -> Value {
    json!({"type": "gradient", "field": field, "strength": 5})
}

fn read(specimen: &Value, placement: &Value) -> Result<Segregation, Vec<String>> {
    PackingRequest::from_json(&request(specimen, placement), 1)
        .map(|request| request.segregation)
        .map_err(|faults| faults.iter().map(ToString::to_string).collect())
}

#[test]
fn random_is_what_is_absent_and_is_not_written() {
    for placement in [Value::Null, json!({"type": "none"})] {
        let read = PackingRequest::from_json(&request(&cube(), &placement), 1).unwrap();
        assert_eq!(read.segregation, Segregation::None {});
        assert_eq!(serde_json::to_value(&read).unwrap().get("segregation"), None);
    }
}

#[test]
fn gradients_are_written_as_they_are_read_with_their_defaults() {
    for (specimen, field, written) in [
        (
            cube(),
            json!({"type": "linear", "axis": "x"}),
            json!({"type": "linear", "axis": "x", "direction": "down"}),
        ),
        (
            cylinder(),
            json!({"type": "linear", "axis": "y", "direction": "up"}),
            json!({"type": "linear", "axis": "y", "direction": "up"}),
        ),
        (cube(), json!({"type": "face", "face": "y_max"}), json!({"type": "face", "face": "y_max"})),
        (cylinder(), json!({"type": "face", "face": "side"}), json!({"type": "face", "face": "side"})),
    ] {
        let first = PackingRequest::from_json(&request(&specimen, &gradient(&field)), 1).unwrap();
        let text = serde_json::to_value(&first).unwrap();
        assert_eq!(text["segregation"]["field"], written);
        assert_eq!(PackingRequest::from_json(&text, 2).unwrap(), first);
    }
}

#[test]
fn every_fault_names_its_place_and_what_would_do() {
    let periodic = json!({"type": "box", "size_mm": [50, 50, 50], "boundary": "periodic"});
    let linear = json!({"type": "linear", "axis": "z"});
    let cases: [(Value, Value, &str); 8] = [
        (
            cube(),
            json!({"type": "sorted"}),
            "/segregation/type: \"sorted\" is unknown: must be one of \"none\", \"gradient\"",
        ),
        (
            cube(),
            json!({"type": "none", "strength": 1}),
            "/segregation/strength: unknown field: this object has type",
        ),
        (
            cube(),
            json!({"type": "gradient", "field": linear, "strength": -1}),
            "/segregation/strength: -1 is out of range: must be at least 0 and at most 1000",
        ),
        (
            cube(),
            gradient(&json!({"type": "linear", "axis": "w"})),
            "/segregation/field/axis: \"w\" is unknown: must be one of \"x\", \"y\", \"z\"",
        ),
        (
            cylinder(),
            gradient(&json!({"type": "face", "face": "x_min"})),
            "/segregation/field/face: \"x_min\" is unknown: must be one of \"z_min\", \"z_max\", \"side\"",
        ),
        (
            cube(),
            gradient(&json!({"type": "face", "face": "side"})),
            "/segregation/field/face: \"side\" is unknown: must be one of \"x_min\", \"x_max\", \"y_min\", \"y_max\", \
             \"z_min\", \"z_max\"",
        ),
        (
            periodic,
            gradient(&linear),
            "/segregation/field: a periodic box has no ends at which grains could gather: a gradient needs walls",
        ),
        (
            cube(),
            json!({"type": "gradient", "strength": 1}),
            "/segregation/field: is missing: the field is required",
        ),
    ];
    for (specimen, placement, message) in cases {
        assert_eq!(read(&specimen, &placement), Err(vec![message.to_owned()]));
    }
}
