//! Exports that worker processes make: their leases, as those of jobs ([`leases`](super::super::leases)), and what
//! becomes of one whose maker has sent what is wrong.

use super::super::checked::{MOST_WRONG_RESULTS, Refused, count_wrong, wrong_results_of};
use super::super::db::{Durability, Row, Transaction, query};
use super::super::leases::{Claim as LeaseClaim, Held, Renewal};
use super::super::studies::properties;
use super::super::submit::to_json;
use super::super::{Store, StoreError, micros, rows};
use super::claims::{self, Claim, ClaimedExport, Maker};
use super::{export, export_id, select_exports};
use crate::exports::{ExportLease, ExportState};
use crate::failure::{Failure, FailureCode};
use crate::ids::ExportId;

impl Store {
    /// Leases an export for the slots of packings to a process, or finds the one that an earlier request of the same ID
    /// has leased. A look that writes nothing comes before.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn claim_export_for(
        &self,
        claim: LeaseClaim,
    ) -> Result<Option<ClaimedExport>, StoreError> {
        let may_begin = claim.slots > 0;
        let has_one = query("select 1 from exports where claim = ? and worker_key = ? and state = 'running'")
            .bind(&claim.id)
            .bind(&claim.key)
            .fetch_optional(self.readers())
            .await?
            .is_some();
        let may_find = has_one || (may_begin && self.has_claimable_export(claim.exports()).await?);
        if !may_find {
            return Ok(None);
        }
        let store = self.clone();
        self.detached(async move {
            // A power cut that undoes the claim leaves the export queued; the lease is then lost.
            let (claimed, ended) = store
                .write(store.durability_of_leases(), claim, |store, claim, tx| {
                    Box::pin(take(store, claim, tx))
                })
                .await?;
            for id in ended {
                store.notify_export(id);
            }
            if let Some(claimed) = &claimed {
                store.notify_export(claimed.export.id);
            }
            Ok(claimed)
        })
        .await
    }

    /// What has become of the lease of an export that a process got with this key.
    pub(in crate::jobs::store) async fn held_export(
        &self,
        key: &str,
        id: ExportId,
        attempt: i64,
    ) -> Result<Held, StoreError> {
        let row = query(
            "select exports.seq, exports.state, exports.id, exports.attempt, jobs.id as job_id
             from exports join jobs on jobs.seq = exports.job
             where exports.id = ? and exports.attempt = ? and exports.worker_key = ? and exports.worker <> ''",
        )
        .bind(id.to_string())
        .bind(attempt)
        .bind(key)
        .fetch_optional(self.readers())
        .await?;
        let Some(row) = row else { return Ok(Held::Lost) };
        let state = ExportState::from_name(row.text("state")?);
        Ok(match state {
            Some(ExportState::Running) => Held::RunningExport(lease(&row)?),
            Some(state) if state.is_finished() => Held::Ended,
            _ => Held::Lost,
        })
    }

    /// The result that a leased export is made from, and the owner and faults of both.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] where the export is no longer the caller's, or the database's.
    pub(crate) async fn leased_export(&self, of: ExportLease) -> Result<ClaimedExport, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let mut tx = store.readers().begin().await?;
            let row = query(select_exports!("where exports.seq = ? and exports.attempt = ?"))
                .bind(of.seq)
                .bind(of.attempt)
                .fetch_optional(&mut tx)
                .await?
                .ok_or(StoreError::LeaseLost)?;
            let found = ClaimedExport::of(export(&row)?, row.try_get("faults")?, &mut tx).await?;
            tx.rollback().await?;
            found.ok_or(StoreError::LeaseLost)
        })
        .await
    }

    /// Requeues an export whose worker process has sent a wrong file or report, and counts it for the process. The
    /// attempt counts: after the last one the export has failed.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn refuse_export(&self, of: ExportLease, fault: &str) -> Result<Refused, StoreError> {
        let (store, fault) = (self.clone(), fault.to_owned());
        self.detached(async move {
            let refused = store
                .write(Durability::PowerCut, (of, fault), |store, (of, fault), tx| {
                    Box::pin(refuse(store, *of, fault, tx))
                })
                .await?;
            store.notify_export(of.id);
            store.wake_export_workers();
            Ok(refused)
        })
        .await
    }

    /// Requeues an export whose worker process reports what only a defect or a faulty machine causes. The attempt
    /// counts: after the last one the export has failed. Returns whether it has.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn retry_export_after_defect(
        &self,
        of: ExportLease,
        failure: Failure,
    ) -> Result<bool, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let has_failed = store
                .write(Durability::PowerCut, (of, failure), |store, (of, failure), tx| {
                    Box::pin(try_again(store, *of, failure, tx))
                })
                .await?;
            store.notify_export(of.id);
            store.wake_export_workers();
            Ok(has_failed)
        })
        .await
    }
}

/// Leases an export, or finds the one that the same claim has leased before; with those that have ended meanwhile.
async fn take(
    store: &Store,
    claim: &LeaseClaim,
    tx: &mut Transaction<'_>,
) -> Result<(Option<ClaimedExport>, Vec<ExportId>), StoreError> {
    let mut ended = Vec::new();
    let before = query(select_exports!(
        "where exports.claim = ? and exports.worker_key = ? and exports.state = 'running'"
    ))
    .bind(&claim.id)
    .bind(&claim.key)
    .fetch_optional(&mut *tx)
    .await?;
    if let Some(row) = before {
        return Ok((ClaimedExport::of(export(&row)?, row.try_get("faults")?, tx).await?, ended));
    }
    let has_job = query(
        "select 1 from jobs where claim = ? and worker_key = ? and state = 'running' and received_at is null",
    )
    .bind(&claim.id)
    .bind(&claim.key)
    .fetch_optional(&mut *tx)
    .await?
    .is_some();
    let is_blocked = wrong_results_of(&claim.key, &claim.worker, tx).await? >= MOST_WRONG_RESULTS;
    if claim.slots == 0 || has_job || is_blocked {
        return Ok((None, ended));
    }
    loop {
        match claims::claim(store, claim.exports(), Maker::Process(claim), store.now_us(), tx).await? {
            Claim::None => return Ok((None, ended)),
            Claim::Claimed(claimed) => return Ok((Some(*claimed), ended)),
            Claim::Ended(id) => ended.extend(id),
        }
    }
}

/// Renews the lease of an export of a process; what became of it.
pub(in crate::jobs::store) async fn renew_export(
    store: &Store,
    key: &str,
    renewal: &Renewal,
    tx: &mut Transaction<'_>,
) -> Result<Held, StoreError> {
    let now = store.now_us();
    let row = query(
        "update exports set lease_expires_at = ?1, progress = coalesce(?2, progress),
             version = version + case when ?2 is null then 0 else 1 end,
             updated_at = case when ?2 is null then updated_at else ?3 end
         where id = ?4 and attempt = ?5 and worker_key = ?6 and worker <> '' and state = 'running'
         returning seq, id, attempt, (select jobs.id from jobs where jobs.seq = exports.job) as job_id",
    )
    .bind(now.saturating_add(micros(store.lease())))
    .bind(renewal.progress.as_ref().map(to_json).transpose()?)
    .bind(now)
    .bind(renewal.id.to_string())
    .bind(renewal.attempt)
    .bind(key)
    .fetch_optional(tx)
    .await?;
    row.map_or(Ok(Held::Lost), |row| Ok(Held::RunningExport(lease(&row)?)))
}

fn lease(row: &Row) -> Result<ExportLease, StoreError> {
    Ok(ExportLease {
        seq: row.try_get("seq")?,
        id: export_id(row.text("id")?)?,
        job: rows::job_id(row.text("job_id")?)?,
        attempt: row.try_get("attempt")?,
    })
}

async fn refuse(
    store: &Store,
    of: ExportLease,
    fault: &str,
    tx: &mut Transaction<'_>,
) -> Result<Refused, StoreError> {
    let row = query("select worker, worker_key from exports where seq = ? and attempt = ? and worker <> ''")
        .bind(of.seq)
        .bind(of.attempt)
        .fetch_optional(&mut *tx)
        .await?
        .ok_or(StoreError::LeaseLost)?;
    let (key, worker): (String, String) = (row.try_get("worker_key")?, row.try_get("worker")?);
    let failure =
        Failure::new(FailureCode::CheckFailed, format!("what a worker has made of it was wrong: {fault}"));
    let has_failed = try_again(store, of, &failure, tx).await?;
    let export = format!("export {}: {fault}", of.id);
    count_wrong(store, (&key, &worker), (of.job, of.attempt), &export, tx).await?;
    Ok(Refused { of_worker: wrong_results_of(&key, &worker, tx).await?, has_failed })
}

/// Requeues an export with its next attempt, or ends it where it has none left; whether it has ended.
async fn try_again(
    store: &Store,
    of: ExportLease,
    failure: &Failure,
    tx: &mut Transaction<'_>,
) -> Result<bool, StoreError> {
    let row = query(
        "update exports set
             state = case when attempt >= max_attempts then 'failed' else 'queued' end,
             error = case when attempt >= max_attempts then ?2 end,
             finished_at = case when attempt >= max_attempts then ?1 end,
             started_at = case when attempt >= max_attempts then started_at end,
             attempt = attempt + case when attempt >= max_attempts then 0 else 1 end,
             progress = null, lease_expires_at = null, version = version + 1, updated_at = ?1
         where seq = ?3 and attempt = ?4 and state = 'running' returning state",
    )
    .bind(store.now_us())
    .bind(to_json(failure)?)
    .bind(of.seq)
    .bind(of.attempt)
    .fetch_optional(&mut *tx)
    .await?
    .ok_or(StoreError::LeaseLost)?;
    let has_failed = row.text("state")? == "failed";
    if has_failed {
        properties::record(tx, of.seq, store.now_us()).await?;
    }
    Ok(has_failed)
}
