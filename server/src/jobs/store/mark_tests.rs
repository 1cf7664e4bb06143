//! A database that is overwritten or rolled back in place while it is open.

#![allow(clippy::unwrap_used)]

use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

use serde_json::json;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{Connection as _, SqliteConnection};

use super::tests::{fresh_file, open_file, submit};
use super::{Fault, JobId, Store, StoreError, Unusable};

/// Writes over the bytes of a file, as `cp` does: its number stays.
fn overwrite(file: &Path, bytes: &[u8]) {
    let number = || std::fs::metadata(file).unwrap().ino();
    let before = number();
    std::fs::write(file, bytes).unwrap();
    assert_eq!(number(), before);
}

/// A connection of another program.
async fn other(file: &Path) -> SqliteConnection {
    SqliteConnection::connect_with(&SqliteConnectOptions::new().filename(file)).await.unwrap()
}

/// Runs statements as another program does.
async fn change(file: &Path, statements: &'static str) {
    let mut connection = other(file).await;
    sqlx::raw_sql(statements).execute(&mut connection).await.unwrap();
    connection.close().await.unwrap();
}

async fn refuses_a_write(store: &Store) {
    store.cancel(JobId::new()).await.unwrap_err();
    assert_eq!(store.usable(), Err(Unusable::DatabaseReplaced));
    assert!(store.is_lost());
}

#[tokio::test]
async fn a_file_that_is_overwritten_by_a_copy_of_an_earlier_run_is_another_database() {
    let (folder, store) = fresh_file().await;
    let file = folder.path().join("packstone.sqlite");
    store.close().await;
    drop(store);
    let copy = std::fs::read(&file).unwrap();
    let store = open_file(&folder).await;
    store.usable().unwrap();
    // The row lies in the write-ahead log: no connection reads it from the file.
    submit(&store, json!({})).await;
    store.usable().unwrap();
    overwrite(&file, &copy);
    assert_eq!(store.usable(), Err(Unusable::DatabaseReplaced));
    refuses_a_write(&store).await;
}

#[tokio::test]
async fn a_file_that_is_cut_off_is_another_database() {
    let (folder, store) = fresh_file().await;
    store.usable().unwrap();
    overwrite(&folder.path().join("packstone.sqlite"), b"");
    assert_eq!(store.usable(), Err(Unusable::DatabaseReplaced));
}

#[tokio::test]
async fn a_database_that_is_rolled_back_through_sqlite_is_another_one() {
    for rollback in [
        // By a backup of another run.
        "update packstone set run = 'other'",
        // By one of this run: two transactions less.
        "update packstone set commits = commits - 2",
        "update packstone set commits = commits - 1",
        "delete from packstone",
    ] {
        let (folder, store) = fresh_file().await;
        let file = folder.path().join("packstone.sqlite");
        for _ in 0..3 {
            submit(&store, json!({})).await;
        }
        change(&file, rollback).await;
        refuses_a_write(&store).await;
    }
}

#[tokio::test]
async fn checkpoints_and_writes_of_other_programs_change_nothing() {
    let (folder, store) = fresh_file().await;
    let file = folder.path().join("packstone.sqlite");
    for _ in 0..5 {
        submit(&store, json!({})).await;
        store.usable().unwrap();
        store.shrink_log().await;
        store.usable().unwrap();
        change(&file, "update packstone set created_at = created_at; pragma wal_checkpoint(truncate)").await;
        store.usable().unwrap();
    }
    store.works().await.unwrap();
}

#[tokio::test]
async fn a_lock_of_another_program_stops_writes_alone() {
    let (folder, store) = fresh_file().await;
    let job = submit(&store, json!({})).await;
    let mut lock = other(&folder.path().join("packstone.sqlite")).await;
    sqlx::raw_sql("begin immediate").execute(&mut lock).await.unwrap();
    let cancel = || async { store.cancel(JobId::new()).await.unwrap_err() };
    let refused = cancel().await;
    assert_eq!(refused.fault(), Some(Fault::Locked), "{refused}");
    assert!(store.get(job.id).await.unwrap().is_some());
    assert_eq!(store.works().await, Err(Unusable::Locked));
    store.usable().unwrap();
    // Those that wait for each other do so for a short while.
    let all = std::iter::repeat_with(cancel).take(3);
    for refused in futures_util::future::join_all(all).await {
        assert_eq!(refused.fault(), Some(Fault::Locked), "{refused}");
    }
    sqlx::raw_sql("rollback").execute(&mut lock).await.unwrap();
    store.works().await.unwrap();
    assert!(matches!(cancel().await, StoreError::NoJob));
}
