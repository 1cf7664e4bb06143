//! Owners in the store: what each sees, whose turn it is, quotas, and data directories of before there were owners.

#![allow(clippy::unwrap_used)]

use serde_json::json;

use super::tests::{LIMITS, fresh, submit_as, succeed, with_quotas};
use super::*;
use crate::accounts::Quotas;

#[tokio::test]
async fn an_owner_sees_his_own_jobs_and_those_that_are_shared() {
    let (_folder, store) = fresh().await;
    let take = async |owner: &str, extra: serde_json::Value| submit_as(&store, owner, extra).await.unwrap();
    let mut mine = Vec::new();
    for i in 0..4 {
        mine.push(take("lab", json!({"name": format!("mine {i}")})).await.id);
        take("field", json!({})).await;
        if i % 2 == 0 {
            mine.push(take("field", json!({"shared": true, "labels": {"a": "b"}})).await.id);
        }
    }
    mine.reverse();
    let seen = async |filter: Filter| {
        let (mut after, mut found) = (None, Vec::new());
        loop {
            let page = store.list(&filter, after, 2).await.unwrap();
            found.extend(page.jobs.iter().map(|job| job.id));
            after = page.next_after;
            if after.is_none() {
                return found;
            }
        }
    };
    let of_lab = Filter { visible_to: Some("lab".into()), ..Filter::default() };
    assert_eq!(seen(of_lab.clone()).await, mine);
    assert_eq!(seen(Filter { state: Some(State::Queued), ..of_lab.clone() }).await, mine);
    assert_eq!(seen(Filter { name: Some("mine".into()), ..of_lab.clone() }).await.len(), 4);
    let label = vec![("a".to_owned(), "b".to_owned())];
    assert_eq!(seen(Filter { labels: label.clone(), ..of_lab }).await.len(), 2);
    let of_none = Filter { visible_to: Some("none".into()), ..Filter::default() };
    assert_eq!(seen(of_none.clone()).await.len(), 2);
    assert_eq!(seen(Filter { labels: label, ..of_none }).await.len(), 2);
    assert_eq!(seen(Filter::default()).await.len(), 10);
    let order = Order { key: SortKey::Priority, descending: false };
    let by_priority = seen(Filter { visible_to: Some("lab".into()), order, ..Filter::default() }).await;
    mine.reverse();
    assert_eq!(by_priority, mine);
}

/// The owners of the jobs that start next, one letter each.
async fn starts(store: &Store, jobs: usize) -> String {
    let mut owners = String::new();
    for _ in 0..jobs {
        owners += &store.claim().await.unwrap().map_or("-".into(), |claimed| claimed.job.owner);
    }
    owners
}

#[tokio::test]
async fn owners_take_turns_whatever_each_has_in_the_queue() {
    let (_folder, store) = fresh().await;
    for _ in 0..10 {
        submit_as(&store, "a", json!({"priority": 100})).await.unwrap();
    }
    assert_eq!(starts(&store, 3).await, "aaa");
    // Who comes later starts next, and then every other job is his, at whatever priority.
    for priority in [-100, 0, 5] {
        submit_as(&store, "b", json!({"priority": priority})).await.unwrap();
    }
    let before = store.claim().await.unwrap().unwrap().job;
    assert_eq!(
        (before.owner.as_str(), before.priority),
        ("b", 5),
        "of one owner the highest priority comes first"
    );
    assert_eq!(starts(&store, 4).await, "abab");
    // Who had nothing in the queue has saved no turns up.
    assert_eq!(starts(&store, 2).await, "aa");
    for owner in ["b", "c", "b", "c", "b", "c"] {
        submit_as(&store, owner, json!({})).await.unwrap();
    }
    assert_eq!(starts(&store, 8).await, "bcabcabc");
    assert_eq!(starts(&store, 2).await, "a-");
}

#[tokio::test]
async fn an_owner_at_his_bound_holds_up_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let store = with_quotas(&folder, LIMITS, Quotas { running: Some(2), ..Quotas::default() }).await;
    for owner in ["a", "a", "a", "a", "b"] {
        submit_as(&store, owner, json!({})).await.unwrap();
    }
    let first = store.claim().await.unwrap().unwrap();
    assert_eq!(starts(&store, 3).await, "ba-");
    let Usage { queued, running, stored_bytes: requests } = store.usage_of("a").await.unwrap();
    assert!((queued, running) == (2, 2) && requests > 0);
    for _ in 0..5 {
        submit_as(&store, "b", json!({})).await.unwrap();
    }
    assert_eq!(starts(&store, 2).await, "b-");
    // A worker that waits is told, whichever way a job ends.
    let mark = store.queue_mark();
    succeed(&store, first.lease).await;
    store.queue_notified(mark, WorkUntil::Unlimited).await.end();
    assert_eq!(starts(&store, 2).await, "a-");
    let usage = Usage { queued: 1, running: 2, stored_bytes: requests + 10 };
    assert_eq!(store.usage_of("a").await.unwrap(), usage);
    assert_eq!(store.usage_of("none").await.unwrap(), Usage { queued: 0, running: 0, stored_bytes: 0 });
}

#[tokio::test]
async fn the_share_of_an_owner_in_the_queue_is_bounded() {
    let folder = tempfile::tempdir().unwrap();
    let store = with_quotas(&folder, LIMITS, Quotas { queued: Some(2), ..Quotas::default() }).await;
    let first = submit_as(&store, "a", json!({})).await.unwrap();
    submit_as(&store, "a", json!({})).await.unwrap();
    let refused = submit_as(&store, "a", json!({})).await.unwrap_err();
    let StoreError::OwnerQueueFull { owner, queued, more, most } = refused else { panic!("{refused}") };
    assert_eq!((owner.as_str(), queued, more, most), ("a", 2, 1, 2));
    submit_as(&store, "b", json!({})).await.unwrap();
    store.cancel(first.id).await.unwrap();
    submit_as(&store, "a", json!({})).await.unwrap();
    assert!(matches!(store.retry(first.id, None).await, Err(StoreError::OwnerQueueFull { .. })));
    assert_eq!(store.get(first.id).await.unwrap().unwrap().state, State::Cancelled, "nothing was changed");
    // What starts makes room.
    store.claim().await.unwrap().unwrap();
    store.claim().await.unwrap().unwrap();
    store.retry(first.id, None).await.unwrap();
}
