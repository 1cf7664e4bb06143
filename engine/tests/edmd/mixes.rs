//! Random small mixes end valid or say why not.

use std::cell::Cell;

use packstone_engine::packing::GrowthEnd;
use packstone_engine::{Limits, PackError, TargetNotReached, pack};
use proptest::prelude::*;
use proptest::test_runner::{TestCaseError, TestRunner};
use serde_json::{Value, json};

use super::valid::{Patience, fault, request};

/// A specimen with edges of 5 to 40 mm.
fn specimen() -> impl Strategy<Value = Value> {
    let edge = || 5.0..40.0_f64;
    prop_oneof![
        (edge(), edge(), edge(), any::<bool>()).prop_map(|(x, y, z, periodic)| {
            json!({"type": "box", "size_mm": [x, y, z], "boundary": if periodic { "periodic" } else { "walls" }})
        }),
        (edge(), edge()).prop_map(|(d, h)| json!({"type": "cylinder", "diameter_mm": d, "height_mm": h})),
    ]
}

/// Sizes of 1 to 60 grains, in any unit, with a ratio of up to 32.
fn sizes() -> impl Strategy<Value = Vec<f64>> {
    let spread = prop_oneof![Just(0.0), 0.0..5.0_f64];
    (prop::collection::vec(0.0..1.0_f64, 1..=60), spread)
        .prop_map(|(of_spread, octaves)| of_spread.into_iter().map(|u| (octaves * u).exp2()).collect())
}

/// A rule, its lengths in shares of the smallest diameter.
fn distance() -> impl Strategy<Value = Value> {
    let wall = || prop::option::of(0.0..1.0_f64);
    let with = |mut rule: Value, wall: Option<f64>| {
        if let Some(mm) = wall {
            rule["wall_gap_mm"] = json!(mm);
        }
        rule
    };
    prop_oneof![
        wall().prop_map(move |w| with(json!({"type": "none"}), w)),
        (0.0..1.0_f64, wall()).prop_map(move |(mm, w)| with(json!({"type": "constant", "gap_mm": mm}), w)),
        (0.0..0.4_f64, wall()).prop_map(move |(f, w)| with(json!({"type": "proportional", "factor": f}), w)),
        (0.0..0.6_f64, wall())
            .prop_map(move |(f, w)| with(json!({"type": "smaller_diameter", "factor": f}), w)),
        wall().prop_map(move |w| with(json!({"type": "maximize"}), w)),
    ]
}

fn method() -> impl Strategy<Value = Value> {
    let power = |from: f64, to: f64| (from..to).prop_map(|exponent| 10.0_f64.powf(exponent));
    let options = (
        prop::option::of(0.5..=1.0_f64),
        prop::option::of(power(-3.0, 3.0)),
        prop::option::of(power(-2.0, 2.0)),
        prop::option::of(any::<bool>()),
        prop::option::of(any::<bool>()),
        prop_oneof![1..200_u64, 200..20_000_u64, Just(20_000_u64)],
        prop::option::of(power(-12.0, -3.0)),
    );
    options.prop_map(
        |(initial_scale, growth_rate, initial_velocity, equal_mass, swap, events, stall_dt_s)| {
            json!({
                "type": "edmd", "initial_scale": initial_scale, "growth_rate": growth_rate,
                "initial_velocity": initial_velocity, "equal_mass": equal_mass, "swap": swap,
                "stop": {"events": events, "stall_dt_s": stall_dt_s},
            })
        },
    )
}

fn without_nulls(value: &mut Value) {
    if let Value::Object(map) = value {
        map.retain(|_, field| !field.is_null());
        map.values_mut().for_each(without_nulls);
    }
}

/// A small mix whose grains fill a given share of its specimen.
fn small_mix() -> impl Strategy<Value = (Value, u64)> {
    (specimen(), sizes(), distance(), method(), 0.01..0.68_f64, 0_u64..1_000_000).prop_map(
        |(specimen, sizes, mut distance, mut method, fraction, seed)| {
            let volume = match (&specimen["size_mm"], &specimen["diameter_mm"], &specimen["height_mm"]) {
                (Value::Array(edges), ..) => edges.iter().map(|l| l.as_f64().unwrap()).product::<f64>(),
                (_, d, h) => std::f64::consts::FRAC_PI_4 * d.as_f64().unwrap().powi(2) * h.as_f64().unwrap(),
            };
            let filled: f64 = sizes.iter().map(|d| std::f64::consts::FRAC_PI_6 * d.powi(3)).sum();
            let unit = libm::cbrt(fraction * volume / filled);
            let mm: Vec<f64> = sizes.iter().map(|d| unit * d).collect();
            let least = mm.iter().copied().fold(f64::INFINITY, f64::min);
            for length in ["mm", "wall_gap_mm"] {
                if let Some(share) = distance[length].as_f64() {
                    distance[length] = json!(share * least);
                }
            }
            without_nulls(&mut method);
            let mix = json!({"grading": {"type": "diameters", "diameters_mm": mm}});
            (json!({"specimen": specimen, "mix": mix, "distance": distance, "method": method}), seed)
        },
    )
}

#[test]
fn random_small_mixes_grow_valid_or_say_why_not() {
    let (valid, short, unfit) = (Cell::new(0), Cell::new(0), Cell::new(0));
    let count = |cell: &Cell<u32>| cell.set(cell.get() + 1);
    let config = ProptestConfig { source_file: Some(file!()), ..ProptestConfig::with_cases(500) };
    let tried = TestRunner::new(config).run(&small_mix(), |(value, seed)| {
        let request = request(&value, seed);
        match pack(&request, &Limits::default(), &Patience::new(100_000)) {
            Ok(packing) => {
                count(&valid);
                prop_assert_eq!(fault(&packing, &request), None);
                let grown = packing.report.statistics.edmd.unwrap();
                prop_assert_eq!(grown.growth_scale, 1.0);
                prop_assert_eq!(grown.grain_collisions + grown.wall_collisions, grown.events);
                let swaps = value["method"]["swap"] != json!(false);
                prop_assert!(swaps || grown.swaps_tried == 0);
            }
            Err(PackError::TargetNotReached(TargetNotReached::GrowthStopped(not_grown))) => {
                count(&short);
                prop_assert!(not_grown.scale_reached < 1.0, "{}", not_grown);
                prop_assert!(
                    matches!(not_grown.end, GrowthEnd::Stalled | GrowthEnd::EventLimit),
                    "{}",
                    not_grown
                );
                prop_assert!(
                    not_grown.volume_fraction_reached < not_grown.volume_fraction_asked,
                    "{}",
                    not_grown
                );
            }
            Err(PackError::Plan(_)) => count(&unfit),
            Err(other) => return Err(TestCaseError::fail(other.to_string())),
        }
        Ok(())
    });
    let [valid, short, unfit] = [valid, short, unfit].map(|cell| cell.get());
    if let Err(error) = tried {
        panic!("{error}\nafter {valid} valid, {short} short, {unfit} unfit");
    }
    // The mixes are worth trying: most are planned, and a good part of them reached.
    assert!(valid >= 50 && short >= 50 && unfit <= 300, "{valid} valid, {short} short, {unfit} unfit");
}
