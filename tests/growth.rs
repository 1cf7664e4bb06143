//! Event-driven molecular dynamics as a client sees it: jobs that grow, how they go, and how they end.

use serde_json::{Value, json};

use crate::harness::{DataDir, Launch, Server, id_of, jobs};

#[tokio::test]
async fn the_job_of_the_contract_succeeds() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::contract()).await;
    let result = client.result(id_of(&job)).await;
    let number = |pointer: &str| {
        let value = result.pointer(pointer).and_then(Value::as_f64);
        value.unwrap_or_else(|| panic!("no number at {pointer}: {:#}", result["statistics"]))
    };
    assert!(number("/summary/grains") > 4500.0);
    assert!((number("/summary/volume_fraction_mixture") - 0.535).abs() < 1e-12);
    assert_eq!(number("/summary/distance_mm"), 1.0);
    assert!(number("/check/min_gap_mm") >= 1.0);
    assert!(number("/check/min_wall_gap_mm") >= 0.5);
    assert_eq!(result["statistics"]["edmd"]["stop"], "target");
    assert!(number("/statistics/edmd/grain_collisions") > 1000.0);
    assert!(number("/statistics/edmd/wall_collisions") > 100.0);
    assert!(number("/statistics/edmd/growth_scale") >= 1.0);
    assert!(number("/timings_s/edmd") > 0.0);
    assert_eq!(result["statistics"]["edmd"]["resumes"], 0);
    server.stop().await;
}

#[tokio::test]
async fn progress_tells_of_the_growth_and_never_falls() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let id = id_of(&client.submit(&jobs::endless_growth()).await).to_owned();
    let mut stream = client.events(&id, None).await;
    let mut progress = Vec::new();
    while progress.iter().filter(|p: &&Value| p["step"] == "edmd").count() < 4 {
        let event = stream.next().await.expect("an endless job goes on");
        if event.name == "progress" {
            progress.push(event.data);
        }
    }
    client.post(&format!("/v1/jobs/{id}/cancel")).send().await.expect(202);
    client.finished(&id).await;
    let fractions: Vec<f64> = progress.iter().map(|p| p["fraction"].as_f64().unwrap()).collect();
    assert!(fractions.is_sorted(), "{fractions:?}");
    let (growing, others): (Vec<&Value>, Vec<&Value>) = progress.iter().partition(|p| p["step"] == "edmd");
    assert!(others.iter().all(|p| p.get("growth").is_none()), "{others:#?}");
    let column = |field: &str| {
        let of = |p: &&Value| p["growth"][field].as_f64().unwrap_or_else(|| panic!("no {field} in {p:#}"));
        growing.iter().map(of).collect::<Vec<f64>>()
    };
    for field in ["distance_mm", "events"] {
        assert!(column(field).is_sorted(), "{field}: {:?}", column(field));
    }
    assert!(column("events")[0] < column("events")[3], "{:?}", column("events"));
    assert!(column("events_per_s")[3] > 0.0);
    assert!(column("volume_fraction").iter().all(|phi| (0.1..1.0).contains(phi)));
    server.stop().await;
}

#[tokio::test]
async fn the_largest_distance_that_was_reached_in_time_is_a_success() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = jobs::with(jobs::contract(), "/distance", json!({"type": "maximize"}));
    let job = jobs::with(job, "/method/stop", json!({"time_s": 2, "stall_dt_s": 1e-300}));
    let job = client.succeed(&job).await;
    let result = client.result(id_of(&job)).await;
    let reached =
        result["summary"]["distance_mm"].as_f64().unwrap_or_else(|| panic!("{:#}", result["summary"]));
    assert!(reached > 0.0, "{reached} mm");
    assert_eq!(result["statistics"]["edmd"]["stop"], "time_limit");
    assert!(result["check"]["min_gap_mm"].as_f64() >= Some(reached));
    assert!(result["check"]["min_wall_gap_mm"].as_f64() >= Some(reached / 2.0));
    let points = result["growth_curve"].as_array().unwrap();
    let curve: Vec<[f64; 2]> = points
        .iter()
        .map(|point| [point["packing_time_s"].as_f64().unwrap(), point["distance_mm"].as_f64().unwrap()])
        .collect();
    assert!(curve.len() >= 2, "{curve:?}");
    assert!(curve.windows(2).all(|pair| pair[0][0] <= pair[1][0] && pair[0][1] <= pair[1][1]), "{curve:?}");
    assert!((curve.last().unwrap()[1] - reached).abs() < 1e-6 * reached, "{curve:?} ends not at {reached}");
    server.stop().await;
}

#[tokio::test]
async fn a_target_beyond_reach_fails_and_says_how_far_it_came() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = jobs::with(jobs::contract(), "/method/stop", json!({"events": 20_000}));
    let job = client.finished(id_of(&client.submit(&job).await)).await;
    assert_eq!(job["state"], "failed", "{job:#}");
    let error = &job["error"];
    assert_eq!(error["type"], "/problems/target-not-reached", "{error:#}");
    assert_eq!(error["end"], "event_limit", "{error:#}");
    let number = |field: &str| error[field].as_f64().unwrap_or_else(|| panic!("no {field} in {error:#}"));
    assert!(number("scale_reached") > 0.5 && number("scale_reached") < 1.0, "{error:#}");
    assert!(number("volume_fraction_reached") < number("volume_fraction_asked"), "{error:#}");
    assert!(number("distance_mm_reached") < number("distance_mm_asked"), "{error:#}");
    assert!(number("events") >= 20_000.0, "{error:#}");
    let detail = error["detail"].as_str().unwrap();
    for says in ["growth stopped at 0.", "of 1.0000 mm", "stop.events"] {
        assert!(detail.contains(says), "{says:?} is not in {detail:?}");
    }
    server.stop().await;
}

#[tokio::test]
async fn a_growing_job_that_would_not_end_is_cancelled() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let id = id_of(&client.submit(&jobs::endless_growth()).await).to_owned();
    client.job_when(&id, "growing", |job| job["progress"]["step"] == "edmd").await;
    client.post(&format!("/v1/jobs/{id}/cancel")).send().await.expect(202);
    assert_eq!(client.finished(&id).await["state"], "cancelled");
    server.stop().await;
}

#[tokio::test]
async fn the_packing_is_the_same_whatever_the_number_of_workers() {
    let mut packings = Vec::new();
    for workers in [1, 2] {
        let data_dir = DataDir::new();
        let server = Launch::new(&data_dir).workers(workers).start().await;
        let client = server.client();
        let mut ids = Vec::new();
        for seed in 1..=4 {
            ids.push(id_of(&client.submit(&jobs::quick_growth(seed)).await).to_owned());
        }
        for id in &ids {
            assert_eq!(client.finished(id).await["state"], "succeeded");
            packings.push(client.result_in(id, "npy").await);
        }
        server.stop().await;
    }
    let (one, two) = packings.split_at(4);
    assert!(one == two);
    assert!(one[0] != one[1], "another seed is another packing");
}
