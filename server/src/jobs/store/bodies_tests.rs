//! Requests on real files: what is stored once, what counts for the owner, what is given back, and damage.

#![allow(clippy::unwrap_used)]

use packstone_engine::Limits;
use serde_json::{Value, json};
use tempfile::TempDir;

use super::db::query;
use super::tests::{LIMITS, artifact, fresh, fresh_file, open, progress, submit, submit_as, succeed};
use super::*;
use crate::accounts::Submitter;
use crate::studies::{Facts, Study};

/// A study of the owner `lab` with so many jobs of 20 000 listed diameters.
async fn large_study(store: &Store, replicates: u32, first_mm: f64) -> (StudyRecord, usize) {
    study_of(store, replicates, (20_000, first_mm)).await
}

/// The same with so many diameters.
async fn study_of(store: &Store, replicates: u32, (count, first_mm): (u32, f64)) -> (StudyRecord, usize) {
    let diameters: Vec<f64> = (0..count).map(|i| first_mm + 1e-6 * f64::from(i)).collect();
    let request = json!({
        "seed": 7,
        "template": {
            "specimen": {"type": "box", "size_mm": [400, 400, 400]},
            "mix": {"grading": {"type": "diameters", "diameters_mm": diameters}},
            "method": {"type": "rsa"}
        },
        "replicates": replicates
    });
    let study = Study::read(&request, 1, None, &Limits::default()).unwrap();
    let by = Submitter { key: "key".into(), owner: "lab".into() };
    let new = NewStudy { request: study.recorded(&request), study, by, idempotency_key: None };
    let list = request["template"]["mix"]["grading"]["diameters_mm"].to_string().len();
    match store.submit_study(new).await.unwrap() {
        SubmittedStudy::Created(study) => (study, list),
        SubmittedStudy::Existing(_) => panic!("a study without a key exists already"),
    }
}

#[tokio::test]
async fn the_list_that_the_jobs_of_a_study_share_is_stored_once_and_counts_for_the_owner() {
    let (_folder, store) = fresh().await;
    let (study, list) = large_study(&store, 60, 1.0).await;
    let parts: i64 = query("select count(*) from study_parts").scalar(store.readers()).await.unwrap();
    let bytes: i64 = query(
        "select cast((select sum(length(body)) from study_parts) + (select sum(length(body)) from job_requests)
             + (select sum(length(body)) from study_requests) as bigint)",
    )
    .scalar(store.readers())
    .await
    .unwrap();
    assert!(parts <= 2 && (bytes as usize) < 3 * list, "{parts} parts, {bytes} bytes, {list} of one list");
    let usage = store.usage_of("lab").await.unwrap();
    assert_eq!(usage.stored_bytes, bytes as u64);
    assert_eq!(store.stored_bytes().await.unwrap()[&("lab".to_owned(), StoredKind::Requests)], bytes as u64);
    // Each reader gets the whole request.
    let claimed = store.claim().await.unwrap().unwrap();
    let body: Value = serde_json::from_str(&claimed.request).unwrap();
    assert_eq!(body["mix"]["grading"]["diameters_mm"].as_array().unwrap().len(), 20_000);
    assert_eq!(store.request(claimed.job.seq).await.unwrap(), body);
    let request = store.study_request(study.seq).await.unwrap();
    assert_eq!(request["template"]["mix"]["grading"], body["mix"]["grading"]);

    store.finish_cancelled(claimed.lease).await.unwrap();
    store.cancel_study(study.id).await.unwrap();
    store.delete_study(study.id).await.unwrap();
    assert_eq!(store.usage_of("lab").await.unwrap().stored_bytes, 0);
    let job = submit_as(&store, "lab", json!({})).await.unwrap();
    assert!(store.usage_of("lab").await.unwrap().stored_bytes > 50);
    store.cancel(job.id).await.unwrap();
    store.delete(job.id).await.unwrap();
    assert_eq!(store.usage_of("lab").await.unwrap().stored_bytes, 0);
}

#[tokio::test]
async fn a_file_becomes_short_again_when_what_it_held_is_deleted() {
    let (folder, store) = fresh_file().await;
    let length = || std::fs::metadata(folder.path().join("packstone.sqlite")).unwrap().len();
    let mut studies = Vec::new();
    for first in 1..=12 {
        studies.push(large_study(&store, 2, f64::from(first)).await.0.id);
    }
    store.shrink_log().await;
    let full = length();
    for study in studies {
        store.cancel_study(study).await.unwrap();
        store.delete_study(study).await.unwrap();
    }
    store.give_back_pages().await.unwrap();
    store.shrink_log().await;
    // 256 free pages stay, and the tables themselves.
    assert!(full > 2 << 20 && length() < (256 * 4096) + (1 << 20), "{full} bytes, then {}", length());
}

/// Changes a stored text as a flipped bit does: what it reads is still a document.
async fn damage(store: &Store, statement: &'static str) {
    query(statement).execute(&mut store.writer().await.unwrap()).await.unwrap();
}

async fn read_rows(folder: &TempDir, store: &Store) -> RowsRead {
    store.shrink_log().await;
    read_every_row(&tests::database(folder).await).await.unwrap()
}

#[tokio::test]
async fn a_damaged_row_is_left_out_of_lists_and_named_and_all_others_are_served() {
    let (folder, store) = fresh().await;
    let mut ids = Vec::new();
    for _ in 0..5 {
        ids.push(submit(&store, json!({})).await.id);
        let lease = store.claim().await.unwrap().unwrap().lease;
        succeed(&store, lease).await;
    }
    assert_eq!(read_rows(&folder, &store).await.damaged, []);
    // A figure of a report, a document that is none any more, and a request.
    damage(&store, "update artifacts set report = replace(report, '3', '7') where job = 2").await;
    damage(&store, "update jobs set labels = '[}' where seq = 4").await;
    damage(&store, "update job_requests set body = replace(body, '0.2', '0.3') where job = 5").await;
    let page = store.list(&Filter::default(), None, 10).await.unwrap();
    assert_eq!(page.jobs.iter().map(|job| job.seq).collect::<Vec<_>>(), [5, 3, 1]);
    assert_eq!(
        page.damaged.iter().map(|row| &row.id).collect::<Vec<_>>(),
        [&ids[3].to_string(), &ids[1].to_string()]
    );
    // A page ends with a damaged row, and the next goes on behind it.
    let first = store.list(&Filter::default(), None, 2).await.unwrap();
    assert_eq!((first.jobs.len(), first.damaged.len()), (1, 1));
    let second = store.list(&Filter::default(), first.next_after, 10).await.unwrap();
    assert_eq!((second.jobs.len(), second.damaged.len()), (2, 1));
    for id in [ids[1], ids[3]] {
        assert!(matches!(store.get(id).await, Err(StoreError::Row(_))));
    }
    assert!(store.get(ids[4]).await.unwrap().is_some());
    assert!(matches!(store.request(5).await, Err(StoreError::Row(_))));
    let read = read_rows(&folder, &store).await;
    let found: Vec<_> = read.damaged.iter().map(|(table, row)| (*table, row.id.clone())).collect();
    assert_eq!(found, [1, 3, 4].map(|i: usize| ("jobs", ids[i].to_string())));
    assert_eq!(read.rows, 5);
}

#[tokio::test]
async fn a_queued_job_whose_request_is_damaged_fails_and_holds_up_no_other() {
    let (_folder, store) = fresh().await;
    let (damaged, next) = (submit(&store, json!({})).await.id, submit(&store, json!({})).await.id);
    damage(&store, "update job_requests set body = replace(body, '0.2', '0.3') where job = 1").await;
    let lease = store.claim().await.unwrap().unwrap().lease;
    assert_eq!(lease.id, next);
    let failed = store.get(damaged).await.unwrap().unwrap();
    assert_eq!(failed.state, State::Failed);
    assert!(failed.error.unwrap().detail.contains("submit the job again"));
    assert_eq!(store.counts().await.unwrap()[&State::Failed], 1);
    store.succeed(lease, artifact("x"), progress(1.0), Facts::default(), Vec::new()).await.unwrap();
}

#[tokio::test]
async fn a_study_that_is_retried_forgets_faults_and_pauses() {
    let (_folder, store) = fresh().await;
    let (study, _) = large_study(&store, 2, 1.0).await;
    store.cancel_study(study.id).await.unwrap();
    damage(&store, "update jobs set faults = 4, not_before = 9000000000000000000").await;
    let (_, retried) = store.retry_study(study.id, vec![State::Cancelled]).await.unwrap();
    assert_eq!(retried.len(), 2);
    let faults: i64 =
        query("select cast(sum(faults) as bigint) from jobs").scalar(store.readers()).await.unwrap();
    assert_eq!(faults, 0);
    assert!(store.claim().await.unwrap().is_some() && store.claim().await.unwrap().is_some());
}

#[tokio::test]
async fn others_write_while_a_large_study_is_deleted() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(&folder, StoreLimits { max_queued: 5000, ..LIMITS }).await;
    let (study, _) = study_of(&store, 4000, (10, 1.0)).await;
    store.cancel_study(study.id).await.unwrap();
    let deleting = {
        let store = store.clone();
        tokio::spawn(async move { store.delete_study(study.id).await })
    };
    // A batch is gone, the study is still there: between two batches a job is accepted.
    while store.counts().await.unwrap()[&State::Cancelled] == 4000 {
        tokio::task::yield_now().await;
    }
    let job = submit(&store, json!({})).await;
    assert!(store.study(study.id).await.unwrap().is_some(), "the job waited for the end of the deletion");
    assert_eq!(deleting.await.unwrap().unwrap().len(), 4000);
    assert!(store.study(study.id).await.unwrap().is_none());
    assert_eq!(store.get(job.id).await.unwrap().unwrap().state, State::Queued);
}
