//! Waiting for a job without asking again and again: `Prefer: wait` and long-polls.

use std::time::{Duration, Instant};

use crate::harness::{DataDir, Launch, Server, id_of, jobs};

#[tokio::test]
async fn a_submission_may_wait_for_its_result() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let reply = client.post("/v1/jobs").header("prefer", "wait=60").json(&jobs::quick(1)).send().await;
    assert_eq!(reply.expect(201).json()["state"], "succeeded");
    assert_eq!(reply.header("preference-applied"), "wait=60");
    server.stop().await;
}

#[tokio::test]
async fn a_wait_ends_with_its_time() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let start = Instant::now();
    let reply = client.post("/v1/jobs").header("prefer", "wait=1").json(&jobs::endless()).send().await;
    let state = reply.expect(201).json()["state"].clone();
    assert!(state == "running" || state == "queued", "{state}");
    assert!(start.elapsed() >= Duration::from_secs(1));
    server.stop().await;
}

#[tokio::test]
async fn an_unchanged_job_is_not_sent_again() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).start().await;
    let client = server.client();
    let running = client.submit(&jobs::endless()).await;
    client.running(id_of(&running)).await;
    // The one worker is taken: this job stays as it is.
    let queued = client.submit(&jobs::quick(1)).await;
    let path = format!("/v1/jobs/{}", id_of(&queued));
    let etag = client.get(&path).send().await.expect(200).header("etag").to_owned();

    let at_once = client.get(&path).header("if-none-match", &etag).send().await;
    at_once.expect(304);
    assert_eq!(at_once.header("etag"), etag);
    assert!(at_once.body.is_empty());

    let start = Instant::now();
    client.get(&path).header("if-none-match", &etag).header("prefer", "wait=1").send().await.expect(304);
    assert!(start.elapsed() >= Duration::from_secs(1));
    client
        .get(&path)
        .header("if-none-match", "\"another\"")
        .header("prefer", "wait=30")
        .send()
        .await
        .expect(200);
    server.stop().await;
}

#[tokio::test]
async fn a_long_poll_answers_when_the_job_changes() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).start().await;
    let client = server.client();
    let running = client.submit(&jobs::endless()).await;
    client.running(id_of(&running)).await;
    let queued = client.submit(&jobs::quick(1)).await;
    let path = format!("/v1/jobs/{}", id_of(&queued));
    let etag = client.get(&path).send().await.header("etag").to_owned();

    let poll =
        tokio::spawn(client.get(&path).header("if-none-match", &etag).header("prefer", "wait=60").send());
    // Whether the poll is there before or after the change, it must answer with it.
    client.post(&format!("{path}/cancel")).send().await.expect(200);
    let start = Instant::now();
    let reply = poll.await.unwrap();
    assert_eq!(reply.expect(200).json()["state"], "cancelled");
    assert!(start.elapsed() < Duration::from_secs(10), "the poll slept through the change");
    assert_ne!(reply.header("etag"), etag);
    server.stop().await;
}
