//! The dashboard and the scaling of workers ask for metrics that the server has.

use std::collections::BTreeSet;
use std::fs;
use std::time::Duration;

use serde_json::Value;

use crate::harness::deadline::{eventually, patiently};
use crate::harness::{Client, DataDir, Launch, id_of, jobs};

const DASHBOARD: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docker/grafana/packstone.json");
const SCALING: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docker/kubernetes/keda/scaledobject.yaml");
/// What Prometheus adds to each series.
const OF_PROMETHEUS: &str = "instance";

/// The metrics that an expression reads, each with what stands in its braces.
fn metrics_in(expression: &str) -> Vec<(&str, &str)> {
    let mut found = Vec::new();
    let mut rest = expression;
    while let Some(start) = ["packstone_", "process_"].iter().filter_map(|prefix| rest.find(prefix)).min() {
        rest = &rest[start..];
        let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let (name, after) = rest.split_at(rest.find(|c| !is_name(c)).unwrap_or(rest.len()));
        let braces =
            after.strip_prefix('{').and_then(|inner| inner.split_once('}')).map_or("", |both| both.0);
        found.push((name, braces));
        rest = after;
    }
    found
}

/// The labels by which an expression groups.
fn grouped_by(expression: &str) -> Vec<&str> {
    expression
        .split(" by (")
        .skip(1)
        .flat_map(|rest| rest.split_once(')').expect("a closed list of labels").0.split(", "))
        .collect()
}

/// The labels of a legend, as `{{label}}`.
fn labels_in(legend: &str) -> Vec<&str> {
    legend.split("{{").skip(1).map(|rest| rest.split_once("}}").expect("a closed label").0).collect()
}

/// What of an expression no series of an answer of `/metrics` has.
fn missing(expression: &str, answer: &str) -> Vec<String> {
    let mut missing = Vec::new();
    let metrics = metrics_in(expression);
    if metrics.is_empty() {
        missing.push("any metric".to_owned());
    }
    let series_of = |name: &str| -> Vec<&str> {
        answer.lines().filter(|line| line.split(['{', ' ']).next() == Some(name)).collect()
    };
    for (name, braces) in &metrics {
        let series = series_of(name);
        if series.is_empty() {
            missing.push((*name).to_owned());
        }
        for matcher in braces.split(", ").filter(|matcher| !matcher.is_empty()) {
            let (label, value) = matcher.split_once('=').expect("a label and a value");
            let value = value.trim_start_matches('~').trim_matches('"');
            if label == OF_PROMETHEUS {
                continue;
            }
            // A pattern of names is each of them; other patterns need the label alone.
            let is_names = value.chars().all(|c| c.is_ascii_lowercase() || "_|".contains(c));
            let wanted: Vec<String> = if is_names {
                value.split('|').map(|name| format!("{label}=\"{name}\"")).collect()
            } else {
                vec![format!("{label}=\"")]
            };
            let absent = wanted.into_iter().filter(|text| !series.iter().any(|line| line.contains(text)));
            missing.extend(absent.map(|text| format!("{name} with {text}")));
        }
    }
    for label in grouped_by(expression) {
        let has = |name: &str| series_of(name).iter().any(|line| line.contains(&format!("{label}=\"")));
        missing.extend(
            metrics.iter().filter(|(name, _)| !has(name)).map(|(name, _)| format!("{name} by {label}")),
        );
    }
    missing
}

#[test]
fn what_no_answer_has_is_found() {
    let answer = "packstone_jobs{state=\"queued\"} 3\nprocess_open_fds 3\n\
                  packstone_x_bucket{type=\"a\",le=\"+Inf\"} 1\n";
    for (expression, lacks) in [
        ("sum(packstone_jobs{state=\"queued\", instance=~\"$instance\"})", vec![]),
        ("sum by (le, type) (rate(packstone_x_bucket[5m]))", vec![]),
        ("process_open_fds + packstone_jobs", vec![]),
        ("packstone_job", vec!["packstone_job"]),
        ("packstone_jobs{state=~\"queued|running\"}", vec!["packstone_jobs with state=\"running\""]),
        ("packstone_jobs{kind=~\"[ab].\"}", vec!["packstone_jobs with kind=\""]),
        ("sum by (route) (packstone_jobs)", vec!["packstone_jobs by route"]),
        ("up", vec!["any metric"]),
    ] {
        assert_eq!(missing(expression, answer), lacks, "{expression}");
    }
    assert_eq!(labels_in("{{a}} of {{b}}"), ["a", "b"]);
}

async fn metrics(client: &Client) -> String {
    String::from_utf8(client.get("/metrics").send().await.expect(200).body.to_vec()).unwrap()
}

/// A server that has done something of each kind, and its metrics.
async fn used_server(data_dir: &DataDir) -> String {
    let server = Launch::new(data_dir).env("PACKSTONE_CHECKPOINT_EVERY_S", "0").start().await;
    let client = server.client();
    let packed = client.succeed(&jobs::quick(1)).await;
    client.get(&format!("/v1/jobs/{}/exports/slice", id_of(&packed))).send().await.expect(200);
    client.get("/v1/jobs/none").send().await.expect_problem(404, "not-found");
    let growing = client.submit(&jobs::endless_growth()).await;
    client.running(id_of(&growing)).await;
    eventually("a checkpoint to be written", || !data_dir.checkpoints().is_empty()).await;
    // Ends are counted after they are answered.
    let answer = patiently("a job and an export to be counted", async {
        let mut look_again = tokio::time::interval(Duration::from_millis(20));
        loop {
            let answer = metrics(&client).await;
            let counted =
                |name: &str| answer.lines().any(|line| line.starts_with(&format!("{name}_count{{")));
            if counted("packstone_job_duration_seconds") && counted("packstone_export_duration_seconds") {
                return answer;
            }
            look_again.tick().await;
        }
    })
    .await;
    server.kill().await;
    answer
}

#[tokio::test]
async fn the_dashboard_shows_metrics_of_the_server() {
    let data_dir = DataDir::new();
    let answer = used_server(&data_dir).await;
    let dashboard: Value = serde_json::from_str(&fs::read_to_string(DASHBOARD).unwrap()).unwrap();
    let mut ids = BTreeSet::new();
    let mut expressions = Vec::new();
    for panel in dashboard["panels"].as_array().unwrap() {
        let title = panel["title"].as_str().unwrap();
        assert!(ids.insert(panel["id"].as_u64().unwrap()), "two panels have the id of {title:?}");
        if panel["type"] == "row" {
            continue;
        }
        let targets = panel["targets"].as_array().unwrap();
        assert!(!targets.is_empty(), "{title:?} shows nothing");
        for target in targets {
            assert_eq!(target["datasource"]["uid"], "${datasource}", "{title:?}");
            let (expression, legend) =
                (target["expr"].as_str().unwrap(), target["legendFormat"].as_str().unwrap());
            for label in labels_in(legend) {
                let has = label == OF_PROMETHEUS || grouped_by(expression).contains(&label);
                assert!(has, "{title:?}: the legend {legend:?} names what {expression} has not");
            }
            for (name, braces) in metrics_in(expression) {
                assert!(braces.contains("instance=~\"$instance\""), "{title:?}: {name} is of all servers");
            }
            expressions.push(expression);
        }
    }
    let variables = dashboard["templating"]["list"].as_array().unwrap();
    assert!(variables.iter().any(|variable| variable["name"] == "datasource"), "{variables:#?}");
    expressions.extend(variables.iter().filter_map(|variable| variable["definition"].as_str()));
    assert!(expressions.len() > 30, "{expressions:#?}");
    let missing: Vec<_> = expressions.iter().flat_map(|expression| missing(expression, &answer)).collect();
    assert_eq!(missing, Vec::<String>::new(), "in\n{answer}");
}

#[tokio::test]
async fn workers_are_scaled_by_metrics_of_the_server() {
    let data_dir = DataDir::new();
    let answer = used_server(&data_dir).await;
    let scaling = fs::read_to_string(SCALING).unwrap();
    let queries: Vec<&str> = scaling.lines().filter_map(|line| line.trim().strip_prefix("query: ")).collect();
    assert!(queries.iter().any(|query| query.contains("packstone_queue_work_seconds")), "{queries:?}");
    for query in queries {
        assert_eq!(missing(query, &answer), Vec::<String>::new(), "{query} in\n{answer}");
    }
}
