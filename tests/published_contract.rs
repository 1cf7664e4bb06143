//! The document that clients are generated from: current, whole, and about what there is.

use serde_json::{Map, Value, json};

use crate::harness::{Contract, DataDir, Server, contract_text, id_of, jobs, packstone};

#[tokio::test]
async fn openapi_yaml_is_what_the_binary_prints_and_serves() {
    let directory = tempfile::tempdir().unwrap();
    let printed = packstone(directory.path(), &["openapi"]).await;
    assert_eq!(printed.code, Some(0), "{printed:?}");
    assert!(printed.stdout == contract_text(), "openapi.yaml is stale: cargo run -- openapi > openapi.yaml");

    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let served = server.client().get("/openapi.json").send().await.expect(200).json();
    assert!(served == *Contract::get().document(), "/openapi.json is another document");
    server.stop().await;
}

pub(crate) fn operations() -> Vec<(String, &'static Map<String, Value>)> {
    let methods = ["get", "head", "post", "put", "patch", "delete"];
    let paths = Contract::get().document()["paths"].as_object().unwrap();
    let mut found = Vec::new();
    for (path, item) in paths {
        for (method, operation) in item.as_object().unwrap() {
            if methods.contains(&method.as_str()) {
                found.push((format!("{method} {path}"), operation.as_object().unwrap()));
            }
        }
    }
    found
}

#[test]
fn every_route_of_this_version_is_in_it() {
    let known: Vec<String> = operations().into_iter().map(|(name, _)| name).collect();
    for operation in [
        "post /v1/jobs",
        "get /v1/jobs",
        "get /v1/jobs/{id}",
        "delete /v1/jobs/{id}",
        "post /v1/jobs/{id}/cancel",
        "post /v1/jobs/{id}/retry",
        "get /v1/jobs/{id}/events",
        "get /v1/jobs/{id}/result",
        "get /v1/jobs/{id}/result/summary",
        "get /v1/jobs/{id}/request",
        "post /v1/plans",
        "post /v1/mixes/read",
        "post /v1/mixes/blend",
        "post /v1/shapes",
        "get /v1/jobs/{id}/exports",
        "get /v1/jobs/{id}/exports/{type}",
        "post /v1/jobs/{id}/exports/{type}",
        "delete /v1/jobs/{id}/exports/{type}",
        "get /v1/jobs/{id}/exports/{type}/status",
        "get /v1/jobs/{id}/plots/{kind}",
        "post /v1/studies",
        "get /v1/studies",
        "get /v1/studies/{id}",
        "delete /v1/studies/{id}",
        "get /v1/studies/{id}/jobs",
        "get /v1/studies/{id}/table",
        "get /v1/studies/{id}/plots/{kind}",
        "post /v1/studies/{id}/cancel",
        "post /v1/studies/{id}/retry",
        "patch /v1/studies/{id}",
        "get /v1/events",
        "post /session",
        "delete /session",
        "get /v1/capabilities",
        "get /v1/key",
        "get /healthz",
        "get /readyz",
        "get /metrics",
    ] {
        assert!(known.iter().any(|name| name == operation), "{operation} is not among {known:#?}");
    }
}

#[test]
fn every_operation_says_what_it_is_and_how_it_fails() {
    let mut ids = Vec::new();
    for (name, operation) in operations() {
        for field in ["operationId", "summary"] {
            let said = operation.get(field).and_then(Value::as_str).unwrap_or_default();
            assert!(!said.is_empty(), "{name} has no {field}");
        }
        ids.push(operation["operationId"].as_str().unwrap());
        let responses = operation["responses"].as_object().unwrap();
        for (status, response) in responses {
            let described = response.get("description").and_then(Value::as_str).unwrap_or_default();
            assert!(
                !described.is_empty() || response.get("$ref").is_some(),
                "{name} {status} is not described"
            );
            let is_error = status.starts_with(['4', '5']);
            let Some(content) = response.get("content").and_then(Value::as_object) else { continue };
            if is_error {
                assert!(
                    content.contains_key("application/problem+json"),
                    "{name} {status} is no problem document"
                );
            }
        }
        if name.starts_with("post /v1") || name.contains("{id}") {
            assert!(responses.keys().any(|status| status.starts_with('4')), "{name} never fails?");
        }
    }
    let count = ids.len();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), count, "operation ids repeat");
}

/// Asks every route for a parameter that none has: the refusal names those that the route reads.
#[tokio::test]
async fn every_route_reads_the_parameters_that_it_is_documented_with() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let study = client.submit_study(&serde_json::json!({"list": [jobs::quick(2)]})).await;
    let mut asked = 0;
    for (name, operation) in operations() {
        let (method, path) = name.split_once(' ').unwrap();
        // Probes, metrics and the list of what there is read no query at all; options of exports are the engine's.
        if !path.starts_with("/v1/") || path.contains("/exports/{type}") {
            continue;
        }
        let id = if path.starts_with("/v1/studies") { id_of(&study) } else { id_of(&job) };
        let kind = if path.starts_with("/v1/studies") { "success" } else { "grading" };
        let path =
            path.replace("{id}", id).replace("{kind}", kind).replace("{task}", id).replace("{attempt}", "1");
        let parameters = operation.get("parameters").and_then(Value::as_array);
        let mut documented: Vec<&str> = parameters
            .into_iter()
            .flatten()
            .filter(|parameter| parameter["in"] == "query")
            .map(|parameter| parameter["name"].as_str().unwrap())
            .collect();
        let target = format!("{path}?zzz=1");
        let request = match method {
            "get" => client.get(&target),
            "post" => client.post(&target).text("{}"),
            "delete" => client.delete(&target),
            "patch" => client.request(reqwest::Method::PATCH, &target).text("{}"),
            "put" => client.request(reqwest::Method::PUT, &target).body(""),
            other => panic!("{other}: say here how it is sent"),
        };
        let problem = request.send().await.expect_problem(400, "validation-error");
        let details =
            problem["errors"].as_array().unwrap().iter().map(|error| error["detail"].as_str().unwrap());
        // One that must be given is missing, too.
        let mut listed = details.filter_map(|detail| Some(detail.split_once("this route has ")?.1));
        let listed = listed.next().unwrap_or_else(|| panic!("{name}: {problem:#}"));
        let mut read: Vec<&str> = listed.split(", ").filter(|listed| *listed != "none").collect();
        documented.sort_unstable();
        read.sort_unstable();
        assert_eq!(read, documented, "{name}");
        asked += 1;
    }
    assert!(asked > 20, "{asked} routes");
    server.stop().await;
}

/// The judge of all other tests: it takes an answer as documented and refuses one with a wrong type, format or field.
#[test]
fn answers_are_held_against_their_schemas() {
    let judge = |value: Value| Contract::get().judge_value("/components/schemas/Problem", &value);
    let problem =
        json!({"type": "/problems/x", "title": "Not found", "status": 404, "detail": "no such job"});
    judge(problem.clone()).unwrap();
    let wrong = [
        ("status", json!("404")),
        ("status", json!(200)),
        ("title", json!(null)),
        ("type", json!("no reference")),
        ("errors", json!([{"field": 1}])),
    ];
    for (field, wrong) in wrong {
        let mut changed = problem.clone();
        changed[field] = wrong;
        let why = judge(changed).expect_err(field);
        assert!(why.contains(field), "{field}: {why}");
    }
}

#[test]
fn jobs_are_listed_by_every_method_that_they_may_ask_for() {
    let document = Contract::get().document();
    let methods = document["components"]["schemas"]["Method"]["oneOf"].as_array().unwrap();
    let asked_for: Vec<_> = methods.iter().map(|method| &method["properties"]["type"]["enum"][0]).collect();
    let parameters = document["paths"]["/v1/jobs"]["get"]["parameters"].as_array().unwrap();
    let filter = parameters.iter().find(|parameter| parameter["name"] == "method").unwrap();
    let listed: Vec<_> = filter["schema"]["enum"].as_array().unwrap().iter().collect();
    assert_eq!(listed, asked_for);
}
