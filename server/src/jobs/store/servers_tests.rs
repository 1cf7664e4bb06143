//! Several servers on one PostgreSQL, each a store of its own.
#![allow(clippy::unwrap_used)]

use std::time::Duration;

use serde_json::json;

use super::tests::{LIMITS, open_shared, submit};

/// A server that is stopped, or cut off, amid a write has the lock that all writers wait for.
#[tokio::test]
async fn a_server_that_stops_amid_a_write_holds_up_the_others_for_seconds() {
    if std::env::var_os("PACKSTONE_TEST_POSTGRES").is_none() {
        eprintln!("skipped: PACKSTONE_TEST_POSTGRES names no PostgreSQL");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let stopped = open_shared(&folder, LIMITS).await;
    let other = open_shared(&folder, LIMITS).await;
    let mut writing = stopped.writer().await.unwrap();
    let tx = writing.begin().await.unwrap();
    let submitted = tokio::time::timeout(Duration::from_mins(1), submit(&other, json!({}))).await;
    submitted.expect("the lock to be released");
    // The stopped one goes on: what it was about to write is lost, and it writes on another connection.
    assert!(tx.commit().await.is_err());
    drop(writing);
    submit(&stopped, json!({})).await;
}
