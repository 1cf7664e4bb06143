//! What a mix amounts to before it is packed, and what this server can do.

use serde_json::json;

use crate::harness::{DataDir, Server, jobs};

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
