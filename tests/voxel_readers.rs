//! Voxels for solvers and mesh generators, opened by these programs; and the materials that they are computed with.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

use crate::harness::{DataDir, Server, id_of, jobs, machine, packstone, run};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/python/read_voxels_of_programs.py");

fn materials() -> Value {
    json!({
        "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2},
        "aggregate": {"youngs_modulus_gpa": 70, "poissons_ratio": 0.25},
        "air": {"youngs_modulus_gpa": 0},
    })
}

/// A box of two aggregates without cubes for voxels.
fn job() -> Value {
    let part = |name: &str, share: f64, d_min_mm: f64| {
        let classes = [json!({"d_min_mm": d_min_mm, "d_max_mm": 2.0 * d_min_mm, "mass_fraction": 1})];
        json!({"name": name, "share": share, "grading": {"type": "classes", "classes": classes}})
    };
    json!({
        "seed": 3,
        "specimen": {"type": "box", "size_mm": [30, 25, 20.5], "boundary": "periodic"},
        "mix": {"aggregates": [part("basalt", 0.7, 4.0), part("air", 0.3, 3.0)], "volume_fraction": 0.35,
                "allow_coarse": true},
    })
}

fn with_materials(mut job: Value, materials: Value) -> Value {
    job["materials"] = materials;
    job
}

async fn export(folder: &Path, options: &str, name: &str) {
    let made = packstone(folder, &["export", "out/result.json", options, "--out", name]).await;
    assert_eq!(made.code, Some(0), "{options}: {made:?}");
    for entry in fs::read_dir(folder.join(name)).unwrap() {
        let path = entry.unwrap().path();
        let file_name = path.file_name().unwrap().to_str().unwrap().to_owned();
        // `result.cells-24.aggregate.npy` and its report.
        let ending = if file_name.ends_with(".report.json") {
            let before = file_name.strip_suffix(".report.json").unwrap().rsplit_once('.').unwrap().1;
            format!("{before}.report.json")
        } else {
            file_name.rsplit_once('.').unwrap().1.to_owned()
        };
        fs::rename(&path, folder.join(format!("{name}.{ending}"))).unwrap();
    }
}

#[tokio::test]
async fn voxels_are_read_by_the_programs_that_they_are_for() {
    let Some(python) = machine::python("Nobody read the voxels.") else { return };
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("job.json"), with_materials(job(), materials()).to_string()).unwrap();
    let made = packstone(folder, &["run", "job.json", "--out", "out"]).await;
    assert_eq!(made.code, Some(0), "{made:?}");
    for (options, name) in [
        ("voxels:format=npy,label=aggregate,cells=24", "labels"),
        ("voxels:for=damask,label=aggregate,cells=24", "damask"),
        ("voxels:for=amitex,label=aggregate,cells=24", "amitex"),
        ("voxels:for=automesh,label=aggregate,cells=24", "automesh"),
        ("voxels:for=fans,cells=24", "fans"),
    ] {
        export(folder, options, name).await;
    }
    let mut command = Command::new(&python);
    command.arg(SCRIPT).arg(folder);
    let read = run(command).await;
    assert_eq!(read.code, Some(0), "{}{}", read.stdout, read.stderr);
    assert!(read.stdout.contains("agree"), "{}", read.stdout);
}

/// The names of the files of a command that succeeded, without reports.
async fn files_of(folder: &Path, args: &[&str]) -> Vec<String> {
    let ended = packstone(folder, args).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let lines = ended.stdout.lines().filter(|line| !line.ends_with("report.json"));
    lines.map(|line| line.rsplit('/').next().unwrap().to_owned()).collect()
}

#[tokio::test]
async fn materials_come_from_an_option_a_file_or_the_job() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("job.json"), job().to_string()).unwrap();
    fs::write(folder.join("materials.json"), materials().to_string()).unwrap();
    let mut other = materials();
    other["matrix"]["youngs_modulus_gpa"] = json!(30);
    fs::write(folder.join("stated.json"), with_materials(job(), other.clone()).to_string()).unwrap();
    let export = ["--export", "voxels:for=fans,cells=12"];

    for command in ["run", "plan"] {
        let args = if command == "run" {
            [&["run", "job.json"], &export[..]].concat()
        } else {
            vec!["plan", "job.json", export[1]]
        };
        let refused = packstone(folder, &args).await;
        assert_eq!(refused.code, Some(3), "{refused:?}");
        let example = refused.stderr.split_once("one for each phase, as ").unwrap().1.lines().next().unwrap();
        fs::write(folder.join("example.json"), example).unwrap();
        let accepted = packstone(folder, &[&args[..], &["--materials", "example.json"]].concat()).await;
        assert_eq!(accepted.code, Some(0), "{accepted:?}");
    }

    // The job's own have no digits in the names of files; those of an option win over all, those of a file over the
    // job's.
    let stated = [&["run", "stated.json", "--out", "stated"], &export[..]].concat();
    assert_eq!(files_of(folder, &stated).await[1], "result.fans.cells-12.zip");
    let run = [&["run", "job.json", "--out", "given", "--materials", "materials.json"], &export[..]].concat();
    let given = files_of(folder, &run).await.remove(1);
    assert!(given.starts_with("result.fans.cells-12.materials-"), "{given}");
    let option = format!("voxels:for=fans,materials={},cells=12", materials());
    let of_option = files_of(folder, &["export", "stated/result.json", &option, "--out", "option"]).await;
    assert_eq!(of_option, std::slice::from_ref(&given), "the same materials have the same name");
    let same =
        |one: &str, two: &str| fs::read(folder.join(one)).unwrap() == fs::read(folder.join(two)).unwrap();
    assert!(same(&format!("given/{given}"), &format!("option/{given}")));
    assert!(!same(&format!("given/{given}"), "stated/result.fans.cells-12.zip"));
    fs::write(folder.join("other.json"), other.to_string()).unwrap();
    let by_file = "voxels:for=fans,cells=12,materials=other.json";
    let of_file = files_of(
        folder,
        &["export", "given/result.json", by_file, "--out", "file", "--materials", "materials.json"],
    )
    .await
    .remove(0);
    assert_ne!(of_file, given);
    assert!(same(&format!("file/{of_file}"), "stated/result.fans.cells-12.zip"));

    fs::write(folder.join("wrong.json"), json!({"matrix": {"poissons_ratio": 0.5}}).to_string()).unwrap();
    fs::write(folder.join("unknown.json"), json!({"granite": {"poissons_ratio": 0.1}}).to_string()).unwrap();
    for (file, says) in [
        (
            "wrong.json",
            "/matrix/poissons_ratio: 0.5 is out of range: must be greater than -1 and less than 0.5",
        ),
        ("unknown.json", "must be one of \"matrix\", \"aggregate\", \"basalt\", \"air\""),
        ("missing.json", "missing.json"),
    ] {
        let args = ["export", "given/result.json", "voxels:for=fans", "--materials", file];
        let refused = packstone(folder, &args).await;
        assert!(refused.code == Some(3) && refused.stderr.contains(says), "{file}: {refused:?}");
    }
}

#[tokio::test]
async fn the_service_asks_for_materials_with_an_example() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let done = client.succeed(&job()).await;
    let voxels = |id: &str| format!("/v1/jobs/{id}/exports/voxels?for=fans&cells=12");
    let path = voxels(id_of(&done));
    let refused = client.get(&path).send().await;
    let problem = refused.expect_problem(422, "validation-error");
    let detail = problem["errors"][0]["detail"].as_str().unwrap();
    let example = detail.split_once("one for each phase, as ").unwrap().1;
    let query: String = form_urlencoded::byte_serialize(example.as_bytes()).collect();
    let made = client.get(&format!("{path}&materials={query}")).send().await;
    assert_eq!(made.expect(200).header("content-type"), "application/zip");
    let name = made.header("content-disposition");
    assert!(name.contains(".fans.cells-12.materials-"), "{name}");

    let mut beforehand = job();
    beforehand["postprocess"] = json!({"type": "voxels", "for": "fans", "cells": 12});
    let refused = client.post("/v1/jobs").json(&beforehand).send().await;
    let problem = refused.expect_problem(422, "validation-error");
    assert_eq!(problem["errors"][0]["pointer"], "/postprocess/materials");
    let done = client.succeed(&with_materials(beforehand, materials())).await;
    client.get(&voxels(id_of(&done))).send().await.expect(200);
    let stored = client.request_of(id_of(&done)).await;
    assert_eq!(stored["materials"]["air"], json!({"youngs_modulus_gpa": 0.0}));
    server.stop().await;
}

/// No packing depends on the materials: a run that was stopped goes on with others, and its result states these.
#[tokio::test]
async fn a_run_goes_on_with_other_materials() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let quick = jobs::quick(3);
    let stated = |youngs: f64| {
        with_materials(quick.clone(), json!({"matrix": {"youngs_modulus_gpa": youngs}})).to_string()
    };
    fs::write(folder.join("job.json"), stated(25.0)).unwrap();
    let run = ["run", "job.json", "--out", "out", "--resume", "--format", "npy,csv,json"];
    let out = folder.join("out");
    fs::create_dir(&out).unwrap();
    // Every write to this device fails as on a full disk.
    std::os::unix::fs::symlink("/dev/full", out.join("result.csv.tmp")).unwrap();
    let stopped = packstone(folder, &run).await;
    assert_eq!(stopped.code, Some(6), "{stopped:?}");
    let first = fs::read(out.join("result.npy")).unwrap();
    fs::write(folder.join("job.json"), stated(30.0)).unwrap();
    let resumed = packstone(folder, &run).await;
    assert_eq!(resumed.code, Some(0), "{resumed:?}");
    assert!(fs::read(out.join("result.npy")).unwrap() == first);
    let result: Value = serde_json::from_slice(&fs::read(out.join("result.json")).unwrap()).unwrap();
    assert_eq!(result["request"]["materials"], json!({"matrix": {"youngs_modulus_gpa": 30.0}}));
}

/// Voxels are written row by row: where a command writes them, the disk limits their file; in a service, its operator.
#[tokio::test]
async fn a_long_file_of_voxels_is_a_matter_of_the_disk() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let mut cube = job();
    cube["specimen"]["size_mm"] = json!([30, 30, 30]);
    fs::write(folder.join("job.json"), cube.to_string()).unwrap();
    let planned = packstone(folder, &["plan", "job.json", "voxels:for=damask,cells=1000"]).await;
    assert_eq!(planned.code, Some(0), "{planned:?}");
    let plan: Value = serde_json::from_str(&planned.stdout).unwrap();
    // 8 bytes each, of which base64 makes four of three.
    let bytes = plan["exports"][0]["estimate"]["bytes"].as_f64().unwrap();
    assert!((bytes / (1e9 * 8.0 * 4.0 / 3.0) - 1.0).abs() < 1e-6, "{plan:#}");

    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    cube["postprocess"] = json!({"type": "voxels", "for": "damask", "cells": 1000});
    let refused = server.client().post("/v1/jobs").json(&cube).send().await;
    let problem = refused.expect_problem(422, "too-large");
    assert!(problem.to_string().contains("voxels are a file of 10667 MB: at most "), "{problem:#}");
    server.stop().await;
}
