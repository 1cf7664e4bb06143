//! Rows of the database as jobs.

use serde_json::Value;

use super::db::{Row, Transaction, query};
use super::{StoreError, bodies};
use crate::ids::StudyId;
use crate::jobs::{ArtifactRecord, JobId, JobRecord, State, StopRequests, StudyPlace};
use crate::tasks;

/// Documents that are longer than this are read off the threads that answer.
const LONG: usize = 1 << 15;

/// A query for jobs with their artifacts; `$tail` holds what follows the joins, `$more` further columns.
macro_rules! select_jobs {
    ($tail:literal) => {
        $crate::jobs::store::rows::select_jobs!("", $tail)
    };
    ($more:expr, $tail:literal) => {
        concat!(
            "select jobs.*, artifacts.path, artifacts.bytes, artifacts.sha256, artifacts.report, ",
            "artifacts.report_digest, artifacts.format_revision, artifacts.format_lengths, ",
            "artifacts.is_whole as artifact_is_whole, studies.id as study_id",
            $more,
            " ",
            "from jobs left join artifacts on artifacts.job = jobs.seq ",
            "left join studies on studies.seq = jobs.study ",
            $tail
        )
    };
}
pub(super) use select_jobs;

/// Makes sure that a row is the one that was stored: the database has it twice, and compares the two in this column.
pub(super) fn check_whole(row: &Row, column: &str) -> Result<(), StoreError> {
    match row.try_get::<i64>(column)? {
        1 => Ok(()),
        _ => Err(StoreError::Row("it is not the row that was stored".into())),
    }
}

/// Reads a row of [`select_jobs!`].
pub(super) fn job(row: &Row) -> Result<JobRecord, StoreError> {
    check_whole(row, "is_whole")?;
    let state = state(row.text("state")?)?;
    // What a worker process has sent of a job that still runs is not checked yet: see `received`.
    let is_running = state == State::Running;
    let artifact = match row.try_get::<Option<String>>("path")? {
        Some(_) if !is_running => Some(artifact(row)?),
        None if state == State::Succeeded => {
            // Its page is another one.
            return Err(StoreError::Row("the record of its result is missing".into()));
        }
        _ => None,
    };
    let error = row.try_get::<Option<String>>("error")?.filter(|_| !is_running);
    let study = match row.try_get::<Option<String>>("study_id")? {
        None => None,
        Some(id) => Some(StudyPlace {
            id: study_id(&id)?,
            point: row.try_get("point")?,
            replicate: row.try_get("replicate")?,
        }),
    };
    let optional_json = |column| -> Result<_, StoreError> {
        row.try_get::<Option<String>>(column)?.as_deref().map(json).transpose()
    };
    Ok(JobRecord {
        seq: row.try_get("seq")?,
        id: job_id(row.text("id")?)?,
        state,
        name: row.try_get("name")?,
        labels: json(row.text("labels")?)?,
        priority: row.try_get("priority")?,
        threads: row.try_get::<Option<i64>>("threads")?.map(|threads| threads as u32),
        most_threads: row.try_get::<i64>("most_threads")? as u32,
        seed: row.try_get("seed")?,
        timeout_s: row.try_get("timeout_s")?,
        attempt: row.try_get("attempt")?,
        max_attempts: row.try_get("max_attempts")?,
        cancel_requested: row.try_get("cancel_requested")?,
        finish_requested: row.try_get("finish_requested")?,
        version: row.try_get("version")?,
        created_at: row.try_get("created_at")?,
        started_at: row.try_get("started_at")?,
        finished_at: row.try_get("finished_at")?,
        updated_at: row.try_get("updated_at")?,
        expires_at: row.try_get("expires_at")?,
        engine: json(row.text("engine")?)?,
        plan_warnings: json(row.text("warnings")?)?,
        overview: row.try_get::<Option<String>>("overview")?.as_deref().map(json).transpose()?,
        progress: optional_json("progress")?,
        error: error.as_deref().map(json).transpose()?,
        artifact,
        study,
        not_before: row.try_get("not_before")?,
        waits_for: row.try_get::<Option<String>>("waits_for")?.as_deref().map(json).transpose()?,
        owner: row.try_get("owner")?,
        submitted_by: row.try_get("submitted_by")?,
        shared: row.try_get("shared")?,
        worker: row.try_get("worker")?,
        faults: row.try_get("faults")?,
    })
}

/// Reads what clients want of a job from its row.
pub(super) fn stop_requests(row: &Row) -> Result<StopRequests, StoreError> {
    Ok(StopRequests { cancel: row.try_get("cancel_requested")?, finish: row.try_get("finish_requested")? })
}

/// Reads the columns of a row of `artifacts`, whose `is_whole` is named `artifact_is_whole`.
pub(super) fn artifact(row: &Row) -> Result<ArtifactRecord, StoreError> {
    check_whole(row, "artifact_is_whole")?;
    Ok(ArtifactRecord {
        path: row.try_get("path")?,
        bytes: row.try_get::<i64>("bytes")? as u64,
        sha256: row.try_get("sha256")?,
        report: json(bodies::checked(row, "report", "report_digest")?)?,
        format_revision: row.try_get("format_revision")?,
        format_lengths: json(row.text("format_lengths")?)?,
    })
}

/// The job of that number, which the caller knows to exist.
pub(super) async fn by_seq(tx: &mut Transaction<'_>, seq: i64) -> Result<JobRecord, StoreError> {
    let row = query(select_jobs!("where jobs.seq = ?")).bind(seq).fetch_optional(&mut *tx).await?;
    job(&row.ok_or(StoreError::NoJob)?)
}

/// The job of that id.
pub(super) async fn by_id(tx: &mut Transaction<'_>, id: JobId) -> Result<JobRecord, StoreError> {
    let row = query(select_jobs!("where jobs.id = ?")).bind(id.to_string()).fetch_optional(&mut *tx).await?;
    job(&row.ok_or(StoreError::NoJob)?)
}

pub(super) fn state(name: &str) -> Result<State, StoreError> {
    State::from_name(name).ok_or_else(|| StoreError::Row(format!("unknown state {name:?}")))
}

pub(super) fn job_id(text: &str) -> Result<JobId, StoreError> {
    JobId::parse(text).ok_or_else(|| StoreError::Row(format!("{text:?} is no job id")))
}

pub(super) fn study_id(text: &str) -> Result<StudyId, StoreError> {
    StudyId::parse(text).ok_or_else(|| StoreError::Row(format!("{text:?} is no study id")))
}

pub(super) fn json<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, StoreError> {
    serde_json::from_str(text).map_err(|error| StoreError::Row(error.to_string()))
}

/// A stored text, which may be long, where it is the one that was stored.
///
/// # Errors
/// [`StoreError::Row`] where it is another one, or the database's.
pub(super) async fn checked_text(row: &Row, text: &str, digest_in: &str) -> Result<String, StoreError> {
    let (text, digest) = (row.try_get::<String>(text)?, row.try_get::<i64>(digest_in)?);
    let is_long = text.len() > LONG;
    off_thread_if(is_long, move || {
        bodies::compared(&text, digest)?;
        Ok(text)
    })
    .await
}

/// A stored document, which may be long, where it is the one that was stored.
///
/// # Errors
/// [`StoreError::Row`] where it is another one or no JSON, or the database's.
pub(super) async fn checked_document(row: &Row, text: &str, digest_in: &str) -> Result<Value, StoreError> {
    let (text, digest) = (row.try_get::<String>(text)?, row.try_get::<i64>(digest_in)?);
    let is_long = text.len() > LONG;
    off_thread_if(is_long, move || bodies::compared(&text, digest).and_then(json)).await
}

/// Reads what is long off the threads that answer.
async fn off_thread_if<T: Send + 'static>(
    is_long: bool,
    read: impl FnOnce() -> Result<T, StoreError> + Send + 'static,
) -> Result<T, StoreError> {
    if is_long { tasks::blocking(read).await? } else { read() }
}

/// A row that cannot be read, or is not what was stored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct DamagedRow {
    /// Its ID, as far as it can be read.
    pub(crate) id: String,
    /// What is wrong.
    pub(crate) fault: String,
}

/// Adds what was read of a row to `read`, or what is wrong with the row to `damaged`.
///
/// # Errors
/// Those that say nothing about the row.
pub(super) fn or_damaged<T>(
    row: &Row,
    record: Result<T, StoreError>,
    read: &mut Vec<T>,
    damaged: &mut Vec<DamagedRow>,
) -> Result<(), StoreError> {
    match record {
        Ok(record) => read.push(record),
        Err(StoreError::Row(fault)) => {
            let id = row.text("id").unwrap_or("").to_owned();
            tracing::error!(id, fault, "a record of the database is damaged");
            damaged.push(DamagedRow { id, fault });
        }
        Err(error) => return Err(error),
    }
    Ok(())
}

/// The number below which the next page starts, where one more row than the page takes was read.
pub(super) fn next_before(rows: &[Row], limit: u32) -> Result<Option<i64>, StoreError> {
    let last = rows.get(limit as usize).and_then(|_| rows.get(limit.saturating_sub(1) as usize));
    Ok(last.map(|row| row.try_get("seq")).transpose()?)
}
