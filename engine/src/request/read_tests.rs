#![allow(clippy::unwrap_used, clippy::too_many_lines, clippy::semicolon_if_nothing_returned)]

use crate::properties::properties;
use proptest::prelude::*;
use serde_json::{Value, json};

use super::super::{DEFAULT_D_MIN_MM, Grading, GrowthOptions, GrowthStop, VolumeFraction};
use super::*;

fn valid() -> Value {
    json!({
        "seed": 7,
        "specimen": {"type": "box", "size_mm": [80, 80, 80], "boundary": "walls"},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2.0, "volume_fraction": 0.535, "volume_fraction_of": "all_aggregate"},
        "distance": {"type": "constant", "gap_mm": 1.0},
        "method": {"type": "rsa", "attempts_per_grain": 100_000},
    })
}

fn faults(change: impl FnOnce(&mut Value)) -> Vec<String> {
    let mut value = valid();
    change(&mut value);
    match PackingRequest::from_json(&value, 1) {
        Ok(request) => panic!("accepted: {request:?}"),
        Err(faults) => faults.iter().map(ToString::to_string).collect(),
    }
}

#[test]
fn a_request_is_written_as_it_is_read() {
    let request = PackingRequest::from_json(&valid(), 1).unwrap();
    let written = serde_json::to_value(&request).unwrap();
    assert_eq!(PackingRequest::from_json(&written, 2).unwrap(), request);
    assert_eq!(
        written["specimen"],
        json!({"type": "box", "size_mm": [80.0, 80.0, 80.0], "boundary": "walls"})
    );
    assert_eq!(written["seed"], 7);
}

#[test]
fn only_specimen_and_mix_are_required() {
    let value = json!({
        "specimen": {"type": "cylinder", "diameter_mm": 100, "height_mm": 200},
        "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "volume_fraction": 0.4},
    });
    let request = PackingRequest::from_json(&value, 42).unwrap();
    assert_eq!(request.seed, 42);
    assert_eq!(request.mix.d_min_mm, Some(DEFAULT_D_MIN_MM));
    assert_eq!(request.distance, Distance::None { wall_gap_mm: None });
    assert_eq!(request.method, Method::Auto {});
    let missing = PackingRequest::from_json(&json!({}), 1).unwrap_err();
    assert_eq!(missing.iter().map(|f| f.pointer.as_str()).collect::<Vec<_>>(), ["/specimen", "/mix"]);
}

#[test]
fn all_faults_of_a_document_are_reported_at_once() {
    let found = faults(|v| {
        v["seed"] = json!(-1);
        v["specimen"]["size_mm"] = json!([80, 0, -5]);
        v["mix"]["volume_fraction"] = json!(1.5);
        v["distance"]["type"] = json!("constnat");
        v["colour"] = json!("red");
    });
    let pointers: Vec<&str> = found.iter().map(|f| f.split(':').next().unwrap()).collect();
    assert_eq!(
        pointers,
        [
            "/seed",
            "/specimen/size_mm/1",
            "/specimen/size_mm/2",
            "/mix/volume_fraction",
            "/distance/type",
            "/colour"
        ]
    );
}

#[test]
fn every_fault_names_field_value_and_bound() {
    type Change = fn(&mut Value);
    let cases: Vec<(Change, &str)> = vec![
        (
            |v| v["seed"] = json!(1.0e16),
            "/seed: 1e+16 is out of range: must be a whole number from 0 to 9007199254740991",
        ),
        (
            |v| v["specimen"] = json!({"type": "sphere"}),
            "/specimen/type: \"sphere\" is unknown: must be one of \"box\", \"cylinder\"",
        ),
        (|v| v["specimen"] = json!([1, 2]), "/specimen: an array is not an object"),
        (
            |v| v["specimen"]["size_mm"] = json!([80, 80]),
            "/specimen/size_mm: has 2 items: must have exactly 3",
        ),
        (
            |v| v["specimen"]["size_mm"][0] = json!(2e6),
            "/specimen/size_mm/0: 2000000 is out of range: must be at least 1e-6 and at most 1000000 mm",
        ),
        (|v| v["specimen"]["size_mm"][0] = json!("80"), "/specimen/size_mm/0: \"80\" is not a number"),
        (
            |v| v["mix"]["volume_fraction"] = json!(0),
            "/mix/volume_fraction: 0 is out of range: must be at least 1e-9 and at most 1",
        ),
        (
            |v| v["mix"]["volume_fraction"] = Value::Null,
            "/mix/volume_fraction: is null: the field is required",
        ),
        (
            |v| v["mix"]["volume_fraction_of"] = json!("eff"),
            "/mix/volume_fraction_of: \"eff\" is unknown: must be one of \"all_aggregate\", \"placed_grains\"",
        ),
        (
            |v| v["mix"]["d_min_mm"] = json!(16),
            "/mix/d_min_mm: 16 is out of range: must be less than the largest diameter 16 mm",
        ),
        (
            |v| v["mix"]["d_min_mm"] = json!(0.1),
            "/mix/d_min_mm: 0.1 is out of range: must be at least 0.25 mm, below which the grading says nothing",
        ),
        (
            |v| v["mix"]["grading"]["name"] = json!("A17"),
            "/mix/grading/name: \"A17\" is unknown: must be one of \"A8\", \"B8\", \"C8\", \"A16\", \"B16\", \"C16\", \"A32\", \"B32\", \"C32\"",
        ),
        (
            |v| v["mix"]["grading"] = json!({"type": "fuller", "d_max_mm": 16, "exponent": 1.5}),
            "/mix/grading/exponent: 1.5 is out of range: must be at least 0.01 and at most 1",
        ),
        (
            |v| v["mix"] = json!({"grading": {"type": "fuller", "d_max_mm": 1.5, "exponent": 0.5}, "volume_fraction": 0.4}),
            "/mix/grading: the default d_min_mm 2 is not below the largest diameter 1.5 mm: name a d_min_mm",
        ),
        (
            |v| v["mix"]["grading"] = json!({"type": "sieves", "points": [[2, 0]]}),
            "/mix/grading/points: has 1 points: must have at least 2",
        ),
        (
            |v| v["mix"]["grading"] = json!({"type": "sieves", "points": [[2, 0], [2, 1]]}),
            "/mix/grading/points/1: the sieve 2 mm stands in two points: must stand in one",
        ),
        (
            |v| v["mix"]["grading"] = json!({"type": "sieves", "points": [[2, 0.5], [4, 0.4], [8, 1]]}),
            "/mix/grading/points/1: passing must not fall towards coarser sieves: 0.4 passes 4 mm, and 0.5 passes 2 mm",
        ),
        (
            |v| v["mix"]["grading"] = json!({"type": "sieves", "points": [[2, 0], [4, 120]]}),
            "/mix/grading/points/1/1: 120 is out of range: must be at least 0 and at most 100 (0 to 1, or percent)",
        ),
        (
            |v| v["mix"]["grading"] = json!({"type": "sieves", "points": [[2, 0], [4, 0.8]]}),
            "/mix/grading/points/1: passing 0.8 is out of range: all mass must pass the coarsest sieve, so its passing must \
             be 1; add the coarser sieves (from 0.9 on, the next sieve of the series is added, here 8 mm)",
        ),
        (
            |v| v["mix"]["grading"] = json!({"type": "classes", "classes": []}),
            "/mix/grading/classes: has 0 classes: must have at least 1",
        ),
        (
            |v| {
                v["mix"]["grading"] = json!({"type": "classes", "classes": [{"d_min_mm": 8, "d_max_mm": 4, "mass_fraction": 1}]})
            },
            "/mix/grading/classes/0: d_min_mm 8 must be less than d_max_mm 4",
        ),
        (
            |v| v["mix"]["grading"] = json!({"type": "classes", "classes": [{"d_min_mm": 4, "d_max_mm": 8, "mass_fraction": 0.7}, {"d_min_mm": 2, "d_max_mm": 4, "mass_fraction": 0.7}]}),
            "/mix/grading/classes: the mass fractions sum to 1.4: must be at most 1, or 1.01 where a table is rounded",
        ),
        (
            |v| v["mix"]["grading"] = json!({"type": "classes", "classes": [{"d_min_mm": 4, "d_max_mm": 8, "mass_fraction": 0.5}, {"d_min_mm": 2, "d_max_mm": 5, "mass_fraction": 0.5}]}),
            "/mix/grading/classes/0: d_min_mm 4 lies inside the class 2..5 mm: classes must not overlap",
        ),
        (
            |v| v["mix"] = json!({"grading": {"type": "diameters", "diameters_mm": [5, -5]}}),
            "/mix/grading/diameters_mm/1: -5 is out of range: must be at least 1e-6 and at most 1000000 mm",
        ),
        (
            |v| {
                v["mix"] =
                    json!({"grading": {"type": "diameters", "diameters_mm": [5]}, "volume_fraction": 0.5})
            },
            "/mix/volume_fraction: an explicit list of diameters prescribes the volume: leave this field out, or set it to \"maximize\", which scales all diameters of the list by one factor",
        ),
        (
            |v| v["distance"]["gap_mm"] = json!(-1),
            "/distance/gap_mm: -1 is out of range: must be at least 0 and at most 1000000 mm",
        ),
        (
            |v| v["distance"]["wall_gap_mm"] = json!(-1),
            "/distance/wall_gap_mm: -1 is out of range: must be at least 0 and at most 1000000 mm",
        ),
        (
            |v| v["distance"] = json!({"type": "none", "gap_mm": 1}),
            "/distance/gap_mm: unknown field: this object has type, wall_gap_mm",
        ),
        (
            |v| v["method"]["attempts_per_grain"] = json!(0),
            "/method/attempts_per_grain: 0 is out of range: must be a whole number from 1 to 1000000000000",
        ),
        (
            |v| v["method"] = json!({"type": "lubachevsky"}),
            "/method/type: \"lubachevsky\" is unknown: must be one of \"auto\", \"rsa\", \"growth\", \"edmd\", \"monte_carlo\"",
        ),
        (
            |v| v["distance"] = json!({"type": "minimize"}),
            "/distance/type: \"minimize\" is unknown: must be one of \"none\", \"constant\", \"proportional\", \"smaller_diameter\", \"maximize\"",
        ),
        (
            |v| v["distance"] = json!({"type": "maximize"}),
            "/distance/type: \"maximize\" needs grains that grow: the method must be \"growth\" or \"auto\", not \"rsa\"",
        ),
        (
            |v| {
                v["method"] = json!({"type": "auto"});
                v["distance"] = json!({"type": "maximize", "gap_mm": 1});
            },
            "/distance/gap_mm: unknown field: this object has type, wall_gap_mm",
        ),
        (
            |v| v["method"] = json!({"type": "edmd", "attempts_per_grain": 5}),
            "/method/attempts_per_grain: unknown field: this object has type, initial_scale, growth_rate, initial_velocity, equal_mass, swap, stop",
        ),
        (
            |v| v["method"] = json!({"type": "edmd", "initial_scale": 0.4}),
            "/method/initial_scale: 0.4 is out of range: must be at least 0.5 and at most 1",
        ),
        (
            |v| v["method"] = json!({"type": "edmd", "growth_rate": 0}),
            "/method/growth_rate: 0 is out of range: must be at least 1e-6 and at most 1000 per s",
        ),
        (
            |v| v["method"] = json!({"type": "edmd", "initial_velocity": 2e6}),
            "/method/initial_velocity: 2000000 is out of range: must be at least 1e-6 and at most 1000000 mm/s",
        ),
        (
            |v| v["method"] = json!({"type": "edmd", "equal_mass": 1}),
            "/method/equal_mass: 1 is not true or false",
        ),
        (
            |v| v["method"] = json!({"type": "edmd", "swap": "yes"}),
            "/method/swap: \"yes\" is not true or false",
        ),
        (|v| v["method"] = json!({"type": "edmd", "stop": 60}), "/method/stop: 60 is not an object"),
        (
            |v| v["method"] = json!({"type": "edmd", "stop": {"time": 60}}),
            "/method/stop/time: unknown field: this object has time_s, events, sweeps, stall_dt_s",
        ),
        (
            |v| v["method"] = json!({"type": "edmd", "stop": {"time_s": 0}}),
            "/method/stop/time_s: 0 is out of range: must be greater than 0 and at most 2678400 s",
        ),
        (
            |v| v["method"] = json!({"type": "edmd", "stop": {"events": 1.5}}),
            "/method/stop/events: 1.5 is out of range: must be a whole number from 1 to 1000000000000000",
        ),
        (
            |v| v["method"] = json!({"type": "edmd", "stop": {"stall_dt_s": 2}}),
            "/method/stop/stall_dt_s: 2 is out of range: must be greater than 0 and at most 1 s",
        ),
    ];
    for (change, message) in cases {
        assert_eq!(faults(change), [message]);
    }
}

#[test]
fn parameters_that_are_absent_stay_absent() {
    let mut value = valid();
    value["method"] = json!({"type": "edmd", "swap": null, "stop": {}});
    value["distance"] = json!({"type": "maximize"});
    let request = PackingRequest::from_json(&value, 1).unwrap();
    assert_eq!(request.method, Method::Edmd { options: GrowthOptions::default() });
    assert_eq!(request.distance, Distance::Maximize { wall_gap_mm: None });
    let written = serde_json::to_value(&request).unwrap();
    assert_eq!(written["method"], json!({"type": "edmd"}));
    assert_eq!(written["distance"], json!({"type": "maximize"}));
    value["method"] = json!({"type": "auto"});
    assert!(PackingRequest::from_json(&value, 1).is_ok(), "auto may choose a method that maximizes");
}

#[test]
fn an_option_that_a_way_of_growth_has_no_use_for_is_named() {
    let shape =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.6}});
    let cases = [
        (false, json!({"type": "growth", "growth_rate": 0.1, "stop": {"events": 5}}), ""),
        (
            false,
            json!({"type": "monte_carlo", "initial_scale": 0.7, "swap": false, "stop": {"sweeps": 5}}),
            "",
        ),
        (true, json!({"type": "growth", "initial_scale": 0.7, "stop": {"sweeps": 5, "time_s": 1}}), ""),
        (
            false,
            json!({"type": "growth", "stop": {"sweeps": 5}}),
            "/method/stop/sweeps: spheres grow by \"edmd\", which has no use for it: must be left out",
        ),
        (
            true,
            json!({"type": "growth", "equal_mass": true}),
            "/method/equal_mass: grains with a shape grow by \"monte_carlo\", which has no use for it: must be left out",
        ),
        (
            false,
            json!({"type": "monte_carlo", "growth_rate": 0.1}),
            "/method/growth_rate: \"monte_carlo\" has no use for it: must be left out",
        ),
        (
            false,
            json!({"type": "monte_carlo", "equal_mass": false, "stop": {"events": 4, "stall_dt_s": 0.1}}),
            "/method/equal_mass: \"monte_carlo\" has no use for it: must be left out; \
             /method/stop/events: \"monte_carlo\" has no use for it: must be left out; \
             /method/stop/stall_dt_s: \"monte_carlo\" has no use for it: must be left out",
        ),
        (
            false,
            json!({"type": "edmd", "stop": {"sweeps": 7}}),
            "/method/stop/sweeps: \"edmd\" has no use for it: must be left out",
        ),
        (
            true,
            json!({"type": "edmd"}),
            "/method/type: \"edmd\" packs spheres alone: must be \"growth\", \"monte_carlo\", \"rsa\" or \"auto\" for \
             grains with a shape",
        ),
    ];
    for (has_shape, method, message) in cases {
        let mut value = valid();
        value["method"] = method.clone();
        if has_shape {
            value["mix"]["shape"] = shape.clone();
        }
        let found = PackingRequest::from_json(&value, 1).err().unwrap_or_default();
        let found: Vec<String> =
            found.iter().map(|fault| format!("{}: {}", fault.pointer, fault.detail)).collect();
        assert_eq!(found.join("; "), message, "{method}");
    }
}

#[test]
fn all_faults_of_a_method_are_reported_at_once() {
    let found = faults(|v| {
        v["method"] = json!({"type": "edmd", "initial_scale": 2, "swap": 0, "stop": {"events": 0, "time_s": -1}, "dt": 1});
    });
    let pointers: Vec<&str> = found.iter().map(|f| f.split(':').next().unwrap()).collect();
    assert_eq!(
        pointers,
        ["/method/initial_scale", "/method/swap", "/method/stop/time_s", "/method/stop/events", "/method/dt"]
    );
}

fn some<T: std::fmt::Debug + Clone>(
    of: impl Strategy<Value = T> + 'static,
) -> impl Strategy<Value = Option<T>> {
    prop::option::of(of)
}

fn growth_options() -> impl Strategy<Value = GrowthOptions> {
    let stop = (
        some(1.0e-3..=growth::MAX_STOP_TIME_S),
        some(1..=growth::MAX_EVENTS as u64),
        some(f64::MIN_POSITIVE..=1.0),
    )
        .prop_map(|(time_s, events, stall_dt_s)| GrowthStop { time_s, events, stall_dt_s, sweeps: None });
    (
        some(growth::MIN_INITIAL_SCALE..=1.0),
        some(growth::MIN_GROWTH_RATE..=growth::MAX_GROWTH_RATE),
        some(growth::MIN_INITIAL_VELOCITY_MM_PER_S..=growth::MAX_INITIAL_VELOCITY_MM_PER_S),
        some(any::<bool>()),
        some(any::<bool>()),
        stop,
    )
        .prop_map(|(initial_scale, growth_rate, initial_velocity, equal_mass, swap, stop)| {
            GrowthOptions { initial_scale, growth_rate, initial_velocity, equal_mass, swap, stop }
        })
}

properties! {
    #[test]
    fn every_growth_is_written_as_it_is_read(options in growth_options(), wall_gap_mm in some(0.0..=10.0)) {
        let mut request = PackingRequest::from_json(&valid(), 1).unwrap();
        request.method = Method::Edmd { options };
        request.distance = Distance::Maximize { wall_gap_mm };
        let text = serde_json::to_string(&request).unwrap();
        let read = PackingRequest::from_json(&serde_json::from_str(&text).unwrap(), 2).unwrap();
        prop_assert_eq!(&read, &request);
        prop_assert_eq!(serde_json::to_string(&read).unwrap(), text);
    }
}

#[test]
fn a_request_built_in_code_is_held_to_the_same_bounds() {
    let value = json!({
        "specimen": {"type": "box", "size_mm": [50, 50, 50]},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "volume_fraction": 0.4},
    });
    let valid = PackingRequest::from_json(&value, 3).unwrap();
    assert_eq!(valid.validate(), Ok(()));
    let mut negative = valid.clone();
    negative.specimen = Specimen::Box { size_mm: [-1.0, 50.0, 50.0], boundary: Boundary::Walls };
    let pointers = |request: &PackingRequest| -> Vec<String> {
        request.validate().unwrap_err().into_iter().map(|fault| fault.pointer).collect()
    };
    assert_eq!(pointers(&negative), ["/specimen/size_mm/0"]);
    let refused = crate::pack(&negative, &crate::Limits::default(), &crate::Unattended);
    assert!(matches!(refused, Err(crate::PackError::Plan(crate::PlanError::Invalid(_)))), "{refused:?}");
    let mut missing = valid.clone();
    missing.mix.volume_fraction = Some(VolumeFraction::Of(f64::NAN));
    assert_eq!(pointers(&missing), ["/mix/volume_fraction"]);
    let mut endless = valid;
    endless.distance = Distance::None { wall_gap_mm: Some(f64::INFINITY) };
    assert_eq!(pointers(&endless), [""]);
}

/// The shares of printed tables are rounded: their sum may exceed 1 by 0.01, and they are divided by it.
#[test]
fn rounded_shares_of_classes_are_divided_by_their_sum() {
    let read = |shares: [f64; 2]| {
        let [coarse, fine] = shares;
        let classes = json!([{"d_min_mm": 4, "d_max_mm": 8, "mass_fraction": fine},
            {"d_min_mm": 8, "d_max_mm": 16, "mass_fraction": coarse}]);
        let mix = json!({"grading": {"type": "classes", "classes": classes}, "volume_fraction": 0.3});
        let request = json!({"specimen": {"type": "box", "size_mm": [60, 60, 60]}, "mix": mix});
        PackingRequest::from_json(&request, 1).map(|request| match request.mix.grading {
            Some(Grading::Classes { classes }) => {
                classes.iter().map(|class| class.mass_fraction).collect::<Vec<_>>()
            }
            _ => Vec::new(),
        })
    };
    assert_eq!(read([0.502, 0.5]).unwrap(), [0.5 / 1.002, 0.502 / 1.002]);
    assert_eq!(read([0.5, 0.48]).unwrap(), [0.48, 0.5], "less is finer than all classes");
    assert!(read([0.52, 0.5]).is_err());
}

/// MATLAB and R write a list of one as its element.
#[test]
fn one_element_stands_in_place_of_a_list_of_one() {
    let read = |mix: Value| {
        let request = json!({"specimen": {"type": "box", "size_mm": [60, 60, 60]}, "mix": mix});
        PackingRequest::from_json(&request, 1).map(|request| request.mix)
    };
    let class = json!({"d_min_mm": 4, "d_max_mm": 8, "mass_fraction": 1});
    let shape = json!({"above_mm": 4, "shape": {"type": "sphere"}});
    let aggregate = json!({"share": 1, "grading": {"type": "monodisperse", "diameter_mm": 8}});
    for (one, list) in [
        (
            json!({"grading": {"type": "classes", "classes": class}, "volume_fraction": 0.3}),
            json!({"grading": {"type": "classes", "classes": [class]}, "volume_fraction": 0.3}),
        ),
        (
            json!({"grading": {"type": "diameters", "diameters_mm": 12}}),
            json!({"grading": {"type": "diameters", "diameters_mm": [12]}}),
        ),
        (
            json!({"aggregates": aggregate, "volume_fraction": 0.3}),
            json!({"aggregates": [aggregate], "volume_fraction": 0.3}),
        ),
        (
            json!({"grading": {"type": "standard", "name": "A16"}, "shapes": shape, "volume_fraction": 0.3}),
            json!({"grading": {"type": "standard", "name": "A16"}, "shapes": [shape], "volume_fraction": 0.3}),
        ),
    ] {
        assert_eq!(read(one.clone()), read(list.clone()), "{one}");
    }
    // A fault names the place in the document that was sent.
    let faults = read(json!({"grading": {"type": "classes", "classes": {"d_min_mm": 4, "d_max_mm": -8, "mass_fraction": 1}}, "volume_fraction": 0.3})).unwrap_err();
    assert_eq!(faults[0].pointer, "/mix/grading/classes/d_max_mm");
}

/// A coarse aggregate with undersize beside a cut-off below its finest sieve.
#[test]
fn a_curve_that_ends_above_the_cut_off_gets_the_next_finer_sieve() {
    let read = |points: Value, d_min: f64| {
        let grading = json!({"type": "sieves", "points": points});
        let mix = json!({"grading": grading, "volume_fraction": 0.3, "d_min_mm": d_min});
        let request = json!({"specimen": {"type": "box", "size_mm": [60, 60, 60]}, "mix": mix});
        PackingRequest::from_json(&request, 1)
    };
    let read_again = |request: &PackingRequest| {
        PackingRequest::from_json(&serde_json::to_value(request).unwrap(), 1).unwrap()
    };
    let request = read(json!([[8, 8], [16, 97]]), 4.0).unwrap();
    let Some(Grading::Sieves { points, completed_mm, .. }) = &request.mix.grading else { panic!() };
    assert_eq!(points, &[[4.0, 0.0], [8.0, 0.08], [16.0, 0.97], [31.5, 1.0]]);
    assert_eq!(completed_mm, &[4.0, 31.5]);
    assert_eq!(read_again(&request), request);
    let notes = request.mix.grading.as_ref().unwrap().completions(0.0, f64::INFINITY);
    assert!(notes[0].contains("starts with 8.0000 % passing 8 mm: the sieve 4 mm was added"), "{notes:?}");
    assert!(notes[1].contains("ends with 97.0000 % passing 16 mm: the sieve 31.5 mm"), "{notes:?}");
    // What lies above the cut-off is known.
    let request = read(json!([[8, 8], [16, 100]]), 8.0).unwrap();
    assert!(request.mix.grading.as_ref().unwrap().completions(0.0, f64::INFINITY).is_empty());
    let faults = read(json!([[8, 30], [16, 100]]), 4.0).unwrap_err();
    assert!(faults[0].detail.contains("or add the finer sieves to the points"), "{faults:?}");
}
