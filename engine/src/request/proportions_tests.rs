#![allow(clippy::unwrap_used)]

use crate::properties::properties;
use proptest::prelude::*;
use serde_json::{Value, json};

use crate::mix::GradedMix;
use crate::request::{Mix, PackingRequest};
use crate::{Limits, Plan, PlanError};

fn request(mix: &Value) -> Result<PackingRequest, Vec<String>> {
    let value = json!({"specimen": {"type": "box", "size_mm": [150, 150, 150]}, "mix": mix});
    PackingRequest::from_json(&value, 1).map_err(|faults| faults.iter().map(ToString::to_string).collect())
}

fn with(content: &Value) -> Value {
    json!({"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": 4, "proportions": content})
}

fn fraction(content: &Value) -> f64 {
    request(&with(content)).unwrap().mix.requested_fraction().unwrap()
}

fn faults(content: &Value) -> Vec<String> {
    request(&with(content)).unwrap_err()
}

#[test]
fn the_aggregate_is_what_the_other_parts_leave() {
    let plain = json!({"cement_kg_m3": 300, "water_cement": 0.5});
    assert!((fraction(&plain) - (1.0 - 300.0 / 3150.0 - 0.15 - 0.03)).abs() < 1e-12);
    let rich = json!({
        "cement_kg_m3": 350, "water_cement": 0.42, "air": 0.015, "cement_density_kg_m3": 3000,
        "water_density_kg_m3": 998,
        "additions": [{"mass_kg_m3": 60, "density_kg_m3": 2300}, {"mass_kg_m3": 22, "density_kg_m3": 2200}],
    });
    let by_hand = 1.0 - 350.0 / 3000.0 - 147.0 / 998.0 - 60.0 / 2300.0 - 22.0 / 2200.0 - 0.015;
    assert!((fraction(&rich) - by_hand).abs() < 1e-12);
}

#[test]
fn or_it_is_told_by_the_cement() {
    let content = json!({"cement_kg_m3": 300, "water_cement": 0.5, "aggregate_cement": 6.2});
    assert!((fraction(&content) - 6.2 * 300.0 / 2650.0).abs() < 1e-12);
    let light = json!({
        "cement_kg_m3": 300, "water_cement": 0.5, "aggregate_cement": 3.0, "aggregate_density_kg_m3": 1400,
    });
    assert!((fraction(&light) - 900.0 / 1400.0).abs() < 1e-12);
}

/// C11: `v_a0 = [1 - (d_0 / d_a)^n] v_a` for a curve of Fuller's kind, cut off at `d_0`.
#[test]
fn what_is_placed_of_a_content_has_the_closed_form() {
    for (exponent, d_0) in [(0.5, 4.0), (0.42, 2.0), (0.9, 8.0)] {
        let mut mix = with(&json!({"cement_kg_m3": 320, "water_cement": 0.45, "air": 0.02}));
        mix["grading"]["exponent"] = json!(exponent);
        mix["d_min_mm"] = json!(d_0);
        let request = request(&mix).unwrap();
        let v_a = 1.0 - 320.0 / 3150.0 - 0.144 - 0.02;
        let v_a0 = (1.0 - (d_0 / 16.0_f64).powf(exponent)) * v_a;
        let graded = GradedMix::new(&request.mix, request.specimen.volume_mm3());
        assert!((graded.volume_fraction_mixture - v_a).abs() < 1e-12);
        assert!((graded.volume_fraction_effective - v_a0).abs() < 1e-12, "{exponent} {d_0}");
        let plan = Plan::new(&request, &Limits::default()).unwrap();
        assert!((plan.volume_fraction_mixture - v_a).abs() < 1e-12);
        assert!((plan.volume_fraction_effective - v_a0).abs() < 1e-12);
    }
}

#[test]
fn a_tabulated_curve_is_truncated_by_itself() {
    let mut mix = with(&json!({"cement_kg_m3": 320, "water_cement": 0.45}));
    mix["grading"] = json!({"type": "sieves", "points": [[2, 0.2], [8, 0.6], [16, 1.0]]});
    let request = request(&mix).unwrap();
    // At 4 mm, half way from 2 to 8 by the logarithm, 0.4 passes.
    let graded = GradedMix::new(&request.mix, request.specimen.volume_mm3());
    assert!((graded.volume_fraction_effective / graded.volume_fraction_mixture - 0.6).abs() < 1e-12);
}

#[test]
fn a_sum_that_leaves_no_aggregate_is_told_term_by_term() {
    assert_eq!(
        faults(&json!({"cement_kg_m3": 900, "water_cement": 0.8})),
        [
            "/mix/proportions: cement 0.2857 + water 0.7200 + air 0.0300: the terms sum to 1.0357 of the volume, which \
          leaves no aggregate: must sum to less than 1"
        ]
    );
    assert_eq!(
        faults(&json!({
            "cement_kg_m3": 300, "water_cement": 0.5, "aggregate_cement": 7,
            "additions": [{"mass_kg_m3": 100, "density_kg_m3": 2500}],
        })),
        [
            "/mix/proportions: cement 0.0952 + water 0.1500 + additions 0.0400 + aggregate 0.7925: the terms sum to 1.0777 \
          of the volume, which implies -0.0777 of air: must sum to at most 1"
        ]
    );
}

#[test]
fn less_aggregate_than_rounding_is_none() {
    assert_eq!(
        faults(&json!({"cement_kg_m3": 2.65e-7, "water_cement": 0.5, "aggregate_cement": 1})),
        [
            "/mix/proportions: cement 0.0000 + water 0.0000 + aggregate 0.0000: the aggregate is 1e-10 of the volume: \
          must be at least 1e-9"
        ]
    );
    assert_eq!(faults(&json!({"cement_kg_m3": 1e-12, "water_cement": 0, "air": 0.999_999_999_9})).len(), 1);
}

#[test]
fn what_contradicts_itself_is_refused() {
    let content = json!({"cement_kg_m3": 300, "water_cement": 0.5});
    let mut both = with(&content);
    both["volume_fraction"] = json!(0.7);
    assert_eq!(
        request(&both).unwrap_err(),
        ["/mix/proportions: the mix has a volume_fraction too: leave one of the two out"]
    );
    let mut effective = with(&content);
    effective["volume_fraction_of"] = json!("placed_grains");
    assert_eq!(
        request(&effective).unwrap_err(),
        [
            "/mix/volume_fraction_of: `proportions` count all aggregate, that below the cut-off too: must be \"all_aggregate\""
        ]
    );
    let list = json!({"grading": {"type": "diameters", "diameters_mm": [8]}, "proportions": content});
    assert_eq!(
        request(&list).unwrap_err(),
        ["/mix/proportions: an explicit list of diameters prescribes the volume: leave this field out"]
    );
    assert_eq!(
        faults(&json!({"cement_kg_m3": 300, "water_cement": 0.5, "aggregate_cement": 6, "air": 0.02})),
        [
            "/mix/proportions/air: with aggregate_cement, or the mass_kg_m3 of the aggregates, the air is what all parts leave: leave one of the two out"
        ]
    );
    assert_eq!(
        faults(&json!({"cement_kg_m3": 300, "water_cement": 0.5, "aggregate_density_kg_m3": 2600})),
        [
            "/mix/proportions/aggregate_density_kg_m3: the aggregate is what the other parts leave, whatever its density: \
          needs aggregate_cement"
        ]
    );
}

#[test]
fn every_number_is_bounded_and_every_fault_told() {
    assert_eq!(
        faults(&json!({
            "cement_kg_m3": 0, "water_cement": -1, "air": 2, "cement_density_kg_m3": 3.15, "fly_ash": 1,
            "additions": [{"mass_kg_m3": 10}],
        })),
        [
            "/mix/proportions/cement_kg_m3: 0 is out of range: must be greater than 0 and at most 10000 kg/m3",
            "/mix/proportions/water_cement: -1 is out of range: must be at least 0 and at most 10",
            "/mix/proportions/additions/0/density_kg_m3: is missing: the field is required",
            "/mix/proportions/air: 2 is out of range: must be at least 0 and at most 1",
            "/mix/proportions/cement_density_kg_m3: 3.15 is out of range: must be at least 100 and at most 30000 kg/m3",
            "/mix/proportions/fly_ash: unknown field: this object has cement_kg_m3, water_cement, aggregate_cement, \
             additions, air, cement_density_kg_m3, water_density_kg_m3, aggregate_density_kg_m3",
        ]
    );
}

#[test]
fn a_plan_that_cannot_be_points_at_the_content() {
    let mut dense = with(&json!({"cement_kg_m3": 100, "water_cement": 0.3}));
    dense["d_min_mm"] = json!(0.05);
    let mut value = serde_json::to_value(request(&dense).unwrap()).unwrap();
    value["specimen"] = json!({"type": "box", "size_mm": [20, 20, 20]});
    value["distance"] = json!({"type": "constant", "gap_mm": 0.5});
    let request = PackingRequest::from_json(&value, 1).unwrap();
    match Plan::new(&request, &Limits::default()) {
        Err(PlanError::Infeasible(fault)) => assert_eq!(fault.pointer, "/mix/proportions"),
        other => panic!("{other:?}"),
    }
}

properties! {
    #[test]
    fn every_content_is_written_as_it_is_read(
        // The greatest of all together have 0.91 of the volume.
        cement in 100.0..450.0_f64, water in 0.2..0.7_f64, air in prop::option::of(0.0..0.08_f64),
        ash in prop::option::of(1.0..60.0_f64), ratio in prop::option::of(0.5..2.5_f64),
    ) {
        let mut content = json!({"cement_kg_m3": cement, "water_cement": water});
        if let Some(ash) = ash {
            content["additions"] = json!([{"mass_kg_m3": ash, "density_kg_m3": 2300}]);
        }
        match (ratio, air) {
            (Some(ratio), _) => content["aggregate_cement"] = json!(ratio),
            (None, Some(air)) => content["air"] = json!(air),
            (None, None) => {}
        }
        let first: Mix = request(&with(&content)).unwrap().mix;
        let again = request(&serde_json::to_value(&first).unwrap()).unwrap().mix;
        prop_assert_eq!(&again, &first);
        prop_assert_eq!(again.requested_fraction(), first.requested_fraction());
    }
}
