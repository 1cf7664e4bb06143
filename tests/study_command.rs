//! `packstone study`: studies without a server, whatever breaks them off.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::deadline::eventually;
use crate::harness::{Finished, Running, jobs, packstone};

/// Two volume fractions, two methods, so many replicates; every run takes some tens of milliseconds.
fn study(replicates: usize) -> Value {
    json!({
        "name": "twice two",
        "template": jobs::with(jobs::equal_spheres(3000, 0), "/seed", Value::Null),
        "grid": {
            "/mix/volume_fraction": {"from": 0.25, "to": 0.3, "step": 0.05},
            "/method": [{"type": "rsa"}, {"type": "edmd"}]
        },
        "replicates": replicates
    })
}

fn write(directory: &Path, study: &Value) {
    fs::write(directory.join("study.json"), study.to_string()).unwrap();
}

async fn run(directory: &Path, more: &[&str]) -> Finished {
    let args = ["study", "study.json", "--out", "out"];
    packstone(directory, &[&args, more].concat()).await
}

fn table(out: &Path) -> Value {
    serde_json::from_slice(&fs::read(out.join("table.json")).unwrap()).unwrap()
}

/// The rows without what no two runs agree on.
fn rows_without_times(out: &Path) -> Vec<Value> {
    let mut rows = table(out)["rows"].as_array().unwrap().clone();
    for row in &mut rows {
        row.as_object_mut()
            .unwrap()
            .retain(|column, _| !column.contains("time_s") && column != "event_us_median");
    }
    rows
}

/// Point and replicate of every run that was written down.
fn runs(out: &Path) -> Vec<(u64, u64)> {
    let text = fs::read_to_string(out.join("runs.jsonl")).unwrap_or_default();
    // A line may be on its way.
    let whole = text.split_inclusive('\n').filter(|line| line.ends_with('\n'));
    let lines = whole.map(|line| serde_json::from_str::<Value>(line).unwrap());
    lines.map(|run| (run["point"].as_u64().unwrap(), run["replicate"].as_u64().unwrap())).collect()
}

#[tokio::test]
async fn a_study_leaves_a_table_and_the_packings_asked_for() {
    let directory = tempfile::tempdir().unwrap();
    write(directory.path(), &study(2));
    let ended = run(directory.path(), &["--format", "npy,csv"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let out = directory.path().join("out");
    let table = table(&out);
    assert_eq!(table["columns"], json!(["/mix/volume_fraction", "/method"]));
    let rows = table["rows"].as_array().unwrap();
    let keys: Vec<(f64, &str)> = rows
        .iter()
        .map(|row| (row["/mix/volume_fraction"].as_f64().unwrap(), row["/method"]["type"].as_str().unwrap()))
        .collect();
    assert_eq!(keys, [(0.25, "rsa"), (0.25, "edmd"), (0.3, "rsa"), (0.3, "edmd")]);
    for row in rows {
        assert_eq!(
            (&row["runs"], &row["successes"], &row["waiting"]),
            (&json!(2), &json!(2), &json!(0)),
            "{row:#}"
        );
        assert!(row["time_s_per_success"].as_f64() > Some(0.0), "{row:#}");
        assert_eq!(row["event_us_median"].is_null(), row["/method"]["type"] == "rsa", "{row:#}");
        assert!(ended.stdout.contains("2/2"), "{}", ended.stdout);
    }
    let csv = fs::read_to_string(out.join("table.csv")).unwrap();
    assert_eq!(csv.lines().count(), 5);
    assert!(csv.starts_with("/mix/volume_fraction,/method,grains,"), "{csv}");
    for plot in ["success", "time", "event_time"] {
        let file = format!("plot-{plot}.svg");
        assert!(fs::read_to_string(out.join(&file)).unwrap().contains("<svg"), "{file}");
        assert!(ended.stdout.contains(&file), "{}", ended.stdout);
    }
    let mut kept: Vec<String> = fs::read_dir(out.join("results"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    kept.sort();
    let expected: Vec<String> = (0..4)
        .flat_map(|point| {
            (0..2).flat_map(move |r| ["csv", "npy"].map(|format| format!("{point}-{r}.{format}")))
        })
        .collect();
    assert_eq!(kept, expected);
}

/// Breaks a study off after its third run, goes on, and holds the table against that of one which nothing disturbed.
async fn survives(signal: Signal) {
    let directory = tempfile::tempdir().unwrap();
    // The seed that is drawn must be that of both halves.
    write(directory.path(), &study(20));
    let out = directory.path().join("out");
    let args = ["study", "study.json", "--out", "out", "--workers", "1"];
    let running = Running::start(directory.path(), &args).await;
    eventually("three runs", || runs(&out).len() >= 3).await;
    running.signal(signal);
    let ended = running.ended().await;
    assert_ne!(ended.code, Some(0), "{ended:?}");
    let done = runs(&out).len();
    assert!((3..80).contains(&done), "{done} runs: it was not broken off");
    if signal == Signal::INT {
        assert!(ended.stderr.contains("--resume"), "{ended:?}");
        let waiting: u64 =
            table(&out)["rows"].as_array().unwrap().iter().map(|row| row["waiting"].as_u64().unwrap()).sum();
        assert_eq!(waiting as usize, 80 - done);
    }

    let refused = run(directory.path(), &[]).await;
    assert!(refused.code != Some(0) && refused.stderr.contains("--resume"), "{refused:?}");
    write(directory.path(), &study(21));
    let refused = run(directory.path(), &["--resume"]).await;
    assert!(refused.stderr.contains("/replicates is 21 in the file and 20 in the folder"), "{refused:?}");

    write(directory.path(), &study(20));
    let ended = run(directory.path(), &["--resume"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let all = runs(&out);
    assert_eq!(all.len(), 80, "a run was done twice or not at all");
    assert_eq!(all.into_iter().collect::<BTreeSet<_>>().len(), 80);

    let seed = serde_json::from_slice::<Value>(&fs::read(out.join("study.json")).unwrap()).unwrap();
    let undisturbed = tempfile::tempdir().unwrap();
    write(undisturbed.path(), &jobs::with(study(20), "/seed", seed["request"]["seed"].clone()));
    let ended = run(undisturbed.path(), &[]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(rows_without_times(&out), rows_without_times(&undisturbed.path().join("out")));

    // There is nothing left to do, and the files are made anew.
    fs::remove_file(out.join("table.csv")).unwrap();
    let again = run(directory.path(), &["--resume"]).await;
    assert_eq!(again.code, Some(0), "{again:?}");
    assert!(out.join("table.csv").exists());
}

#[tokio::test]
async fn a_kill_costs_the_runs_on_their_way_only() {
    survives(Signal::KILL).await;
}

#[tokio::test]
async fn an_interrupt_stops_a_study_in_good_order() {
    survives(Signal::INT).await;
}

#[tokio::test]
async fn points_that_are_known_well_enough_need_no_more_runs() {
    let directory = tempfile::tempdir().unwrap();
    let unreachable = jobs::with(jobs::unreachable(), "/seed", Value::Null);
    write(
        directory.path(),
        &json!({
            "template": unreachable, "grid": {"/mix/volume_fraction": [0.2, 0.5]}, "replicates": 6,
            "stop_when": {"failed_in_a_row": 2}
        }),
    );
    let ended = run(directory.path(), &["--workers", "1"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let rows = rows_without_times(&directory.path().join("out"));
    let counts = |row: &Value| {
        ["runs", "successes", "waiting", "stopped_early"].map(|column| row[column].as_u64().unwrap())
    };
    assert_eq!(rows.iter().map(counts).collect::<Vec<_>>(), [[6, 6, 0, 0], [2, 0, 0, 4]]);
}

#[tokio::test]
async fn a_job_past_its_time_did_not_reach_its_packing() {
    let directory = tempfile::tempdir().unwrap();
    write(directory.path(), &json!({"list": [jobs::with(jobs::endless(), "/timeout_s", json!(0.3))]}));
    let ended = run(directory.path(), &[]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let row = &rows_without_times(&directory.path().join("out"))[0];
    assert_eq!((&row["point"], &row["name"]), (&json!(0), &json!("endless")));
    assert_eq!((&row["runs"], &row["successes"], &row["void"]), (&json!(1), &json!(0), &json!(0)), "{row:#}");
}

#[tokio::test]
async fn the_largest_distance_leaves_its_curve() {
    let directory = tempfile::tempdir().unwrap();
    let job = jobs::with(jobs::quick_growth(3), "/distance", json!({"type": "maximize"}));
    let job = jobs::with(job, "/method/stop", json!({"events": 200_000}));
    write(directory.path(), &json!({"list": [jobs::quick(1), job]}));
    let ended = run(directory.path(), &[]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let out = directory.path().join("out");
    let curves: Value = serde_json::from_slice(&fs::read(out.join("curves.json")).unwrap()).unwrap();
    assert_eq!(curves.as_array().map(Vec::len), Some(1), "{curves:#}");
    assert_eq!(curves[0]["point"], 1);
    for plot in ["distance", "curve", "volume_fraction"] {
        assert!(out.join(format!("plot-{plot}.svg")).exists(), "{plot}");
    }
    let curve: Vec<[f64; 2]> = serde_json::from_value(curves[0]["distance_curve"].clone()).unwrap();
    assert!(curve.len() >= 2 && curve.is_sorted_by(|a, b| a[0] <= b[0] && a[1] <= b[1]), "{curve:?}");
    let reached = table(&out)["rows"][1]["distance_mm_median"].as_f64().unwrap();
    assert!((curve.last().unwrap()[1] - reached).abs() < 1e-6 * reached, "{curve:?} ends not at {reached}");
}

#[tokio::test]
async fn a_study_that_is_refused_runs_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let mut infeasible = study(1);
    infeasible["grid"]["/mix/volume_fraction"] = json!([0.2, 0.9]);
    for (request, says) in [
        (infeasible, "/grid/~1mix~1volume_fraction/1: point 2 and 1 more: "),
        (jobs::with(study(1), "/colour", json!(1)), "/colour: unknown field"),
        (study(3000), "must have at most 10000"),
    ] {
        write(directory.path(), &request);
        let ended = run(directory.path(), &[]).await;
        assert!(ended.code.is_some_and(|code| code != 0), "{ended:?}");
        assert!(ended.stderr.contains(says), "{says:?} is not in {}", ended.stderr);
        assert!(!directory.path().join("out").exists());
    }
    write(directory.path(), &study(1));
    // A script may always say --resume.
    let ended = run(directory.path(), &["--resume"]).await;
    assert!(ended.code == Some(0) && ended.stderr.contains("there is no study in out"), "{ended:?}");
}

#[tokio::test]
async fn models_that_jobs_ask_for_lie_with_the_results() {
    let directory = tempfile::tempdir().unwrap();
    let mut template = jobs::with(jobs::quick(0), "/seed", Value::Null);
    template = jobs::with(
        template,
        "/postprocess",
        json!([{"type": "voxels", "format": "raw", "cells": 6}, {"type": "slice"}]),
    );
    let study = json!({"seed": 1, "template": template, "grid": {"/postprocess/0/cells": [6, 7]}});
    write(directory.path(), &study);
    let ended = run(directory.path(), &[]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let results = directory.path().join("out/results");
    let length =
        |name: &str| fs::metadata(results.join(name)).unwrap_or_else(|e| panic!("{name}: {e}")).len();
    assert_eq!((length("0-0.cells-6.raw"), length("1-0.cells-7.raw")), (216, 343));
    assert!(length("0-0.slice.svg") > 0 && length("1-0.cells-7.raw.report.json") > 0);
}
