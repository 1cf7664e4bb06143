//! Bodies of a megabyte that are made to cost much: what they cost is bounded.

use serde_json::{Value, json};

use crate::harness::{DataDir, Server, jobs};

const BODY_BYTES: usize = 1 << 20;
const MAX_ANSWER_BYTES: usize = 200_000;
const MAX_MEMORY_BYTES: u64 = 50 << 20;

/// `open`, as many of `item` as fit, and `close`.
fn filled(open: &str, item: impl Fn(usize) -> String, close: &str) -> String {
    let mut body = String::from(open);
    for i in 0.. {
        let item = item(i);
        if body.len() + item.len() + 1 + close.len() > BODY_BYTES {
            break;
        }
        if i > 0 {
            body.push(',');
        }
        body.push_str(&item);
    }
    body.push_str(close);
    body
}

/// The text of a job or study with the value of `"HERE"` in place of its mark.
fn around(document: &Value, filling: impl Fn(&str, &str) -> String) -> String {
    let text = document.to_string();
    let (open, close) = text.split_once("\"HERE\"").expect("a mark");
    filling(open, close)
}

fn list_in(document: &Value, item: impl Fn(usize) -> String) -> String {
    around(document, |open, close| filled(&format!("{open}["), &item, &format!("]{close}")))
}

fn object_in(document: &Value, item: impl Fn(usize) -> String) -> String {
    around(document, |open, close| filled(&format!("{open}{{"), &item, &format!("}}{close}")))
}

/// Path, what it is, and the body.
fn hostile_bodies() -> Vec<(&'static str, &'static str, String)> {
    let key = |i: usize| format!("\"{i:x}\":1");
    let at = |pointer: &str| jobs::with(jobs::quick(1), pointer, json!("HERE"));
    let grading = |grading: Value| jobs::with(jobs::quick(1), "/mix/grading", grading);
    let study = |field: &str| json!({"template": jobs::quick(1), field: "HERE"});
    let tall = |open: &str| open.repeat(BODY_BYTES / open.len());
    vec![
        ("/v1/jobs", "unknown keys", filled("{", key, "}")),
        ("/v1/jobs", "unknown keys in the mix", object_in(&at("/mix"), key)),
        ("/v1/jobs", "labels", object_in(&at("/labels"), |i| format!("\"{i:x}\":\"a\""))),
        ("/v1/jobs", "postprocess", list_in(&at("/postprocess"), |_| "{\"type\":\"mesh\",\"x\":1}".into())),
        ("/v1/jobs", "options", object_in(&at("/postprocess"), key)),
        ("/v1/jobs", "numbers", list_in(&at("/seed"), |_| "0".into())),
        ("/v1/jobs", "arrays", list_in(&at("/seed"), |_| "[0]".into())),
        ("/v1/jobs", "empty arrays", list_in(&at("/seed"), |_| "[]".into())),
        ("/v1/jobs", "objects", list_in(&at("/seed"), |_| "{\"a\":0}".into())),
        ("/v1/jobs", "long key", format!("{{\"{}\":1}}", "\\u0001".repeat(BODY_BYTES / 6))),
        (
            "/v1/jobs",
            "long name",
            around(&at("/name"), |a, b| format!("{a}\"{}\"{b}", "x".repeat(BODY_BYTES))),
        ),
        ("/v1/jobs", "deep arrays", tall("[")),
        ("/v1/jobs", "deep objects", tall("{\"a\":")),
        (
            "/v1/jobs",
            "bad diameters",
            list_in(&grading(json!({"type": "diameters", "diameters_mm": "HERE"})), |_| "-1".into()),
        ),
        (
            "/v1/jobs",
            "sieves",
            list_in(&grading(json!({"type": "sieves", "points": "HERE"})), |i| format!("[{},0]", i + 1)),
        ),
        (
            "/v1/jobs",
            "classes",
            list_in(&grading(json!({"type": "classes", "classes": "HERE"})), |i| {
                format!("{{\"d_min_mm\":{},\"d_max_mm\":{},\"mass_fraction\":1e-9}}", i + 1, i + 2)
            }),
        ),
        ("/v1/studies", "unknown keys", filled("{", key, "}")),
        ("/v1/studies", "grid", object_in(&study("grid"), |i| format!("\"/{i:x}\":[1]"))),
        ("/v1/studies", "zip", object_in(&study("zip"), |i| format!("\"/{i:x}\":[1]"))),
        (
            "/v1/studies",
            "long pointer",
            around(&study("grid"), |a, b| format!("{a}{{\"{}\":[1]}}{b}", "/x".repeat(BODY_BYTES / 2))),
        ),
        (
            "/v1/studies",
            "values",
            list_in(&json!({"template": jobs::quick(1), "grid": {"/name": "HERE"}}), |i| i.to_string()),
        ),
        ("/v1/studies", "empty jobs", list_in(&json!({"list": "HERE"}), |_| "{}".into())),
        ("/v1/studies", "numbers for jobs", list_in(&json!({"list": "HERE"}), |_| "0".into())),
        (
            "/v1/studies",
            "faulty jobs",
            list_in(&json!({"list": "HERE"}), |i| {
                format!("{{\"mix\":{i},\"{i:0>90}\":1,\"labels\":{{\"\":1}}}}")
            }),
        ),
    ]
}

#[tokio::test]
async fn a_megabyte_of_anything_costs_little() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    // The first of each kind of request fills pools and buffers.
    client.post("/v1/jobs").text("{}").send().await.expect(422);
    client.post("/v1/studies").text("{}").send().await.expect(422);
    for (path, what, body) in hostile_bodies() {
        assert!(body.len() > BODY_BYTES - 200 && body.len() < BODY_BYTES + 1000, "{what}: {}", body.len());
        let before = server.reset_peak_bytes();
        let reply = client.post(path).text(body).send().await;
        let added = server.peak_bytes().saturating_sub(before);
        assert!(reply.status.is_client_error(), "{path}, {what}: {}", reply.status);
        assert!(reply.body.len() < MAX_ANSWER_BYTES, "{path}, {what}: {} bytes", reply.body.len());
        assert!(added < MAX_MEMORY_BYTES, "{path}, {what}: {} MB", added >> 20);
        let errors = reply.json()["errors"].as_array().map_or(0, Vec::len);
        assert!((1..=101).contains(&errors), "{path}, {what}: {errors} faults");
    }
    let query = "a&".repeat(10_000);
    let problem =
        client.get(&format!("/v1/jobs?{query}")).send().await.expect_problem(400, "validation-error");
    assert_eq!(problem["errors"].as_array().unwrap().len(), 101);
}
