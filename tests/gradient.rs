//! Gradients and mixes by content, as a client asks for them and finds them in plan, result and study.

use std::f64::consts::FRAC_PI_6;

use serde_json::{Value, json};

use crate::harness::{DataDir, Launch, Server, id_of, jobs, results};

fn sinking(job: Value, strength: f64) -> Value {
    let field = json!({"type": "linear", "axis": "z"});
    jobs::with(job, "/segregation", json!({"type": "gradient", "field": field, "strength": strength}))
}

/// Mean over a third of the mass of where its grains lie between the walls, coarsest grains first, counted from the
/// lower end: by hand, from rows alone.
fn mean_of_third(rows: &results::Rows, height_mm: f64, wall_gap_mm: f64, third: usize) -> f64 {
    let mut rows = rows.clone();
    rows.sort_by(|a, b| b[3].total_cmp(&a[3]));
    let volume = |row: &[f64; 4]| FRAC_PI_6 * row[3].powi(3);
    let all: f64 = rows.iter().map(volume).sum();
    let (low, high) = (third as f64 / 3.0, (third as f64 + 1.0) / 3.0);
    let (mut from, mut sum) = (0.0, 0.0);
    for row in &rows {
        let to = from + volume(row) / all;
        let gap = row[3] / 2.0 + wall_gap_mm;
        sum += 3.0 * (to.min(high) - from.max(low)).max(0.0) * (row[2] - gap) / (height_mm - 2.0 * gap);
        from = to;
    }
    sum
}

#[tokio::test]
async fn a_gradient_is_in_the_result_and_its_figures_are_true() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    for method in [json!({"type": "rsa"}), json!({"type": "edmd"}), json!({"type": "auto"})] {
        let job = jobs::with(jobs::quick(3), "/method", method);
        let finished = client.succeed(&sinking(job, 100.0)).await;
        let request = client.request_of(id_of(&finished)).await;
        assert_eq!(request["segregation"]["field"]["direction"], "down", "the default is filled in");
        let result = client.result(id_of(&finished)).await;
        let found = &result["segregation"];
        let along = &found["along"];
        assert!(along["difference"].as_f64().unwrap() > 0.2, "{found:#}");
        assert_eq!(along["p_value"], 0.001, "the smallest of 999 permutations: {found:#}");
        assert_eq!(found["across"].as_object().unwrap().len(), 2, "{found:#}");
        // Half of 0.2 mm is kept from the walls. The field rises downwards.
        let rows = results::from_json(&result);
        for (name, third) in [("coarsest_third", 0), ("finest_third", 2)] {
            let by_hand = 1.0 - mean_of_third(&rows, 40.0, 0.1, third);
            assert!((along[name].as_f64().unwrap() - by_hand).abs() < 1e-9, "{name}: {by_hand} {found:#}");
        }
    }
    // None is asked for: none is told of, and none is in what was asked.
    let random = client.succeed(&jobs::quick(3)).await;
    assert_eq!(client.request_of(id_of(&random)).await.get("segregation"), None);
    let result = client.result(id_of(&random)).await;
    assert_eq!(result.get("segregation"), None);
    // Nor does one without strength move a grain.
    let weak = client.succeed(&sinking(jobs::quick(3), 0.0)).await;
    let weak = client.result(id_of(&weak)).await;
    assert_eq!(weak["grains"], result["grains"]);
    assert!(weak["segregation"]["along"]["p_value"].as_f64().unwrap() > 0.05, "{:#}", weak["segregation"]);
    server.stop().await;
}

#[tokio::test]
async fn a_plan_says_that_it_does_not_know_gradients() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = sinking(jobs::quick(1), 10.0);
    let plan = client.post("/v1/plans").json(&job).send().await.expect(200).json();
    let beyond = plan["extrapolations"].as_array().unwrap();
    assert!(beyond.iter().any(|text| text.as_str().unwrap().contains("gradient")), "{plan:#}");
    server.stop().await;
}

#[tokio::test]
async fn the_content_of_a_cubic_metre_is_a_volume_fraction() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let mix = json!({
        "grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": 4,
        "proportions": {"cement_kg_m3": 320, "water_cement": 0.5},
    });
    let job = jobs::with(jobs::quick(1), "/mix", mix);
    let aggregate = 1.0 - 320.0 / 3150.0 - 0.16 - 0.03;
    let plan = client.post("/v1/plans").json(&job).send().await.expect(200).json();
    assert!((plan["volume_fraction_mixture"].as_f64().unwrap() - aggregate).abs() < 1e-12, "{plan:#}");
    assert!(
        (plan["volume_fraction_effective"].as_f64().unwrap() - aggregate / 2.0).abs() < 1e-12,
        "{plan:#}"
    );
    let finished = client.succeed(&job).await;
    let request = client.request_of(id_of(&finished)).await;
    let content = &request["mix"]["proportions"];
    assert_eq!((&content["air"], &content["cement_density_kg_m3"]), (&json!(0.03), &json!(3150.0)));
    let summary = client.result(id_of(&finished)).await["summary"].clone();
    assert!((summary["volume_fraction_mixture"].as_f64().unwrap() - aggregate).abs() < 1e-12, "{summary:#}");
    // What a plan refuses is told at the content.
    let rich = jobs::with(job, "/mix/proportions/cement_kg_m3", json!(900));
    let rich = jobs::with(rich, "/mix/proportions/water_cement", json!(0.8));
    let problem = client.post("/v1/jobs").json(&rich).send().await.expect_problem(422, "validation-error");
    assert_eq!(problem["errors"][0]["pointer"], "/mix/proportions");
    let detail = problem["errors"][0]["detail"].as_str().unwrap();
    assert!(detail.contains("the terms sum to 1.0357"), "{detail}");
    server.stop().await;
}

#[tokio::test]
async fn both_are_columns_of_a_study() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    let mut template = sinking(jobs::quick(1), 0.0);
    template["mix"] = json!({
        "grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4,
        "proportions": {"cement_kg_m3": 320, "water_cement": 0.5},
    });
    template.as_object_mut().unwrap().remove("seed");
    let study = json!({
        "seed": 1, "template": template, "replicates": 2,
        "grid": {"/segregation/strength": [0, 30], "/mix/proportions/water_cement": {"from": 0.5, "to": 0.6, "step": 0.1}},
    });
    let finished = client.submit_study(&study).await;
    let finished = client.study_finished(id_of(&finished)).await;
    assert_eq!(finished["counts"]["succeeded"], 8, "{finished:#}");
    let rows = client.table(id_of(&finished)).await;
    let keys: Vec<[f64; 2]> = rows
        .iter()
        .map(|row| {
            ["/segregation/strength", "/mix/proportions/water_cement"]
                .map(|column| row[column].as_f64().unwrap())
        })
        .collect();
    assert_eq!(keys, [[0.0, 0.5], [0.0, 0.6], [30.0, 0.5], [30.0, 0.6]]);
    // More water leaves less aggregate.
    assert!(rows[0]["grains"].as_f64() > rows[1]["grains"].as_f64(), "{rows:#?}");
    server.stop().await;
}
