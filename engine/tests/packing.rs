//! Whole runs through the public interface: random mixes end valid or say why not, and the same
//! seed gives the same packing.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use packstone_engine::packing::GrowthEnd;
use packstone_engine::{
    Control, GrowthEffort, Limits, PackError, PackingRequest, Progress, Step, TargetNotReached, Unattended,
    check, pack,
};
use proptest::prelude::*;
use serde_json::{Value, json};

fn request(value: &Value, seed: u64) -> PackingRequest {
    PackingRequest::from_json(value, seed).unwrap()
}

fn specimen() -> impl Strategy<Value = Value> {
    let edge = || 18.0..60.0_f64;
    prop_oneof![
        (edge(), edge(), edge(), any::<bool>()).prop_map(|(x, y, z, periodic)| {
            json!({"type": "box", "size_mm": [x, y, z], "boundary": if periodic { "periodic" } else { "walls" }})
        }),
        (edge(), edge()).prop_map(|(d, h)| json!({"type": "cylinder", "diameter_mm": d, "height_mm": h})),
    ]
}

fn grading() -> impl Strategy<Value = Value> {
    prop_oneof![
        prop::sample::select(vec!["A8", "B8", "C8", "A16", "B16", "C16"])
            .prop_map(|name| json!({"type": "standard", "name": name})),
        (4.0..16.0_f64, 0.1..1.0_f64)
            .prop_map(|(d, q)| json!({"type": "fuller", "d_max_mm": d, "exponent": q})),
        (2.5..10.0_f64).prop_map(|d| json!({"type": "monodisperse", "diameter_mm": d})),
        Just(json!({"type": "sieves", "points": [[1.0, 0.1], [4.0, 0.1], [8.0, 1.0]]})),
        law(),
    ]
}

/// Curves by formulas, laws of sizes, and bands of standards.
fn law() -> impl Strategy<Value = Value> {
    let by = || prop::sample::select(vec!["mass", "number"]);
    prop_oneof![
        (4.0..9.0_f64, 0.02..0.4_f64, by())
            .prop_map(|(median, sigma, by)| json!({"type": "lognormal", "median_mm": median, "sigma": sigma, "by": by})),
        (4.0..9.0_f64, 0.1..1.0_f64, by()).prop_map(|(mean, deviation, by)| {
            json!({"type": "normal", "mean_mm": mean, "standard_deviation_mm": deviation, "by": by})
        }),
        (4.0..9.0_f64, 3.0..20.0_f64, by()).prop_map(|(scale, shape, by)| {
            json!({"type": "weibull", "scale_mm": scale, "shape": shape, "by": by, "d_min_mm": 2, "d_max_mm": 11})
        }),
        (0.1..1.0_f64).prop_map(|q| json!({"type": "andreasen", "d_min_mm": 2, "d_max_mm": 8, "exponent": q})),
        (0.0..20.0_f64).prop_map(|a| json!({"type": "bolomey", "d_max_mm": 12, "a_percent": a})),
        (0.0..9.0_f64).prop_map(|k| json!({"type": "dreux_gorisse", "d_max_mm": 12, "k_percent": k})),
        (10.0..40.0_f64).prop_map(|a| json!({"type": "faury", "d_max_mm": 12, "a_percent": a})),
        by().prop_map(|by| json!({"type": "sizes", "by": by, "sizes": [
            {"diameter_mm": 3, "share": 5}, {"diameter_mm": 7, "share": 2},
        ]})),
        prop::sample::select(vec!["lower", "middle", "upper"]).prop_map(
            |curve| json!({"type": "standard", "standard": "ASTM C33", "name": "8", "curve": curve})
        ),
    ]
}

fn distance() -> impl Strategy<Value = Value> {
    prop_oneof![
        Just(json!({"type": "none"})),
        (0.0..1.5_f64).prop_map(|mm| json!({"type": "constant", "gap_mm": mm})),
        (0.0..0.3_f64, 0.0..1.0_f64)
            .prop_map(|(f, w)| json!({"type": "proportional", "factor": f, "wall_gap_mm": w})),
        (0.0..0.4_f64).prop_map(|f| json!({"type": "smaller_diameter", "factor": f})),
    ]
}

fn method() -> impl Strategy<Value = Value> {
    prop_oneof![
        Just(json!({"type": "rsa", "attempts_per_grain": 3000})),
        Just(json!({"type": "rsa"})),
        // Enough for the small ones; what jams would take minutes to say so.
        Just(json!({"type": "edmd", "stop": {"events": 100_000}})),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn random_mixes_end_valid_or_say_why_not(
        specimen in specimen(), grading in grading(), distance in distance(),
        fraction in 0.02..0.75_f64, seed in 0_u64..1_000_000, method in method(),
    ) {
        let limited = method.get("attempts_per_grain").is_some();
        let grows = method["type"] == "edmd";
        let value = json!({
            "specimen": specimen, "distance": distance, "method": method,
            "mix": {"grading": grading, "d_min_mm": 2.0, "volume_fraction": fraction, "volume_fraction_of": "placed_grains",
                    "allow_coarse": true},
        });
        let request = request(&value, seed);
        match pack(&request, &Limits::default(), &Unattended) {
            Ok(packing) => {
                prop_assert!(packing.report.check.min_excess_gap_mm.is_none_or(|slack| slack >= 0.0));
                prop_assert!(check::check(packing.spheres().unwrap(), &request).is_ok());
            }
            Err(PackError::TargetNotReached(TargetNotReached::InsertionFailed(short))) => {
                prop_assert!(short.placed < short.grains);
                prop_assert!(short.saturation_proven || (limited && short.attempts == 3000), "{:?}", short);
                prop_assert!(!limited || short.attempts <= 3000, "{:?}", short);
                prop_assert!(short.volume_fraction_reached < short.volume_fraction_asked);
            }
            Err(PackError::TargetNotReached(TargetNotReached::GrowthStopped(short))) => {
                prop_assert!(grows, "{}", short);
                prop_assert!(short.scale_reached > 0.0 && short.scale_reached < 1.0, "{:?}", short);
                prop_assert!(short.volume_fraction_reached < short.volume_fraction_asked, "{:?}", short);
                let is_spent = matches!(short.effort, GrowthEffort::Events { events, .. } if events >= 100_000);
                prop_assert!(short.end == GrowthEnd::Stalled || is_spent, "{:?}", short);
            }
            Err(PackError::Plan(_)) => {}
            Err(other) => prop_assert!(false, "{}", other),
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_packing_and_another_does_not() {
    let value = json!({
        "specimen": {"type": "cylinder", "diameter_mm": 60, "height_mm": 60},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "volume_fraction": 0.5},
    });
    let run = |seed| pack(&request(&value, seed), &Limits::default(), &Unattended).unwrap();
    let (first, again, other) = (run(5), run(5), run(6));
    assert_eq!(first.spheres().unwrap(), again.spheres().unwrap());
    assert_eq!(first.report.statistics, again.report.statistics);
    assert_ne!(first.spheres().unwrap(), other.spheres().unwrap());
}

/// The stream behind a seed is a promise across builds: this fails when it changes, and then the
/// name of the generator in the results must change too.
#[test]
fn the_stream_behind_a_seed_is_pinned() {
    let value = json!({
        "specimen": {"type": "box", "size_mm": [50, 50, 50]},
        "mix": {"grading": {"type": "diameters", "diameters_mm": [10.0, 5.0]}},
    });
    let packing = pack(&request(&value, 1), &Limits::default(), &Unattended).unwrap();
    assert_eq!(
        packing.spheres().unwrap().center(0),
        [38.845_606_968_303_49, 28.755_387_879_297_437, 43.537_922_403_762_5]
    );
}

/// Stops at a step: every loop of the engine must listen.
struct StopIn(Step, AtomicBool);

impl Control for StopIn {
    fn report(&self, progress: &Progress) {
        if progress.step == self.0 {
            self.1.store(true, Ordering::Relaxed);
        }
    }
    fn should_stop(&self) -> bool {
        self.1.load(Ordering::Relaxed)
    }
}

#[test]
fn a_run_can_be_stopped_in_every_step() {
    let value = json!({
        "specimen": {"type": "box", "size_mm": [100, 100, 100]},
        "mix": {"grading": {"type": "standard", "name": "B16"}, "d_min_mm": 1.0, "volume_fraction": 0.5},
    });
    for step in [Step::Sampling, Step::Rsa, Step::Check] {
        let control = StopIn(step, AtomicBool::new(false));
        let ended = pack(&request(&value, 1), &Limits::default(), &control)
            .map(|packing| packing.spheres().unwrap().len());
        assert!(matches!(ended, Err(PackError::Stopped { .. })), "{step:?}: {ended:?}");
    }
}

/// Progress never falls within a run and ends at 1.
struct Rising(Mutex<f64>);

impl Control for Rising {
    fn report(&self, progress: &Progress) {
        let mut last = self.0.lock().unwrap();
        assert!(progress.fraction >= *last && progress.fraction <= 1.0, "{progress:?} after {last}");
        assert!(progress.done <= progress.total, "{progress:?}");
        *last = progress.fraction;
    }
    fn should_stop(&self) -> bool {
        false
    }
}

#[test]
fn progress_rises_to_one() {
    let value = json!({
        "specimen": {"type": "box", "size_mm": [70, 70, 70]},
        "mix": {"grading": {"type": "standard", "name": "B16"}, "d_min_mm": 1.0, "volume_fraction": 0.5},
    });
    let control = Rising(Mutex::new(0.0));
    pack(&request(&value, 1), &Limits::default(), &control).unwrap();
    assert_eq!(*control.0.lock().unwrap(), 1.0);
}

/// Grains that leave no room at all: there is one place for them, and it is found at the first attempt.
#[test]
fn grains_that_fit_exactly_are_packed() {
    let cube = |x: f64, y: f64, z: f64| json!({"type": "box", "size_mm": [x, y, z]});
    let cylinder = |d: f64, h: f64| json!({"type": "cylinder", "diameter_mm": d, "height_mm": h});
    let touching = json!({"type": "none"});
    let gap = |mm: f64| json!({"type": "constant", "gap_mm": mm});
    let rsa = json!({"type": "rsa"});
    let [edmd, auto] = ["edmd", "auto"].map(|name| json!({"type": name}));
    let cases = [
        (cube(10.0, 10.0, 10.0), touching.clone(), vec![10.0], vec![&rsa, &edmd, &auto]),
        (cylinder(10.0, 10.0), touching.clone(), vec![10.0], vec![&rsa, &edmd, &auto]),
        (cylinder(10.1, 30.0), touching.clone(), vec![10.1], vec![&rsa, &edmd, &auto]),
        (cube(10.0, 10.0, 10.0), gap(0.6), vec![9.4], vec![&rsa, &edmd, &auto]),
        (cube(20.0, 10.0, 10.0), touching.clone(), vec![10.0; 2], vec![&edmd, &auto]),
        (cylinder(10.0, 20.0), touching.clone(), vec![10.0; 2], vec![&edmd, &auto]),
        (cube(10.0, 30.0, 10.0), touching.clone(), vec![10.0; 3], vec![&edmd, &auto]),
        (cube(20.4, 10.2, 10.2), gap(0.2), vec![10.0; 2], vec![&edmd, &auto]),
        (cube(20.0, 20.0, 10.0), touching, vec![10.0; 4], vec![&edmd, &auto]),
    ];
    for (specimen, distance, diameters, methods) in cases {
        for method in methods {
            let value = json!({
                "specimen": specimen, "distance": distance, "method": method,
                "mix": {"grading": {"type": "diameters", "diameters_mm": diameters}},
            });
            for seed in 1..4 {
                let packing = pack(&request(&value, seed), &Limits::default(), &Unattended)
                    .unwrap_or_else(|error| panic!("{value} with seed {seed}: {error}"));
                assert_eq!(packing.spheres().unwrap().len(), diameters.len());
                assert!(packing.report.check.min_excess_gap_mm.is_none_or(|excess| excess >= 0.0));
            }
        }
    }
}
