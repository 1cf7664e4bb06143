//! The store in PostgreSQL: what several servers on one database do, and what a crash of the database does. The rest of
//! the suite runs on it where `PACKSTONE_TEST_POSTGRES` names one.

use std::collections::BTreeSet;
use std::time::Duration;

use serde_json::Value;

use crate::harness::deadline::within;
use crate::harness::{Client, DataDir, Launch, Postgres, Server, id_of, jobs};

/// The service answers so long after its database does.
const BACK_WITHIN: Duration = Duration::from_secs(10);

async fn start(postgres: &Postgres, data_dir: &DataDir) -> Server {
    Launch::new(data_dir).args(&["--store", &postgres.database("lab"), "--lease-s", "3"]).start().await
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
    let counts = postgres.ask("lab", "select state, jobs from job_counts where jobs > 0 order by state");
    assert_eq!(counts, "cancelled|1\nsucceeded|2");
}

#[tokio::test]
async fn several_servers_share_one_queue() {
    let Some(postgres) = Postgres::start() else { return };
    let data_dirs = [DataDir::new(), DataDir::new()];
    // Both migrate the empty database.
    let (one, two) = tokio::join!(start(&postgres, &data_dirs[0]), start(&postgres, &data_dirs[1]));
    let (here, there) = (one.client(), two.client());
    let mut ids = BTreeSet::new();
    for seed in 0..20 {
        ids.insert(id_of(&here.submit(&jobs::quick(seed)).await).to_owned());
    }
    // A client of one server sees what workers of the other do, without delay.
    for id in &ids {
        assert_eq!(there.finished(id).await["attempt"], 1);
    }
    let placed = |dir: &DataDir| dir.artifacts().len();
    assert_eq!(placed(&data_dirs[0]) + placed(&data_dirs[1]), 20, "each job was run once");
    assert!(data_dirs.iter().all(|dir| placed(dir) > 0), "both servers have worked");
    // A server that dies loses its job to the other one.
    let long = here.submit(&jobs::endless()).await;
    here.running(id_of(&long)).await;
    let second = here.submit(&jobs::endless()).await;
    here.running(id_of(&second)).await;
    one.kill().await;
    let taken = there.job_when(id_of(&long), "taken back", |job| {
        job["state"] == "queued" || job["attempt"].as_i64() > Some(1)
    });
    let taken_second = there.job_when(id_of(&second), "taken back", |job| {
        job["state"] == "queued" || job["attempt"].as_i64() > Some(1)
    });
    // One of the two ran on the server that is gone.
    tokio::select! {
        _ = taken => {}
        _ = taken_second => {}
    }
    for job in [&long, &second] {
        there.post(&format!("/v1/jobs/{}/cancel", id_of(job))).send().await;
        there.finished(id_of(job)).await;
    }
    two.stop().await;
    let counts = postgres.ask("lab", "select state, jobs from job_counts where jobs > 0 order by state");
    assert_eq!(counts, "cancelled|2\nsucceeded|20");
}

#[tokio::test]
async fn a_database_that_is_not_there_is_named() {
    let data_dir = DataDir::new();
    for (url, says) in [
        ("mysql://host/db", "must be a URL as postgres://user@host/database"),
        #[cfg(not(feature = "postgres"))]
        ("postgres://nobody@localhost/none", "--features postgres"),
        #[cfg(feature = "postgres")]
        ("postgres://nobody:secret@localhost/none?host=/nowhere", "the database"),
    ] {
        let output = Launch::new(&data_dir).args(&["--store", url]).into_command().output().unwrap();
        assert!(!output.status.success());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(said.contains(says), "{said}");
        assert!(!said.contains("secret"), "{said}");
    }
}
