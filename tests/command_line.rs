//! The commands that need no server: `run`, `demo`, and how they fail.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use crate::harness::{DataDir, Server, id_of, jobs, packstone, results, run};

fn files(directory: &Path) -> Vec<String> {
    let entries = fs::read_dir(directory).unwrap_or_else(|error| panic!("{}: {error}", directory.display()));
    let mut names: Vec<String> =
        entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn write_job(directory: &Path, job: &Value) {
    fs::write(directory.join("job.json"), job.to_string()).unwrap();
}

#[tokio::test]
async fn run_packs_a_job_without_a_server() {
    let directory = tempfile::tempdir().unwrap();
    write_job(directory.path(), &jobs::quick(4));
    let ended = packstone(
        directory.path(),
        &["run", "job.json", "--out", "made/here", "--format", "json,csv,vtk,vtp,npy"],
    )
    .await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let out = directory.path().join("made/here");
    assert_eq!(files(&out), ["result.csv", "result.json", "result.npy", "result.vtk", "result.vtp"]);

    let read = |name: &str| fs::read(out.join(name)).unwrap();
    let result: Value = serde_json::from_slice(&read("result.json")).unwrap();
    assert!(result.get("job_id").is_none(), "there is no job");
    assert_eq!(result["request"]["seed"], 4);
    let rows = results::from_json(&result);
    assert!(rows.len() > 100);
    assert_eq!(results::from_csv(&read("result.csv")), rows);
    assert_eq!(results::from_npy(&read("result.npy")), rows);
    assert_eq!(results::from_vtk(&read("result.vtk")), rows);
    assert_eq!(results::from_vtp(&read("result.vtp")), rows);
}

#[tokio::test]
async fn run_and_derive_make_models_that_the_service_would_make() {
    let directory = tempfile::tempdir().unwrap();
    let postprocess = json!([{"type": "raw", "cells": 9}, {"type": "raw", "cells": 12}]);
    let job = jobs::with(jobs::quick(4), "/postprocess", postprocess);
    write_job(directory.path(), &job);
    let ended =
        packstone(directory.path(), &["run", "job.json", "--out", "made", "--format", "json,slice,stl,msh"])
            .await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let made = directory.path().join("made");
    let models = ["result-2.raw", "result.raw", "result.slice.svg", "result.stl.zip", "result.msh"];
    let mut expected: Vec<String> = vec!["result.json".into(), "result.msh.geo".into()];
    expected.extend(models.iter().flat_map(|name| [(*name).to_owned(), format!("{name}.report.json")]));
    expected.sort();
    assert_eq!(files(&made), expected);
    let read = |name: &str| fs::read(directory.path().join(name)).unwrap();
    let report: Value = serde_json::from_slice(&read("made/result-2.raw.report.json")).unwrap();
    assert_eq!((&report["type"], &report["shape"]), (&json!("raw"), &json!([12, 12, 12])));
    let script = String::from_utf8(read("made/result.msh.geo")).unwrap();
    assert!(script.starts_with("Merge \"result.msh\";"), "{script}");

    // The same of the result in a file, and of what the service has stored.
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let stored = server.client().succeed(&job).await;
    let of_service = format!("/v1/jobs/{}/result?format=raw&cells=12", id_of(&stored));
    let of_service = server.client().get(&of_service).send().await.expect(200).body.clone();
    let artifact = data_dir.artifacts().into_iter().find(|f| f.extension().is_some_and(|e| e == "packstone"));
    let artifact = artifact.unwrap().to_string_lossy().into_owned();
    for (of, out) in [("made/result.json", "json"), (artifact.as_str(), "stored")] {
        let derive = ["derive", of, "--type", "raw", "--option", "cells=12", "--out", out];
        let ended = packstone(directory.path(), &derive).await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
        assert_eq!(ended.stdout.trim(), format!("{out}/result.raw"));
        let export = read(&format!("{out}/result.raw"));
        assert!(export == read("made/result-2.raw") && export == of_service, "{out}: other labels");
    }
    server.stop().await;

    for (option, says) in
        [("cells=0", "/cells: 0 is out of range"), ("colour=red", "/colour: unknown option")]
    {
        let derive = ["derive", "made/result.json", "--type", "raw", "--option", option];
        let ended = packstone(directory.path(), &derive).await;
        assert!(ended.code == Some(1) && ended.stderr.contains(says), "{ended:?}");
    }
    let refused = jobs::with(jobs::quick(4), "/postprocess", json!({"type": "slice", "at_mm": 99}));
    write_job(directory.path(), &refused);
    let ended = packstone(directory.path(), &["run", "job.json", "--out", "refused"]).await;
    assert!(ended.code == Some(1) && ended.stderr.contains("/at_mm: 99 is out of range"), "{ended:?}");
    assert!(!directory.path().join("refused").exists(), "it was refused before the work");
}

#[tokio::test]
async fn run_reads_standard_input() {
    let directory = tempfile::tempdir().unwrap();
    write_job(directory.path(), &jobs::quick(4));
    let job = fs::File::open(directory.path().join("job.json")).unwrap();
    let out = directory.path().join("out");
    let ended = tokio::task::spawn_blocking({
        let out = out.clone();
        move || {
            Command::new(env!("CARGO_BIN_EXE_packstone"))
                .args(["run", "-", "--format", "csv", "--out"])
                .arg(out)
                .stdin(Stdio::from(job))
                .output()
        }
    });
    let ended = ended.await.unwrap().unwrap();
    assert!(ended.status.success(), "{ended:?}");
    assert_eq!(files(&out), ["result.csv"]);
}

#[tokio::test]
async fn run_says_what_is_wrong_and_writes_nothing() {
    let directory = tempfile::tempdir().unwrap();
    for (job, says) in [
        (jobs::with(jobs::quick(1), "/mix/volume_fraction", json!(2)), "/mix/volume_fraction"),
        (jobs::with(jobs::quick(1), "/distance/gap_mm", json!(5)), "/mix/volume_fraction"),
        (jobs::unreachable(), "placed "),
        (json!([]), "an array"),
    ] {
        write_job(directory.path(), &job);
        let ended = packstone(directory.path(), &["run", "job.json", "--out", "out"]).await;
        assert!(ended.code.is_some_and(|code| code != 0), "{ended:?}");
        assert!(ended.stderr.contains(says), "{says:?} is not in {}", ended.stderr);
        assert!(!ended.stderr.contains("panicked"), "{}", ended.stderr);
        let out = directory.path().join("out");
        assert!(!out.exists() || files(&out).is_empty(), "files of a failed run: {:?}", files(&out));
    }
    fs::write(directory.path().join("job.json"), "{\"specimen\": }").unwrap();
    let ended = packstone(directory.path(), &["run", "job.json", "--out", "out"]).await;
    assert!(ended.code != Some(0) && ended.stderr.contains("line 1"), "{ended:?}");
    let ended = packstone(directory.path(), &["run", "missing.json", "--out", "out"]).await;
    assert!(ended.code != Some(0) && ended.stderr.contains("missing.json"), "{ended:?}");
    write_job(directory.path(), &jobs::quick(1));
    let ended = packstone(directory.path(), &["run", "job.json", "--out", "out", "--format", "step"]).await;
    assert!(
        ended.code != Some(0) && ended.stderr.contains("step") && ended.stderr.contains("vtp"),
        "{ended:?}"
    );
    fs::write(directory.path().join("file"), "").unwrap();
    let ended = packstone(directory.path(), &["run", "job.json", "--out", "file"]).await;
    assert!(ended.code != Some(0) && ended.stderr.contains("file"), "{ended:?}");
}

#[tokio::test]
async fn the_demo_leaves_a_packing_to_look_at() {
    let directory = tempfile::tempdir().unwrap();
    let ended = packstone(directory.path(), &["demo", "--out", "shown"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let out = directory.path().join("shown");
    let read = |name: &str| fs::read(out.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
    let result: Value = serde_json::from_slice(&read("result.json")).unwrap();
    let rows = results::from_json(&result);
    assert!(rows.len() > 1000, "{} grains are no show", rows.len());
    assert_eq!(result["request"]["mix"]["grading"]["name"], "A16");
    assert_eq!(result["request"]["specimen"]["size_mm"], json!([150.0, 150.0, 150.0]));
    assert_eq!(results::from_csv(&read("result.csv")), rows);
    assert_eq!(results::from_vtp(&read("result.vtp")), rows);
    for name in ["result.json", "result.csv", "result.vtp"] {
        assert!(ended.stdout.contains(name), "{} is not told of:\n{}", name, ended.stdout);
    }
}

#[tokio::test]
async fn the_example_is_a_job() {
    let example = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/a16.json");
    let directory = tempfile::tempdir().unwrap();
    let ended = packstone(directory.path(), &["run", example, "--out", "out", "--format", "csv"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
}

#[tokio::test]
async fn help_and_version_are_told_and_nonsense_is_not() {
    let directory = tempfile::tempdir().unwrap();
    let version = packstone(directory.path(), &["--version"]).await;
    assert_eq!(
        (version.code, version.stdout.trim()),
        (Some(0), concat!("packstone ", env!("CARGO_PKG_VERSION")))
    );
    let help = packstone(directory.path(), &["--help"]).await;
    for command in ["serve", "run", "study", "demo", "openapi", "key"] {
        assert!(help.stdout.contains(command), "{}", help.stdout);
    }
    for nonsense in
        [&["bake"][..], &["serve", "--listen", "somewhere"], &["serve", "--workers", "-1"], &["run"]]
    {
        let ended = packstone(directory.path(), nonsense).await;
        assert!(ended.code.is_some_and(|code| code != 0), "{nonsense:?}");
        assert!(!ended.stderr.is_empty() && !ended.stderr.contains("panicked"), "{}", ended.stderr);
    }
    let mut no_terminal = Command::new(env!("CARGO_BIN_EXE_packstone"));
    no_terminal.current_dir(directory.path()).env_clear().arg("--help");
    assert_eq!(run(no_terminal).await.code, Some(0), "an empty environment is enough");
}
