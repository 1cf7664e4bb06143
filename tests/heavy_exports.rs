//! Exports that take as long as a packing and that the request of a job asks for: made in the slots of packings, of the
//! server or of worker processes, whatever dies meanwhile.

use std::path::Path;

use reqwest::Method;
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::deadline::eventually;
use crate::harness::{Client, DataDir, Launch, Running, Server, id_of, jobs};
use crate::workers::{build_of, claim, sha256};

/// Voxels along an edge: a model of 100 MB is made in a slot.
const CELLS: u64 = 465;

/// A job with a voxel model that takes a few seconds, for many lines through each voxel.
fn job() -> Value {
    let voxels = json!({"type": "voxels", "format": "raw", "cells": CELLS, "samples": 16});
    jobs::with(jobs::quick(1), "/postprocess", json!([voxels]))
}

fn path(job: &str) -> String {
    format!("/v1/jobs/{job}/exports/voxels?format=raw&cells={CELLS}&samples=16")
}

fn status(job: &str) -> String {
    path(job).replace("voxels?", "voxels/status?")
}

/// Waits until the export is in a state.
async fn export_when(client: &Client, job: &str, state: &str) -> Value {
    client.when(&status(job), state, |export| export["state"] == state).await
}

async fn server(data_dir: &DataDir, lease_s: &str) -> Server {
    Launch::new(data_dir).workers(0).env("PACKSTONE_LEASE_S", lease_s).start().await
}

fn worker(folder: &Path, server: &Server, name: &str) -> Running {
    let url = format!("http://{}", server.address());
    Running::spawn(folder, &["worker", "--server", &url, "--name", name, "--slots", "1"])
}

/// A job that is packed, whose export a worker of that name makes at the moment.
async fn begun(server: &Server, worker: &str) -> String {
    let client = server.client();
    let done = client.succeed(&job()).await;
    let id = id_of(&done).to_owned();
    let running = export_when(&client, &id, "running").await;
    assert_eq!(running["worker"], worker, "{running:#}");
    // A lease whose answer cannot be delivered goes back to the queue, and its attempt does not count.
    let is_fetched = |line: &str| line.contains("method=GET") && line.contains("/1/result\"}");
    eventually("the worker to have its lease", || server.log().lines().any(is_fetched)).await;
    id
}

#[tokio::test]
async fn a_worker_makes_what_takes_long_and_another_goes_on_when_it_is_killed() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = server(&data_dir, "3").await;
    let client = server.client();
    let first = worker(folder.path(), &server, "first");
    let id = begun(&server, "first").await;
    let second = worker(folder.path(), &server, "second");
    first.signal(Signal::KILL);
    first.ended().await;
    let made = export_when(&client, &id, "succeeded").await;
    assert_eq!((&made["worker"], &made["bytes"]), (&json!("second"), &json!(CELLS.pow(3))), "{made:#}");
    let file = client.get(&path(&id)).send().await.expect(200).body.clone();
    assert_eq!(made["sha256"], sha256(&file), "the file is the one that the worker has made");
    // What is asked for later is made by the server, with the same bytes.
    client.delete(&path(&id)).send().await.expect(204);
    client.post(&path(&id)).send().await.expect(202);
    let again = export_when(&client, &id, "succeeded").await;
    assert_eq!((&again["worker"], &again["sha256"]), (&Value::Null, &made["sha256"]), "{again:#}");
    second.signal(Signal::TERM);
    assert_eq!(second.ended().await.code, Some(0));
    server.stop().await;
}

#[tokio::test]
async fn a_server_whose_workers_have_gone_makes_it_itself() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = server(&data_dir, "3").await;
    let client = server.client();
    let first = worker(folder.path(), &server, "first");
    let id = begun(&server, "first").await;
    first.signal(Signal::KILL);
    first.ended().await;
    let made = export_when(&client, &id, "succeeded").await;
    assert_eq!((&made["worker"], &made["bytes"]), (&Value::Null, &json!(CELLS.pow(3))), "{made:#}");
    server.stop().await;
}

#[tokio::test]
async fn a_slot_of_the_server_makes_it_and_the_next_job_waits_until_it_is_done_or_deleted() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    let done = client.succeed(&job()).await;
    let id = id_of(&done);
    export_when(&client, id, "running").await;
    let next = client.submit(&jobs::quick(2)).await;
    let next_job = client.job(id_of(&next)).await;
    let export = client.get(&status(id)).send().await.expect(200).json();
    assert_eq!((&export["state"], &next_job["state"]), (&json!("running"), &json!("queued")), "{export:#}");
    assert_eq!(export["worker"], Value::Null);
    client.delete(&path(id)).send().await.expect(204);
    assert_eq!(client.finished(id_of(&next)).await["state"], "succeeded");
    assert_eq!(client.job(id).await["exports"], json!([]), "it is gone");
    server.stop().await;
}

#[tokio::test]
async fn what_a_worker_says_of_an_export_is_held_against_the_packing() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = server(&data_dir, "10").await;
    let client = server.client();
    let build = build_of(&client).await;
    let first = worker(folder.path(), &server, "first");
    let id = begun(&server, "first").await;
    first.signal(Signal::KILL);
    first.ended().await;
    let volume_fraction = client.result(&id).await["summary"]["volume_fraction_effective"].clone();
    let right = json!({
        "type": "voxels", "shape": [CELLS, CELLS, CELLS], "spacing_mm": [0.1, 0.1, 0.1], "origin_mm": [0, 0, 0],
        "dtype": "|u1", "outside_label": null, "inside_voxels": 4, "aggregate_voxels": 1,
        "grains_without_voxel": 0, "volume_fraction": volume_fraction, "volume_fraction_labels": 0.25,
        "volume_fraction_samples": 0.25,
    });
    let whole = vec![0_u8; usize::try_from(CELLS.pow(3)).unwrap()];
    // Takes a while, in which the lease would run out.
    let digest = sha256(&whole);
    let put = async |lease: &str, report: &Value, file: &[u8], digest: &str| {
        let report = report.to_string().into_bytes();
        let target = format!("{lease}/export?sha256={digest}&report_bytes={}", report.len());
        client.request(Method::PUT, &target).body([&report[..], file].concat()).send().await
    };
    // The first attempt was that of the worker that was killed.
    for (attempt, report, file, digest, fault) in [
        (2, right.clone(), &b"x"[..], sha256(b"x"), "must have 100544625"),
        (3, jobs::with(right.clone(), "/volume_fraction", json!(0.9)), &whole[..], digest, "fraction 0.9"),
    ] {
        let asking = claim(&format!("claim {attempt}"), &build);
        let asked = client.post("/v1/leases").header("prefer", "wait=30").json(&asking).send().await;
        let leased = asked.expect(200).json()["exports"][0].clone();
        assert_eq!((&leased["job"], &leased["attempt"]), (&json!(id), &json!(attempt)), "{leased:#}");
        let lease = format!("/v1/leases/{}/{attempt}", leased["export"].as_str().unwrap());
        let result = client.get(&format!("{lease}/result")).send().await.expect(200).body.clone();
        assert_eq!(leased["result_sha256"], sha256(&result));
        // A file that was damaged on its way counts for nobody, and the lease goes on.
        put(&lease, &right, b"x", &"0".repeat(64)).await.expect_problem(400, "validation-error");
        let refused = put(&lease, &report, file, &digest).await;
        let problem = refused.expect_problem(400, "validation-error");
        assert!(problem["errors"][0]["detail"].as_str().unwrap().contains(fault), "{problem:#}");
        let late = put(&lease, &right, b"x", &sha256(b"x")).await;
        if attempt == 2 {
            late.expect_problem(409, "lease-lost");
        } else {
            // The export has ended: it is answered, and changes nothing.
            late.expect(200);
        }
    }
    let failed = export_when(&client, &id, "failed").await;
    assert_eq!(failed["error"]["type"], "/problems/check-failed", "{failed:#}");
    let faulty = client.get("/v1/workers").send().await.expect(200).json();
    let found = &faulty["items"][0];
    assert_eq!((&found["worker"], &found["wrong_results"]), (&json!("by hand"), &json!(2)), "{faulty:#}");
    server.stop().await;
}
