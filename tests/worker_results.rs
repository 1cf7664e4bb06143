//! What a worker process sends is checked: results, failures and checkpoints that are wrong change nothing, are told of
//! by name, and after three of them the process gets no job.

use std::collections::BTreeMap;
use std::path::Path;

use reqwest::Method;
use serde_json::{Value, json};

use crate::harness::deadline::eventually;
use crate::harness::{Client, DataDir, Launch, Postgres, Reply, Running, Server, id_of, jobs, packstone};
use crate::workers::{build_of, claim, packed_alone, sha256, with_id};

/// A result in the form in which workers send it.
#[derive(Clone)]
struct Stored {
    /// The magic that tells the revision.
    magic: [u8; 8],
    head: Value,
    rows: usize,
    columns: Vec<Vec<f64>>,
}

impl Stored {
    fn read(bytes: &[u8]) -> Self {
        let number = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
        let (head_bytes, rows) = (number(8), number(16));
        let head = serde_json::from_slice(&bytes[24..24 + head_bytes]).unwrap();
        // The sum of all bytes stands at the end.
        let values: Vec<f64> = bytes[24 + head_bytes..bytes.len() - 4]
            .chunks_exact(8)
            .map(|value| f64::from_le_bytes(value.try_into().unwrap()))
            .collect();
        let columns = values.chunks_exact(rows).map(<[f64]>::to_vec).collect();
        Self { magic: bytes[..8].try_into().unwrap(), head, rows, columns }
    }

    fn bytes(&self) -> Vec<u8> {
        let mut head = serde_json::to_vec(&self.head).unwrap();
        // Columns start at a multiple of 64 bytes.
        head.resize((24 + head.len()).next_multiple_of(64) - 24, b' ');
        let mut bytes = self.magic.to_vec();
        bytes.extend((head.len() as u64).to_le_bytes());
        bytes.extend((self.rows as u64).to_le_bytes());
        bytes.extend(head);
        bytes.extend(self.columns.iter().flatten().flat_map(|value| value.to_le_bytes()));
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        bytes
    }

    /// The report, which lies one level deeper where the columns are named.
    fn report(&mut self) -> &mut Value {
        if self.head.get("head").is_some() { &mut self.head["head"] } else { &mut self.head }
    }
}

/// Packings as workers make them, from a server of its own.
struct Packer {
    server: Server,
    data_dir: DataDir,
}

impl Packer {
    async fn start() -> Self {
        let data_dir = DataDir::new();
        Self { server: Server::start(&data_dir).await, data_dir }
    }

    /// The right result of a job with another ID.
    async fn result(&self, job: &Value, id: &str) -> Vec<u8> {
        let before = self.data_dir.artifacts();
        let packed = self.server.client().succeed(job).await;
        let all = self.data_dir.artifacts();
        let file = all.iter().find(|path| !before.contains(path)).expect("the file of the result");
        with_id(&std::fs::read(file).unwrap(), id_of(&packed), id)
    }
}

/// A worker by hand.
struct ByHand {
    client: Client,
    build: Value,
    claims: std::cell::Cell<u32>,
}

impl ByHand {
    async fn of(client: &Client) -> Self {
        Self { client: client.clone(), build: build_of(client).await, claims: std::cell::Cell::new(0) }
    }

    /// Asks for a job under a name.
    async fn ask(&self, worker: &str) -> Reply {
        self.claims.set(self.claims.get() + 1);
        let mut asking = claim(&format!("{worker} {}", self.claims.get()), &self.build);
        asking["worker"] = json!(worker);
        self.client.post("/v1/leases").json(&asking).send().await
    }

    /// Leases the job, which must be the next one; the path of its lease.
    async fn lease(&self, worker: &str, id: &str) -> String {
        let leased = self.ask(worker).await.expect(200).json();
        assert_eq!(leased["leases"][0]["job"], id, "{leased:#}");
        format!("/v1/leases/{id}/{}", leased["leases"][0]["attempt"])
    }

    /// Sends a result.
    async fn send(&self, lease: &str, file: Vec<u8>) -> Reply {
        let target = format!("{lease}/result?sha256={}", sha256(&file));
        self.client.request(Method::PUT, &target).body(file).send().await
    }
}

/// A worker process that ends when there is no job left.
async fn honest(folder: &Path, server: &Server) {
    let url = format!("http://{}", server.address());
    let args = ["worker", "--server", &url, "--name", "honest", "--slots", "1", "--idle-exit-s", "1"];
    let ended = Running::spawn(folder, &args).ended().await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
}

fn small(mut job: Value) -> Value {
    job["mix"]["d_min_mm"] = json!(5.0);
    job["mix"]["volume_fraction"] = json!(0.2);
    job
}

fn ellipsoids() -> Value {
    let ratios = json!({"type": "constant", "b_over_a": 0.8, "c_over_a": 0.6});
    small(jobs::with(jobs::quick(3), "/mix/shape", json!({"type": "ellipsoid", "ratios": ratios})))
}

fn polyhedra() -> Value {
    let shape = json!({"type": "polyhedron", "template_count": 2});
    small(jobs::with(jobs::quick(3), "/mix/shape", shape))
}

type Change = Box<dyn Fn(&mut Stored)>;

/// Results that are wrong, by what is wrong with them.
fn wrong_results(other_seed: Stored) -> BTreeMap<&'static str, Change> {
    let change = |change: fn(&mut Stored)| -> Change { Box::new(change) };
    BTreeMap::from([
        (
            "moved into its neighbour",
            change(|stored| {
                for column in 0..3 {
                    stored.columns[column][1] = stored.columns[column][0] + 0.01;
                }
            }),
        ),
        ("outside", change(|stored| stored.columns[0][2] = -5.0)),
        ("not a number", change(|stored| stored.columns[1][2] = f64::NAN)),
        (
            "missing",
            change(|stored| {
                stored.rows -= 1;
                stored.columns.iter_mut().for_each(|column| _ = column.pop());
            }),
        ),
        (
            "of another seed",
            Box::new(move |stored: &mut Stored| {
                stored.rows = other_seed.rows;
                stored.columns.clone_from(&other_seed.columns);
            }),
        ),
        ("another size", change(|stored| stored.columns[3][4] = stored.columns[3][4].next_up())),
        ("a long warning", change(|stored| stored.report()["warnings"] = json!(["x".repeat(1 << 20)]))),
        ("another figure", change(|stored| stored.report()["summary"]["grains"] = json!(7))),
        (
            "another job",
            change(|stored| stored.report()["job_id"] = json!("0192f2b1-3775-70c1-9a6b-ffffffffffff")),
        ),
        ("another engine", change(|stored| stored.report()["engine"]["version"] = json!("9.9.9"))),
    ])
}

#[tokio::test]
async fn wrong_results_are_refused_and_an_honest_worker_ends_the_job() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let (packer, by_hand) = (Packer::start().await, ByHand::of(&client).await);
    let mut jobs_sent = Vec::new();
    for (kind, job) in [("spheres", jobs::quick(1)), ("ellipsoids", ellipsoids()), ("polyhedra", polyhedra())]
    {
        let mut other = job.clone();
        other["seed"] = json!(77);
        let other_seed = Stored::read(&packer.result(&other, "0192f2b1-3775-70c1-9a6b-033010b8f4d4").await);
        let right = Stored::read(&packer.result(&job, "0192f2b1-3775-70c1-9a6b-033010b8f4d4").await);
        for (wrong, change) in wrong_results(other_seed) {
            // The next one to be leased is the last one that was submitted.
            let priority = json!(jobs_sent.len());
            let submitted = client.submit(&jobs::with(job.clone(), "/priority", priority)).await;
            let id = id_of(&submitted);
            let (worker, mut stored) = (format!("{kind} {wrong}"), right.clone());
            stored.report()["job_id"] = json!(id);
            stored.report()["request"] = client.request_of(id).await;
            change(&mut stored);
            let lease = by_hand.lease(&worker, id).await;
            let status = by_hand.send(&lease, stored.bytes()).await.status.as_u16();
            assert!([200, 400].contains(&status), "{worker}: {status}");
            let back = client.job_when(id, "requeued", |job| job["attempt"] == 2).await;
            assert_eq!(
                (&back["state"], &back["result"]),
                (&json!("queued"), &Value::Null),
                "{worker}: {back:#}"
            );
            assert!(back["max_attempts"].as_u64() > submitted["max_attempts"].as_u64(), "it does not count");
            jobs_sent.push((id.to_owned(), job.clone()));
            let is_told = || {
                let told =
                    |line: &str| line.contains("a worker sent a wrong result") && line.contains(&worker);
                server.log().lines().any(told)
            };
            eventually("the log to name the worker", is_told).await;
        }
    }
    let count = jobs_sent.len() as f64;
    assert_eq!(client.metric("packstone_results_checked_total{outcome=\"wrong\"}").await, count);
    // Bytes that are cut off, as they are and as they were to be.
    let (id, job) = jobs_sent[0].clone();
    let mut cut = packer.result(&job, &id).await;
    cut.truncate(cut.len() - 100);
    let truncated = client.submit(&jobs::with(job.clone(), "/priority", json!(99))).await;
    let truncated = id_of(&truncated);
    let lease = by_hand.lease("cuts", truncated).await;
    let target = format!("{lease}/result?sha256={}", "0".repeat(64));
    let damaged = client.request(Method::PUT, &target).body(cut.clone()).send().await;
    damaged.expect_problem(400, "validation-error");
    assert_eq!(client.job(truncated).await["state"], "running", "it may be sent again");
    by_hand.send(&lease, cut).await.expect_problem(400, "validation-error");
    assert_eq!(client.job(truncated).await["state"], "queued");
    jobs_sent.push((truncated.to_owned(), job.clone()));
    // Right grains whose sum, which the worker has written after them, is not theirs.
    let damaged = client.submit(&jobs::with(job.clone(), "/priority", json!(100))).await;
    let damaged = id_of(&damaged);
    let mut file = packer.result(&job, damaged).await;
    *file.last_mut().unwrap() ^= 1;
    let lease = by_hand.lease("sums", damaged).await;
    let refused = by_hand.send(&lease, file).await.expect_problem(400, "validation-error");
    assert!(refused.to_string().contains("do not have the sum"), "{refused:#}");
    assert_eq!(client.job(damaged).await["state"], "queued");
    jobs_sent.push((damaged.to_owned(), job.clone()));

    honest(folder.path(), &server).await;
    for (id, job) in jobs_sent {
        let done = client.finished(&id).await;
        assert_eq!((&done["state"], &done["worker"]), (&json!("succeeded"), &json!("honest")), "{done:#}");
        assert!(client.result_in(&id, "npy").await == packed_alone(folder.path(), &job).await, "{job:#}");
    }
    assert_eq!(data_dir.artifacts().len() as f64, count + 2.0, "no wrong file is left");
    server.stop().await;
    packer.server.stop().await;
}

#[tokio::test]
async fn three_wrong_results_block_a_worker_until_it_is_allowed_again() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let by_hand = ByHand::of(&client).await;
    let submitted = client.submit(&jobs::quick(1)).await;
    let id = id_of(&submitted);
    for wrong in 1..=3 {
        let lease = by_hand.lease("faulty", id).await;
        by_hand.send(&lease, b"nonsense".to_vec()).await.expect_problem(400, "validation-error");
        let faulty = client.get("/v1/workers").send().await.expect(200).json();
        let item = &faulty["items"][0];
        assert_eq!(
            (&item["wrong_results"], &item["worker"]),
            (&json!(wrong), &json!("faulty")),
            "{faulty:#}"
        );
        assert_eq!((&item["blocked"], &item["last_job"]), (&json!(wrong == 3), &json!(id)), "{faulty:#}");
        assert!(item["last_fault"].as_str().unwrap().contains("no result"), "{faulty:#}");
    }
    let is_told = || server.log().contains("the worker gets no job until an administrator allows it again");
    eventually("the log to say so", is_told).await;
    assert_eq!(client.metric("packstone_workers_blocked").await, 1.0);
    // It survives a restart, and holds for this process alone.
    server.kill().await;
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let by_hand = ByHand::of(&client).await;
    let refused = by_hand.ask("faulty").await.expect_problem(409, "worker-blocked");
    assert!(
        refused["detail"].as_str().unwrap().contains("\"faulty\" has sent 3 wrong results"),
        "{refused:#}"
    );
    let lease = by_hand.lease("another", id).await;
    client.post(&format!("{lease}/end")).json(&json!({"outcome": "released"})).send().await.expect(200);
    for (body, status, kind) in [
        (json!({"worker": "unknown"}), 404, "not-found"),
        (json!({"worker": "faulty", "key": "of nobody"}), 404, "not-found"),
        (json!({"name": "faulty"}), 422, "validation-error"),
    ] {
        client.post("/v1/workers/allow").json(&body).send().await.expect_problem(status, kind);
    }
    let left = client.post("/v1/workers/allow").json(&json!({"worker": "faulty"})).send().await;
    assert_eq!(left.expect(200).json()["items"], json!([]));
    let lease = by_hand.lease("faulty", id).await;
    client.post(&format!("{lease}/end")).json(&json!({"outcome": "released"})).send().await.expect(200);
    honest(folder.path(), &server).await;
    assert_eq!(client.job(id).await["state"], "succeeded");
    server.stop().await;
}

/// More than one worker says so: the job, or the program, is at fault, and not each worker of a cluster in turn.
#[tokio::test]
async fn a_job_whose_results_are_wrong_with_two_workers_fails() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let by_hand = ByHand::of(&client).await;
    let submitted = client.submit(&jobs::quick(1)).await;
    let id = id_of(&submitted);
    for wrong in 0..6 {
        let lease = by_hand.lease(["one", "two"][wrong / 3], id).await;
        by_hand.send(&lease, b"nonsense".to_vec()).await.expect_problem(400, "validation-error");
    }
    let failed = client.job(id).await;
    assert_eq!(failed["error"]["type"], "/problems/check-failed", "{failed:#}");
    server.stop().await;
}

#[tokio::test]
async fn a_check_that_a_kill_ends_begins_again_and_one_that_is_cancelled_ends() {
    let data_dir = DataDir::new();
    let launch = || Launch::new(&data_dir).workers(0);
    let server = launch().start().await;
    let client = server.client();
    let (packer, by_hand) = (Packer::start().await, ByHand::of(&client).await);
    let job = jobs::equal_spheres(300_000, 1);
    let submitted = client.submit(&job).await;
    let id = id_of(&submitted);
    let lease = by_hand.lease("by hand", id).await;
    let file = packer.result(&job, id).await;
    by_hand.send(&lease, file.clone()).await.expect(200);
    let checking = client.job(id).await;
    server.kill().await;
    assert_eq!(
        (&checking["state"], &checking["progress"]["step"], &checking["worker"], &checking["result"]),
        (&json!("running"), &json!("check"), &json!("by hand"), &Value::Null),
        "{checking:#}"
    );
    let server = launch().start().await;
    let client = server.client();
    let done = client.finished(id).await;
    assert_eq!((&done["state"], &done["attempt"]), (&json!("succeeded"), &json!(1)), "{done:#}");
    assert_eq!(done["worker"], "by hand");
    // The worker repeats its request, of which it has heard nothing.
    let by_hand = ByHand::of(&client).await;
    by_hand.send(&lease, file).await.expect(200);

    let submitted = client.submit(&job).await;
    let id = id_of(&submitted);
    let lease = by_hand.lease("by hand", id).await;
    by_hand.send(&lease, packer.result(&job, id).await).await.expect(200);
    client.post(&format!("/v1/jobs/{id}/cancel")).send().await.expect(202);
    assert_eq!(client.finished(id).await["state"], "cancelled");
    for result in ["", "/summary"] {
        let gone = client.get(&format!("/v1/jobs/{id}/result{result}")).send().await;
        gone.expect_problem(409, "job-failed");
    }
    assert_eq!(client.metric("packstone_results_unchecked").await, 0.0);
    server.stop().await;
    packer.server.stop().await;
}

#[tokio::test]
async fn without_a_share_numbers_and_sizes_are_checked_nevertheless() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(0).args(&["--verify-results", "0"]).start().await;
    let client = server.client();
    let (packer, by_hand) = (Packer::start().await, ByHand::of(&client).await);
    let nobody = "0192f2b1-3775-70c1-9a6b-033010b8f4d4";
    let right = Stored::read(&packer.result(&jobs::quick(1), nobody).await);
    let other = Stored::read(&packer.result(&jobs::quick(2), nobody).await);
    for (wrong, change) in wrong_results(other) {
        let submitted = client.submit(&jobs::quick(1)).await;
        let id = id_of(&submitted);
        let mut stored = right.clone();
        stored.report()["job_id"] = json!(id);
        change(&mut stored);
        let lease = by_hand.lease(wrong, id).await;
        by_hand.send(&lease, stored.bytes()).await;
        if wrong == "moved into its neighbour" {
            assert_eq!(client.finished(id).await["state"], "succeeded", "the pairs were not looked at");
        } else {
            client.job_when(id, "requeued", |job| job["attempt"] == 2).await;
            client.post(&format!("/v1/jobs/{id}/cancel")).send().await.expect(200);
        }
    }
    server.stop().await;
    packer.server.stop().await;
}

#[tokio::test]
async fn ends_and_checkpoints_that_a_worker_cannot_know_are_refused() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let by_hand = ByHand::of(&client).await;
    let submitted = client.submit(&jobs::quick(1)).await;
    let id = id_of(&submitted);
    let lease = by_hand.lease("by hand", id).await;
    let end = async |end: Value| client.post(&format!("{lease}/end")).json(&end).send().await;
    let failed = |failure: Value| json!({"outcome": "failed", "failure": failure});
    for (document, pointer) in [
        (json!({"outcome": "cancelled"}), "/outcome"),
        (failed(json!({"code": "machine-fault", "detail": "x"})), "/failure/code"),
        (failed(json!({"code": "attempts-exhausted", "detail": "x"})), "/failure/code"),
        (failed(json!({"code": "timed-out", "detail": "x"})), "/failure/code"),
        (failed(json!({"code": "out-of-memory", "detail": "x"})), "/failure/code"),
        (failed(json!({"code": "target-not-reached", "detail": "x"})), "/failure/facts"),
        (failed(json!({"code": "internal-error", "detail": "x".repeat(5000)})), "/failure/detail"),
    ] {
        let refused = end(document).await.expect_problem(422, "validation-error");
        assert_eq!(refused["errors"][0]["pointer"], pointer, "{refused:#}");
    }
    for file in ["a checkpoint", ""] {
        let put = client.request(Method::PUT, &format!("{lease}/checkpoint")).body(file);
        put.send().await.expect_problem(400, "validation-error");
    }
    assert_eq!(data_dir.checkpoints(), Vec::<String>::new());
    assert_eq!(client.job(id).await["state"], "running");
    // A proof that no packing can exist, of a request that has one.
    let field = json!({"pointer": "/mix/volume_fraction", "detail": "no arrangement reaches it"});
    end(failed(json!({"code": "infeasible-mix", "detail": "x", "fields": [field]}))).await.expect(200);
    client.job_when(id, "requeued", |job| job["state"] == "queued" && job["attempt"] == 2).await;
    let faulty = client.get("/v1/workers").send().await.expect(200).json();
    assert_eq!(faulty["items"][0]["wrong_results"], 1, "{faulty:#}");

    // What only a defect causes counts once no attempt is left.
    let job = jobs::with(jobs::quick(2), "/max_attempts", json!(2));
    let submitted = client.submit(&jobs::with(job, "/priority", json!(1))).await;
    let defect = id_of(&submitted);
    for attempt in 1..=2 {
        let lease = by_hand.lease("by hand", defect).await;
        let failure = failed(json!({"code": "check-failed", "detail": format!("attempt {attempt}")}));
        client.post(&format!("{lease}/end")).json(&failure).send().await.expect(200);
        let state = if attempt == 1 { "queued" } else { "failed" };
        assert_eq!(client.job(defect).await["state"], state);
    }
    assert_eq!(client.job(defect).await["error"]["detail"], "attempt 2");
    honest(folder.path(), &server).await;
    assert_eq!(client.job(id).await["state"], "succeeded");
    server.stop().await;
}

/// The key of a worker opens no route of administrators.
#[tokio::test]
async fn only_administrators_allow_workers() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let mut keys = Vec::new();
    let mut lines = String::new();
    for (name, role) in [("root", "admin"), ("cluster", "worker"), ("lab", "submit")] {
        let made = packstone(folder.path(), &["key", name, "--role", role]).await.stdout;
        let mut printed = made.lines();
        keys.push(printed.next().unwrap().to_owned());
        lines.push_str(printed.next().unwrap());
        lines.push('\n');
    }
    let file = folder.path().join("keys");
    std::fs::write(&file, lines).unwrap();
    let server = Launch::new(&data_dir)
        .workers(0)
        .env("PACKSTONE_API_KEYS_FILE", file.to_str().unwrap())
        .start()
        .await;
    let [root, cluster, lab] = [0, 1, 2].map(|i| server.client().with_key(&keys[i]));
    let submitted = lab.submit(&jobs::quick(1)).await;
    let by_hand = ByHand { client: cluster.clone(), ..ByHand::of(&root).await };
    for _ in 0..3 {
        let lease = by_hand.lease("node 7", id_of(&submitted)).await;
        by_hand.send(&lease, Vec::new()).await.expect_problem(400, "validation-error");
    }
    by_hand.ask("node 7").await.expect_problem(409, "worker-blocked");
    let body = json!({"key": "cluster", "worker": "node 7"});
    for key in [&cluster, &lab] {
        key.get("/v1/workers").send().await.expect_problem(403, "forbidden");
        key.post("/v1/workers/allow").json(&body).send().await.expect_problem(403, "forbidden");
    }
    let faulty = root.get("/v1/workers").send().await.expect(200).json();
    assert_eq!(faulty["items"][0]["key"], "cluster", "{faulty:#}");
    root.post("/v1/workers/allow").json(&body).send().await.expect(200);
    by_hand.ask("node 7").await.expect(200);
    server.terminate();
    let log = server.log_at_end().await;
    assert!(log.contains("an administrator has allowed a worker again"), "{log}");
}

/// Servers that share a database: a check goes to another one, and a worker is blocked for all.
#[tokio::test]
async fn a_check_of_a_server_that_dies_goes_to_another_one() {
    let Some(postgres) = Postgres::start() else { return };
    let (data_dirs, shared) = ([DataDir::new(), DataDir::new()], tempfile::tempdir().unwrap());
    let (store, place) = (postgres.database("lab"), shared.path().to_str().unwrap().to_owned());
    let start = async |data_dir| {
        let launch = Launch::new(data_dir).args(&["--store", &store, "--blobs", &place]);
        launch.workers(0).env("PACKSTONE_LEASE_S", "3").start().await
    };
    let (one, two) = tokio::join!(start(&data_dirs[0]), start(&data_dirs[1]));
    let (here, there) = (one.client(), two.client());
    let (packer, by_hand) = (Packer::start().await, ByHand::of(&here).await);
    // More than all that the first server can check before it dies.
    let job = jobs::equal_spheres(300_000, 1);
    let mut ids = Vec::new();
    for _ in 0..2 {
        let submitted = here.submit(&job).await;
        let id = id_of(&submitted).to_owned();
        let file = packer.result(&job, &id).await;
        ids.push((id, file));
    }
    for (id, file) in &ids {
        let lease = by_hand.lease("by hand", id).await;
        by_hand.send(&lease, file.clone()).await.expect(200);
    }
    one.kill().await;
    for (id, ..) in &ids {
        let done = there.finished(id).await;
        assert_eq!((&done["state"], &done["attempt"]), (&json!("succeeded"), &json!(1)), "{done:#}");
    }
    let submitted = there.submit(&jobs::quick(1)).await;
    let by_hand = ByHand::of(&there).await;
    for _ in 0..3 {
        let lease = by_hand.lease("faulty", id_of(&submitted)).await;
        by_hand.send(&lease, b"nonsense".to_vec()).await.expect_problem(400, "validation-error");
    }
    let one = start(&data_dirs[0]).await;
    let by_hand = ByHand::of(&one.client()).await;
    by_hand.ask("faulty").await.expect_problem(409, "worker-blocked");
    for server in [one, two, packer.server] {
        server.stop().await;
    }
}
