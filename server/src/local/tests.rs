//! Tests of packings in the process of a caller.

#![allow(clippy::unwrap_used)]

use serde_json::{Value, json};

use super::*;

const FAST: &str = r#"{"specimen": {"type": "box", "size_mm": [40, 40, 40]}, "seed": 7,
    "mix": {"grading": {"type": "standard", "name": "A16"}, "volume_fraction": 0.4}}"#;

/// Grains that grow for a second or so.
fn growth(seed: Option<u64>) -> String {
    let mut job = json!({
        "specimen": {"type": "box", "size_mm": [60, 60, 60]},
        "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": 3, "volume_fraction": 0.9},
        "method": {"type": "edmd", "initial_scale": 0.5},
        "distance": {"type": "none"}
    });
    if let Some(seed) = seed {
        job["seed"] = seed.into();
    }
    job.to_string()
}

fn problem(ended: Ended) -> Value {
    let Ended::Refused(document) = ended else { panic!("{ended}") };
    serde_json::from_str(&document).unwrap()
}

#[test]
fn a_packing_has_the_forms_of_a_service_and_is_restored() {
    let packed = Job::read(FAST, None, None).unwrap().pack(&Run::default()).unwrap();
    let (values, columns) = packed.columns().unwrap();
    assert_eq!((values.len(), columns), (4 * packed.len(), 4));
    let report: Value = serde_json::from_str(&packed.report().unwrap()).unwrap();
    assert_eq!((&report["request"]["seed"], &report["check"]["pairs_checked"].is_u64()), (&json!(7), &true));
    let again = Packed::restore(&packed.store().unwrap()).unwrap();
    assert_eq!((again.columns().unwrap().0, again.report().unwrap()), (values, packed.report().unwrap()));
    assert!(Packed::restore(b"nonsense").is_err());
    for format in ["json", "csv", "npy", "vtp", "vtk", "view", "html"] {
        let (mut one, mut other) = (Vec::new(), Vec::new());
        packed.write_table(format, &mut one).unwrap();
        again.write_table(format, &mut other).unwrap();
        assert!(!one.is_empty() && one == other, "{format}");
    }
    let mut file = Vec::new();
    let report = packed.write_export("slice", r#"{"axis": "x"}"#, &Run::default(), &mut file).unwrap();
    assert!(report.contains("\"type\":\"slice\"") && file.starts_with(b"<svg"), "{report}");
    let svg = packed.plot("grading", false, "dark").unwrap();
    assert!(svg.starts_with("<svg"), "{svg}");
    let picture = packed.picture(64, &Run::default()).unwrap();
    assert!(picture.starts_with(b"\x89PNG") && picture == again.picture(64, &Run::default()).unwrap());
}

#[test]
fn refusals_are_the_documents_of_a_service() {
    let job = FAST.replace("0.4", "1.4");
    let refused = problem(Job::read(&job, None, None).unwrap_err());
    assert_eq!(refused["type"], "/problems/validation-error");
    assert_eq!(refused["errors"][0]["pointer"], "/mix/volume_fraction");
    assert_eq!(problem(Job::read("{", None, None).unwrap_err())["type"], "/problems/malformed-json");
    let few = Job::read(FAST, Some(10), None).unwrap();
    assert_eq!(problem(few.plan().unwrap_err())["type"], "/problems/too-large");
    assert_eq!(problem(few.pack(&Run::default()).unwrap_err())["type"], "/problems/too-large");
    let packed = Job::read(FAST, None, None).unwrap().pack(&Run::default()).unwrap();
    let mut file = Vec::new();
    for (export, options, pointer) in
        [("cube", "{}", "/type"), ("voxels", r#"{"cells": 0}"#, "/cells"), ("slice", "3", "")]
    {
        let refused = problem(packed.write_export(export, options, &Run::default(), &mut file).unwrap_err());
        assert_eq!(refused["errors"][0]["pointer"], pointer, "{refused:#}");
    }
    let refused = problem(packed.write_table("xls", &mut file).unwrap_err());
    assert!(refused["detail"].as_str().unwrap().contains("csv, vtk"), "{refused:#}");
    assert_eq!(
        problem(packed.plot("zingg", true, "light").unwrap_err())["type"],
        "/problems/format-not-available"
    );
    assert_eq!(problem(packed.plot("radial", true, "red").unwrap_err())["errors"][0]["pointer"], "/theme");
    assert_eq!(file, Vec::<u8>::new());
}

#[test]
fn a_plan_and_the_runs_of_a_study_are_those_of_a_service() {
    let plan: Value = serde_json::from_str(&Job::read(FAST, None, None).unwrap().plan().unwrap()).unwrap();
    assert!(plan["grains"].as_f64().unwrap() > 100.0 && plan["proposal"].is_object(), "{plan:#}");
    let template: Value = serde_json::from_str(FAST).unwrap();
    let study = json!({"seed": 5, "template": template, "replicates": 2,
        "grid": {"/mix/volume_fraction": [0.2, 0.3]}});
    let mut study = study;
    study["template"].as_object_mut().unwrap().remove("seed");
    let runs: Value =
        serde_json::from_str(&Study::read(&study.to_string()).unwrap().runs().unwrap()).unwrap();
    assert_eq!(runs["columns"], json!(["/mix/volume_fraction"]));
    let values: Vec<_> = runs["points"].as_array().unwrap().iter().map(|point| &point["values"]).collect();
    assert_eq!(values, [&json!([0.2]), &json!([0.3])]);
    assert!(runs["points"][0]["warnings"][0].as_str().unwrap().contains("40 mm"), "{runs:#}");
    let places: Vec<_> =
        runs["runs"].as_array().unwrap().iter().map(|run| (&run["point"], &run["replicate"])).collect();
    assert_eq!(places.len(), 4, "{runs:#}");
    let seeds: std::collections::HashSet<_> =
        runs["runs"].as_array().unwrap().iter().map(|run| run["request"]["seed"].as_u64().unwrap()).collect();
    assert_eq!(seeds.len(), 4, "each run has a seed of its own");
    study["grid"]["/mix/volume_fraction"] = json!([2]);
    assert_eq!(problem(Study::read(&study.to_string()).unwrap_err())["type"], "/problems/validation-error");
}

#[test]
fn a_stopped_run_keeps_a_last_checkpoint_and_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.checkpoint");
    // Never due: the last one is written because the run is stopped.
    let run = Run::with_checkpoint_every(std::time::Duration::from_hours(1));
    let job = Job::read(&growth(None), None, Some(&file)).unwrap();
    let ended = std::thread::scope(|scope| {
        let packing = scope.spawn(|| job.pack(&run));
        let grows = || run.take_progress().is_some_and(|told| told.contains("\"growth\""));
        while !packing.is_finished() && !grows() {
            std::thread::yield_now();
        }
        run.stop();
        packing.join().unwrap()
    });
    assert!(matches!(ended, Err(Ended::Stopped)), "{ended:?}");
    assert!(file.exists());
    // Of another request.
    let other = Job::read(&growth(Some(1)), None, Some(&file)).unwrap().pack(&Run::default()).unwrap_err();
    assert!(problem(other)["detail"].as_str().unwrap().contains("belongs to another request"));
    // What refuses the job before it runs says nothing about the checkpoint.
    let few = Job::read(&growth(None), Some(10), Some(&file)).unwrap();
    assert_eq!(problem(few.pack(&Run::default()).unwrap_err())["type"], "/problems/too-large");
    assert!(file.exists());
    // The seed that was drawn is that of the checkpoint.
    let again = Job::read(&growth(None), None, Some(&file)).unwrap();
    assert_eq!(again.request.seed, job.request.seed);
    let resumed = again.pack(&Run::default()).unwrap();
    assert!(!file.exists());
    let alone =
        Job::read(&growth(Some(job.request.seed)), None, None).unwrap().pack(&Run::default()).unwrap();
    assert!(resumed.columns().unwrap() == alone.columns().unwrap(), "the bits differ");
}

#[test]
fn a_table_counts_what_ran_and_what_a_stop_rule_left_out() {
    let mut template: Value = serde_json::from_str(FAST).unwrap();
    template.as_object_mut().unwrap().remove("seed");
    let study = json!({"seed": 5, "template": template, "replicates": 3, "stop_when": {"failed_in_a_row": 1},
        "grid": {"/mix/volume_fraction": [0.2, 0.3]}});
    let study = Study::read(&study.to_string()).unwrap();
    let runs: Value = serde_json::from_str(&study.runs().unwrap()).unwrap();
    let (record, packed) = run_of_study(&runs["runs"][0]["request"].to_string(), &Run::default()).unwrap();
    assert!(packed.is_some());
    let mut ran: Value = serde_json::from_str(&record).unwrap();
    assert_eq!(ran["outcome"], "succeeded");
    (ran["point"], ran["replicate"]) = (json!(0), json!(0));
    // As a run elsewhere may end.
    let failed =
        json!({"point": 1, "replicate": 0, "outcome": "target_not_reached", "facts": {"time_s": 1.0}});
    assert!(!study.count(0, "succeeded").unwrap());
    assert!(study.count(1, "target_not_reached").unwrap(), "the rule is met");
    let records = json!([ran, failed]).to_string();
    let table: Value = serde_json::from_str(&study.table(&records, "json").unwrap()).unwrap();
    let figures = |row: usize| {
        ["runs", "successes", "waiting", "stopped_early"].map(|name| table["rows"][row][name].as_u64())
    };
    assert_eq!(figures(0), [Some(1), Some(1), Some(2), Some(0)]);
    assert_eq!(figures(1), [Some(1), Some(0), Some(0), Some(2)]);
    assert_eq!(study.table(&records, "csv").unwrap().lines().count(), 3);
    assert!(study.plot("success", &records, None, None, true, "light").unwrap().starts_with("<svg"));
    for refused in [
        study.count(2, "succeeded").map(|_| String::new()),
        study.count(0, "lost").map(|_| String::new()),
        study.table("[{}]", "json"),
        study.table(&records, "xls"),
        study.plot("success", &records, Some("colour"), None, true, "light"),
    ] {
        assert_eq!(problem(refused.unwrap_err())["type"], "/problems/validation-error");
    }
}
