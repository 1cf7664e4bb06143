//! How many jobs the store leases and ends in a second. Run on demand, on a release build, with `--ignored`.

#![allow(clippy::unwrap_used)]

use std::time::Instant;

use serde_json::json;

use super::tests::{open_shared, submit, succeed};
use super::*;

/// Clients that lease and end at the same time.
const CLIENTS: usize = 50;

/// The largest of all but one in a hundred, in milliseconds.
fn p99_ms(mut times: Vec<Duration>) -> f64 {
    times.sort_unstable();
    times[times.len() * 99 / 100].as_secs_f64() * 1e3
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "measures: run by hand on a release build"]
async fn fifty_clients_lease_and_end() {
    let jobs: usize = std::env::var("PACKSTONE_LOAD_JOBS").map_or(4000, |jobs| jobs.parse().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let limits = StoreLimits { max_queued: jobs as u64, lease: Duration::from_mins(1) };
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
    let running = Instant::now();
    let mut clients = tokio::task::JoinSet::new();
    for client in 0..CLIENTS {
        let store = store.clone();
        clients.spawn(async move {
            let (mut claims, mut ends) = (Vec::new(), Vec::new());
            loop {
                let id = format!("{client}-{}", claims.len());
                let claim =
                    Claim { worker: "node".into(), key: "workers".into(), id, slots: 1, remaining: None };
                let started = Instant::now();
                let Some(claimed) = store.claim_for(claim).await.unwrap().pop() else { break };
                claims.push(started.elapsed());
                let started = Instant::now();
                succeed(&store, claimed.lease).await;
                ends.push(started.elapsed());
            }
            (claims, ends)
        });
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
}
