//! Runs that were broken off and go on: whatever broke them off, the packing is that of a run which
//! nothing disturbed.

use std::fs;
use std::path::Path;

use rustix::process::Signal;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::harness::deadline::eventually;
use crate::harness::{Client, DataDir, Launch, Running, Server, holds_every_store, id_of, jobs, packstone};

/// A server that keeps a checkpoint between any two epochs.
async fn keeping(data_dir: &DataDir) -> Server {
    let args = ["--checkpoint-every-s", "0", "--sweep-interval-s", "0.2"];
    Launch::new(data_dir).args(&args).env("RUST_LOG", "info").start().await
}

async fn sha256(client: &Client, id: &str) -> Vec<u8> {
    Sha256::digest(client.result_in(id, "npy").await).to_vec()
}

/// What the method that grew the grains counted.
async fn statistics(client: &Client, id: &str) -> Value {
    let summary = client.get(&format!("/v1/jobs/{id}/result/summary")).send().await.expect(200).json();
    let counted = summary["statistics"].as_object().unwrap();
    counted.get("edmd").or(counted.get("monte_carlo")).unwrap().clone()
}

/// Runs a job, breaks it off after each of `cuts` first checkpoints of an attempt, and holds the result against that
/// of a run that nothing disturbed.
async fn survives(job: &Value, cuts: usize, end: impl AsyncFn(Server)) -> Value {
    let data_dir = DataDir::new();
    let mut server = keeping(&data_dir).await;
    let submitted = server.client().submit(job).await;
    let id = id_of(&submitted).to_owned();
    for _ in 0..cuts {
        let attempt = server.client().running(&id).await["attempt"].clone();
        let name = format!("{id}.{attempt}.checkpoint");
        eventually("a checkpoint of the attempt", || data_dir.checkpoints().contains(&name)).await;
        end(server).await;
        server = keeping(&data_dir).await;
    }
    let client = server.client();
    let cut = client.finished(&id).await;
    assert_eq!(cut["state"], "succeeded", "{cut:#}");
    let counted = statistics(&client, &id).await;
    assert!(counted["resumes"].as_u64() >= Some(1), "it started anew: {counted:#}");
    assert!(server.log().contains("going on from a checkpoint"), "{}", server.log());

    let undisturbed = client.succeed(job).await;
    assert_eq!(statistics(&client, id_of(&undisturbed)).await["resumes"], 0);
    assert!(
        sha256(&client, &id).await == sha256(&client, id_of(&undisturbed)).await,
        "the packing is another than that of an undisturbed run"
    );
    eventually("checkpoints to go with their jobs", || data_dir.checkpoints().is_empty()).await;
    server.stop().await;
    cut
}

#[tokio::test]
async fn a_power_cut_costs_no_more_than_the_last_epoch() {
    if holds_every_store() {
        return;
    }
    let job = survives(&jobs::growth(), 2, async |server| server.kill().await).await;
    assert_eq!(job["attempt"], 3, "{job:#}");
}

#[tokio::test]
async fn grains_that_are_no_spheres_go_on_after_a_power_cut_too() {
    if holds_every_store() {
        return;
    }
    let ratios = json!({"type": "constant", "b_over_a": 0.8, "c_over_a": 0.65});
    for (shape, fraction) in [("ellipsoid", 0.55), ("polyhedron", 0.45)] {
        let job = jobs::with(jobs::growth(), "/mix/shape", json!({"type": shape, "ratios": ratios}));
        let job = jobs::with(job, "/method", json!({"type": "monte_carlo"}));
        let job = jobs::with(job, "/mix/volume_fraction", json!(fraction));
        let job = survives(&job, 2, async |server| server.kill().await).await;
        assert_eq!(job["attempt"], 3, "{job:#}");
    }
}

#[tokio::test]
async fn a_restart_costs_no_more_than_the_last_epoch() {
    let job = survives(&jobs::growth(), 1, async |server| server.stop().await).await;
    // In a shared store the next run has a number of its own, and the job one attempt more.
    let left = job["max_attempts"].as_u64().unwrap() - job["attempt"].as_u64().unwrap();
    assert_eq!(left, 2, "a restart is no attempt: {job:#}");
}

#[tokio::test]
async fn what_cannot_be_gone_on_from_is_no_obstacle() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(0).start().await;
    let id = id_of(&server.client().submit(&jobs::quick_growth(1)).await).to_owned();
    server.kill().await;
    let file = data_dir.path().join(format!("checkpoints/{id}.1.checkpoint"));
    fs::write(&file, "no checkpoint at all").unwrap();
    let server = keeping(&data_dir).await;
    let client = server.client();
    let job = client.finished(&id).await;
    assert_eq!(job["state"], "succeeded", "{job:#}");
    assert_eq!(statistics(&client, &id).await["resumes"], 0);
    assert!(server.log().contains("a checkpoint is of no use"), "{}", server.log());
    server.stop().await;
}

#[tokio::test]
async fn a_folder_that_takes_no_checkpoint_harms_nothing() {
    let data_dir = DataDir::new();
    let server = keeping(&data_dir).await;
    // The name of the folder is taken by a file: no checkpoint can be written, as on a full disk.
    let folder = data_dir.path().join("checkpoints");
    fs::remove_dir(&folder).unwrap();
    fs::write(&folder, "").unwrap();
    server.client().succeed(&jobs::quick_growth(1)).await;
    assert!(server.log().contains("a checkpoint could not be kept"), "{}", server.log());
    server.stop().await;
}

#[tokio::test]
async fn a_cancelled_job_leaves_no_checkpoint_and_a_retry_starts_anew() {
    let data_dir = DataDir::new();
    let server = keeping(&data_dir).await;
    let client = server.client();
    let id = id_of(&client.submit(&jobs::endless_growth()).await).to_owned();
    eventually("a checkpoint", || !data_dir.checkpoints().is_empty()).await;
    client.post(&format!("/v1/jobs/{id}/cancel")).send().await.expect(202);
    assert_eq!(client.finished(&id).await["state"], "cancelled");
    eventually("the checkpoint to go", || data_dir.checkpoints().is_empty()).await;
    client.post(&format!("/v1/jobs/{id}/retry")).send().await.expect(200);
    eventually("a checkpoint of the next attempt", || {
        data_dir.checkpoints() == [format!("{id}.2.checkpoint")]
    })
    .await;
    assert!(!server.log().contains("going on from a checkpoint"), "{}", server.log());
    client.post(&format!("/v1/jobs/{id}/cancel")).send().await.expect(202);
    client.finished(&id).await;
    server.stop().await;
}

fn write_job(directory: &Path, job: &Value) {
    fs::write(directory.join("job.json"), job.to_string()).unwrap();
}

/// Breaks `packstone run` off after its first checkpoint, goes on, and holds the result against that of the server.
async fn run_survives(signal: Signal) {
    let directory = tempfile::tempdir().unwrap();
    let mut job = jobs::growth();
    // The seed that is drawn must be that of both halves.
    job.as_object_mut().unwrap().remove("seed");
    write_job(directory.path(), &job);
    let args = ["run", "job.json", "--out", "out", "--format", "json,npy", "--checkpoint-every-s", "0"];
    let checkpoint = directory.path().join("out/checkpoint.packstone");
    let running = Running::start(directory.path(), &args).await;
    eventually("a checkpoint", || checkpoint.exists()).await;
    running.signal(signal);
    let ended = running.ended().await;
    assert_ne!(ended.code, Some(0), "{ended:?}");
    if signal != Signal::KILL {
        assert!(ended.stderr.contains("--resume"), "{ended:?}");
    }
    assert!(checkpoint.exists(), "{ended:?}");
    assert!(!directory.path().join("out/result.npy").exists());

    let ended = packstone(directory.path(), &args).await;
    assert!(ended.code != Some(0) && ended.stderr.contains("--resume"), "{ended:?}");
    assert!(ended.stderr.contains("--fresh"), "{ended:?}");
    write_job(directory.path(), &jobs::with(job.clone(), "/mix/volume_fraction", json!(0.52)));
    let resume = [&args[..], &["--resume"]].concat();
    let ended = packstone(directory.path(), &resume).await;
    assert!(ended.code != Some(0), "{ended:?}");
    assert!(
        ended.stderr.contains("/mix/volume_fraction is 0.52 in the job and 0.53 in the checkpoint"),
        "{ended:?}"
    );

    write_job(directory.path(), &job);
    let ended = packstone(directory.path(), &resume).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(!checkpoint.exists(), "a finished run has no use for it");
    let read = |name: &str| fs::read(directory.path().join("out").join(name)).unwrap();
    let result: Value = serde_json::from_slice(&read("result.json")).unwrap();
    assert!(result["statistics"]["edmd"]["resumes"].as_u64() >= Some(1), "{}", result["statistics"]);

    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    job["seed"] = result["request"]["seed"].clone();
    let undisturbed = client.succeed(&job).await;
    assert!(read("result.npy") == client.result_in(id_of(&undisturbed), "npy").await);
    server.stop().await;
}

#[tokio::test]
async fn a_run_goes_on_after_a_power_cut() {
    run_survives(Signal::KILL).await;
}

#[tokio::test]
async fn a_run_goes_on_after_an_interrupt() {
    run_survives(Signal::INT).await;
}

/// The checkpoint that is next due by the clock would come some seconds later.
#[tokio::test]
async fn a_run_that_is_asked_to_stop_keeps_a_last_checkpoint() {
    let directory = tempfile::tempdir().unwrap();
    let job = jobs::with(jobs::endless_growth(), "/specimen/size_mm", json!([60, 60, 60]));
    write_job(directory.path(), &job);
    let args = ["run", "job.json", "--out", "out", "--checkpoint-every-s", "4"];
    let checkpoint = directory.path().join("out/checkpoint.packstone");
    let running = Running::start(directory.path(), &args).await;
    eventually("a checkpoint", || checkpoint.exists()).await;
    let before = fs::read(&checkpoint).unwrap();
    running.signal(Signal::INT);
    let ended = running.ended().await;
    assert!(ended.code == Some(130) && ended.stderr.contains("--resume"), "{ended:?}");
    assert!(fs::read(&checkpoint).unwrap() != before, "the checkpoint is that of before the interrupt");
}

#[tokio::test]
async fn a_run_stops_on_a_signal_before_there_is_a_checkpoint() {
    for signal in [Signal::INT, Signal::TERM] {
        let directory = tempfile::tempdir().unwrap();
        write_job(directory.path(), &jobs::endless());
        let running = Running::start(directory.path(), &["run", "job.json", "--out", "out"]).await;
        running.signal(signal);
        let ended = running.ended().await;
        assert_eq!(ended.code, Some(130), "{ended:?}");
        assert!(ended.stderr.contains("stopped on request before the first checkpoint"), "{ended:?}");
        assert_eq!(fs::read_dir(directory.path().join("out")).unwrap().count(), 0);
    }
}

#[tokio::test]
async fn what_is_no_checkpoint_is_refused_and_can_be_discarded() {
    let directory = tempfile::tempdir().unwrap();
    write_job(directory.path(), &jobs::quick(1));
    let args = ["run", "job.json", "--out", "out", "--format", "npy"];
    let with = |option| packstone_with(directory.path(), &args, option);
    // A script may always say --resume.
    let ended = with("--resume").await;
    assert!(ended.code == Some(0) && ended.stderr.contains("starts anew"), "{ended:?}");
    fs::remove_file(directory.path().join("out/result.npy")).unwrap();
    let checkpoint = directory.path().join("out/checkpoint.packstone");
    fs::write(&checkpoint, "PACKSTCK and then nothing of use").unwrap();
    let ended = with("--resume").await;
    assert!(ended.code == Some(3) && ended.stderr.contains("--fresh"), "{ended:?}");
    let ended = packstone(directory.path(), &args).await;
    assert!(ended.code != Some(0) && ended.stderr.contains("--fresh"), "{ended:?}");
    assert!(checkpoint.exists(), "nobody said that it may go");
    let ended = with("--fresh").await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(!checkpoint.exists() && directory.path().join("out/result.npy").exists());
    let both = packstone(directory.path(), &["run", "job.json", "--resume", "--fresh"]).await;
    assert!(both.code != Some(0) && both.stderr.contains("cannot be used with"), "{both:?}");
    let bad = packstone(directory.path(), &["run", "job.json", "--checkpoint-every-s", "-1"]).await;
    assert_ne!(bad.code, Some(0), "{bad:?}");
}

async fn packstone_with(directory: &Path, args: &[&str], option: &str) -> crate::harness::Finished {
    packstone(directory, &[args, &[option]].concat()).await
}

#[tokio::test]
async fn attempts_that_keep_a_checkpoint_do_not_count() {
    if holds_every_store() {
        return;
    }
    let data_dir = DataDir::new();
    let mut server = keeping(&data_dir).await;
    let job = server.client().submit(&jobs::with(jobs::growth(), "/max_attempts", json!(1))).await;
    let id = id_of(&job).to_owned();
    for attempt in 1..=2 {
        assert_eq!(server.client().running(&id).await["attempt"], attempt);
        let name = format!("{id}.{attempt}.checkpoint");
        eventually("a checkpoint of the attempt", || data_dir.checkpoints().contains(&name)).await;
        server.kill().await;
        server = keeping(&data_dir).await;
    }
    let ended = server.client().finished(&id).await;
    assert_eq!(ended["state"], "succeeded", "{ended:#}");
    server.stop().await;
}

#[tokio::test]
async fn a_server_that_is_asked_to_stop_keeps_a_last_checkpoint() {
    let data_dir = DataDir::new();
    // The first is due after five seconds, unless the server stops.
    let server = Launch::new(&data_dir).args(&["--checkpoint-every-s", "3600"]).start().await;
    let client = server.client();
    let job = client.submit(&jobs::endless_growth()).await;
    client.job_when(id_of(&job), "it to grow", |job| job["progress"]["step"] == "edmd").await;
    assert!(data_dir.checkpoints().is_empty());
    server.stop().await;
    assert_eq!(data_dir.checkpoints(), [format!("{}.1.checkpoint", id_of(&job))]);
}
