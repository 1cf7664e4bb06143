//! Cancel, retry and delete, and the states that forbid them.

use serde_json::Value;

use crate::harness::deadline::eventually;
use crate::harness::{Client, DataDir, Launch, Reply, Server, id_of, jobs};

async fn act(client: &Client, id: &str, action: &str) -> Reply {
    client.post(&format!("/v1/jobs/{id}/{action}")).send().await
}

async fn delete(client: &Client, id: &str) -> Reply {
    client.delete(&format!("/v1/jobs/{id}")).send().await
}

#[tokio::test]
async fn a_running_job_that_would_not_end_is_cancelled() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.submit(&jobs::endless()).await;
    let id = id_of(&job);
    client.running(id).await;

    let asked = act(&client, id, "cancel").await.expect(202).json();
    assert!(asked["cancel_requested"] == true, "{asked:#}");
    let cancelled = client.finished(id).await;
    assert_eq!(cancelled["state"], "cancelled");
    assert!(cancelled["result"].is_null());
    client.get(&format!("/v1/jobs/{id}/result")).send().await.expect_problem(409, "job-failed");

    // The worker is free again.
    client.succeed(&jobs::quick(1)).await;
    assert!(data_dir.artifacts().len() <= 1, "a cancelled job left files: {:?}", data_dir.artifacts());
    server.stop().await;
}

#[tokio::test]
async fn a_queued_job_is_cancelled_at_once_and_never_runs() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    let running = client.submit(&jobs::endless()).await;
    client.running(id_of(&running)).await;
    let queued = client.submit(&jobs::quick(1)).await;
    let cancelled = act(&client, id_of(&queued), "cancel").await.expect(200).json();
    assert_eq!(cancelled["state"], "cancelled");
    assert!(cancelled["started_at"].is_null());

    act(&client, id_of(&running), "cancel").await.expect(202);
    client.succeed(&jobs::quick(2)).await;
    assert!(client.job(id_of(&queued)).await["started_at"].is_null());
    server.stop().await;
}

#[tokio::test]
async fn what_the_state_forbids_is_a_conflict_and_changes_nothing() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    let succeeded = client.succeed(&jobs::quick(1)).await;
    let running = client.submit(&jobs::endless()).await;
    client.running(id_of(&running)).await;
    let queued = client.submit(&jobs::quick(2)).await;

    let conflict = |reply: Reply, state: &str| {
        let problem = reply.expect_problem(409, "conflict");
        assert!(problem["detail"].as_str().unwrap().contains(state), "{problem:#}");
    };
    conflict(act(&client, id_of(&succeeded), "cancel").await, "succeeded");
    conflict(act(&client, id_of(&succeeded), "retry").await, "succeeded");
    for (job, state) in [(&running, "running"), (&queued, "queued")] {
        conflict(act(&client, id_of(job), "retry").await, state);
        conflict(delete(&client, id_of(job)).await, state);
        assert_eq!(client.job(id_of(job)).await["state"], state);
    }
    let after = client.job(id_of(&succeeded)).await;
    assert_eq!(after, succeeded);

    let unknown = "01900000-0000-7000-8000-000000000000";
    act(&client, unknown, "cancel").await.expect_problem(404, "not-found");
    act(&client, unknown, "retry").await.expect_problem(404, "not-found");
    delete(&client, unknown).await.expect_problem(404, "not-found");
    server.stop().await;
}

#[tokio::test]
async fn a_failed_or_cancelled_job_runs_again_when_retried() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();

    let blocker = client.submit(&jobs::endless()).await;
    client.running(id_of(&blocker)).await;
    let job = client.submit(&jobs::quick(1)).await;
    let id = id_of(&job);
    act(&client, id, "cancel").await.expect(200);
    let retried: Value = act(&client, id, "retry").await.json();
    assert_eq!(retried["state"], "queued", "{retried:#}");
    assert!(retried["finished_at"].is_null() && retried["error"].is_null());
    assert_eq!(retried["cancel_requested"], false);
    act(&client, id_of(&blocker), "cancel").await.expect(202);
    assert_eq!(client.finished(id).await["state"], "succeeded");

    let failing = client.submit(&jobs::unreachable()).await;
    let first = client.finished(id_of(&failing)).await;
    act(&client, id_of(&failing), "retry").await;
    let second = client
        .job_when(id_of(&failing), "failed again", |job| job["attempt"] == 2 && job["state"] == "failed")
        .await;
    assert_eq!(second["error"], first["error"], "the same seed fails in the same way");
    server.stop().await;
}

#[tokio::test]
async fn a_deleted_job_is_gone_with_its_files() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let kept = client.succeed(&jobs::quick(1)).await;
    let job = client.succeed(&jobs::quick(2)).await;
    let id = id_of(&job);
    let file_of = |id: &str| data_dir.artifacts().into_iter().any(|file| file.to_string_lossy().contains(id));
    assert!(file_of(id));

    let reply = delete(&client, id).await;
    assert!(reply.expect(204).body.is_empty());
    assert!(!file_of(id) && file_of(id_of(&kept)));
    for path in ["", "/result", "/result/summary", "/events"] {
        client.get(&format!("/v1/jobs/{id}{path}")).send().await.expect_problem(404, "not-found");
    }
    delete(&client, id).await.expect_problem(404, "not-found");
    let listed = client.get("/v1/jobs").send().await.json();
    assert_eq!(listed["items"].as_array().unwrap().len(), 1);
    client.result(id_of(&kept)).await;
    server.stop().await;
}

#[tokio::test]
async fn a_cancel_that_meets_the_end_leaves_one_end() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    let mut ends = Vec::new();
    for seed in 0..60 {
        let job = client.submit(&jobs::quick(seed)).await;
        let id = id_of(&job).to_owned();
        // Sooner or later in the run, by as many round trips.
        for _ in 0..seed % 6 {
            client.job(&id).await;
        }
        let status = act(&client, &id, "cancel").await.status.as_u16();
        let ended = client.finished(&id).await;
        let state = ended["state"].as_str().unwrap().to_owned();
        match status {
            200 => assert_eq!(state, "cancelled"),
            202 => assert!(state == "cancelled" || state == "succeeded", "{state}"),
            409 => assert_eq!(state, "succeeded"),
            other => panic!("{other}"),
        }
        assert_eq!(ended["result"].is_null(), state == "cancelled", "{ended:#}");
        let result = client.get(&format!("/v1/jobs/{id}/result")).send().await;
        result.expect(if state == "cancelled" { 409 } else { 200 });
        ends.push(state);
    }
    let succeeded = ends.iter().filter(|state| *state == "succeeded").count();
    eventually("files of cancelled jobs to go", || data_dir.artifacts().len() == succeeded).await;
    server.stop().await;
}

#[tokio::test]
async fn the_id_must_be_an_id() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    for nonsense in ["1", "..%2f..%2fetc%2fpasswd", "%00", "01900000-0000-7000-8000-00000000000g"] {
        let reply = client.get(&format!("/v1/jobs/{nonsense}")).send().await;
        reply.expect_problem(404, "not-found");
        act(&client, nonsense, "cancel").await.expect_problem(404, "not-found");
    }
    server.stop().await;
}
