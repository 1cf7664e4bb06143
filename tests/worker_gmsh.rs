//! Tetrahedra, triangles and decks that jobs name in `postprocess`, with Gmsh on the machine of the server, on that of
//! a worker process, or on both: who makes them.

use std::path::Path;
use std::process::Command;

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::deadline::patiently;
use crate::harness::{Client, DataDir, Launch, Running, Server, id_of, machine};
use crate::properties::urlencode;

fn materials() -> Value {
    json!({
        "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2},
        "aggregate": {"youngs_modulus_gpa": 70, "poissons_ratio": 0.2},
    })
}

/// A small cube with an export by Gmsh of each kind, and one of the engine's own.
fn job() -> Value {
    json!({
        "seed": 3,
        "specimen": {"type": "box", "size_mm": [20, 20, 20]},
        "mix": {"grading": {"type": "fuller", "d_max_mm": 8, "exponent": 0.5}, "d_min_mm": 5, "volume_fraction": 0.4},
        "distance": {"type": "constant", "gap_mm": 0.5},
        "materials": materials(),
        "postprocess": [
            {"type": "mesh", "format": "inp", "segments": 8},
            {"type": "deck", "elements": "tetrahedra", "segments": 8},
            {"type": "slice", "format": "vtu"},
            {"type": "properties", "cells": 8, "kinds": "stiffness"},
        ],
    })
}

/// A job without exports.
fn plain() -> Value {
    let mut job = job();
    job.as_object_mut().unwrap().remove("postprocess");
    job
}

/// A server that packs nothing itself and finds no Gmsh but the one that is named.
async fn server(data_dir: &DataDir, gmsh: Option<&Path>) -> Server {
    let launch = Launch::new(data_dir).workers(0).env("PACKSTONE_LEASE_S", "3").env("PATH", "/nowhere");
    match gmsh {
        Some(gmsh) => launch.args(&["--gmsh", gmsh.to_str().unwrap()]).start().await,
        None => launch.start().await,
    }
}

/// A worker that finds no Gmsh but the one that is named.
fn worker(folder: &Path, server: &Server, name: &str, gmsh: Option<&Path>) -> Running {
    let mut command = Command::new(env!("CARGO_BIN_EXE_packstone"));
    let url = format!("http://{}", server.address());
    command.args(["worker", "--server", &url, "--name", name, "--slots", "1"]).current_dir(folder);
    command.env_remove("PACKSTONE_GMSH").env("PATH", "/nowhere");
    if let Some(gmsh) = gmsh {
        command.arg("--gmsh").arg(gmsh);
    }
    Running::of(command)
}

/// A shell script in Gmsh's place, of another version, which fails.
fn failing(folder: &Path) -> std::path::PathBuf {
    let file = folder.join("failing-gmsh");
    let text = "#!/bin/sh\ncase \"$*\" in *--version*) echo 4.99.0; exit 0;; esac\n\
        echo 'Error   : volume 7 cannot be filled' >&2; exit 1\n";
    // Another process writes it: a file that this one has open while another thread starts a program is busy.
    let mut writer = Command::new("sh");
    writer.args(["-c", "printf '%s' \"$2\" >\"$1\" && chmod 755 \"$1\"", "sh"]);
    assert!(writer.arg(&file).arg(text).status().unwrap().success());
    file
}

/// The exports of a job by their types, once all have ended.
async fn ended(client: &Client, job: &Value) -> Vec<Value> {
    let list = client.get(&format!("/v1/jobs/{}/exports", id_of(job))).send().await.expect(200).json();
    let mut exports = Vec::new();
    for export in list["items"].as_array().unwrap() {
        let is_over = |export: &Value| ["succeeded", "failed"].contains(&export["state"].as_str().unwrap());
        exports.push(client.when(export["links"]["self"].as_str().unwrap(), "over", is_over).await);
    }
    exports.sort_by_key(|export| export["type"].as_str().unwrap().to_owned());
    exports
}

/// Type, state and maker of each export.
fn makers(exports: &[Value]) -> Value {
    exports.iter().map(|export| json!([export["type"], export["state"], export["worker"]])).collect()
}

/// Submits a job as soon as the server has heard of a worker that makes its exports.
async fn submitted_when_accepted(client: &Client, job: &Value) -> Value {
    patiently("a worker with Gmsh to be heard", async {
        let mut look_again = tokio::time::interval(std::time::Duration::from_millis(50));
        loop {
            look_again.tick().await;
            let reply = client.post("/v1/jobs").json(job).send().await;
            if reply.status != 422 {
                return reply.expect(201).json();
            }
        }
    })
    .await
}

async fn stopped(worker: Running) -> String {
    worker.signal(Signal::TERM);
    let ended = worker.ended().await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    ended.stderr
}

#[tokio::test]
async fn a_worker_with_gmsh_meshes_for_a_server_that_has_none() {
    let Some((python, _)) = machine::gmsh("No worker made tetrahedra.") else { return };
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = server(&data_dir, None).await;
    let client = server.client();
    let bare = worker(folder.path(), &server, "bare", None);
    let packed = client.succeed(&plain()).await;
    assert_eq!(packed["worker"], "bare");
    // Nobody who could make them was heard.
    let problem =
        client.post("/v1/jobs").json(&job()).send().await.expect_problem(422, "format-not-available");
    assert!(problem.to_string().contains("apt install gmsh"), "{problem:#}");

    let meshing = worker(folder.path(), &server, "meshing", Some(&python));
    let submitted = submitted_when_accepted(&client, &job()).await;
    let done = client.finished(id_of(&submitted)).await;
    let exports = ended(&client, &done).await;
    for (export, kind) in exports.iter().zip(["deck", "mesh", "properties", "slice"]) {
        assert_eq!((&export["type"], &export["state"]), (&json!(kind), &json!("succeeded")), "{export:#}");
        // The engine's own is made by either.
        assert!(kind == "properties" || export["worker"] == "meshing", "{export:#}");
    }
    let mesher = exports[1]["report"]["tetrahedra"]["mesher"].as_str().unwrap();
    assert!(mesher.starts_with("Gmsh 4."), "{mesher}");
    // They are there for all, though this server could not make them.
    let path = format!("/v1/jobs/{}/exports/mesh?format=inp&segments=8", id_of(&done));
    assert!(client.get(&path).send().await.expect(200).body.starts_with(b"** Packstone "));
    let other = format!("/v1/jobs/{}/exports/mesh?format=inp&segments=9", id_of(&done));
    client.get(&other).send().await.expect_problem(422, "format-not-available");
    let log = stopped(meshing).await;
    assert!(log.contains(&format!("mesher=\"{mesher}\"")), "{log}");
    assert!(stopped(bare).await.contains("mesher=\"none\""));
    server.stop().await;
}

#[tokio::test]
async fn a_server_with_gmsh_meshes_what_its_workers_cannot() {
    let Some((python, _)) = machine::gmsh("No worker made tetrahedra.") else { return };
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = server(&data_dir, Some(&python)).await;
    let client = server.client();
    // One without Gmsh, and one with another: its files would have other bytes.
    let other = failing(folder.path());
    for (name, gmsh) in [("bare", None), ("other", Some(other.as_path()))] {
        let worker = worker(folder.path(), &server, name, gmsh);
        let done = client.succeed(&job()).await;
        assert_eq!(done["worker"], name);
        let exports = ended(&client, &done).await;
        let here = |kind: &str| json!([kind, "succeeded", null]);
        let expected = json!([here("deck"), here("mesh"), ["properties", "succeeded", name], here("slice")]);
        assert_eq!(makers(&exports), expected, "{exports:#?}");
        stopped(worker).await;
    }
    // One with the same makes them, and the bytes are those of the server.
    let same = worker(folder.path(), &server, "same", Some(&python));
    let done = client.succeed(&job()).await;
    let exports = ended(&client, &done).await;
    let there = |kind: &str| json!([kind, "succeeded", "same"]);
    assert_eq!(makers(&exports), json!(["deck", "mesh", "properties", "slice"].map(there)), "{exports:#?}");
    stopped(same).await;
    let path = format!("/v1/jobs/{}/exports/mesh?format=inp&segments=8", id_of(&done));
    client.delete(&path).send().await.expect(204);
    client.get(&path).send().await.expect(200);
    let again = client.get(&path.replace("mesh?", "mesh/status?")).send().await.expect(200).json();
    assert_eq!((&again["worker"], &again["sha256"]), (&Value::Null, &exports[1]["sha256"]), "{again:#}");
    server.stop().await;
}

#[tokio::test]
async fn what_gmsh_says_on_a_worker_is_the_cause_of_the_failure() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = server(&data_dir, None).await;
    let client = server.client();
    let gmsh = failing(folder.path());
    let worker = worker(folder.path(), &server, "failing", Some(&gmsh));
    let mut one = job();
    one["postprocess"] = json!([{"type": "mesh", "format": "inp", "segments": 8}]);
    let submitted = submitted_when_accepted(&client, &one).await;
    let done = client.finished(id_of(&submitted)).await;
    let exports = ended(&client, &done).await;
    assert_eq!(makers(&exports), json!([["mesh", "failed", "failing"]]), "{exports:#?}");
    let error = &exports[0]["error"];
    assert_eq!(error["type"], "/problems/machine-fault", "{error:#}");
    assert!(error["detail"].as_str().unwrap().contains("volume 7 cannot be filled"), "{error:#}");
    stopped(worker).await;
    // Materials in a URL, as the page sends them, change nothing: nobody here can make it.
    let materials = urlencode(&materials().to_string());
    let deck = format!("/v1/jobs/{}/exports/deck?elements=tetrahedra&materials={materials}", id_of(&done));
    client.get(&deck).send().await.expect_problem(422, "format-not-available");
    server.stop().await;
}
