//! Ends of attempts that worker processes have sent, until they are checked.

#![allow(clippy::unwrap_used)]

use serde_json::json;

use super::tests::{LIMITS, artifact, fresh, open, open_shared, progress, submit};
use super::*;
use crate::failure::{Failure, FailureCode};
use crate::jobs::{ArtifactRecord, JobRecord, WaitReason};
use crate::studies::Facts;

fn claim(id: &str, worker: &str) -> Claim {
    Claim {
        worker: worker.into(),
        key: "workers".into(),
        id: id.into(),
        slots: 1,
        remaining: None,
        can_mesh: false,
    }
}

fn formats() -> FormatLengths {
    FormatLengths { revision: 7, bytes: [("csv".to_owned(), 5)].into() }
}

async fn leased(store: &Store, id: &str) -> Lease {
    store.claim_for(claim(id, "node7")).await.unwrap().remove(0).lease
}

/// A job whose result was received.
async fn received(store: &Store, path: &str) -> Lease {
    submit(store, json!({})).await;
    let lease = leased(store, path).await;
    store.receive_result(lease, artifact(path), progress(1.0)).await.unwrap();
    lease
}

async fn job(store: &Store, lease: Lease) -> JobRecord {
    store.get(lease.id).await.unwrap().unwrap()
}

#[tokio::test]
async fn a_received_result_is_no_result_before_it_is_checked() {
    let (_folder, store) = fresh().await;
    let lease = received(&store, "ab/a.1.packstone").await;
    let running = job(&store, lease).await;
    assert_eq!((running.state, running.artifact, running.worker.as_str()), (State::Running, None, "node7"));
    assert!(store.refers_to("ab/a.1.packstone").await.unwrap(), "the sweeper leaves the file alone");
    assert_eq!(store.unchecked().await.unwrap(), 1);
    // For its worker the attempt is over, whatever it sends; its lease does not run out.
    assert_eq!(store.held("workers", lease.id, 1).await.unwrap(), Held::Ended);
    let late = Renewal { id: lease.id.into(), attempt: 1, progress: Some(progress(0.5)) };
    assert_eq!(store.renew("workers".into(), vec![late]).await.unwrap(), [Held::Lost]);
    assert!(matches!(store.give_back(lease).await, Err(StoreError::LeaseLost)));
    assert!(matches!(
        store.requeue_after_fault(lease, WaitReason::machine()).await,
        Err(StoreError::LeaseLost)
    ));
    assert_eq!(store.reclaim_expired_leases(Vec::new()).await.unwrap(), 0);
    assert!(store.processes().await.unwrap().is_empty());
    // The same request again is answered as before; another result is not taken.
    store.receive_result(lease, artifact("ab/a.1.packstone"), progress(1.0)).await.unwrap();
    let other = store.receive_result(lease, artifact("ab/b.1.packstone"), progress(1.0)).await;
    assert!(matches!(other, Err(StoreError::LeaseLost)));

    let check = store.next_check(true).await.unwrap().unwrap();
    assert_eq!((check.lease, check.worker.as_str(), check.key.as_str()), (lease, "node7", "workers"));
    assert!(matches!(check.end, ReceivedEnd::Result(found) if found == artifact("ab/a.1.packstone")));
    assert!(store.next_check(true).await.unwrap().is_none(), "it is being checked");
    assert!(!store.renew_check(lease).await.unwrap());
    store.accept_result(lease, progress(1.0), Facts::default(), Vec::new(), formats()).await.unwrap();
    let done = job(&store, lease).await;
    let FormatLengths { revision: format_revision, bytes: format_lengths } = formats();
    let expected = ArtifactRecord { format_revision, format_lengths, ..artifact("ab/a.1.packstone") };
    assert_eq!((done.state, done.artifact), (State::Succeeded, Some(expected)));
    assert_eq!(store.unchecked().await.unwrap(), 0);
    assert!(matches!(store.renew_check(lease).await, Err(StoreError::LeaseLost)));
}

#[tokio::test]
async fn a_wrong_result_requeues_the_job_and_counts_for_the_worker() {
    let (_folder, store) = fresh().await;
    submit(&store, json!({"max_attempts": 1})).await;
    for wrong in 1..=MOST_WRONG_RESULTS {
        let lease = leased(&store, &wrong.to_string()).await;
        assert_eq!(lease.attempt, wrong);
        let path = format!("ab/a.{wrong}.packstone");
        store.receive_result(lease, artifact(&path), progress(1.0)).await.unwrap();
        store.next_check(true).await.unwrap().unwrap();
        let refused = store.refuse_end(lease, "grain 3 lies outside").await.unwrap();
        assert_eq!((refused.of_worker, refused.has_failed), (wrong, false));
        assert!(!store.refers_to(&path).await.unwrap() && store.is_removed(&path).await.unwrap());
        let waiting = job(&store, lease).await;
        assert_eq!(
            (waiting.state, waiting.attempt, waiting.max_attempts),
            (State::Queued, wrong + 1, wrong + 1)
        );
        assert!(matches!(store.refuse_end(lease, "again").await, Err(StoreError::LeaseLost)));
    }
    let blocked = store.claim_for(claim("x", "node7")).await;
    assert!(matches!(blocked, Err(StoreError::WorkerBlocked { wrong: 3, .. })), "{blocked:?}");
    let faulty = store.faulty_workers().await.unwrap();
    assert_eq!((faulty.len(), faulty[0].is_blocked()), (1, true));
    assert_eq!(faulty[0].last_fault, "grain 3 lies outside");
    assert_eq!(store.allow_worker("others".into(), "node7".into()).await.unwrap(), 0);
    // Another process of the same key gets the job.
    let other = store.claim_for(claim("y", "node8")).await.unwrap().remove(0).lease;
    store.give_back(other).await.unwrap();
    assert_eq!(store.allow_worker("workers".into(), "node7".into()).await.unwrap(), 3);
    assert_eq!(store.claim_for(claim("z", "node7")).await.unwrap().len(), 1);
}

#[tokio::test]
async fn a_cancelled_check_ends_although_no_check_may_begin() {
    let (_folder, store) = fresh().await;
    let (first, second) =
        (received(&store, "ab/a.1.packstone").await, received(&store, "ab/b.1.packstone").await);
    assert_eq!(store.next_check(true).await.unwrap().unwrap().lease, first, "in their order");
    for lease in [first, second] {
        store.cancel(lease.id).await.unwrap();
    }
    assert!(store.renew_check(first).await.unwrap(), "the check hears of it");
    assert!(store.next_check(false).await.unwrap().is_none());
    for lease in [first, second] {
        assert_eq!(job(&store, lease).await.state, State::Cancelled);
        let late = store.accept_result(lease, progress(1.0), Facts::default(), Vec::new(), formats()).await;
        assert!(matches!(late, Err(StoreError::LeaseLost)));
    }
    assert!(store.is_removed("ab/b.1.packstone").await.unwrap());
}

#[tokio::test]
async fn a_check_goes_to_the_next_server_when_its_lease_runs_out() {
    let folder = tempfile::tempdir().unwrap();
    let store = open_shared(&folder, LIMITS).await;
    let lease = received(&store, "ab/a.1.packstone").await;
    store.next_check(true).await.unwrap().unwrap();
    assert!(store.next_check(true).await.unwrap().is_none());
    store.leave_check(lease, Some(Duration::ZERO)).await.unwrap();
    assert_eq!(store.next_check(true).await.unwrap().unwrap().lease, lease);
    store.leave_check(lease, None).await.unwrap();
    assert_eq!(store.next_check(true).await.unwrap().unwrap().lease, lease);
}

#[tokio::test]
async fn a_check_begins_again_after_a_start_of_the_server() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(&folder, LIMITS).await;
    let lease = received(&store, "ab/a.1.packstone").await;
    store.next_check(true).await.unwrap().unwrap();
    store.close().await;
    drop(store);
    let store = open(&folder, LIMITS).await;
    assert_eq!(store.recover(Vec::new()).await.unwrap(), 0, "the job is not taken back");
    assert_eq!(store.await_workers().await.unwrap(), 0);
    assert_eq!(store.recover_checks().await.unwrap(), 1);
    assert_eq!(store.next_check(true).await.unwrap().unwrap().lease, lease);
    store.requeue_lost_result(lease).await.unwrap();
    let waiting = job(&store, lease).await;
    assert_eq!((waiting.state, waiting.attempt, waiting.max_attempts), (State::Queued, 2, 4));
    assert!(store.faulty_workers().await.unwrap().is_empty(), "the worker is not to blame");
}

#[tokio::test]
async fn failures_wait_for_their_check_too() {
    let (_folder, store) = fresh().await;
    submit(&store, json!({"max_attempts": 2})).await;
    let lease = leased(&store, "a").await;
    let failure = Failure::new(FailureCode::InfeasibleMix, "no");
    store.receive_failure(lease, failure.clone(), progress(1.0)).await.unwrap();
    let running = job(&store, lease).await;
    assert_eq!((running.state, running.error), (State::Running, None));
    let check = store.next_check(true).await.unwrap().unwrap();
    assert!(matches!(check.end, ReceivedEnd::Failure(found) if found == failure));
    store.refuse_end(lease, "it can be planned").await.unwrap();
    assert_eq!(job(&store, lease).await.error, None);
    // What only a defect causes counts: the second attempt is the third number, after that which did not count.
    for (attempt, state) in [(2, State::Queued), (3, State::Failed)] {
        let lease = leased(&store, &attempt.to_string()).await;
        assert_eq!(lease.attempt, attempt);
        let ended = store.retry_after_defect(lease, Failure::internal()).await.unwrap();
        assert_eq!((job(&store, lease).await.state, ended), (state, state == State::Failed));
    }
    let next = submit(&store, json!({})).await;
    let lease = leased(&store, "b").await;
    store.receive_failure(lease, failure.clone(), progress(1.0)).await.unwrap();
    store.next_check(true).await.unwrap().unwrap();
    store.accept_failure(lease, &failure, Facts::default()).await.unwrap();
    let failed = store.get(next.id).await.unwrap().unwrap();
    assert_eq!((failed.state, failed.error), (State::Failed, Some(failure)));
}

/// The first answer was read, as its job is being checked. Whoever repeats the request takes another job, as after the
/// end of the check, and does not wait in vain with a wake-up.
#[tokio::test]
async fn a_claim_that_is_repeated_while_its_result_is_checked_takes_another_job() {
    let (_folder, store) = fresh().await;
    submit(&store, json!({})).await;
    let first = store.claim_for(claim("a", "node7")).await.unwrap();
    let second = submit(&store, json!({})).await;
    assert_eq!(store.claim_for(claim("a", "node7")).await.unwrap(), first);
    store.receive_result(first[0].lease, artifact("ab/a.1.packstone"), progress(1.0)).await.unwrap();
    let found = store.claim_for(claim("a", "node7")).await.unwrap();
    assert_eq!(found.iter().map(|claimed| claimed.job.id).collect::<Vec<_>>(), [second.id]);
}
