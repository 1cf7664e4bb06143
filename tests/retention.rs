//! What ends and leaves by time, and the deletion of many jobs at once.

use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Launch, id_of, jobs};
use crate::users::Keys;

/// Submits a quick job with a label and waits for its end.
async fn labelled(client: &Client, seed: u64, label: &str) -> String {
    let job = jobs::with(jobs::quick(seed), "/labels", json!({"series": label}));
    id_of(&client.succeed(&job).await).to_owned()
}

async fn delete(client: &Client, query: &str) -> Value {
    client.delete(&format!("/v1/jobs?{query}")).send().await.expect(200).json()
}

#[tokio::test]
async fn finished_jobs_are_deleted_by_a_filter_and_counted_before() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).start().await;
    let client = server.client();
    let (first, second) = (labelled(&client, 1, "a").await, labelled(&client, 2, "a").await);
    let other = labelled(&client, 3, "b").await;
    let study = json!({
        "template": jobs::with(jobs::with(jobs::quick(1), "/seed", Value::Null), "/labels", json!({"series": "a"})),
        "replicates": 2, "seed": 5,
    });
    let study = client.submit_study(&study).await;
    client.study_finished(id_of(&study)).await;
    let waiting = client.submit(&jobs::with(jobs::endless(), "/labels", json!({"series": "a"}))).await;
    client.running(id_of(&waiting)).await;
    for (query, place) in
        [("", "state"), ("dry_run=true", "state"), ("state=queued", "state"), ("before=now", "before")]
    {
        let refused =
            client.delete(&format!("/v1/jobs?{query}")).send().await.expect_problem(400, "validation-error");
        assert_eq!(refused["errors"][0]["parameter"], place, "{refused:#}");
    }
    let answer = |deleted: u64, dry_run: bool| json!({"deleted": deleted, "dry_run": dry_run, "more": false});
    let mut counted = delete(&client, "label=series=a&dry_run=true").await;
    // Its results would become free.
    assert!(counted.as_object_mut().unwrap().remove("bytes").unwrap().as_u64().unwrap() > 0);
    assert_eq!(counted, answer(2, true));
    assert_eq!(delete(&client, "state=failed").await, answer(0, false));
    let ended = client.job(&second).await["finished_at"].as_str().unwrap().to_owned();
    assert_eq!(delete(&client, &format!("label=series=a&before={ended}")).await, answer(1, false));
    client.get(&format!("/v1/jobs/{first}")).send().await.expect_problem(404, "not-found");
    assert_eq!(delete(&client, "label=series=a&state=succeeded").await, answer(1, false));
    assert_eq!(client.job(&other).await["state"], "succeeded");
    let files = data_dir.artifacts();
    assert_eq!(files.len(), 3, "the other job and the study keep their results: {files:?}");
    assert_eq!(client.table(id_of(&study)).await[0]["successes"], 2);
    assert_eq!(delete(&client, "before=9999-12-31T23:59:59Z").await, answer(1, false));
    assert_eq!(client.job(id_of(&waiting)).await["state"], "running");
    server.stop().await;
}

#[tokio::test]
async fn a_key_deletes_the_jobs_of_its_owner_only() {
    let keys = Keys::make(&[
        (&["root", "--role", "admin"], ""),
        (&["anna", "--role", "submit", "--owner", "lab"], ""),
        (&["bert", "--role", "read", "--owner", "lab"], ""),
        (&["carl", "--role", "submit"], ""),
    ])
    .await;
    let data_dir = DataDir::new();
    let server = keys.launch(&data_dir).start().await;
    let [root, anna, bert, carl] = ["root", "anna", "bert", "carl"].map(|name| keys.client(&server, name));
    let of_anna = labelled(&anna, 1, "x").await;
    let shared =
        jobs::with(jobs::with(jobs::quick(2), "/shared", json!(true)), "/labels", json!({"series": "x"}));
    let of_carl = carl.succeed(&shared).await;
    bert.delete("/v1/jobs?label=series=x").send().await.expect_problem(403, "forbidden");
    assert_eq!(delete(&anna, "label=series=x").await["deleted"], 1);
    anna.get(&format!("/v1/jobs/{of_anna}")).send().await.expect_problem(404, "not-found");
    assert_eq!(anna.job(id_of(&of_carl)).await["state"], "succeeded");
    assert_eq!(delete(&root, "state=succeeded&dry_run=true").await["deleted"], 1);
    assert_eq!(delete(&root, "state=succeeded").await["deleted"], 1);
    server.stop().await;
}

#[tokio::test]
async fn what_is_old_leaves_unless_it_has_a_time_of_its_own() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).start().await;
    let client = server.client();
    let old = labelled(&client, 1, "a").await;
    let own = jobs::with(jobs::quick(2), "/expires_at", json!("9999-12-31T23:59:59Z"));
    let own = client.succeed(&own).await;
    assert_eq!(own["expires_at"], "9999-12-31T23:59:59Z");
    let study =
        json!({"template": jobs::with(jobs::quick(1), "/seed", Value::Null), "replicates": 1, "seed": 5});
    let study = client.submit_study(&study).await;
    client.study_finished(id_of(&study)).await;
    server.stop().await;
    // A millionth of a day, looked at twice a second.
    let options = ["--expire-after-days", "0.000001", "--sweep-interval-s", "0.5"];
    let server = Launch::new(&data_dir).args(&options).start().await;
    let client = server.client();
    assert_eq!(
        client.get("/v1/capabilities").send().await.expect(200).json()["limits"]["expire_after_days"],
        1e-6
    );
    client.gone(&format!("/v1/jobs/{old}")).await;
    client.gone(&format!("/v1/studies/{}", id_of(&study))).await;
    assert_eq!(client.job(id_of(&own)).await["state"], "succeeded");
    assert_eq!(data_dir.artifacts().len(), 1);
    server.stop().await;
}

#[tokio::test]
async fn a_job_that_expires_while_it_waits_is_cancelled() {
    let data_dir = DataDir::new();
    // The sweep would remove it a moment later.
    let server = Launch::new(&data_dir).workers(0).args(&["--sweep-interval-s", "3600"]).start().await;
    let client = server.client();
    let soon = jiff::Timestamp::now() + jiff::SignedDuration::from_secs(2);
    let job = client.submit(&jobs::with(jobs::quick(1), "/expires_at", json!(soon.to_string()))).await;
    let done = client.finished(id_of(&job)).await;
    assert_eq!((&done["state"], &done["started_at"]), (&json!("cancelled"), &Value::Null), "{done:#}");
    assert!(done["finished_at"].as_str().unwrap().parse::<jiff::Timestamp>().unwrap() >= soon, "{done:#}");
    server.stop().await;
}

#[tokio::test]
async fn no_run_takes_longer_than_the_server_allows_here_and_elsewhere() {
    for workers in [1, 0] {
        let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
        let server = Launch::new(&data_dir).workers(workers).args(&["--max-run-s", "1.5"]).start().await;
        let client = server.client();
        let url = format!("http://{}", server.address());
        let args = ["worker", "--server", &url, "--name", "w", "--slots", "1"];
        let worker = (workers == 0).then(|| crate::harness::Running::spawn(folder.path(), &args));
        let jobs = [
            (jobs::endless(), "1.5 s"),
            (jobs::with(jobs::endless(), "/timeout_s", json!(1000)), "1.5 s"),
            (jobs::with(jobs::endless(), "/timeout_s", json!(0.5)), "0.5 s"),
        ];
        for (job, limit) in jobs {
            let submitted = client.submit(&job).await;
            let ended = client.finished(id_of(&submitted)).await;
            assert_eq!(ended["error"]["type"], "/problems/timed-out", "{ended:#}");
            let detail = ended["error"]["detail"].as_str().unwrap();
            assert!(detail.contains(limit) && detail.contains("--max-run-s"), "{detail}");
        }
        if let Some(worker) = worker {
            worker.signal(rustix::process::Signal::TERM);
            assert_eq!(worker.ended().await.code, Some(0));
        }
        server.stop().await;
    }
}
