//! The model against the studies it was fitted to, and against those it was not.

#![allow(clippy::unwrap_used)]

use serde::Deserialize;
use serde_json::{Value, json};

use super::*;
use crate::request::VolumeFraction;

/// Tables of studies that were run; `docs/estimates.md` says how.
const DATA: &str = include_str!("../../../docs/estimates/data.json");

#[derive(Deserialize)]
struct Study {
    case: String,
    fitted: bool,
    template: Value,
    rows: Vec<Row>,
}

#[derive(Deserialize)]
struct Row {
    method: String,
    volume_fraction: f64,
    runs: u64,
    succeeded: u64,
    events_per_grain: Option<f64>,
    time_s: Option<f64>,
}

fn studies() -> Vec<Study> {
    serde_json::from_str(DATA).unwrap()
}

/// The plan of a row, with no limits on the method.
fn plan_of(study: &Study, row: &Row) -> Plan {
    let mut request = study.template.clone();
    request["mix"]["volume_fraction"] = json!(row.volume_fraction);
    request["method"] = json!({"type": row.method});
    Plan::new(&PackingRequest::from_json(&request, 1).unwrap(), &Limits::default()).unwrap()
}

#[test]
fn estimates_hold_where_they_were_not_fitted() {
    let mut times = 0;
    for study in studies().iter().filter(|study| !study.fitted) {
        for row in &study.rows {
            let plan = plan_of(study, row);
            let likely = if row.method == "rsa" { plan.methods.rsa } else { plan.methods.growth };
            let what = format!("{} {} {}", study.case, row.method, row.volume_fraction);
            assert!(plan.extrapolations.is_empty(), "{what}: {:?}", plan.extrapolations);
            if row.succeeded == 0 {
                assert!(likely.success_probability < 0.9, "{what}: {likely:?}");
            } else if row.succeeded == row.runs {
                assert!(likely.success_probability > 0.1, "{what}: {likely:?}");
            }
            // Shorter runs are over before anyone asks.
            if let Some(time_s) = row.time_s.filter(|time_s| *time_s > 0.03) {
                let off = (likely.time_s / time_s).ln().abs();
                times += 1;
                assert!(off < 2.0_f64.ln(), "{what}: {:.3} s for {time_s:.3} s", likely.time_s);
            }
        }
    }
    assert!(times > 40, "{times} times");
}

#[test]
fn estimates_follow_the_studies_they_were_fitted_to() {
    let mut squares = Vec::new();
    for study in studies().iter().filter(|study| study.fitted) {
        for row in &study.rows {
            let plan = plan_of(study, row);
            let likely = if row.method == "rsa" { plan.methods.rsa } else { plan.methods.growth };
            if let (Some(time_s), true) = (row.time_s.filter(|t| *t > 0.03), row.succeeded == row.runs) {
                squares.push((likely.time_s / time_s).ln().powi(2));
            }
            if row.method == "rsa" && likely.success_probability > 0.99 {
                assert!(row.succeeded > 0, "{} at {}", study.case, row.volume_fraction);
            }
        }
    }
    let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    assert!(rms < 0.5, "times are off by a factor of {:.2} in the mean", rms.exp());
}

#[test]
fn events_follow_the_studies() {
    for study in studies() {
        for row in study.rows.iter().filter(|row| row.succeeded == row.runs) {
            let Some(events) = row.events_per_grain.filter(|events| *events > 20.0) else { continue };
            let mut request = study.template.clone();
            request["mix"]["volume_fraction"] = json!(row.volume_fraction);
            let request = PackingRequest::from_json(&request, 1).unwrap();
            let mix = GradedMix::new(&request.mix, request.specimen.volume_mm3());
            let rule = DistanceRule::new(&request.distance, &request.specimen);
            let case = Case::of_mix(&request, &mix, &rule);
            let filled = case.filled;
            let expected = case.features.events_per_grain(filled, case.grains);
            let off = (expected / events).ln();
            let bound = if study.fitted { 1.2 } else { 2.0_f64.ln() };
            assert!(
                off.abs() < bound,
                "{} {}: {expected:.0} for {events:.0}",
                study.case,
                row.volume_fraction
            );
        }
    }
}

#[test]
fn a_proposal_is_likely() {
    let request = |fraction: f64, distance: Value| {
        json!({"specimen": {"type": "box", "size_mm": [80, 80, 80]},
            "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2, "volume_fraction": fraction},
            "distance": distance, "method": {"type": "edmd"}})
    };
    let plan = |value: &Value| {
        let request = PackingRequest::from_json(value, 1).unwrap();
        Plan::new(&request, &Limits::default()).unwrap().with_proposal(&request)
    };
    let constant = |mm: f64| json!({"type": "constant", "gap_mm": mm});
    let dense = plan(&request(0.57, constant(1.0)));
    assert!(dense.success_probability < 0.5, "{dense:?}");
    assert!(dense.warnings.iter().any(|w| w.starts_with("growth is unlikely")), "{:?}", dense.warnings);
    let phi = dense.proposal.unwrap().volume_fraction.unwrap();
    // The paper ends at 0.535 here; of four seeds all reach 0.55 in 11 to 15 s, and none 0.555 in 120 s.
    assert!((0.53..0.555).contains(&phi), "{phi}");
    assert!(plan(&request(phi, constant(1.0))).success_probability > 0.85);
    let mm = dense.proposal.unwrap().distance_mm.unwrap();
    assert!((0.7..1.0).contains(&mm), "{mm}");
    assert!(plan(&request(0.57, constant(mm))).success_probability > 0.85);
}

/// Mixes of 3 to 535 spheres whose reach of growth was bisected (`docs/estimates.md`, "The data").
#[test]
fn growth_of_few_grains_reaches_what_was_found() {
    const REACHES: &str = include_str!("../../../docs/estimates/reach.jsonl");
    let mut errors = Vec::new();
    for row in REACHES.lines().map(|line| serde_json::from_str::<Value>(line).unwrap()) {
        if row["what"] == "few-events" {
            let request = PackingRequest::from_json(&row["request"], 1).unwrap();
            let growth = Plan::new(&request, &Limits::default()).unwrap().methods.growth;
            errors.push(growth.volume_fraction_with_coating_reach - row["reach"].as_f64().unwrap());
        }
    }
    assert_eq!(errors.len(), 21);
    errors.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
    assert!(errors[10].abs() < 0.02 && errors[20].abs() < 0.09, "{errors:?}");
    // Without the term for very few grains eleven are more than 0.02 too high.
    assert!(errors.iter().filter(|error| **error > 0.02).count() <= 8, "{errors:?}");
}

#[test]
fn a_proposal_of_few_grains_has_a_margin() {
    // Of six spheres with their gaps 0.4066 was not reached, of ten 0.388 (draw 42 of the benchmark).
    let few = |size_mm: Value, grading: Value, d_min_mm: f64, gap_mm: f64| {
        let value = json!({
            "specimen": {"type": "box", "size_mm": size_mm},
            "mix": {"grading": grading, "allow_coarse": true, "d_min_mm": d_min_mm, "volume_fraction": 0.05,
                "volume_fraction_of": "placed_grains"},
            "distance": {"type": "constant", "gap_mm": gap_mm},
            "method": {"type": "edmd"},
        });
        let request = PackingRequest::from_json(&value, 1).unwrap();
        let plan = Plan::new(&request, &Limits::default()).unwrap().with_proposal(&request);
        let mut proposed = request.clone();
        proposed.mix.volume_fraction =
            Some(VolumeFraction::Of(plan.proposal.unwrap().volume_fraction.unwrap()));
        let proposed = Plan::new(&proposed, &Limits::default()).unwrap();
        assert!((0.88..0.92).contains(&proposed.success_probability), "{proposed:?}");
        let reach = proposed.methods.growth.volume_fraction_with_coating_reach;
        (proposed.volume_fraction_with_coating, reach)
    };
    let sieves =
        json!({"type": "sieves", "points": [[2.0, 0.0], [2.908, 0.103], [4.629, 0.103], [6.731, 1.0]]});
    for (at, reach) in [
        few(json!([69.55, 69.55, 69.55]), json!({"type": "standard", "name": "B32"}), 17.556, 10.636),
        few(json!([49.154, 37.252, 14.808]), sieves, 5.972, 4.887),
    ] {
        assert!(at < reach - 0.015, "{at} {reach}");
    }
}

#[test]
fn a_proposal_of_a_loose_request_is_that_of_a_dense_one() {
    // From 0.2 to what is reached the number of grains triples, and with it what they reach.
    for method in ["rsa", "edmd"] {
        let proposed = |fraction: f64| {
            let value = json!({
                "specimen": {"type": "box", "size_mm": [40, 40, 40]},
                "mix": {"grading": {"type": "fuller", "d_max_mm": 8, "exponent": 0.5}, "d_min_mm": 4,
                    "volume_fraction": fraction, "volume_fraction_of": "placed_grains"},
                "method": {"type": method},
            });
            let request = PackingRequest::from_json(&value, 1).unwrap();
            let plan = Plan::new(&request, &Limits::default()).unwrap().with_proposal(&request);
            (plan.success_probability, plan.proposal.unwrap().volume_fraction.unwrap())
        };
        let (loose, dense) = (proposed(0.2).1, proposed(0.45).1);
        assert!((loose / dense - 1.0).abs() < 0.004, "{method}: {loose} {dense}");
        let probability = proposed(loose).0;
        assert!((0.88..0.93).contains(&probability), "{method}: {probability}");
    }
}

#[test]
fn what_was_not_studied_is_said() {
    let beyond = |value: &Value| {
        Plan::new(&PackingRequest::from_json(value, 1).unwrap(), &Limits::default()).unwrap().extrapolations
    };
    let mix = json!({"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": 2,
        "volume_fraction": 0.5, "volume_fraction_of": "placed_grains"});
    let cube = json!({"type": "box", "size_mm": [80, 80, 80]});
    assert!(beyond(&json!({"specimen": cube, "mix": mix})).is_empty());
    let few = beyond(&json!({"specimen": {"type": "box", "size_mm": [20, 20, 20]}, "mix": mix}));
    assert!(few.iter().any(|w| w.contains("grains (300 to")), "{few:?}");
    let attempts =
        json!({"specimen": cube, "mix": mix, "method": {"type": "rsa", "attempts_per_grain": 1000}});
    assert_eq!(beyond(&attempts), ["a number of attempts per grain"]);
    let slow = json!({"specimen": cube, "mix": mix, "method": {"type": "edmd", "growth_rate": 0.01}});
    assert!(beyond(&slow)[0].contains("options of growth"));
}

#[test]
fn spheres_that_grow_by_moves_are_planned_as_such() {
    let plan = |method: &str| {
        let value = json!({
            "specimen": {"type": "box", "size_mm": [80, 80, 80]},
            "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": 2,
                "volume_fraction": 0.66, "volume_fraction_of": "placed_grains"},
            "method": {"type": method},
        });
        Plan::new(&PackingRequest::from_json(&value, 1).unwrap(), &Limits::default()).unwrap()
    };
    let [events, growth, moves] = ["edmd", "growth", "monte_carlo"].map(plan);
    assert_eq!(growth, events);
    assert!(moves.estimated_time_s > events.estimated_time_s, "{moves:?}");
    assert_eq!(moves.methods.rsa, events.methods.rsa);
    assert!(moves.extrapolations.iter().any(|w| w.contains("spheres that grow by moves")), "{moves:?}");
    assert!(moves.most_threads == 1 && moves.keeps_checkpoints);
}
