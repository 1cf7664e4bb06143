//! Whatever a request may say, however extreme, its plan is a refusal or finite figures.
#![allow(clippy::unwrap_used)]

use crate::properties::properties;
use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;

/// A number as people send them, or as fuzzers do: any magnitude that a float holds.
fn magnitude() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => (-3.0..3.0).prop_map(|e: f64| 10.0_f64.powf(e)),
        2 => (-12.0..7.0).prop_map(|e: f64| 10.0_f64.powf(e)),
        1 => (-323.0..308.0).prop_map(|e: f64| 10.0_f64.powf(e)),
        1 => Just(5e-324),
    ]
}

/// A share of a whole, down to the least that a float holds.
fn share() -> impl Strategy<Value = f64> {
    prop_oneof![4 => 0.01..=1.0, 1 => magnitude().prop_map(|x| x.min(1.0)), 1 => Just(1.0 - f64::EPSILON / 2.0)]
}

fn grading() -> impl Strategy<Value = Value> {
    let ordered = |a: f64, b: f64| if a < b { [a, b] } else { [b, a] };
    prop_oneof![
        prop::sample::select(vec!["A8", "B16", "C32"])
            .prop_map(|name| json!({"type": "standard", "name": name})),
        (magnitude(), share())
            .prop_map(|(d, exponent)| json!({"type": "fuller", "d_max_mm": d, "exponent": exponent})),
        (magnitude(), magnitude(), magnitude(), share()).prop_map(|(a, b, c, passing)| {
            let mut d = [a, b, c];
            d.sort_unstable_by(f64::total_cmp);
            json!({"type": "sieves", "points": [[d[0], 0.0], [d[1], passing], [d[2], 1.0]]})
        }),
        prop::collection::vec((magnitude(), magnitude(), share()), 1..3).prop_map(move |classes| {
            let classes: Vec<Value> = classes
                .into_iter()
                .map(|(a, b, mass)| {
                    let [low, high] = ordered(a, b);
                    json!({"d_min_mm": low, "d_max_mm": high, "mass_fraction": mass})
                })
                .collect();
            json!({"type": "classes", "classes": classes})
        }),
        magnitude().prop_map(|d| json!({"type": "monodisperse", "diameter_mm": d})),
        prop::collection::vec(magnitude(), 1..4)
            .prop_map(|mm| json!({"type": "diameters", "diameters_mm": mm})),
    ]
}

fn amount() -> impl Strategy<Value = Value> {
    prop_oneof![
        3 => share().prop_map(|phi| json!({"volume_fraction": phi})),
        1 => (magnitude(), share(), prop::option::of(magnitude())).prop_map(|(cement, water, ratio)| {
            json!({"proportions": {"cement_kg_m3": cement, "water_cement": water, "aggregate_cement": ratio}})
        }),
    ]
}

/// A specimen of any size, or one that holds a few or many of the largest grain.
fn specimen(largest_mm: f64) -> impl Strategy<Value = Value> {
    let length = move || prop_oneof![1 => magnitude(), 4 => (0.0..3.0).prop_map(move |e: f64| largest_mm * 10.0_f64.powf(e))];
    prop_oneof![
        (length(), length(), length(), any::<bool>()).prop_map(|(x, y, z, periodic)| {
            json!({"type": "box", "size_mm": [x, y, z], "boundary": if periodic { "periodic" } else { "walls" }})
        }),
        (length(), length()).prop_map(|(d, h)| json!({"type": "cylinder", "diameter_mm": d, "height_mm": h})),
    ]
}

/// The largest diameter that a grading names; that of the largest standard curve for those.
fn largest_mm(grading: &Value) -> f64 {
    match grading["type"].as_str().unwrap() {
        "standard" => 32.0,
        "fuller" => grading["d_max_mm"].as_f64().unwrap(),
        "sieves" => grading["points"][2][0].as_f64().unwrap(),
        "monodisperse" => grading["diameter_mm"].as_f64().unwrap(),
        "classes" => {
            let classes = grading["classes"].as_array().unwrap();
            classes.iter().map(|c| c["d_max_mm"].as_f64().unwrap()).fold(0.0, f64::max)
        }
        _ => grading["diameters_mm"]
            .as_array()
            .unwrap()
            .iter()
            .map(|d| d.as_f64().unwrap())
            .fold(0.0, f64::max),
    }
}

fn distance() -> impl Strategy<Value = Value> {
    prop_oneof![
        Just(json!({"type": "none"})),
        magnitude().prop_map(|mm| json!({"type": "constant", "gap_mm": mm})),
        magnitude().prop_map(|factor| json!({"type": "proportional", "factor": factor})),
        (magnitude(), magnitude())
            .prop_map(|(f, wall)| json!({"type": "smaller_diameter", "factor": f, "wall_gap_mm": wall})),
        Just(json!({"type": "maximize"})),
    ]
}

/// A ratio of two axes.
fn ratio() -> impl Strategy<Value = f64> {
    prop_oneof![8 => 0.1..=1.0, 1 => Just(0.1), 1 => Just(1.0)]
}

fn law() -> BoxedStrategy<Value> {
    prop_oneof![
        ratio().prop_map(|value| json!(value)),
        (ratio(), ratio()).prop_map(|(a, b)| json!({"type": "uniform", "min": a.min(b), "max": a.max(b)})),
        (ratio(), ratio())
            .prop_map(|(m, s)| json!({"type": "beta", "mean": m, "standard_deviation": 0.3 * s * s * s})),
        prop::collection::vec(ratio(), 1..4).prop_map(|values| json!({"type": "table", "values": values})),
    ]
    .boxed()
}

fn shape() -> BoxedStrategy<Value> {
    let index = || prop_oneof![0.0..=1.0, Just(0.0), Just(1.0)];
    let ratios = prop_oneof![
        (ratio(), ratio())
            .prop_map(|(a, b)| json!({"type": "constant", "b_over_a": a.max(b), "c_over_a": a.min(b)})),
        (law(), law()).prop_map(|(e, f)| json!({"type": "independent", "elongation": e, "flatness": f})),
        ratio().prop_map(|k| json!({"type": "triangle", "k": k})),
        prop::collection::vec([ratio(), ratio(), ratio()], 1..4)
            .prop_map(|axes| json!({"type": "measured", "axes": axes})),
        (index(), 0.4..=1.0).prop_map(|(i, e)| json!({"type": "flakiness", "index": i, "elongation": e})),
        index().prop_map(|i| json!({"type": "shape_index", "index": i})),
    ];
    let plain = prop_oneof![
        1 => Just(json!({"type": "sphere"})),
        4 => ratios.boxed().prop_map(|ratios| json!({"type": "ellipsoid", "ratios": ratios})),
    ]
    .boxed();
    prop_oneof![
        plain.clone(),
        (plain.clone(), plain, 0.01..0.99).prop_map(|(a, b, share)| json!({"type": "mixture", "of": [
            {"share": share, "shape": a}, {"share": 1.0 - share, "shape": b}]})),
    ]
    .boxed()
}

/// Polyhedra, alone or mixed.
fn polyhedra() -> BoxedStrategy<Value> {
    let template = prop_oneof![
        prop_oneof![Just(6), Just(7), 6..=60].prop_map(|faces| json!({"template": "cuts", "faces": faces})),
        prop_oneof![Just(0.0), Just(0.4), 0.0..=0.4]
            .prop_map(|share| json!({"template": "deformed_cuboid", "displacement": share})),
        Just(json!({"template": "voronoi"})),
    ];
    let ratios = prop_oneof![
        Just(json!({"type": "triangle", "k": 0.1})),
        (ratio(), ratio())
            .prop_map(|(a, b)| json!({"type": "constant", "b_over_a": a.max(b), "c_over_a": a.min(b)})),
        (law(), law()).prop_map(|(e, f)| json!({"type": "independent", "elongation": e, "flatness": f})),
    ];
    let rounding = prop_oneof![Just(0.0), Just(0.4), 0.0..=0.4];
    let one = (template, ratios, rounding, 1..3, 0..4_u64)
        .prop_map(|(template, ratios, rounding, count, seed)| {
            let mut shape = template;
            shape["type"] = json!("polyhedron");
            shape["ratios"] = ratios;
            shape["rounding"] = json!(rounding);
            shape["template_count"] = json!(count);
            shape["template_seed"] = json!(seed);
            shape
        })
        .boxed();
    prop_oneof![
        2 => one.clone(),
        1 => (one.clone(), one, 0.01..0.99).prop_map(|(a, b, share)| json!({"type": "mixture", "of": [
            {"share": share, "shape": a}, {"share": 1.0 - share, "shape": b}]})),
    ]
    .boxed()
}

/// The shapes of a mix: none, one for all sizes, or two by size.
fn shapes() -> BoxedStrategy<Value> {
    prop_oneof![
        2 => Just(json!({})),
        1 => (shape(), any::<bool>()).prop_map(|(shape, by_volume)| {
            json!({"shape": shape, "size": if by_volume { "equivalent" } else { "sieve" }})
        }),
        1 => (shape(), shape(), magnitude()).prop_map(|(coarse, fine, above)| json!({"shapes": [
            {"above_mm": above, "shape": coarse}, {"above_mm": 0, "shape": fine}]})),
        1 => (polyhedra(), any::<bool>()).prop_map(|(shape, by_volume)| {
            json!({"shape": shape, "size": if by_volume { "equivalent" } else { "sieve" }})
        }),
        1 => (polyhedra(), prop_oneof![polyhedra(), shape()], magnitude()).prop_map(|(coarse, fine, above)| {
            json!({"shapes": [{"above_mm": above, "shape": coarse}, {"above_mm": 0, "shape": fine}]})
        }),
    ]
    .boxed()
}

fn request() -> BoxedStrategy<Value> {
    let mix = (grading(), amount(), prop::option::of(magnitude()), any::<bool>(), shapes()).prop_map(
        |(grading, amount, d_min, effective, shapes)| {
            let mut mix = if grading["type"] == "diameters" { json!({}) } else { amount };
            mix["grading"] = grading;
            if let Some(d_min) = d_min {
                mix["d_min_mm"] = json!(d_min);
            }
            if effective && mix.get("volume_fraction").is_some() {
                mix["volume_fraction_of"] = json!("placed_grains");
            }
            for (name, value) in shapes.as_object().unwrap() {
                mix[name] = value.clone();
            }
            mix
        },
    );
    let of_mix = |mix: Value| {
        let specimen = specimen(largest_mm(&mix["grading"]));
        (Just(mix), specimen, distance(), prop::sample::select(vec!["auto", "rsa", "edmd"]))
    };
    mix.prop_flat_map(of_mix).prop_map(|(mix, specimen, distance, method)| {
        json!({"mix": mix, "specimen": specimen, "distance": distance, "method": {"type": method}})
    })
    .boxed()
}

#[test]
fn a_class_whose_share_is_the_least_float_has_a_plan_of_finite_figures() {
    let ellipsoid =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.36, "c_over_a": 0.1}});
    let document = json!({
        "specimen": {"type": "box", "size_mm": [20, 20, 20], "boundary": "periodic"},
        "mix": {
            "grading": {"type": "sieves", "points": [[0.001, 0.0], [1.0, 5e-324], [17.0, 1.0]]},
            "d_min_mm": 0.6, "volume_fraction": 0.5, "volume_fraction_of": "placed_grains", "allow_coarse": true,
            "shape": ellipsoid,
        },
    });
    let request = PackingRequest::from_json(&document, 1).unwrap();
    let plan = Plan::new(&request, &Limits::default()).unwrap();
    assert!(plan.classes.iter().all(|class| class.grains.is_finite()), "{:?}", plan.classes);
    assert_eq!(plan.classes[0].grains, 0.0);
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(4000))]
    #[test]
    fn an_extreme_request_has_a_plan_of_finite_figures_or_a_refusal(document in request()) {
        let Ok(request) = PackingRequest::from_json(&document, 1) else { return Ok(()) };
        let Ok(plan) = Plan::new(&request, &Limits::default()) else { return Ok(()) };
        prop_assert!((0.0..=1.0).contains(&plan.success_probability), "{document}: {plan:?}");
        prop_assert!(plan.grains >= 0.0 && plan.estimated_time_s >= 0.0, "{document}: {plan:?}");
        // What is not finite is a null in JSON.
        let written = serde_json::to_string(&plan).unwrap();
        prop_assert!(!written.contains("null"), "{document}: {written}");
        let proposal = plan.with_proposal(&request).proposal.unwrap();
        for most in [proposal.volume_fraction, proposal.distance_mm].into_iter().flatten() {
            prop_assert!(most.is_finite() && most >= 0.0, "{document}: {proposal:?}");
        }
    }
}
