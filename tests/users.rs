//! Many users of one server: what each key may see and do.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use reqwest::Method;
use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Launch, Reply, Server, id_of, jobs, packstone, run};
use crate::published_contract::operations;

/// A file of keys, and the keys by name.
pub(crate) struct Keys {
    _folder: tempfile::TempDir,
    pub(crate) file: PathBuf,
    pub(crate) by_name: Vec<(String, String)>,
}

impl Keys {
    /// Makes keys as `packstone key` does, each from its arguments; `more` is appended to the line.
    pub(crate) async fn make(of: &[(&[&str], &str)]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (mut lines, mut keys) = (String::new(), Vec::new());
        for (args, more) in of {
            let mut command = vec!["key"];
            command.extend_from_slice(args);
            let made = packstone(folder.path(), &command).await;
            assert_eq!(made.code, Some(0), "{made:?}");
            let mut printed = made.stdout.lines();
            keys.push((args[0].to_owned(), printed.next().unwrap().to_owned()));
            writeln!(lines, "{} {more}", printed.next().unwrap()).unwrap();
        }
        let file = folder.path().join("keys");
        fs::write(&file, lines).unwrap();
        Self { _folder: folder, file, by_name: keys }
    }

    pub(crate) fn launch(&self, data_dir: &DataDir) -> Launch {
        Launch::new(data_dir).env("PACKSTONE_API_KEYS_FILE", self.file.to_str().unwrap())
    }

    pub(crate) fn client(&self, server: &Server, name: &str) -> Client {
        let key = self.by_name.iter().find(|(known, _)| known == name).unwrap();
        server.client().with_key(&key.1)
    }
}

/// An administrator, two keys of a laboratory, another user, and a key for the metrics.
pub(crate) async fn laboratory() -> Keys {
    Keys::make(&[
        (&["root", "--role", "admin"], ""),
        (&["anna", "--role", "submit", "--owner", "lab"], ""),
        (&["bert", "--role", "read", "--owner", "lab"], ""),
        (&["carl", "--role", "submit"], ""),
        (&["gauge", "--role", "metrics"], ""),
    ])
    .await
}

/// Routes that compute an answer from a body and store nothing.
const COMPUTING: [&str; 4] = ["/v1/plans", "/v1/mixes/read", "/v1/mixes/blend", "/v1/shapes"];

fn send(client: &Client, method: &str, target: &str) -> crate::harness::Request {
    let request = client.request(Method::from_bytes(method.to_uppercase().as_bytes()).unwrap(), target);
    match method {
        "patch" => request.text("{}"),
        "post" if !target.contains("/exports/") => request.text("{}"),
        _ => request,
    }
}

fn detail(problem: &Value) -> &str {
    problem["detail"].as_str().unwrap()
}

/// The walk over the published document: a route that is added is walked without a word here.
#[tokio::test]
async fn every_route_refuses_a_foreign_id_and_a_key_without_the_right() {
    let keys = laboratory().await;
    let data_dir = DataDir::new();
    let server = keys.launch(&data_dir).start().await;
    let [root, anna, bert, carl, gauge] =
        ["root", "anna", "bert", "carl", "gauge"].map(|name| keys.client(&server, name));
    let job = anna.succeed(&jobs::quick(1)).await;
    let study = anna.submit_study(&json!({"list": [jobs::quick(2)]})).await;
    let study = anna.study_finished(id_of(&study)).await;
    let before = anna.job(id_of(&job)).await;
    let (mut named, mut changing, mut service, mut asked) = (0, 0, 0, 0);
    for (name, _) in operations() {
        let (method, template) = name.split_once(' ').unwrap();
        let of_study = template.starts_with("/v1/studies");
        let with = |id: &str| {
            let kind = if of_study { "success" } else { "grading" };
            // A slice needs no script.
            let export = if template.ends_with("/script") { "mesh" } else { "slice" };
            template.replace("{id}", id).replace("{type}", export).replace("{kind}", kind)
        };
        let for_workers = template.starts_with("/v1/leases");
        if for_workers || template.starts_with("/v1/workers") {
            // For workers or administrators alone, whoever the owner of the job is.
            let role = if for_workers { "`worker`" } else { "`admin`" };
            let target = template.replace("{task}", id_of(&job)).replace("{attempt}", "1");
            for client in [&anna, &bert, &carl, &gauge] {
                let problem = send(client, method, &target).send().await.expect_problem(403, "forbidden");
                assert!(detail(&problem).contains(role), "{problem}");
            }
            assert_ne!(send(&root, method, &target).send().await.status, 403, "{name}");
            service += 1;
            continue;
        }
        if template == "/session" {
            // Open to all: tests/sessions.rs.
            continue;
        }
        let changes = method != "get" && !COMPUTING.contains(&template);
        if template.contains("{id}") {
            let own = if of_study { id_of(&study) } else { id_of(&job) };
            let none = "01900000-0000-7000-8000-000000000000";
            // Whatever else is wrong with the request, nothing tells an ID of others from one that nobody has.
            for query in ["", "?zzz=1"] {
                let answer = async |id: &str| {
                    let reply: Reply = send(&carl, method, &(with(id) + query)).send().await;
                    let problem = reply.expect_problem(404, "not-found");
                    (detail(&problem).replace(id, "ID"), reply.headers.len())
                };
                assert_eq!(answer(own).await, answer(none).await, "{name}{query}");
            }
            let escaped = format!("{}%{:02x}", &own[..35], own.as_bytes()[35]);
            send(&carl, method, &with(&escaped)).send().await.expect_problem(404, "not-found");
            if !changes {
                let reply = send(&bert, method, &with(own)).send().await;
                let status = reply.status.as_u16();
                assert!(status < 400 || template.ends_with("/status"), "{name}: {status}");
                let other = send(&root, method, &with(own)).send().await;
                assert_eq!(other.status, reply.status, "{name}");
            }
            named += 1;
        }
        if changes {
            let own = if of_study { id_of(&study) } else { id_of(&job) };
            let problem = send(&bert, method, &with(own)).send().await.expect_problem(403, "forbidden");
            assert!(
                detail(&problem).contains("`read`") && detail(&problem).contains("`submit`"),
                "{problem}"
            );
            changing += 1;
        }
        if template == "/metrics" {
            let problem = send(&carl, method, template).send().await.expect_problem(403, "forbidden");
            assert!(detail(&problem).contains("`metrics`"), "{problem}");
            send(&root, method, template).send().await.expect(200);
            send(&gauge, method, template).send().await.expect(200);
            service += 1;
        } else if template.contains("{id}")
            || changes
            || ["/v1/jobs", "/v1/studies", "/v1/events"].contains(&template)
            || COMPUTING.contains(&template)
        {
            let own = if of_study { id_of(&study) } else { id_of(&job) };
            let problem = send(&gauge, method, &with(own)).send().await.expect_problem(403, "forbidden");
            assert!(detail(&problem).contains("`metrics`"), "{problem}");
        } else {
            // What every key may ask.
            assert_ne!(send(&gauge, method, &with("none")).send().await.status, 403, "{name}");
            asked += 1;
        }
    }
    assert!(named > 20 && changing > 8 && service == 11 && asked > 3, "{named} {changing} {service} {asked}");
    let after = anna.job(id_of(&job)).await;
    assert_eq!(
        (after["state"].clone(), after["labels"].clone()),
        (before["state"].clone(), before["labels"].clone())
    );
    carl.get("/v1/nowhere").send().await.expect_problem(404, "not-found");
    carl.get("/openapi.json").send().await.expect(200);
    server.stop().await;
}

async fn listed(client: &Client, path: &str) -> Vec<String> {
    let page = client.get(path).send().await.expect(200).json();
    page["items"].as_array().unwrap().iter().map(|item| id_of(item).to_owned()).collect()
}

#[tokio::test]
async fn lists_show_what_is_one_s_own_or_shared() {
    let keys = laboratory().await;
    let data_dir = DataDir::new();
    let server = keys.launch(&data_dir).start().await;
    let [root, anna, bert, carl] = ["root", "anna", "bert", "carl"].map(|name| keys.client(&server, name));
    let job = anna.succeed(&jobs::quick(1)).await;
    assert_eq!(
        (&job["owner"], &job["submitted_by"], &job["shared"]),
        (&json!("lab"), &json!("anna"), &json!(false))
    );
    let id = id_of(&job).to_owned();
    let open = carl.submit(&jobs::with(jobs::quick(2), "/shared", json!(true))).await;
    assert_eq!((&open["owner"], &open["shared"]), (&json!("carl"), &json!(true)));
    let open = id_of(&open).to_owned();
    for (client, expected) in [
        (&root, vec![open.clone(), id.clone()]),
        (&anna, vec![open.clone(), id.clone()]),
        (&bert, vec![open.clone(), id.clone()]),
        (&carl, vec![open.clone()]),
    ] {
        assert_eq!(listed(client, "/v1/jobs").await, expected);
    }
    // A cursor of one owner is none of another's listing.
    let page = anna.get("/v1/jobs?limit=1").send().await.expect(200).json();
    let next = format!("/v1/jobs?limit=1&cursor={}", page["next_cursor"].as_str().unwrap());
    assert_eq!(listed(&anna, &next).await, std::slice::from_ref(&id));
    carl.get(&next).send().await.expect_problem(400, "validation-error");

    // Shared by a patch, read by others, changed by none of them.
    let share = |shared: bool| {
        let patch = anna.request(Method::PATCH, &format!("/v1/jobs/{id}"));
        patch.json(&json!({"shared": shared})).header("content-type", "application/merge-patch+json")
    };
    assert_eq!(share(true).send().await.expect(200).json()["shared"], true);
    assert_eq!(listed(&carl, "/v1/jobs").await, [open.clone(), id.clone()]);
    for path in ["", "/result", "/exports/slice?format=svg", "/plots/grading", "/request"] {
        carl.get(&format!("/v1/jobs/{id}{path}")).send().await.expect(200);
    }
    let problem = carl.delete(&format!("/v1/jobs/{id}")).send().await.expect_problem(403, "forbidden");
    assert!(detail(&problem).contains("lab") && detail(&problem).contains("shared"), "{problem}");
    let kept = carl.post(&format!("/v1/jobs/{id}/exports/slice?format=svg")).send().await;
    kept.expect_problem(403, "forbidden");
    share(false).send().await.expect(200);
    carl.get(&format!("/v1/jobs/{id}")).send().await.expect_problem(404, "not-found");

    // A study is shared with its jobs.
    let study = anna.submit_study(&json!({"list": [jobs::quick(3), jobs::quick(4)]})).await;
    let study = id_of(&study).to_owned();
    let jobs_of = format!("/v1/jobs?study={study}");
    assert_eq!(listed(&carl, "/v1/studies").await, Vec::<String>::new());
    assert_eq!(listed(&carl, &jobs_of).await, Vec::<String>::new());
    let patch = |client: &Client, body: &Value| {
        client.request(Method::PATCH, &format!("/v1/studies/{study}")).json(body)
    };
    patch(&carl, &json!({"shared": true})).send().await.expect_problem(404, "not-found");
    patch(&anna, &json!({"shared": 1})).send().await.expect_problem(422, "validation-error");
    let shared = patch(&anna, &json!({"shared": true})).send().await.expect(200).json();
    assert_eq!((&shared["shared"], &shared["owner"]), (&json!(true), &json!("lab")));
    assert_eq!(listed(&carl, "/v1/studies").await, std::slice::from_ref(&study));
    assert_eq!(listed(&carl, &jobs_of).await.len(), 2);
    assert_eq!(listed(&carl, &format!("/v1/studies/{study}/jobs")).await.len(), 2);
    let table = carl.get(&format!("/v1/studies/{study}/table")).send().await.expect(200).json();
    assert_eq!(table["rows"].as_array().unwrap().len(), 2);
    carl.post(&format!("/v1/studies/{study}/cancel")).send().await.expect_problem(403, "forbidden");
    let own = carl.submit_study(&json!({"list": [jobs::quick(5)], "shared": true})).await;
    let own = id_of(&own).to_owned();
    assert_eq!(bert.get(&format!("/v1/studies/{own}")).send().await.expect(200).json()["shared"], true);
    assert_eq!(listed(&bert, &format!("/v1/studies/{own}/jobs")).await.len(), 1);
    server.stop().await;
}

#[tokio::test]
async fn keys_of_one_owner_share_idempotency_keys_and_those_of_others_do_not() {
    let keys = Keys::make(&[
        (&["anna", "--role", "submit", "--owner", "lab"], ""),
        (&["emma", "--role", "submit", "--owner", "lab"], ""),
        (&["carl", "--role", "submit"], ""),
    ])
    .await;
    let data_dir = DataDir::new();
    let server = keys.launch(&data_dir).start().await;
    let submit = async |name: &str, status: u16| {
        let request = keys.client(&server, name).post("/v1/jobs").header("idempotency-key", "one");
        request.json(&jobs::quick(1)).send().await.expect(status).json()
    };
    let first = submit("anna", 201).await;
    assert_eq!(id_of(&submit("emma", 200).await), id_of(&first));
    assert_ne!(id_of(&submit("carl", 201).await), id_of(&first));
    let of_study = json!({"list": [jobs::quick(3)]});
    for (name, status) in [("anna", 201), ("emma", 200), ("carl", 201)] {
        let request = keys.client(&server, name).post("/v1/studies").header("idempotency-key", "one");
        request.json(&of_study).send().await.expect(status);
    }
    server.stop().await;
}

#[tokio::test]
async fn a_client_learns_what_its_key_may_do() {
    let keys = laboratory().await;
    let data_dir = DataDir::new();
    let server = keys.launch(&data_dir).start().await;
    for (name, owner, role) in [
        ("root", "root", "admin"),
        ("anna", "lab", "submit"),
        ("bert", "lab", "read"),
        ("carl", "carl", "submit"),
    ] {
        let key = keys.client(&server, name).get("/v1/key").send().await.expect(200).json();
        assert_eq!((&key["name"], &key["owner"], &key["role"]), (&json!(name), &json!(owner), &json!(role)));
    }
    let job = keys.client(&server, "anna").submit(&jobs::quick(1)).await;
    let root = keys.client(&server, "root");
    root.finished(id_of(&job)).await;
    root.delete(&format!("/v1/jobs/{}", id_of(&job))).send().await.expect(204);
    server.stop().await;

    let server = Server::start(&data_dir).await;
    let key = server.client().get("/v1/key").send().await.expect(200).json();
    assert_eq!((&key["name"], &key["owner"], &key["role"]), (&json!(null), &json!(null), &json!("admin")));
    server.stop().await;
    for bad in [vec!["key", "a=b"], vec!["key", "a", "--owner", "b c"], vec!["key", "a", "--role", "king"]] {
        let refused = packstone(keys.file.parent().unwrap(), &bad).await;
        assert_eq!(refused.code, Some(2), "{bad:?}: {refused:?}");
    }
}

#[tokio::test]
async fn quotas_of_an_owner_are_refused_with_figures_and_bind_nobody_else() {
    let keys = Keys::make(&[
        (&["anna", "--role", "submit", "--owner", "lab", "--max-grains", "3000"], "max_queued=2"),
        (&["emma", "--role", "submit", "--owner", "lab"], ""),
        (&["carl", "--role", "submit"], "max_grains=none"),
    ])
    .await;
    let data_dir = DataDir::new();
    let args = ["--max-grains-per-key", "4000", "--max-queued-per-key", "50"];
    let server = keys.launch(&data_dir).workers(0).args(&args).start().await;
    let [anna, emma, carl] = ["anna", "emma", "carl"].map(|name| keys.client(&server, name));
    let key = emma.get("/v1/key").send().await.expect(200).json();
    let quotas = json!({"max_queued": 2, "max_running": null, "max_grains": 3000, "max_stored_bytes": null});
    assert_eq!(key["quotas"], quotas, "an owner's, whichever key names them");
    assert_eq!(key["used"], json!({"queued": 0, "running": 0, "stored_bytes": 0}));

    // Grains of one packing.
    for path in ["/v1/jobs", "/v1/plans"] {
        let refused = anna.post(path).json(&jobs::equal_spheres(3500, 1)).send().await;
        let problem = refused.expect_problem(422, "too-large");
        assert!(detail(&problem).contains("3000"), "{problem}");
        let accepted = carl.post(path).json(&jobs::equal_spheres(5000, 1)).send().await;
        assert!(accepted.status.is_success());
    }
    let study = json!({"list": [jobs::equal_spheres(3500, 1)]});
    anna.post("/v1/studies").json(&study).send().await.expect_problem(422, "too-large");

    // Jobs that wait, of both keys of the owner together.
    let first = anna.submit(&jobs::quick(1)).await;
    emma.submit(&jobs::quick(2)).await;
    for client in [&anna, &emma] {
        let refused = client.post("/v1/jobs").json(&jobs::quick(3)).send().await;
        assert!(refused.header("retry-after").parse::<u32>().unwrap() >= 1);
        let problem = refused.expect_problem(429, "queue-full");
        assert!(detail(&problem).contains("at most 2") && detail(&problem).contains("lab"), "{problem}");
    }
    let study = json!({"list": [jobs::quick(3), jobs::quick(4)]});
    anna.post("/v1/studies").json(&study).send().await.expect_problem(429, "queue-full");
    carl.submit_study(&study).await;
    assert_eq!(emma.get("/v1/key").send().await.expect(200).json()["used"]["queued"], 2);
    anna.post(&format!("/v1/jobs/{}/cancel", id_of(&first))).send().await.expect(200);
    emma.submit(&jobs::quick(5)).await;
    server.stop().await;
}

#[tokio::test]
async fn jobs_beyond_max_running_wait_and_others_run() {
    let keys = Keys::make(&[
        (&["anna", "--role", "submit", "--max-running", "1"], ""),
        (&["carl", "--role", "submit"], ""),
    ])
    .await;
    let data_dir = DataDir::new();
    let server = keys.launch(&data_dir).workers(3).start().await;
    let [anna, carl] = ["anna", "carl"].map(|name| keys.client(&server, name));
    let first = anna.submit(&jobs::endless()).await;
    anna.running(id_of(&first)).await;
    let second = anna.submit(&jobs::endless()).await;
    let others = carl.submit(&jobs::endless()).await;
    carl.running(id_of(&others)).await;
    carl.succeed(&jobs::quick(1)).await;
    assert_eq!(anna.job(id_of(&second)).await["state"], "queued");
    anna.post(&format!("/v1/jobs/{}/cancel", id_of(&first))).send().await.expect(202);
    anna.running(id_of(&second)).await;
    // A bound that is raised counts without a restart, and without another job that ends.
    let third = anna.submit(&jobs::endless()).await;
    let text = fs::read_to_string(&keys.file).unwrap().replace("max_running=1", "max_running=22");
    fs::write(&keys.file, text).unwrap();
    anna.running(id_of(&third)).await;
    server.stop().await;
}

#[tokio::test]
async fn a_key_that_sends_too_many_requests_waits_and_no_other_does() {
    let keys = Keys::make(&[
        (&["anna", "--role", "submit"], ""),
        (&["carl", "--role", "submit"], ""),
        (&["root", "--role", "admin"], "max_requests_per_second=none"),
        (&["emma", "--max-requests-per-second", "2.5"], ""),
    ])
    .await;
    let data_dir = DataDir::new();
    // So slow that the time that the test takes brings no further request.
    let args = ["--max-requests-per-second-per-key", "0.001", "--request-burst-per-key", "3"];
    let server = keys.launch(&data_dir).args(&args).start().await;
    let [anna, carl, root] = ["anna", "carl", "root"].map(|name| keys.client(&server, name));
    let key = anna.get("/v1/key").send().await.expect(200).json();
    assert_eq!((&key["max_requests_per_second"], &key["request_burst"]), (&json!(0.001), &json!(3)));
    let emma = keys.client(&server, "emma").get("/v1/key").send().await.expect(200).json();
    assert_eq!((&emma["max_requests_per_second"], &emma["request_burst"]), (&json!(2.5), &json!(3)));
    anna.get("/v1/nowhere").send().await.expect_problem(404, "not-found");
    anna.post("/v1/jobs").json(&jobs::quick(1)).send().await.expect(201);
    for path in ["/v1/jobs", "/v1/key", "/metrics"] {
        let refused = anna.get(path).send().await;
        let seconds: u64 = refused.header("retry-after").parse().unwrap();
        assert!((900..=1000).contains(&seconds), "{seconds}");
        let problem = refused.expect_problem(429, "too-many-requests");
        assert!(detail(&problem).contains("0.001") && detail(&problem).contains("anna"), "{problem}");
    }
    anna.post("/v1/jobs").json(&jobs::quick(2)).send().await.expect_problem(429, "too-many-requests");
    for _ in 0..20 {
        anna.get("/healthz").send().await.expect(200);
        anna.get("/readyz").send().await.expect(200);
        root.get("/v1/key").send().await.expect(200);
    }
    carl.get("/v1/jobs").send().await.expect(200);
    let metrics = root.get("/metrics").send().await.expect(200).body.clone();
    let text = String::from_utf8(metrics.to_vec()).unwrap();
    assert!(text.lines().any(|line| line == "packstone_http_requests_over_rate_total 4"), "{text}");
    server.stop().await;
}

pub(crate) fn audit_lines(file: &std::path::Path) -> Vec<Value> {
    let text = fs::read_to_string(file).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Each operation of the published document that changes something is told under its own name.
#[tokio::test]
async fn the_audit_log_tells_of_every_request_that_changes_something() {
    let keys = laboratory().await;
    let data_dir = DataDir::new();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("audit.jsonl");
    let server = keys.launch(&data_dir).args(&["--audit-log", file.to_str().unwrap()]).start().await;
    let [root, anna, bert, carl] = ["root", "anna", "bert", "carl"].map(|name| keys.client(&server, name));
    let job = anna.succeed(&jobs::quick(1)).await;
    let study = anna.submit_study(&json!({"list": [jobs::quick(2)]})).await;
    let study = anna.study_finished(id_of(&study)).await;
    let mut expected =
        vec![json!(["submit_job", id_of(&job), 201]), json!(["submit_study", id_of(&study), 201])];
    let told = |file: &std::path::Path| {
        let line = |line: &Value| json!([line["action"], line["id"], line["status"]]);
        audit_lines(file).iter().map(line).collect::<Vec<_>>()
    };
    assert_eq!(told(&file), expected);
    let first = &audit_lines(&file)[0];
    assert_eq!(
        (&first["key"], &first["owner"], &first["address"]),
        (&json!("anna"), &json!("lab"), &json!("127.0.0.1"))
    );
    assert!(first["time"].as_str().unwrap().ends_with('Z') && first["path"] == "/v1/jobs", "{first}");
    for (name, operation) in operations() {
        let (method, template) = name.split_once(' ').unwrap();
        if template == "/session" {
            // Those of known keys are told: tests/sessions.rs.
            continue;
        }
        if method == "get" || COMPUTING.contains(&template) || template.starts_with("/v1/leases") {
            // What reads is not told, nor what workers do.
            root.get("/v1/jobs").send().await.expect(200);
            continue;
        }
        let id = if template.starts_with("/v1/studies") { id_of(&study) } else { id_of(&job) };
        let target = template.replace("{id}", id).replace("{type}", "slice");
        for (client, status) in [(&bert, 403), (&carl, 404)] {
            // Carl may submit, and allow no worker; his empty document is refused, and so is a deletion without a
            // filter.
            let status = match method {
                _ if status != 404 || template.contains("{id}") => status,
                _ if template == "/v1/workers/allow" => 403,
                "delete" => 400,
                _ => 422,
            };
            send(client, method, &target).send().await.expect(status);
            let id = if template.contains("{id}") { json!(id) } else { Value::Null };
            expected.push(json!([operation["operationId"], id, status]));
        }
    }
    assert_eq!(told(&file), expected);
    assert!(expected.len() > 20, "{}", expected.len());
    // Without a key nothing is told but in the log of the service.
    server.client().delete(&format!("/v1/jobs/{}", id_of(&job))).send().await.expect(401);
    // Rotated without a word to the server.
    let rotated = folder.path().join("audit.jsonl.1");
    fs::rename(&file, &rotated).unwrap();
    root.delete(&format!("/v1/jobs/{}", id_of(&job))).send().await.expect(204);
    assert_eq!(told(&file), [json!(["delete_job", id_of(&job), 204])]);
    assert_eq!(audit_lines(&file)[0]["key"], "root");
    assert_eq!(told(&rotated), expected);
    server.stop().await;
}

#[tokio::test]
async fn an_audit_log_that_cannot_be_written_ends_nothing() {
    let data_dir = DataDir::new();
    let folder = tempfile::tempdir().unwrap();
    let logs = folder.path().join("logs");
    let file = logs.join("audit.jsonl");
    let args = ["--audit-log", file.to_str().unwrap()];
    let refused = run(Launch::new(&data_dir).args(&args).into_command()).await;
    assert_ne!(refused.code, Some(0));
    assert!((refused.stderr + &refused.stdout).contains("audit.jsonl"));
    fs::create_dir(&logs).unwrap();
    let server = Launch::new(&data_dir).args(&args).start().await;
    let client = server.client();
    fs::remove_dir_all(&logs).unwrap();
    let job = client.succeed(&jobs::quick(1)).await;
    let lost = async |count: u64| {
        let metrics = client.get("/metrics").send().await.expect(200).body.clone();
        let text = String::from_utf8(metrics.to_vec()).unwrap();
        let line = format!("packstone_audit_lines_lost_total {count}");
        assert!(text.lines().any(|found| found == line), "{text}");
    };
    lost(1).await;
    fs::create_dir(&logs).unwrap();
    client.delete(&format!("/v1/jobs/{}", id_of(&job))).send().await.expect(204);
    lost(1).await;
    let text = fs::read_to_string(&file).unwrap();
    let line: Value = serde_json::from_str(text.trim()).unwrap();
    assert_eq!((&line["action"], &line["key"]), (&json!("delete_job"), &json!("")));
    server.terminate();
    let log = server.log_at_end().await;
    assert!(log.contains("audit log cannot be written") && log.contains("can be written again"), "{log}");
}
