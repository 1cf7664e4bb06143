//! Effective properties from a mix to the numbers: the command line and the service.

use std::fs;
use std::path::Path;
use std::process::Command;

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::deadline::eventually;
use crate::harness::results::json_in as read;
use crate::harness::{Client, DataDir, Launch, Running, Server, id_of, packstone};

/// Materials of which the grains are stiffer by a factor.
fn materials(contrast: f64) -> Value {
    json!({
        "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2, "expansion_1_k": 1.1e-5,
            "conductivity_w_m_k": 1.8},
        "aggregate": {"youngs_modulus_gpa": 25.0 * contrast, "poissons_ratio": 0.25, "expansion_1_k": 8e-6,
            "conductivity_w_m_k": 3},
    })
}

/// A small cube of mortar with spheres.
fn mix() -> Value {
    json!({
        "seed": 1,
        "specimen": {"type": "box", "size_mm": [24, 24, 24]},
        "mix": {"grading": {"type": "standard", "name": "A8"}, "d_min_mm": 4, "volume_fraction": 0.4,
            "allow_coarse": true},
        "distance": {"type": "constant", "gap_mm": 0.4},
    })
}

fn with_materials() -> Value {
    let mut job = mix();
    job["materials"] = materials(2.8);
    job
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

#[tokio::test]
async fn one_command_goes_from_a_mix_to_its_properties() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("mix.json"), with_materials().to_string()).unwrap();
    fs::write(folder.join("hard.json"), materials(28.0).to_string()).unwrap();
    let args = ["run", "mix.json", "--out", "out", "--export", "properties:cells=16"];
    let hard = ["--export", "properties:cells=16,kinds=stiffness,conductivity,materials=hard.json"];
    let run = packstone(folder, &[&args[..], &hard].concat()).await;
    assert_eq!(run.code, Some(0), "{run:?}");
    let soft = read(&folder.join("out/result.properties.cells-16.json"));
    let report = read(&folder.join("out/result.properties.cells-16.json.report.json"));
    assert_eq!(report["type"], "properties");
    assert_eq!(report["stiffness"], soft["stiffness"]);
    assert_eq!(soft["cell"]["kind"], "repeated_box");
    let bounds = &soft["stiffness"]["bounds"];
    let e = number(&soft["stiffness"]["isotropic"]["youngs_modulus_gpa"]);
    let [low, high] = ["reuss", "voigt"].map(|name| number(&bounds[name]["youngs_modulus_gpa"]));
    assert!(low < e && e < high, "{soft:#}");
    let alpha = number(&soft["expansion"]["isotropic_1_k"]);
    assert!((8e-6..1.1e-5).contains(&alpha), "{alpha}");
    assert!((1.8..3.0).contains(&number(&soft["conductivity"]["isotropic"])), "{soft:#}");
    let hard = run.stdout.lines().find(|line| line.contains("kinds-stiffness-conductivity")).unwrap();
    let hard = read(&folder.join(hard));
    assert!(number(&hard["stiffness"]["isotropic"]["youngs_modulus_gpa"]) > 1.05 * e, "{hard:#}");
    assert_eq!(hard.get("expansion"), None);

    let plan = packstone(folder, &["plan", "mix.json", "properties:cells=256"]).await;
    assert_eq!(plan.code, Some(0), "{plan:?}");
    let plan: Value = serde_json::from_str(&plan.stdout).unwrap();
    let estimate = &plan["exports"][0]["estimate"]["computation"];
    let fields = 4.0 * 3.0 * 256_f64.powi(3);
    let memory = number(&estimate["memory_bytes"]);
    assert!(
        memory > 9.0 * fields && memory < 14.0 * fields && number(&estimate["cpu_s"]) > 1.0,
        "{estimate:#}"
    );

    fs::write(folder.join("bare.json"), mix().to_string()).unwrap();
    let bare = ["run", "bare.json", "--out", "bare", "--export", "properties"];
    let refused = packstone(folder, &bare).await;
    assert_eq!((refused.code, folder.join("bare").exists()), (Some(3), false), "{refused:?}");
    assert!(refused.stderr.contains("\"youngs_modulus_gpa\": 25"), "{refused:?}");
}

#[tokio::test]
async fn the_service_makes_the_same_file_and_names_what_is_missing() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client: Client = server.client();
    let job = client.succeed(&with_materials()).await;
    let path = |job: &Value, query: &str| format!("/v1/jobs/{}/exports/properties?{query}", id_of(job));
    let file = client.get(&path(&job, "cells=12&kinds=stiffness")).send().await.expect(200).body.clone();
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("mix.json"), with_materials().to_string()).unwrap();
    let run = packstone(
        folder,
        &["run", "mix.json", "--out", "out", "--export", "properties:cells=12,kinds=stiffness"],
    )
    .await;
    assert_eq!(run.code, Some(0), "{run:?}");
    let of_command = run.stdout.lines().find(|line| line.contains("properties")).unwrap();
    assert_eq!(file, fs::read(folder.join(of_command)).unwrap());

    for (query, pointer) in [("cells=7", "cells"), ("kinds=mass", "kinds"), ("tolerance=0", "tolerance")] {
        let problem = client.get(&path(&job, query)).send().await;
        let problem = problem.expect_problem(400, "validation-error");
        assert!(problem.to_string().contains(pointer), "{query}: {problem:#}");
    }
    let bare = client.succeed(&mix()).await;
    let refused = client.get(&path(&bare, "cells=12")).send().await;
    let problem = refused.expect_problem(422, "validation-error");
    assert!(problem.to_string().contains("youngs_modulus_gpa"), "{problem:#}");
    let mut with_properties = mix();
    with_properties["postprocess"] = json!({"type": "properties", "cells": 12});
    client.post("/v1/jobs").json(&with_properties).send().await.expect_problem(422, "validation-error");
    with_properties["postprocess"]["materials"] = materials(2.8);
    let done = client.succeed(&with_properties).await;
    let options = format!("cells=12&materials={}", urlencode(&materials(2.8).to_string()));
    let file = client.get(&path(&done, &options)).send().await.expect(200).body.clone();
    let file: Value = serde_json::from_slice(&file).unwrap();
    assert!(number(&file["stiffness"]["isotropic"]["youngs_modulus_gpa"]) > 25.0, "{file:#}");
    server.stop().await;
}

/// Many iterations a load case.
fn hard() -> String {
    let hard = urlencode(&materials(300.0).to_string());
    format!("cells=36&kinds=stiffness&fields=true&materials={hard}")
}

#[tokio::test]
async fn a_command_that_was_killed_goes_on_from_its_load_cases() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("mix.json"), with_materials().to_string()).unwrap();
    fs::write(folder.join("hard.json"), materials(300.0).to_string()).unwrap();
    let run = packstone(folder, &["run", "mix.json", "--out", "out"]).await;
    assert_eq!(run.code, Some(0), "{run:?}");
    let hard = "properties:cells=36,kinds=stiffness,fields=true,materials=hard.json";
    let command = ["export", "out/result.json", hard, "--checkpoint-every-s", "0", "--out"];
    let whole = packstone(folder, &[&command[..], &["whole"]].concat()).await;
    assert_eq!(whole.code, Some(0), "{whole:?}");
    let is_fields = |file: &&Path| file.extension().is_some_and(|ending| ending == "vti");
    let file = whole.stdout.lines().map(Path::new).find(is_fields).unwrap();
    let name = file.file_name().unwrap().to_str().unwrap();
    let checkpoint = folder.join("killed").join(format!("{name}.checkpoint"));
    let running = Running::start(folder, &[&command[..], &["killed"]].concat()).await;
    eventually("the first load case", || checkpoint.exists()).await;
    running.signal(Signal::KILL);
    running.ended().await;
    assert!(checkpoint.exists() && !folder.join("killed").join(name).exists());
    let resumed = packstone(folder, &[&command[..], &["killed"]].concat()).await;
    assert_eq!(resumed.code, Some(0), "{resumed:?}");
    assert!(resumed.stderr.contains("going on from it"), "{resumed:?}");
    for ending in ["", ".report.json"] {
        let read = |out: &str| fs::read(folder.join(out).join(format!("{name}{ending}"))).unwrap();
        assert!(read("killed") == read("whole"), "{name}{ending}");
    }
    assert!(!checkpoint.exists());
}

#[tokio::test]
async fn a_service_that_was_killed_goes_on_from_the_load_cases_of_its_slot() {
    let data_dir = DataDir::new();
    let start = async || {
        let launch = Launch::new(&data_dir).workers(1).args(&["--checkpoint-every-s", "0"]);
        launch.start().await
    };
    let server = start().await;
    let mut job = with_materials();
    job["postprocess"] = json!({"type": "properties", "cells": 36, "kinds": "stiffness", "fields": true,
        "materials": materials(300.0)});
    let done = server.client().succeed(&job).await;
    let id = id_of(&done).to_owned();
    eventually("the first load case", || {
        data_dir.checkpoints().iter().any(|name| !name.starts_with(&id) && name.ends_with(".checkpoint"))
    })
    .await;
    server.kill().await;
    let server = start().await;
    let client = server.client();
    let path = |what: &str| format!("/v1/jobs/{id}/exports/properties{what}?{}", hard());
    let made = client.when(&path("/status"), "succeeded", |export| export["state"] == "succeeded").await;
    assert!(server.log().contains("going on from a checkpoint"), "{}", server.log());
    let file = client.get(&path("")).send().await.expect(200).body.clone();
    eventually("the checkpoints to go", || data_dir.checkpoints().is_empty()).await;
    // Made again without any, it is the same.
    client.delete(&path("")).send().await.expect(204);
    client.post(&path("")).send().await.expect(202);
    let again = client.when(&path("/status"), "succeeded", |export| export["state"] == "succeeded").await;
    assert_eq!(again["sha256"], made["sha256"]);
    assert_eq!(made["bytes"], file.len());
    server.stop().await;
}

/// A log with a line for each checkpoint that is kept.
const CHECKPOINTS_IN_LOG: (&str, &str) = ("PACKSTONE_LOG", "info,packstone_server::checkpoints=debug");

/// Load cases that were solved by a process which keeps a checkpoint after each.
fn solved(log: &str) -> usize {
    log.lines().filter(|line| line.contains("kept a checkpoint")).count()
}

/// Load cases of a stiffness: six on the voxels, and six on half as many along each edge.
const LOAD_CASES: usize = 12;

#[tokio::test]
async fn a_worker_goes_on_from_the_load_cases_that_one_has_sent_which_was_killed() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let launch =
        Launch::new(&data_dir).workers(0).args(&["--checkpoint-every-s", "0"]).env("PACKSTONE_LEASE_S", "3");
    let server = launch.env(CHECKPOINTS_IN_LOG.0, CHECKPOINTS_IN_LOG.1).start().await;
    let client = server.client();
    let url = format!("http://{}", server.address());
    let worker = |name: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_packstone"));
        command.args([
            "worker",
            "--server",
            &url,
            "--name",
            name,
            "--slots",
            "1",
            "--checkpoint-every-s",
            "0",
        ]);
        command.args(["--send-checkpoints-every-s", "0.1"]).current_dir(folder.path());
        command.env(CHECKPOINTS_IN_LOG.0, CHECKPOINTS_IN_LOG.1);
        Running::of(command)
    };
    let first = worker("first");
    let mut job = with_materials();
    job["postprocess"] = json!({"type": "properties", "cells": 36, "kinds": "stiffness", "fields": true,
        "materials": materials(300.0)});
    let id = id_of(&client.succeed(&job).await).to_owned();
    let of_export = |name: &String| !name.starts_with(&id) && name.ends_with(".1.checkpoint");
    eventually("load cases with the server", || data_dir.checkpoints().iter().any(of_export)).await;
    first.signal(Signal::KILL);
    first.ended().await;
    let second = worker("second");
    let path = |what: &str| format!("/v1/jobs/{id}/exports/properties{what}?{}", hard());
    let made = client.when(&path("/status"), "succeeded", |export| export["state"] == "succeeded").await;
    assert_eq!(made["worker"], "second", "{made:#}");
    second.signal(Signal::TERM);
    let log = second.ended().await.stderr;
    assert!(log.contains("going on from a checkpoint"), "{log}");
    let by_second = solved(&log);
    assert!((1..LOAD_CASES).contains(&by_second), "it has solved {by_second} load cases: {log}");
    eventually("the checkpoints to go", || data_dir.checkpoints().is_empty()).await;
    // The server alone solves all of them, to the same bytes.
    client.delete(&path("")).send().await.expect(204);
    client.post(&path("")).send().await.expect(202);
    let again = client.when(&path("/status"), "succeeded", |export| export["state"] == "succeeded").await;
    assert_eq!((&again["worker"], &again["sha256"]), (&Value::Null, &made["sha256"]));
    assert_eq!(solved(&server.log()), LOAD_CASES);
    server.stop().await;
}

/// Text as a value in a query.
pub(crate) fn urlencode(text: &str) -> String {
    text.bytes().map(|byte| format!("%{byte:02X}")).collect::<Vec<_>>().concat()
}
