//! Exports for the slots of packings: who leases them, and what becomes of those that worker processes make.

#![allow(clippy::unwrap_used)]

use packstone_engine::export::ExportRequest;
use serde_json::json;

use super::super::db::query;
use super::super::tests::{artifact, fresh, fresh_file, progress, submit};
use super::super::{
    Claim, ClaimedExport, ExportQueue, Held, Kept, MOST_WRONG_RESULTS, Renewal, Store, StoreError,
};
use crate::exports::{ExportLease, ExportRecord, ExportState, NewExport, StoredFile};
use crate::failure::{Failure, FailureCode};
use crate::jobs::JobId;
use crate::studies::Facts;

fn heavy(at_mm: f64) -> NewExport {
    let export = ExportRequest::from_json(&json!({"type": "slice", "at_mm": at_mm})).unwrap();
    NewExport { quick: false, heavy: true, ..NewExport::new(&export, "ab") }
}

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

/// A job with an export, packed by a worker process or by the server.
async fn packed(store: &Store, worker: Option<&str>) -> JobId {
    let job = submit(store, json!({})).await;
    let lease = match worker {
        Some(worker) => {
            let claim = claim(&format!("packing {}", job.id), worker);
            store.claim_for(claim).await.unwrap()[0].lease
        }
        None => store.claim().await.unwrap().unwrap().lease,
    };
    let path = format!("{}.1", lease.id);
    let heavy = vec![heavy(1.0)];
    store.succeed(lease, artifact(&path), progress(1.0), Facts::default(), heavy).await.unwrap();
    job.id
}

async fn leased(store: &Store, id: &str, worker: &str) -> ExportRecord {
    store.claim_export_for(claim(id, worker)).await.unwrap().unwrap().export
}

async fn again(store: &Store, of: &ExportRecord) -> ExportRecord {
    store.export(of.job, of.id).await.unwrap().unwrap()
}

async fn held(store: &Store, key: &str, of: &ExportRecord) -> Held {
    store.held(key, of.id, of.attempt).await.unwrap()
}

fn file() -> StoredFile {
    StoredFile { path: "made".into(), bytes: 7, sha256: "cd".repeat(32) }
}

/// Lets all leases run out.
async fn run_out(store: &Store) {
    let mut writer = store.writer().await.unwrap();
    query("update exports set lease_expires_at = 1 where state = 'running'")
        .execute(&mut writer)
        .await
        .unwrap();
}

/// What needs Gmsh goes to who has it, however long it has waited; all else goes to anybody.
#[tokio::test]
async fn an_export_that_needs_gmsh_is_leased_to_a_process_that_has_it_alone() {
    let (_folder, store) = fresh().await;
    let job = submit(&store, json!({})).await;
    let lease = store.claim().await.unwrap().unwrap().lease;
    let of_mesher = NewExport { needs_mesher: true, ..heavy(1.0) };
    let path = format!("{}.1", lease.id);
    let both = vec![of_mesher, heavy(2.0)];
    store.succeed(lease, artifact(&path), progress(1.0), Facts::default(), both).await.unwrap();
    let at = |of: Option<&ClaimedExport>| of.map(|of| of.export.options["at_mm"].clone());
    let without = store.claim_export_for(claim("a", "node7")).await.unwrap();
    assert_eq!(at(without.as_ref()), Some(json!(2.0)), "the one behind it");
    assert_eq!(store.claim_export_for(claim("b", "node8")).await.unwrap(), None);
    assert_eq!(store.claim_heavy_export(async { false }).await.unwrap(), None, "nor to a server without it");
    let with = Claim { can_mesh: true, ..claim("c", "node9") };
    let with = store.claim_export_for(with).await.unwrap().unwrap();
    assert_eq!((at(Some(&with)), with.export.job), (Some(json!(1.0)), job.id));
    store.export_requeued(&with.export).await.unwrap();
    let here = store.claim_heavy_export(async { true }).await.unwrap();
    assert_eq!(at(here.as_ref()), Some(json!(1.0)));
}

#[tokio::test]
async fn exports_for_slots_are_left_to_them_and_go_first_to_who_packed_the_job() {
    let (_folder, store) = fresh().await;
    let (of_server, of_worker) = (packed(&store, None).await, packed(&store, Some("node7")).await);
    for queue in [ExportQueue::Usual, ExportQueue::Quick] {
        assert_eq!(store.claim_export(queue).await.unwrap(), None, "{queue:?}");
    }
    let waiting = submit(&store, json!({})).await;
    let first = leased(&store, "a", "node7").await;
    assert_eq!((first.job, first.worker.as_str(), first.heavy), (of_worker, "node7", true));
    assert_eq!(leased(&store, "a", "node7").await, first, "the answer was lost");
    assert!(store.claim_for(claim("a", "node7")).await.unwrap().is_empty(), "the claim has an export");
    let none = Claim { slots: 0, ..claim("b", "node7") };
    assert_eq!(store.claim_export_for(none).await.unwrap(), None, "it asks for what it was given alone");
    let second = store.claim_heavy_export(async { false }).await.unwrap().unwrap().export;
    assert_eq!((second.job, second.worker.as_str()), (of_server, ""));
    assert_eq!(store.claim_heavy_export(async { false }).await.unwrap(), None);
    assert_eq!(store.claim_export_for(claim("b", "node7")).await.unwrap(), None);
    assert_eq!(store.claim_for(claim("b", "node7")).await.unwrap()[0].job.id, waiting.id);
    assert_eq!(store.claim_export_for(claim("b", "node7")).await.unwrap(), None, "the claim has a job");
    // Of a job of another worker, where nothing else waits.
    let of_other = packed(&store, Some("node8")).await;
    assert_eq!(leased(&store, "c", "node7").await.job, of_other);
}

#[tokio::test]
async fn the_lease_of_an_export_is_renewed_and_ended_by_its_key_and_attempt_alone() {
    let (_folder, store) = fresh().await;
    packed(&store, Some("node7")).await;
    let first = leased(&store, "a", "node7").await;
    let lease = ExportLease::from(&first);
    assert_eq!(held(&store, "workers", &first).await, Held::RunningExport(lease));
    assert_eq!(held(&store, "others", &first).await, Held::Lost);
    let renewal = Renewal { id: first.id.into(), attempt: 1, progress: Some(progress(0.25)) };
    let renewed = store.renew("workers".into(), vec![renewal.clone()]).await.unwrap();
    assert_eq!(renewed, [Held::RunningExport(lease)]);
    assert_eq!(again(&store, &first).await.progress.unwrap()["fraction"], 0.25);
    let processes = store.processes().await.unwrap();
    assert_eq!((processes.len(), processes[0].jobs, processes[0].is_heard), (1, 1, true));
    run_out(&store).await;
    assert!(store.has_expired_leases().await.unwrap());
    assert_eq!(store.reclaim_expired_exports(Vec::new()).await.unwrap(), 1);
    assert_eq!(held(&store, "workers", &first).await, Held::Lost);
    assert_eq!(store.renew("workers".into(), vec![renewal]).await.unwrap(), [Held::Lost]);
    let late = store.export_made(&first, file(), json!({})).await;
    assert!(matches!(late, Err(StoreError::LeaseLost)), "{late:?}");
    let second = leased(&store, "b", "node8").await;
    assert_eq!((second.id, second.attempt, second.worker.as_str()), (first.id, 2, "node8"));
    store.export_requeued(&second).await.unwrap();
    let third = leased(&store, "c", "node8").await;
    assert_eq!(third.attempt, 3, "no two runs write the same file");
    store.export_made(&third, file(), json!({"n": 1})).await.unwrap();
    assert_eq!(held(&store, "workers", &third).await, Held::Ended);
    let made = again(&store, &third).await;
    assert_eq!(
        (made.state, made.worker.as_str(), made.file),
        (ExportState::Succeeded, "node8", Some(file()))
    );
    // An attempt that was given back does not count, one whose lease ran out does.
    packed(&store, None).await;
    for attempt in 1..=3 {
        let running = leased(&store, &format!("d{attempt}"), "node9").await;
        assert_eq!(running.attempt, attempt);
        run_out(&store).await;
        store.reclaim_expired_exports(Vec::new()).await.unwrap();
        let ended = again(&store, &running).await;
        assert_eq!(ended.state == ExportState::Failed, attempt == 3, "{ended:?}");
    }
}

/// As of jobs: what solves a load case in each attempt ends, however often its worker dies.
#[tokio::test]
async fn an_attempt_that_has_kept_a_checkpoint_does_not_count() {
    let (_folder, store) = fresh().await;
    packed(&store, None).await;
    let kept = |of: &ExportRecord, attempt: i64| {
        vec![Kept { job: of.id.to_string(), attempt, at_us: store.now_us() }]
    };
    for attempt in 1..=5 {
        let running = leased(&store, &format!("a{attempt}"), "node7").await;
        assert_eq!(running.attempt, attempt);
        run_out(&store).await;
        assert_eq!(store.reclaim_expired_exports(kept(&running, attempt)).await.unwrap(), 1);
        assert_eq!(again(&store, &running).await.state, ExportState::Queued, "{attempt}");
    }
    // A checkpoint of an attempt before is no step forward.
    for attempt in 6..=8 {
        let running = leased(&store, &format!("a{attempt}"), "node7").await;
        run_out(&store).await;
        store.reclaim_expired_exports(kept(&running, attempt - 1)).await.unwrap();
        let ended = again(&store, &running).await;
        assert_eq!(ended.state == ExportState::Failed, attempt == 8, "{ended:?}");
    }
}

#[tokio::test]
async fn a_start_of_the_server_leaves_worker_processes_their_exports() {
    let (_folder, store) = fresh_file().await;
    for _ in 0..2 {
        packed(&store, None).await;
    }
    let elsewhere = leased(&store, "a", "node7").await;
    let here = store.claim_heavy_export(async { false }).await.unwrap().unwrap().export;
    run_out(&store).await;
    assert_eq!(store.await_workers().await.unwrap(), 1);
    assert_eq!(store.recover_exports(Vec::new()).await.unwrap(), 1);
    assert_eq!(again(&store, &elsewhere).await.state, ExportState::Running);
    assert_eq!(again(&store, &here).await.state, ExportState::Queued);
    assert_eq!(store.reclaim_expired_exports(Vec::new()).await.unwrap(), 0, "it has the time of a lease");
    store.delete_export(elsewhere.job, elsewhere.id).await.unwrap();
    assert_eq!(held(&store, "workers", &elsewhere).await, Held::Lost);
}

#[tokio::test]
async fn a_wrong_export_counts_for_its_attempts_and_for_its_worker() {
    let (_folder, store) = fresh().await;
    packed(&store, None).await;
    for attempt in 1..=3 {
        let wrong = leased(&store, &format!("a{attempt}"), "node7").await;
        let refused = store.refuse_export(ExportLease::from(&wrong), "it is empty").await.unwrap();
        assert_eq!((refused.of_worker, refused.has_failed), (attempt, attempt == 3));
        let late = store.refuse_export(ExportLease::from(&wrong), "it is empty").await;
        assert!(matches!(late, Err(StoreError::LeaseLost)), "{late:?}");
        let ended = again(&store, &wrong).await;
        if attempt == 3 {
            assert_eq!(ended.error.unwrap().code, FailureCode::CheckFailed);
        } else {
            assert_eq!((ended.state, ended.attempt, ended.error), (ExportState::Queued, attempt + 1, None));
        }
    }
    let faulty = store.faulty_workers().await.unwrap();
    assert_eq!((faulty[0].worker.as_str(), faulty[0].wrong_results), ("node7", MOST_WRONG_RESULTS));
    assert!(faulty[0].last_fault.ends_with("it is empty"), "{faulty:?}");
    packed(&store, None).await;
    assert_eq!(store.claim_export_for(claim("b", "node7")).await.unwrap(), None, "it is blocked");
    // A defect that a worker reports counts for the export, not for the worker.
    let running = leased(&store, "c", "node8").await;
    let defect = Failure::new(FailureCode::InternalError, "a panic");
    assert!(!store.retry_export_after_defect(ExportLease::from(&running), defect).await.unwrap());
    assert_eq!(leased(&store, "d", "node8").await.attempt, 2);
    assert_eq!(store.faulty_workers().await.unwrap().len(), 1);
}
