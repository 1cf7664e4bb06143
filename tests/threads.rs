//! Threads of one packing: a job holds as many worker slots, gives them back, and its packing does not depend on them.

use std::time::Duration;

use rustix::process::Signal;
use serde_json::{Value, json};
use tokio::time::sleep;

use crate::harness::deadline::patiently;
use crate::harness::{Client, DataDir, Launch, Running, id_of, jobs, packstone};

/// Waits until jobs hold so many slots of the server.
async fn busy(client: &Client, slots: u32) {
    patiently(&format!("{slots} busy slots"), async {
        while (client.metric("packstone_worker_slots_busy").await - f64::from(slots)).abs() > 0.5 {
            sleep(Duration::from_millis(20)).await;
        }
    })
    .await;
}

async fn cancel(client: &Client, job: &Value) {
    client.post(&format!("/v1/jobs/{}/cancel", id_of(job))).send().await.expect(202);
}

fn endless(threads: impl Into<Value>) -> Value {
    jobs::with(jobs::endless(), "/threads", threads.into())
}

#[tokio::test]
async fn a_job_holds_a_slot_for_each_of_its_threads_until_it_ends() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    let both = client.submit(&endless(2)).await;
    assert_eq!(both["threads"], 2);
    busy(&client, 2).await;
    let next = client.submit(&jobs::quick(1)).await;
    assert_eq!(next["threads"], Value::Null);
    assert_eq!(client.job(id_of(&next)).await["state"], "queued");
    assert_eq!(client.job(id_of(&both)).await["state"], "running");
    cancel(&client, &both).await;
    assert_eq!(client.finished(id_of(&next)).await["state"], "succeeded");
    busy(&client, 0).await;
    // A failed job gives its slots back too, and one with more threads than slots takes what is there.
    let late = client.submit(&jobs::with(endless(64), "/timeout_s", json!(0.5))).await;
    busy(&client, 2).await;
    assert_eq!(client.finished(id_of(&late)).await["error"]["type"], "/problems/timed-out");
    busy(&client, 0).await;
    // Work that is sequential takes one, whatever was asked for.
    let growth = client.submit(&jobs::with(jobs::endless_growth(), "/threads", json!(2))).await;
    client.running(id_of(&growth)).await;
    busy(&client, 1).await;
    server.stop().await;
}

#[tokio::test]
async fn a_job_without_threads_leaves_slots_to_those_that_wait() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(3).start().await;
    let client = server.client();
    let alone = client.submit(&endless(Value::Null)).await;
    busy(&client, 3).await;
    let waiting = [client.submit(&endless(Value::Null)).await, client.submit(&endless(Value::Null)).await];
    cancel(&client, &alone).await;
    for job in &waiting {
        client.running(id_of(job)).await;
    }
    busy(&client, 3).await;
    cancel(&client, &waiting[1]).await;
    client.succeed(&jobs::quick(1)).await;
    server.stop().await;
}

#[tokio::test]
async fn a_worker_process_holds_slots_too() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let url = format!("http://{}", server.address());
    let both = client.submit(&endless(2)).await;
    let worker = Running::spawn(folder.path(), &["worker", "--server", &url, "--slots", "2"]);
    client.running(id_of(&both)).await;
    let next = client.submit(&jobs::with(jobs::quick(1), "/threads", json!(2))).await;
    client.job_when(id_of(&both), "packing", |job| job["progress"]["done"].as_u64() > Some(0)).await;
    assert_eq!(client.job(id_of(&next)).await["state"], "queued");
    cancel(&client, &both).await;
    assert_eq!(client.finished(id_of(&next)).await["state"], "succeeded");
    let rest = client.submit(&endless(Value::Null)).await;
    client.job_when(id_of(&rest), "packing", |job| job["progress"]["done"].as_u64() > Some(0)).await;
    worker.signal(Signal::TERM);
    let log = worker.ended().await.stderr;
    let started: Vec<&str> = log
        .lines()
        .filter_map(|line| line.split_once("started threads="))
        .map(|(_, threads)| threads)
        .collect();
    assert_eq!(started, ["2", "1", "2"], "{log}");
    server.stop().await;
}

#[tokio::test]
async fn the_packing_does_not_depend_on_them() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = Launch::new(&data_dir).workers(8).start().await;
    let client = server.client();
    let job = jobs::equal_spheres(110_000, 5);
    let mut results: Vec<(Vec<u8>, Value)> = Vec::new();
    for threads in [1, 2, 3, 8] {
        let done = client.succeed(&jobs::with(job.clone(), "/threads", json!(threads))).await;
        assert_eq!(done["threads"], threads);
        let mut result = client.result(id_of(&done)).await;
        let own = result.as_object_mut().unwrap();
        own.remove("job_id").unwrap();
        own.remove("timings_s").unwrap();
        results.push((client.result_in(id_of(&done), "npy").await.to_vec(), result));
    }
    assert!(results.windows(2).all(|two| two[0] == two[1]), "the result tells of the threads");
    std::fs::write(folder.path().join("job.json"), job.to_string()).unwrap();
    let args = ["run", "job.json", "--out", "out", "--format", "npy", "--threads", "3"];
    let run = packstone(folder.path(), &args).await;
    assert_eq!(run.code, Some(0), "{run:?}");
    assert!(std::fs::read(folder.path().join("out/result.npy")).unwrap() == results[0].0);
    server.stop().await;
}
