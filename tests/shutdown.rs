//! The end of a server that was asked to end: soon, in good order, and at no job's expense.

use std::time::{Duration, Instant};

use serde_json::json;

use crate::harness::{DataDir, Launch, Server, id_of, jobs};

const LIMIT: Duration = Duration::from_secs(10);

#[tokio::test]
async fn fifty_streams_and_running_jobs_do_not_hold_it_up() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    let running = [client.submit(&jobs::endless()).await, client.submit(&jobs::endless()).await];
    for job in &running {
        client.running(id_of(job)).await;
    }
    let queued = client.submit(&jobs::quick(1)).await;
    let mut streams = Vec::new();
    for i in 0..50 {
        let mut stream = client.events(id_of(&running[i % 2]), None).await;
        stream.next().await.expect("a first event");
        streams.push(tokio::spawn(stream.drained()));
    }
    let etag = client.get(&format!("/v1/jobs/{}", id_of(&queued))).send().await.header("etag").to_owned();
    let path = format!("/v1/jobs/{}", id_of(&queued));
    let poll =
        tokio::spawn(client.get(&path).header("if-none-match", &etag).header("prefer", "wait=60").try_send());

    let start = Instant::now();
    server.terminate();
    let status = server.ends_within(LIMIT).await;
    assert!(status.success(), "{status} after {:?}", start.elapsed());
    for stream in streams {
        stream.await.unwrap();
    }
    // The poll may have been answered or not; it must not hang.
    let _ = poll.await.unwrap();

    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    for job in &running {
        let job = client.job(id_of(job)).await;
        assert!(job["state"] == "queued" || job["state"] == "running", "{job:#}");
        client.running(id_of(&job)).await;
        client.post(&format!("/v1/jobs/{}/cancel", id_of(&job))).send().await.expect(202);
    }
    assert_eq!(client.finished(id_of(&queued)).await["state"], "succeeded");
    server.stop().await;
}

#[tokio::test]
async fn jobs_go_back_to_the_queue_before_it_ends() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let job = server.client().submit(&jobs::endless()).await;
    server.client().running(id_of(&job)).await;
    server.stop().await;
    // Without a worker nothing runs: the job is seen as the stopped server left it.
    let server = Launch::new(&data_dir).workers(0).start().await;
    let job = server.client().job(id_of(&job)).await;
    assert_eq!(job["state"], "queued", "{job:#}");
    assert!(job["started_at"].is_null(), "{job:#}");
    server.stop().await;
}

#[tokio::test]
async fn a_restart_is_not_the_job_s_fault() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let mut job = jobs::endless();
    job["max_attempts"] = json!(1);
    let job = server.client().submit(&job).await;
    server.client().running(id_of(&job)).await;
    server.stop().await;
    for _ in 0..3 {
        let server = Server::start(&data_dir).await;
        server.client().running(id_of(&job)).await;
        server.stop().await;
    }
}

#[tokio::test]
async fn an_idle_server_ends_at_once_and_twice_asked_is_no_harm() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    server.client().succeed(&jobs::quick(1)).await;
    server.terminate();
    server.terminate();
    assert!(server.ends_within(LIMIT).await.success());
}

#[tokio::test]
async fn an_interrupt_is_as_good() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let job = server.client().submit(&jobs::endless()).await;
    server.client().running(id_of(&job)).await;
    server.interrupt();
    assert!(server.ends_within(LIMIT).await.success());
}
