//! The power cut: `kill -9` at random moments while jobs are submitted, run and written.
//!
//! What was answered with 201 must be there afterwards; what was seen as finished must stay as it
//! was seen; every stored result must be the bytes that its checksum promises. The moments are
//! drawn from a seeded generator, so that a failure can be run again.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::time::Duration;

use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::harness::deadline::eventually;
use crate::harness::{Client, DataDir, Launch, Reply, id_of, jobs};

#[tokio::test]
async fn fifteen_power_cuts_lose_nothing() {
    survive(15, 1).await;
}

#[tokio::test]
#[ignore = "long: cargo test --release -p packstone-server --test e2e a_thousand -- --ignored"]
async fn a_thousand_power_cuts_lose_nothing() {
    survive(1000, 2).await;
}

/// As many as a job may ask for: one that takes long meets several cuts.
const ATTEMPTS: u64 = 10;

/// What the client knows.
#[derive(Default)]
pub(crate) struct Known {
    /// Idempotency keys with their bodies; a key may or may not have made a job so far.
    orders: Vec<(String, Value)>,
    /// Jobs that were answered with 201 or 200, by key.
    pub(crate) accepted: HashMap<String, String>,
    /// Jobs that were seen succeeded, by id.
    succeeded: HashMap<String, Value>,
    /// How often a job was found out of attempts, and retried.
    exhausted: usize,
    /// A server lives on while its database is gone, and says so: to the client that is a cut too.
    loses_database: bool,
}

/// Checkpoints at every opportunity, so that the cuts meet them being written.
fn launch(data_dir: &DataDir) -> Launch {
    Launch::new(data_dir).workers(2).args(&["--checkpoint-every-s", "0"])
}

async fn survive(kills: usize, seed: u64) {
    let data_dir = DataDir::new();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut known = Known::default();
    for _ in 0..kills {
        let server = launch(&data_dir).start().await;
        let moment = Duration::from_micros(random.next_u64() % 600_000);
        let client = server.client();
        tokio::select! {
            () = order_and_watch(&client, &mut known, &mut random) => unreachable!("a client goes on for ever"),
            // Not a wait for anything: the moment of the power cut is drawn.
            () = tokio::time::sleep(moment) => {}
        }
        server.kill().await;
    }

    let server = launch(&data_dir).start().await;
    account(&server.client(), &data_dir, &mut known).await;
    server.stop().await;
    swept(&data_dir, &known).await;
    known.print(kills);
}

/// Calls each job to account: every order has made one job, which ends with a result that is stored as it was, and the
/// same as that of every other job of the same request.
pub(crate) async fn account(client: &Client, data_dir: &DataDir, known: &mut Known) {
    for (key, body) in known.orders.clone() {
        let reply = loop {
            let reply = client.post("/v1/jobs").header("idempotency-key", &key).json(&body).send().await;
            // The first write after a crash of the database may be the one that finds its connection gone.
            if !known.is_without_database(&reply) {
                break reply;
            }
        };
        let id = id_of(&reply.json()).to_owned();
        match known.accepted.get(&key) {
            Some(before) => {
                reply.expect(200);
                assert_eq!(before, &id, "the accepted job of {key} was lost");
            }
            None => assert!(reply.status == 200 || reply.status == 201, "{}", reply.status),
        }
        known.accepted.insert(key, id);
    }
    assert_eq!(
        count_jobs(client).await,
        known.orders.len(),
        "a key has made two jobs, or a job came from nowhere"
    );
    let mut by_seed: HashMap<String, Vec<u8>> = HashMap::new();
    for id in known.accepted.values() {
        let mut job = client.finished(id).await;
        if job["state"] == "failed" {
            check_exhausted(&job);
            known.exhausted += 1;
            client.post(&format!("/v1/jobs/{id}/retry")).send().await.expect(200);
            job = client.finished(id).await;
        }
        assert_eq!(job["state"], "succeeded", "{job:#}");
        if let Some(before) = known.succeeded.get(id) {
            assert_eq!(&job, before, "a finished job changed");
        }
        check_artifact(data_dir, &job);
        let spheres = client.result_in(id, "npy").await.to_vec();
        let same = by_seed.entry(client.request_of(id).await.to_string()).or_insert_with(|| spheres.clone());
        assert!(*same == spheres, "the same request and seed gave two packings");
    }
}

/// The sweep at the next start leaves one file for each job, and no half-written one.
pub(crate) async fn swept(data_dir: &DataDir, known: &Known) {
    let server = Launch::new(data_dir).start().await;
    eventually("orphans to be swept", || data_dir.artifacts().len() == known.accepted.len()).await;
    eventually("checkpoints to go with their jobs", || data_dir.checkpoints().is_empty()).await;
    server.stop().await;
}

impl Known {
    /// What a client knows of servers whose database may be gone for a while.
    pub(crate) fn of_servers_with_a_database() -> Self {
        Self { loses_database: true, ..Self::default() }
    }

    /// Whether an answer says that the database is gone for the moment, where that may be.
    fn is_without_database(&self, reply: &Reply) -> bool {
        self.loses_database && reply.status == 503
    }

    pub(crate) fn print(&self, kills: usize) {
        println!(
            "{kills} faults: {} jobs, {} of them seen finished before a later one, {} retried when out of attempts",
            self.accepted.len(),
            self.succeeded.len(),
            self.exhausted
        );
    }
}

/// Few enough open jobs, with those that may have been taken, that each has a fair chance to end between two cuts.
const MOST_OPEN: usize = 8;

/// Orders jobs, some of them again, and looks at what has become of others, until it is dropped.
pub(crate) async fn order_and_watch(client: &Client, known: &mut Known, random: &mut Xoshiro256PlusPlus) {
    loop {
        let open: Vec<String> =
            known.accepted.values().filter(|id| !known.succeeded.contains_key(*id)).cloned().collect();
        let unanswered: Vec<usize> =
            (0..known.orders.len()).filter(|i| !known.accepted.contains_key(&known.orders[*i].0)).collect();
        let choice = random.next_u64() % 4;
        let number = random.next_u64() as usize;
        if open.is_empty() && unanswered.is_empty() || choice < 2 && open.len() + unanswered.len() < MOST_OPEN
        {
            let key = format!("order-{}", known.orders.len());
            let body = some_job(random);
            known.orders.push((key.clone(), body.clone()));
            order(client, known, &key, &body).await;
        } else if choice == 2 || open.is_empty() {
            // What was not answered first: without a database that is every order.
            let again = unanswered.first().copied().unwrap_or(number % known.orders.len());
            let (key, body) = known.orders[again].clone();
            order(client, known, &key, &body).await;
        } else {
            watch(client, known, &open[number % open.len()]).await;
        }
    }
}

/// The one way to fail here: a job that was running at as many cuts as it may be started.
fn check_exhausted(job: &Value) {
    assert_eq!(job["error"]["type"], "/problems/attempts-exhausted", "{job:#}");
    assert!(job["attempt"].as_u64() >= Some(ATTEMPTS), "{job:#}");
}

async fn watch(client: &Client, known: &mut Known, id: &str) {
    let request = client.get(&format!("/v1/jobs/{id}"));
    if let Ok(reply) = request.try_send().await {
        if known.is_without_database(&reply) {
            return;
        }
        let job = reply.expect(200).json();
        if job["state"] == "failed" {
            check_exhausted(&job);
            known.exhausted += 1;
            // It may be cut off as any request; then the job is found failed again.
            let retry = client.post(&format!("/v1/jobs/{id}/retry"));
            if let Ok(reply) = retry.try_send().await
                && !known.is_without_database(&reply)
            {
                reply.expect(200);
            }
        }
        if job["state"] == "succeeded" {
            known.succeeded.insert(id.to_owned(), job);
        }
    }
}

async fn order(client: &Client, known: &mut Known, key: &str, body: &Value) {
    let request = client.post("/v1/jobs").header("idempotency-key", key).json(body);
    // An error is the cut; then the client does not know whether its job was taken.
    if let Ok(reply) = request.try_send().await {
        if known.is_without_database(&reply) {
            return;
        }
        assert!(reply.status == 201 || reply.status == 200, "{}", reply.status);
        let id = id_of(&reply.json()).to_owned();
        let before = known.accepted.insert(key.to_owned(), id.clone());
        assert!(before.is_none_or(|before| before == id), "{key} made two jobs");
    }
}

/// Of three sizes, so that the cuts meet all phases: the largest writes two megabytes. One kind grows and goes on
/// from its checkpoints. Few seeds, so that
/// many jobs are the same and must give the same packing.
fn some_job(random: &mut Xoshiro256PlusPlus) -> Value {
    let seed = random.next_u64() % 3;
    let mut job = match random.next_u64() % 5 {
        0 | 1 => jobs::quick(seed),
        2 => jobs::equal_spheres(20_000, seed),
        3 => jobs::with(jobs::with(jobs::growth(), "/seed", json!(seed)), "/mix/volume_fraction", json!(0.5)),
        _ => jobs::equal_spheres(60_000, seed),
    };
    job["max_attempts"] = json!(ATTEMPTS);
    job
}

async fn count_jobs(client: &Client) -> usize {
    let (mut count, mut cursor) = (0, String::new());
    loop {
        let page = client.get(&format!("/v1/jobs?limit=100{cursor}")).send().await.expect(200).json();
        count += page["items"].as_array().unwrap().len();
        match page["next_cursor"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return count,
        }
    }
}

/// The stored file of a job is there once, with the length and the SHA-256 that the job tells.
fn check_artifact(data_dir: &DataDir, job: &Value) {
    let id = id_of(job);
    let files = data_dir.artifacts();
    let file = files.iter().find(|file| {
        let name = file.file_name().unwrap().to_string_lossy();
        name.contains(&format!("{id}.{}", job["attempt"])) && !name.contains("tmp")
    });
    let bytes = std::fs::read(file.unwrap_or_else(|| panic!("no file of {job:#} in {files:?}"))).unwrap();
    let mut sha256 = String::new();
    for byte in Sha256::digest(&bytes) {
        write!(sha256, "{byte:02x}").unwrap();
    }
    assert_eq!(job["result"]["sha256"], sha256, "the file of {id} is not what its checksum says");
    assert_eq!(job["result"]["bytes"], bytes.len());
}
