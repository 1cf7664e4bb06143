//! Leases of workers in other processes.

#![allow(clippy::unwrap_used)]

use serde_json::json;

use super::tests::{LIMITS, artifact, fresh, open, progress, submit, succeed};
use super::*;
use crate::failure::Failure;
use crate::jobs::State;
use crate::studies::Facts;

fn claim(id: &str, slots: u32) -> Claim {
    Claim { worker: "node7".into(), key: "workers".into(), id: id.into(), slots }
}

fn renewal(lease: Lease) -> Renewal {
    Renewal { id: lease.id, attempt: lease.attempt, progress: None }
}

async fn held(store: &Store, lease: Lease) -> Held {
    store.held("workers", lease.id, lease.attempt).await.unwrap()
}

#[tokio::test]
async fn a_repeated_claim_finds_the_jobs_of_the_first() {
    let (_folder, store) = fresh().await;
    for _ in 0..3 {
        submit(&store, json!({})).await;
    }
    let first = store.claim_for(claim("a", 2)).await.unwrap();
    assert_eq!(first.len(), 2);
    assert_eq!((first[0].job.worker.as_str(), first[0].job.state), ("node7", State::Running));
    assert_eq!(store.claim_for(claim("a", 2)).await.unwrap(), first, "the answer was lost");
    let other = Claim { key: "others".into(), ..claim("a", 2) };
    let second = store.claim_for(other).await.unwrap();
    assert_eq!(second.len(), 1, "the claim of another key is another claim");
    assert!(store.claim_for(claim("b", 2)).await.unwrap().is_empty());
}

#[tokio::test]
async fn a_lease_is_its_keys_and_renewed_together_with_others() {
    let (_folder, store) = fresh().await;
    for _ in 0..2 {
        submit(&store, json!({})).await;
    }
    let leases: Vec<Lease> =
        store.claim_for(claim("a", 2)).await.unwrap().iter().map(|claimed| claimed.lease).collect();
    let news = Renewal { progress: Some(progress(0.25)), ..renewal(leases[1]) };
    let renewed = store.renew("workers".into(), vec![renewal(leases[0]), news.clone()]).await.unwrap();
    let expected: Vec<Held> =
        leases.iter().map(|lease| Held::Running { lease: *lease, cancel_requested: false }).collect();
    assert_eq!(renewed, expected);
    assert_eq!(store.get(leases[1].id).await.unwrap().unwrap().progress.unwrap()["fraction"], 0.25);
    assert_eq!(store.renew("others".into(), vec![news]).await.unwrap(), [Held::Lost]);
    store.cancel(leases[0].id).await.unwrap();
    let renewed = store.renew("workers".into(), vec![renewal(leases[0])]).await.unwrap();
    assert_eq!(renewed, [Held::Running { lease: leases[0], cancel_requested: true }]);
    store.finish_cancelled(leases[0]).await.unwrap();
    assert_eq!(held(&store, leases[0]).await, Held::Ended);
    assert_eq!(store.renew("workers".into(), vec![renewal(leases[0])]).await.unwrap(), [Held::Lost]);
}

#[tokio::test]
async fn a_released_attempt_is_never_given_out_again() {
    let (_folder, store) = fresh().await;
    submit(&store, json!({"max_attempts": 1})).await;
    let first = store.claim_for(claim("a", 1)).await.unwrap().remove(0).lease;
    store.give_back(first).await.unwrap();
    assert_eq!(held(&store, first).await, Held::Lost);
    let second = store.claim_for(claim("b", 1)).await.unwrap().remove(0);
    assert_eq!((second.lease.attempt, second.job.max_attempts), (2, 2), "the attempt did not count");
    assert!(matches!(store.give_back(first).await, Err(StoreError::LeaseLost)), "a repeated request");
    store.requeue_after_fault(second.lease).await.unwrap();
    let waiting = store.get(first.id).await.unwrap().unwrap();
    assert_eq!((waiting.state, waiting.attempt, waiting.max_attempts), (State::Queued, 3, 3));
    assert!(matches!(
        store.fail(second.lease, &Failure::internal(), Facts::default()).await,
        Err(StoreError::LeaseLost)
    ));
}

#[tokio::test]
async fn a_start_of_the_server_leaves_other_processes_their_jobs() {
    let folder = tempfile::tempdir().unwrap();
    let short = StoreLimits { lease: Duration::ZERO, ..LIMITS };
    let store = open(&folder, short).await;
    for _ in 0..2 {
        submit(&store, json!({})).await;
    }
    let there = store.claim_for(claim("a", 1)).await.unwrap().remove(0).lease;
    let here = store.claim().await.unwrap().unwrap().lease;
    store.close().await;
    drop(store);
    let store = open(&folder, LIMITS).await;
    assert_eq!(store.recover(Vec::new()).await.unwrap(), 1, "that of a worker of the server");
    assert_eq!(store.get(here.id).await.unwrap().unwrap().state, State::Queued);
    assert_eq!(store.await_workers().await.unwrap(), 1);
    assert_eq!(store.reclaim_expired_leases(Vec::new()).await.unwrap(), 0, "it has time to be heard");
    assert!(matches!(held(&store, there).await, Held::Running { .. }));
    succeed(&store, there).await;
    assert_eq!(held(&store, there).await, Held::Ended);
}

#[tokio::test]
async fn a_lease_that_ran_out_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(&folder, StoreLimits { lease: Duration::ZERO, ..LIMITS }).await;
    submit(&store, json!({})).await;
    let first = store.claim_for(claim("a", 1)).await.unwrap().remove(0).lease;
    assert_eq!(store.reclaim_expired_leases(Vec::new()).await.unwrap(), 1);
    let second = store.claim_for(claim("b", 1)).await.unwrap().remove(0).lease;
    assert_eq!((first.id, first.attempt + 1), (second.id, second.attempt));
    assert_eq!(held(&store, first).await, Held::Lost);
    let late = store.succeed(first, artifact("late"), progress(1.0), Facts::default(), Vec::new()).await;
    assert!(matches!(late, Err(StoreError::LeaseLost)));
    succeed(&store, second).await;
}
