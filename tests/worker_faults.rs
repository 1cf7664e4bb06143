//! Faults of the machines on which workers run, and of the network between them and the server.
//!
//! These tests need the rights of root, and programs that Debian has in iproute2 and faketime; see
//! [`machine`](crate::harness::machine).

use std::fs;
use std::path::Path;
use std::process::Command;

use jiff::Timestamp;
use rustix::process::Signal;
use serde_json::json;

use crate::harness::deadline::eventually;
use crate::harness::machine::{Network, SmallDisk, faketime};
use crate::harness::{Client, DataDir, Launch, Running, Server, id_of, jobs};
use crate::workers::packed_alone;

/// A server that packs nothing itself, whose leases are short.
fn launch(data_dir: &DataDir) -> Launch {
    Launch::new(data_dir).workers(0).env("PACKSTONE_LEASE_S", "3")
}

/// Starts a worker of a server with a command that ends in the program. Its scratch is a folder of its name.
fn worker(mut command: Command, folder: &Path, server: &Server, name: &str) -> Running {
    let url = format!("http://{}", server.address());
    command.args(["worker", "--server", &url, "--name", name, "--scratch", name, "--slots", "1"]);
    command.args(["--checkpoint-every-s", "0.2", "--send-checkpoints-every-s", "0.2"]).current_dir(folder);
    Running::of(command)
}

fn program() -> Command {
    Command::new(PROGRAM)
}

const PROGRAM: &str = env!("CARGO_BIN_EXE_packstone");

/// Asks a worker to end, and returns what it said.
async fn stopped(worker: Running) -> String {
    worker.signal(Signal::TERM);
    let ended = worker.ended().await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    ended.stderr
}

/// The files below a folder.
fn files(folder: &Path) -> Vec<String> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push(path.display().to_string());
        }
    }
    found
}

async fn leases(client: &Client, event: &str) -> f64 {
    client.metric(&format!("packstone_leases_total{{event=\"{event}\"}}")).await
}

/// That an attempt which lost its lease can neither end its job nor bring a result.
async fn is_refused(client: &Client, id: &str, attempt: u64) {
    let lease = format!("/v1/leases/{id}/{attempt}");
    for end in [
        json!({"outcome": "released"}),
        json!({"outcome": "cancelled"}),
        json!({"outcome": "failed", "failure": {"code": "timed-out", "detail": "too late"}}),
    ] {
        let late = client.post(&format!("{lease}/end")).json(&end).send().await;
        late.expect_problem(409, "lease-lost");
    }
    for path in [format!("{lease}/result?sha256={}", "0".repeat(64)), format!("{lease}/checkpoint")] {
        let late = client.request(reqwest::Method::PUT, &path).body("late").send().await;
        late.expect_problem(409, "lease-lost");
    }
}

#[tokio::test]
async fn a_worker_that_is_cut_off_loses_its_job_and_goes_on_with_others() {
    let Some(network) = Network::make() else { return };
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let listen = format!("{}:0", network.address());
    let server = launch(&data_dir).listen(&listen).args(&["--insecure"]).start().await;
    let client = server.client();
    let far = worker(network.command(PROGRAM), folder.path(), &server, "far");
    let job = jobs::growth();
    let submitted = client.submit(&job).await;
    let id = id_of(&submitted);
    let growing = client.job_when(id, "growing", |job| job["progress"]["step"] == "edmd").await;
    assert_eq!(growing["worker"], "far");
    network.link(false);
    client.job_when(id, "taken back", |job| job["attempt"] == 2).await;
    // The worker goes on, and has a result that it cannot send.
    let unsent = folder.path().join("far/artifacts");
    eventually("the packing of the worker that is cut off", || !files(&unsent).is_empty()).await;
    let near = worker(program(), folder.path(), &server, "near");
    let done = client.finished(id).await;
    assert_eq!(
        (&done["state"], &done["worker"], &done["attempt"]),
        (&json!("succeeded"), &json!("near"), &json!(2)),
        "{done:#}"
    );
    let refused = leases(&client, "refused").await;
    is_refused(&client, id, 1).await;
    assert!(leases(&client, "refused").await >= refused + 5.0, "each refusal is counted");
    stopped(near).await;
    network.link(true);
    let next = client.succeed(&jobs::quick(1)).await;
    assert_eq!(next["worker"], "far", "the worker goes on");
    // It learns of the loss from the answer to a new request, or from a late answer to one before the cut.
    eventually("the result that nobody wants to go", || files(&unsent).is_empty()).await;
    assert_eq!(client.job(id).await, done, "the late result changed nothing");
    assert!(client.result_in(id, "npy").await == packed_alone(folder.path(), &job).await);
    let log = stopped(far).await;
    assert!(log.contains("the lease was lost; this attempt leaves no trace"), "{log}");
    assert_eq!(data_dir.artifacts().len(), 2, "{:?}", data_dir.artifacts());
    eventually("the checkpoints to go", || data_dir.checkpoints().is_empty()).await;
    assert_eq!((leases(&client, "expired").await, leases(&client, "taken").await), (1.0, 3.0));
    server.stop().await;
}

#[tokio::test]
async fn clocks_that_are_wrong_and_run_at_other_rates_change_nothing() {
    let Some(library) = faketime() else { return };
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = launch(&data_dir).start().await;
    let client = server.client();
    let job = jobs::growth();
    let alone = packed_alone(folder.path(), &job).await;
    // Hours off; the last two with another rate of the monotonic clock too.
    for (name, time, hours) in
        [("ahead", "+30h", 30), ("behind", "-7h", -7), ("fast", "+5h x1.6", 5), ("slow", "-5h x0.6", -5)]
    {
        let mut command = program();
        command.env("LD_PRELOAD", &library).env("FAKETIME", time);
        let worker = worker(command, folder.path(), &server, name);
        let renewed = leases(&client, "renewed").await;
        let done = client.succeed(&job).await;
        assert_eq!((&done["worker"], &done["attempt"]), (&json!(name), &json!(1)), "{time}: {done:#}");
        assert!(leases(&client, "renewed").await > renewed, "{time}: the lease was not renewed");
        assert!(client.result_in(id_of(&done), "npy").await == alone, "{time}");
        let log = stopped(worker).await;
        let said: Timestamp = log.split_whitespace().next().unwrap().parse().unwrap();
        let off = said.duration_since(Timestamp::now()).as_secs_f64() / 3600.0;
        assert!((off - f64::from(hours)).abs() < 1.0, "{time}: the clock of the worker is {off} h off");
    }
    for event in ["expired", "refused"] {
        assert_eq!(leases(&client, event).await, 0.0, "{event}");
    }
    server.stop().await;
}

#[tokio::test]
async fn a_worker_with_a_full_disk_gives_the_job_back_and_says_why() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let scratch = folder.path().join("full");
    fs::create_dir(&scratch).unwrap();
    let Some(_disk) = SmallDisk::mount(&scratch, 256 << 10) else { return };
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    // Some 640 KB.
    let job = jobs::with(jobs::equal_spheres(20_000, 1), "/max_attempts", json!(1));
    let submitted = client.submit(&job).await;
    let id = id_of(&submitted);
    let full = worker(program(), folder.path(), &server, "full");
    client.running(id).await;
    let back = client.job_when(id, "given back", |job| job["state"] == "queued").await;
    assert_eq!(
        (&back["attempt"], &back["max_attempts"]),
        (&json!(2), &json!(2)),
        "it did not count: {back:#}"
    );
    // It does not take the job again, nor another one.
    let sound = worker(program(), folder.path(), &server, "sound");
    let done = client.finished(id).await;
    assert_eq!((&done["state"], &done["worker"]), (&json!("succeeded"), &json!("sound")), "{done:#}");
    assert!(client.result_in(id, "npy").await == packed_alone(folder.path(), &job).await);
    client.succeed(&jobs::quick(1)).await;
    is_refused(&client, id, 1).await;
    let log = stopped(full).await;
    for says in [
        "the result was not written",
        "No space left on device",
        "the disk of this worker is full; it takes no job",
    ] {
        assert!(log.contains(says), "{says:?} is not in {log}");
    }
    assert_eq!(log.matches(": started").count(), 1, "{log}");
    assert_eq!(files(&scratch.join("artifacts")), Vec::<String>::new());
    stopped(sound).await;
    server.stop().await;
}

/// What a worker does that slept after its packing was done.
#[tokio::test]
async fn a_late_result_is_refused_and_the_job_ends_once() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = launch(&data_dir).start().await;
    let client = server.client();
    let job = jobs::growth();
    let submitted = client.submit(&job).await;
    let id = id_of(&submitted);
    let sleeper = worker(program(), folder.path(), &server, "sleeper");
    client.job_when(id, "growing", |job| job["progress"]["step"] == "edmd").await;
    let server_address = server.address().to_string();
    server.kill().await;
    // It goes on while there is no server, and sleeps when it has its result.
    let results = folder.path().join("sleeper/artifacts");
    let is_whole = || files(&results).iter().any(|name| name.ends_with(".packstone"));
    eventually("the packing of the worker", is_whole).await;
    sleeper.signal(Signal::STOP);
    let server = launch(&data_dir).listen(&server_address).start().await;
    let client = server.client();
    client.job_when(id, "taken back", |job| job["attempt"] == 2).await;
    let other = worker(program(), folder.path(), &server, "other");
    let done = client.finished(id).await;
    assert_eq!((&done["worker"], &done["attempt"]), (&json!("other"), &json!(2)), "{done:#}");
    sleeper.signal(Signal::CONT);
    eventually("the late result to go", || files(&results).is_empty()).await;
    let log = stopped(sleeper).await;
    assert!(log.contains("the lease was lost; this attempt leaves no trace"), "{log}");
    assert!(leases(&client, "refused").await >= 1.0);
    is_refused(&client, id, 1).await;
    assert_eq!(client.job(id).await, done);
    assert_eq!(data_dir.artifacts().len(), 1, "{:?}", data_dir.artifacts());
    assert!(client.result_in(id, "npy").await == packed_alone(folder.path(), &job).await);
    stopped(other).await;
    server.stop().await;
}
