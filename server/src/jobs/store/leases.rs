//! Leases of workers in other processes, which renew them over HTTP.
//!
//! Job and attempt are the fencing token, as for the workers of the server itself: whoever lost the lease changes
//! nothing. A process may repeat each of its requests. So a claim has an ID, by which a repeated one finds the jobs
//! that the first one leased, and an attempt is never given out twice: a job that comes back has the next one.

use std::time::Duration;

use super::checked::{MOST_WRONG_RESULTS, wrong_results_of};
use super::claims::{Claimed, Lessee};
use super::db::{Durability, Row, Transaction, query};
use super::exports::{ExportQueue, renew_export};
use super::submit::to_json;
use super::{Store, StoreError, micros, rows};
use crate::exports::ExportLease;
use crate::ids::TaskId;
use crate::jobs::{JobId, JobProgress, Lease, State, StopRequests};

/// A process that asks for jobs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Claim {
    /// Name of the process.
    pub(crate) worker: String,
    /// Name of its API key.
    pub(crate) key: String,
    /// The same in each repetition of the request, and in no other.
    pub(crate) id: String,
    /// Most jobs that it takes.
    pub(crate) slots: u32,
    /// Time that it has left, where that is limited. It gets no job whose work would be lost with the process: see
    /// [`forecasts`](super::forecasts).
    pub(crate) remaining: Option<Duration>,
    /// Whether it makes exports that need Gmsh.
    pub(crate) can_mesh: bool,
}

impl Claim {
    /// The exports that it may make.
    pub(super) fn exports(&self) -> ExportQueue {
        if self.can_mesh { ExportQueue::Heavy } else { ExportQueue::HeavyUnmeshed }
    }
}

/// The renewal of a lease.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Renewal {
    pub(crate) id: TaskId,
    pub(crate) attempt: i64,
    /// News of the run, where there are any.
    pub(crate) progress: Option<JobProgress>,
}

/// A process that runs jobs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct RunningProcess {
    /// Name of its API key.
    pub(crate) key: String,
    /// Its own name.
    pub(crate) worker: String,
    /// How many jobs and exports it runs.
    pub(crate) jobs: u64,
    /// It was heard within its lease.
    pub(crate) is_heard: bool,
}

/// What has become of a lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Held {
    /// The attempt runs.
    Running { lease: Lease, requests: StopRequests },
    /// The attempt of an export runs.
    RunningExport(ExportLease),
    /// The attempt was the last of the job or the export, which has ended, waits for a client, or waits for the check
    /// of what the process has sent.
    Ended,
    /// The job or the export is another attempt's, or gone.
    Lost,
}

impl Store {
    /// Leases up to `slots` jobs to a process, or finds those that an earlier request of the same ID leased.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn claim_for(&self, claim: Claim) -> Result<Vec<Claimed>, StoreError> {
        let store = self.clone();
        self.detached(async move {
            // A power cut that undoes the claim leaves the jobs queued; the leases are then lost.
            let claimed = store
                .write(store.durability_of_leases(), claim, |store, claim, tx| {
                    Box::pin(claim.take(store, tx))
                })
                .await?;
            for claimed in &claimed {
                store.notify_job(&claimed.job);
            }
            Ok(claimed)
        })
        .await
    }

    /// Renews leases of a process, and records the progress where there is any; what became of each.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn renew(&self, key: String, renewals: Vec<Renewal>) -> Result<Vec<Held>, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let reported: Vec<TaskId> = renewals
                .iter()
                .filter(|renewal| renewal.progress.is_some())
                .map(|renewal| renewal.id)
                .collect();
            let held = store
                .write(Durability::ProcessEnd, (key, renewals), |store, (key, renewals), tx| {
                    Box::pin(renew_all(store, key, renewals, tx))
                })
                .await?;
            for (id, held) in reported.into_iter().zip(&held) {
                match held {
                    Held::RunningExport(of) => store.notify_export(of.id),
                    _ => store.notify(id.job()),
                }
            }
            Ok(held)
        })
        .await
    }

    /// What has become of a lease that a process got with this key.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn held(
        &self,
        key: &str,
        id: impl Into<TaskId>,
        attempt: i64,
    ) -> Result<Held, StoreError> {
        let id = id.into();
        let row = query(
            "select seq, state, cancel_requested, finish_requested, received_at,
                 (select studies.id from studies where studies.seq = jobs.study) as study_id
             from jobs where id = ? and attempt = ? and worker_key = ? and worker <> ''",
        )
        .bind(id.to_string())
        .bind(attempt)
        .bind(key)
        .fetch_optional(self.readers())
        .await?;
        let Some(row) = row else { return self.held_export(key, id.export(), attempt).await };
        let state = rows::state(row.text("state")?)?;
        Ok(match state {
            // Its result, or why there is none, was received.
            State::Running if row.try_get::<Option<i64>>("received_at")?.is_some() => Held::Ended,
            State::Running => {
                Held::Running { lease: lease(&row, id.job(), attempt)?, requests: rows::stop_requests(&row)? }
            }
            state if state.is_finished() => Held::Ended,
            _ => Held::Lost,
        })
    }

    /// The processes that run jobs.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn processes(&self) -> Result<Vec<RunningProcess>, StoreError> {
        let rows = query(
            "select worker_key, worker, count(*) as jobs, max(lease_expires_at) as lease_expires_at from (
                 select worker_key, worker, lease_expires_at from jobs
                 where state = 'running' and worker <> '' and received_at is null
                 union all select worker_key, worker, lease_expires_at from exports
                 where state = 'running' and worker <> ''
             ) as leased group by worker_key, worker",
        )
        .fetch_all(self.readers())
        .await?;
        let now = self.now_us();
        rows.iter()
            .map(|row| {
                Ok(RunningProcess {
                    key: row.try_get("worker_key")?,
                    worker: row.try_get("worker")?,
                    jobs: row.try_get::<i64>("jobs")?.cast_unsigned(),
                    is_heard: row.try_get::<Option<i64>>("lease_expires_at")? > Some(now),
                })
            })
            .collect()
    }

    /// Gives every process that runs jobs and exports the time of a lease to find the server again, at its start.
    /// Returns how many they run.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn await_workers(&self) -> Result<u64, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let mut writer = store.quick_writer().await?;
            let until = store.now_us().saturating_add(micros(store.limits().lease));
            let mut moved = 0;
            for text in [
                "update jobs set lease_expires_at = ?
                 where state = 'running' and worker <> '' and received_at is null",
                "update exports set lease_expires_at = ? where state = 'running' and worker <> ''",
            ] {
                moved += query(text).bind(until).execute(&mut writer).await?.rows_affected();
            }
            Ok(moved)
        })
        .await
    }
}

impl Claim {
    /// Leases the jobs, or finds those that the same claim has leased before.
    async fn take(&self, store: &Store, tx: &mut Transaction<'_>) -> Result<Vec<Claimed>, StoreError> {
        let mut claimed = Vec::new();
        while claimed.len() < self.slots as usize
            && let Some(next) = store.claim_next(tx, Lessee::Process(self, claimed.len())).await?
        {
            claimed.push(next);
        }
        if !claimed.is_empty() {
            return Ok(claimed);
        }
        let before = Claimed::before(self, tx).await?;
        let wrong = wrong_results_of(&self.key, &self.worker, tx).await?;
        if before.is_empty() && wrong >= MOST_WRONG_RESULTS {
            return Err(StoreError::WorkerBlocked { worker: self.worker.clone(), wrong });
        }
        Ok(before)
    }
}

async fn renew_all(
    store: &Store,
    key: &str,
    renewals: &[Renewal],
    tx: &mut Transaction<'_>,
) -> Result<Vec<Held>, StoreError> {
    let now = store.now_us();
    let mut held = Vec::with_capacity(renewals.len());
    for renewal in renewals {
        let row = query(
            "update jobs set lease_expires_at = ?1, progress = coalesce(?2, progress),
                 version = version + case when ?2 is null then 0 else 1 end,
                 updated_at = case when ?2 is null then updated_at else ?3 end
             where id = ?4 and attempt = ?5 and worker_key = ?6 and worker <> '' and state = 'running'
                 and received_at is null
             returning seq, cancel_requested, finish_requested,
                 (select studies.id from studies where studies.seq = jobs.study) as study_id",
        )
        .bind(now.saturating_add(micros(store.limits().lease)))
        .bind(renewal.progress.as_ref().map(to_json).transpose()?)
        .bind(now)
        .bind(renewal.id.to_string())
        .bind(renewal.attempt)
        .bind(key)
        .fetch_optional(&mut *tx)
        .await?;
        held.push(match row {
            Some(row) => Held::Running {
                lease: lease(&row, renewal.id.job(), renewal.attempt)?,
                requests: rows::stop_requests(&row)?,
            },
            None => renew_export(store, key, renewal, tx).await?,
        });
    }
    Ok(held)
}

fn lease(row: &Row, id: JobId, attempt: i64) -> Result<Lease, StoreError> {
    let study = row.try_get::<Option<String>>("study_id")?;
    let study = study.as_deref().map(rows::study_id).transpose()?;
    Ok(Lease { seq: row.try_get("seq")?, id, attempt, study })
}
