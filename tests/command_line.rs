//! The commands that need no server: `run`, `demo`, and how they fail.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::deadline::eventually;
use crate::harness::{DataDir, Running, Server, jobs, packstone, results, run};

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
        &["run", "job.json", "--out", "made/here", "--format", "json,csv,vtk,vtp,npy,view"],
    )
    .await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let out = directory.path().join("made/here");
    assert_eq!(
        files(&out),
        ["result.csv", "result.json", "result.npy", "result.view", "result.vtk", "result.vtp"]
    );

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
async fn run_and_export_make_what_the_service_would_make() {
    let directory = tempfile::tempdir().unwrap();
    let postprocess = json!([{"type": "voxels", "format": "raw", "cells": 9}, {"type": "mesh"}]);
    let job = jobs::with(jobs::quick(4), "/postprocess", postprocess);
    write_job(directory.path(), &job);
    let run = ["run", "job.json", "--out", "made", "--export", "voxels:format=raw,cells=12"];
    let more = ["--export", "slice", "--export", "mesh:format=stl", "--export", "mesh"];
    let ended = packstone(directory.path(), &[&run[..], &more].concat()).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let made = directory.path().join("made");
    // What the job asks for as well is made once.
    let exports =
        ["result.cells-9.raw", "result.cells-12.raw", "result.slice.svg", "result.stl.zip", "result.msh"];
    let mut expected: Vec<String> = vec!["result.json".into(), "result.msh.geo".into()];
    expected.extend(exports.iter().flat_map(|name| [(*name).to_owned(), format!("{name}.report.json")]));
    expected.sort();
    assert_eq!(files(&made), expected);
    for name in &expected {
        assert!(ended.stdout.lines().any(|line| line == format!("made/{name}")), "{name}: {}", ended.stdout);
    }
    let read = |name: &str| fs::read(directory.path().join(name)).unwrap();
    let report: Value = serde_json::from_slice(&read("made/result.cells-12.raw.report.json")).unwrap();
    assert_eq!((&report["type"], &report["shape"]), (&json!("voxels"), &json!([12, 12, 12])));
    let script = String::from_utf8(read("made/result.msh.geo")).unwrap();
    assert!(script.starts_with("Merge \"result.msh\";"), "{script}");

    // The same of the result in a file, and of the one that the service has stored.
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    server.client().succeed(&jobs::quick(4)).await;
    server.stop().await;
    let artifact = data_dir.artifacts().into_iter().find(|f| f.extension().is_some_and(|e| e == "packstone"));
    let artifact = artifact.unwrap().to_string_lossy().into_owned();
    for (of, out) in [("made/result.json", "json"), (artifact.as_str(), "stored")] {
        let export = ["export", of, "voxels:format=raw,cells=12", "--out", out];
        let ended = packstone(directory.path(), &export).await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
        assert_eq!(
            ended.stdout.trim(),
            format!("{out}/result.cells-12.raw\n{out}/result.cells-12.raw.report.json")
        );
        assert!(
            read(&format!("{out}/result.cells-12.raw")) == read("made/result.cells-12.raw"),
            "{out}: other labels"
        );
    }

    for (export, code, says) in [
        ("voxels:cells=0", 2, "/cells: 0 is out of range"),
        ("voxels:colour=red", 2, "/colour: unknown option"),
        ("cube", 2, "must be one of mesh, voxels, slice, deck, ldpm, certificates, shapes, quality"),
        ("slice:at_mm=99", 3, "/at_mm: 99 is out of range"),
    ] {
        let ended = packstone(directory.path(), &["export", "made/result.json", export]).await;
        assert!(ended.code == Some(code) && ended.stderr.contains(says), "{ended:?}");
    }
    let refused = jobs::with(jobs::quick(4), "/postprocess", json!([{"type": "slice", "at_mm": 99}]));
    write_job(directory.path(), &refused);
    let ended = packstone(directory.path(), &["run", "job.json", "--out", "refused"]).await;
    assert!(ended.code == Some(3) && ended.stderr.contains("/at_mm: 99 is out of range"), "{ended:?}");
    assert!(!directory.path().join("refused").exists(), "it was refused before the work");
}

#[tokio::test]
async fn nothing_is_overwritten_without_force() {
    let directory = tempfile::tempdir().unwrap();
    let here = directory.path();
    write_job(here, &jobs::quick(4));
    let run = ["run", "job.json", "--out", "out", "--format", "csv", "--plot", "grading", "--picture"];
    let export = ["export", "out/result.json", "slice:format=json", "--picture", "--out", "out"];
    assert_eq!(packstone(here, &["run", "job.json", "--out", "out"]).await.code, Some(0));
    for (command, files) in [
        (&run[..], &["result.csv", "plot-grading.svg", "result.png"][..]),
        (&export, &["result.slice.json", "result.slice.json.report.json", "result.png"]),
    ] {
        let paths = files.iter().map(|file| here.join("out").join(file));
        let _ = fs::remove_file(here.join("out/result.png"));
        for (file, path) in files.iter().zip(paths.clone()) {
            fs::write(&path, "mine").unwrap();
            let ended = packstone(here, command).await;
            assert!(ended.code == Some(3) && ended.stderr.contains(file), "{ended:?}");
            assert!(ended.stderr.contains("--force"), "{ended:?}");
            assert_eq!(fs::read_to_string(&path).unwrap(), "mine");
            fs::remove_file(&path).unwrap();
        }
        paths.clone().for_each(|path| fs::write(path, "mine").unwrap());
        let forced = packstone(here, &[command, &["--force"]].concat()).await;
        assert_eq!(forced.code, Some(0), "{forced:?}");
        for path in paths {
            assert_ne!(fs::read(&path).unwrap(), b"mine", "{}", path.display());
        }
    }
}

#[tokio::test]
async fn a_picture_is_a_png_of_the_packing() {
    let directory = tempfile::tempdir().unwrap();
    write_job(directory.path(), &jobs::quick(4));
    let ended = packstone(directory.path(), &["run", "job.json", "--out", "run", "--picture"]).await;
    assert!(ended.code == Some(0) && ended.stdout.contains("run/result.png"), "{ended:?}");
    let ended =
        packstone(directory.path(), &["export", "run/result.json", "--picture", "--out", "two"]).await;
    assert!(ended.code == Some(0) && ended.stdout.trim() == "two/result.png", "{ended:?}");
    let picture = fs::read(directory.path().join("run/result.png")).unwrap();
    assert!(picture.starts_with(b"\x89PNG\r\n\x1a\n"));
    let length = |at: usize| u32::from_be_bytes(picture[at..at + 4].try_into().unwrap());
    assert!(length(16).max(length(20)) >= 1400, "{} x {}", length(16), length(20));
    assert!(picture == fs::read(directory.path().join("two/result.png")).unwrap(), "not reproducible");
}

#[tokio::test]
async fn a_plan_says_what_a_job_amounts_to() {
    let directory = tempfile::tempdir().unwrap();
    write_job(directory.path(), &jobs::quick(4));
    let ended = packstone(directory.path(), &["plan", "job.json"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let plan: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert!(plan["grains"].as_f64() > Some(100.0) && plan["methods"]["rsa"].is_object(), "{plan:#}");
    assert_eq!(files(directory.path()), ["job.json"]);
    write_job(directory.path(), &jobs::with(jobs::quick(4), "/mix/volume_fraction", json!(0.95)));
    let ended = packstone(directory.path(), &["plan", "job.json"]).await;
    assert!(ended.code == Some(3) && ended.stderr.contains("/mix/volume_fraction"), "{ended:?}");
}

#[tokio::test]
async fn exit_codes_tell_faults_apart() {
    let directory = tempfile::tempdir().unwrap();
    let here = directory.path();
    write_job(here, &jobs::unreachable());
    let ended = packstone(here, &["run", "job.json", "--out", "out"]).await;
    assert_eq!(ended.code, Some(4), "{ended:?}");
    assert_eq!(packstone(here, &["run", "missing.json"]).await.code, Some(3));
    assert_eq!(packstone(here, &["bake"]).await.code, Some(2));
    // Every write to this device fails as on a full disk.
    write_job(here, &jobs::quick(1));
    fs::create_dir(here.join("full")).unwrap();
    std::os::unix::fs::symlink("/dev/full", here.join("full/result.csv.tmp")).unwrap();
    let ended = packstone(here, &["run", "job.json", "--out", "full", "--format", "csv"]).await;
    assert!(ended.code == Some(6) && ended.stderr.contains("result.csv cannot be written"), "{ended:?}");
    let help = packstone(here, &["--help"]).await;
    for code in ["0", "1", "2", "3", "4", "5", "6", "130"] {
        assert!(help.stdout.lines().any(|line| line.starts_with(&format!("  {code} "))), "{}", help.stdout);
    }
}

#[tokio::test]
async fn a_package_gets_completions_and_manual_pages() {
    let directory = tempfile::tempdir().unwrap();
    for shell in ["bash", "zsh", "fish"] {
        let ended = packstone(directory.path(), &["completions", shell]).await;
        assert!(ended.code == Some(0) && ended.stdout.contains("checkpoint-every-s"), "{shell}: {ended:?}");
    }
    let page = packstone(directory.path(), &["man"]).await;
    assert!(page.code == Some(0) && page.stdout.contains(".TH packstone 1"), "{page:?}");
    assert_eq!(packstone(directory.path(), &["man", "--out", "man1"]).await.code, Some(0));
    let pages = files(&directory.path().join("man1"));
    for name in ["packstone.1", "packstone-run.1", "packstone-serve.1", "packstone-export.1"] {
        assert!(pages.iter().any(|page| page == name), "{pages:?}");
    }
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
    let out = directory.path().join("shown");
    // One that is killed, with a part of its files.
    let killed = Running::spawn(directory.path(), &["demo", "--out", "shown"]);
    eventually("a demo that writes", || {
        out.exists() && files(&out).iter().any(|name| name.ends_with(".unfinished"))
    })
    .await;
    killed.signal(Signal::KILL);
    killed.ended().await;
    fs::write(out.join("result.json"), "half").unwrap();
    let ended = packstone(directory.path(), &["demo", "--out", "shown"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(
        files(&out),
        ["data", "result.csv", "result.html", "result.json", "result.png", "result.vtp"],
        "nothing else is left"
    );
    let again = packstone(directory.path(), &["demo", "--out", "shown"]).await;
    assert!(again.code == Some(3) && again.stderr.contains("--force"), "{again:?}");
    let read = |name: &str| fs::read(out.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
    let result: Value = serde_json::from_slice(&read("result.json")).unwrap();
    let rows = results::from_json(&result);
    assert!(rows.len() > 1000, "{} grains are no show", rows.len());
    assert_eq!(result["request"]["mix"]["grading"]["name"], "A16");
    assert_eq!(result["request"]["specimen"]["size_mm"], json!([150.0, 150.0, 150.0]));
    assert_eq!(results::from_csv(&read("result.csv")), rows);
    assert_eq!(results::from_vtp(&read("result.vtp")), rows);
    assert!(read("result.png").starts_with(b"\x89PNG"));
    let page = String::from_utf8(read("result.html")).unwrap();
    assert_eq!(page_data(&page)["result"]["request"], result["request"]);
    assert_eq!(page_data(&page)["grains"], rows.len());
    for name in ["result.json", "result.csv", "result.vtp", "result.png", "result.html"] {
        assert!(ended.stdout.contains(name), "{} is not told of:\n{}", name, ended.stdout);
    }
}

/// What the script of a page reads.
fn page_data(page: &str) -> Value {
    let start = page.split("id=\"result-data\">").nth(1).unwrap();
    serde_json::from_str(start.split("</script>").next().unwrap()).unwrap()
}

#[tokio::test]
async fn a_run_writes_a_page_with_its_grains() {
    let directory = tempfile::tempdir().unwrap();
    let job = json!({"name": "</script>", "seed": 7, "specimen": {"type": "box", "size_mm": [40, 40, 40]},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2}});
    fs::write(directory.path().join("job.json"), job.to_string()).unwrap();
    let ended = packstone(directory.path(), &["run", "job.json", "--format", "html,view"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let page = fs::read_to_string(directory.path().join("result.html")).unwrap();
    let data = page_data(&page);
    assert_eq!(data["result"]["request"]["name"], "</script>");
    let view = fs::read(directory.path().join("result.view")).unwrap();
    assert_eq!((data["grains"].as_u64().unwrap() as usize) * 8 + 64, view.len());
    let grains = page.split("id=\"grains-data\">").nth(1).unwrap().split('<').next().unwrap();
    assert!(grains == BASE64_STANDARD.encode(&view), "the page holds the view");
    assert!(!page.contains("src=") && !page.contains("href="), "the page refers to nothing outside");
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
    assert_eq!(version.code, Some(0));
    let text = version.stdout.trim();
    let commit = text.strip_prefix(concat!("packstone ", env!("CARGO_PKG_VERSION"), " ("));
    let commit = commit.and_then(|rest| rest.strip_suffix(')')).unwrap_or_else(|| panic!("{text}"));
    let is_commit = commit.len() == 12 && commit.bytes().all(|byte| byte.is_ascii_hexdigit());
    assert!(is_commit || commit == "unknown", "{text}");
    let help = packstone(directory.path(), &["--help"]).await;
    for command in ["serve", "run", "export", "study", "plan", "demo", "openapi", "key", "completions", "man"]
    {
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
