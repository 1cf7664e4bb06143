//! What is made of results, in the store.
//!
//! There is one row for one thing, however often and by whichever way it is asked for: the unique key sees to it. A
//! row leaves with its job; who works at it finds it gone. As the data directory is one service's own, a row that
//! is running at the start belongs to nobody, so there are no leases; the attempt keeps the late word of one that
//! was taken back from being heard.

mod ask;
mod query;
#[cfg(test)]
mod tests;
mod work;

use serde_json::Value;
use sqlx::sqlite::SqliteRow;
use sqlx::{Row as _, SqliteConnection};

use super::{StoreError, rows};
use crate::derived::{DerivedRecord, DerivedState, StoredFile};
use crate::ids::DerivedId;

pub(crate) use ask::Wish;
pub(super) use ask::insert_beforehand;
pub(super) use query::files_of_job;
pub(crate) use work::ClaimedDerived;

/// A query for what is derived, with the ids of the jobs; `$tail` holds what follows.
macro_rules! select_derived {
    ($tail:literal) => {
        concat!(
            "select derived.*, jobs.id as job_id from derived join jobs on jobs.seq = derived.job ",
            $tail
        )
    };
}
use select_derived;

/// Reads a row of [`select_derived!`].
fn derived(row: &SqliteRow) -> Result<DerivedRecord, StoreError> {
    let file = match row.try_get::<Option<String>, _>("path")? {
        None => None,
        Some(path) => Some(StoredFile {
            path,
            bytes: row.try_get::<i64, _>("bytes")? as u64,
            sha256: row.try_get("sha256")?,
        }),
    };
    let optional_json = |column| -> Result<Option<Value>, StoreError> {
        row.try_get::<Option<String>, _>(column)?.as_deref().map(rows::json).transpose()
    };
    let name: String = row.try_get("state")?;
    let state = DerivedState::from_name(&name);
    Ok(DerivedRecord {
        seq: row.try_get("seq")?,
        id: derived_id(&row.try_get::<String, _>("id")?)?,
        job: rows::job_id(&row.try_get::<String, _>("job_id")?)?,
        job_seq: row.try_get("job")?,
        key: row.try_get("key")?,
        kind: rows::json(&format!("\"{}\"", row.try_get::<String, _>("type")?))?,
        options: rows::json(&row.try_get::<String, _>("options")?)?,
        kept: row.try_get("kept")?,
        state: state.ok_or_else(|| StoreError::Row(format!("unknown state {name:?}")))?,
        attempt: row.try_get("attempt")?,
        version: row.try_get("version")?,
        progress: optional_json("progress")?,
        file,
        report: optional_json("report")?,
        error: optional_json("error")?,
        created_at: row.try_get("created_at")?,
        started_at: row.try_get("started_at")?,
        finished_at: row.try_get("finished_at")?,
        updated_at: row.try_get("updated_at")?,
    })
}

fn derived_id(text: &str) -> Result<DerivedId, StoreError> {
    DerivedId::parse(text).ok_or_else(|| StoreError::Row(format!("{text:?} is no id of something derived")))
}

/// The one of that number, which the caller knows to exist.
async fn by_seq(connection: &mut SqliteConnection, seq: i64) -> Result<DerivedRecord, StoreError> {
    let row = sqlx::query(select_derived!("where derived.seq = ?"))
        .bind(seq)
        .fetch_optional(&mut *connection)
        .await?;
    derived(&row.ok_or(StoreError::NoDerived)?)
}

/// What clients see of a job has changed: what is kept of it.
async fn touch_job(connection: &mut SqliteConnection, job: i64, now: i64) -> Result<(), StoreError> {
    sqlx::query("update jobs set version = version + 1, updated_at = ? where seq = ?")
        .bind(now)
        .bind(job)
        .execute(connection)
        .await?;
    Ok(())
}
