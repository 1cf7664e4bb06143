//! Gradients through the public interface: they are there where they were asked for, and nowhere else.

use std::sync::Mutex;

use packstone_engine::packing::{SegregationReport, Separation};
use packstone_engine::{
    Checkpoint, Control, Limits, Packing, PackingRequest, Plan, Progress, Resume, TemplateCache, Unattended,
    pack, pack_or_resume,
};
use serde_json::{Value, json};

fn cube() -> Value {
    json!({"type": "box", "size_mm": [50, 50, 50]})
}

fn cylinder() -> Value {
    json!({"type": "cylinder", "diameter_mm": 60, "height_mm": 40})
}

fn linear() -> Value {
    json!({"type": "linear", "axis": "z"})
}

fn job(specimen: &Value, phi: f64, method: &Value) -> Value {
    json!({
        "specimen": specimen, "method": method,
        "mix": {"grading": {"type": "fuller", "d_max_mm": 12, "exponent": 0.5}, "d_min_mm": 2.5,
                "volume_fraction": phi, "volume_fraction_of": "placed_grains"},
    })
}

fn with_gradient(mut job: Value, field: &Value, strength: f64) -> Value {
    job["segregation"] = json!({"type": "gradient", "field": field, "strength": strength});
    job
}

fn packed(job: &Value, seed: u64) -> Packing {
    let request = PackingRequest::from_json(job, seed).unwrap();
    pack(&request, &Limits::default(), &Unattended).unwrap()
}

fn placement(job: &Value, seed: u64) -> SegregationReport {
    packed(job, seed).report.segregation.unwrap()
}

fn controls(report: &SegregationReport) -> Vec<Separation> {
    let across = report.across;
    [across.x, across.y, across.z].into_iter().flatten().collect()
}

/// The smallest p value of 999 permutations: none of them has as large a statistic as the packing.
const LEAST_P: f64 = 1.0 / 1000.0;

/// A difference along the field in every seed, and none across it in most of them.
fn assert_along_and_not_across(job: &Value, least: f64) {
    let mut by_chance = Vec::new();
    for seed in 1..=3 {
        let found = placement(job, seed);
        assert!(found.along.difference > least && found.along.p_value == LEAST_P, "{found:?}");
        by_chance.extend(controls(&found).iter().map(|control| control.p_value));
    }
    let beyond = by_chance.iter().filter(|p| **p < 0.05).count();
    assert!(beyond * 3 <= by_chance.len(), "{by_chance:?}");
}

#[test]
fn a_strong_gradient_is_seen_along_its_axis_and_not_across() {
    for method in [json!({"type": "rsa"}), json!({"type": "rsa", "attempts_per_grain": 100_000})] {
        assert_along_and_not_across(&with_gradient(job(&cube(), 0.4, &method), &linear(), 30.0), 0.4);
    }
    let up = json!({"type": "linear", "axis": "x", "direction": "up"});
    let found = placement(&with_gradient(job(&cube(), 0.4, &json!({"type": "rsa"})), &up, 30.0), 1);
    assert!(found.along.difference > 0.25 && found.across.x.is_none(), "{found:?}");
}

#[test]
fn coarse_grains_lie_where_the_field_says() {
    let mean_height = |direction: &str| {
        let field = json!({"type": "linear", "axis": "z", "direction": direction});
        let spheres = packed(&with_gradient(job(&cube(), 0.4, &json!({"type": "rsa"})), &field, 30.0), 1)
            .into_spheres()
            .unwrap();
        spheres.z_mm[..10].iter().sum::<f64>() / 10.0
    };
    assert!(mean_height("up") > 35.0 && mean_height("down") < 15.0);
}

#[test]
fn a_lateral_surface_draws_coarse_grains_in_a_cylinder() {
    let side = json!({"type": "face", "face": "side"});
    let strong = with_gradient(job(&cylinder(), 0.35, &json!({"type": "rsa"})), &side, 30.0);
    assert_along_and_not_across(&strong, 0.4);
    let bottom = json!({"type": "face", "face": "z_min"});
    assert_along_and_not_across(
        &with_gradient(job(&cylinder(), 0.35, &json!({"type": "rsa"})), &bottom, 30.0),
        0.4,
    );
}

#[test]
fn growth_and_its_exchanges_keep_the_gradient() {
    for method in [json!({"type": "edmd"}), json!({"type": "edmd", "swap": false})] {
        assert_along_and_not_across(&with_gradient(job(&cube(), 0.6, &method), &linear(), 30.0), 0.25);
    }
    // The largest distance: from a gradient on to the end.
    let mut longest = job(&cube(), 0.45, &json!({"type": "edmd", "stop": {"events": 200_000}}));
    longest["distance"] = json!({"type": "maximize"});
    let found = placement(&with_gradient(longest, &linear(), 30.0), 1);
    assert!(found.along.difference > 0.3 && found.along.p_value == LEAST_P, "{found:?}");
}

#[test]
fn no_strength_is_random_placing_bit_for_bit() {
    for method in [json!({"type": "rsa"}), json!({"type": "edmd"}), json!({"type": "auto"})] {
        let random = job(&cube(), 0.35, &method);
        let (a, b) = (packed(&random, 1), packed(&with_gradient(random, &linear(), 0.0), 1));
        assert_eq!(a.spheres().unwrap(), b.spheres().unwrap());
        assert!(a.report.segregation.is_none() && b.report.segregation.is_some());
    }
}

const SEEDS: u64 = 50;

fn reports(job: &Value) -> Vec<SegregationReport> {
    (0..SEEDS).map(|seed| placement(job, seed)).collect()
}

/// Largest excess of the share of p values below one over it, and the other way round, in units in which 1.86
/// has probability 1e-3 (Kolmogorov and Smirnov, one-sided).
fn gaps(reports: &[SegregationReport]) -> (f64, f64) {
    let mut p: Vec<f64> = reports.iter().map(|report| report.along.p_value).collect();
    p.sort_by(f64::total_cmp);
    let n = p.len() as f64;
    let most = |gap: &dyn Fn(f64, f64) -> f64| {
        p.iter().enumerate().map(|(i, p)| gap(i as f64, *p)).fold(0.0, f64::max) * n.sqrt()
    };
    (most(&|i, p| (i + 1.0) / n - p), most(&|i, p| p - i / n))
}

#[test]
fn without_a_gradient_p_values_are_uniform_where_grains_do_not_crowd() {
    for strength in [0.0, 1.0e-9] {
        let sparse = with_gradient(job(&cube(), 0.05, &json!({"type": "rsa"})), &linear(), strength);
        let (small, large) = gaps(&reports(&sparse));
        assert!(small < 1.86 && large < 1.86, "{strength}: {small} {large}");
    }
}

/// Crowded grains are spread more evenly than chance would spread them one by one, and p values know that: they are
/// uniform (of permutations alone their median was 0.62 at 35 % and 0.72 at 60 %). The least strength runs all the
/// machinery of a gradient.
#[test]
fn without_a_gradient_p_values_are_uniform_where_grains_crowd() {
    for (method, phi, strength) in [("rsa", 0.4, 0.0), ("rsa", 0.4, 1.0e-9), ("edmd", 0.6, 1.0e-9)] {
        let crowded = with_gradient(job(&cube(), phi, &json!({"type": method})), &linear(), strength);
        let found = reports(&crowded);
        let (small, large) = gaps(&found);
        assert!(small < 1.86 && large < 1.86, "{method} {strength}: {small} {large}");
        let mean = found.iter().map(|found| found.along.difference).sum::<f64>() / SEEDS as f64;
        assert!(mean.abs() < 0.02, "{method} {strength}: {mean}");
    }
}

/// A weak gradient, which permutations of sizes alone would call chance in half of the packings.
#[test]
fn a_weak_gradient_is_told_from_chance() {
    let weak = with_gradient(job(&cube(), 0.4, &json!({"type": "rsa"})), &linear(), 3.0);
    let found: Vec<f64> = (0..10).map(|seed| placement(&weak, seed).along.p_value).collect();
    assert!(found.iter().filter(|p| **p < 0.05).count() >= 8, "{found:?}");
}

#[test]
fn a_gradient_leaves_the_diameters_alone_and_is_reproducible() {
    let random = job(&cube(), 0.4, &json!({"type": "rsa"}));
    let gradient = with_gradient(random.clone(), &linear(), 10.0);
    let (first, again) = (packed(&gradient, 7), packed(&gradient, 7));
    assert_eq!(first.spheres().unwrap(), again.spheres().unwrap());
    assert_eq!(first.report.segregation, again.report.segregation);
    let random = packed(&random, 7);
    assert_eq!(first.spheres().unwrap().d_mm, random.spheres().unwrap().d_mm);
    assert_ne!(first.spheres().unwrap().z_mm, random.spheres().unwrap().z_mm);
}

/// Keeps the checkpoint of each epoch.
struct Keeping(Mutex<Vec<Vec<u8>>>);

impl Control for Keeping {
    fn report(&self, _: &Progress) {}
    fn should_stop(&self) -> bool {
        false
    }
    fn wants_checkpoint(&self) -> bool {
        true
    }
    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        let mut bytes = Vec::new();
        checkpoint.write_to(&mut bytes).unwrap();
        self.0.lock().unwrap().push(bytes);
    }
}

#[test]
fn a_run_that_was_interrupted_ends_as_it_would_have() {
    let value = with_gradient(job(&cube(), 0.6, &json!({"type": "edmd"})), &linear(), 30.0);
    let request = PackingRequest::from_json(&value, 3).unwrap();
    let keeping = Keeping(Mutex::new(Vec::new()));
    let whole = pack(&request, &Limits::default(), &keeping).unwrap();
    let kept = keeping.0.into_inner().unwrap();
    assert!(kept.len() > 2);
    let resume = Resume::read_from(&mut &kept[kept.len() / 2][..], &request).unwrap();
    let resumed =
        pack_or_resume(&request, &Limits::default(), &TemplateCache::default(), Some(resume), &Unattended)
            .unwrap();
    assert_eq!(resumed.spheres().unwrap(), whole.spheres().unwrap());
    assert_eq!(resumed.report.segregation, whole.report.segregation);
}

#[test]
fn the_plan_says_that_it_does_not_know_gradients() {
    let plan = |strength| {
        let value = with_gradient(job(&cube(), 0.4, &json!({"type": "auto"})), &linear(), strength);
        Plan::new(&PackingRequest::from_json(&value, 1).unwrap(), &Limits::default()).unwrap()
    };
    let says = |plan: &Plan| plan.extrapolations.iter().any(|beyond| beyond.contains("gradient"));
    let (none, strong) = (plan(0.0), plan(10.0));
    assert!(says(&strong) && !says(&none));
    assert_eq!((none.grains, none.methods), (strong.grains, strong.methods));
}

/// The same mix of ellipsoids, or of rounded polyhedra.
fn of_shapes(mut job: Value, angular: bool) -> Value {
    job["mix"]["shape"] = if angular {
        json!({"type": "polyhedron", "rounding": 0.05, "template_count": 4})
    } else {
        json!({"type": "ellipsoid", "ratios": {"type": "triangle", "k": 0.4}})
    };
    job
}

#[test]
fn a_gradient_of_shapes_is_seen_along_its_axis_and_not_across() {
    for (angular, phi) in [(false, 0.4), (true, 0.3)] {
        let random = of_shapes(job(&cube(), phi, &json!({"type": "rsa"})), angular);
        assert_along_and_not_across(&with_gradient(random, &linear(), 30.0), 0.3);
    }
    let side = json!({"type": "face", "face": "side"});
    let in_cylinder = of_shapes(job(&cylinder(), 0.3, &json!({"type": "rsa"})), false);
    assert_along_and_not_across(&with_gradient(in_cylinder, &side, 30.0), 0.3);
}

#[test]
fn growth_of_shapes_and_its_exchanges_keep_the_gradient() {
    for (angular, phi) in [(false, 0.6), (true, 0.5)] {
        let grown = of_shapes(job(&cube(), phi, &json!({"type": "monte_carlo"})), angular);
        assert_along_and_not_across(&with_gradient(grown, &linear(), 30.0), 0.2);
    }
}

#[test]
fn no_strength_packs_shapes_bit_for_bit_as_without_a_gradient() {
    for (method, phi) in [("rsa", 0.3), ("monte_carlo", 0.5), ("auto", 0.3)] {
        let random = of_shapes(job(&cube(), phi, &json!({"type": method})), false);
        let (a, b) = (packed(&random, 1), packed(&with_gradient(random, &linear(), 0.0), 1));
        assert_eq!(a.grains, b.grains, "{method}");
        assert!(a.report.segregation.is_none() && b.report.segregation.is_some());
    }
}

/// As for spheres: the least strength runs all the machinery of a gradient.
#[test]
fn without_a_gradient_p_values_of_shapes_are_uniform() {
    for (angular, phi, strength) in [(false, 0.35, 1.0e-9), (true, 0.2, 0.0)] {
        let random = of_shapes(job(&cube(), phi, &json!({"type": "rsa"})), angular);
        let found = reports(&with_gradient(random, &linear(), strength));
        let (small, large) = gaps(&found);
        assert!(small < 1.86 && large < 1.86, "{angular} {strength}: {small} {large}");
        let mean = found.iter().map(|found| found.along.difference).sum::<f64>() / SEEDS as f64;
        assert!(mean.abs() < 0.02, "{angular} {strength}: {mean}");
    }
}

#[test]
fn growth_of_shapes_along_a_gradient_goes_on_from_a_checkpoint_to_the_same_packing() {
    let grown = of_shapes(job(&cube(), 0.6, &json!({"type": "monte_carlo"})), false);
    let request = PackingRequest::from_json(&with_gradient(grown, &linear(), 30.0), 3).unwrap();
    let keeping = Keeping(Mutex::new(Vec::new()));
    let whole = pack(&request, &Limits::default(), &keeping).unwrap();
    let kept = keeping.0.into_inner().unwrap();
    assert!(kept.len() > 2);
    let resume = Resume::read_from(&mut &kept[kept.len() / 2][..], &request).unwrap();
    let resumed =
        pack_or_resume(&request, &Limits::default(), &TemplateCache::default(), Some(resume), &Unattended)
            .unwrap();
    assert_eq!(resumed.grains, whole.grains);
    assert_eq!(resumed.report.segregation, whole.report.segregation);
}

/// Few grains, so few that thirds are single ones.
#[test]
fn even_one_grain_has_a_report() {
    let value = json!({
        "specimen": cube(), "mix": {"grading": {"type": "diameters", "diameters_mm": [10.0]}}, "method": {"type": "rsa"},
    });
    let found = placement(&with_gradient(value, &linear(), 100.0), 1);
    assert_eq!((found.along.difference, found.along.p_value), (0.0, 1.0));
}
