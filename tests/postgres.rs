//! The store in PostgreSQL: what several servers on one database do, and what a crash of the database does. The rest of
//! the suite runs on it where `PACKSTONE_TEST_POSTGRES` names one.

use std::fs;
use std::path::Path;
use std::time::Duration;

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::deadline::{eventually, within};
use crate::harness::{Client, DataDir, Launch, Postgres, Running, Server, id_of, jobs, packstone};
use crate::webhooks::{Receiver, Secret, webhook_of, with_url};

/// The service answers so long after its database does.
const BACK_WITHIN: Duration = Duration::from_secs(10);

/// A server on the database `lab` that takes jobs of a server that died after 3 s.
fn launch(postgres: &Postgres, data_dir: &DataDir) -> Launch {
    Launch::new(data_dir).args(&["--store", &postgres.database("lab"), "--lease-s", "3"])
}

async fn start(postgres: &Postgres, data_dir: &DataDir) -> Server {
    launch(postgres, data_dir).start().await
}

/// Cuts a byte off a result below a folder; its path in the database.
fn cut_a_result(folder: &Path) -> String {
    let artifacts = folder.join("artifacts");
    let fan = fs::read_dir(&artifacts).unwrap().next().unwrap().unwrap().path();
    let file = fs::read_dir(fan).unwrap().next().unwrap().unwrap().path();
    let length = file.metadata().unwrap().len();
    fs::File::options().write(true).open(&file).unwrap().set_len(length - 1).unwrap();
    file.strip_prefix(artifacts).unwrap().to_str().unwrap().to_owned()
}

/// How many jobs the store counts in each state, as lines.
fn counts(postgres: &Postgres) -> String {
    postgres.ask("lab", "select state, jobs from job_counts where jobs > 0 order by state")
}

/// Submits again and again until the job is accepted, and each refusal says that it is for a while.
async fn submitted_at_last(client: &Client, job: &Value) -> Value {
    loop {
        let reply = client.post("/v1/jobs").json(job).send().await;
        if reply.status.as_u16() == 201 {
            return reply.json();
        }
        assert!([503, 507].contains(&reply.status.as_u16()), "{:?}", reply.body);
        assert!(reply.header("retry-after").parse::<u64>().unwrap() >= 1);
    }
}

#[tokio::test]
async fn a_crash_of_the_database_is_survived_without_a_restart() {
    let Some(postgres) = Postgres::start() else { return };
    let data_dir = DataDir::new();
    let server = start(&postgres, &data_dir).await;
    let client = server.client();
    let before = client.succeed(&jobs::quick(1)).await;
    let running = client.submit(&jobs::endless()).await;
    client.running(id_of(&running)).await;
    postgres.crash();
    let refused = client.post("/v1/jobs").json(&jobs::quick(2)).send().await;
    refused.expect(503);
    assert!(refused.header("retry-after").parse::<u64>().is_ok());
    client.get("/readyz").send().await.expect(503);
    client.get("/healthz").send().await.expect(200);
    postgres.up();
    let job = jobs::quick(2);
    let back = submitted_at_last(&client, &job);
    let after = within(BACK_WITHIN, "the service to be back", back).await;
    assert_eq!(client.job(id_of(&before)).await["state"], "succeeded");
    // The attempt that ran through it has its lease still, or another one has the job.
    client.running(id_of(&running)).await;
    client.post(&format!("/v1/jobs/{}/cancel", id_of(&running))).send().await.expect(202);
    assert_eq!(client.finished(id_of(&running)).await["state"], "cancelled");
    assert_eq!(client.finished(id_of(&after)).await["state"], "succeeded");
    client.get("/readyz").send().await.expect(200);
    server.stop().await;
    assert_eq!(counts(&postgres), "cancelled|1\nsucceeded|2");
}

#[tokio::test]
async fn a_connection_to_the_database_can_be_encrypted_and_its_certificate_demanded() {
    let Some(postgres) = Postgres::start() else { return };
    let url = postgres.restarted_with_tls("lab");
    let certificate = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data/tls/certificate.pem");
    for (parameters, is_served) in [
        // By default the connection is encrypted, because the database offers it; this one takes no others.
        (String::new(), true),
        (format!("?sslmode=verify-ca&sslrootcert={certificate}"), true),
        ("?sslmode=disable".to_owned(), false),
        // The authorities of the system know nothing of this certificate.
        ("?sslmode=verify-full".to_owned(), false),
    ] {
        let (data_dir, store) = (DataDir::new(), format!("{url}{parameters}"));
        let launch = Launch::new(&data_dir).args(&["--store", &store]);
        if is_served {
            let server = launch.start().await;
            server.client().succeed(&jobs::quick(1)).await;
            server.stop().await;
        } else {
            let output = launch.into_command().output().unwrap();
            assert!(!output.status.success(), "{parameters}");
        }
    }
}

#[tokio::test]
async fn several_servers_share_one_queue_and_one_folder_of_results() {
    let Some(postgres) = Postgres::start() else { return };
    let data_dirs = [DataDir::new(), DataDir::new()];
    let shared = tempfile::tempdir().unwrap();
    let start = async |data_dir| {
        launch(&postgres, data_dir).args(&["--blobs", shared.path().to_str().unwrap()]).start().await
    };
    // Both migrate the empty database.
    let (one, two) = tokio::join!(start(&data_dirs[0]), start(&data_dirs[1]));
    let (here, there) = (one.client(), two.client());
    let mut ids = Vec::new();
    for seed in 0..20 {
        ids.push(id_of(&here.submit(&jobs::quick(seed)).await).to_owned());
    }
    // A client of one server sees what workers of the other do, and gets what they made.
    for id in &ids {
        assert_eq!(there.finished(id).await["attempt"], 1);
        let path = format!("/v1/jobs/{id}/result?format=csv");
        let [mine, theirs] = [&here, &there].map(|client| client.get(&path).send());
        let (mine, theirs) = tokio::join!(mine, theirs);
        assert!(mine.expect(200).body == theirs.expect(200).body && !mine.body.is_empty());
    }
    let export = format!("/v1/jobs/{}/exports/slice?axis=z&at_mm=20&format=json", ids[0]);
    let sliced = here.get(&export).send().await;
    assert_eq!(sliced.expect(200).body, there.get(&export).send().await.expect(200).body);

    // What a list says of its jobs is the same in both databases.
    let page = there.get("/v1/jobs?overview=true&totals=true&limit=3").send().await.expect(200).json();
    assert_eq!((&page["totals"]["jobs"], &page["totals"]["more"]), (&json!(20), &json!(false)));
    assert!(page["totals"]["bytes"].as_u64() > Some(0), "{page:#}");
    assert_eq!(page["items"][2]["overview"]["shape"], "spheres");
    let named = there.get("/v1/jobs?name=NONE&totals=true").send().await.expect(200).json();
    assert_eq!(named["totals"]["jobs"], 0);
    let counted = there.delete("/v1/jobs?state=succeeded&dry_run=true").send().await.expect(200).json();
    assert_eq!((&counted["deleted"], counted["bytes"].as_u64() > Some(0)), (&json!(20), true));

    // Two jobs that fill both servers: one of them dies and loses its job to the other.
    let mut running = Vec::new();
    for _ in 0..2 {
        let job = here.submit(&jobs::endless()).await;
        running.push(id_of(&here.running(id_of(&job)).await).to_owned());
    }
    one.kill().await;
    let is_taken = |job: &Value| job["state"] == "queued" || job["attempt"].as_i64() > Some(1);
    tokio::select! {
        _ = there.job_when(&running[0], "taken back", is_taken) => {}
        _ = there.job_when(&running[1], "taken back", is_taken) => {}
    }
    for id in &running {
        there.post(&format!("/v1/jobs/{id}/cancel")).send().await;
        assert_eq!(there.finished(id).await["state"], "cancelled");
    }
    two.stop().await;
    assert_eq!(counts(&postgres), "cancelled|2\nsucceeded|20");
    let (store, place) = (postgres.database("lab"), shared.path().to_str().unwrap());
    let check = ["check", "--store", &store, "--blobs", place, data_dirs[0].path().to_str().unwrap()];
    let checked = packstone(shared.path(), &check).await;
    assert!(checked.code == Some(0) && checked.stdout.contains("files checked, 0 faults"), "{checked:?}");
    let damaged = cut_a_result(shared.path());
    let checked = packstone(shared.path(), &check).await;
    assert!(checked.code == Some(1) && checked.stdout.contains(&damaged), "{checked:?}");
}

/// How many connections hold the lock of the leader, the word "lead" in ASCII.
const LEADERS: &str =
    "select count(*) from pg_locks where locktype = 'advisory' and objid = x'6c656164'::int";

/// Submits a job with a webhook where nobody packs, and cancels it.
async fn cancelled_with_webhook(client: &Client, receiver: &Receiver) -> String {
    let job = client.submit(&with_url(jobs::quick(1), &receiver.url("/in"))).await;
    client.post(&format!("/v1/jobs/{}/cancel", id_of(&job))).send().await.expect(200);
    id_of(&job).to_owned()
}

#[tokio::test]
async fn a_leader_that_sleeps_is_replaced_and_does_nothing_twice_when_it_goes_on() {
    let Some(postgres) = Postgres::start() else { return };
    let (secret, shared) = (Secret::make().await, DataDir::new());
    let data_dirs = [DataDir::new(), DataDir::new()];
    let store = postgres.database("lab");
    let args = ["--store", &store, "--lease-s", "2", "--blobs", shared.path().to_str().unwrap()];
    let launch = |which: usize| secret.launch(&data_dirs[which]).args(&args);
    let first = Running::of(launch(0).into_command());
    eventually("a leader", || postgres.ask("lab", LEADERS) == "1").await;
    // The other one packs nothing, so that the first one does.
    let second = launch(1).workers(0).start().await;
    let client = second.client();
    let packed = id_of(&client.submit(&jobs::endless()).await).to_owned();
    client.running(&packed).await;

    first.signal(Signal::STOP);
    let requeued = client.job_when(&packed, "taken back", |job| job["state"] == "queued").await;
    assert_eq!(requeued["attempt"], 2);
    let mut receivers =
        [Receiver::holding_back("127.0.0.1").await, Receiver::holding_back("127.0.0.2").await];
    let mut ended = vec![cancelled_with_webhook(&client, &receivers[0]).await];
    receivers[0].next().await;

    // A message is on its way, and another one is recorded, when the sleeper goes on.
    first.signal(Signal::CONT);
    let again = client.running(&packed).await;
    assert_eq!(again["attempt"], 2, "the sleeper has learned that its lease is lost");
    ended.push(cancelled_with_webhook(&client, &receivers[1]).await);
    receivers[1].next().await;
    for (id, receiver) in ended.iter().zip(&receivers) {
        receiver.let_go();
        assert_eq!(webhook_of(&client, id, "delivered").await["attempts"], 1);
    }
    client.post(&format!("/v1/jobs/{packed}/cancel")).send().await.expect(202);
    assert_eq!(client.finished(&packed).await["attempt"], 2);
    for receiver in &mut receivers {
        receiver.nothing_more();
    }
    assert_eq!(postgres.ask("lab", LEADERS), "1");
    first.signal(Signal::TERM);
    assert_eq!(first.ended().await.code, Some(0));
    second.stop().await;
    assert_eq!(counts(&postgres), "cancelled|3");
}

#[tokio::test]
async fn a_database_that_is_not_there_is_named() {
    let data_dir = DataDir::new();
    for (url, says) in [
        ("mysql://host/db", "must be a URL as postgres://user@host/database"),
        ("mysql://lab:secret@host/db", "--store must be a URL as postgres://user@host/database"),
        ("postgres://nobody:secret@localhost/none?host=/nowhere", "the database"),
    ] {
        let output = Launch::new(&data_dir).args(&["--store", url]).into_command().output().unwrap();
        assert!(!output.status.success());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(said.contains(says), "{said}");
        assert!(!said.contains("secret"), "{said}");
    }
}
