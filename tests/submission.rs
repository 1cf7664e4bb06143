//! A job from its submission to its end, as most clients see it.

use serde_json::{Value, json};

use crate::harness::{DataDir, Server, id_of, jobs};

#[tokio::test]
async fn a_submitted_job_is_created_run_and_answered_with_its_result() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();

    let mut job = jobs::quick(7);
    job["name"] = json!("A16 cube");
    job["labels"] = json!({"series": "TB-7"});
    let reply = client.post("/v1/jobs").json(&job).send().await;
    let submitted = reply.expect(201).json();
    let id = id_of(&submitted);
    assert_eq!(reply.header("location"), format!("/v1/jobs/{id}"));
    assert_eq!(submitted["name"], "A16 cube");
    assert_eq!(submitted["labels"], json!({"series": "TB-7"}));
    assert_eq!(submitted["seed"], 7);

    let finished = client.finished(id).await;
    assert_eq!(finished["state"], "succeeded", "{finished:#}");
    assert_eq!(finished["attempt"], 1);
    assert_eq!(finished["progress"]["fraction"], 1.0);
    assert_eq!(finished["cancel_requested"], false);
    assert!(finished["error"].is_null());
    let moment = |name: &str| finished[name].as_str().unwrap_or_else(|| panic!("no {name}")).to_owned();
    // RFC 3339 in UTC with equal precision sorts as text.
    assert!(moment("created_at") <= moment("started_at") && moment("started_at") <= moment("finished_at"));

    let result = client.result(id).await;
    assert_eq!(result["job_id"], id);
    assert_eq!(result["request"]["seed"], 7);
    assert_eq!(result["summary"], finished["result"]["summary"]);
    assert_eq!(result["summary"]["grains"], result["grains"]["rows"].as_array().unwrap().len());
    let mut figures = result.clone();
    for rest in ["grains", "request"] {
        assert!(figures.as_object_mut().unwrap().remove(rest).is_some(), "{rest}");
    }
    let summary = client.get(&format!("/v1/jobs/{id}/result/summary")).send().await.expect(200).json();
    assert_eq!(summary, figures);

    // What may be long is not in every poll.
    assert_eq!(submitted["request"], result["request"]);
    assert!(finished.get("request").is_none());
    let asked = client.get(&format!("/v1/jobs/{id}?include=request")).send().await.expect(200).json();
    assert_eq!((&asked["request"], &client.request_of(id).await), (&result["request"], &result["request"]));
    let reply = client.get(&format!("/v1/jobs/{id}?include=spheres")).send().await;
    assert_eq!(reply.expect_problem(400, "validation-error")["errors"][0]["parameter"], "include");
    for link in ["self", "events", "result", "summary", "request", "exports"] {
        let link = finished["links"][link].as_str().unwrap();
        if !link.ends_with("/events") {
            client.get(link).send().await.expect(200);
        }
    }
    server.stop().await;
}

#[tokio::test]
async fn defaults_are_filled_in_and_the_drawn_seed_is_recorded() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();

    let mut job = jobs::quick(0);
    for field in ["seed", "distance"] {
        job.as_object_mut().unwrap().remove(field);
    }
    job["specimen"].as_object_mut().unwrap().remove("boundary");
    let (first, second) = (client.submit(&job).await, client.submit(&job).await);
    let request = &first["request"];
    assert_eq!(request["specimen"]["boundary"], "walls");
    assert_eq!(request["mix"]["volume_fraction_of"], "all_aggregate");
    assert_eq!(request["distance"]["type"], "none");
    assert_eq!(request["method"]["type"], "auto");
    assert_eq!(request["seed"], first["seed"]);
    assert_eq!(first["priority"], 0);
    assert_ne!(first["seed"], second["seed"], "two jobs drew the same seed of 2^53");

    // What a job reports as its request is a request: sent again, it is accepted and means the same.
    let again = client.submit(&packing_of(request)).await;
    assert_eq!(packing_of(&again["request"]), packing_of(request));
    server.stop().await;
}

/// The fields of a request that say what to pack.
fn packing_of(request: &Value) -> Value {
    let fields = ["seed", "specimen", "mix", "distance", "method"];
    fields
        .iter()
        .map(|field| ((*field).to_owned(), request[field].clone()))
        .collect::<serde_json::Map<_, _>>()
        .into()
}

#[tokio::test]
async fn a_packing_that_cannot_be_reached_is_an_answer_and_has_no_result() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();

    let submitted = client.submit(&jobs::unreachable()).await;
    let finished = client.finished(id_of(&submitted)).await;
    assert_eq!(finished["state"], "failed", "{finished:#}");
    let error = &finished["error"];
    assert!(error["type"].as_str().unwrap().ends_with("/target-not-reached"), "{error:#}");
    assert_eq!(finished["attempt"], 1, "an answer of the method is not tried again");
    let detail = error["detail"].as_str().unwrap();
    assert!(detail.contains("placed ") && detail.contains("attempts"), "{detail}");
    assert!(error["placed"].as_u64() < error["grains"].as_u64(), "{error:#}");
    assert!(error["attempts"].as_u64() >= Some(1000) && error["saturation_proven"] == false, "{error:#}");
    assert!(finished["result"].is_null());

    let path = format!("/v1/jobs/{}/result", id_of(&submitted));
    let problem = client.get(&path).send().await.expect_problem(409, "job-failed");
    assert!(problem["detail"].as_str().unwrap().contains("placed "), "{problem:#}");
    client.get(&format!("{path}/summary")).send().await.expect_problem(409, "job-failed");
    server.stop().await;
}

#[tokio::test]
async fn that_no_place_is_left_is_reported_as_proven() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();

    // Centres of 12 mm grains lie in a cube of 8 mm, whose diagonal of 13.9 mm has room for two of them.
    let job = json!({
        "seed": 3,
        "specimen": {"type": "box", "size_mm": [20, 20, 20]},
        "mix": {"grading": {"type": "diameters", "diameters_mm": [12, 12, 12]}},
        "method": {"type": "rsa"}
    });
    let submitted = client.submit(&job).await;
    let finished = client.finished(id_of(&submitted)).await;
    let detail = finished["error"]["detail"].as_str().unwrap_or_else(|| panic!("{finished:#}"));
    assert!(detail.contains("proven") && detail.contains("12"), "{detail}");
    server.stop().await;
}

#[tokio::test]
async fn a_result_is_not_there_before_the_job_has_ended() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();

    let submitted = client.submit(&jobs::endless()).await;
    let id = id_of(&submitted);
    client.running(id).await;
    let path = format!("/v1/jobs/{id}/result");
    client.get(&path).send().await.expect_problem(409, "result-not-ready");
    client.get(&format!("{path}/summary")).send().await.expect_problem(409, "result-not-ready");
    let job = client.get(&format!("/v1/jobs/{id}")).send().await;
    assert!(job.header("retry-after").parse::<u32>().unwrap() >= 1);
    assert!(job.json()["result"].is_null());

    for path in ["", "/result", "/result/summary", "/events"] {
        let unknown = format!("/v1/jobs/01900000-0000-7000-8000-000000000000{path}");
        client.get(&unknown).send().await.expect_problem(404, "not-found");
    }
    server.stop().await;
}
