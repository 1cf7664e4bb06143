//! What a mix amounts to before it is packed, and what this server can do.

use std::time::{Duration, Instant};

use futures_util::future::join_all;
use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Launch, Server, id_of, jobs};

#[tokio::test]
async fn a_plan_counts_and_stores_nothing() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    // Counts in closed form for a 150 mm cube at 0.70 (docs/method.md, section 1).
    for (curve, d_min, grains, effective) in
        [("A16", 2.0, 44_202.0, 0.553), ("B16", 2.0, 40_049.0, 0.406), ("B16", 0.5, 2_053_000.0, 0.56)]
    {
        let job = json!({
            "specimen": {"type": "box", "size_mm": [150, 150, 150]},
            "mix": {"grading": {"type": "standard", "name": curve}, "d_min_mm": d_min, "volume_fraction": 0.70}
        });
        let plan = client.post("/v1/plans").json(&job).send().await.expect(200).json();
        let expected = plan["grains"].as_f64().unwrap();
        assert!((expected - grains).abs() < 1.0e-3 * grains, "{curve} from {d_min} mm: {expected} grains");
        assert!((plan["volume_fraction_effective"].as_f64().unwrap() - effective).abs() < 1.0e-9, "{plan:#}");
        assert!((plan["volume_fraction_mixture"].as_f64().unwrap() - 0.70).abs() < 1.0e-9, "{plan:#}");
        // A grain has at least three coordinates and a diameter.
        assert!(plan["memory_bytes"].as_f64().unwrap() > 32.0 * grains);
        let by_class: f64 =
            plan["classes"].as_array().unwrap().iter().map(|c| c["grains"].as_f64().unwrap()).sum();
        assert!((by_class - expected).abs() < 1.0e-6 * expected);
        // All three fit; more of each would too.
        assert!(plan["success_probability"].as_f64().unwrap() > 0.9, "{plan:#}");
        assert!(plan["estimated_time_s"].as_f64().unwrap() > 0.0);
        assert!(plan["proposal"]["volume_fraction"].as_f64().unwrap() > 0.70, "{plan:#}");
        assert!(plan["proposal"]["distance_mm"].as_f64().unwrap() > 0.1, "{plan:#}");
    }
    let listed = client.get("/v1/jobs").send().await.json();
    assert_eq!(listed["items"], json!([]));
    server.stop().await;
}

#[tokio::test]
async fn a_plan_refuses_what_a_submission_refuses() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    for (pointer, value) in [
        ("/mix/volume_fraction", json!(1.5)),
        ("/distance/gap_mm", json!(5)),
        ("/mix/d_min_mm", json!(1.0e-3)),
        ("/specimen/size_mm", json!([10, 40, 40])),
        ("/priority", json!(1000)),
    ] {
        let job = jobs::with(jobs::quick(1), pointer, value.clone());
        let dry = client.post("/v1/plans").json(&job).send().await;
        let real = client.post("/v1/jobs").json(&job).send().await;
        let [dry, real] = [&dry, &real].map(|reply| {
            let mut problem = reply.expect(422).json();
            problem.as_object_mut().unwrap().remove("instance");
            problem
        });
        assert_eq!(dry, real, "{pointer} {value}");
    }
    // The parameter of earlier versions must not submit what was to be planned.
    let reply = client.post("/v1/jobs?dry_run=true").json(&jobs::quick(1)).send().await;
    let problem = reply.expect_problem(400, "validation-error");
    assert_eq!(problem["errors"][0]["parameter"], "dry_run");
    server.stop().await;
}

#[tokio::test]
async fn capabilities_tell_what_can_be_asked_for() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let capabilities = client.get("/v1/capabilities").send().await.expect(200).json();
    let text = capabilities.to_string();
    for word in [
        "A16",
        "C32",
        "fuller",
        "sieves",
        "cylinder",
        "smaller_diameter",
        "maximize",
        "rsa",
        "edmd",
        "monte_carlo",
        "ellipsoid",
        "vtp",
        "npy",
        "20000000",
        "max_study_jobs",
    ] {
        assert!(text.contains(word), "{word} is not among the capabilities: {capabilities:#}");
    }
    server.stop().await;
}

/// A mix of four aggregates with 32 templates of 60 faces each, which take the longest to draw and to measure.
fn costly(template_seed: u64) -> Value {
    let aggregate = |number: u64| {
        json!({"share": 0.25, "grading": {"type": "standard", "name": "A16"},
            "shape": {"type": "polyhedron", "faces": 60, "template_seed": 4 * template_seed + number}})
    };
    json!({
        "specimen": {"type": "box", "size_mm": [100, 100, 100]},
        "mix": {"aggregates": [aggregate(0), aggregate(1), aggregate(2), aggregate(3)], "d_min_mm": 8,
            "volume_fraction": 0.3},
    })
}

#[tokio::test]
async fn plans_of_polyhedra_hold_up_no_other_answer() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let begun = Instant::now();
    let ask = |seed: u64| {
        let client = server.client();
        async move {
            // Half of them as submissions.
            let path = if seed.is_multiple_of(2) { "/v1/plans" } else { "/v1/jobs" };
            let reply = client.post(path).json(&costly(seed)).timeout(Duration::from_mins(2)).send().await;
            assert!([200, 201, 503].contains(&reply.status.as_u16()), "{path}: {}", reply.status);
            begun.elapsed()
        }
    };
    let plans = tokio::spawn(join_all((0..16).map(ask)));
    let client = server.client();
    let mut answers = Vec::new();
    while !plans.is_finished() {
        let asked = Instant::now();
        client.get("/healthz").send().await.expect(200);
        answers.push(asked.elapsed());
    }
    // Relative to the plans, so that a slow machine makes no difference: on a quiet one they take 5 s. An answer that
    // waits for plans takes as long as one of them, and then there are about as many answers as plans.
    let all = plans.await.unwrap().into_iter().max().unwrap();
    answers.sort_unstable();
    let most = answers[answers.len() * 9 / 10];
    assert!(answers.len() > 80, "{} answers while all plans took {all:?}", answers.len());
    assert!(16 * most < all, "nine of ten answers took up to {most:?} while all plans took {all:?}");
    server.stop().await;
}

#[tokio::test]
async fn a_study_of_one_mix_of_polyhedra_draws_its_templates_once() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    let study = |template_seed: u64, points: u64| {
        let values: Vec<f64> = (0..points).map(|i| 0.1 + 0.001 * i as f64).collect();
        json!({"template": costly(template_seed), "grid": {"/mix/volume_fraction": values}})
    };
    let took = async |study: Value| {
        let submitted = Instant::now();
        let study = client.submit_study(&study).await;
        let took = submitted.elapsed();
        let cancelled = client.post(&format!("/v1/studies/{}/cancel", id_of(&study))).send().await;
        assert!(cancelled.status.is_success(), "{}", cancelled.status);
        took
    };
    let one = took(study(1, 2)).await;
    let many = took(study(2, 200)).await;
    assert!(many < 15 * one, "200 points take {many:?}, 2 points {one:?}");
    server.stop().await;
}

/// Each server measures its processor for itself, and beside other work by another step of the speed.
fn without_times(plan: &[u8]) -> Value {
    let mut plan: Value = serde_json::from_slice(plan).unwrap();
    plan["estimated_time_s"].take();
    for method in plan["methods"].as_object_mut().unwrap().values_mut() {
        method["estimated_time_s"].take();
    }
    plan
}

#[tokio::test]
async fn a_plan_is_the_same_whether_or_not_it_was_made_before() {
    let (data_dir, other_dir) = (DataDir::new(), DataDir::new());
    let server = Server::start(&data_dir).await;
    let other = Server::start(&other_dir).await;
    let export = json!([{"type": "mesh", "format": "stl"}, {"type": "shapes"}]);
    for job in [costly(3), jobs::with(costly(3), "/postprocess", export), jobs::quick(1)] {
        let (client, of_other) = (server.client(), other.client());
        let plan =
            async |client: &Client| client.post("/v1/plans").json(&job).send().await.expect(200).body.clone();
        let first = plan(&client).await;
        assert_eq!(first, plan(&client).await);
        assert_eq!(without_times(&first), without_times(&plan(&of_other).await));
    }
    server.stop().await;
    other.stop().await;
}
