//! Moves between a file of SQLite and a PostgreSQL that `PACKSTONE_TEST_POSTGRES` names.

#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::Path;

use serde_json::json;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{AssertSqlSafe, Connection as _, PgConnection, Row as _, SqliteConnection};
use tempfile::TempDir;

use super::*;
use crate::jobs::store::Store;
use crate::jobs::store::tests::{LIMITS, database, submit};

/// Rows in every table: texts with quotes, other scripts and a length beyond a page, the bounds of integers, nulls, and
/// tables of several pages. The last job that was numbered is deleted.
const ROWS: &str = include_str!("rows.sql");

/// An empty database of PostgreSQL. `None`, said aloud, where there is none to test with.
async fn postgres(folder: &TempDir) -> Option<Database> {
    let database = database(folder).await;
    if database.file().is_none() {
        return Some(database);
    }
    // Past the capture of the test harness: that nothing was tested must be seen.
    std::io::stderr().write_all(b"\n*** SKIPPED: PACKSTONE_TEST_POSTGRES names no PostgreSQL\n").unwrap();
    None
}

fn file(folder: &TempDir, name: &str) -> Database {
    folder.path().join(name).as_path().into()
}

async fn sqlite(path: &Path) -> SqliteConnection {
    SqliteConnection::connect_with(&SqliteConnectOptions::new().filename(path)).await.unwrap()
}

async fn filled(folder: &TempDir) -> Database {
    let database = file(folder, "from.sqlite");
    drop(database.open().await.unwrap());
    let mut connection = sqlite(database.file().unwrap()).await;
    sqlx::raw_sql(ROWS).execute(&mut connection).await.unwrap();
    connection.close().await.unwrap();
    database
}

async fn moved(from: &Database, to: &Database) -> Result<Vec<Moved>, TransferError> {
    Transfer::new(from.clone(), to.clone()).unwrap().run(false, |_| {}).await
}

async fn client(database: &Database) -> PgConnection {
    let Database::Postgres { options, .. } = database else { panic!("no PostgreSQL") };
    // Not the name of a server.
    PgConnection::connect_with(&options.clone().application_name("psql")).await.unwrap()
}

/// Everything of a file of SQLite: its schema, its numbers and its rows, each as text.
async fn contents(path: &Path) -> BTreeMap<String, Vec<String>> {
    let mut connection = sqlite(path).await;
    let mut contents = BTreeMap::new();
    let schema: Vec<String> =
        sqlx::query_scalar("select type || name || coalesce(sql, '') from sqlite_schema order by 1")
            .fetch_all(&mut connection)
            .await
            .unwrap();
    contents.insert("schema".to_owned(), schema);
    let tables = "select name from sqlite_schema where type = 'table'";
    for table in sqlx::query_scalar::<_, String>(tables).fetch_all(&mut connection).await.unwrap() {
        // But for what belongs to the runs of a service on one file.
        let columns = "select name from pragma_table_xinfo(?1)
            where not (?1 = 'packstone' and name in ('run', 'commits'))";
        let columns: Vec<String> =
            sqlx::query_scalar(columns).bind(&table).fetch_all(&mut connection).await.unwrap();
        let row = columns
            .iter()
            .map(|column| format!("quote(\"{column}\")"))
            .collect::<Vec<_>>()
            .join(" || ',' || ");
        let rows = sqlx::query_scalar(AssertSqlSafe(format!("select {row} from \"{table}\" order by 1")));
        contents.insert(table, rows.fetch_all(&mut connection).await.unwrap());
    }
    contents
}

#[tokio::test]
async fn every_row_comes_back_from_postgresql_as_it_went() {
    let folder = tempfile::tempdir().unwrap();
    let Some(between) = postgres(&folder).await else { return };
    let (from, to) = (filled(&folder).await, file(&folder, "to.sqlite"));
    let before = contents(from.file().unwrap()).await;
    let mut seen = Progress::default();
    let transfer = Transfer::new(from.clone(), between.clone()).unwrap();
    let there = transfer.run(false, |progress| {
        assert!(progress.copied >= seen.copied && progress.verified >= seen.verified);
        seen = progress;
    });
    let there = there.await.unwrap();
    assert!(there.iter().all(|moved| moved.rows > 0), "a table without rows was not tested: {there:?}");
    assert_eq!((seen.copied, seen.verified), (seen.rows, seen.rows));
    assert_eq!(seen.rows, there.iter().map(|moved| moved.rows).sum::<u64>());
    let back = moved(&between, &to).await.unwrap();
    assert_eq!(there, back);
    for database in [&from, &to] {
        let log = database.file().unwrap().with_extension("sqlite-wal");
        assert!(!log.exists(), "{} is left", log.display());
    }
    let after = contents(to.file().unwrap()).await;
    assert_eq!(before.keys().collect::<Vec<_>>(), after.keys().collect::<Vec<_>>());
    for (table, rows) in &before {
        assert!(rows == &after[table], "{table} differs");
    }
    assert_eq!(before, contents(from.file().unwrap()).await, "the source was changed");
}

#[tokio::test]
async fn the_destination_counts_on_where_the_source_has_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let Some(between) = postgres(&folder).await else { return };
    let to = file(&folder, "to.sqlite");
    moved(&filled(&folder).await, &between).await.unwrap();
    let store = Store::open(&between, folder.path(), LIMITS, std::sync::Arc::default()).await.unwrap();
    submit(&store, json!({"labels": {"made": "there"}})).await;
    drop(store);
    let mut there = client(&between).await;
    let counts = "select (select jobs from job_counts where state = 'queued') as counted,
        (select count(*) from jobs where state = 'queued') as queued, (select max(seq) from jobs) as last";
    let row = sqlx::query(counts).fetch_one(&mut there).await.unwrap();
    let [counted, queued, last] = ["counted", "queued", "last"].map(|column| row.get::<i64, _>(column));
    // 6 was the number of a job that is deleted.
    assert_eq!((counted, last), (queued, 7));
    sqlx::query("delete from jobs where seq = 7").execute(&mut there).await.unwrap();
    moved(&between, &to).await.unwrap();
    let store = Store::open(&to, folder.path(), LIMITS, std::sync::Arc::default()).await.unwrap();
    submit(&store, json!({"labels": {"made": "here"}})).await;
    let mut here = sqlite(to.file().unwrap()).await;
    let row = sqlx::query(counts).fetch_one(&mut here).await.unwrap();
    let [counted, queued, last] = ["counted", "queued", "last"].map(|column| row.get::<i64, _>(column));
    assert_eq!((counted, last), (queued, 8));
}

#[tokio::test]
async fn a_copy_that_differs_leaves_the_destination_empty() {
    let folder = tempfile::tempdir().unwrap();
    let Some(to) = postgres(&folder).await else { return };
    let from = filled(&folder).await;
    let mut connection = sqlite(from.file().unwrap()).await;
    // PostgreSQL has no texts with this character.
    sqlx::query("update jobs set name = 'a' || char(0) where seq = 1")
        .execute(&mut connection)
        .await
        .unwrap();
    connection.close().await.unwrap();
    let refused = moved(&from, &to).await.unwrap_err();
    assert!(matches!(&refused, TransferError::Differs { table, .. } if table == "jobs"), "{refused}");
    let mut there = client(&to).await;
    let left = "select (select count(*) from jobs) + (select count(*) from removals)
        + (select sum(jobs)::bigint from job_counts)
        + (select count(*) from pg_trigger where not tgisinternal and tgenabled <> 'O')";
    let left: i64 = sqlx::query_scalar(left).fetch_one(&mut there).await.unwrap();
    assert_eq!(left, 0);
}

#[tokio::test]
async fn a_destination_with_rows_is_refused_with_their_number() {
    let folder = tempfile::tempdir().unwrap();
    let Some(to) = postgres(&folder).await else { return };
    let from = filled(&folder).await;
    moved(&from, &to).await.unwrap();
    for (from, to) in [(&from, &to), (&to, &from)] {
        let refused = moved(from, to).await.unwrap_err().to_string();
        assert!(refused.contains("5 rows in jobs") && !refused.contains("job_counts"), "{refused}");
    }
}

#[tokio::test]
async fn a_database_that_servers_are_connected_to_is_moved_by_force_only() {
    let folder = tempfile::tempdir().unwrap();
    let Some(to) = postgres(&folder).await else { return };
    let from = filled(&folder).await;
    let Database::Postgres { options, .. } = &to else { panic!("no PostgreSQL") };
    let server = PgConnection::connect_with(options).await.unwrap();
    let refused = moved(&from, &to).await.unwrap_err();
    assert!(matches!(&refused, TransferError::InUse { connections: 1, .. }), "{refused}");
    Transfer::new(from, to).unwrap().run(true, |_| {}).await.unwrap();
    server.close().await.unwrap();
}

#[test]
fn two_databases_of_one_kind_are_refused_by_name() {
    let [one, two] = ["one.sqlite", "two.sqlite"].map(|name| Database::File(name.into()));
    let refused = Transfer::new(one, two).unwrap_err().to_string();
    assert!(refused.contains("one.sqlite and two.sqlite"), "{refused}");
    let [one, two]: [Database; 2] =
        ["postgres://lab:secret@a/b", "postgres://lab:secret@c/d"].map(|url| url.parse().unwrap());
    let refused = Transfer::new(one, two).unwrap_err().to_string();
    assert!(refused.contains("@a:5432/b and ") && !refused.contains("secret"), "{refused}");
}
