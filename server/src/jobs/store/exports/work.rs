//! The state transitions of an export by its worker.

use std::time::Duration;

use super::super::db::query;
use super::super::submit::to_json;
use super::super::writer::Writing;
use super::super::{Store, StoreError, fault_pause, micros, rows};
use super::{by_seq, export_id};
use crate::exports::{ExportRecord, StoredFile};
use crate::failure::{Failure, FailureCode};
use crate::ids::ExportId;
use crate::jobs::{ArtifactRecord, JobProgress};

/// Most starts of an export during which the server stopped, as the table has it by default.
pub(super) const MAX_ATTEMPTS: i64 = 3;

/// The statement that starts the next export among those of `$tail`.
macro_rules! next {
    ($tail:literal) => {
        concat!(
            "update exports set state = 'running', version = version + 1, started_at = ?1, updated_at = ?1,
                 lease_expires_at = ?2,
                 progress = null, error = null, not_before = null
             where seq = (select seq from exports ",
            $tail,
            " and (not_before is null or not_before <= ?1) order by rank, seq limit 1) returning seq, faults"
        )
    };
}

/// An export that the caller has claimed.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ClaimedExport {
    pub(crate) export: ExportRecord,
    /// The result that the export is made from.
    pub(crate) result: ArtifactRecord,
    /// Faults of the machine that it has met.
    pub(crate) faults: i64,
}

impl Store {
    /// Requeues every running export at start-up, when no worker has it; an export without attempts left fails. Returns
    /// how many were running. Where other servers may share the database, only those whose lease ran out are taken.
    pub(crate) async fn recover_exports(&self) -> Result<usize, StoreError> {
        self.reclaim_exports(if self.is_shared() { self.now_us() } else { i64::MAX }).await
    }

    /// Does the same for the exports whose lease ran out.
    pub(crate) async fn reclaim_expired_exports(&self) -> Result<usize, StoreError> {
        self.reclaim_exports(self.now_us()).await
    }

    async fn reclaim_exports(&self, leases_until: i64) -> Result<usize, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let exhausted = Failure::new(
                FailureCode::AttemptsExhausted,
                format!("the server stopped {MAX_ATTEMPTS} times while it was being made"),
            );
            let mut writer = store.writer().await?;
            let moved = query(
                "update exports set
                     state = case when attempt >= max_attempts then 'failed' else 'queued' end,
                     error = case when attempt >= max_attempts then ?2 else null end,
                     finished_at = case when attempt >= max_attempts then ?1 else null end, attempt = attempt + 1,
                     progress = null,
                     lease_expires_at = null, version = version + 1, updated_at = ?1
                 where state = 'running' and coalesce(lease_expires_at, 0) <= ?3 returning id",
            )
            .bind(store.now_us())
            .bind(to_json(&exhausted)?)
            .bind(leases_until)
            .fetch_all(&mut writer)
            .await?;
            drop(writer);
            for row in &moved {
                store.notify_export(export_id(row.text("id")?)?);
                store.wake_export_workers();
            }
            Ok(moved.len())
        })
        .await
    }

    /// Claims the next export: one that a client waits for first, then the oldest. With `quick` only exports that take
    /// little time are considered.
    pub(crate) async fn claim_export(&self, quick: bool) -> Result<Option<ClaimedExport>, StoreError> {
        let store = self.clone();
        self.detached(async move {
            // A power cut that undoes the claim leaves the export queued.
            let mut writer = store.shared.writer.lock(store.durability_of_leases()).await?;
            let claimed = claim(&mut writer, store.lease(), quick).await?;
            drop(writer);
            if let Some(claimed) = &claimed {
                store.notify_export(claimed.export.id);
            }
            Ok(claimed)
        })
        .await
    }

    /// Records the progress; `false` where the export is no longer the caller's.
    pub(crate) async fn export_progress(
        &self,
        of: &ExportRecord,
        progress: JobProgress,
    ) -> Result<bool, StoreError> {
        let (seq, attempt, id) = (of.seq, of.attempt, of.id);
        let store = self.clone();
        self.detached(async move {
            let mut writer = store.quick_writer().await?;
            let now = writer.now_us();
            let moved = query(
                "update exports set progress = ?1, version = version + 1, updated_at = ?2, lease_expires_at = ?5
                 where seq = ?3 and attempt = ?4 and state = 'running'",
            )
            .bind(to_json(&progress)?)
            .bind(now)
            .bind(seq)
            .bind(attempt)
            .bind(now.saturating_add(micros(store.lease())))
            .execute(&mut writer)
            .await?;
            drop(writer);
            let still = moved.rows_affected() > 0;
            if still {
                store.notify_export(id);
            }
            Ok(still)
        })
        .await
    }

    /// Renews the lease of an export that has no news; `false` where it is no longer the caller's.
    pub(crate) async fn renew_export(&self, of: &ExportRecord) -> Result<bool, StoreError> {
        let (seq, attempt) = (of.seq, of.attempt);
        let store = self.clone();
        self.detached(async move {
            let mut writer = store.quick_writer().await?;
            let renewed = query(
                "update exports set lease_expires_at = ? where seq = ? and attempt = ? and state = 'running'",
            )
            .bind(writer.now_us().saturating_add(micros(store.lease())))
            .bind(seq)
            .bind(attempt)
            .execute(&mut writer)
            .await?;
            Ok(renewed.rows_affected() > 0)
        })
        .await
    }

    /// Whether the export is still running in the attempt of the caller.
    pub(crate) async fn export_is_wanted(&self, of: &ExportRecord) -> Result<bool, StoreError> {
        let row = query("select 1 from exports where seq = ? and attempt = ? and state = 'running'")
            .bind(of.seq)
            .bind(of.attempt)
            .fetch_optional(self.readers())
            .await?;
        Ok(row.is_some())
    }

    /// Ends the export with its file, which is on disk already; `false` where it is no longer the caller's.
    pub(crate) async fn export_made(
        &self,
        of: &ExportRecord,
        file: StoredFile,
        report: serde_json::Value,
    ) -> Result<bool, StoreError> {
        let end = End { state: "succeeded", file: Some(file), report: Some(report), error: None };
        self.end_export(of, end).await
    }

    /// Ends the export without a file; `false` where it is no longer the caller's.
    pub(crate) async fn export_failed(
        &self,
        of: &ExportRecord,
        failure: &Failure,
    ) -> Result<bool, StoreError> {
        let error = Some(failure.clone());
        self.end_export(of, End { state: "failed", file: None, report: None, error }).await
    }

    /// Requeues the export where the server stops; the attempt does not count. Where other servers may take the export,
    /// the next one has a number of its own all the same: no two runs write the same file.
    pub(crate) async fn export_requeued(&self, of: &ExportRecord) -> Result<bool, StoreError> {
        self.end_export(of, End { state: "queued", file: None, report: None, error: None }).await
    }

    /// Requeues the export after a fault of the machine; the attempt does not count, as in [`Self::export_requeued`],
    /// and the next one starts after a pause. `false` where the export is no longer the caller's.
    pub(crate) async fn export_requeued_after_fault(&self, of: &ExportRecord) -> Result<bool, StoreError> {
        let (seq, attempt, id) = (of.seq, of.attempt, of.id);
        let store = self.clone();
        let pause = self.detached(async move {
            let mut writer = store.writer().await?;
            let mut tx = writer.begin().await?;
            let now = store.now_us();
            let row = query(
                "update exports set state = 'queued', faults = faults + 1, version = version + 1, updated_at = ?1,
                     started_at = null, progress = null, lease_expires_at = null,
                     attempt = attempt + case when ?4 then 1 else 0 end,
                     max_attempts = max_attempts + case when ?4 then 1 else 0 end
                 where seq = ?2 and attempt = ?3 and state = 'running' returning faults",
            )
            .bind(now)
            .bind(seq)
            .bind(attempt)
            .bind(store.is_shared())
            .fetch_optional(&mut tx)
            .await?;
            let Some(row) = row else { return Ok(None) };
            let pause = fault_pause(row.try_get("faults")?);
            query("update exports set not_before = ? where seq = ?")
                .bind(now.saturating_add(micros(pause)))
                .bind(seq)
                .execute(&mut tx)
                .await?;
            tx.commit().await?;
            drop(writer);
            store.notify_export(id);
            Ok(Some(pause))
        })
        .await?;
        if let Some(pause) = pause {
            tracing::warn!(pause_s = pause.as_secs(), "a fault of the machine: the export is requeued");
            self.wake_export_workers_after(pause);
        }
        Ok(pause.is_some())
    }

    async fn end_export(&self, of: &ExportRecord, end: End) -> Result<bool, StoreError> {
        let (seq, attempt, id) = (of.seq, of.attempt, of.id);
        let store = self.clone();
        self.detached(async move {
            let mut writer = store.writer().await?;
            let moved = query(
                "update exports set state = ?1, path = ?2, bytes = ?3, sha256 = ?4, report = ?5, error = ?6,
                     progress = null, lease_expires_at = null, version = version + 1, updated_at = ?7,
                     finished_at = case when ?1 = 'queued' then null else ?7 end,
                     started_at = case when ?1 = 'queued' then null else started_at end,
                     used_at = case when used_at > ?7 then used_at else ?7 end,
                     attempt = attempt + case when ?1 = 'queued' and ?10 then 1 else 0 end,
                     max_attempts = max_attempts + case when ?1 = 'queued' and ?10 then 1 else 0 end
                 where seq = ?8 and attempt = ?9 and state = 'running'",
            )
            .bind(end.state)
            .bind(end.file.as_ref().map(|file| file.path.clone()))
            .bind(end.file.as_ref().map(|file| file.bytes.cast_signed()))
            .bind(end.file.as_ref().map(|file| file.sha256.clone()))
            .bind(end.report.as_ref().map(to_json).transpose()?)
            .bind(end.error.as_ref().map(to_json).transpose()?)
            .bind(store.now_us())
            .bind(seq)
            .bind(attempt)
            .bind(store.is_shared())
            .execute(&mut writer)
            .await?;
            let is_recorded =
                moved.rows_affected() > 0 || recorded_before(&mut writer, seq, end.file).await?;
            drop(writer);
            store.notify_export(id);
            Ok(is_recorded)
        })
        .await
    }

    /// Removes the least recently used exports of the cache until it has at most `most_bytes`, except `but`, which a
    /// client waits for. Returns the paths of the files, which no row refers to any more.
    pub(crate) async fn shrink_cache(
        &self,
        most_bytes: u64,
        but: ExportId,
    ) -> Result<Vec<String>, StoreError> {
        self.freeing(move |store| async move {
            let mut writer = store.writer().await?;
            let mut tx = writer.begin().await?;
            let mut held: i64 =
                query("select cast(sum(cache_bytes) as bigint) from export_counts").scalar(&mut tx).await?;
            let (mut paths, mut dropped) = (Vec::new(), Vec::new());
            while held.cast_unsigned() > most_bytes {
                let oldest = query(
                    "delete from exports where seq = (
                         select seq from exports where not kept and path is not null and state = 'succeeded'
                             and id <> ? order by used_at limit 1
                     ) returning id, path, bytes",
                )
                .bind(but.to_string())
                .fetch_optional(&mut tx)
                .await?;
                let Some(oldest) = oldest else { break };
                held -= oldest.try_get::<i64>("bytes")?;
                paths.push(oldest.try_get("path")?);
                dropped.push(export_id(oldest.text("id")?)?);
            }
            tx.commit().await?;
            drop(writer);
            for id in dropped {
                store.notify_export(id);
            }
            Ok(paths)
        })
        .await
    }
}

/// How an export ended.
struct End {
    state: &'static str,
    file: Option<StoredFile>,
    report: Option<serde_json::Value>,
    error: Option<Failure>,
}

/// Whether this file is recorded already, as when the connection to the database went between a commit and its answer.
/// A caller that heard that the export is no longer its own would remove the file that is recorded.
async fn recorded_before(
    writer: &mut Writing<'_>,
    seq: i64,
    file: Option<StoredFile>,
) -> Result<bool, StoreError> {
    let Some(file) = file else { return Ok(false) };
    let row = query("select 1 from exports where seq = ? and path = ? and sha256 = ?")
        .bind(seq)
        .bind(file.path)
        .bind(file.sha256)
        .fetch_optional(writer)
        .await?;
    Ok(row.is_some())
}

/// The statement that claims the next export.
pub(super) fn claim_sql(quick: bool) -> &'static str {
    if quick {
        next!("indexed by exports_quick where state = 'queued' and quick")
    } else {
        next!("indexed by exports_queue where state = 'queued'")
    }
}

async fn claim(
    writer: &mut Writing<'_>,
    lease: Duration,
    quick: bool,
) -> Result<Option<ClaimedExport>, StoreError> {
    let now = writer.now_us();
    let mut tx = writer.begin().await?;
    let row = query(claim_sql(quick))
        .bind(now)
        .bind(now.saturating_add(micros(lease)))
        .fetch_optional(&mut tx)
        .await?;
    let Some(row) = row else {
        tx.rollback().await?;
        return Ok(None);
    };
    let export = by_seq(&mut tx, row.try_get("seq")?).await?;
    let faults = row.try_get("faults")?;
    let result = rows::by_seq(&mut tx, export.job_seq).await?.artifact;
    tx.commit().await?;
    // The row of an export exists only while its job has a result.
    let result = result.ok_or_else(|| StoreError::Row("an export of no result".into()))?;
    Ok(Some(ClaimedExport { export, result, faults }))
}
