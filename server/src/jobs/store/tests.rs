//! The store on real files: the moves of a job, who may make them, and what survives.

#![allow(clippy::unwrap_used)]

use packstone_engine::Limits;
use serde_json::json;
use sqlx::Connection as _;
use tempfile::TempDir;

use super::db::query;
use super::*;
use crate::accounts::{Quotas, Submitter};
use crate::exports::{NewExport, StoredFile};
use crate::failure::{Failure, FailureCode};
use crate::jobs::{ArtifactRecord, JobProgress, JobRecord, JobRequest};
use crate::studies::{Facts, Study};

pub(super) const LIMITS: StoreLimits = StoreLimits { max_queued: 1000, lease: Duration::from_mins(1) };

pub(super) async fn open(folder: &TempDir, limits: StoreLimits) -> Store {
    with_quotas(folder, limits, Quotas::default()).await
}

pub(super) async fn with_quotas(folder: &TempDir, limits: StoreLimits, quotas: Quotas) -> Store {
    let accounts = Arc::new(Accounts::new(None, quotas));
    Store::open(&database(folder).await, folder.path(), limits, accounts).await.unwrap()
}

/// The same; PostgreSQL as a service opens it, for which other servers may use it.
pub(super) async fn open_shared(folder: &TempDir, limits: StoreLimits) -> Store {
    let mut database = database(folder).await;
    if let Database::Postgres { is_shared, .. } = &mut database {
        *is_shared = true;
    }
    Store::open(&database, folder.path(), limits, Arc::default()).await.unwrap()
}

/// The database of a test: a file in its folder, or one of its own in the PostgreSQL that `PACKSTONE_TEST_POSTGRES`
/// names, a URL without a database.
pub(super) async fn database(folder: &TempDir) -> Database {
    let Ok(server) = std::env::var("PACKSTONE_TEST_POSTGRES") else { return file_of(folder) };
    let server = db::postgres::options(&server).unwrap();
    let name = folder.path().file_name().unwrap().to_str().unwrap();
    let name = crate::hex::encode(name.as_bytes());
    let mut maintenance =
        sqlx::PgConnection::connect_with(&server.clone().database("postgres")).await.unwrap();
    let create = sqlx::AssertSqlSafe(format!("create database \"{name}\""));
    // It exists where a test opens its store again.
    let created = sqlx::query(create).execute(&mut maintenance).await;
    assert!(created.is_ok() || created.unwrap_err().as_database_error().unwrap().code().unwrap() == "42P04");
    Database::Postgres { options: Box::new(server.database(&name)), is_shared: false }
}

/// Opens that file as this version does.
pub(super) async fn open_file(folder: &TempDir) -> Store {
    Store::open(&file_of(folder), folder.path(), LIMITS, Arc::default()).await.unwrap()
}

/// A store in SQLite, whatever the tests run on.
pub(super) async fn fresh_file() -> (TempDir, Store) {
    let folder = tempfile::tempdir().unwrap();
    let store = open_file(&folder).await;
    (folder, store)
}

fn file_of(folder: &TempDir) -> Database {
    folder.path().join("packstone.sqlite").as_path().into()
}

pub(super) async fn fresh() -> (TempDir, Store) {
    let folder = tempfile::tempdir().unwrap();
    let store = open(&folder, LIMITS).await;
    (folder, store)
}

pub(super) fn request(extra: &serde_json::Value) -> JobRequest {
    let mut job = json!({
        "specimen": {"type": "box", "size_mm": [50, 50, 50]},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2}
    });
    job.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
    JobRequest::read(&job, 7, None).unwrap()
}

pub(super) async fn submit(store: &Store, extra: serde_json::Value) -> JobRecord {
    submit_forecast(store, 1.0, extra).await
}

pub(super) async fn submit_forecast(store: &Store, forecast_s: f64, extra: serde_json::Value) -> JobRecord {
    let new = NewJob {
        request: request(&extra),
        warnings: Vec::new(),
        forecast_s,
        keeps_checkpoints: true,
        most_threads: 1,
        by: Submitter::default(),
        idempotency_key: None,
    };
    match store.submit(new).await.unwrap() {
        Submitted::Created(job) => job,
        Submitted::Existing(_) => panic!("a job without a key exists already"),
    }
}

pub(super) async fn submit_as(
    store: &Store,
    owner: &str,
    extra: serde_json::Value,
) -> Result<JobRecord, StoreError> {
    let by = Submitter { key: format!("key of {owner}"), owner: owner.into() };
    let request = request(&extra);
    let new = NewJob {
        request,
        warnings: Vec::new(),
        forecast_s: 1.0,
        keeps_checkpoints: true,
        most_threads: 1,
        by,
        idempotency_key: None,
    };
    match store.submit(new).await? {
        Submitted::Created(job) => Ok(job),
        Submitted::Existing(_) => panic!("a job without a key exists already"),
    }
}

/// Lets the time pass at which the jobs and studies expire that have one.
pub(super) async fn expire_all(store: &Store) {
    for text in [
        "update jobs set expires_at = 1 where expires_at is not null",
        "update studies set expires_at = 1 where expires_at is not null",
    ] {
        query(text).execute(&mut store.writer().await.unwrap()).await.unwrap();
    }
}

pub(super) fn progress(fraction: f64) -> JobProgress {
    JobProgress {
        fraction,
        step: packstone_engine::Step::Rsa,
        done: 1,
        total: 2,
        unit: "grains".into(),
        message: String::new(),
        eta_s: None,
        growth: None,
    }
}

pub(super) fn artifact(path: &str) -> ArtifactRecord {
    ArtifactRecord {
        path: path.into(),
        bytes: 10,
        sha256: "ab".repeat(32),
        report: json!({"summary": {"grains": 3}}).as_object().unwrap().clone(),
        format_revision: 1,
        format_lengths: [("json".to_owned(), 99)].into(),
    }
}

pub(super) async fn succeed(store: &Store, lease: Lease) {
    let path = format!("{}.{}", lease.id, lease.attempt);
    store.succeed(lease, artifact(&path), progress(1.0), Facts::default(), Vec::new()).await.unwrap();
}

#[tokio::test]
async fn the_library_has_no_known_corruption_bugs() {
    let (_folder, store) = fresh_file().await;
    let version: String = query("select sqlite_version()").scalar(store.readers()).await.unwrap();
    let parts: Vec<u32> = version.split('.').map(|part| part.parse().unwrap()).collect();
    assert!(parts >= vec![3, 51, 3], "SQLite {version}");
}

#[tokio::test]
async fn a_job_runs_through_its_states() {
    let (_folder, store) = fresh().await;
    let job = submit(&store, json!({"name": "n", "labels": {"a": "b"}, "timeout_s": 5})).await;
    assert_eq!((job.state, job.attempt, job.version), (State::Queued, 1, 1));
    let claimed = store.claim().await.unwrap().unwrap();
    assert_eq!((claimed.lease.id, claimed.job.state), (job.id, State::Running));
    assert_eq!(claimed.job.timeout_s, Some(5.0));
    assert_eq!(serde_json::from_str::<serde_json::Value>(&claimed.request).unwrap()["name"], "n");
    assert_eq!(store.claim().await.unwrap(), None);
    store.heartbeat(claimed.lease, Some(progress(0.5))).await.unwrap();
    let running = store.get(job.id).await.unwrap().unwrap();
    assert_eq!(running.progress.unwrap()["fraction"], 0.5);
    assert_eq!(running.version, 3);
    store.heartbeat(claimed.lease, None).await.unwrap();
    assert_eq!(store.get(job.id).await.unwrap().unwrap().version, 3, "a renewal is no news");
    succeed(&store, claimed.lease).await;
    let done = store.get(job.id).await.unwrap().unwrap();
    assert_eq!(done.state, State::Succeeded);
    assert_eq!(done.artifact.unwrap().format_lengths["json"], 99);
    assert!(done.finished_at >= done.started_at);
    assert_eq!(store.request(job.seq).await.unwrap()["labels"], json!({"a": "b"}));
}

#[tokio::test]
async fn the_next_job_is_the_oldest_of_the_highest_priority() {
    let (_folder, store) = fresh().await;
    let mut ids = Vec::new();
    for priority in [0, 5, -5, 5] {
        ids.push(submit(&store, json!({"priority": priority})).await.id);
    }
    for expected in [ids[1], ids[3], ids[0], ids[2]] {
        assert_eq!(store.claim().await.unwrap().unwrap().lease.id, expected);
    }
}

#[tokio::test]
async fn only_the_holder_of_the_lease_may_write() {
    let (_folder, store) = fresh().await;
    submit(&store, json!({})).await;
    let old = store.claim().await.unwrap().unwrap().lease;
    assert_eq!(store.recover(Vec::new()).await.unwrap(), 1);
    let new = store.claim().await.unwrap().unwrap().lease;
    assert_eq!((new.id, new.attempt), (old.id, old.attempt + 1));
    let failure = Failure::internal();
    assert!(matches!(store.heartbeat(old, Some(progress(0.1))).await, Err(StoreError::LeaseLost)));
    assert!(matches!(
        store.succeed(old, artifact("x"), progress(1.0), Facts::default(), Vec::new()).await,
        Err(StoreError::LeaseLost)
    ));
    assert!(matches!(store.fail(old, &failure, Facts::default()).await, Err(StoreError::LeaseLost)));
    assert!(matches!(store.finish_cancelled(old).await, Err(StoreError::LeaseLost)));
    assert!(matches!(store.give_back(old).await, Err(StoreError::LeaseLost)));
    assert!(!store.refers_to("x").await.unwrap());
    succeed(&store, new).await;
    // As after a commit whose answer was lost: no caller may take its file for one that nobody records.
    succeed(&store, new).await;
    assert_eq!(store.get(new.id).await.unwrap().unwrap().state, State::Succeeded);
    assert!(
        matches!(store.fail(new, &failure, Facts::default()).await, Err(StoreError::LeaseLost)),
        "it ended already"
    );
}

#[tokio::test]
async fn recovery_counts_attempts_and_a_shutdown_does_not() {
    let (folder, store) = fresh().await;
    let job = submit(&store, json!({"max_attempts": 2})).await;
    let lease = store.claim().await.unwrap().unwrap().lease;
    store.give_back(lease).await.unwrap();
    let given_back = store.get(job.id).await.unwrap().unwrap();
    assert_eq!((given_back.state, given_back.attempt), (State::Queued, 1));
    store.claim().await.unwrap().unwrap();
    // The process ends without a word, and another opens the file.
    drop(store);
    let store = open(&folder, LIMITS).await;
    assert_eq!(store.recover(Vec::new()).await.unwrap(), 1);
    assert_eq!(store.claim().await.unwrap().unwrap().lease.attempt, 2);
    assert_eq!(store.recover(Vec::new()).await.unwrap(), 1);
    let ended = store.get(job.id).await.unwrap().unwrap();
    assert_eq!(ended.state, State::Failed);
    assert_eq!(ended.error.unwrap().code, FailureCode::AttemptsExhausted);
    assert_eq!(store.recover(Vec::new()).await.unwrap(), 0);
    // What an attempt left before it was recorded belongs to nobody.
    let id = job.id.to_string();
    let left = [1, 2].map(|attempt| format!("{}/{id}.{attempt}.packstone", &id[id.len() - 2..]));
    assert_eq!(store.removals(9).await.unwrap(), left);
    let retried = store.retry(job.id, None).await.unwrap();
    assert_eq!((retried.state, retried.attempt, retried.max_attempts), (State::Queued, 3, 4));
    assert_eq!((retried.error, retried.finished_at), (None, None));
}

/// A request of the first run may reach the database late, after another server has begun a run of its own: with the
/// number of its attempt the first result would be recorded, and the second written over its file.
#[tokio::test]
async fn where_servers_share_a_queue_every_run_has_an_attempt_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let store = open_shared(&folder, LIMITS).await;
    if !store.is_shared() {
        eprintln!("SKIPPED: PACKSTONE_TEST_POSTGRES names no PostgreSQL");
        return;
    }
    let job = submit(&store, json!({"max_attempts": 2})).await;
    let first = store.claim().await.unwrap().unwrap().lease;
    store.requeue_after_fault(first, crate::jobs::WaitReason::machine()).await.unwrap();
    store.end_pauses(job.owner.clone()).await.unwrap();
    let second = store.claim().await.unwrap().unwrap().lease;
    store.give_back(second).await.unwrap();
    let third = store.claim().await.unwrap().unwrap();
    assert_eq!((first.attempt, second.attempt, third.lease.attempt), (1, 2, 3));
    assert_eq!(third.job.max_attempts, 4, "neither counts");
    for late in [first, second] {
        let recorded =
            store.succeed(late, artifact("late"), progress(1.0), Facts::default(), Vec::new()).await;
        assert!(matches!(recorded, Err(StoreError::LeaseLost)));
    }
    succeed(&store, third.lease).await;

    let export =
        packstone_engine::export::ExportRequest::from_json(&json!({"type": "slice", "at_mm": 1.0})).unwrap();
    let export = NewExport::new(&export, "ab");
    store.request_export(job.id, export, Retention::Kept).await.unwrap();
    let mut runs = Vec::new();
    for is_fault in [false, true] {
        let run = store.claim_export(ExportQueue::Usual).await.unwrap().unwrap().export;
        if is_fault {
            store.export_requeued_after_fault(&run).await.unwrap();
        } else {
            store.export_requeued(&run).await.unwrap();
        }
        runs.push(run);
    }
    query("update exports set not_before = null").execute(&mut store.writer().await.unwrap()).await.unwrap();
    let last = store.claim_export(ExportQueue::Usual).await.unwrap().unwrap().export;
    assert_eq!((runs[0].attempt, runs[1].attempt, last.attempt), (1, 2, 3));
    for late in &runs {
        let file = StoredFile { path: "late".into(), bytes: 1, sha256: "cd".repeat(32) };
        assert!(matches!(store.export_made(late, file, json!({})).await, Err(StoreError::LeaseLost)));
    }
    for starts_left in (0..3).rev() {
        query("update exports set lease_expires_at = 0")
            .execute(&mut store.writer().await.unwrap())
            .await
            .unwrap();
        assert_eq!(store.reclaim_expired_exports(Vec::new()).await.unwrap(), 1);
        assert_eq!(
            store.claim_export(ExportQueue::Usual).await.unwrap().is_some(),
            starts_left > 0,
            "neither counts"
        );
    }
}

#[tokio::test]
async fn a_job_whose_cancellation_was_asked_for_is_not_recovered() {
    let (_folder, store) = fresh().await;
    let job = submit(&store, json!({})).await;
    let lease = store.claim().await.unwrap().unwrap().lease;
    let Cancelled::Soon(asked) = store.cancel(job.id).await.unwrap() else { panic!("it was running") };
    assert!(asked.cancel_requested);
    let Cancelled::Soon(again) = store.cancel(job.id).await.unwrap() else { panic!("it was running") };
    assert_eq!(again.version, asked.version, "asking twice is no news");
    assert!(store.heartbeat(lease, None).await.unwrap().cancel);
    store.recover(Vec::new()).await.unwrap();
    assert_eq!(store.get(job.id).await.unwrap().unwrap().state, State::Cancelled);
}

#[tokio::test]
async fn leases_run_out() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(&folder, StoreLimits { lease: Duration::ZERO, ..LIMITS }).await;
    let job = submit(&store, json!({})).await;
    store.claim().await.unwrap().unwrap();
    assert_eq!(store.reclaim_expired_leases(Vec::new()).await.unwrap(), 1);
    assert_eq!(store.get(job.id).await.unwrap().unwrap().attempt, 2);
    drop(store);
    let store = open(&folder, LIMITS).await;
    store.claim().await.unwrap().unwrap();
    assert_eq!(store.reclaim_expired_leases(Vec::new()).await.unwrap(), 0, "this one lasts a minute");
}

#[tokio::test]
async fn states_forbid_what_makes_no_sense() {
    let (_folder, store) = fresh().await;
    let queued = submit(&store, json!({})).await.id;
    assert!(matches!(store.retry(queued, None).await, Err(StoreError::Forbidden(State::Queued))));
    assert!(matches!(store.delete(queued).await, Err(StoreError::Forbidden(State::Queued))));
    let lease = store.claim().await.unwrap().unwrap().lease;
    assert!(matches!(store.delete(queued).await, Err(StoreError::Forbidden(State::Running))));
    succeed(&store, lease).await;
    assert!(matches!(store.cancel(queued).await, Err(StoreError::Forbidden(State::Succeeded))));
    assert!(matches!(store.retry(queued, None).await, Err(StoreError::Forbidden(State::Succeeded))));
    assert_eq!(store.delete(queued).await.unwrap(), [format!("{queued}.1")]);
    assert_eq!(store.get(queued).await.unwrap(), None);
    assert!(matches!(store.cancel(queued).await, Err(StoreError::NoJob)));
    let waiting = submit(&store, json!({})).await.id;
    assert!(
        matches!(store.cancel(waiting).await.unwrap(), Cancelled::Now(job) if job.state == State::Cancelled)
    );
    assert_eq!(store.claim().await.unwrap(), None, "a cancelled job is not run");
}

#[tokio::test]
async fn a_key_brings_the_same_job_even_after_a_restart() {
    let (folder, store) = fresh().await;
    let keyed = |scope: &str, body: &str| NewJob {
        request: request(&json!({})),
        warnings: Vec::new(),
        forecast_s: 1.0,
        keeps_checkpoints: true,
        most_threads: 1,
        by: Submitter { key: scope.into(), owner: scope.into() },
        idempotency_key: Some(IdempotencyKey {
            scope: scope.into(),
            key: "k".into(),
            body_sha256: body.into(),
        }),
    };
    let mut together = Vec::new();
    for _ in 0..16 {
        together.push(tokio::spawn({
            let (store, new) = (store.clone(), keyed("lab", "1"));
            async move { store.submit(new).await.unwrap() }
        }));
    }
    let (mut created, mut existing) = (Vec::new(), Vec::new());
    for submitted in together {
        match submitted.await.unwrap() {
            Submitted::Created(job) => created.push(job.id),
            Submitted::Existing(job) => existing.push(job.id),
        }
    }
    assert_eq!((created.len(), existing.len()), (1, 15));
    assert!(existing.iter().all(|id| *id == created[0]));
    drop(store);
    let store = open(&folder, LIMITS).await;
    assert!(
        matches!(store.submit(keyed("lab", "1")).await.unwrap(), Submitted::Existing(job) if job.id == created[0])
    );
    assert!(matches!(store.submit(keyed("lab", "2")).await, Err(StoreError::KeyReused)));
    assert!(matches!(store.submit(keyed("field", "2")).await.unwrap(), Submitted::Created(_)));
    store.cancel(created[0]).await.unwrap();
    store.delete(created[0]).await.unwrap();
    assert!(
        matches!(store.submit(keyed("lab", "2")).await.unwrap(), Submitted::Created(_)),
        "its job is gone"
    );
}

#[tokio::test]
async fn the_queue_is_bounded() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(&folder, StoreLimits { max_queued: 2, ..LIMITS }).await;
    let first = submit(&store, json!({})).await.id;
    submit(&store, json!({})).await;
    let third = NewJob {
        request: request(&json!({})),
        warnings: Vec::new(),
        forecast_s: 1.0,
        keeps_checkpoints: true,
        most_threads: 1,
        by: Submitter::default(),
        idempotency_key: None,
    };
    assert!(matches!(store.submit(third.clone()).await, Err(StoreError::QueueFull { most: 2, .. })));
    store.cancel(first).await.unwrap();
    assert!(matches!(store.submit(third).await.unwrap(), Submitted::Created(_)));
    assert!(matches!(store.retry(first, None).await, Err(StoreError::QueueFull { most: 2, .. })));
    let counts = store.counts().await.unwrap();
    assert_eq!((counts[&State::Queued], counts[&State::Cancelled]), (2, 1));
}

#[tokio::test]
async fn pages_neither_repeat_nor_skip_while_jobs_come_in() {
    let (_folder, store) = fresh().await;
    let mut expected = Vec::new();
    for i in 0..25 {
        let job = submit(&store, json!({"labels": {"parity": (i % 2).to_string(), "all": "x"}})).await;
        if i % 2 == 1 {
            expected.insert(0, job.id);
        }
        if i % 4 == 3 {
            store.cancel(job.id).await.unwrap();
        }
    }
    let label = |key: &str, value: &str| (key.to_owned(), value.to_owned());
    let odd = Filter { labels: vec![label("all", "x"), label("parity", "1")], ..Filter::default() };
    let (mut seen, mut before) = (Vec::new(), None);
    loop {
        let page = store.list(&odd, before, 5).await.unwrap();
        assert!(page.jobs.len() <= 5);
        seen.extend(page.jobs.iter().map(|job| job.id));
        submit(&store, json!({"labels": {"parity": "1", "all": "x"}})).await;
        match page.next_after {
            Some(next) => before = Some(next),
            None => break,
        }
    }
    assert_eq!(seen, expected);
    let cancelled = Filter { state: Some(State::Cancelled), ..odd.clone() };
    assert_eq!(store.list(&cancelled, None, 500).await.unwrap().jobs.len(), 6);
    let cancelled = Filter { state: Some(State::Cancelled), ..Filter::default() };
    assert_eq!(store.list(&cancelled, None, 500).await.unwrap().jobs.len(), 6);
    let none = Filter { labels: vec![label("parity", "2")], ..Filter::default() };
    assert_eq!(store.list(&none, None, 500).await.unwrap().jobs, []);
    assert_eq!(store.list(&Filter::default(), None, 500).await.unwrap().jobs.len(), 28);
}

#[tokio::test]
async fn only_finished_jobs_expire() {
    let (_folder, store) = fresh().await;
    let later = json!({"expires_at": "2030-01-01T00:00:00Z"});
    let done = submit(&store, later.clone()).await.id;
    let lease = store.claim().await.unwrap().unwrap().lease;
    succeed(&store, lease).await;
    let waiting = submit(&store, later).await.id;
    expire_all(&store).await;
    let lasting = submit(&store, json!({"expires_at": "2999-01-01T00:00:00Z"})).await.id;
    store.cancel(lasting).await.unwrap();
    let removed = store.remove_expired().await.unwrap();
    assert_eq!(removed.len(), 1);
    assert_eq!((removed[0].id, removed[0].files.clone()), (done, vec![format!("{done}.1")]));
    assert_eq!(store.remove_expired().await.unwrap(), []);
    assert!(store.get(waiting).await.unwrap().is_some() && store.get(lasting).await.unwrap().is_some());
}

#[tokio::test]
async fn changes_wake_whoever_waits_for_the_job() {
    let (_folder, store) = fresh().await;
    let mark = store.queue_mark();
    let job = submit(&store, json!({})).await.id;
    let mut changes = store.subscribe(job);
    store.claim().await.unwrap().unwrap();
    changes.changed().await;
    store.cancel(job).await.unwrap();
    changes.changed().await;
    // A worker whose mark is older than the submission does not wait.
    store.queue_notified(mark, WorkUntil::Unlimited).await.end();
}

#[tokio::test]
async fn every_listing_and_claim_uses_an_index() {
    let (_folder, store) = fresh_file().await;
    let label = |key: &str| (key.to_owned(), "v".to_owned());
    for (state, labels) in [
        (None, vec![]),
        (Some(State::Queued), vec![]),
        (None, vec![label("a")]),
        (Some(State::Queued), vec![label("a"), label("b")]),
    ] {
        let plan = plan_of(&store, &query::list_sql(&Filter { state, labels, ..Filter::default() })).await;
        assert!(
            plan.iter().all(|step| !step.starts_with("SCAN") && !step.contains("TEMP B-TREE")),
            "{plan:?}"
        );
    }
    for (key, index) in [(SortKey::Priority, "jobs_by_priority"), (SortKey::Finished, "jobs_by_finished")] {
        for (descending, state) in [(false, None), (true, None), (true, Some(State::Succeeded))] {
            let filter = Filter { order: Order { key, descending }, state, ..Filter::default() };
            let plan = plan_of(&store, &query::list_sql(&filter)).await;
            assert!(plan[0].contains("SEARCH jobs") && plan[0].contains(index), "{plan:?}");
            assert!(plan.iter().all(|step| !step.contains("TEMP B-TREE")), "{plan:?}");
        }
        // What a label leaves is sorted.
        let order = Order { key, descending: true };
        let filter = Filter { order, labels: vec![label("a")], ..Filter::default() };
        let plan = plan_of(&store, &query::list_sql(&filter)).await;
        assert!(plan.iter().all(|step| !step.starts_with("SCAN")), "{plan:?}");
    }
    for (state, order) in [(None, Order::default()), (Some(State::Queued), Order::default())] {
        // What an owner may see is two ranges, of which no more than a page each is sorted.
        let filter = Filter { state, order, visible_to: Some("lab".into()), ..Filter::default() };
        let plan = plan_of(&store, &query::list_sql(&filter)).await;
        for index in ["jobs_by_owner", "jobs_shared"] {
            let walked = plan.iter().position(|step| step.contains(index)).unwrap();
            assert!(!plan[walked + 1].contains("TEMP B-TREE"), "{plan:?}");
        }
    }
    let plan = plan_of(&store, claims::NEXT_IN_QUEUE).await;
    let walked = plan.iter().position(|step| step.contains("jobs_queue")).unwrap();
    assert!(plan[walked].contains("SEARCH") && plan[walked].contains("owner=?"), "{plan:?}");
    // Only the owners' first jobs are sorted, and no row of the jobs is scanned.
    assert!(plan.iter().filter(|step| step.contains("TEMP B-TREE")).count() == 1, "{plan:?}");
    assert!(!plan[walked + 1].contains("TEMP B-TREE"), "{plan:?}");
    assert!(
        plan.iter().all(|step| !step.starts_with("SCAN head") && !step.starts_with("SCAN jobs")),
        "{plan:?}"
    );
}

/// The steps by which SQLite runs a statement.
pub(super) async fn plan_of(store: &Store, sql: &str) -> Vec<String> {
    let explained = db::QueryBuilder::new(&format!("explain query plan {sql}")).build();
    let rows = explained.fetch_all(store.readers()).await.unwrap();
    rows.iter().map(|row| row.try_get("detail").unwrap()).collect()
}

#[tokio::test]
async fn a_store_that_can_be_written_says_so_and_stays_as_it_is() {
    let (_folder, store) = fresh().await;
    submit(&store, json!({})).await;
    store.works().await.unwrap();
    assert_eq!(store.counts().await.unwrap()[&State::Queued], 1);
    store.close().await;
    assert!(store.get(JobId::new()).await.is_err());
}

#[tokio::test]
async fn threads_are_kept_beside_the_request() {
    let (_folder, store) = fresh().await;
    for threads in [json!(null), json!(3)] {
        let job = submit(&store, json!({"threads": threads})).await;
        let claimed = store.claim().await.unwrap().unwrap();
        assert_eq!(json!(job.threads), threads);
        assert_eq!((claimed.job.threads, claimed.job.most_threads), (job.threads, 1));
        assert!(!claimed.request.contains("threads"), "{}", claimed.request);
    }
}

#[tokio::test]
async fn a_search_finds_names_and_what_jobs_without_a_name_pack() {
    let (_folder, store) = fresh().await;
    let unnamed = submit(&store, json!({})).await;
    let named = submit(&store, json!({"name": "Größe"})).await;
    // A list that the requests of a study share.
    let part =
        json!({"share": 0.0625, "grading": {"type": "standard", "name": "A16"}, "density_kg_m3": 2650});
    let mix =
        json!({"volume_fraction": 0.2, "d_min_mm": 4, "allow_coarse": true, "aggregates": vec![part; 16]});
    let template = json!({"specimen": {"type": "box", "size_mm": [50, 50, 50]}, "mix": mix});
    let request = json!({"seed": 1, "template": template, "replicates": 2});
    let study = Study::read(&request, 1, None, &Limits::default()).unwrap();
    let (request, by) = (study.recorded(&request), Submitter::default());
    store.submit_study(NewStudy { study, request, by, idempotency_key: None }).await.unwrap();
    let find = async |words: &str| {
        let filter = Filter { name: Some(words.into()), ..Filter::default() };
        store.list(&filter, None, 10).await.unwrap().jobs.iter().map(|job| job.seq).collect::<Vec<_>>()
    };
    assert_eq!(find("One Size 8 mm, 20 %").await, [named.seq, unnamed.seq]);
    assert_eq!(find("größe").await, [named.seq]);
    assert_eq!(find("16 aggregates, 20 %, cube").await, [named.seq + 2, named.seq + 1]);
    assert_eq!(find("cube 51").await, [0_i64; 0]);
}
