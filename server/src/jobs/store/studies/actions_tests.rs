//! Studies of more jobs than one transaction changes.

#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;

use serde_json::json;

use super::super::db::query;
use super::super::tests::{LIMITS, open, submit};
use super::super::{Store, StoreError, StoreLimits};
use super::tests::{again, take_in, two_points};
use super::{StudyRecord, StudyState};
use crate::jobs::State;
use crate::jobs::request::Change;

/// A study of 1250 jobs in a store that takes 1350.
async fn large() -> (tempfile::TempDir, Store, StudyRecord) {
    let folder = tempfile::tempdir().unwrap();
    let store = open(&folder, StoreLimits { max_queued: 1350, ..LIMITS }).await;
    let study = take_in(&store, &two_points(625, &json!({}))).await;
    (folder, store, study)
}

async fn shared_jobs(store: &Store, study: &StudyRecord) -> i64 {
    query("select count(*) from jobs where study = ? and shared")
        .bind(study.seq)
        .scalar(store.readers())
        .await
        .unwrap()
}

#[tokio::test]
async fn a_large_study_is_cancelled_some_jobs_at_a_time() {
    let (_folder, store, study) = large().await;
    let mut after = None;
    for (cancelled, is_last) in [(500, false), (1000, false), (1250, true)] {
        let (found, more) = store.clone().cancel_some(study.id.into(), after).await.unwrap();
        assert_eq!((found.counts.cancelled, found.counts.queued), (cancelled, 1250 - cancelled));
        assert_eq!(more.is_none(), is_last);
        // Others can write in between.
        submit(&store, json!({})).await;
        after = more;
    }
    assert_eq!(again(&store, &study).await.state(), StudyState::Finished);
}

#[tokio::test]
async fn a_large_study_is_cancelled_retried_and_shared_as_a_whole() {
    let (_folder, store, study) = large().await;
    let cancelled = store.cancel_study(study.id).await.unwrap();
    assert_eq!((cancelled.counts.cancelled, cancelled.state()), (1250, StudyState::Finished));
    let (open, retried) = store.retry_study(study.id, vec![State::Failed, State::Cancelled]).await.unwrap();
    assert_eq!((open.counts.queued, open.state()), (1250, StudyState::Open));
    let jobs: BTreeSet<_> = retried.iter().map(|(job, _)| job.to_string()).collect();
    assert_eq!((retried.len(), jobs.len()), (1250, 1250), "each once");
    assert!(retried.iter().all(|(_, attempt)| *attempt == 2));
    // They wait in the order of their numbers, as they did before.
    let turns: Vec<i64> = query("select turn from jobs where study = ? order by seq")
        .bind(study.seq)
        .scalars(store.readers())
        .await
        .unwrap();
    assert!(turns.is_sorted_by(|a, b| a < b), "{turns:?}");

    let shared = store.patch_study(study.id, Some(true), Change::Keep).await.unwrap();
    assert!(shared.shared);
    assert_eq!(shared_jobs(&store, &study).await, 1250);
    store.patch_study(study.id, Some(false), Change::Keep).await.unwrap();
    assert_eq!(shared_jobs(&store, &study).await, 0);
}

/// The change that comes later wins for every job, also for those that the earlier one has not reached.
#[tokio::test]
async fn of_two_changes_of_a_large_study_that_meet_all_jobs_have_the_later() {
    let (_folder, store, study) = large().await;
    let write = async |text| {
        query(text).bind(study.seq).execute(&mut store.writer().await.unwrap()).await.unwrap();
    };
    let share_some = async || {
        let mut writer = store.writer().await.unwrap();
        let mut tx = writer.begin().await.unwrap();
        let jobs = store.share_some(&mut tx, study.seq).await.unwrap().len();
        tx.commit().await.unwrap();
        jobs
    };
    write("update studies set shared = true where seq = ?").await;
    assert_eq!(share_some().await, 500);
    write("update studies set shared = false where seq = ?").await;
    assert_eq!(share_some().await, 500, "those that were shared before");
    assert_eq!(share_some().await, 0, "the earlier change goes on, and shares nothing");
    assert_eq!(shared_jobs(&store, &study).await, 0);
}

#[tokio::test]
async fn a_large_study_is_retried_only_where_the_queue_has_room_for_all_of_it() {
    let (_folder, store, study) = large().await;
    store.cancel_study(study.id).await.unwrap();
    for _ in 0..101 {
        submit(&store, json!({})).await;
    }
    let refused = store.retry_study(study.id, vec![State::Cancelled]).await;
    assert!(matches!(refused, Err(StoreError::QueueFull { more: 1250, .. })), "{refused:?}");
    assert_eq!(again(&store, &study).await.counts.queued, 0);
}
