use std::cell::Cell;

use crate::properties::properties;
use proptest::prelude::*;
use serde_json::json;

use super::*;
use crate::{Limits, PackingRequest, Spheres, Unattended, pack};

thread_local! {
    /// Makes [`Cpu::detect`] answer with the baseline in this thread.
    pub(super) static IS_BASELINE_FORCED: Cell<bool> = const { Cell::new(false) };
}

/// What `work` gives on the path of the baseline.
pub(crate) fn on_baseline<R>(work: impl FnOnce() -> R) -> R {
    IS_BASELINE_FORCED.set(true);
    let result = work();
    IS_BASELINE_FORCED.set(false);
    result
}

fn bits(lanes: impl Lanes) -> [u64; 4] {
    lanes.to_array().map(f64::to_bits)
}

/// Every operation of a set on two fours of numbers, as bits.
fn operations<S: InstructionSet>(set: S, x: [f64; 4], y: [f64; 4]) -> Vec<[u64; 4]> {
    let (a, b) = (set.lanes(x), set.lanes(y));
    let mut found = vec![
        bits(a + b),
        bits(a - b),
        bits(a * b),
        bits(a / b),
        bits(-a),
        bits(a.min(b)),
        bits(a.max(b)),
        bits(a.lt(b).select(a, b)),
        bits(a.le(b).select(a, b)),
        bits(a.ge(b).select(a, b)),
        bits((a.lt(b) | a.ge(b)).select(a, b)),
        bits((a.le(b) & a.ge(b)).select(a, b)),
        bits(set.splat(x[0])),
        [a.lt(b).any(), a.le(b).any(), a.ge(b).any(), false].map(u64::from),
        bits(a.max(set.splat(0.0)).sqrt()),
    ];
    found.extend(S::Lanes::transpose([a, b, a + b, a * b]).map(bits));
    found
}

properties! {
    #[test]
    fn operations_have_the_same_bits_in_every_set(
        x in prop::array::uniform4(-1e9..1e9_f64), y in prop::array::uniform4(prop_oneof![-2.0..2.0_f64, Just(0.0)]),
    ) {
        with_instruction_set!(Cpu::detect(), set => {
            prop_assert_eq!(operations(set, x, y), operations(Baseline, x, y));
        });
    }
}

/// Packings of both methods in every kind of specimen, with every distance rule.
fn packings() -> Vec<Spheres> {
    let cube = |boundary| json!({"type": "box", "size_mm": [32, 30, 28], "boundary": boundary});
    let cylinder = json!({"type": "cylinder", "diameter_mm": 32, "height_mm": 32});
    let rules = [
        json!({"type": "none"}),
        json!({"type": "constant", "gap_mm": 0.4}),
        json!({"type": "proportional", "factor": 0.1}),
        json!({"type": "smaller_diameter", "factor": 0.15, "wall_gap_mm": 0.2}),
    ];
    let mut packings = Vec::new();
    for method in ["rsa", "edmd"] {
        for specimen in [cube("walls"), cube("periodic"), cylinder.clone()] {
            for rule in &rules {
                let value = json!({
                    "specimen": specimen, "distance": rule, "method": {"type": method},
                    "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2.0, "volume_fraction": 0.4},
                });
                let request = PackingRequest::from_json(&value, 5).unwrap();
                packings
                    .push(pack(&request, &Limits::default(), &Unattended).unwrap().into_spheres().unwrap());
            }
        }
    }
    packings
}

#[test]
fn packings_have_the_same_bits_on_every_path() {
    let detected = packings();
    assert_eq!(detected, on_baseline(packings));
    assert!(detected.iter().all(|spheres| spheres.len() > 100));
}
