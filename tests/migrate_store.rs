//! `packstone migrate-store`: what a service answers before and after its store has moved.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Finished, Launch, Postgres, Server, id_of, jobs, packstone, run};

/// An administrator and two owners.
struct Keys {
    folder: tempfile::TempDir,
    keys: Vec<String>,
}

impl Keys {
    async fn make() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (mut lines, mut keys) = (String::new(), Vec::new());
        for args in [
            &["root", "--role", "admin"][..],
            &["anna", "--role", "submit", "--owner", "lab"],
            &["carl", "--role", "submit"],
        ] {
            let made = packstone(folder.path(), &[&["key"], args].concat()).await;
            let mut printed = made.stdout.lines();
            keys.push(printed.next().unwrap().to_owned());
            writeln!(lines, "{}", printed.next().unwrap()).unwrap();
        }
        let secret = packstone(folder.path(), &["webhook-secret"]).await.stdout;
        let keys = Self { folder, keys };
        fs::write(keys.file("keys"), lines).unwrap();
        fs::write(keys.file("secret"), secret).unwrap();
        keys
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A server on a data directory; `store` is a URL, or empty for the file.
    async fn serve(&self, data_dir: &DataDir, store: &str, workers: usize) -> Server {
        Launch::new(data_dir)
            .workers(workers)
            .env("PACKSTONE_STORE", store)
            .env("PACKSTONE_API_KEYS_FILE", self.file("keys").to_str().unwrap())
            .env("PACKSTONE_WEBHOOK_SECRET_FILE", self.file("secret").to_str().unwrap())
            .env("PACKSTONE_WEBHOOK_ALLOWED_HOST", "127.0.0.1")
            // What nobody receives is not sent again during the test.
            .args(&["--webhook-first-pause-s", "3000"])
            .start()
            .await
    }

    /// Clients of the administrator and both owners.
    fn clients(&self, server: &Server) -> [Client; 3] {
        [0, 1, 2].map(|key| server.client().with_key(&self.keys[key]))
    }
}

async fn migrate(args: &[&str]) -> Finished {
    packstone(&std::env::temp_dir(), &[&["migrate-store"], args].concat()).await
}

async fn migrated(from: &str, to: &str) -> Finished {
    let ended = migrate(&["--from", from, "--to", to]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    ended
}

fn path(data_dir: &DataDir) -> &str {
    data_dir.path().to_str().unwrap()
}

/// Answers by key and target: ETag and body.
type Answers = BTreeMap<String, (Option<String>, Vec<u8>)>;

/// Adds an answer, and returns its body.
async fn ask(answers: &mut Answers, client: &Client, who: &str, target: &str) -> Value {
    let reply = client.get(target).send().await;
    assert_eq!(reply.status, 200, "{target}: {reply:?}");
    let etag = reply.headers.get("etag").map(|etag| etag.to_str().unwrap().to_owned());
    answers.insert(format!("{who} {target}"), (etag, reply.body.to_vec()));
    serde_json::from_slice(&reply.body).unwrap_or_default()
}

/// All that a server answers about what its store holds, to the administrator and to each owner.
async fn answers(clients: &[Client; 3]) -> Answers {
    let mut found = Answers::new();
    for (client, who) in clients.iter().zip(["root", "anna", "carl"]) {
        let listed = ask(&mut found, client, who, "/v1/jobs?limit=500").await;
        for order in ["priority", "-finished"] {
            ask(&mut found, client, who, &format!("/v1/jobs?limit=500&sort={order}")).await;
        }
        ask(&mut found, client, who, "/v1/jobs?label=series=TB-7").await;
        for job in listed["items"].as_array().unwrap() {
            let path = format!("/v1/jobs/{}", id_of(job));
            ask(&mut found, client, who, &format!("{path}?include=request")).await;
            ask(&mut found, client, who, &format!("{path}/request")).await;
            if job["state"] != "succeeded" {
                continue;
            }
            for target in ["result?format=npy", "result?format=json", "result/summary"] {
                ask(&mut found, client, who, &format!("{path}/{target}")).await;
            }
            let exports = ask(&mut found, client, who, &format!("{path}/exports")).await;
            for export in exports["items"].as_array().unwrap() {
                let file = export["links"]["file"].as_str().expect("a file that was made");
                ask(&mut found, client, who, file).await;
            }
        }
        let studies = ask(&mut found, client, who, "/v1/studies").await;
        for study in studies["items"].as_array().unwrap() {
            let path = format!("/v1/studies/{}", id_of(study));
            for target in ["?include=request", "/table", "/table?format=csv", "/jobs?limit=500"] {
                ask(&mut found, client, who, &format!("{path}{target}")).await;
            }
        }
    }
    let metrics = clients[0].get("/metrics").send().await;
    let text = String::from_utf8(metrics.body.to_vec()).unwrap();
    let stored = ["packstone_jobs{", "packstone_exports{", "packstone_stored_bytes{", "packstone_queue_"];
    for line in text.lines().filter(|line| stored.iter().any(|name| line.starts_with(name))) {
        let (name, value) = line.rsplit_once(' ').unwrap();
        if !name.contains("age") {
            found.insert(name.to_owned(), (None, value.into()));
        }
    }
    found
}

fn assert_same(before: &Answers, after: &Answers) {
    assert_eq!(before.keys().collect::<Vec<_>>(), after.keys().collect::<Vec<_>>());
    for (target, (etag, body)) in before {
        let text = |body: &[u8]| String::from_utf8_lossy(&body[..body.len().min(3000)]).into_owned();
        let found = &after[target];
        assert!(body == &found.1, "{target} was\n{}\nand is\n{}", text(body), text(&found.1));
        assert_eq!(etag, &found.0, "{target}");
    }
}

/// Jobs in every state, with labels, priorities, a webhook and exports, of two owners, and a study that was stopped
/// early. Returns what was submitted with the idempotency key `again`, and the job.
async fn fill(keys: &Keys, data_dir: &DataDir, store: &str) -> (Value, Value) {
    let server = keys.serve(data_dir, store, 1).await;
    let [_, anna, carl] = keys.clients(&server);
    let job = jobs::with(jobs::quick(1), "/labels", json!({"series": "TB-7", "Größe": "8/16 \"fein\""}));
    let job = jobs::with(job, "/webhook_url", json!("http://127.0.0.1:9/?token=a"));
    let repeated = anna.post("/v1/jobs").header("idempotency-key", "again").json(&job).send().await;
    let repeated = repeated.expect(201).json();
    assert_eq!(anna.finished(id_of(&repeated)).await["state"], "succeeded");
    anna.job_when(id_of(&repeated), "told", |job| job["webhook"]["attempts"] == 1).await;
    for (target, method) in [("voxels?format=raw&cells=20", "POST"), ("slice?format=json", "GET")] {
        let target = format!("/v1/jobs/{}/exports/{target}", id_of(&repeated));
        let request = if method == "POST" { anna.post(&target) } else { anna.get(&target) };
        request.header("prefer", "wait=60").send().await.expect(200);
    }
    let failed = carl.submit(&jobs::unreachable()).await;
    assert_eq!(carl.finished(id_of(&failed)).await["state"], "failed");
    let mut template = jobs::unreachable();
    template.as_object_mut().unwrap().remove("seed");
    let study = json!({
        "name": "stopped", "labels": {"series": "TB-7"}, "template": template,
        "grid": {"/mix/volume_fraction": [0.2, 0.5]}, "replicates": 4, "stop_when": {"failed_in_a_row": 2}
    });
    let study = anna.submit_study(&study).await;
    assert_eq!(anna.study_finished(id_of(&study)).await["counts"]["cancelled"], 2);
    server.stop().await;
    let server = keys.serve(data_dir, store, 0).await;
    let [root, anna, carl] = keys.clients(&server);
    for (client, seed) in [(&anna, 2), (&carl, 3), (&root, 4), (&anna, 5)] {
        client.submit(&jobs::with(jobs::quick(seed), "/priority", json!(seed))).await;
    }
    let cancelled = carl.submit(&jobs::with(jobs::quick(6), "/shared", json!(true))).await;
    carl.post(&format!("/v1/jobs/{}/cancel", id_of(&cancelled))).send().await.expect(200);
    assert_eq!(carl.finished(id_of(&cancelled)).await["state"], "cancelled");
    server.stop().await;
    (job, repeated)
}

/// What a server without workers answers.
async fn answers_of(keys: &Keys, data_dir: &DataDir, store: &str) -> Answers {
    let server = keys.serve(data_dir, store, 0).await;
    let found = answers(&keys.clients(&server)).await;
    server.stop().await;
    found
}

#[tokio::test]
async fn a_store_that_has_moved_to_postgresql_and_back_answers_as_before() {
    let Some(postgres) = Postgres::start() else { return };
    let (keys, store) = (Keys::make().await, postgres.database("lab"));
    let (data_dir, back) = (DataDir::new(), DataDir::new());
    let (job, repeated) = fill(&keys, &data_dir, "").await;
    let before = answers_of(&keys, &data_dir, "").await;
    for what in ["/exports/voxels", "/exports/slice", "anna /v1/studies/", "packstone_stored_bytes"] {
        assert!(before.keys().any(|target| target.contains(what)), "{what} is not compared");
    }
    let ended = migrated(path(&data_dir), &store).await;
    let serve = format!("packstone serve --data-dir {} --store 'postgres://packstone@", path(&data_dir));
    assert!(ended.stdout.contains(&serve), "{}", ended.stdout);
    assert!(
        ended.stdout.contains(&format!("they stay in {}/artifacts", path(&data_dir))),
        "{}",
        ended.stdout
    );
    assert_same(&before, &answers_of(&keys, &data_dir, &store).await);

    // The queue goes on, numbers and keys too.
    let server = keys.serve(&data_dir, &store, 0).await;
    let listed = keys.clients(&server)[0].get("/v1/jobs?state=queued").send().await.expect(200).json();
    assert_eq!(listed["items"].as_array().unwrap().len(), 4);
    server.stop().await;
    let server = keys.serve(&data_dir, &store, 1).await;
    let [root, anna, _] = keys.clients(&server);
    for job in listed["items"].as_array().unwrap() {
        assert_eq!(root.finished(id_of(job)).await["state"], "succeeded");
    }
    let again = anna.post("/v1/jobs").header("idempotency-key", "again").json(&job).send().await;
    assert_eq!(again.expect(200).json()["id"], repeated["id"], "the key is known");
    let study = anna.submit_study(&json!({"list": [jobs::quick(7), jobs::quick(8)]})).await;
    anna.study_finished(id_of(&study)).await;
    server.stop().await;
    let before = answers_of(&keys, &data_dir, &store).await;
    let there = migrate(&["--from", &store, "--to", path(&back), "--json"]).await;
    assert_eq!(there.code, Some(0), "{there:?}");
    let tables: Value = serde_json::from_str(&there.stdout).unwrap();
    let jobs_moved =
        tables["tables"].as_array().unwrap().iter().find(|table| table["table"] == "jobs").unwrap();
    assert_eq!(jobs_moved["rows"], postgres.ask("lab", "select count(*) from jobs").parse::<u64>().unwrap());
    assert_eq!(jobs_moved["sha256"].as_str().unwrap().len(), 64);
    let mut copy = Command::new("cp");
    copy.arg("-a").arg(data_dir.path().join("artifacts")).arg(back.path());
    assert_eq!(run(copy).await.code, Some(0));
    assert_same(&before, &answers_of(&keys, &back, "").await);
    let checked = packstone(back.path(), &["check", path(&back)]).await;
    assert_eq!(checked.code, Some(0), "{checked:?}");
}

#[tokio::test]
async fn a_job_that_ran_when_the_server_died_goes_on_in_the_other_database() {
    let Some(postgres) = Postgres::start() else { return };
    let (data_dir, store) = (DataDir::new(), postgres.database("lab"));
    let launch = |store: &str| Launch::new(&data_dir).env("PACKSTONE_STORE", store).args(&["--lease-s", "3"]);
    let server = launch("").start().await;
    let job = server.client().submit(&jobs::endless()).await;
    server.client().running(id_of(&job)).await;
    server.kill().await;
    migrated(path(&data_dir), &store).await;
    let server = launch(&store).start().await;
    let client = server.client();
    let again = client.job_when(id_of(&job), "running again", |job| {
        job["state"] == "running" && job["attempt"].as_i64() > Some(1)
    });
    again.await;
    client.post(&format!("/v1/jobs/{}/cancel", id_of(&job))).send().await.expect(202);
    assert_eq!(client.finished(id_of(&job)).await["state"], "cancelled");
    server.stop().await;
}

#[tokio::test]
async fn a_store_that_is_in_use_or_not_empty_is_not_moved() {
    let Some(postgres) = Postgres::start() else { return };
    let (full, empty) = (postgres.database("full"), postgres.database("empty"));
    let (data_dir, fresh) = (DataDir::new(), DataDir::new());
    let refused = async |from: &str, to: &str, code: i32, says: &str| {
        let ended = migrate(&["--from", from, "--to", to]).await;
        assert_eq!(ended.code, Some(code), "{ended:?}");
        assert!(ended.stderr.contains(says) && ended.stdout.is_empty(), "{says} is not in {ended:?}");
    };
    let local = Launch::new(&data_dir).workers(0).env("PACKSTONE_STORE", "").start().await;
    local.client().submit(&jobs::quick(1)).await;
    refused(path(&data_dir), &full, 1, "is in use by another packstone").await;
    local.stop().await;
    migrated(path(&data_dir), &full).await;
    refused(path(&data_dir), &full, 3, "1 rows in jobs").await;
    refused(&full, path(&data_dir), 3, "1 rows in jobs").await;
    // A server of either database, which must not lose what it is told meanwhile.
    let other = DataDir::new();
    for (url, from, to) in [(&full, full.as_str(), path(&fresh)), (&empty, path(&data_dir), empty.as_str())] {
        let server = Launch::new(&other).workers(0).env("PACKSTONE_STORE", url).start().await;
        refused(from, to, 1, "is in use: ").await;
        server.stop().await;
    }
    let server = Launch::new(&other).workers(0).env("PACKSTONE_STORE", &full).start().await;
    let forced = migrate(&["--from", &full, "--to", path(&fresh), "--force"]).await;
    assert_eq!(forced.code, Some(0), "{forced:?}");
    server.stop().await;
}

#[tokio::test]
async fn what_cannot_be_moved_is_refused_before_anything_is_made() {
    let parent = tempfile::tempdir().unwrap();
    let [one, two] = ["one", "two"].map(|name| parent.path().join(name).to_str().unwrap().to_owned());
    let url = "postgres://lab:secret@localhost/none?host=/nowhere";
    let cases = [
        (one.as_str(), two.as_str(), "one/packstone.sqlite and "),
        (url, url, "one of the two must be PostgreSQL and the other a data directory"),
        (one.as_str(), url, "is no data directory: it holds no packstone.sqlite"),
        (one.as_str(), "mysql://lab:secret@host/db", "--to must be a URL as postgres://"),
    ];
    for (from, to, says) in cases {
        let ended = migrate(&["--from", from, "--to", to]).await;
        assert_eq!(ended.code, Some(3), "{ended:?}");
        assert!(ended.stderr.contains(says), "{says} is not in {ended:?}");
        assert!(!ended.stderr.contains("secret"), "{ended:?}");
    }
    assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 0, "a directory was made");
}
