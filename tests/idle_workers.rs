//! Idle workers of several kinds on one queue: which of them a job wakes, and what becomes of a job whose worker stops
//! before it has read the answer.

use std::path::Path;
use std::time::{Duration, Instant};

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Fault, Launch, Proxy, Running, id_of, jobs};

/// Starts a worker of a server, and returns when it waits for jobs.
async fn worker(folder: &Path, client: &Client, url: &str, more: &[&str]) -> Running {
    let before = client.metric("packstone_worker_processes").await;
    let args = ["worker", "--server", url, "--name", more.first().unwrap_or(&"w"), "--slots", "1"];
    let running = Running::spawn(folder, &[&args[..], more.get(1..).unwrap_or_default()].concat());
    client.metric_when("packstone_worker_processes", |processes| processes > before).await;
    running
}

/// Longer than a pilot with 50 s left has, and not worth handing on.
fn long() -> Value {
    jobs::with(jobs::endless(), "/specimen/size_mm", json!([130, 130, 130]))
}

#[tokio::test]
async fn a_job_that_fits_no_pilot_starts_on_the_idle_worker_of_the_server() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = Launch::new(&data_dir).start().await;
    let client = server.client();
    let url = format!("http://{}", server.address());
    let pilot = worker(folder.path(), &client, &url, &["pilot", "--until", "200s"]).await;
    for seed in 1..=3 {
        // The order in which the two wait changes from one job to the next.
        client.succeed(&jobs::quick(seed)).await;
        let submitted = Instant::now();
        let job = client.submit(&long()).await;
        client.running(id_of(&job)).await;
        assert!(submitted.elapsed() < Duration::from_secs(5), "{:?}", submitted.elapsed());
        client.post(&format!("/v1/jobs/{}/cancel", id_of(&job))).send().await.expect(202);
        client.finished(id_of(&job)).await;
    }
    pilot.signal(Signal::TERM);
    assert_eq!(pilot.ended().await.code, Some(0));
    server.stop().await;
}

#[tokio::test]
async fn a_job_whose_worker_stops_before_it_has_read_the_answer_is_queued_at_once() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    // Leases of a minute: the job does not wait for the end of one.
    let server = Launch::new(&data_dir).workers(0).env("PACKSTONE_LEASE_S", "60").start().await;
    let client = server.client();
    let proxy = Proxy::start(&server.address().to_string()).await;
    let stopped = worker(folder.path(), &client, &proxy.url(), &["stopped"]).await;
    proxy.set(Fault::HeldAnswers);
    let job = client.submit(&jobs::quick(1)).await;
    proxy.has_failed(1).await;
    assert_eq!(client.job(id_of(&job)).await["worker"], "stopped");
    proxy.set(Fault::None);
    stopped.signal(Signal::TERM);
    let ended = stopped.ended().await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let waiting = client.job(id_of(&job)).await;
    assert_eq!((&waiting["state"], &waiting["worker"]), (&json!("queued"), &Value::Null), "{waiting:#}");
    let next = worker(folder.path(), &client, &proxy.url(), &["next"]).await;
    assert_eq!(client.finished(id_of(&job)).await["worker"], "next");
    next.signal(Signal::TERM);
    assert_eq!(next.ended().await.code, Some(0));
    server.stop().await;
}
