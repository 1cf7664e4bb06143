//! Workers in other processes: `packstone worker`, and what becomes of jobs when it, or the server, dies or stops.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use rustix::process::Signal;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use crate::harness::deadline::{eventually, patiently};
use crate::harness::{Client, DataDir, Launch, Running, Server, id_of, jobs, packstone};

/// A server that packs nothing itself, whose leases are short.
async fn server(data_dir: &DataDir) -> Server {
    launch(data_dir).start().await
}

fn launch(data_dir: &DataDir) -> Launch {
    Launch::new(data_dir).workers(0).env("PACKSTONE_LEASE_S", "3")
}

/// Starts a worker of a server.
fn worker(folder: &Path, server: &Server, name: &str, more: &[&str]) -> Running {
    let url = format!("http://{}", server.address());
    let args = ["worker", "--server", &url, "--name", name, "--slots", "1", "--checkpoint-every-s", "0.2"];
    Running::spawn(folder, &[&args[..], more].concat())
}

/// The packing of a job without a service, as the bytes of `npy`.
pub(crate) async fn packed_alone(folder: &Path, job: &Value) -> Vec<u8> {
    std::fs::write(folder.join("job.json"), job.to_string()).unwrap();
    let ended = packstone(folder, &["run", "job.json", "--out", "alone", "--format", "npy", "--force"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let found = std::fs::read_dir(folder.join("alone")).unwrap().map(|entry| entry.unwrap().path());
    let file = found.into_iter().find(|path| path.extension().is_some_and(|ending| ending == "npy")).unwrap();
    std::fs::read(file).unwrap()
}

/// A claim of a job by hand.
pub(crate) fn claim(id: &str, build: &Value) -> Value {
    json!({"claim": id, "worker": "by hand", "slots": 1, "build": build["build"], "bits": build["bits"]})
}

/// Build and bits of the server, as its version and a refusal tell them.
pub(crate) async fn build_of(client: &Client) -> Value {
    let version = packstone(Path::new("/"), &["--version"]).await.stdout;
    let build = version.trim().strip_prefix("packstone ").unwrap().to_owned();
    let body = json!({"claim": "x", "worker": "w", "slots": 1, "build": build, "bits": "none"});
    let refused = client.post("/v1/leases").json(&body).send().await.expect_problem(409, "worker-refused");
    let bits = refused["detail"].as_str().unwrap().rsplit('"').nth(1).unwrap().to_owned();
    assert_eq!(bits.len(), 64, "{refused:#}");
    json!({"build": build, "bits": bits})
}

#[tokio::test]
async fn jobs_and_studies_run_elsewhere_with_the_same_bits() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = server(&data_dir).await;
    let client = server.client();
    let one = worker(folder.path(), &server, "one", &["--idle-exit-s", "2"]);
    let two = worker(folder.path(), &server, "two", &["--idle-exit-s", "2"]);
    let ellipsoids = jobs::with(
        jobs::quick(3),
        "/mix/shape",
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.6}}),
    );
    let with_slice = jobs::with(
        jobs::quick_growth(1),
        "/postprocess",
        json!([{"type": "slice", "axis": "z", "at_mm": 20}]),
    );
    for job in [with_slice, jobs::quick(2), ellipsoids] {
        let done = client.succeed(&job).await;
        assert!(["one", "two"].contains(&done["worker"].as_str().unwrap()), "{done:#}");
        assert_eq!(done["progress"]["fraction"], 1.0);
        if !done["exports"].as_array().unwrap().is_empty() {
            let slice = format!("/v1/jobs/{}/exports/slice?axis=z&at_mm=20", id_of(&done));
            client.get(&slice).header("prefer", "wait=20").send().await.expect(200);
        }
        let bytes = client.result_in(id_of(&done), "npy").await;
        assert!(bytes == packed_alone(folder.path(), &job).await, "other bits than those of `packstone run`");
        assert!(client.result(id_of(&done)).await["summary"]["grains"].as_u64().unwrap() > 20);
    }
    let failed = client.submit(&jobs::unreachable()).await;
    let failed = client.finished(id_of(&failed)).await;
    assert_eq!(failed["error"]["type"], "/problems/target-not-reached", "{failed:#}");
    assert!(failed["error"]["placed"].as_u64().unwrap() > 100, "{failed:#}");
    let study = json!({
        "template": jobs::with(jobs::quick(1), "/seed", Value::Null), "replicates": 3, "seed": 5,
        "grid": {"/mix/volume_fraction": [0.2, 0.3]},
    });
    let study = client.submit_study(&study).await;
    client.study_finished(id_of(&study)).await;
    for row in client.table(id_of(&study)).await {
        assert_eq!(row["successes"], 3, "{row:#}");
        assert!(row["grains"].as_f64() > Some(10.0) && row["time_s_total"].as_f64() > Some(0.0), "{row:#}");
    }
    for worker in [one, two] {
        let ended = worker.ended().await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
    }
    assert_eq!(data_dir.checkpoints(), Vec::<String>::new());
    server.stop().await;
}

#[tokio::test]
async fn a_worker_that_is_asked_to_stop_leaves_its_job_where_it_was() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = server(&data_dir).await;
    let client = server.client();
    let first = worker(folder.path(), &server, "first", &[]);
    let job = jobs::growth();
    let submitted = client.submit(&job).await;
    let id = id_of(&submitted);
    client.job_when(id, "growing", |job| job["progress"]["step"] == "edmd").await;
    first.signal(Signal::TERM);
    let ended = first.ended().await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let waiting = client.job(id).await;
    assert_eq!((&waiting["state"], &waiting["worker"]), (&json!("queued"), &Value::Null), "{waiting:#}");
    assert_eq!((&waiting["attempt"], &waiting["max_attempts"]), (&json!(2), &json!(4)), "it did not count");
    assert_eq!(data_dir.checkpoints(), [format!("{id}.1.checkpoint")]);
    let second = worker(folder.path(), &server, "second", &[]);
    let done = client.finished(id).await;
    assert_eq!((&done["state"], &done["worker"]), (&json!("succeeded"), &json!("second")), "{done:#}");
    assert!(client.result_in(id, "npy").await == packed_alone(folder.path(), &job).await);
    second.signal(Signal::TERM);
    let log = second.ended().await.stderr;
    assert!(log.contains("going on from a checkpoint"), "{log}");
    eventually("the checkpoint to go", || data_dir.checkpoints().is_empty()).await;
    server.stop().await;
}

#[tokio::test]
async fn a_job_of_a_worker_that_was_killed_goes_on_from_what_it_had_sent() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = server(&data_dir).await;
    let client = server.client();
    let first = worker(folder.path(), &server, "first", &["--send-checkpoints-every-s", "0.2"]);
    let job = jobs::growth();
    let submitted = client.submit(&jobs::with(job.clone(), "/max_attempts", json!(1))).await;
    let id = id_of(&submitted);
    eventually("a checkpoint with the server", || !data_dir.checkpoints().is_empty()).await;
    first.signal(Signal::KILL);
    first.ended().await;
    let second = worker(folder.path(), &server, "second", &[]);
    let done = client.finished(id).await;
    assert_eq!((&done["state"], &done["worker"]), (&json!("succeeded"), &json!("second")), "{done:#}");
    assert_eq!(done["attempt"], 2, "an attempt that has kept a checkpoint does not count");
    assert!(client.result_in(id, "npy").await == packed_alone(folder.path(), &job).await);
    second.signal(Signal::TERM);
    assert!(second.ended().await.stderr.contains("going on from a checkpoint"));
    server.stop().await;
}

#[tokio::test]
async fn a_cancelled_job_stops_at_once_and_its_worker_takes_the_next() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let worker = worker(folder.path(), &server, "one", &[]);
    let submitted = client.submit(&jobs::endless()).await;
    let id = id_of(&submitted);
    client.running(id).await;
    let asked = std::time::Instant::now();
    client.post(&format!("/v1/jobs/{id}/cancel")).send().await.expect(202);
    assert_eq!(client.finished(id).await["state"], "cancelled");
    // A lease of a minute is renewed every 15 s: the cancellation did not wait for that.
    assert!(asked.elapsed() < Duration::from_secs(10), "{:?}", asked.elapsed());
    client.succeed(&jobs::quick(1)).await;
    let slow = jobs::with(jobs::endless(), "/timeout_s", json!(0.5));
    let slow = client.submit(&slow).await;
    let slow = client.finished(id_of(&slow)).await;
    assert_eq!(slow["error"]["type"], "/problems/timed-out", "{slow:#}");
    worker.signal(Signal::TERM);
    assert_eq!(worker.ended().await.code, Some(0));
    server.stop().await;
}

/// The forecast of a job.
async fn forecast_s(client: &Client, job: &Value) -> f64 {
    let plan = client.post("/v1/plans").json(job).send().await.expect(200).json();
    plan["estimated_time_s"].as_f64().unwrap()
}

#[tokio::test]
async fn a_worker_whose_time_is_limited_gets_what_it_can_end_or_hand_on() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = server(&data_dir).await;
    let client = server.client();
    let lost = jobs::with(jobs::endless(), "/specimen/size_mm", json!([130, 130, 130]));
    let (fits, long) = (jobs::quick(1), jobs::endless_growth());
    // More than what the workers below have left, a minute for their stop taken off.
    assert!(forecast_s(&client, &lost).await > 80.0 && forecast_s(&client, &long).await > 80.0);
    let lost = client.submit(&jobs::with(lost, "/priority", json!(100))).await;
    let fits = client.submit(&fits).await;
    let limited =
        |name, until| worker(folder.path(), &server, name, &["--until", until, "--idle-exit-s", "0.5"]);
    let short = limited("short", "80s").ended().await;
    assert_eq!(short.code, Some(0), "{short:?}");
    let asked = server.log().matches("path=\"/v1/leases\"").count();
    assert!((2..10).contains(&asked), "a request for jobs is held back for a second at least: {asked}");
    assert_eq!(client.finished(id_of(&fits)).await["state"], "succeeded");
    let waiting = client.job(id_of(&lost)).await;
    assert_eq!((&waiting["state"], &waiting["attempt"]), (&json!("queued"), &json!(1)), "{waiting:#}");

    // Longer than the time of any worker, and gone on with by one after another.
    let long = client.submit(&long).await;
    for attempt in 1..=2 {
        let pilot = limited("pilot", "140s");
        let growing = |job: &Value| job["attempt"] == attempt && job["progress"]["step"] == "edmd";
        client.job_when(id_of(&long), "growing", growing).await;
        pilot.signal(Signal::TERM);
        let ended = pilot.ended().await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
        assert_eq!(ended.stderr.contains("going on from a checkpoint"), attempt > 1, "{ended:?}");
        assert_eq!(client.job(id_of(&long)).await["state"], "queued");
    }
    let unlimited = worker(folder.path(), &server, "unlimited", &[]);
    client.running(id_of(&lost)).await;
    unlimited.signal(Signal::TERM);
    assert_eq!(unlimited.ended().await.code, Some(0));
    let mut wrong = claim("a", &build_of(&client).await);
    wrong["remaining_s"] = json!(-1);
    let refused = client.post("/v1/leases").json(&wrong).send().await.expect_problem(422, "validation-error");
    assert_eq!(refused["errors"][0]["pointer"], "/remaining_s", "{refused:#}");
    server.stop().await;
}

#[tokio::test]
async fn a_client_that_polls_sees_the_progress_of_a_job_elsewhere() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    // Leases of a minute: without a client that watches, a worker reports every 15 s.
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let worker = worker(folder.path(), &server, "one", &[]);
    let submitted = client.submit(&jobs::endless_growth()).await;
    let id = id_of(&submitted);
    client.running(id).await;
    let renewed = client.metric("packstone_leases_total{event=\"renewed\"}").await;
    let mut seen = std::collections::BTreeSet::new();
    patiently("the progress to be seen five times", async {
        let mut poll_again = tokio::time::interval(Duration::from_millis(200));
        while seen.len() < 5 {
            poll_again.tick().await;
            seen.insert(client.job(id).await["progress"].to_string());
        }
    })
    .await;
    let more = client.metric("packstone_leases_total{event=\"renewed\"}").await - renewed;
    // The worker is asked to report every second, however often a client polls.
    assert!((4.0..50.0).contains(&more), "{more} renewals");
    worker.signal(Signal::TERM);
    assert_eq!(worker.ended().await.code, Some(0));
    server.stop().await;
}

#[tokio::test]
async fn a_server_that_dies_costs_its_workers_nothing() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    // Longer than a start takes on a machine that has other work: a lease cannot be renewed before.
    let launch = || launch(&data_dir).env("PACKSTONE_LEASE_S", "30");
    let server = launch().start().await;
    let address = server.address().to_string();
    let worker = worker(folder.path(), &server, "one", &[]);
    let job = jobs::growth();
    let submitted = server.client().submit(&job).await;
    let id = id_of(&submitted).to_owned();
    server.client().job_when(&id, "growing", |job| job["progress"]["step"] == "edmd").await;
    server.kill().await;
    let server = launch().listen(&address).start().await;
    let client = server.client();
    let done = client.finished(&id).await;
    assert_eq!((&done["state"], &done["attempt"]), (&json!("succeeded"), &json!(1)), "{done:#}");
    assert!(client.result_in(&id, "npy").await == packed_alone(folder.path(), &job).await);
    worker.signal(Signal::TERM);
    assert_eq!(worker.ended().await.code, Some(0));
    server.stop().await;
}

#[tokio::test]
async fn a_worker_that_slept_past_its_lease_changes_nothing() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = server(&data_dir).await;
    let client = server.client();
    let sleeper = worker(folder.path(), &server, "sleeper", &[]);
    let job = jobs::growth();
    let submitted = client.submit(&job).await;
    let id = id_of(&submitted);
    client.job_when(id, "growing", |job| job["progress"]["step"] == "edmd").await;
    sleeper.signal(Signal::STOP);
    client.job_when(id, "given to another", |job| job["attempt"] == 2).await;
    let other = worker(folder.path(), &server, "other", &[]);
    client.job_when(id, "running elsewhere", |job| job["worker"] == "other").await;
    assert_eq!(client.metric("packstone_jobs_running{place=\"worker\"}").await, 1.0);
    assert_eq!(client.metric("packstone_jobs_running{place=\"server\"}").await, 0.0);
    sleeper.signal(Signal::CONT);
    let done = client.finished(id).await;
    assert_eq!((&done["worker"], &done["attempt"]), (&json!("other"), &json!(2)), "{done:#}");
    assert!(client.result_in(id, "npy").await == packed_alone(folder.path(), &job).await);
    assert_eq!(data_dir.artifacts().len(), 1, "the first attempt left nothing");
    let refused = client.metric("packstone_leases_total{event=\"refused\"}").await;
    assert!(refused >= 1.0, "the first worker has learned that its lease is lost");
    for (name, value) in [
        ("packstone_leases_total{event=\"taken\"}", 2.0),
        ("packstone_leases_total{event=\"expired\"}", 1.0),
        ("packstone_worker_processes", 2.0),
        ("packstone_jobs_running{place=\"worker\"}", 0.0),
    ] {
        assert_eq!(client.metric(name).await, value, "{name}");
    }
    for worker in [sleeper, other] {
        worker.signal(Signal::TERM);
        assert_eq!(worker.ended().await.code, Some(0));
    }
    server.stop().await;
}

#[tokio::test]
async fn requests_may_be_repeated_and_nothing_but_the_result_is_taken() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let build = build_of(&client).await;
    client.post("/v1/leases").json(&claim("none", &build)).send().await.expect(204);
    let submitted = client.submit(&jobs::with(jobs::quick(1), "/timeout_s", json!(0.01))).await;
    let id = id_of(&submitted);
    // The room on the disk may change between two answers.
    let leased = async || {
        let mut leased = client.post("/v1/leases").json(&claim("a", &build)).send().await.expect(200).json();
        assert!(leased["leases"][0]["room_bytes"].take().is_number(), "{leased}");
        leased
    };
    let first = leased().await;
    assert_eq!(first["leases"][0]["job"], id);
    assert_eq!(leased().await, first, "the answer was lost");
    client.post("/v1/leases").json(&claim("b", &build)).send().await.expect(204);
    let lease = format!("/v1/leases/{id}/1");
    let renewals = json!({"renewals": [{"task": id, "attempt": 1}, {"task": id, "attempt": 2}]});
    let renewed = client.post("/v1/leases/renewals").json(&renewals).send().await.expect(200).json();
    let states = [0, 1].map(|i| renewed["leases"][i]["state"].clone());
    assert_eq!(states, ["running", "lost"]);
    // Files that were damaged on their way may be sent again.
    for body in [b"nonsense".to_vec(), Vec::new()] {
        let put = |target: String| client.request(reqwest::Method::PUT, &target).body(body.clone());
        let refused = put(format!("{lease}/result?sha256={}", "0".repeat(64))).send().await;
        assert!(
            refused.expect_problem(400, "validation-error")["detail"].as_str().unwrap().contains("sha256")
        );
        put(format!("{lease}/result")).send().await.expect_problem(400, "validation-error");
    }
    assert_eq!(client.job(id).await["state"], "running");
    assert_eq!(data_dir.artifacts(), Vec::<std::path::PathBuf>::new(), "nothing is left of them");
    // A checkpoint ends with the CRC-32 of what came before.
    let mut whole = b"PACKSTCK and a state".to_vec();
    whole.extend(crc32fast::hash(&whole).to_le_bytes());
    let checkpoint = format!("{lease}/checkpoint");
    let put = |body: &[u8]| client.request(reqwest::Method::PUT, &checkpoint).body(body.to_vec());
    put(&whole).send().await.expect(204);
    for at in 0..whole.len() {
        let mut damaged = whole.clone();
        damaged[at] ^= 1;
        let refused = put(&damaged).send().await.expect_problem(400, "validation-error");
        assert!(refused["detail"].as_str().unwrap().contains("checkpoint"), "{refused}");
    }
    assert_eq!(client.get(&checkpoint).send().await.expect(200).body, whole, "the whole one is kept");
    // One that is damaged where it lies is not given out.
    let name = format!("checkpoints/{}", data_dir.checkpoints()[0]);
    let mut damaged = whole.clone();
    damaged[10] ^= 1;
    std::fs::write(data_dir.path().join(name), damaged).unwrap();
    client.get(&checkpoint).send().await.expect_problem(404, "not-found");
    put(&whole).send().await.expect(204);
    // Its end, twice; and what comes too late.
    let failure = json!({"code": "timed-out", "detail": "it took too long"});
    let end = json!({"outcome": "failed", "failure": failure, "facts": {"time_s": 1.5}});
    for _ in 0..2 {
        let ended = client.post(&format!("{lease}/end")).json(&end).send().await.expect(200).json();
        assert_eq!(ended["state"], "recorded");
    }
    assert_eq!(client.job(id).await["error"]["type"], "/problems/timed-out");
    client.post(&format!("/v1/jobs/{id}/retry")).send().await.expect(200);
    let late = client.post(&format!("{lease}/end")).json(&end).send().await;
    late.expect_problem(409, "lease-lost");
    let unnamed = client.post("/v1/leases/none/1/end").json(&end).send().await;
    unnamed.expect_problem(404, "not-found");
    server.stop().await;
}

/// What a worker would send as the result of a job: the file of the same packing, with the ID of that job.
pub(crate) fn with_id(file: &[u8], packed: &str, id: &str) -> Vec<u8> {
    let mut file = file.to_vec();
    let at =
        file.windows(packed.len()).position(|bytes| bytes == packed.as_bytes()).expect("the ID of the job");
    file[at..at + id.len()].copy_from_slice(id.as_bytes());
    let end = file.len() - 4;
    let sum = crc32fast::hash(&file[..end]).to_le_bytes();
    file[end..].copy_from_slice(&sum);
    file
}

/// A file that nobody records would stay until the sweeper finds it.
#[tokio::test]
async fn a_result_counts_although_its_worker_went_before_the_answer() {
    let (data_dir, other) = (DataDir::new(), DataDir::new());
    let packing = Launch::new(&other).start().await;
    let packed = packing.client().succeed(&jobs::equal_spheres(20_000, 1)).await;
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let build = build_of(&client).await;
    let submitted = client.submit(&jobs::equal_spheres(20_000, 1)).await;
    let id = id_of(&submitted);
    client.post("/v1/leases").json(&claim("a", &build)).send().await.expect(200);
    let file = with_id(&std::fs::read(&other.artifacts()[0]).unwrap(), id_of(&packed), id);
    let head = format!(
        "PUT /v1/leases/{id}/1/result?sha256={} HTTP/1.1\r\nhost: {}\r\ncontent-length: {}\r\n\r\n",
        sha256(&file),
        server.address(),
        file.len()
    );
    let mut connection = std::net::TcpStream::connect(server.address()).unwrap();
    connection.write_all(head.as_bytes()).unwrap();
    connection.write_all(&file).unwrap();
    drop(connection);
    let done = client.finished(id).await;
    assert_eq!((&done["state"], &done["attempt"]), (&json!("succeeded"), &json!(1)), "{done:#}");
    assert_eq!(data_dir.artifacts().len(), 1);
    server.stop().await;
    packing.stop().await;
}

/// A worker that lost its connection sends its result again, while the first request may still be under way.
#[tokio::test]
async fn a_result_that_is_sent_many_times_at_once_is_kept() {
    let (data_dir, other) = (DataDir::new(), DataDir::new());
    let packing = Launch::new(&other).start().await;
    let packed = packing.client().succeed(&jobs::quick(1)).await;
    let file = std::fs::read(&other.artifacts()[0]).unwrap();
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let build = build_of(&client).await;
    for round in 0..20 {
        let submitted = client.submit(&jobs::quick(1)).await;
        let id = id_of(&submitted);
        client.post("/v1/leases").json(&claim(&round.to_string(), &build)).send().await.expect(200);
        let file = with_id(&file, id_of(&packed), id);
        let target = format!("/v1/leases/{id}/1/result?sha256={}", sha256(&file));
        let put = || client.request(reqwest::Method::PUT, &target).body(file.clone()).send();
        let statuses: Vec<u16> = futures_util::future::join_all((0..24).map(|_| put()))
            .await
            .iter()
            .map(|reply| reply.status.as_u16())
            .collect();
        assert!(
            statuses.contains(&200) && statuses.iter().all(|status| [200, 503].contains(status)),
            "{statuses:?}"
        );
        let done = client.finished(id).await;
        assert_eq!((&done["state"], &done["attempt"]), (&json!("succeeded"), &json!(1)), "{done:#}");
        assert!(
            client.get(&format!("/v1/jobs/{id}/result?format=npy")).send().await.status == 200,
            "{statuses:?}"
        );
    }
    assert_eq!(data_dir.artifacts().len(), 20);
    server.stop().await;
    packing.stop().await;
}

#[tokio::test]
async fn only_workers_of_the_same_build_with_a_key_get_jobs() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let mut lines = String::new();
    let mut keys = Vec::new();
    for (name, role) in [("root", "admin"), ("cluster", "worker"), ("other", "worker"), ("lab", "submit")] {
        let made = packstone(folder.path(), &["key", name, "--role", role]).await;
        let mut printed = made.stdout.lines();
        keys.push(printed.next().unwrap().to_owned());
        lines += printed.next().unwrap();
        lines += "\n";
        std::fs::write(folder.path().join(name), keys.last().unwrap()).unwrap();
    }
    let file = folder.path().join("keys");
    std::fs::write(&file, lines).unwrap();
    let server = Launch::new(&data_dir)
        .workers(0)
        .env("PACKSTONE_API_KEYS_FILE", file.to_str().unwrap())
        .start()
        .await;
    let [root, cluster, other, lab] = [0, 1, 2, 3].map(|i| server.client().with_key(&keys[i]));
    for (key, told) in [(None, "401"), (Some("lab"), "403"), (Some("root"), "")] {
        let args = key.map_or(Vec::new(), |key| vec!["--key-file", key]);
        let args = [&args[..], &["--idle-exit-s", "0.5"]].concat();
        let ended = worker(folder.path(), &server, "w", &args).ended().await;
        let expected = if told.is_empty() { 0 } else { 8 };
        assert_eq!(ended.code, Some(expected), "{ended:?}");
        assert!(ended.stderr.contains(told), "{ended:?}");
    }
    let build = build_of(&root).await;
    let mut wrong = claim("a", &build);
    wrong["build"] = json!("0.0.1 (abc)");
    let refused = cluster.post("/v1/leases").json(&wrong).send().await.expect_problem(409, "worker-refused");
    assert!(refused["detail"].as_str().unwrap().contains("0.0.1 (abc)"), "{refused:#}");
    assert_eq!(root.metric("packstone_workers_refused_total").await, 2.0);
    // A worker may work, and look at its key; nothing else.
    let job = lab.submit(&jobs::quick(1)).await;
    let id = id_of(&job);
    cluster.get("/v1/key").send().await.expect(200);
    for target in ["/v1/jobs", &format!("/v1/jobs/{id}"), "/metrics", "/v1/studies"] {
        cluster.get(target).send().await.expect_problem(403, "forbidden");
    }
    cluster.post("/v1/jobs").json(&jobs::quick(2)).send().await.expect_problem(403, "forbidden");
    lab.post("/v1/leases").json(&claim("a", &build)).send().await.expect_problem(403, "forbidden");
    cluster.post("/v1/leases").json(&claim("a", &build)).send().await.expect(200);
    // A lease belongs to the key that got it.
    let end = json!({"outcome": "released"});
    let path = format!("/v1/leases/{id}/1/end");
    other.post(&path).json(&end).send().await.expect_problem(409, "lease-lost");
    assert_eq!(lab.job(id).await["worker"], "by hand");
    cluster.post(&path).json(&end).send().await.expect(200);
    assert_eq!(lab.job(id).await["state"], "queued");
    server.stop().await;
}

#[tokio::test]
async fn a_worker_goes_on_with_the_key_that_its_file_has_after_a_rotation() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let mut made = Vec::new();
    // The new key has the name of the old one: the lease of a job belongs to it.
    for (name, role) in [("root", "admin"), ("cluster", "worker"), ("cluster", "worker")] {
        let printed = packstone(folder.path(), &["key", name, "--role", role]).await.stdout;
        let (key, line) = printed.split_once('\n').unwrap();
        made.push((key.to_owned(), line.to_owned()));
    }
    let at = |name: &str| folder.path().join(name);
    // Both files are replaced in one step.
    let put = |name: &str, text: String| {
        std::fs::write(at("new"), text).unwrap();
        std::fs::rename(at("new"), at(name)).unwrap();
    };
    put("keys", format!("{}{}", made[0].1, made[1].1));
    put("key", made[1].0.clone());
    let server = Launch::new(&data_dir)
        .workers(0)
        .env("PACKSTONE_API_KEYS_FILE", at("keys").to_str().unwrap())
        .start()
        .await;
    let root = server.client().with_key(&made[0].0);
    let worker = worker(folder.path(), &server, "w", &["--key-file", "key"]);
    let job = root.submit(&jobs::endless_growth()).await;
    root.running(id_of(&job)).await;
    put("key", made[2].0.clone());
    put("keys", format!("{}{}", made[0].1, made[2].1));
    let old = server.client().with_key(&made[1].0);
    let refused = async { while old.get("/v1/key").send().await.status.as_u16() != 401 {} };
    patiently("the old key to be refused", refused).await;
    // The worker learns of it by an answer to the new key.
    root.post(&format!("/v1/jobs/{}/cancel", id_of(&job))).send().await.expect(202);
    let ended = root.finished(id_of(&job)).await;
    assert_eq!((&ended["state"], &ended["attempt"]), (&json!("cancelled"), &json!(1)), "{ended:#}");
    worker.signal(Signal::TERM);
    let ended = worker.ended().await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(ended.stderr.contains("the file has another one now"), "{ended:?}");
    server.stop().await;
}

pub(crate) fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").unwrap();
        text
    })
}
