//! How many jobs the store leases and ends in a second. Run on demand, on a release build, with `--ignored`.
//! `PACKSTONE_LOAD_JOBS` jobs are leased and ended; `PACKSTONE_LOAD_QUEUED` others wait all the time.

#![allow(clippy::unwrap_used)]

use std::time::Instant;

use packstone_engine::Limits;
use serde_json::json;

use super::tests::{open_shared, submit, succeed};
use super::*;
use crate::accounts::Submitter;
use crate::studies::Study;

/// Clients that lease and end at the same time.
const CLIENTS: usize = 50;

/// The largest of all but one in a hundred, in milliseconds.
fn p99_ms(mut times: Vec<Duration>) -> f64 {
    times.sort_unstable();
    times[times.len() * 99 / 100].as_secs_f64() * 1e3
}

/// Jobs of a study that is submitted so that its jobs wait.
const JOBS_OF_STUDY: usize = 10_000;

fn number(variable: &str, otherwise: usize) -> usize {
    std::env::var(variable).map_or(otherwise, |number| number.parse().unwrap())
}

/// Submits studies until so many jobs wait.
async fn fill(store: &Store, jobs: usize) {
    let points: Vec<usize> = (1..=JOBS_OF_STUDY / 100).collect();
    let request = json!({
        "seed": 1,
        "template": {
            "specimen": {"type": "box", "size_mm": [50, 50, 50]},
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2}
        },
        "grid": {"/timeout_s": points},
        "replicates": 100
    });
    let study = Study::read(&request, 1, None, &Limits::default()).unwrap();
    for _ in 0..jobs.div_ceil(JOBS_OF_STUDY) {
        let study = NewStudy {
            study: study.clone(),
            request: study.recorded(&request),
            by: Submitter::default(),
            idempotency_key: None,
        };
        store.submit_study(study).await.unwrap();
    }
}

/// Leases and ends so many jobs one after another; the times of the claims and of the ends.
async fn lease_and_end(store: Store, client: usize, jobs: usize) -> (Vec<Duration>, Vec<Duration>) {
    let (mut claims, mut ends) = (Vec::new(), Vec::new());
    for job in 0..jobs {
        let id = format!("{client}-{job}");
        let claim = Claim {
            worker: "node".into(),
            key: "workers".into(),
            id,
            slots: 1,
            remaining: None,
            can_mesh: false,
        };
        let started = Instant::now();
        let claimed = store.claim_for(claim).await.unwrap().pop().expect("a job that waits");
        claims.push(started.elapsed());
        let started = Instant::now();
        succeed(&store, claimed.lease).await;
        ends.push(started.elapsed());
    }
    (claims, ends)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "measures: run by hand on a release build"]
async fn fifty_clients_lease_and_end() {
    let jobs = number("PACKSTONE_LOAD_JOBS", 4000).next_multiple_of(CLIENTS);
    let queued = number("PACKSTONE_LOAD_QUEUED", 0);
    let folder = tempfile::tempdir().unwrap();
    let limits = StoreLimits { max_queued: u64::MAX, lease: Duration::from_mins(1) };
    let store = open_shared(&folder, limits).await;
    let submitting = Instant::now();
    let mut clients = tokio::task::JoinSet::new();
    for client in 0..CLIENTS {
        let store = store.clone();
        clients.spawn(async move {
            for _ in (client..jobs).step_by(CLIENTS) {
                submit(&store, json!({})).await;
            }
        });
    }
    clients.join_all().await;
    let submitted = submitting.elapsed();
    fill(&store, queued).await;
    let running = Instant::now();
    let mut clients = tokio::task::JoinSet::new();
    for client in 0..CLIENTS {
        clients.spawn(lease_and_end(store.clone(), client, jobs / CLIENTS));
    }
    let (claims, ends): (Vec<_>, Vec<_>) = clients.join_all().await.into_iter().unzip();
    let ran = running.elapsed();
    let (claims, ends) = (claims.concat(), ends.concat());
    assert_eq!((claims.len(), ends.len()), (jobs, jobs));
    let rate = |time: Duration| jobs as f64 / time.as_secs_f64();
    println!(
        "submitted {:.0} jobs/s; leased and ended {:.0} jobs/s; p99 of a claim {:.1} ms, of an end {:.1} ms",
        rate(submitted),
        rate(ran),
        p99_ms(claims),
        p99_ms(ends),
    );
    if queued > 0 {
        let (claims, ends) = lease_and_end(store, CLIENTS, 500.min(queued)).await;
        println!("alone: p99 of a claim {:.1} ms, of an end {:.1} ms", p99_ms(claims), p99_ms(ends));
    }
}
