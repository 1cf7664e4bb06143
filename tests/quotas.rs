//! Quotas of jobs and studies by one estimate, and jobs that say why they wait.

use serde_json::{Value, json};

use crate::harness::{DataDir, Launch, id_of, jobs};
use crate::users::Keys;

/// A study of so many packings of a job.
fn study(job: &Value, replicates: u32) -> Value {
    let mut template = job.clone();
    template.as_object_mut().unwrap().remove("seed");
    json!({"template": template, "replicates": replicates, "seed": 1})
}

#[tokio::test]
async fn a_study_is_refused_by_the_sum_of_what_its_jobs_would_be_refused_by() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(0).args(&["--max-stored-bytes", "1000000"]).start().await;
    let client = server.client();
    let refused = async |path: &str, body: &Value| {
        let reply = client.post(path).json(body).send().await;
        assert!(!reply.header("retry-after").is_empty());
        let problem = reply.expect_problem(507, "insufficient-storage");
        // Requests that were accepted count.
        let free_bytes = problem["free_bytes"].as_u64().unwrap();
        assert!((990_000..=1_000_000).contains(&free_bytes), "{problem}");
        problem["needed_bytes"].as_u64().unwrap()
    };
    let large = jobs::equal_spheres(70_000, 1);
    let of_one = refused("/v1/jobs", &large).await;
    assert_eq!(refused("/v1/studies", &study(&large, 20)).await, 20 * of_one);
    // Each of its jobs would fit, all of them do not.
    let small = jobs::equal_spheres(2000, 1);
    let of_one = refused("/v1/studies", &study(&small, 20)).await / 20;
    assert!((64_000..100_000).contains(&of_one), "{of_one}");
    // Exports that are kept count as they do for a job.
    let voxels = json!([{"type": "voxels", "format": "raw", "cells": 100}]);
    let with_voxels =
        refused("/v1/studies", &study(&jobs::with(small.clone(), "/postprocess", voxels), 1)).await;
    assert!((of_one + 1_000_000..of_one + 1_100_000).contains(&with_voxels), "{with_voxels}");
    client.submit_study(&study(&small, 10)).await;
    // Ellipsoids have twelve columns, spheres four.
    let ratios = json!({"type": "constant", "b_over_a": 0.8, "c_over_a": 0.6});
    let shape = json!({"type": "ellipsoid", "ratios": ratios});
    let ellipsoids = jobs::with(jobs::equal_spheres(40_000, 1), "/mix/shape", shape);
    let plan = client.post("/v1/plans").json(&ellipsoids).send().await.expect(200).json();
    let columns = refused("/v1/jobs", &ellipsoids).await as f64 / (8.0 * plan["grains"].as_f64().unwrap());
    assert!((12.0..12.5).contains(&columns), "{columns}");
    server.stop().await;
}

#[tokio::test]
async fn a_submission_that_is_repeated_needs_no_more_room() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--max-stored-bytes", "150000"]).start().await;
    let client = server.client();
    let job = jobs::equal_spheres(3000, 1);
    for (path, body) in [("/v1/jobs", job.clone()), ("/v1/studies", study(&job, 1))] {
        let submit = async || client.post(path).header("idempotency-key", "k").json(&body).send().await;
        let id = id_of(&submit().await.expect(201).json()).to_owned();
        if path == "/v1/jobs" {
            client.finished(&id).await;
        } else {
            client.study_finished(&id).await;
        }
        client.post(path).json(&body).send().await.expect_problem(507, "insufficient-storage");
        assert_eq!(id_of(&submit().await.expect(200).json()), id);
        client.delete(&format!("{path}/{id}")).send().await.expect(204);
    }
    server.stop().await;
}

#[tokio::test]
async fn a_job_without_room_for_its_result_says_so_until_there_is_room() {
    let data_dir = DataDir::new();
    let launch =
        |workers, quota| Launch::new(&data_dir).workers(workers).args(&["--max-stored-bytes", quota]);
    let server = launch(1, "1000000").start().await;
    let first = server.client().succeed(&jobs::equal_spheres(3000, 1)).await;
    server.stop().await;
    let server = launch(0, "1000000").start().await;
    let second = server.client().submit(&jobs::equal_spheres(3000, 2)).await;
    assert_eq!(second["waiting"], Value::Null, "it waits for a worker only");
    server.stop().await;
    // The quota is lowered while it waits.
    let server = launch(1, "150000").start().await;
    let client = server.client();
    let id = id_of(&second);
    let waiting = client.job_when(id, "without room", |job| job["waiting"].is_object()).await;
    assert_eq!((&waiting["state"], &waiting["waiting"]["for"]), (&json!("queued"), &json!("storage")));
    let detail = waiting["waiting"]["detail"].as_str().unwrap();
    assert!(detail.contains("no room") && detail.contains("150000"), "{detail}");
    assert!(waiting["waiting"]["until"].as_str() > waiting["updated_at"].as_str(), "{waiting:#}");
    let state = client.events(id, None).await.next().await.unwrap();
    assert_eq!((state.name.as_str(), &state.data["waiting"]), ("state", &waiting["waiting"]));
    let listed = client.get("/v1/jobs?state=queued").send().await.expect(200).json();
    assert_eq!(listed["items"][0]["waiting"], waiting["waiting"]);
    client.delete(&format!("/v1/jobs/{}", id_of(&first))).send().await.expect(204);
    let done = client.finished(id).await;
    assert_eq!((&done["state"], &done["waiting"]), (&json!("succeeded"), &Value::Null), "{done:#}");
    server.stop().await;
}

#[tokio::test]
async fn a_job_beyond_max_running_says_so() {
    let keys = Keys::make(&[(&["anna", "--role", "submit", "--max-running", "1"], "")]).await;
    let data_dir = DataDir::new();
    let server = keys.launch(&data_dir).workers(2).start().await;
    let client = keys.client(&server, "anna");
    let first = client.submit(&jobs::endless()).await;
    assert_eq!(client.running(id_of(&first)).await["waiting"], Value::Null);
    let second = client.submit(&jobs::endless()).await;
    let why = json!({
        "for": "running_quota", "detail": "as many jobs of its owner run as may: 1 of 1 (max_running)", "until": null
    });
    assert_eq!(second["waiting"], why);
    assert_eq!(client.job(id_of(&second)).await["waiting"], why);
    client.post(&format!("/v1/jobs/{}/cancel", id_of(&first))).send().await.expect(202);
    assert_eq!(client.running(id_of(&second)).await["waiting"], Value::Null);
    server.stop().await;
}
