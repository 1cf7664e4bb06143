//! Exports in the store, on real files: one row for one thing, who may move it, what goes with it, and old data
//! directories.

#![allow(clippy::unwrap_used)]

use jiff::Timestamp;
use packstone_engine::export::ExportRequest;
use serde_json::json;

use super::super::db::query;
use super::super::tests::{LIMITS, artifact, expire_all, fresh, fresh_file, open, plan_of, progress, submit};
use super::super::{ExportQueue, Retention, Store, StoreError};
use super::query::ExportPage;
use crate::exports::{ExportRecord, ExportState, MAX_KEPT, MAX_WAITING, NewExport, StoredFile};
use crate::failure::{Failure, FailureCode};
use crate::jobs::{JobId, JobRecord};
use crate::studies::Facts;

fn cut(at_mm: f64) -> NewExport {
    let export = ExportRequest::from_json(&json!({"type": "slice", "at_mm": at_mm})).unwrap();
    NewExport::new(&export, "ab")
}

/// The same as something that takes its time.
fn slow(at_mm: f64) -> NewExport {
    NewExport { quick: false, ..cut(at_mm) }
}

async fn finished(store: &Store, postprocess: Vec<NewExport>) -> JobRecord {
    let job = submit(store, json!({})).await;
    let lease = store.claim().await.unwrap().unwrap().lease;
    let path = format!("{}.1", lease.id);
    store.succeed(lease, artifact(&path), progress(1.0), Facts::default(), postprocess).await.unwrap();
    store.get(job.id).await.unwrap().unwrap()
}

fn file(path: &str, bytes: u64) -> StoredFile {
    StoredFile { path: path.into(), bytes, sha256: "cd".repeat(32) }
}

async fn make(store: &Store, path: &str, bytes: u64) -> ExportRecord {
    let claimed = store.claim_export(ExportQueue::Usual).await.unwrap().unwrap().export;
    store.export_made(&claimed, file(path, bytes), json!({"n": 1})).await.unwrap();
    again(store, &claimed).await.unwrap()
}

async fn again(store: &Store, record: &ExportRecord) -> Option<ExportRecord> {
    store.export(record.job, record.id).await.unwrap()
}

async fn request(store: &Store, job: JobId, new: NewExport, retention: Retention) -> (ExportRecord, bool) {
    store.request_export(job, new, retention).await.unwrap()
}

#[tokio::test]
async fn the_same_is_made_once_however_often_it_is_asked_for() {
    let (_folder, store) = fresh().await;
    let job = finished(&store, Vec::new()).await;
    let (first, created) = request(&store, job.id, cut(1.0), Retention::Cached).await;
    assert!(created && !first.kept && first.state == ExportState::Queued);
    let (second, created) = request(&store, job.id, cut(1.0), Retention::Cached).await;
    assert!(!created && second.id == first.id);
    assert_eq!(store.claim_export(ExportQueue::Usual).await.unwrap().unwrap().export.id, first.id);
    assert_eq!(store.claim_export(ExportQueue::Usual).await.unwrap(), None, "it is being made");
    let (running, _) = request(&store, job.id, cut(1.0), Retention::Cached).await;
    assert_eq!(running.state, ExportState::Running);
    store.renew_export(&running, Some(progress(0.5))).await.unwrap();
    store.export_made(&running, file("p", 7), json!({"n": 1})).await.unwrap();
    let made = again(&store, &first).await.unwrap();
    assert_eq!((made.state, made.file.clone()), (ExportState::Succeeded, Some(file("p", 7))));
    assert_eq!((made.report, made.progress), (Some(json!({"n": 1})), None));
    assert!(
        matches!(store.export_made(&running, file("q", 7), json!({})).await, Err(StoreError::LeaseLost)),
        "it has ended"
    );
    let repeated = store.export_made(&running, file("p", 7), json!({"n": 1})).await;
    assert!(
        repeated.is_ok(),
        "the answer to a commit may be lost; who heard that it has ended would remove the file"
    );
    let other = request(&store, job.id, cut(2.0), Retention::Cached).await;
    assert!(other.1, "another thing");
    assert_eq!(store.list_exports(job.seq, None, 10).await.unwrap().exports.len(), 2);
    let ExportPage { exports: page, next_before: next, .. } =
        store.list_exports(job.seq, None, 1).await.unwrap();
    assert_eq!((page[0].id, next), (other.0.id, Some(other.0.seq)));
    assert_eq!(store.list_exports(job.seq, next, 1).await.unwrap().exports[0].id, first.id);
}

#[tokio::test]
async fn what_is_kept_shows_in_its_job() {
    let (_folder, store) = fresh().await;
    let job = finished(&store, vec![cut(1.0), cut(1.0), cut(2.0)]).await;
    assert_eq!(
        store.kept_of(job.seq).await.unwrap().len(),
        2,
        "two requests for the same export have one row"
    );
    let (used, _) = request(&store, job.id, cut(3.0), Retention::Cached).await;
    let version = |store: &Store| {
        let store = store.clone();
        async move { store.get(job.id).await.unwrap().unwrap().version }
    };
    assert_eq!(version(&store).await, job.version, "a cache is no news");
    let (kept, created) = request(&store, job.id, cut(3.0), Retention::Kept).await;
    assert!(!created && kept.kept && kept.id == used.id && kept.version > used.version);
    assert_eq!(version(&store).await, job.version + 1);
    request(&store, job.id, cut(3.0), Retention::Kept).await;
    assert_eq!(version(&store).await, job.version + 1, "it is kept already");
    store.delete_export(job.id, kept.id).await.unwrap();
    assert_eq!(version(&store).await, job.version + 2);
    assert_eq!(again(&store, &kept).await, None);
    assert!(matches!(store.delete_export(job.id, kept.id).await, Err(StoreError::NoExport)));
}

#[tokio::test]
async fn what_a_client_waits_for_comes_first_and_what_is_quick_has_its_own_way() {
    let (_folder, store) = fresh().await;
    let job = finished(&store, vec![slow(1.0), slow(2.0), cut(3.0)]).await;
    request(&store, job.id, slow(4.0), Retention::Cached).await;
    request(&store, job.id, slow(2.0), Retention::Cached).await;
    let mut order = Vec::new();
    let quick = store.claim_export(ExportQueue::Quick).await.unwrap().unwrap();
    assert_eq!(quick.export.options["at_mm"], 3.0);
    assert_eq!(store.claim_export(ExportQueue::Quick).await.unwrap(), None);
    while let Some(claimed) = store.claim_export(ExportQueue::Usual).await.unwrap() {
        assert_eq!(claimed.result.path, format!("{}.1", job.id));
        order.push(claimed.export.options["at_mm"].as_f64().unwrap());
    }
    assert_eq!(order, [2.0, 4.0, 1.0]);
}

#[tokio::test]
async fn what_was_running_at_a_crash_waits_again_but_not_for_ever() {
    let (folder, store) = fresh().await;
    let job = finished(&store, Vec::new()).await;
    let (requested, _) = request(&store, job.id, cut(1.0), Retention::Kept).await;
    let before = store.claim_export(ExportQueue::Usual).await.unwrap().unwrap().export;
    drop(store);
    let store = open(&folder, LIMITS).await;
    for _ in 0..2 {
        assert_eq!(store.recover_exports(Vec::new()).await.unwrap(), 1);
        assert!(
            matches!(store.export_made(&before, file("p", 1), json!({})).await, Err(StoreError::LeaseLost)),
            "a late word"
        );
        assert_eq!(store.claim_export(ExportQueue::Usual).await.unwrap().unwrap().export.id, requested.id);
    }
    store.recover_exports(Vec::new()).await.unwrap();
    let failed = again(&store, &requested).await.unwrap();
    assert_eq!(failed.state, ExportState::Failed);
    assert_eq!(failed.error.unwrap().code, FailureCode::AttemptsExhausted);
    // Who asks again wants it tried again, as often as before.
    assert_eq!(request(&store, job.id, cut(1.0), Retention::Cached).await.0.state, ExportState::Queued);
    assert_eq!(store.recover_exports(Vec::new()).await.unwrap(), 0);
    let again = store.claim_export(ExportQueue::Usual).await.unwrap().unwrap().export;
    assert!(again.attempt > failed.attempt, "a file of its own");
    assert!(
        matches!(store.export_made(&before, file("p", 1), json!({})).await, Err(StoreError::LeaseLost)),
        "a late word"
    );
    for _ in 0..2 {
        assert_eq!(store.recover_exports(Vec::new()).await.unwrap(), 1);
        assert!(store.claim_export(ExportQueue::Usual).await.unwrap().is_some());
    }
}

#[tokio::test]
async fn failures_of_the_options_stay_and_others_are_tried_again() {
    let (_folder, store) = fresh().await;
    let job = finished(&store, Vec::new()).await;
    for (kind, after) in
        [(FailureCode::TooLarge, ExportState::Failed), (FailureCode::InternalError, ExportState::Queued)]
    {
        request(&store, job.id, cut(1.0), Retention::Cached).await;
        if let Some(claimed) = store.claim_export(ExportQueue::Usual).await.unwrap() {
            store.export_failed(&claimed.export, &Failure::new(kind, "why")).await.unwrap();
        }
        let (requested, _) = request(&store, job.id, cut(1.0), Retention::Cached).await;
        assert_eq!(requested.state, after, "{}", kind.name());
        assert_eq!(requested.error.is_some(), after == ExportState::Failed);
        store.delete_export(job.id, requested.id).await.unwrap();
    }
    let (requested, _) = request(&store, job.id, cut(1.0), Retention::Cached).await;
    let claimed = store.claim_export(ExportQueue::Usual).await.unwrap().unwrap().export;
    store.export_requeued(&claimed).await.unwrap();
    let waiting = again(&store, &requested).await.unwrap();
    assert_eq!((waiting.state, waiting.attempt, waiting.started_at), (ExportState::Queued, 1, None));
}

#[tokio::test]
async fn all_files_of_a_job_go_with_it() {
    let (_folder, store) = fresh().await;
    let job = finished(&store, vec![cut(1.0)]).await;
    request(&store, job.id, cut(2.0), Retention::Cached).await;
    make(&store, "first", 1).await;
    let running = store.claim_export(ExportQueue::Usual).await.unwrap().unwrap().export;
    assert!(store.refers_to("first").await.unwrap());
    let mut files = store.delete(job.id).await.unwrap();
    files.sort();
    assert_eq!(files, [format!("{}.1", job.id), "first".to_owned()]);
    assert!(!store.refers_to("first").await.unwrap());
    assert!(matches!(store.check_export_lease(&running).await, Err(StoreError::LeaseLost)));
    assert!(matches!(
        store.export_made(&running, file("late", 1), json!({})).await,
        Err(StoreError::LeaseLost)
    ));
    assert!(matches!(
        store.request_export(job.id, cut(1.0), Retention::Cached).await,
        Err(StoreError::NoJob)
    ));
    let counts = store.export_counts().await.unwrap();
    assert!(counts.states.values().all(|n| *n == 0) && counts.cache_bytes == 0, "{counts:?}");

    let expiring = submit(&store, json!({"expires_at": "2030-01-01T00:00:00Z"})).await;
    let lease = store.claim().await.unwrap().unwrap().lease;
    store.succeed(lease, artifact("old"), progress(1.0), Facts::default(), vec![cut(1.0)]).await.unwrap();
    make(&store, "old-cut", 1).await;
    expire_all(&store).await;
    let removed = store.remove_expired().await.unwrap();
    assert_eq!(
        (removed[0].id, removed[0].files.clone()),
        (expiring.id, vec!["old-cut".into(), "old".into()])
    );
}

#[tokio::test]
async fn the_cache_drops_what_was_used_longest_ago_and_nothing_that_is_kept() {
    let (_folder, store) = fresh().await;
    let job = finished(&store, Vec::new()).await;
    let mut made = Vec::new();
    for i in 0..4 {
        let retention = if i == 0 { Retention::Kept } else { Retention::Cached };
        request(&store, job.id, cut(f64::from(i)), retention).await;
        made.push(make(&store, &format!("file{i}"), 10).await);
    }
    assert_eq!(store.export_counts().await.unwrap().cache_bytes, 30);
    request(&store, job.id, cut(1.0), Retention::Cached).await;
    assert_eq!(store.shrink_cache(30, made[3].id).await.unwrap(), Vec::<String>::new());
    assert_eq!(store.shrink_cache(20, made[3].id).await.unwrap(), ["file2"]);
    assert_eq!(
        store.shrink_cache(0, made[3].id).await.unwrap(),
        ["file1"],
        "all but the one that is waited for"
    );
    assert!(again(&store, &made[0]).await.is_some(), "what is kept is no cache");
    assert_eq!(store.export_counts().await.unwrap().cache_bytes, 10);
    request(&store, job.id, cut(3.0), Retention::Kept).await;
    assert_eq!(store.export_counts().await.unwrap().cache_bytes, 0, "it is kept from now on");
    // Dropped, it is made again.
    assert!(request(&store, job.id, cut(2.0), Retention::Cached).await.1);
}

#[tokio::test]
async fn a_file_that_is_gone_is_made_again() {
    let (_folder, store) = fresh().await;
    let job = finished(&store, Vec::new()).await;
    request(&store, job.id, cut(1.0), Retention::Cached).await;
    let made = make(&store, "first", 5).await;
    store.requeue_export(made.seq, "other".into()).await.unwrap();
    assert_eq!(again(&store, &made).await.unwrap().state, ExportState::Succeeded, "that was another file");
    store.requeue_export(made.seq, "first".into()).await.unwrap();
    store.requeue_export(made.seq, "first".into()).await.unwrap();
    assert_eq!(store.export_counts().await.unwrap().cache_bytes, 0);
    let again = make(&store, "second", 5).await;
    assert_eq!((again.id, again.attempt), (made.id, 2));
}

#[tokio::test]
async fn what_waits_and_what_is_kept_is_bounded() {
    let (_folder, store) = fresh().await;
    let job = finished(&store, Vec::new()).await;
    let other = finished(&store, Vec::new()).await;
    for i in 0..MAX_KEPT {
        request(&store, job.id, cut(i as f64), Retention::Kept).await;
    }
    let refused = store.request_export(job.id, cut(1e5), Retention::Kept).await;
    assert!(matches!(refused, Err(StoreError::TooManyKept { .. })), "{refused:?}");
    assert!(
        !request(&store, job.id, cut(0.0), Retention::Kept).await.1,
        "an export that exists can still be requested"
    );
    for i in MAX_KEPT..MAX_WAITING {
        request(&store, job.id, cut(i as f64), Retention::Cached).await;
    }
    let refused = store.request_export(other.id, cut(0.0), Retention::Cached).await;
    assert!(matches!(refused, Err(StoreError::TooManyWait { .. })), "{refused:?}");
    store.claim_export(ExportQueue::Usual).await.unwrap().unwrap();
    request(&store, other.id, cut(0.0), Retention::Cached).await;
    // However much waits, the next is found by an index.
    let (_folder, file) = fresh_file().await;
    for (queue, index) in [
        (ExportQueue::Usual, "exports_queue"),
        (ExportQueue::Quick, "exports_quick"),
        (ExportQueue::Heavy, "exports_heavy"),
        (ExportQueue::HeavyUnmeshed, "exports_heavy"),
        (ExportQueue::HeavyMeshed, "exports_heavy"),
    ] {
        let plan = plan_of(&file, super::claims::claim_sql(queue)).await;
        assert!(plan.iter().any(|step| step.contains(index)), "{plan:?}");
        assert!(!plan.iter().any(|step| step.contains("TEMP B-TREE")), "{plan:?}");
    }
}

#[tokio::test]
async fn exports_of_a_damaged_job_end_with_its_retry_and_are_made_after_it() {
    let (_folder, store) = fresh().await;
    let job = finished(&store, vec![slow(1.0)]).await;
    let (waiting, _) = request(&store, job.id, slow(2.0), Retention::Cached).await;
    let running = store.claim_export(ExportQueue::Usual).await.unwrap().unwrap().export;
    assert_eq!(running.id, waiting.id, "a client waits for it");
    let mut changes = store.subscribe_export(running.id);
    let damaged = job.artifact.unwrap().path;
    store.retry(job.id, Some(damaged)).await.unwrap();
    changes.changed().await;
    assert!(matches!(store.check_export_lease(&running).await, Err(StoreError::LeaseLost)));
    assert_eq!(store.claim_export(ExportQueue::Usual).await.unwrap(), None);
    let ended = store.list_exports(job.seq, None, 10).await.unwrap().exports;
    assert_eq!(ended.len(), 2);
    for export in ended {
        assert_eq!(export.state, ExportState::Failed);
        assert_eq!(export.error.unwrap().code, FailureCode::ResultDamaged);
    }
    // The same bits again: the keys are the same too.
    let lease = store.claim().await.unwrap().unwrap().lease;
    let again = artifact(&format!("{}.2", lease.id));
    store.succeed(lease, again, progress(1.0), Facts::default(), vec![slow(1.0)]).await.unwrap();
    let of_request = store.claim_export(ExportQueue::Usual).await.unwrap().unwrap();
    assert_eq!((of_request.export.key.clone(), of_request.export.kept), (slow(1.0).key, true));
    assert!(of_request.result.path.ends_with(".2"));
    assert_eq!(request(&store, job.id, slow(2.0), Retention::Cached).await.0.state, ExportState::Queued);
}

#[tokio::test]
async fn an_export_of_a_job_without_a_result_holds_up_no_other() {
    let (_folder, store) = fresh().await;
    let (first, second) = (finished(&store, Vec::new()).await, finished(&store, Vec::new()).await);
    let (lost, _) = request(&store, first.id, cut(1.0), Retention::Cached).await;
    let (good, _) = request(&store, second.id, cut(1.0), Retention::Cached).await;
    query("delete from artifacts where job = ?")
        .bind(first.seq)
        .execute(&mut store.writer().await.unwrap())
        .await
        .unwrap();
    assert_eq!(store.claim_export(ExportQueue::Usual).await.unwrap().unwrap().export.id, good.id);
    assert_eq!(again(&store, &lost).await.unwrap().state, ExportState::Failed);
}

#[tokio::test]
async fn an_export_whose_row_is_damaged_fails_and_holds_up_no_other() {
    let (_folder, store) = fresh().await;
    let job = finished(&store, Vec::new()).await;
    let (damaged, _) = request(&store, job.id, cut(1.0), Retention::Cached).await;
    let (good, _) = request(&store, job.id, cut(2.0), Retention::Cached).await;
    query("update exports set options = '{\"axis\"' where seq = ?")
        .bind(damaged.seq)
        .execute(&mut store.writer().await.unwrap())
        .await
        .unwrap();
    assert_eq!(store.claim_export(ExportQueue::Usual).await.unwrap().unwrap().export.id, good.id);
    let row = query("select state, error from exports where seq = ?")
        .bind(damaged.seq)
        .fetch_optional(store.readers())
        .await
        .unwrap()
        .unwrap();
    assert_eq!(row.text("state").unwrap(), "failed");
    assert!(row.text("error").unwrap().contains("is damaged"), "{:?}", row.text("error"));
    // The same request replaces the row, and a damaged one can be removed.
    let (replaced, created) = request(&store, job.id, cut(1.0), Retention::Cached).await;
    assert!(created && replaced.id != damaged.id, "{replaced:?}");
    query("update exports set type = 'mesch'").execute(&mut store.writer().await.unwrap()).await.unwrap();
    store.delete_export(job.id, good.id).await.unwrap();
    assert!(matches!(store.delete_export(job.id, good.id).await, Err(StoreError::NoExport)));
}

#[tokio::test]
async fn an_idle_export_worker_sees_the_end_of_a_pause_that_nobody_tells_of() {
    let (_folder, store) = fresh().await;
    let job = finished(&store, Vec::new()).await;
    request(&store, job.id, cut(1.0), Retention::Cached).await;
    // The words of the request are taken by a worker that finds it paused, as after a restart.
    let until = Timestamp::now().as_microsecond() + 500_000;
    query("update exports set not_before = ?")
        .bind(until)
        .execute(&mut store.writer().await.unwrap())
        .await
        .unwrap();
    store.exports_queued(ExportQueue::Usual).await;
    assert_eq!(store.claim_export(ExportQueue::Usual).await.unwrap(), None, "it is paused");
    store.exports_queued(ExportQueue::Usual).await;
    assert!(store.claim_export(ExportQueue::Usual).await.unwrap().is_some());
}
