//! What an operator looks at: health, readiness, metrics, request ids, the document.

use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Launch, Server, holds_every_store, id_of, jobs};

#[tokio::test]
async fn health_and_readiness_are_answered() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    client.get("/healthz").send().await.expect(200);
    client.get("/readyz").send().await.expect(200);
    client.head("/healthz").send().await.expect(200);
    server.stop().await;
}

/// The sum of all series of a metric whose labels contain `label`.
async fn metric(client: &Client, name: &str, label: &str) -> f64 {
    let reply = client.get("/metrics").send().await;
    let text = String::from_utf8(reply.expect(200).body.to_vec()).unwrap();
    assert!(text.contains(&format!("# TYPE {name} ")), "no {name} in\n{text}");
    text.lines()
        .filter(|line| line.split(['{', ' ']).next() == Some(name) && line.contains(label))
        .map(|line| line.rsplit(' ').next().unwrap().parse::<f64>().unwrap())
        .sum()
}

#[tokio::test]
async fn metrics_count_what_happened() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    client.succeed(&jobs::quick(1)).await;
    client.succeed(&jobs::quick(2)).await;
    let failed = client.submit(&jobs::unreachable()).await;
    client.finished(id_of(&failed)).await;
    let running = client.submit(&jobs::endless()).await;
    client.running(id_of(&running)).await;
    client.submit(&jobs::quick(3)).await;

    assert!((metric(&client, "packstone_jobs", "queued").await - 1.0).abs() < 0.5);
    assert!((metric(&client, "packstone_jobs", "running").await - 1.0).abs() < 0.5);
    assert!((metric(&client, "packstone_jobs", "succeeded").await - 2.0).abs() < 0.5);
    assert!((metric(&client, "packstone_jobs", "failed").await - 1.0).abs() < 0.5);
    assert!((metric(&client, "packstone_jobs_submitted_total", "").await - 5.0).abs() < 0.5);
    assert!(metric(&client, "packstone_http_requests_total", "201").await >= 5.0);
    server.stop().await;
}

/// Checks the forecast times that wait and run; the store keeps microseconds.
async fn expect_work(client: &Client, queued_s: f64, running_s: f64) {
    for (name, expected) in
        [("packstone_queue_work_seconds", queued_s), ("packstone_running_work_seconds", running_s)]
    {
        let found = metric(client, name, "").await;
        assert!((found - expected).abs() < 1e-4, "{name} is {found}, the plans say {expected}");
    }
}

#[tokio::test]
async fn the_work_that_waits_and_runs_is_that_of_the_plans() {
    if holds_every_store() {
        return;
    }
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    let forecast = async |job: &Value| {
        let plan = client.post("/v1/plans").json(job).send().await.expect(200).json();
        plan["estimated_time_s"].as_f64().unwrap()
    };
    expect_work(&client, 0.0, 0.0).await;
    let endless = jobs::endless();
    let running = client.submit(&endless).await;
    client.running(id_of(&running)).await;
    let running_s = forecast(&endless).await;
    assert!(running_s > 0.1, "{running_s}");
    expect_work(&client, 0.0, running_s).await;

    let growing_s = forecast(&jobs::contract()).await;
    let growing = client.submit(&jobs::contract()).await;
    let bounded = jobs::with(jobs::endless(), "/timeout_s", json!(0.25));
    let bounded_s = forecast(&bounded).await.min(0.25);
    client.submit(&bounded).await;
    expect_work(&client, growing_s + bounded_s, running_s).await;
    let volume_fractions = [0.53, 0.535];
    let mut template = jobs::contract();
    template.as_object_mut().unwrap().remove("seed");
    client
        .submit_study(&json!({
            "seed": 1, "template": template, "grid": {"/mix/volume_fraction": volume_fractions},
            "replicates": 3
        }))
        .await;
    let mut study_s = 0.0;
    for volume_fraction in volume_fractions {
        let point = jobs::with(jobs::contract(), "/mix/volume_fraction", json!(volume_fraction));
        study_s += 3.0 * forecast(&point).await;
    }
    expect_work(&client, growing_s + bounded_s + study_s, running_s).await;
    client.post(&format!("/v1/jobs/{}/cancel", id_of(&growing))).send().await.expect(200);
    expect_work(&client, bounded_s + study_s, running_s).await;

    // What ran when the server died waits again.
    server.kill().await;
    let server = Launch::new(&data_dir).workers(0).start().await;
    expect_work(&server.client(), bounded_s + study_s + running_s, 0.0).await;
    server.stop().await;
}

#[tokio::test]
async fn a_request_id_is_echoed_or_made_and_named_by_problems() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let reply = client.get("/healthz").header("x-request-id", "lab-42").send().await;
    assert_eq!(reply.header("x-request-id"), "lab-42");
    let (one, two) = (client.get("/nowhere").send().await, client.get("/nowhere").send().await);
    assert_ne!(one.header("x-request-id"), two.header("x-request-id"));
    let problem = one.expect_problem(404, "not-found");
    let instance = problem["instance"].as_str().unwrap();
    assert!(instance.contains(one.header("x-request-id")), "{instance}");
    // What could be taken for lines of a log is not taken over.
    let long = "x".repeat(5000);
    assert_ne!(
        client.get("/healthz").header("x-request-id", &long).send().await.header("x-request-id"),
        long
    );
    server.stop().await;
}

#[tokio::test]
async fn logs_are_json_on_request_and_carry_the_ids() {
    let data_dir = DataDir::new();
    let server =
        Launch::new(&data_dir).args(&["--log-format", "json"]).env("PACKSTONE_LOG", "debug").start().await;
    let client = server.client();
    let reply = client.post("/v1/jobs").header("x-request-id", "lab-43").json(&jobs::quick(1)).send().await;
    let job = reply.expect(201).json();
    client.finished(id_of(&job)).await;
    server.terminate();
    let log = server.log_at_end().await;
    let lines: Vec<Value> = log.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    assert!(!lines.is_empty(), "no JSON in\n{log}");
    let with = |text: &str| lines.iter().any(|line| line.to_string().contains(text));
    assert!(with("lab-43"), "no line has the request's id:\n{log}");
    assert!(with(id_of(&job)), "no line has the job's id:\n{log}");
}

#[tokio::test]
async fn a_problem_type_is_explained_where_it_points() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let problem = client.get("/v1/jobs/none").send().await.expect_problem(404, "not-found");
    let explained = client.get(problem["type"].as_str().unwrap()).send().await;
    explained.expect(200);
    assert!(!explained.body.is_empty());
    server.stop().await;
}
