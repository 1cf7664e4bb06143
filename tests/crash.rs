//! The power cut: `kill -9` at random moments while jobs are submitted, run and written.
//!
//! What was answered with 201 must be there afterwards; what was seen as finished must stay as it
//! was seen; every stored result must be the bytes that its checksum promises. The moments are
//! drawn from a seeded generator, so that a failure can be run again.

use std::collections::{BTreeMap, HashMap};
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use rustix::process::Signal;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::harness::deadline::eventually;
use crate::harness::machine::{Network, faketime};
use crate::harness::{
    Client, DataDir, Launch, Postgres, Reply, Running, holds_every_store, id_of, jobs, packstone,
};

#[tokio::test]
async fn fifteen_power_cuts_lose_nothing() {
    survive(15, 1).await;
}

#[tokio::test]
#[ignore = "long: cargo test --release -p packstone-server --test e2e a_thousand -- --ignored"]
async fn a_thousand_power_cuts_lose_nothing() {
    survive(1000, 2).await;
}

#[tokio::test]
async fn kills_of_workers_and_server_lose_nothing() {
    if holds_every_store() {
        return;
    }
    survive_elsewhere(15, 3, &KILLS, None).await;
}

#[tokio::test]
async fn kills_sleep_cut_links_and_wrong_clocks_lose_nothing() {
    if holds_every_store() {
        return;
    }
    let (Some(network), Some(library)) = (Network::make(), faketime()) else { return };
    survive_elsewhere(30, 5, &ALL_FAULTS, Some((network, library))).await;
}

#[tokio::test]
#[ignore = "long: cargo test --release -p packstone-server --test e2e five_hundred -- --ignored"]
async fn five_hundred_kills_of_workers_and_server_lose_nothing() {
    survive_elsewhere(500, 4, &KILLS, None).await;
}

#[tokio::test]
#[ignore = "long: cargo test --release -p packstone-server --test e2e five_hundred -- --ignored"]
async fn five_hundred_faults_of_all_kinds_lose_nothing() {
    let (Some(network), Some(library)) = (Network::make(), faketime()) else { return };
    survive_elsewhere(500, 6, &ALL_FAULTS, Some((network, library))).await;
}

#[tokio::test]
async fn kills_of_servers_and_their_database_lose_nothing() {
    survive_together(15, 5).await;
}

#[tokio::test]
#[ignore = "long: cargo test --release -p packstone-server --features postgres --test e2e five_hundred -- --ignored"]
async fn five_hundred_kills_of_servers_and_their_database_lose_nothing() {
    survive_together(500, 6).await;
}

/// As many as a job may ask for: one that takes long meets several cuts.
const ATTEMPTS: u64 = 10;

/// What the client knows.
#[derive(Default)]
struct Known {
    /// Idempotency keys with their bodies; a key may or may not have made a job so far.
    orders: Vec<(String, Value)>,
    /// Jobs that were answered with 201 or 200, by key.
    accepted: HashMap<String, String>,
    /// Jobs that were seen succeeded, by id.
    succeeded: HashMap<String, Value>,
    /// How often a job was found out of attempts, and retried.
    exhausted: usize,
    /// A server lives on while its database is gone, and says so: to the client that is a cut too.
    loses_database: bool,
    /// Faults by kind.
    faults: BTreeMap<&'static str, usize>,
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

/// What may befall the server and two workers in other processes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Fault {
    KillWorker(usize),
    KillServer,
    /// It sleeps past its lease.
    Sleep(usize),
    /// The link of the second worker goes down, until the lease has run out.
    LinkDown,
}

const KILLS: [Fault; 3] = [Fault::KillWorker(0), Fault::KillWorker(1), Fault::KillServer];
const ALL_FAULTS: [Fault; 6] =
    [KILLS[0], KILLS[1], KILLS[2], Fault::Sleep(0), Fault::Sleep(1), Fault::LinkDown];
/// For how many moments, of 0.3 s in the mean, a worker sleeps or a link is down: longer than a lease of 2 s.
const MOMENTS: usize = 10;

/// The same with the server and two workers in other processes. With a network, the second worker is in it, and the
/// clock of the first is wrong.
async fn survive_elsewhere(moments: usize, seed: u64, faults: &[Fault], network: Option<(Network, PathBuf)>) {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let launch = || Launch::new(&data_dir).workers(0).env("PACKSTONE_LEASE_S", "2").args(&["--insecure"]);
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut known = Known::default();
    let listen = network.as_ref().map_or("127.0.0.1", |(network, _)| network.address());
    let mut server = launch().listen(&format!("{listen}:0")).start().await;
    let address = server.address().to_string();
    let url = format!("http://{address}");
    let names = ["one", "two"];
    let worker = |index: usize| {
        let program = env!("CARGO_BIN_EXE_packstone");
        let mut command = match &network {
            Some((network, _)) if index == 1 => network.command(program),
            _ => Command::new(program),
        };
        if let Some((_, library)) = network.as_ref().filter(|_| index == 0) {
            command.env("LD_PRELOAD", library).env("FAKETIME", "-9h x1.3");
        }
        command.args(["worker", "--server", &url, "--slots", "2", "--name", names[index]]);
        command.args([
            "--scratch",
            names[index],
            "--checkpoint-every-s",
            "0",
            "--send-checkpoints-every-s",
            "0.1",
        ]);
        command.current_dir(folder.path());
        Running::of(command)
    };
    let mut workers = [0, 1].map(worker).map(Some);
    // What the server and the workers said, and the moments at which sleepers wake and the link is up again.
    let mut said = Vec::new();
    let (mut wake, mut link_up) = ([None; 2], None);
    for moment in 0..moments {
        let pause = Duration::from_micros(random.next_u64() % 600_000);
        let client = server.client();
        tokio::select! {
            () = order_and_watch(&client, &mut known, &mut random) => unreachable!("a client goes on for ever"),
            () = tokio::time::sleep(pause) => {}
        }
        for (wake, worker) in wake.iter_mut().zip(&workers) {
            if wake.take_if(|at| *at == moment).is_some() {
                worker.as_ref().expect("a worker").signal(Signal::CONT);
            }
        }
        if let Some((network, _)) = network.as_ref().filter(|_| link_up == Some(moment)) {
            network.link(true);
            link_up = None;
        }
        let fault = faults[random.next_u64() as usize % faults.len()];
        // Few would wake if those who sleep or are cut off could be met by another fault.
        let is_spared = match fault {
            Fault::KillWorker(index) | Fault::Sleep(index) => {
                wake[index].is_some() || (index == 1 && link_up.is_some())
            }
            Fault::LinkDown => wake[1].is_some() || link_up.is_some(),
            Fault::KillServer => false,
        };
        if is_spared {
            continue;
        }
        *known.faults.entry(fault.name()).or_default() += 1;
        match fault {
            Fault::KillServer => {
                said.push(server.log());
                server.kill().await;
                server = launch().listen(&address).start().await;
            }
            Fault::KillWorker(index) => {
                let killed = workers[index].take().expect("a worker");
                killed.signal(Signal::KILL);
                said.push(killed.ended().await.stderr);
                workers[index] = Some(worker(index));
                wake[index] = None;
            }
            Fault::Sleep(index) => {
                workers[index].as_ref().expect("a worker").signal(Signal::STOP);
                wake[index] = Some(moment + MOMENTS);
            }
            Fault::LinkDown => {
                network.as_ref().expect("a network").0.link(false);
                link_up = Some(moment + MOMENTS);
            }
        }
    }
    for worker in workers.iter().flatten() {
        worker.signal(Signal::CONT);
    }
    if let Some((network, _)) = &network {
        network.link(true);
    }
    account(&server.client(), &data_dir, &mut known).await;
    for worker in workers.into_iter().flatten() {
        worker.signal(Signal::TERM);
        let ended = worker.ended().await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
        said.push(ended.stderr);
    }
    said.push(server.log());
    let ends = check_ends(&server.client(), &known, &said).await;
    server.stop().await;
    let path = data_dir.path().display().to_string();
    let checked = packstone(folder.path(), &["check", &path]).await;
    assert_eq!(checked.code, Some(0), "{checked:?}");
    swept(&data_dir, &known).await;
    let told = |text: &str| said.iter().map(|log| log.matches(text).count()).sum::<usize>();
    let (out, lost) =
        (told("leases ran out; the jobs wait"), told("the lease was lost; this attempt leaves no"));
    println!("{:?}: {ends} ends in the logs, {out} times leases ran out, {lost} late ends", known.faults);
    // By chance a few faults meet no job; many do.
    assert!(moments < 300 || (out > 0 && lost > 0), "no lease was lost");
    known.print(moments);
}

impl Fault {
    fn name(self) -> &'static str {
        match self {
            Self::KillWorker(_) => "killed workers",
            Self::KillServer => "killed servers",
            Self::Sleep(_) => "workers asleep",
            Self::LinkDown => "links down",
        }
    }
}

/// Holds what the server and the workers said against the jobs as they are: each succeeded once, by its last attempt.
/// Whoever was killed may have said less than it did. The metrics count the jobs that there are. Returns the ends that
/// were told.
async fn check_ends(client: &Client, known: &Known, said: &[String]) -> usize {
    let mut ended: HashMap<(&str, String), Vec<String>> = HashMap::new();
    for line in said.iter().flat_map(|log| log.lines()) {
        // `ended` is said by a worker, `a lease ended` by the server.
        let who = if line.contains(" a lease ended ") {
            "the server"
        } else if line.contains(": ended outcome") {
            "a worker"
        } else {
            continue;
        };
        let field = |name: &str| {
            let (_, rest) =
                line.split_once(&format!("{name}=")).unwrap_or_else(|| panic!("no {name} in {line}"));
            rest.split([' ', '}']).next().unwrap().trim_matches('"').to_owned()
        };
        if field("outcome") == "succeeded" {
            ended.entry((who, field("job_id"))).or_default().push(field("attempt"));
        }
    }
    for ((who, id), attempts) in &ended {
        let job = client.job(id).await;
        assert_eq!(attempts, &[job["attempt"].to_string()], "{who} told other ends of {job:#}");
    }
    assert!(ended.keys().all(|(_, id)| known.accepted.values().any(|known| known == id)), "{ended:?}");
    assert_eq!(client.metric("packstone_jobs{state=\"succeeded\"}").await, known.accepted.len() as f64);
    for state in ["queued", "running", "failed", "cancelled"] {
        assert_eq!(client.metric(&format!("packstone_jobs{{state=\"{state}\"}}")).await, 0.0, "{state}");
    }
    ended.len()
}

/// The same with two servers that share a database and a folder of results, any of which may be killed at any moment.
async fn survive_together(kills: usize, seed: u64) {
    let Some(postgres) = Postgres::start() else { return };
    let (store, shared) = (postgres.database("lab"), DataDir::new());
    let data_dirs = [DataDir::new(), DataDir::new()];
    let args = ["--store", &store, "--blobs", shared.path().to_str().unwrap(), "--lease-s", "2"];
    let often = ["--checkpoint-every-s", "0", "--sweep-interval-s", "0.5", "--least-blob-age-s", "5"];
    let launch = |which: usize| Launch::new(&data_dirs[which]).args(&args).args(&often);
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut known = Known { loses_database: true, ..Known::default() };
    let mut servers = [launch(0).start().await, launch(1).start().await];
    for _ in 0..kills {
        let moment = Duration::from_micros(random.next_u64() % 600_000);
        let client = servers[random.next_u64() as usize % 2].client();
        tokio::select! {
            () = order_and_watch(&client, &mut known, &mut random) => unreachable!("a client goes on for ever"),
            () = tokio::time::sleep(moment) => {}
        }
        match random.next_u64() % 3 {
            2 => {
                postgres.crash();
                // The servers are without it for a while.
                tokio::select! {
                    () = order_and_watch(&client, &mut known, &mut random) => unreachable!("as above"),
                    () = tokio::time::sleep(moment) => {}
                }
                postgres.up();
            }
            i => {
                let which = i as usize;
                let address = servers[which].address().to_string();
                let [one, two] = servers;
                let (killed, other) = if which == 0 { (one, two) } else { (two, one) };
                killed.kill().await;
                let successor = launch(which).listen(&address).start().await;
                servers = if which == 0 { [successor, other] } else { [other, successor] };
            }
        }
    }
    account(&servers[0].client(), &shared, &mut known).await;
    eventually("orphans to be swept", || shared.artifacts().len() == known.accepted.len()).await;
    for server in servers {
        server.stop().await;
    }
    let counted = postgres.ask("lab", "select sum(jobs) from job_counts");
    assert_eq!(counted, postgres.ask("lab", "select count(*) from jobs"));
    let succeeded =
        "select count(*) from jobs join artifacts on artifacts.job = jobs.seq where state = 'succeeded'";
    assert_eq!(postgres.ask("lab", succeeded), counted);
    known.print(kills);
}

/// Calls each job to account: every order has made one job, which ends with a result that is stored as it was, and the
/// same as that of every other job of the same request.
async fn account(client: &Client, data_dir: &DataDir, known: &mut Known) {
    for (key, body) in known.orders.clone() {
        let reply = client.post("/v1/jobs").header("idempotency-key", &key).json(&body).send().await;
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
async fn swept(data_dir: &DataDir, known: &Known) {
    let server = Launch::new(data_dir).start().await;
    eventually("orphans to be swept", || data_dir.artifacts().len() == known.accepted.len()).await;
    eventually("checkpoints to go with their jobs", || data_dir.checkpoints().is_empty()).await;
    server.stop().await;
}

impl Known {
    /// Whether an answer says that the database is gone for the moment, where that may be.
    fn is_without_database(&self, reply: &Reply) -> bool {
        self.loses_database && reply.status == 503
    }

    fn print(&self, kills: usize) {
        println!(
            "{kills} kills: {} jobs, {} of them seen finished before a later kill, {} retried when out of attempts",
            self.accepted.len(),
            self.succeeded.len(),
            self.exhausted
        );
    }
}

/// Few enough open jobs that each has a fair chance to end between two cuts.
const MOST_OPEN: usize = 12;

/// Orders jobs, some of them again, and looks at what has become of others, until it is dropped.
async fn order_and_watch(client: &Client, known: &mut Known, random: &mut Xoshiro256PlusPlus) {
    loop {
        let open: Vec<String> =
            known.accepted.values().filter(|id| !known.succeeded.contains_key(*id)).cloned().collect();
        let choice = random.next_u64() % 4;
        if open.is_empty() || (choice < 2 && open.len() < MOST_OPEN) {
            let key = format!("order-{}", known.orders.len());
            let body = some_job(random);
            known.orders.push((key.clone(), body.clone()));
            order(client, known, &key, &body).await;
        } else if choice == 2 {
            let (key, body) = known.orders[random.next_u64() as usize % known.orders.len()].clone();
            order(client, known, &key, &body).await;
        } else {
            watch(client, known, &open[random.next_u64() as usize % open.len()]).await;
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
