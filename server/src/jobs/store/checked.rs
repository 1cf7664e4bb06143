//! The ends of checks of what worker processes have sent (see [`received`](super::received)), and the processes whose
//! results were wrong.

use std::collections::BTreeMap;

use super::db::{Durability, Row, Transaction, query};
use super::exports::insert_beforehand;
use super::received::delete_artifact;
use super::studies::runs;
use super::submit::to_json;
use super::{Store, StoreError};
use crate::exports::NewExport;
use crate::failure::{Failure, FailureCode};
use crate::jobs::{JobId, JobProgress, Lease};
use crate::studies::Facts;

/// Wrong results after which a worker process gets no job.
pub(crate) const MOST_WRONG_RESULTS: i64 = 3;
/// Wrong results of one job after which it fails: more than one worker has sent them, so that a defect of the program
/// is more likely than faulty machines.
const MOST_WRONG_OF_JOB: i64 = 2 * MOST_WRONG_RESULTS;

/// What has become of a job or an export whose attempt ended wrongly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Refused {
    /// Wrong results of the worker process, this one too, since it was last allowed.
    pub(crate) of_worker: i64,
    /// The job or the export has failed: too many of its results were wrong.
    pub(crate) has_failed: bool,
}

/// The lengths of the formats of a result.
#[derive(Clone, Debug)]
pub(crate) struct FormatLengths {
    /// Revision of the formats.
    pub(crate) revision: u32,
    /// Length in bytes by name of the format.
    pub(crate) bytes: BTreeMap<String, u64>,
}

/// A worker process that has sent wrong results since it was last allowed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct FaultyWorker {
    /// Name of its API key.
    pub(crate) key: String,
    /// Its own name.
    pub(crate) worker: String,
    pub(crate) wrong_results: i64,
    /// When the last one came, in microseconds since the Unix epoch.
    pub(crate) last_at: i64,
    /// ID of the job of the last one.
    pub(crate) last_job: String,
    /// What was wrong with it.
    pub(crate) last_fault: String,
}

impl FaultyWorker {
    /// Whether it gets no job.
    pub(crate) fn is_blocked(&self) -> bool {
        self.wrong_results >= MOST_WRONG_RESULTS
    }
}

impl Store {
    /// Ends a job with its result, which was checked, and queues the exports that its request lists.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn accept_result(
        &self,
        lease: Lease,
        progress: JobProgress,
        facts: Facts,
        postprocess: Vec<NewExport>,
        formats: FormatLengths,
    ) -> Result<(), StoreError> {
        let store = self.clone();
        self.detached(async move {
            let has_exports = !postprocess.is_empty();
            let input = (lease, progress, facts, (postprocess, formats));
            let cancelled = store
                .write(
                    Durability::PowerCut,
                    input,
                    |store, (lease, progress, facts, (postprocess, formats)), tx| {
                        Box::pin(async move {
                            let now = store.now_us();
                            let moved = query(
                            "update jobs set state = 'succeeded', version = version + 1, finished_at = ?1,
                                 updated_at = ?1, lease_expires_at = null, received_at = null, progress = ?2
                             where seq = ?3 and attempt = ?4 and received_at is not null
                             returning study, point, replicate",
                        )
                        .bind(now)
                        .bind(to_json(progress)?)
                        .bind(lease.seq)
                        .bind(lease.attempt)
                        .fetch_optional(&mut *tx)
                        .await?
                        .ok_or(StoreError::LeaseLost)?;
                            query(
                                "update artifacts set format_revision = ?, format_lengths = ?
                             where job = ? and attempt = ?",
                            )
                            .bind(formats.revision)
                            .bind(to_json(&formats.bytes)?)
                            .bind(lease.seq)
                            .bind(lease.attempt)
                            .execute(&mut *tx)
                            .await?;
                            insert_beforehand(tx, lease.seq, postprocess, now).await?;
                            runs::record(tx, &moved, facts.outcome_of_packing(), facts, now).await
                        })
                    },
                )
                .await?;
            store.notify_ended(lease, &cancelled);
            if has_exports {
                store.wake_export_workers();
            }
            Ok(())
        })
        .await
    }

    /// Ends a job with the failure that was received, as the check has found it.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn accept_failure(
        &self,
        lease: Lease,
        failure: &Failure,
        facts: Facts,
    ) -> Result<(), StoreError> {
        let (store, document) = (self.clone(), to_json(failure)?);
        let outcome = runs::outcome_of(failure.code);
        self.detached(async move {
            let input = (lease, document, outcome, facts);
            let cancelled = store
                .write(Durability::PowerCut, input, |store, (lease, document, outcome, facts), tx| {
                    Box::pin(async move {
                        let now = store.now_us();
                        let moved = query(
                            "update jobs set state = 'failed', version = version + 1, finished_at = ?1,
                                 updated_at = ?1, lease_expires_at = null, received_at = null, error = ?2
                             where seq = ?3 and attempt = ?4 and received_at is not null
                             returning study, point, replicate",
                        )
                        .bind(now)
                        .bind(document)
                        .bind(lease.seq)
                        .bind(lease.attempt)
                        .fetch_optional(&mut *tx)
                        .await?
                        .ok_or(StoreError::LeaseLost)?;
                        runs::record(tx, &moved, *outcome, facts, now).await
                    })
                })
                .await?;
            store.notify_ended(lease, &cancelled);
            Ok(())
        })
        .await
    }

    /// Requeues a job whose attempt ended with a wrong result or failure, and counts it for the worker process. The
    /// attempt does not count for the job, which fails once [`MOST_WRONG_OF_JOB`] of its results were wrong.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn refuse_end(&self, lease: Lease, fault: &str) -> Result<Refused, StoreError> {
        let (store, fault) = (self.clone(), fault.to_owned());
        self.detached(async move {
            let refused = store
                .write(Durability::PowerCut, (lease, fault), |store, (lease, fault), tx| {
                    Box::pin(refuse(store, *lease, fault, tx))
                })
                .await?;
            store.notify_lease(lease);
            store.wake_worker();
            Ok(refused)
        })
        .await
    }

    /// Requeues a job whose received result is no longer what was stored here. The attempt does not count.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn requeue_lost_result(&self, lease: Lease) -> Result<(), StoreError> {
        let store = self.clone();
        self.detached(async move {
            store
                .write(Durability::PowerCut, lease, |store, lease, tx| {
                    Box::pin(async move {
                        delete_artifact(*lease, tx).await?;
                        move_on(store, *lease, Next::Requeued, tx).await
                    })
                })
                .await?;
            store.notify_lease(lease);
            store.wake_worker();
            Ok(())
        })
        .await
    }

    /// Requeues a job whose worker reports what only a defect or a faulty machine causes. The attempt counts: after the
    /// last one the job has failed. Returns whether it has ended.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn retry_after_defect(
        &self,
        lease: Lease,
        failure: Failure,
    ) -> Result<bool, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let has_ended = store
                .write(Durability::PowerCut, (lease, failure), |store, (lease, failure), tx| {
                    Box::pin(move_on(store, *lease, Next::Retried(failure), tx))
                })
                .await?;
            store.notify_lease(lease);
            store.wake_worker();
            Ok(has_ended)
        })
        .await
    }

    /// The worker processes that have sent wrong results since they were last allowed, the latest first.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn faulty_workers(&self) -> Result<Vec<FaultyWorker>, StoreError> {
        let rows = query(
            "select found.worker_key, found.worker, found.wrong_results, last.at, last.job, last.fault
             from (
                 select worker_key, worker, count(*) as wrong_results, max(seq) as last_seq
                 from wrong_results group by worker_key, worker
             ) as found join wrong_results as last on last.seq = found.last_seq
             order by last.seq desc",
        )
        .fetch_all(self.readers())
        .await?;
        let read = |row: &Row| -> Result<FaultyWorker, StoreError> {
            Ok(FaultyWorker {
                key: row.try_get("worker_key")?,
                worker: row.try_get("worker")?,
                wrong_results: row.try_get("wrong_results")?,
                last_at: row.try_get("at")?,
                last_job: row.try_get("job")?,
                last_fault: row.try_get("fault")?,
            })
        };
        rows.iter().map(read).collect()
    }

    /// Forgets the wrong results of a worker process, which gets jobs again; how many they were.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn allow_worker(&self, key: String, worker: String) -> Result<u64, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let mut writer = store.writer().await?;
            let forgotten = query("delete from wrong_results where worker_key = ? and worker = ?")
                .bind(key)
                .bind(worker)
                .execute(&mut writer)
                .await?
                .rows_affected();
            drop(writer);
            store.wake_worker();
            Ok(forgotten)
        })
        .await
    }

    /// Notifies of a job that ended, and of the jobs that the stop rule of its study cancelled because of it.
    fn notify_ended(&self, lease: Lease, cancelled: &[JobId]) {
        self.notify_lease(lease);
        self.notify_all(cancelled);
        self.wake_worker_for_held_back();
    }
}

/// Wrong results of a worker process since it was last allowed.
pub(super) async fn wrong_results_of(
    key: &str,
    worker: &str,
    tx: &mut Transaction<'_>,
) -> Result<i64, StoreError> {
    let count = query("select count(*) from wrong_results where worker_key = ? and worker = ?");
    Ok(count.bind(key).bind(worker).scalar(tx).await?)
}

/// Counts a wrong result for the worker process of that key and name.
pub(super) async fn count_wrong(
    store: &Store,
    (key, worker): (&str, &str),
    (job, attempt): (JobId, i64),
    fault: &str,
    tx: &mut Transaction<'_>,
) -> Result<(), StoreError> {
    query(
        "insert into wrong_results (worker_key, worker, job, attempt, fault, at) values (?1, ?2, ?3, ?4, ?5, ?6)",
    )
    .bind(key)
    .bind(worker)
    .bind(job.to_string())
    .bind(attempt)
    .bind(fault)
    .bind(store.now_us())
    .execute(tx)
    .await?;
    Ok(())
}

async fn refuse(
    store: &Store,
    lease: Lease,
    fault: &str,
    tx: &mut Transaction<'_>,
) -> Result<Refused, StoreError> {
    let row = query(
        "select worker, worker_key from jobs where seq = ? and attempt = ? and state = 'running' and worker <> ''",
    )
    .bind(lease.seq)
    .bind(lease.attempt)
    .fetch_optional(&mut *tx)
    .await?
    .ok_or(StoreError::LeaseLost)?;
    let (key, worker): (String, String) = (row.try_get("worker_key")?, row.try_get("worker")?);
    count_wrong(store, (&key, &worker), (lease.id, lease.attempt), fault, tx).await?;
    let of_job: i64 = query("select count(*) from wrong_results where job = ?")
        .bind(lease.id.to_string())
        .scalar(&mut *tx)
        .await?;
    let failure = (of_job >= MOST_WRONG_OF_JOB).then(|| {
        Failure::new(
            FailureCode::CheckFailed,
            format!("the results of {of_job} attempts were wrong; the last one: {fault}"),
        )
    });
    delete_artifact(lease, tx).await?;
    move_on(store, lease, failure.as_ref().map_or(Next::Requeued, Next::Failed), tx).await?;
    let of_worker = wrong_results_of(&key, &worker, tx).await?;
    Ok(Refused { of_worker, has_failed: failure.is_some() })
}

/// What becomes of a job whose attempt ended without a result that is believed.
enum Next<'f> {
    /// It waits again; the attempt does not count.
    Requeued,
    /// It waits again; where no attempt is left, it has failed.
    Retried(&'f Failure),
    /// It has failed.
    Failed(&'f Failure),
}

/// Requeues or ends a job; whether it has ended. A job that a client has cancelled is cancelled.
async fn move_on(
    store: &Store,
    lease: Lease,
    next: Next<'_>,
    tx: &mut Transaction<'_>,
) -> Result<bool, StoreError> {
    let (failure, counts) = match next {
        Next::Requeued => (None, false),
        Next::Retried(failure) => (Some(failure), true),
        Next::Failed(failure) => (Some(failure), false),
    };
    let row = query(
        "update jobs set
             state = case when cancel_requested then 'cancelled'
                 when ?2 is not null and (not ?3 or attempt >= max_attempts) then 'failed' else 'queued' end,
             error = case when not cancel_requested and (not ?3 or attempt >= max_attempts) then ?2 end,
             finished_at = case
                 when cancel_requested or (?2 is not null and (not ?3 or attempt >= max_attempts)) then ?1 end,
             started_at = case
                 when cancel_requested or (?2 is not null and (not ?3 or attempt >= max_attempts)) then started_at end,
             attempt = attempt + case
                 when cancel_requested or (?2 is not null and (not ?3 or attempt >= max_attempts)) then 0 else 1 end,
             max_attempts = max_attempts + case
                 when cancel_requested or (?2 is not null and not ?3) or ?3 then 0 else 1 end,
             progress = null, lease_expires_at = null, received_at = null, version = version + 1, updated_at = ?1
         where seq = ?4 and attempt = ?5 and state = 'running' returning state",
    )
    .bind(store.now_us())
    .bind(failure.map(to_json).transpose()?)
    .bind(counts)
    .bind(lease.seq)
    .bind(lease.attempt)
    .fetch_optional(tx)
    .await?
    .ok_or(StoreError::LeaseLost)?;
    Ok(row.text("state")? != "queued")
}
