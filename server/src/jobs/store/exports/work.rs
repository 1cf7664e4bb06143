//! The state transitions of an export by its worker.

use super::super::db::{Durability, Transaction, query};
use super::super::leased::{Kind, LeasedTask, take_back};
use super::super::studies::properties;
use super::super::submit::to_json;
use super::super::upkeep::Kept;
use super::super::{Store, StoreError};
use super::export_id;
use crate::exports::{ExportLease, ExportState, StoredFile};
use crate::failure::{Failure, FailureCode};
use crate::ids::{ExportId, StudyId};
use crate::jobs::JobProgress;

/// Most starts of an export during which the server stopped, as the table has it by default.
pub(super) const MAX_ATTEMPTS: i64 = 3;

impl Store {
    /// Requeues every running export of this server at start-up, when none of its workers has it; an export without
    /// attempts left fails. Returns how many were running. Worker processes keep theirs. Where other servers may share
    /// the database, only those whose lease ran out are taken.
    pub(crate) async fn recover_exports(&self, checkpoints: Vec<Kept>) -> Result<usize, StoreError> {
        self.reclaim_exports(if self.is_shared() { self.now_us() } else { i64::MAX }, checkpoints).await
    }

    /// Does the same for the exports whose lease ran out.
    pub(crate) async fn reclaim_expired_exports(&self, checkpoints: Vec<Kept>) -> Result<usize, StoreError> {
        self.reclaim_exports(self.now_us(), checkpoints).await
    }

    async fn reclaim_exports(&self, leases_until: i64, checkpoints: Vec<Kept>) -> Result<usize, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let exhausted = Failure::new(
                FailureCode::AttemptsExhausted,
                format!("the server or the worker stopped {MAX_ATTEMPTS} times while it was being made"),
            );
            // Then the leases of this server's own workers end, and no others.
            let at_start = leases_until == i64::MAX;
            let mut writer = store.writer().await?;
            let mut tx = writer.begin().await?;
            let which = (leases_until, at_start);
            let moved = take_back(&store, Kind::Export, &exhausted, which, &checkpoints, &mut tx).await?;
            for row in &moved {
                let failed = query("select seq from exports where id = ? and state = 'failed'")
                    .bind(row.text("id")?)
                    .fetch_optional(&mut tx)
                    .await?;
                if let Some(failed) = failed {
                    properties::record(&mut tx, failed.try_get("seq")?, store.now_us()).await?;
                }
            }
            tx.commit().await?;
            drop(writer);
            for row in &moved {
                store.notify_export(export_id(row.text("id")?)?);
                store.wake_export_workers();
            }
            Ok(moved.len())
        })
        .await
    }

    /// Renews the lease of an export, and records the progress where there is any.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] where the export is no longer the caller's, or the database's.
    pub(crate) async fn renew_export(
        &self,
        of: impl Into<ExportLease>,
        progress: Option<JobProgress>,
    ) -> Result<(), StoreError> {
        let (store, of) = (self.clone(), of.into());
        let (task, id) = (LeasedTask::from(of), of.id);
        self.detached(async move {
            store.renew_lease(task, progress.as_ref()).await?;
            if progress.is_some() {
                store.notify_export(id);
            }
            Ok(())
        })
        .await
    }

    /// Looks whether the export is still running in the attempt of the caller.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] where it is not, or the database's.
    pub(crate) async fn check_export_lease(&self, of: impl Into<ExportLease>) -> Result<(), StoreError> {
        let of = of.into();
        query("select 1 from exports where seq = ? and attempt = ? and state = 'running'")
            .bind(of.seq)
            .bind(of.attempt)
            .fetch_optional(self.readers())
            .await?
            .map(drop)
            .ok_or(StoreError::LeaseLost)
    }

    /// Ends the export with its file, which is on disk already.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] where the export is no longer the caller's, or the database's.
    pub(crate) async fn export_made(
        &self,
        of: impl Into<ExportLease>,
        file: StoredFile,
        report: serde_json::Value,
    ) -> Result<(), StoreError> {
        let (store, of) = (self.clone(), of.into());
        let id = of.id;
        let made = Made { seq: of.seq, attempt: of.attempt, file, report };
        self.detached(async move {
            let study = store
                .write(Durability::PowerCut, made, |store, made, tx| Box::pin(made.record(store, tx)))
                .await?;
            store.notify_export(id);
            if let Some(study) = study {
                store.notify_study(study);
            }
            Ok(())
        })
        .await
    }

    /// Ends the export without a file.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] where the export is no longer the caller's, or the database's.
    pub(crate) async fn export_failed(
        &self,
        of: impl Into<ExportLease>,
        failure: &Failure,
    ) -> Result<(), StoreError> {
        self.leave_export(of, ExportState::Failed, Some(to_json(failure)?)).await
    }

    /// Requeues the export where the server stops; the attempt does not count.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] where the export is no longer the caller's, or the database's.
    pub(crate) async fn export_requeued(&self, of: impl Into<ExportLease>) -> Result<(), StoreError> {
        self.leave_export(of, ExportState::Queued, None).await?;
        self.wake_export_workers();
        Ok(())
    }

    async fn leave_export(
        &self,
        of: impl Into<ExportLease>,
        to: ExportState,
        error: Option<String>,
    ) -> Result<(), StoreError> {
        let (store, of) = (self.clone(), of.into());
        let id = of.id;
        self.detached(async move {
            let study = store
                .write(Durability::PowerCut, (of, to, error), |store, (of, to, error), tx| {
                    Box::pin(async move {
                        LeasedTask::from(*of).leave(store, to.name(), error.as_deref(), tx).await?;
                        properties::record(tx, of.seq, store.now_us()).await
                    })
                })
                .await?;
            store.notify_export(id);
            if let Some(study) = study {
                store.notify_study(study);
            }
            Ok(())
        })
        .await
    }

    /// Requeues the export after a fault of the machine; the attempt does not count, and the next one starts after a
    /// pause.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] where the export is no longer the caller's, or the database's.
    pub(crate) async fn export_requeued_after_fault(
        &self,
        of: impl Into<ExportLease>,
    ) -> Result<(), StoreError> {
        let (store, of) = (self.clone(), of.into());
        let (task, id) = (LeasedTask::from(of), of.id);
        let (pause, _) = self
            .detached(async move {
                let requeued = task.requeue_after_fault(&store, None).await?;
                store.notify_export(id);
                Ok(requeued)
            })
            .await?;
        tracing::warn!(pause_s = pause.as_secs(), "a fault of the machine: the export is requeued");
        self.wake_export_workers_after(pause);
        Ok(())
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

/// The end of an export with its file.
struct Made {
    seq: i64,
    attempt: i64,
    file: StoredFile,
    report: serde_json::Value,
}

impl Made {
    /// Records it; the study whose run has its properties by it.
    async fn record(&self, store: &Store, tx: &mut Transaction<'_>) -> Result<Option<StudyId>, StoreError> {
        let Self { seq, attempt, file, report } = self;
        let moved = query(
            "update exports set state = 'succeeded', path = ?1, bytes = ?2, sha256 = ?3, report = ?4, error = null,
                 progress = null, lease_expires_at = null, version = version + 1, updated_at = ?5, finished_at = ?5,
                 used_at = case when used_at > ?5 then used_at else ?5 end
             where seq = ?6 and attempt = ?7 and state = 'running'",
        )
        .bind(&file.path)
        .bind(file.bytes.cast_signed())
        .bind(&file.sha256)
        .bind(to_json(report)?)
        .bind(store.now_us())
        .bind(*seq)
        .bind(*attempt)
        .execute(&mut *tx)
        .await?;
        if moved.rows_affected() > 0 {
            return properties::record(tx, *seq, store.now_us()).await;
        }
        // The same file may be recorded already, as when the connection to the database went between a commit and its
        // answer. A caller that heard of a lost lease would remove the file that is recorded.
        query("select 1 from exports where seq = ? and path = ? and sha256 = ?")
            .bind(*seq)
            .bind(&file.path)
            .bind(&file.sha256)
            .fetch_optional(tx)
            .await?
            .map(|_| None)
            .ok_or(StoreError::LeaseLost)
    }
}
