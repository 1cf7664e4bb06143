//! Requesting and deleting exports.

use super::super::db::{Transaction, query};
use super::super::studies::properties::touch_study_of;
use super::super::submit::to_json;
use super::super::writer::Writing;
use super::super::{Store, StoreError};
use super::work::MAX_ATTEMPTS;
use super::{by_seq, export, export_id, select_exports, touch_job};
use crate::exports::{ExportRecord, ExportState, MAX_KEPT, MAX_WAITING, NewExport};
use crate::failure::{Failure, FailureCode};
use crate::ids::{ExportId, JobId};

/// How long an export is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Retention {
    /// In the cache: it may be removed as soon as its file has been sent.
    Cached,
    /// As long as its job.
    Kept,
}

impl Store {
    /// Finds an export of a job that succeeded, or adds it to the queue; returns whether it was added. An export that
    /// failed for a transient reason is requeued. A row that is kept has been synchronized to the disk when this
    /// returns; a row of the cache has not, because a client can request it again.
    ///
    /// # Errors
    /// [`StoreError::NoJob`], [`StoreError::TooManyWait`], [`StoreError::TooManyKept`], or the database's.
    pub(crate) async fn request_export(
        &self,
        job: JobId,
        new: NewExport,
        retention: Retention,
    ) -> Result<(ExportRecord, bool), StoreError> {
        let store = self.clone();
        self.detached(async move {
            let mut writer = match retention {
                Retention::Kept => store.writer().await?,
                Retention::Cached => store.quick_writer().await?,
            };
            let Requested { record, created, job_changed } =
                find_or_insert(&mut writer, job, &new, retention).await?;
            drop(writer);
            if record.state == ExportState::Queued {
                store.wake_export_workers();
            }
            store.notify_export(record.id);
            if job_changed {
                store.notify(job);
            }
            Ok((record, created))
        })
        .await
    }

    /// Requeues a succeeded export whose file is damaged. Does nothing to an export in another state or with another
    /// path.
    pub(crate) async fn requeue_export(&self, seq: i64, path: String) -> Result<(), StoreError> {
        let store = self.clone();
        self.detached(async move {
            let mut writer = store.writer().await?;
            query(
                "update exports set state = 'queued', attempt = attempt + 1, max_attempts = attempt + ?4,
                     version = version + 1, rank = 0,
                     path = null, bytes = null, sha256 = null, report = null, progress = null, started_at = null,
                     finished_at = null, updated_at = ?1
                 where seq = ?2 and state = 'succeeded' and path = ?3",
            )
            .bind(store.now_us())
            .bind(seq)
            .bind(path)
            .bind(MAX_ATTEMPTS)
            .execute(&mut writer)
            .await?;
            drop(writer);
            store.wake_export_workers();
            Ok(())
        })
        .await
    }

    /// Removes an export, whatever its state, and returns the path of its file, which no row refers to any more. A
    /// worker that makes the export finds no row and stops.
    ///
    /// # Errors
    /// [`StoreError::NoExport`], or the database's.
    pub(crate) async fn delete_export(&self, job: JobId, id: ExportId) -> Result<Option<String>, StoreError> {
        self.freeing(move |store| async move {
            let mut writer = store.writer().await?;
            let mut tx = writer.begin().await?;
            // Only what is needed, so that a damaged row can be removed too.
            let row = query(
                "delete from exports where id = ? and job = (select seq from jobs where id = ?)
                 returning job, kept, path",
            )
            .bind(id.to_string())
            .bind(job.to_string())
            .fetch_optional(&mut tx)
            .await?
            .ok_or(StoreError::NoExport)?;
            let kept: bool = row.try_get("kept")?;
            if kept {
                touch_job(&mut tx, row.try_get("job")?, store.now_us()).await?;
            }
            touch_study_of(&mut tx, row.try_get("job")?, store.now_us()).await?;
            let path = row.try_get("path")?;
            tx.commit().await?;
            drop(writer);
            store.notify_export(id);
            if kept {
                store.notify(job);
            }
            Ok(path)
        })
        .await
    }
}

/// The row of a requested export.
struct Requested {
    record: ExportRecord,
    created: bool,
    job_changed: bool,
}

async fn find_or_insert(
    writer: &mut Writing<'_>,
    job: JobId,
    new: &NewExport,
    retention: Retention,
) -> Result<Requested, StoreError> {
    let now = writer.now_us();
    let mut tx = writer.begin().await?;
    let job: i64 = query("select seq from jobs where id = ? and state = 'succeeded'")
        .bind(job.to_string())
        .fetch_optional(&mut tx)
        .await?
        .ok_or(StoreError::NoJob)?
        .try_get("seq")?;
    let known = query(select_exports!("where exports.job = ? and exports.key = ?"))
        .bind(job)
        .bind(&new.key)
        .fetch_optional(&mut tx)
        .await?;
    let known = match known.as_ref().map(export) {
        // It is made again from the result; the sweeper moves its file to the quarantine.
        Some(Err(StoreError::Row(fault))) => {
            tracing::error!(fault, "an export is damaged in the database and is replaced");
            query("delete from exports where job = ? and key = ?")
                .bind(job)
                .bind(&new.key)
                .execute(&mut tx)
                .await?;
            None
        }
        known => known.transpose()?,
    };
    let keep = retention == Retention::Kept && !known.as_ref().is_some_and(|known| known.kept);
    if keep {
        check_kept(&mut tx, job).await?;
    }
    let seq = if let Some(known) = &known {
        update(&mut tx, known, may_be_retried(known), keep, now).await?;
        known.seq
    } else {
        check_waiting(&mut tx).await?;
        let inserted = insert(&mut tx, job, new, Row { kept: keep, rank: 0, now }).await?;
        inserted.ok_or(StoreError::NoExport)?
    };
    if keep {
        touch_job(&mut tx, job, now).await?;
    }
    let record = by_seq(&mut tx, seq).await?;
    tx.commit().await?;
    Ok(Requested { record, created: known.is_none(), job_changed: keep })
}

/// A client is waiting: the export moves to the front of the queue, is requeued if it failed (`retried`), and is kept
/// from now on if `keep` is set.
async fn update(
    tx: &mut Transaction<'_>,
    known: &ExportRecord,
    retried: bool,
    keep: bool,
    now: i64,
) -> Result<(), StoreError> {
    query(
        "update exports set used_at = ?2, rank = case when state = 'queued' or ?3 then 0 else rank end,
             kept = kept or ?4, version = version + case when ?3 or ?4 then 1 else 0 end,
             updated_at = case when ?3 or ?4 then ?2 else updated_at end
         where seq = ?1",
    )
    .bind(known.seq)
    .bind(now)
    .bind(retried)
    .bind(keep)
    .execute(&mut *tx)
    .await?;
    if retried {
        query(
            "update exports set state = 'queued', attempt = attempt + 1, max_attempts = attempt + ?2, error = null,
                 progress = null, started_at = null, finished_at = null
             where seq = ?1",
        )
        .bind(known.seq)
        .bind(MAX_ATTEMPTS)
        .execute(&mut *tx)
        .await?;
        touch_study_of(tx, known.job_seq, now).await?;
    }
    Ok(())
}

/// Queues the exports that the request of a job lists, in the transaction that ends the job.
pub(in crate::jobs::store) async fn insert_beforehand(
    tx: &mut Transaction<'_>,
    job: i64,
    new: &[NewExport],
    now: i64,
) -> Result<(), StoreError> {
    for new in new {
        if insert(tx, job, new, Row { kept: true, rank: 1, now }).await?.is_some() {
            continue;
        }
        // Of an earlier result of the job, which was damaged.
        let known = query(select_exports!("where exports.job = ? and exports.key = ?"))
            .bind(job)
            .bind(&new.key)
            .fetch_optional(&mut *tx)
            .await?;
        if let Some(known) = known.as_ref().map(export).transpose()? {
            update(tx, &known, may_be_retried(&known), !known.kept, now).await?;
        }
    }
    Ok(())
}

/// Whether an export has failed for a reason that passes.
fn may_be_retried(known: &ExportRecord) -> bool {
    known.state == ExportState::Failed && known.error.as_ref().is_none_or(|error| error.code.is_transient())
}

/// Ends the exports that wait or are made of a result that is given up, in the transaction that retries the job.
/// Returns which they were.
pub(in crate::jobs::store) async fn end_of_retried(
    tx: &mut Transaction<'_>,
    job: i64,
    now: i64,
) -> Result<Vec<ExportId>, StoreError> {
    let failure = Failure::new(
        FailureCode::ResultDamaged,
        "the result was damaged and the job is retried: request the export again when the job has succeeded",
    );
    let ended = query(
        "update exports set state = 'failed', error = ?2, progress = null, lease_expires_at = null, not_before = null,
             version = version + 1, finished_at = ?3, updated_at = ?3
         where job = ?1 and state in ('queued', 'running') returning id",
    )
    .bind(job)
    .bind(to_json(&failure)?)
    .bind(now)
    .fetch_all(tx)
    .await?;
    ended.iter().map(|row| export_id(row.text("id")?)).collect()
}

struct Row {
    kept: bool,
    rank: i64,
    now: i64,
}

/// Inserts a row and returns its number; `None` where the job already has the export.
async fn insert(
    tx: &mut Transaction<'_>,
    job: i64,
    new: &NewExport,
    row: Row,
) -> Result<Option<i64>, StoreError> {
    let inserted = query(
        "insert into exports (id, job, key, type, options, kept, quick, heavy, needs_mesher, rank, state, created_at,
             updated_at, used_at, owner)
         values (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?10, ?11, ?8, 'queued', ?9, ?9, ?9,
             (select owner from jobs where seq = ?2))
         on conflict (job, key) do nothing returning seq",
    )
    .bind(ExportId::new().to_string())
    .bind(job)
    .bind(&new.key)
    .bind(new.kind.name())
    .bind(&new.options)
    .bind(row.kept)
    .bind(new.quick)
    .bind(row.rank)
    .bind(row.now)
    .bind(new.heavy)
    .bind(new.needs_mesher)
    .fetch_optional(tx)
    .await?;
    Ok(inserted.map(|row| row.try_get("seq")).transpose()?)
}

async fn check_kept(tx: &mut Transaction<'_>, job: i64) -> Result<(), StoreError> {
    let kept: i64 = query("select count(*) from exports where job = ? and kept").bind(job).scalar(tx).await?;
    if kept as u64 >= MAX_KEPT { Err(StoreError::TooManyKept { most: MAX_KEPT }) } else { Ok(()) }
}

async fn check_waiting(tx: &mut Transaction<'_>) -> Result<(), StoreError> {
    let waiting: i64 =
        query("select count(*) from exports indexed by exports_queue where state = 'queued' and not heavy and rank = 0")
            .scalar(tx)
            .await?;
    if waiting as u64 >= MAX_WAITING { Err(StoreError::TooManyWait { most: MAX_WAITING }) } else { Ok(()) }
}
