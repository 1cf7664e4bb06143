//! Leasing the next export: to an export worker of this server, or to a slot of packings, here or in another process.

use super::super::db::{Transaction, query};
use super::super::leases::Claim as LeaseClaim;
use super::super::submit::to_json;
use super::super::{Store, StoreError, micros, rows};
use super::{by_seq, end_of_retried};
use crate::exports::ExportRecord;
use crate::failure::{Failure, FailureCode};
use crate::ids::ExportId;
use crate::jobs::ArtifactRecord;

/// The statement that starts the export whose number `$tail` selects, for the worker `?3` with the key `?4`.
macro_rules! next {
    ($tail:expr) => {
        concat!(
            "update exports set state = 'running', version = version + 1, started_at = ?1, updated_at = ?1,
                 lease_expires_at = ?2, progress = null, error = null, not_before = null,
                 worker = ?3, worker_key = ?4, claim = ?5
             where seq = (",
            $tail,
            ") returning seq, id, faults"
        )
    };
}

/// The query for the next export among those of `$tail`, at the time `?1`.
macro_rules! waiting {
    ($($tail:literal),+) => {
        concat!(
            "select seq from exports ",
            $($tail,)+
            " and (not_before is null or not_before <= ?1) order by rank, seq limit 1"
        )
    };
}

/// The number of the next export for the slots of packings that `$which` selects: of the first 250 one whose job the
/// worker `?3` with the key `?4` has packed, else the first.
macro_rules! heavy {
    ($which:literal) => {
        concat!(
            "select coalesce((select line.seq from (
                 select exports.seq, exports.rank, exports.job from exports indexed by exports_heavy
                 where state = 'queued' and heavy",
            $which,
            " and (not_before is null or not_before <= ?1)
                 order by exports.rank, exports.seq limit 250
             ) as line join jobs on jobs.seq = line.job where jobs.worker = ?3 and jobs.worker_key = ?4
             order by line.rank, line.seq limit 1), (",
            waiting!("indexed by exports_heavy where state = 'queued' and heavy", $which),
            "))"
        )
    };
}

/// Which of the exports that wait are looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ExportQueue {
    /// Those for export workers.
    Usual,
    /// Of these what is made in a moment.
    Quick,
    /// Those for the slots of packings.
    Heavy,
    /// Of these what needs no Gmsh.
    HeavyUnmeshed,
    /// Of these what needs it.
    HeavyMeshed,
}

/// Who makes an export.
#[derive(Clone, Copy, Debug)]
pub(in crate::jobs::store) enum Maker<'c> {
    /// This server.
    Here,
    /// A worker process.
    Process(&'c LeaseClaim),
}

/// An export that the caller has claimed.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ClaimedExport {
    pub(crate) export: ExportRecord,
    /// The result that the export is made from.
    pub(crate) result: ArtifactRecord,
    /// Faults of the machine that it has met.
    pub(crate) faults: i64,
    /// Most threads, as the request of the job has it.
    pub(crate) threads: Option<u32>,
}

impl Store {
    /// Claims the next export of a queue: one that a client waits for first, then the oldest.
    pub(crate) async fn claim_export(&self, queue: ExportQueue) -> Result<Option<ClaimedExport>, StoreError> {
        let store = self.clone();
        self.detached(async move {
            // A power cut that undoes the claim leaves the export queued.
            loop {
                let mut writer = store.shared.writer.lock(store.durability_of_leases()).await?;
                let now = writer.now_us();
                let mut tx = writer.begin().await?;
                let claimed = claim(&store, queue, Maker::Here, now, &mut tx).await?;
                if let Claim::None = claimed {
                    tx.rollback().await?;
                } else {
                    tx.commit().await?;
                }
                drop(writer);
                match claimed {
                    Claim::None => return Ok(None),
                    Claim::Claimed(claimed) => {
                        store.notify_export(claimed.export.id);
                        return Ok(Some(*claimed));
                    }
                    Claim::Ended(id) => id.into_iter().for_each(|id| store.notify_export(id)),
                }
            }
        })
        .await
    }

    /// Claims the next export for the slots of packings, or finds that none waits by a look that writes nothing.
    /// `can_mesh` is asked where one needs Gmsh.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn claim_heavy_export(
        &self,
        can_mesh: impl Future<Output = bool>,
    ) -> Result<Option<ClaimedExport>, StoreError> {
        if !self.has_claimable_export(ExportQueue::Heavy).await? {
            return Ok(None);
        }
        let is_unmeshed = self.has_claimable_export(ExportQueue::HeavyMeshed).await? && !can_mesh.await;
        self.claim_export(if is_unmeshed { ExportQueue::HeavyUnmeshed } else { ExportQueue::Heavy }).await
    }

    /// Whether an export waits that [`Self::claim_export`] would claim now. Claims nothing.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn has_claimable_export(&self, queue: ExportQueue) -> Result<bool, StoreError> {
        let text = match queue {
            ExportQueue::Usual => {
                waiting!("indexed by exports_queue where state = 'queued' and not heavy")
            }
            ExportQueue::Quick => waiting!("indexed by exports_quick where state = 'queued' and quick"),
            ExportQueue::Heavy => waiting!("indexed by exports_heavy where state = 'queued' and heavy"),
            ExportQueue::HeavyUnmeshed => {
                waiting!("indexed by exports_heavy where state = 'queued' and heavy and not needs_mesher")
            }
            ExportQueue::HeavyMeshed => {
                waiting!("indexed by exports_heavy where state = 'queued' and heavy and needs_mesher")
            }
        };
        Ok(query(text).bind(self.now_us()).fetch_optional(self.readers()).await?.is_some())
    }
}

/// The statement that claims the next export.
pub(super) fn claim_sql(queue: ExportQueue) -> &'static str {
    match queue {
        ExportQueue::Usual => {
            next!(waiting!("indexed by exports_queue where state = 'queued' and not heavy"))
        }
        ExportQueue::Quick => next!(waiting!("indexed by exports_quick where state = 'queued' and quick")),
        ExportQueue::Heavy => next!(heavy!("")),
        ExportQueue::HeavyUnmeshed => next!(heavy!(" and not needs_mesher")),
        ExportQueue::HeavyMeshed => next!(heavy!(" and needs_mesher")),
    }
}

/// Claims the next export of a queue.
pub(super) async fn claim(
    store: &Store,
    queue: ExportQueue,
    maker: Maker<'_>,
    now: i64,
    tx: &mut Transaction<'_>,
) -> Result<Claim, StoreError> {
    let (worker, key, claim) = match maker {
        Maker::Here => ("", "", None),
        Maker::Process(claim) => (claim.worker.as_str(), claim.key.as_str(), Some(&claim.id)),
    };
    let row = query(claim_sql(queue))
        .bind(now)
        .bind(now.saturating_add(micros(store.lease())))
        .bind(worker)
        .bind(key)
        .bind(claim)
        .fetch_optional(&mut *tx)
        .await?;
    let Some(row) = row else { return Ok(Claim::None) };
    let seq = row.try_get("seq")?;
    let export = match by_seq(&mut *tx, seq).await {
        Ok(export) => export,
        Err(StoreError::Row(fault)) => {
            fail_damaged(&mut *tx, seq, &fault, now).await?;
            return Ok(Claim::Ended(row.text("id").ok().and_then(ExportId::parse)));
        }
        Err(error) => return Err(error),
    };
    let (id, job, faults) = (export.id, export.job_seq, row.try_get("faults")?);
    if let Some(claimed) = ClaimedExport::of(export, faults, tx).await? {
        return Ok(Claim::Claimed(Box::new(claimed)));
    }
    tracing::warn!(export_id = %id, "an export of a job without a result has ended");
    // An export waits or runs only while its job has a result: a database that says otherwise holds up no other.
    end_of_retried(tx, job, now).await?;
    Ok(Claim::Ended(Some(id)))
}

impl ClaimedExport {
    /// An export with the result of its job; `None` where the job has none.
    pub(super) async fn of(
        export: ExportRecord,
        faults: i64,
        tx: &mut Transaction<'_>,
    ) -> Result<Option<Self>, StoreError> {
        let job = match rows::by_seq(tx, export.job_seq).await {
            Err(StoreError::Row(fault)) => {
                tracing::error!(
                    seq = export.job_seq,
                    fault,
                    "a job with an export is damaged in the database"
                );
                return Ok(None);
            }
            job => job?,
        };
        let threads = job.threads;
        Ok(job.artifact.map(|result| Self { export, result, faults, threads }))
    }
}

/// Ends an export whose row cannot be read.
async fn fail_damaged(tx: &mut Transaction<'_>, seq: i64, fault: &str, now: i64) -> Result<(), StoreError> {
    tracing::error!(seq, fault, "a queued export is damaged in the database and fails");
    let detail = format!("the record of the export in the database is damaged ({fault}): ask for it again");
    let failure = Failure::new(FailureCode::InternalError, &detail);
    query(
        "update exports set state = 'failed', version = version + 1, finished_at = ?1, updated_at = ?1,
             lease_expires_at = null, error = ?2
         where seq = ?3",
    )
    .bind(now)
    .bind(to_json(&failure)?)
    .bind(seq)
    .execute(tx)
    .await?;
    Ok(())
}

/// What a claim has found.
pub(super) enum Claim {
    None,
    Claimed(Box<ClaimedExport>),
    /// An export of a job without a result, or one whose row cannot be read, which has ended; the ID where it is known.
    Ended(Option<ExportId>),
}
