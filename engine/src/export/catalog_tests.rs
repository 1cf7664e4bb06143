#![allow(clippy::unwrap_used)]

use serde_json::json;

use super::*;

fn said(faults: &[FieldError]) -> Vec<String> {
    faults.iter().map(ToString::to_string).collect()
}

#[test]
fn every_type_is_found_by_its_name_and_has_its_formats() {
    for kind in ExportType::ALL {
        assert_eq!(ExportType::from_name(kind.name()), Some(kind));
        assert_eq!(json!(kind), kind.name());
        let plain = ExportRequest::from_json(&json!({"type": kind.name()})).unwrap();
        assert_eq!(plain.export_type(), kind, "every option has a default");
        assert_eq!(kind.formats()[0], plain.format(), "the first format is the default");
        for format in kind.formats() {
            let export = ExportRequest::from_text(kind, [("format", *format)]).unwrap();
            let stored = serde_json::to_value(&export).unwrap();
            assert_eq!((&stored["type"], &stored["format"]), (&json!(kind.name()), &json!(format)));
            assert_eq!(ExportRequest::from_json(&stored).unwrap(), export, "the stored form reads back");
        }
        assert_eq!(ExportRequest::from_text(kind, []).unwrap(), plain);
        let stored = serde_json::to_value(&plain).unwrap();
        assert_eq!(stored["type"], kind.name());
        assert_eq!(ExportRequest::from_json(&stored).unwrap(), plain, "the stored form reads back");
        assert!(plain.media_type().contains('/') && !plain.file_extension().contains('.'), "{}", kind.name());
    }
    assert_eq!(ExportType::from_name("Slice"), None);
}

#[test]
fn what_comes_as_text_is_what_comes_as_json() {
    for (text, value) in [
        ("16", json!(16)),
        ("-1.5e3", json!(-1500.0)),
        ("true", json!(true)),
        ("z", json!("z")),
        ("", json!("")),
        ("1.2.3", json!("1.2.3")),
        ("[1, 2]", json!([1, 2])),
        ("{broken", json!("{broken")),
        ("trueish", json!("trueish")),
    ] {
        assert_eq!(value_of(text), value, "{text}");
    }
    let text = ExportRequest::from_text(ExportType::Slice, [("at_mm", "7.5"), ("format", "json")]);
    let value = ExportRequest::from_json(&json!({"type": "slice", "at_mm": 7.5, "format": "json"}));
    assert_eq!(text, value);
}

#[test]
fn faults_of_options_are_all_told_each_at_its_place() {
    let faults = ExportRequest::from_text(
        ExportType::Slice,
        [("format", "gif"), ("colour", "red"), ("at_mm", "1"), ("at_mm", "2")],
    )
    .unwrap_err();
    let said = said(&faults);
    assert!(
        said.iter().any(|fault| fault == "/at_mm: is given more than once: must be given once"),
        "{said:?}"
    );
    assert!(
        said.iter().any(|fault| fault.starts_with("/format: \"gif\" is unknown: must be one of")),
        "{said:?}"
    );
    assert!(said.iter().any(|fault| fault.starts_with("/colour: unknown option: slice has ")), "{said:?}");

    let faults = ExportRequest::from_json(&json!({"type": "sphere"})).unwrap_err();
    assert!(faults[0].to_string().starts_with("/type: \"sphere\" is unknown: must be one of"), "{faults:?}");
    let faults = ExportRequest::from_json(&json!({"type": "slice", "colour": "red"})).unwrap_err();
    assert!(
        faults[0].to_string().starts_with("/colour: unknown field: this object has type, "),
        "{faults:?}"
    );
}
