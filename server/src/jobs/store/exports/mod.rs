//! Exports in the store.
//!
//! The unique key `(job, key)` makes one row of all requests for the same export. The row is deleted with its job.
//! Exports are leased as jobs are: who makes one renews its lease, and one whose lease ran out is requeued. The update
//! of a worker names its attempt, so that a worker whose export was requeued changes nothing.

mod claims;
mod elsewhere;
#[cfg(test)]
mod elsewhere_tests;
mod query;
mod request;
#[cfg(test)]
mod tests;
mod work;

use serde_json::Value;

use super::db::{Row, Transaction, query};
use super::{StoreError, rows};
use crate::exports::{ExportRecord, ExportState, StoredFile};
use crate::ids::ExportId;

pub(crate) use claims::{ClaimedExport, ExportQueue};
pub(super) use elsewhere::renew_export;
pub(super) use query::files_of_job;
pub(crate) use request::Retention;
pub(super) use request::{end_of_retried, insert_beforehand};

/// A query for exports, with the ids of the jobs; `$tail` holds what follows.
macro_rules! select_exports {
    ($tail:literal) => {
        concat!(
            "select exports.*, jobs.id as job_id from exports join jobs on jobs.seq = exports.job ",
            $tail
        )
    };
}
pub(super) use select_exports;

/// Reads a row of [`select_exports!`].
pub(super) fn export(row: &Row) -> Result<ExportRecord, StoreError> {
    rows::check_whole(row, "is_whole")?;
    let file = match row.try_get::<Option<String>>("path")? {
        None => None,
        Some(path) => Some(StoredFile {
            path,
            bytes: row.try_get::<i64>("bytes")? as u64,
            sha256: row.try_get("sha256")?,
        }),
    };
    let optional_json = |column| -> Result<Option<Value>, StoreError> {
        row.try_get::<Option<String>>(column)?.as_deref().map(rows::json).transpose()
    };
    let name: String = row.try_get("state")?;
    let state = ExportState::from_name(&name);
    Ok(ExportRecord {
        seq: row.try_get("seq")?,
        id: export_id(row.text("id")?)?,
        job: rows::job_id(row.text("job_id")?)?,
        job_seq: row.try_get("job")?,
        key: row.try_get("key")?,
        kind: rows::json(&format!("\"{}\"", row.try_get::<String>("type")?))?,
        options: rows::json(row.text("options")?)?,
        kept: row.try_get("kept")?,
        state: state.ok_or_else(|| StoreError::Row(format!("unknown state {name:?}")))?,
        attempt: row.try_get("attempt")?,
        version: row.try_get("version")?,
        progress: optional_json("progress")?,
        file,
        report: optional_json("report")?,
        error: row.try_get::<Option<String>>("error")?.as_deref().map(rows::json).transpose()?,
        created_at: row.try_get("created_at")?,
        started_at: row.try_get("started_at")?,
        finished_at: row.try_get("finished_at")?,
        updated_at: row.try_get("updated_at")?,
        owner: row.try_get("owner")?,
        heavy: row.try_get("heavy")?,
        worker: row.try_get("worker")?,
    })
}

pub(super) fn export_id(text: &str) -> Result<ExportId, StoreError> {
    ExportId::parse(text).ok_or_else(|| StoreError::Row(format!("{text:?} is no export ID")))
}

/// The export of that number, which the caller knows to exist.
async fn by_seq(tx: &mut Transaction<'_>, seq: i64) -> Result<ExportRecord, StoreError> {
    let row = query(select_exports!("where exports.seq = ?")).bind(seq).fetch_optional(&mut *tx).await?;
    export(&row.ok_or(StoreError::NoExport)?)
}

/// Increments the version of a job whose list of kept exports has changed.
async fn touch_job(tx: &mut Transaction<'_>, job: i64, now: i64) -> Result<(), StoreError> {
    query("update jobs set version = version + 1, updated_at = ? where seq = ?")
        .bind(now)
        .bind(job)
        .execute(tx)
        .await?;
    Ok(())
}
