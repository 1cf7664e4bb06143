//! Leases of workers in other processes.

#![allow(clippy::unwrap_used)]

use std::task::Poll;

use futures_util::poll;
use serde_json::json;
use tokio::time::Instant;

use super::tests::{LIMITS, artifact, fresh, fresh_file, open, plan_of, progress, request, submit, succeed};
use super::*;
use crate::accounts::Submitter;
use crate::failure::Failure;
use crate::jobs::{State, StopRequests, WaitReason};
use crate::studies::Facts;

fn claim(id: &str, slots: u32) -> Claim {
    Claim {
        worker: "node7".into(),
        key: "workers".into(),
        id: id.into(),
        slots,
        remaining: None,
        can_mesh: false,
    }
}

fn renewal(lease: Lease) -> Renewal {
    Renewal { id: lease.id.into(), attempt: lease.attempt, progress: None }
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
    submit(&store, json!({})).await;
    assert_eq!(store.claim_for(claim("a", 3)).await.unwrap(), first, "a repeated claim leases nothing more");
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
    let expected: Vec<Held> = leases
        .iter()
        .map(|lease| Held::Running { lease: *lease, requests: StopRequests::default() })
        .collect();
    assert_eq!(renewed, expected);
    assert_eq!(store.get(leases[1].id).await.unwrap().unwrap().progress.unwrap()["fraction"], 0.25);
    assert_eq!(store.renew("others".into(), vec![news]).await.unwrap(), [Held::Lost]);
    store.cancel(leases[0].id).await.unwrap();
    let renewed = store.renew("workers".into(), vec![renewal(leases[0])]).await.unwrap();
    let requests = StopRequests { cancel: true, finish: false };
    assert_eq!(renewed, [Held::Running { lease: leases[0], requests }]);
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
    store.requeue_after_fault(second.lease, WaitReason::machine()).await.unwrap();
    let waiting = store.get(first.id).await.unwrap().unwrap();
    assert_eq!((waiting.state, waiting.attempt, waiting.max_attempts), (State::Queued, 3, 3));
    assert!(matches!(
        store.fail(second.lease, &Failure::internal(), Facts::default()).await,
        Err(StoreError::LeaseLost)
    ));
}

/// The answer to a result may be that it could not be recorded. The worker then ends its attempt without it, and the
/// job may be deleted at once: the file must not be found as one of a job that the database does not know.
#[tokio::test]
async fn the_file_that_an_attempt_elsewhere_may_have_left_is_removed() {
    let (_folder, store) = fresh().await;
    let job = submit(&store, json!({})).await;
    let first = store.claim_for(claim("a", 1)).await.unwrap().remove(0).lease;
    store.requeue_after_fault(first, WaitReason::machine()).await.unwrap();
    store.end_pauses(job.owner.clone()).await.unwrap();
    let second = store.claim_for(claim("a", 1)).await.unwrap().remove(0).lease;
    store.give_back(second).await.unwrap();
    let third = store.claim_for(claim("a", 1)).await.unwrap().remove(0).lease;
    store.fail(third, &Failure::internal(), Facts::default()).await.unwrap();
    store.delete(job.id).await.unwrap();
    let id = job.id.to_string();
    let left = [1, 2, 3].map(|attempt| format!("{}/{id}.{attempt}.packstone", &id[id.len() - 2..]));
    assert_eq!(store.removals(9).await.unwrap(), left);
    for path in left {
        assert!(store.is_removed(&path).await.unwrap());
    }
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

/// Submits a job that is forecast to take so long.
async fn submit_long(store: &Store, owner: &str, forecast_s: f64, keeps_checkpoints: bool) -> JobId {
    let by = Submitter { key: String::new(), owner: owner.into() };
    let request = request(&json!({}));
    let new = NewJob {
        request,
        warnings: Vec::new(),
        forecast_s,
        keeps_checkpoints,
        most_threads: 1,
        by,
        idempotency_key: None,
    };
    match store.submit(new).await.unwrap() {
        Submitted::Created(job) => job.id,
        Submitted::Existing(_) => panic!("a job without a key exists already"),
    }
}

/// The job that a worker with so much time left gets.
async fn claimed_within(store: &Store, remaining_s: impl Into<Option<u64>>) -> Option<JobId> {
    let remaining = remaining_s.into().map(Duration::from_secs);
    let next = Claim { remaining, ..claim(&JobId::new().to_string(), 1) };
    store.claim_for(next).await.unwrap().first().map(|claimed| claimed.job.id)
}

#[tokio::test]
async fn a_worker_whose_time_is_limited_gets_no_job_whose_work_would_be_lost() {
    let (_folder, store) = fresh().await;
    let lost = submit_long(&store, "", 3600.0, false).await;
    let grows = submit_long(&store, "", 7200.0, true).await;
    let short = submit_long(&store, "", 25.0, false).await;
    let quick = submit_long(&store, "", 5.0, true).await;
    assert_eq!(claimed_within(&store, 4).await, None);
    assert_eq!(
        claimed_within(&store, 20).await,
        Some(quick),
        "too little for a checkpoint of the longer one"
    );
    assert_eq!(claimed_within(&store, 29).await, Some(short));
    let unknown = submit_long(&store, "", f64::NAN, false).await;
    assert_eq!(claimed_within(&store, 29).await, None);
    assert_eq!(claimed_within(&store, 30).await, Some(grows), "the first in line that keeps checkpoints");
    assert_eq!(claimed_within(&store, 59).await, None);
    assert_eq!(claimed_within(&store, 60).await, Some(unknown), "a forecast of a minute");
    assert_eq!(claimed_within(&store, 3599).await, None);
    assert_eq!(claimed_within(&store, 3600).await, Some(lost));
    let any = submit_long(&store, "", 1e9, false).await;
    assert_eq!(claimed_within(&store, None).await, Some(any), "a worker without a limit takes all");
}

#[tokio::test]
async fn owners_take_turns_for_workers_whose_time_is_limited() {
    let (_folder, store) = fresh().await;
    let owner_of = async |id: Option<JobId>| store.get(id.unwrap()).await.unwrap().unwrap().owner;
    for (owner, forecast_s, jobs) in [("a", 3600.0, 6), ("a", 10.0, 3), ("b", 10.0, 9), ("c", 3600.0, 3)] {
        for _ in 0..jobs {
            submit_long(&store, owner, forecast_s, false).await;
        }
    }
    let mut owners = String::new();
    for _ in 0..6 {
        owners += &owner_of(claimed_within(&store, 600).await).await;
    }
    assert_eq!(owners, "ababab", "those who have what fits take turns");
    for _ in 0..2 {
        assert_eq!(owner_of(claimed_within(&store, 600).await).await, "b");
    }
    // Who was passed over has kept the turn, and has saved none up.
    owners.clear();
    for _ in 0..7 {
        owners += &owner_of(claimed_within(&store, None).await).await;
    }
    assert_eq!(&owners[..1], "a", "the oldest of those whose turn it is");
    assert_eq!(owners.matches('a').count(), 3, "{owners}");
    assert_eq!(owners.matches('b').count(), 2, "{owners}");
    assert_eq!(owners.matches('c').count(), 2, "{owners}");
}

#[tokio::test]
async fn a_job_that_was_cut_goes_on_with_the_next_worker_whose_time_is_limited() {
    let (_folder, store) = fresh().await;
    let id = submit_long(&store, "", 7200.0, true).await;
    for attempt in 1..=5 {
        let next = Claim { remaining: Some(Duration::from_mins(5)), ..claim(&attempt.to_string(), 1) };
        let lease = store.claim_for(next).await.unwrap().remove(0).lease;
        assert_eq!((lease.id, lease.attempt), (id, attempt));
        store.give_back(lease).await.unwrap();
    }
    assert_eq!(store.get(id).await.unwrap().unwrap().state, State::Queued, "no attempt counted");
}

#[tokio::test]
async fn a_claim_within_a_time_looks_at_the_next_jobs_of_each_owner_only() {
    let (_folder, store) = fresh_file().await;
    let plan = plan_of(&store, claims::NEXT_WITHIN).await;
    let walked = plan.iter().find(|step| step.contains("jobs_queue")).unwrap();
    assert!(walked.contains("SEARCH") && walked.contains("owner=?"), "{plan:?}");
    assert!(
        plan.iter().all(|step| !step.starts_with("SCAN head") && !step.starts_with("SCAN jobs")),
        "{plan:?}"
    );
    let first = submit_long(&store, "", 100.0, false).await;
    for _ in 1..250 {
        submit_long(&store, "", 100.0, false).await;
    }
    let short = submit_long(&store, "", 1.0, false).await;
    assert_eq!(claimed_within(&store, 10).await, None, "it is too far behind");
    let (mark, until) = (store.queue_mark(), WorkUntil::Moment(Instant::now() + Duration::from_secs(10)));
    store.cancel(first).await.unwrap();
    store.queue_notified(mark, until).await.end();
    assert_eq!(claimed_within(&store, 10).await, Some(short));
}

#[tokio::test]
async fn an_idle_worker_looks_for_jobs_that_nobody_told_it_of() {
    let (_folder, store) = fresh().await;
    let until = WorkUntil::Moment(Instant::now() + Duration::from_mins(1));
    let mut idle = Box::pin(store.queue_notified(store.queue_mark(), until));
    assert!(poll!(idle.as_mut()).is_pending());
    // As if the words of another server had been lost.
    let long = submit_long(&store, "", 100.0, false).await;
    drop(idle);
    let mut idle = Box::pin(store.queue_notified(store.queue_mark(), until));
    assert!(poll!(idle.as_mut()).is_pending());
    store.look_for_jobs().await.unwrap();
    assert!(poll!(idle.as_mut()).is_pending(), "the job does not fit into its time");
    let mut other = Box::pin(store.queue_notified(store.queue_mark(), WorkUntil::Unlimited));
    assert!(poll!(other.as_mut()).is_pending());
    store.look_for_jobs().await.unwrap();
    let Poll::Ready(wake_up) = poll!(other.as_mut()) else { panic!("it has the time") };
    assert!(poll!(idle.as_mut()).is_pending());
    assert_eq!(store.claim().await.unwrap().unwrap().job.id, long);
    wake_up.end();
}

#[tokio::test]
async fn a_wake_up_passes_from_a_worker_that_gets_no_answer_to_the_next() {
    let (_folder, store) = fresh().await;
    let idle = || Box::pin(store.queue_notified(store.queue_mark(), WorkUntil::Unlimited));
    let mut idle = [idle(), idle(), idle()];
    for worker in &mut idle {
        assert!(poll!(worker.as_mut()).is_pending());
    }
    submit(&store, json!({})).await;
    let [blocked, next, last] = &mut idle;
    let Poll::Ready(wake_up) = poll!(blocked.as_mut()) else { panic!("it has waited longest") };
    assert!(poll!(next.as_mut()).is_pending(), "one wake-up wakes one worker");
    // The worker has sent three wrong results meanwhile, has hung up, or the store has failed.
    drop(wake_up);
    let Poll::Ready(wake_up) = poll!(next.as_mut()) else { panic!("the wake-up is lost") };
    assert!(store.claim().await.unwrap().is_some());
    wake_up.end();
    assert!(poll!(last.as_mut()).is_pending(), "no job is left for it");
}
