#![allow(clippy::unwrap_used)]

use serde_json::{Value, json};

use super::*;

fn plan(value: &Value) -> Result<Plan, PlanError> {
    Plan::new(&PackingRequest::from_json(value, 1).unwrap(), &Limits::default())
}

fn box_of(size: f64, mix: &Value, distance: &Value) -> Value {
    json!({"specimen": {"type": "box", "size_mm": [size, size, size]}, "mix": mix, "distance": distance})
}

fn standard(name: &str, d_min: f64, fraction: f64) -> Value {
    json!({"grading": {"type": "standard", "name": name}, "d_min_mm": d_min, "volume_fraction": fraction})
}

#[test]
fn a_plan_states_the_known_figures() {
    let plan = plan(&box_of(150.0, &standard("A16", 2.0, 0.70), &json!({"type": "none"}))).unwrap();
    assert!((plan.grains - 44_202.0).abs() < 0.5);
    assert!((plan.volume_fraction_effective - 0.553).abs() < 1e-9);
    assert!((plan.classes.iter().map(|c| c.grains).sum::<f64>() - plan.grains).abs() < 1e-6);
    assert!(plan.warnings.is_empty(), "{:?}", plan.warnings);
}

#[test]
fn a_distance_to_walls_that_are_none_is_a_warning() {
    for distance in [
        json!({"type": "none", "wall_gap_mm": 0}),
        json!({"type": "constant", "gap_mm": 0.5, "wall_gap_mm": 1.5}),
        json!({"type": "proportional", "factor": 0.01, "wall_gap_mm": 1.5}),
        json!({"type": "smaller_diameter", "factor": 0.01, "wall_gap_mm": 1.5}),
        json!({"type": "maximize", "wall_gap_mm": 1.5}),
    ] {
        let mut value = box_of(150.0, &standard("A16", 4.0, 0.3), &distance);
        value["method"] = json!({"type": "edmd"});
        let warned = |value: &Value| {
            let warnings = plan(value).unwrap().warnings;
            warnings.iter().any(|w| w.ends_with("has no effect: a periodic box has no walls"))
        };
        assert!(!warned(&value), "{distance}");
        value["specimen"]["boundary"] = json!("periodic");
        assert!(warned(&value), "{distance}");
        if let Some(distance) = value["distance"].as_object_mut() {
            distance.remove("wall_gap_mm");
        }
        assert!(!warned(&value), "{distance}");
    }
}

#[test]
fn coating_counts_the_distance() {
    // The paper's 6.3: phi_M 0.535 with 1 mm is 0.693 with the coating.
    let plan = plan(&box_of(80.0, &standard("A16", 2.0, 0.535), &json!({"type": "constant", "gap_mm": 1.0})))
        .unwrap();
    assert!(
        (plan.volume_fraction_with_coating - 0.693).abs() < 0.001,
        "{}",
        plan.volume_fraction_with_coating
    );
    // Growth reaches it, random sequential addition does not.
    assert!(plan.success_probability > 0.9 && plan.warnings.is_empty(), "{plan:?}");
    assert!(plan.methods.rsa.success_probability < 1e-3, "{:?}", plan.methods.rsa);
    let mut by_rsa = box_of(80.0, &standard("A16", 2.0, 0.535), &json!({"type": "constant", "gap_mm": 1.0}));
    by_rsa["method"] = json!({"type": "rsa"});
    let warnings = self::plan(&by_rsa).unwrap().warnings;
    assert!(warnings[0].starts_with("random sequential addition is unlikely"), "{warnings:?}");
}

#[test]
fn a_grain_larger_than_the_specimen_is_refused_with_its_field() {
    let refused = |value: &Value| match plan(value) {
        Err(PlanError::Invalid(faults)) => faults[0].clone(),
        other => panic!("{other:?}"),
    };
    let fault = refused(&box_of(15.0, &standard("A16", 2.0, 0.3), &json!({"type": "none"})));
    assert_eq!(fault.pointer, "/specimen/size_mm/0");
    assert!(fault.detail.contains("15 mm") && fault.detail.contains("16 mm"), "{}", fault.detail);
    let coated = box_of(16.5, &standard("A16", 2.0, 0.3), &json!({"type": "constant", "gap_mm": 1.0}));
    assert!(refused(&coated).detail.contains("17 mm with its distance"));
    let cylinder = json!({"specimen": {"type": "cylinder", "diameter_mm": 100, "height_mm": 10}, "mix": standard("A16", 2.0, 0.3)});
    assert_eq!(refused(&cylinder).pointer, "/specimen/height_mm");
}

#[test]
fn more_grains_or_memory_than_allowed_are_refused_with_the_number() {
    let many = box_of(150.0, &standard("B16", 0.25, 0.9), &json!({"type": "none"}));
    let Err(PlanError::TooLarge(fault)) = plan(&many) else { panic!() };
    assert_eq!(fault.pointer, "/mix/d_min_mm");
    assert!(fault.detail.contains("must be at most 20000000"), "{}", fault.detail);
    let limits = Limits { max_memory_bytes: 100_000_000, ..Limits::default() };
    let request =
        PackingRequest::from_json(&box_of(150.0, &standard("B16", 0.5, 0.7), &json!({"type": "none"})), 1)
            .unwrap();
    let Err(PlanError::TooLarge(fault)) = Plan::new(&request, &limits) else { panic!() };
    assert!(fault.detail.contains("memory: must be at most 100000000"), "{}", fault.detail);
}

#[test]
fn what_no_packing_reaches_is_infeasible_and_says_why() {
    let infeasible = |value: &Value| match plan(value) {
        Err(PlanError::Infeasible(fault)) => fault,
        other => panic!("{other:?}"),
    };
    let equal = |fraction: f64| {
        box_of(
            80.0,
            &json!({"grading": {"type": "monodisperse", "diameter_mm": 5}, "volume_fraction": fraction}),
            &json!({"type": "none"}),
        )
    };
    assert!(plan(&equal(0.74)).is_ok());
    let fault = infeasible(&equal(0.75));
    assert_eq!(fault.pointer, "/mix/volume_fraction");
    assert!(fault.detail.contains("0.7500") && fault.detail.contains("0.7405"), "{}", fault.detail);
    let coated =
        infeasible(&box_of(80.0, &standard("A16", 2.0, 0.7), &json!({"type": "constant", "gap_mm": 4.0})));
    assert!(coated.detail.contains("with the distance as a coating"), "{}", coated.detail);
    let list = box_of(
        20.0,
        &json!({"grading": {"type": "diameters", "diameters_mm": vec![10.0; 20]}}),
        &json!({"type": "none"}),
    );
    assert_eq!(infeasible(&list).pointer, "/mix/grading/diameters_mm");
}

#[test]
fn walls_that_ask_for_less_than_half_the_distance_leave_more_room() {
    let mix = json!({"grading": {"type": "diameters", "diameters_mm": vec![4.0; 8]}});
    // Eight grains of 4 mm, 2 mm apart, fill a cube of 10 mm to the walls: (4 + 2 + 4)^3.
    let request = box_of(10.0, &mix, &json!({"type": "constant", "gap_mm": 2.0, "wall_gap_mm": 0.0}));
    assert!(plan(&request).is_ok(), "{:?}", plan(&request));
}

#[test]
fn a_cut_off_that_leaves_nothing_is_refused() {
    let mut mix = json!({
        "grading": {"type": "sieves", "points": [[2, 0.0], [8, 1.0], [16, 1.0]]}, "d_min_mm": 9,
        "volume_fraction": 0.3
    });
    for basis in ["all_aggregate", "placed_grains"] {
        mix["volume_fraction_of"] = json!(basis);
        let Err(PlanError::Invalid(faults)) = plan(&box_of(80.0, &mix, &json!({"type": "none"}))) else {
            panic!("{basis}")
        };
        assert_eq!(faults[0].pointer, "/mix/d_min_mm");
        assert!(faults[0].detail.contains("9 mm leaves less than"), "{}", faults[0].detail);
    }
}

#[test]
fn threads_have_work_where_many_grains_are_placed_at_random_or_grow() {
    let most = |d_min_mm: f64, volume_fraction: f64, method: &str| {
        let request = json!({
            "specimen": {"type": "box", "size_mm": [60, 60, 60]},
            "mix": {"grading": {"type": "standard", "name": "B16"}, "d_min_mm": d_min_mm,
                    "volume_fraction": volume_fraction},
            "method": {"type": method},
        });
        let request = PackingRequest::from_json(&request, 1).unwrap();
        Plan::new(&request, &Limits::default()).unwrap().most_threads
    };
    assert_eq!(most(0.5, 0.6, "rsa"), 64);
    assert_eq!(most(0.5, 0.6, "auto"), 64);
    assert_eq!(most(0.5, 0.6, "edmd"), 4);
    assert_eq!(most(2.0, 0.6, "edmd"), 1);
    assert_eq!(most(0.5, 0.6, "monte_carlo"), 4);
    assert_eq!(most(2.0, 0.6, "monte_carlo"), 1);
    assert_eq!(most(2.0, 0.6, "rsa"), 1);
}

/// `repairs.md` A1: the run proves that nothing fits from 0.569 on.
#[test]
fn ballast_is_forecast_from_its_sizes() {
    let value = json!({
        "specimen": {"type": "box", "size_mm": [450, 450, 450]},
        "mix": {
            "grading": {"type": "sieves", "points": [
                [9.5, 0.015], [19.05, 0.05], [25.4, 0.22], [38.1, 0.75], [50.8, 0.95], [63.5, 1],
            ]},
            "d_min_mm": 9.5, "volume_fraction": 0.6, "volume_fraction_of": "placed_grains",
        },
        "method": {"type": "rsa"},
    });
    let plan = plan(&value).unwrap();
    assert!(plan.success_probability < 0.05, "{plan:?}");
    let reach = plan.methods.rsa.volume_fraction_with_coating_reach;
    assert!((0.53..0.58).contains(&reach), "{reach}");
}

/// `repairs.md` A3: the start of growth to the largest distance is a small part of the work.
#[test]
fn growth_without_a_target_is_expected_to_go_on_until_grains_jam() {
    let mut value = box_of(70.0, &standard("A16", 2.0, 0.6), &json!({"type": "maximize"}));
    value["method"] = json!({"type": "edmd", "stop": {"time_s": 60}});
    let growth = plan(&value).unwrap().growth;
    assert!(growth.events_per_grain > 100.0 * growth.start_work, "{growth:?}");
}

/// Times follow from the speed of the processor and end with the limit of the request; nothing else does.
#[test]
fn a_plan_on_another_processor_has_other_times_alone() {
    let mut value = box_of(80.0, &standard("A16", 2.0, 0.8), &json!({"type": "none"}));
    for method in ["auto", "rsa", "edmd", "monte_carlo"] {
        value["method"] = json!({"type": method});
        let request = PackingRequest::from_json(&value, 1).unwrap();
        let plan = Plan::new(&request, &Limits::default()).unwrap();
        let slow = plan.clone().at_speed(&request, 0.25);
        let close = |time_s: f64, other_s: f64| (time_s / other_s - 1.0).abs() < 1e-9;
        assert!(close(slow.estimated_time_s, 4.0 * plan.estimated_time_s), "{method}");
        assert!(close(slow.methods.rsa.time_s, 4.0 * plan.methods.rsa.time_s), "{method}");
        assert_eq!(slow.methods.rsa.operations, plan.methods.rsa.operations);
        assert_eq!(slow.methods.growth.operations, plan.methods.growth.operations);
        assert_eq!(slow.clone().at_speed(&request, 1.0), plan);
    }
    value["method"] = json!({"type": "edmd", "stop": {"time_s": 0.01}});
    let request = PackingRequest::from_json(&value, 1).unwrap();
    let plan = Plan::new(&request, &Limits::default()).unwrap();
    assert_eq!([1.0, 1e-3].map(|speed| plan.clone().at_speed(&request, speed).estimated_time_s), [0.01; 2]);
}

/// A loose mix is added at random, and the most that `auto` packs is what growth reaches.
#[test]
fn a_proposal_of_auto_is_what_the_better_method_reaches() {
    let proposed = |method: &str| {
        let mut value = box_of(80.0, &standard("A16", 2.0, 0.3), &json!({"type": "none"}));
        value["mix"]["volume_fraction_of"] = json!("placed_grains");
        value["method"] = json!({"type": method});
        let request = PackingRequest::from_json(&value, 1).unwrap();
        let plan = Plan::new(&request, &Limits::default()).unwrap().with_proposal(&request);
        (plan.proposal.unwrap().volume_fraction.unwrap(), plan)
    };
    let [(by_auto, auto), (by_rsa, rsa), (by_growth, _)] = ["auto", "rsa", "growth"].map(proposed);
    assert!(auto.places_first && by_auto == by_growth && by_growth > by_rsa + 0.03, "{by_auto} {by_rsa}");
    // The reach has no margin for the error of the forecast, the proposal has.
    let reach = rsa.methods.rsa.volume_fraction_with_coating_reach;
    assert!(by_rsa < reach && by_rsa > reach - 0.02, "{by_rsa} {reach}");
}
