//! Which job runs when, for how long, and how often.

use std::time::Duration;

use serde_json::{Value, json};

use crate::harness::deadline::within;
use crate::harness::{DataDir, Launch, Server, holds_every_store, id_of, jobs};

#[tokio::test]
async fn higher_priorities_run_first_and_equal_ones_in_order() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    let blocker = client.submit(&jobs::endless()).await;
    client.running(id_of(&blocker)).await;

    let mut submitted = Vec::new();
    for (seed, priority) in [0, -5, 10, 0, 100, -100, 10, 0].into_iter().enumerate() {
        let job = jobs::with(jobs::quick(seed as u64), "/priority", json!(priority));
        submitted.push(client.submit(&job).await);
    }
    client.post(&format!("/v1/jobs/{}/cancel", id_of(&blocker))).send().await.expect(202);
    let mut finished = Vec::new();
    for job in &submitted {
        finished.push(client.finished(id_of(job)).await);
    }
    let by = |field: &'static str| move |job: &Value| job[field].as_str().unwrap().to_owned();
    let mut by_start = finished.clone();
    by_start.sort_by_key(by("started_at"));
    let mut expected = finished;
    expected.sort_by_key(|job| (-job["priority"].as_i64().unwrap(), id_of(job).to_owned()));
    let order = |jobs: &[Value]| jobs.iter().map(|job| job["seed"].clone()).collect::<Vec<_>>();
    assert_eq!(order(&by_start), order(&expected));
    server.stop().await;
}

#[tokio::test]
async fn as_many_jobs_run_as_there_are_workers() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    let mut submitted = Vec::new();
    for _ in 0..3 {
        submitted.push(client.submit(&jobs::endless()).await);
    }
    client.running(id_of(&submitted[0])).await;
    client.running(id_of(&submitted[1])).await;
    assert_eq!(client.job(id_of(&submitted[2])).await["state"], "queued");
    client.post(&format!("/v1/jobs/{}/cancel", id_of(&submitted[0]))).send().await.expect(202);
    client.running(id_of(&submitted[2])).await;
    server.stop().await;
}

#[tokio::test]
async fn a_job_over_its_time_fails() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.submit(&jobs::with(jobs::endless(), "/timeout_s", json!(1))).await;
    client.running(id_of(&job)).await;
    let failed = within(Duration::from_secs(5), "the time limit of 1 s", client.finished(id_of(&job))).await;
    assert_eq!(failed["state"], "failed");
    assert_eq!(failed["error"]["type"], "/problems/timed-out", "{failed:#}");
    assert!(failed["error"]["detail"].as_str().unwrap().contains('1'), "{failed:#}");
    assert_eq!(failed["attempt"], 1, "what took too long once is not tried again");
    // The limit counts running time: a job that waits longer than its limit still runs.
    client.succeed(&jobs::with(jobs::quick(1), "/timeout_s", json!(60))).await;
    server.stop().await;
}

#[tokio::test]
async fn a_job_is_tried_again_after_a_crash_but_not_for_ever() {
    if holds_every_store() {
        return;
    }
    let data_dir = DataDir::new();
    let mut server = Launch::new(&data_dir).workers(1).start().await;
    let job = server.client().submit(&jobs::with(jobs::endless(), "/max_attempts", json!(3))).await;
    let id = id_of(&job).to_owned();
    for attempt in 1..=3 {
        let running = server.client().running(&id).await;
        assert_eq!(running["attempt"], attempt, "{running:#}");
        server.kill().await;
        server = Launch::new(&data_dir).workers(1).start().await;
    }
    let failed = server.client().finished(&id).await;
    assert_eq!(failed["state"], "failed");
    assert_eq!(failed["error"]["type"], "/problems/attempts-exhausted", "{failed:#}");
    assert_eq!(failed["attempt"], 3);
    // Whoever knows better may try once more.
    server.client().post(&format!("/v1/jobs/{id}/retry")).send().await;
    assert_eq!(server.client().running(&id).await["attempt"], 4);
    server.stop().await;
}

#[tokio::test]
async fn a_full_queue_is_said_and_refuses_nothing_else() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(0).args(&["--max-queued", "2"]).start().await;
    let client = server.client();
    let first = client.submit(&jobs::quick(1)).await;
    client
        .post("/v1/jobs")
        .header("idempotency-key", "second")
        .json(&jobs::quick(2))
        .send()
        .await
        .expect(201);
    let refused =
        client.post("/v1/jobs").header("idempotency-key", "third").json(&jobs::quick(3)).send().await;
    let problem = refused.expect_problem(429, "queue-full");
    assert!(problem["detail"].as_str().unwrap().contains('2'), "{problem:#}");
    assert!(refused.header("retry-after").parse::<u32>().unwrap() >= 1);
    // What is known already is answered, what is asked without storing too, and a place that is given up is free.
    client
        .post("/v1/jobs")
        .header("idempotency-key", "second")
        .json(&jobs::quick(2))
        .send()
        .await
        .expect(200);
    client.post("/v1/plans").json(&jobs::quick(3)).send().await.expect(200);
    client.post(&format!("/v1/jobs/{}/cancel", id_of(&first))).send().await.expect(200);
    client.post("/v1/jobs").header("idempotency-key", "third").json(&jobs::quick(3)).send().await.expect(201);
    client.post(&format!("/v1/jobs/{}/retry", id_of(&first))).send().await.expect_problem(429, "queue-full");
    server.stop().await;
}
