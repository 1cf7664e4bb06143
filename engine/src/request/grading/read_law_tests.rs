#![allow(clippy::unwrap_used, clippy::disallowed_methods, clippy::needless_pass_by_value)]

use serde_json::{Value, json};

use crate::request::PackingRequest;

fn stored(grading: Value) -> Result<Value, String> {
    let request = json!({
        "specimen": {"type": "box", "size_mm": [200, 200, 200]},
        "mix": {"grading": grading, "volume_fraction": 0.3},
    });
    match PackingRequest::from_json(&request, 1) {
        Ok(request) => Ok(serde_json::to_value(request.mix.grading.unwrap()).unwrap()),
        Err(faults) => Err(faults.into_iter().map(|fault| fault.to_string()).collect::<Vec<_>>().join("; ")),
    }
}

#[test]
fn bounds_that_are_absent_are_quantiles_and_are_said() {
    let law = stored(json!({"type": "lognormal", "median_mm": 8, "sigma": 0.5})).unwrap();
    let factor = (3.090_232_306_167_813_f64 * 0.5).exp();
    assert!((law["d_min_mm"].as_f64().unwrap() * factor / 8.0 - 1.0).abs() < 1e-12, "{law}");
    assert!((law["d_max_mm"].as_f64().unwrap() / factor / 8.0 - 1.0).abs() < 1e-12, "{law}");
    assert_eq!(law["by"], "mass");
    // What is stored reads as itself.
    assert_eq!(stored(law.clone()).unwrap(), law);
    let weibull = stored(json!({"type": "weibull", "scale_mm": 8, "shape": 2, "d_max_mm": 16})).unwrap();
    let low = 8.0 * (-(0.999_f64.ln())).sqrt();
    assert!((weibull["d_min_mm"].as_f64().unwrap() / low - 1.0).abs() < 1e-12, "{weibull}");
    let said = |grading: Value| {
        let request = json!({
            "specimen": {"type": "box", "size_mm": [200, 200, 200]},
            "mix": {"grading": grading, "volume_fraction": 0.3},
        });
        PackingRequest::from_json(&request, 1).unwrap().mix.grading.unwrap().completions(0.0, f64::INFINITY)
    };
    let notes = said(json!({"type": "normal", "mean_mm": 8, "standard_deviation_mm": 1, "d_max_mm": 10}));
    assert_eq!(
        notes,
        ["the law is cut off at its d_min_mm, 4.9098 mm, which 0.1 % of the mass is finer than"]
    );
    assert!(said(weibull).iter().any(|note| note.contains("d_min_mm")));
}

#[test]
fn faults_name_the_field_and_what_to_change() {
    for (grading, says) in [
        (json!({"type": "lognormal", "median_mm": 8}), "/mix/grading/sigma"),
        (json!({"type": "lognormal", "median_mm": 8, "sigma": 5}), "at most 3"),
        (json!({"type": "lognormal", "median_mm": 8, "sigma": 0.2, "by": "volume"}), "\"mass\", \"number\""),
        (
            json!({"type": "lognormal", "median_mm": 8, "sigma": 0.2, "d_min_mm": 900, "d_max_mm": 950}),
            "less than 1e-9 of the law",
        ),
        (
            json!({"type": "lognormal", "median_mm": 8, "sigma": 0.2, "d_min_mm": 9, "d_max_mm": 7}),
            "must be less",
        ),
        (json!({"type": "normal", "mean_mm": 8, "standard_deviation_mm": 3}), "must have a d_min_mm"),
        (json!({"type": "normal", "mean_mm": 8, "standard_deviation_mm": 0.001}), "0.001 of the mean"),
        (json!({"type": "weibull", "scale_mm": 1e6, "shape": 0.2}), "name a d_min_mm of 1e-6 to"),
        (
            json!({"type": "lognormal", "median_mm": 8, "sigma": 0.3, "d_min_mm": 30}),
            "/mix/grading/d_min_mm: d_min_mm 30 must be less than d_max_mm 20.2",
        ),
        (
            json!({"type": "normal", "mean_mm": 4, "standard_deviation_mm": 0.004, "d_min_mm": 7.9, "d_max_mm": 8.1}),
            "less than 1e-9",
        ),
        (
            json!({"type": "weibull", "scale_mm": 2.5, "shape": 3, "d_min_mm": 7.8, "d_max_mm": 8.2}),
            "less than 1e-9",
        ),
        (json!({"type": "standard", "name": "57"}), "name it as `standard`, for example \"ASTM C33\""),
        (json!({"type": "andreasen", "d_min_mm": 16, "d_max_mm": 8, "exponent": 0.3}), "must be less"),
        (json!({"type": "bolomey", "d_max_mm": 16, "a_percent": 60}), "at most 50"),
        (
            json!({"type": "faury", "d_max_mm": 120, "a_percent": 60}),
            "must be more than 0 and less than 100 %",
        ),
        (json!({"type": "faury", "d_max_mm": 32, "a_percent": 24, "mould_radius_mm": 20}), "0.75"),
        (
            json!({"type": "dreux_gorisse", "d_max_mm": 16, "k_percent": 0, "d_min_mm": 9}),
            "where the curve bends",
        ),
        (json!({"type": "sizes", "sizes": []}), "at least 1"),
        (json!({"type": "sizes", "sizes": [{"diameter_mm": 4, "share": 0}]}), "/mix/grading/sizes/0/share"),
        (
            json!({"type": "sizes", "sizes": [{"diameter_mm": 4, "share": 1}, {"diameter_mm": 4, "share": 2}]}),
            "stands twice",
        ),
    ] {
        let fault = stored(grading).unwrap_err();
        assert!(fault.contains(says), "{says}: {fault}");
    }
}

/// A fault of one field does not make the others unknown.
#[test]
fn a_law_with_a_fault_has_this_fault_alone() {
    let law = json!({
        "type": "normal", "mean_mm": 8, "standard_deviation_mm": 0.001, "by": "number", "d_min_mm": 7, "d_max_mm": 9,
    });
    let fault = stored(law).unwrap_err();
    assert!(!fault.contains("; ") && fault.contains("0.001 of the mean"), "{fault}");
}

#[test]
fn one_size_stands_for_a_list_of_one() {
    let sizes = stored(json!({"type": "sizes", "sizes": {"diameter_mm": 8, "share": 120}})).unwrap();
    assert_eq!(
        sizes,
        json!({"type": "sizes", "sizes": [{"diameter_mm": 8.0, "share": 120.0}], "by": "mass"})
    );
}
