//! Requests of studies: what they expand to, and how they are refused.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;

use proptest::prelude::*;
use serde_json::json;

use super::*;
use crate::jobs::JobRequest;
use crate::planning::Planner;

/// A template that is cheap to plan.
fn job() -> Value {
    json!({
        "specimen": {"type": "box", "size_mm": [50, 50, 50]},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2}
    })
}

fn read(request: &Value) -> Result<Study, Failure> {
    let now = "2026-06-01T00:00:00Z".parse().unwrap();
    Study::read(request, 42, Some(now), &Limits::default())
}

fn refused(request: &Value) -> (FailureCode, Vec<String>) {
    let failure = read(request).unwrap_err();
    (failure.code, failure.fields.iter().map(ToString::to_string).collect())
}

fn fractions(study: &Study) -> Vec<f64> {
    study.points.iter().map(|point| point.job.mix.requested_fraction().unwrap()).collect()
}

#[test]
fn a_grid_is_the_product_of_its_entries_and_the_last_varies_fastest() {
    let study = read(&json!({
        "name": "two by three", "labels": {"series": "TB-7"}, "seed": 7, "template": job(),
        "grid": {
            "/mix/volume_fraction": {"from": 0.1, "to": 0.2, "step": 0.1},
            "/method": [{"type": "rsa"}, {"type": "rsa", "attempts_per_grain": 1000}, {"type": "edmd"}]
        },
        "replicates": 4, "stop_when": {"failed_in_a_row": 3, "interval_width": 0.2}
    }))
    .unwrap();
    assert_eq!(study.name.as_deref(), Some("two by three"));
    assert_eq!(study.labels["series"], "TB-7");
    assert_eq!((study.seed, study.replicates, study.jobs()), (7, 4, 24));
    assert_eq!(study.stop_when, StopWhen { failed_in_a_row: Some(3), interval_width: Some(0.2) });
    assert_eq!(study.columns, ["/mix/volume_fraction", "/method"]);
    assert_eq!(fractions(&study), [0.1, 0.1, 0.1, 0.2, 0.2, 0.2]);
    assert_eq!(study.points[4].values, [json!(0.2), json!({"type": "rsa", "attempts_per_grain": 1000})]);
    let order: Vec<(usize, usize)> = study.order().collect();
    assert_eq!(order[..7], [(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (5, 0), (0, 1)]);
    assert_eq!(order.len(), 24);
}

#[test]
fn points_that_differ_in_the_method_only_pack_the_same_grains() {
    let study = read(&json!({
        "template": job(), "replicates": 3,
        "grid": {"/mix/volume_fraction": [0.1, 0.2], "/method": [{"type": "rsa"}, {"type": "edmd"}]}
    }))
    .unwrap();
    let seeds: Vec<&Vec<u64>> = study.points.iter().map(|point| &point.seeds).collect();
    assert_eq!(seeds[0], seeds[1]);
    assert_eq!(seeds[2], seeds[3]);
    let all: BTreeSet<u64> = seeds.iter().flat_map(|seeds| seeds.iter().copied()).collect();
    assert_eq!(all.len(), 6);
    assert_eq!(study.points[1].replicate(2), JobRequest { seed: seeds[0][2], ..study.points[1].job.clone() });
    assert_eq!(study.points[0].job.seed, seeds[0][0]);
}

#[test]
fn zipped_entries_run_together_and_faster_than_the_grid() {
    let study = read(&json!({
        "template": job(),
        "grid": {"/mix/volume_fraction": [0.1, 0.2]},
        "zip": {"/name": ["small", "large"], "/specimen/size_mm": [[40, 40, 40], [60, 60, 60]]}
    }))
    .unwrap();
    assert_eq!(study.columns, ["/mix/volume_fraction", "/name", "/specimen/size_mm"]);
    assert_eq!(fractions(&study), [0.1, 0.1, 0.2, 0.2]);
    let names: Vec<&str> = study.points.iter().map(|point| point.job.name.as_deref().unwrap()).collect();
    assert_eq!(names, ["small", "large", "small", "large"]);
    assert_eq!(study.points[3].values[2], json!([60, 60, 60]));
}

#[test]
fn a_list_keeps_the_seeds_it_names_and_has_place_and_name_for_columns() {
    let mut named = job();
    named["seed"] = json!(5);
    named["name"] = json!("first");
    let study = read(&json!({"seed": 7, "list": [named, job()]})).unwrap();
    assert_eq!(study.points[0].seeds, [5]);
    // printf '7\n1\n0' | sha256sum
    assert_eq!(study.points[1].seeds, [2_300_643_132_971_063]);
    assert!(study.columns.is_empty());
    let keys = study.keys();
    assert_eq!(keys.columns, ["point", "name"]);
    assert_eq!(keys.values, [[json!(0), json!("first")], [json!(1), Value::Null]]);
    assert_eq!(read(&json!({"list": [job(), job()], "replicates": 3})).unwrap().jobs(), 6);
}

#[test]
fn a_template_alone_is_one_point() {
    let study = read(&json!({"template": job(), "replicates": 2})).unwrap();
    assert_eq!((study.points.len(), study.jobs(), study.seed), (1, 2, 42));
    assert_eq!(study.keys().columns, ["point", "name"]);
    assert_eq!(study.recorded(&json!({"seed": null, "name": "x"})), json!({"seed": 42, "name": "x"}));
}

#[test]
fn a_missing_member_may_be_set_and_a_seed_varied() {
    let study = read(&json!({
        "template": job(), "grid": {"/distance": [null, {"type": "constant", "gap_mm": 1}], "/seed": [3, 4]}
    }))
    .unwrap();
    let seeds: Vec<u64> = study.points.iter().map(|point| point.seeds[0]).collect();
    assert_eq!(seeds, [3, 4, 3, 4]);
}

#[test]
fn ranges_are_the_numbers_on_paper() {
    let study = |range: Value| {
        let request = json!({"template": job(), "grid": {"/mix/volume_fraction": range}});
        fractions(&read(&request).unwrap())
    };
    assert_eq!(
        study(json!({"from": 0.055, "to": 0.09, "step": 0.005})),
        [0.055, 0.06, 0.065, 0.07, 0.075, 0.08, 0.085, 0.09]
    );
    assert_eq!(study(json!({"from": 0.3, "to": 0.1, "step": -0.1})), [0.3, 0.2, 0.1]);
    assert_eq!(study(json!({"from": 0.1, "to": 0.1, "step": 1})), [0.1]);
    // Beyond the last step; and an end that is met but for rounding.
    assert_eq!(study(json!({"from": 0.1, "to": 0.19, "step": 0.05})), [0.1, 0.15]);
    assert_eq!(study(json!({"from": 0.1, "to": 0.3, "step": 0.066_666_666_666_7})).len(), 4);
    let values = Values::Range { from: 0.55, step: 0.005, length: 8 };
    assert_eq!(values.get(7), json!(0.585));
    let values = Values::Range { from: -1.0, step: 0.5, length: 5 };
    let texts: Vec<String> = (0..5).map(|i| values.get(i).to_string()).collect();
    assert_eq!(texts, ["-1", "-0.5", "0", "0.5", "1"]);
    // Terms that cancel: 43 times 0.001 is not 0.043 to a computer.
    let values = Values::Range { from: -0.043, step: 0.001, length: 45 };
    let texts: Vec<String> = (42..45).map(|i| values.get(i).to_string()).collect();
    assert_eq!(texts, ["-0.001", "0", "0.001"]);
}

#[test]
fn faults_of_the_grammar_come_together_at_their_places() {
    let (kind, faults) = refused(&json!({
        "name": "", "seed": -1, "replicates": 0, "colour": 1, "template": job(),
        "stop_when": {"failed_in_a_row": 0, "interval_width": 2, "time_s": 1},
        "grid": {"mix": [1], "/mix/volume_fraction": [], "/specimen/edge/0": 3, "/mix/d_min_mm": {"from": 1, "to": 2, "step": 0}},
        "zip": {"/priority": [1, 2], "/timeout_s": [1, 2, 3]}
    }));
    assert_eq!(kind, FailureCode::ValidationError);
    assert_eq!(
        faults,
        [
            "/name: has 0 characters: must have at least 1 and at most 200",
            "/seed: -1 is out of range: must be a whole number from 0 to 9007199254740991",
            "/replicates: 0 is out of range: must be a whole number from 1 to 10000",
            "/stop_when/failed_in_a_row: 0 is out of range: must be a whole number from 1 to 10000",
            "/stop_when/interval_width: 2 is out of range: must be greater than 0 and at most 1",
            "/stop_when/time_s: unknown field: this object has failed_in_a_row, interval_width",
            "/grid/mix: the key is no JSON pointer to a field: must begin with a slash, as /mix/volume_fraction",
            "/grid/~1mix~1volume_fraction: has no values: must have at least 1",
            "/grid/~1specimen~1edge~10: the template has no /specimen/edge, so that nothing can be put into it: \
             write it there",
            "/grid/~1specimen~1edge~10: must be a list of values, or a range as {\"from\": 0.55, \"to\": 0.7, \
             \"step\": 0.005}",
            "/grid/~1mix~1d_min_mm/step: 0 is out of range: must lead from 1 to 2",
            "/zip/~1timeout_s: has 3 values: must have 2 as /priority, which it runs together with",
            "/colour: unknown field: this object has name, labels, seed, replicates, stop_when, shared, webhook_url, \
             list, template, grid, zip",
        ]
    );
}

#[test]
fn what_contradicts_itself_is_refused() {
    let seeded = |mut job: Value| {
        job["seed"] = json!(1);
        job
    };
    for (request, says) in [
        (json!({}), "document: there are no jobs"),
        (json!([]), "document: an array is not an object"),
        (json!({"list": []}), "/list: has no jobs"),
        (json!({"list": [job()], "template": job()}), "/template: a study has a list of jobs or a template"),
        (json!({"list": [job()], "grid": {}}), "/grid: a list of jobs has no places to vary"),
        (json!({"list": [job(), seeded(job())], "replicates": 2}), "/list/1/seed: with replicates"),
        (json!({"template": seeded(job())}), "/template/seed: the seeds of the jobs derive"),
        (
            json!({"template": job(), "grid": {"/seed": [1]}, "replicates": 2}),
            "/grid/~1seed: with replicates",
        ),
        (
            json!({"template": job(), "grid": {"/mix": [{}], "/mix/d_min_mm": [1]}}),
            "/grid/~1mix~1d_min_mm: the place overlaps with that of /mix:",
        ),
        (
            json!({"template": job(), "grid": {"/mix/d_min_mm": [1]}, "zip": {"/mix/d_min_mm": [1]}}),
            "/zip/~1mix~1d_min_mm: the place overlaps",
        ),
        (
            json!({"template": job(), "grid": {"/mix/volume_fraction": [0.1, 0.2, 0.1]}}),
            "/grid/~1mix~1volume_fraction/2: the value occurs twice",
        ),
        (
            json!({"template": job(), "grid": {"/specimen/size_mm/3": [0.1]}}),
            "/grid/~1specimen~1size_mm~13: the template has no such item: /specimen/size_mm has 3 items",
        ),
    ] {
        let (kind, faults) = refused(&request);
        assert_eq!((kind, faults.len()), (FailureCode::ValidationError, 1), "{request} {faults:?}");
        assert!(faults[0].starts_with(says), "{} does not say {says:?}", faults[0]);
    }
}

#[test]
fn faults_of_jobs_point_to_what_the_user_wrote() {
    let (kind, faults) = refused(&json!({
        "template": {"specimen": {"type": "box", "size_mm": [50, 50, -50]}, "mix": job()["mix"]},
        "grid": {
            "/mix/volume_fraction": {"from": 0.5, "to": 1.5, "step": 0.5},
            "/method": [{"type": "rsa"}, {"type": "rsa", "colour": 1}]
        },
        "zip": {"/priority": [1, "high"]}
    }));
    assert_eq!(kind, FailureCode::ValidationError);
    assert_eq!(
        faults,
        [
            "/template/specimen/size_mm/2: point 0 and 11 more: -50 is out of range: must be at least 1e-6 and at \
             most 1000000 mm",
            "/zip/~1priority/1: point 1 and 5 more: \"high\" is not a whole number",
            "/grid/~1method/1/colour: point 2 and 5 more: unknown field: this object has type, attempts_per_grain",
            "/grid/~1mix~1volume_fraction: point 8 and 3 more: 1.5 is out of range: must be at least 1e-9 and at \
             most 1",
        ]
    );
    let (_, faults) = refused(&json!({"list": [job(), {"specimen": job()["specimen"], "name": ""}]}));
    assert_eq!(
        faults,
        [
            "/list/1/name: has 0 characters: must have at least 1 and at most 200",
            "/list/1/mix: is missing: the field is required",
        ]
    );
}

#[test]
fn one_point_that_cannot_be_packed_refuses_the_study() {
    let grid = |fractions: Value| json!({"template": job(), "grid": {"/mix/volume_fraction": fractions}});
    let (kind, faults) = refused(&grid(json!([0.2, 0.9, 0.3])));
    assert_eq!((kind, faults.len()), (FailureCode::InfeasibleMix, 1), "{faults:?}");
    assert!(
        faults[0].starts_with("/grid/~1mix~1volume_fraction/1: point 1: the grains to place"),
        "{faults:?}"
    );
    // The gravest kind speaks for all.
    let (kind, faults) = refused(&grid(json!([0.9, 2])));
    assert_eq!((kind, faults.len()), (FailureCode::ValidationError, 2), "{faults:?}");
    let (_, faults) = refused(&grid(json!({"from": 0.7, "to": 0.95, "step": 0.05})));
    assert_eq!(faults.len(), 1, "{faults:?}");
    assert!(faults[0].starts_with("/grid/~1mix~1volume_fraction: point 1 and 4 more: "), "{faults:?}");
    let request = json!({"template": job(), "grid": {"/specimen/size_mm": [[50, 50, 50], [1e5, 1e5, 1e5]]}});
    let (kind, faults) = refused(&request);
    assert_eq!(kind, FailureCode::TooLarge, "{faults:?}");
    assert!(faults[0].contains("point 1: "), "{faults:?}");
}

#[test]
fn too_many_jobs_are_refused_before_they_are_made() {
    let phi = "/mix/volume_fraction";
    for (request, says) in [
        (
            json!({"template": job(), "grid": {phi: {"from": 0.1, "to": 0.2, "step": 0.001}}, "replicates": 100}),
            "document: the study has 10100 jobs (points: 101, replicates: 100): must have at most 10000",
        ),
        (
            json!({"template": job(), "grid": {phi: {"from": 0, "to": 1e300, "step": 1e-3}}}),
            "document: the study has",
        ),
        (json!({"list": vec![job(); 101], "replicates": 100}), "document: the study has 10100 jobs"),
    ] {
        let (kind, faults) = refused(&request);
        assert_eq!((kind, faults.len()), (FailureCode::TooLarge, 1), "{faults:?}");
        assert!(faults[0].starts_with(says), "{faults:?}");
    }
}

#[test]
fn long_lists_times_many_jobs_are_refused() {
    let mut template = job();
    template["mix"] = json!({"grading": {"type": "diameters", "diameters_mm": vec![1.5; 100_000]}});
    let (kind, faults) = refused(&json!({"template": template, "replicates": 200}));
    assert_eq!(kind, FailureCode::TooLarge);
    assert!(faults[0].contains("bytes of JSON together: must be at most 67108864"), "{faults:?}");
}

#[test]
fn axes_and_their_values_are_bounded() {
    for axes in ["grid", "zip"] {
        let entries: serde_json::Map<String, Value> =
            (0..50_000).map(|i| (format!("/{i}"), json!([1]))).collect();
        let (code, faults) = refused(&json!({"template": job(), axes: entries}));
        assert_eq!(code, FailureCode::ValidationError);
        assert_eq!(faults, [format!("/{axes}: has 50000 entries: must have at most 32")]);
        let (_, faults) = refused(&json!({"template": job(), axes: {"/name": vec!["a"; 10_001]}}));
        assert_eq!(faults, [format!("/{axes}/~1name: has 10001 values: must have at most 10000")]);
        let long = format!("/{}", "x/".repeat(100_000));
        let (_, faults) = refused(&json!({"template": job(), axes: {long: [1]}}));
        assert!(faults[0].ends_with("the key has 200001 characters: must have at most 250"), "{faults:?}");
        assert!(faults[0].len() < 1000);
    }
    let mut template = job();
    template["mix"] = json!({"grading": {"type": "diameters", "diameters_mm": vec![1; 5000]}});
    let (code, faults) =
        refused(&json!({"template": template, "grid": {"/priority": {"from": 0, "to": 99, "step": 0.1}}}));
    assert_eq!(code, FailureCode::TooLarge);
    assert!(faults[0].contains("values together: must hold at most 4000000"), "{faults:?}");
}

#[test]
fn a_point_whose_exports_cannot_be_made_refuses_the_study() {
    let mut periodic = job();
    periodic["specimen"]["boundary"] = json!("periodic");
    periodic["postprocess"] = json!([{"type": "ldpm"}]);
    let (code, faults) = refused(&json!({"list": [job(), periodic]}));
    assert_eq!(code, FailureCode::FormatNotAvailable, "{faults:?}");
    assert!(faults[0].starts_with("/list/1/postprocess/0"), "{faults:?}");
}

#[test]
fn reading_stops_when_nobody_waits() {
    let request =
        json!({"template": job(), "replicates": 1, "grid": {"/priority": {"from": 0, "to": 99, "step": 1}}});
    let checks = std::cell::Cell::new(0);
    let go_on = || {
        checks.set(checks.get() + 1);
        checks.get() < 5
    };
    let stopped =
        Study::read_while(&request, 42, None, &Limits::default(), &Planner::default(), &go_on).unwrap_err();
    assert_eq!((stopped.code, checks.get()), (FailureCode::InternalError, 5));
}

#[test]
fn of_many_faults_the_first_are_told() {
    let (_, faults) = refused(&json!({"list": vec![json!({"name": "", "mix": 1}); 200]}));
    assert_eq!(faults.len(), 101);
    assert_eq!(faults[100], "document: and 500 more faults");
}

proptest! {
    #[test]
    fn a_refined_study_keeps_the_packings_it_had(
        fractions in prop::collection::btree_set(50..400_u32, 1..12),
        kept in any::<u64>(),
        replicates in 1..4_usize,
    ) {
        let values = |keep: &dyn Fn(usize) -> bool| -> Vec<Value> {
            let kept = fractions.iter().enumerate().filter(|(i, _)| keep(*i));
            kept.map(|(_, x)| json!(f64::from(*x) / 1000.0)).collect()
        };
        let study = |values: Vec<Value>, replicates: usize| {
            read(&json!({"template": job(), "grid": {"/mix/volume_fraction": values}, "replicates": replicates}))
        };
        let coarse = values(&|i| i == 0 || kept & (1 << i) != 0);
        let coarse = study(coarse, replicates).unwrap();
        let fine = study(values(&|_| true), replicates + 1).unwrap();
        for point in &coarse.points {
            let same = fine.points.iter().find(|fine| fine.values == point.values).unwrap();
            prop_assert_eq!(&point.seeds[..], &same.seeds[..replicates]);
        }
    }

    #[test]
    fn every_combination_is_a_point_once(lengths in prop::collection::vec(1..4_usize, 0..4), zipped in 0..4_usize) {
        let places = ["/priority", "/max_attempts", "/timeout_s", "/mix/grading/diameter_mm"];
        let values = |n: usize| (1..=n).map(|i| json!(i)).collect::<Vec<_>>();
        let grid: serde_json::Map<String, Value> =
            places.iter().zip(&lengths).map(|(place, n)| ((*place).into(), json!(values(*n)))).collect();
        let mut request = json!({"template": job(), "grid": grid});
        if zipped > 0 {
            let names: Vec<String> = (0..zipped).map(|i| format!("{i}")).collect();
            request["zip"] = json!({"/name": names, "/labels": vec![json!({}); zipped]});
        }
        let study = read(&request).unwrap();
        let points: BTreeSet<String> = study.points.iter().map(|point| json!(point.values).to_string()).collect();
        prop_assert_eq!(points.len(), study.points.len());
        prop_assert_eq!(points.len(), lengths.iter().product::<usize>() * zipped.max(1));
        for point in &study.points {
            let job = json!(point.job);
            for (column, value) in study.columns.iter().zip(&point.values) {
                // Numbers of the job may have gained a point.
                let (found, expected) = (job.pointer(column), Some(value));
                let number = |value: Option<&Value>| value.and_then(Value::as_f64);
                prop_assert!(found == expected || number(found).is_some() && number(found) == number(expected));
            }
        }
    }

    #[test]
    fn ranges_meet_both_ends(from in -1000..1000_i32, steps in 0..2000_u32, step in 1..1000_u32) {
        let (from, step) = (f64::from(from) / 1000.0, f64::from(step) / 1000.0);
        let to = from + f64::from(steps) * step;
        let request = json!({"from": from, "to": to, "step": step});
        let faults = Faults::default();
        let values = read_range(&At::root(&request, &faults)).unwrap();
        prop_assert_eq!(values.len(), u64::from(steps) + 1);
        prop_assert_eq!(values.get(0).as_f64(), Some(from));
        let last = values.get(steps as usize).as_f64().unwrap();
        prop_assert!((last - to).abs() <= 1e-11 * to.abs().max(1e-3), "{} {}", last, to);
        // Three decimals went in, no more come out.
        for i in 0..=steps as usize {
            let text = values.get(i).to_string();
            prop_assert!(text.split('.').nth(1).is_none_or(|decimals| decimals.len() <= 3), "{}", text);
        }
    }
}
