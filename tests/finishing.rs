//! Runs that end with what they have reached: asked by `POST /v1/jobs/{id}/finish` at any moment, in the server and in
//! a worker process, or by limits with `"on_limit": "keep"`.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Launch, Running, Server, id_of, jobs, results};

/// Longest time from the request to the result that is promised, and what the machine of a test may add.
const PROMISED: Duration = Duration::from_secs(5);
const MARGIN: Duration = Duration::from_secs(15);

/// Equal spheres that jam before their target, and grow until they are stopped as far as a test is concerned.
fn dense_growth() -> Value {
    let job = jobs::with(jobs::equal_spheres(4000, 3), "/mix/volume_fraction", json!(0.70));
    let job = jobs::with(job, "/specimen/size_mm", json!([14.4, 14.4, 14.4]));
    jobs::with(job, "/method", json!({"type": "edmd", "stop": {"stall_dt_s": 1e-300}}))
}

/// Waits until a running job reports a step.
async fn in_step(client: &Client, id: &str, step: &str) {
    client.job_when(id, step, |job| job["progress"]["step"] == step).await;
}

/// Asks twice for the end, and waits for it.
async fn finish(client: &Client, id: &str) -> Value {
    let path = format!("/v1/jobs/{id}/finish");
    let asked = Instant::now();
    let first = client.post(&path).send().await.expect(202).json();
    assert!(first["finish_requested"] == true && first["cancel_requested"] == false, "{first:#}");
    let again = client.post(&path).send().await;
    assert!([200, 202].contains(&again.status.as_u16()), "{again:?}");
    let done = client.finished(id).await;
    assert!(asked.elapsed() < PROMISED + MARGIN, "{:?}", asked.elapsed());
    assert_eq!(done["state"], "succeeded", "{done:#}");
    // Asked once more after the end it is the same.
    assert_eq!(client.post(&path).send().await.expect(200).json()["version"], done["version"]);
    done
}

/// Holds a packing of spheres against what it says of itself, by all pairs: the smallest gap, with the images of a
/// periodic box, and the volume fraction.
async fn judge(client: &Client, id: &str, edges_mm: [f64; 3]) -> (f64, f64) {
    let rows = results::from_json(&client.result(id).await);
    // Apart from the connections of the client, which would not see meanwhile that the server closes them.
    tokio::task::spawn_blocking(move || judge_rows(&rows, edges_mm)).await.unwrap()
}

fn judge_rows(rows: &results::Rows, edges_mm: [f64; 3]) -> (f64, f64) {
    let mut least = f64::INFINITY;
    for (i, one) in rows.iter().enumerate() {
        for other in &rows[..i] {
            let apart = |axis: usize| {
                let d: f64 = one[axis] - other[axis];
                d - edges_mm[axis] * (d / edges_mm[axis]).round()
            };
            let distance = (0..3).map(|axis| apart(axis).powi(2)).sum::<f64>().sqrt();
            least = least.min(distance - (one[3] + other[3]) / 2.0);
        }
    }
    let volume: f64 = rows.iter().map(|row| std::f64::consts::PI / 6.0 * row[3].powi(3)).sum();
    (least, volume / edges_mm.iter().product::<f64>())
}

#[tokio::test]
async fn growth_ends_with_its_packing_when_it_is_asked() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(3).start().await;
    let client = server.client();
    let ids: Vec<String> = {
        let mut ids = Vec::new();
        for _ in 0..3 {
            ids.push(id_of(&client.submit(&dense_growth()).await).to_owned());
        }
        ids
    };
    // Some time after the start, by the clock: what is promised is about seconds.
    let begun = Instant::now();
    for (id, after_s) in ids.iter().zip([1, 3, 10]) {
        in_step(&client, id, "edmd").await;
        tokio::time::sleep_until((begun + Duration::from_secs(after_s)).into()).await;
        let done = finish(&client, id).await;
        let partial = &done["result"]["summary"]["partial"];
        assert_eq!(partial["reason"], "finished", "{done:#}");
        let reached = partial["volume_fraction_reached"].as_f64().unwrap();
        let asked = partial["volume_fraction_requested"].as_f64().unwrap();
        let scale = partial["size_scale"].as_f64().unwrap();
        assert!(0.3 < reached && reached < asked && scale < 1.0, "{partial:#}");
        // Whole grains miss the volume that is asked for by half of one of 4000 at most.
        assert!((scale.powi(3) - reached / asked).abs() < 2e-4, "{partial:#}");
        let (least_mm, fraction) = judge(&client, id, [14.4; 3]).await;
        assert!((-1e-12..1e-6).contains(&least_mm), "the largest scale leaves a contact: {least_mm} mm");
        assert!((fraction - reached).abs() < 1e-9, "{fraction} {partial:#}");
        assert!(done["warnings"].as_array().is_some_and(|warnings| !warnings.is_empty()), "{done:#}");
        // What is made of it says so.
        let plot = client
            .get(&format!("/v1/jobs/{id}/plots/grading?title=false"))
            .send()
            .await
            .expect(200)
            .body
            .clone();
        assert!(String::from_utf8_lossy(&plot).contains("partial packing"));
    }
    server.stop().await;
}

#[tokio::test]
async fn random_addition_ends_with_the_grains_that_are_placed() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let id = id_of(&client.submit(&jobs::endless()).await).to_owned();
    in_step(&client, &id, "rsa").await;
    let done = finish(&client, &id).await;
    let partial = &done["result"]["summary"]["partial"];
    assert_eq!(
        (&partial["reason"], &partial["size_scale"]),
        (&json!("finished"), &json!(1.0)),
        "{partial:#}"
    );
    let (placed, wanted) =
        (partial["grains_placed"].as_u64().unwrap(), partial["grains_requested"].as_u64().unwrap());
    assert!(0 < placed && placed < wanted && done["result"]["summary"]["grains"] == placed, "{partial:#}");
    server.stop().await;
}

#[tokio::test]
async fn a_packing_that_is_checked_is_complete() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let id = id_of(&client.submit(&jobs::equal_spheres(400_000, 1)).await).to_owned();
    // A check that is over before it is told of leaves the packing as complete.
    let is_packed = |job: &Value| {
        let step = job["progress"]["step"].as_str();
        step.is_some_and(|step| ["check", "write"].contains(&step)) || !job["finished_at"].is_null()
    };
    client.job_when(&id, "checked", is_packed).await;
    let asked = client.post(&format!("/v1/jobs/{id}/finish")).send().await;
    let done = client.finished(&id).await;
    assert_eq!(done["state"], "succeeded", "{done:#}");
    assert!(done["result"]["summary"].get("partial").is_none(), "{done:#}");
    // The check may end between the two.
    if asked.status == 409 {
        assert!(asked.expect_problem(409, "conflict")["detail"].as_str().unwrap().contains("has its result"));
    } else {
        asked.expect(202);
    }
    server.stop().await;
}

#[tokio::test]
async fn a_worker_in_another_process_is_told_to_finish() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let url = format!("http://{}", server.address());
    let worker =
        Running::spawn(folder.path(), &["worker", "--server", &url, "--name", "far", "--slots", "1"]);
    let id = id_of(&client.submit(&dense_growth()).await).to_owned();
    in_step(&client, &id, "edmd").await;
    let done = finish(&client, &id).await;
    assert_eq!(
        (&done["worker"], &done["result"]["summary"]["partial"]["reason"]),
        (&json!("far"), &json!("finished"))
    );
    // One that is full, and whose next job waits, finishes too.
    let first = id_of(&client.submit(&jobs::endless_growth()).await).to_owned();
    let behind = id_of(&client.submit(&jobs::quick(1)).await).to_owned();
    in_step(&client, &first, "edmd").await;
    finish(&client, &first).await;
    client.finished(&behind).await;
    worker.signal(rustix::process::Signal::TERM);
    worker.ended().await;
    server.stop().await;
}

#[tokio::test]
async fn what_has_nothing_to_keep_is_refused_with_words() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    let running = id_of(&client.submit(&jobs::endless_growth()).await).to_owned();
    in_step(&client, &running, "edmd").await;
    let queued = id_of(&client.submit(&jobs::quick(1)).await).to_owned();
    let refused = async |id: &str, words: &str| {
        let problem =
            client.post(&format!("/v1/jobs/{id}/finish")).send().await.expect_problem(409, "conflict");
        assert!(problem["detail"].as_str().unwrap().contains(words), "{problem:#}");
    };
    refused(&queued, "it waits").await;
    client.post(&format!("/v1/jobs/{running}/cancel")).send().await.expect(202);
    client.finished(&running).await;
    refused(&running, "nothing was kept").await;
    client.finished(&queued).await;
    refused(&queued, "has its result").await;
    let unknown = client.post("/v1/jobs/01900000-0000-7000-8000-000000000000/finish").send().await;
    unknown.expect_problem(404, "not-found");
    server.stop().await;
}

#[tokio::test]
async fn limits_keep_what_is_reached_where_the_job_says_so() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let kept = jobs::with(dense_growth(), "/on_limit", json!("keep"));
    let done = client.succeed(&jobs::with(kept.clone(), "/timeout_s", json!(2))).await;
    assert_eq!(done["result"]["summary"]["partial"]["reason"], "timed_out", "{done:#}");
    let done = client.succeed(&jobs::with(kept, "/method/stop", json!({"events": 20_000}))).await;
    assert_eq!(done["result"]["summary"]["partial"]["reason"], "event_limit", "{done:#}");
    // Without, it fails, and says what can be done.
    let id = id_of(&client.submit(&jobs::with(dense_growth(), "/timeout_s", json!(1))).await).to_owned();
    let failed = client.finished(&id).await;
    assert_eq!(
        (&failed["error"]["type"], &failed["error"]["can_retry"]),
        (&json!("/problems/timed-out"), &json!(true))
    );
    assert_eq!(failed["error"]["changes"][0]["patch"], json!({"on_limit": "keep"}), "{failed:#}");
    let id = id_of(&client.submit(&jobs::unreachable()).await).to_owned();
    let failed = client.finished(&id).await;
    assert_eq!(failed["error"]["can_retry"], false, "a second run ends as the first: {failed:#}");
    // Each change that is offered succeeds.
    let request = client.request_of(&id).await;
    let changes = failed["error"]["changes"].as_array().unwrap();
    assert!(changes.len() >= 3, "to keep, to grow, a lower fraction: {failed:#}");
    for change in changes {
        let mut changed = request.clone();
        merge(&mut changed, &change["patch"]);
        client.succeed(&changed).await;
    }
    server.stop().await;
}

/// A JSON merge patch (RFC 7396).
fn merge(target: &mut Value, patch: &Value) {
    let Value::Object(members) = patch else {
        *target = patch.clone();
        return;
    };
    if !target.is_object() {
        *target = json!({});
    }
    for (name, value) in members {
        if value.is_null() {
            target.as_object_mut().unwrap().shift_remove(name);
        } else {
            merge(&mut target[name], value);
        }
    }
}

#[tokio::test]
async fn a_study_counts_partial_packings_apart() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let mut job = jobs::with(dense_growth(), "/on_limit", json!("keep"));
    job.as_object_mut().unwrap().shift_remove("seed");
    let job = jobs::with(job, "/method/stop", json!({"events": 20_000}));
    let study =
        json!({"template": job, "grid": {"/mix/volume_fraction": [0.2, 0.7]}, "replicates": 2, "seed": 1});
    let study = client.submit_study(&study).await;
    client.study_finished(id_of(&study)).await;
    let table = client.table(id_of(&study)).await;
    let figures = |row: &Value| [row["runs"].clone(), row["successes"].clone(), row["partial"].clone()];
    assert_eq!(figures(&table[0]), [json!(2), json!(2), json!(0)], "{table:#?}");
    assert_eq!(figures(&table[1]), [json!(2), json!(0), json!(2)], "{table:#?}");
    assert_eq!(
        (&table[0]["volume_fraction_reached_median"], &table[1]["success_rate"]),
        (&Value::Null, &json!(0.0))
    );
    let reached: Vec<f64> = client
        .jobs_of(id_of(&study))
        .await
        .iter()
        .filter_map(|job| job["result"]["summary"]["partial"]["volume_fraction_reached"].as_f64())
        .collect();
    assert_eq!(reached.len(), 2);
    let median = table[1]["volume_fraction_reached_median"].as_f64().unwrap();
    assert!((median - f64::midpoint(reached[0], reached[1])).abs() < 1e-12, "{median} {reached:?}");
    server.stop().await;
}
