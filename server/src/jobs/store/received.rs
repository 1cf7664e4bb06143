//! Ends of attempts that worker processes have sent, until they are checked.
//!
//! Such a job is `running`, and `received_at` is set. Its attempt is over for the worker. Only the end of the check
//! ([`checked`](super::checked)) or a cancellation moves it on; each write here names the attempt. The row of a
//! received result in `artifacts` counts as stored, and is shown to no client before the job has succeeded. A received
//! failure lies in `error`.
//!
//! The lease of the job is that of the server that checks it: a server that ends in the meantime loses it, and the next
//! one checks the same result.

use std::time::Duration;

use super::bodies::{self, body_of_job};
use super::db::{Durability, Row, Transaction, query};
use super::submit::to_json;
use super::{Store, StoreError, micros, rows};
use crate::failure::Failure;
use crate::jobs::{ArtifactRecord, JobProgress, Lease};

/// The end of an attempt that is to be checked.
#[derive(Clone, Debug)]
pub(crate) struct Received {
    pub(crate) lease: Lease,
    /// Name of the worker process.
    pub(crate) worker: String,
    /// Name of its API key.
    pub(crate) key: String,
    /// The request as stored.
    pub(crate) request: String,
    pub(crate) started_at: Option<i64>,
    /// When it was received, in microseconds since the Unix epoch.
    pub(crate) at: i64,
    pub(crate) end: ReceivedEnd,
}

/// What a worker process has sent.
#[derive(Clone, Debug)]
pub(crate) enum ReceivedEnd {
    /// A result, which is stored.
    Result(ArtifactRecord),
    /// Why there is none.
    Failure(Failure),
}

impl Store {
    /// Ends an attempt with a result of a worker process, which is on disk already and is to be checked.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn receive_result(
        &self,
        lease: Lease,
        artifact: ArtifactRecord,
        progress: JobProgress,
    ) -> Result<(), StoreError> {
        let store = self.clone();
        self.detached(async move {
            let input = (lease, artifact, progress);
            store
                .write(Durability::PowerCut, input, |store, (lease, artifact, progress), tx| {
                    Box::pin(async move {
                        match begin_check(store, *lease, progress, None, tx).await {
                            Err(StoreError::LeaseLost) => recorded_before(*lease, artifact, tx).await,
                            Err(error) => Err(error),
                            Ok(()) => insert(*lease, artifact, tx).await,
                        }
                    })
                })
                .await?;
            store.notify_lease(lease);
            store.wake_checks();
            Ok(())
        })
        .await
    }

    /// Ends an attempt with a failure that a worker process reports and that is to be checked.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn receive_failure(
        &self,
        lease: Lease,
        failure: Failure,
        progress: JobProgress,
    ) -> Result<(), StoreError> {
        let store = self.clone();
        self.detached(async move {
            let failure = to_json(&failure)?;
            store
                .write(
                    Durability::PowerCut,
                    (lease, failure, progress),
                    |store, (lease, failure, progress), tx| {
                        Box::pin(begin_check(store, *lease, progress, Some(failure), tx))
                    },
                )
                .await?;
            store.notify_lease(lease);
            store.wake_checks();
            Ok(())
        })
        .await
    }

    /// Ends the checks of jobs that a client has cancelled. Where one `may_begin`, leases the next end that waits for
    /// its check.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn next_check(&self, may_begin: bool) -> Result<Option<Received>, StoreError> {
        // A look that costs no write, in most cases.
        let waiting = query(
            "select 1 from jobs where received_at is not null
                 and (cancel_requested or (?1 and coalesce(lease_expires_at, 0) <= ?2))",
        )
        .bind(may_begin)
        .bind(self.now_us())
        .fetch_optional(self.readers())
        .await?;
        if waiting.is_none() {
            return Ok(None);
        }
        let store = self.clone();
        self.detached(async move {
            let mut writer = store.writer().await?;
            let mut tx = writer.begin().await?;
            let now = store.now_us();
            let cancelled = query(
                "update jobs set state = 'cancelled', version = version + 1, updated_at = ?1, finished_at = ?1,
                     lease_expires_at = null, received_at = null, error = null
                 where received_at is not null and cancel_requested
                 returning seq, id, attempt,
                     (select studies.id from studies where studies.seq = jobs.study) as study_id",
            )
            .bind(now)
            .fetch_all(&mut tx)
            .await?;
            let cancelled = cancelled.iter().map(lease).collect::<Result<Vec<_>, _>>()?;
            for lease in &cancelled {
                delete_artifact(*lease, &mut tx).await?;
            }
            let next = query(concat!(
                "update jobs set lease_expires_at = ?2 where seq = (
                     select next.seq from jobs as next
                     where ?3 and next.received_at is not null and coalesce(next.lease_expires_at, 0) <= ?1
                     order by next.received_at, next.seq limit 1
                 ) returning seq, id, attempt, worker, worker_key, started_at, received_at, error,
                     (select studies.id from studies where studies.seq = jobs.study) as study_id,
                     ",
                body_of_job!()
            ))
            .bind(now)
            .bind(now.saturating_add(micros(store.limits().lease)))
            .bind(may_begin)
            .fetch_optional(&mut tx)
            .await?;
            let next = match next {
                Some(row) => Some(Received::read(&row, &mut tx).await?),
                None => None,
            };
            tx.commit().await?;
            drop(writer);
            for lease in cancelled {
                store.notify_lease(lease);
                store.wake_worker_for_held_back();
            }
            Ok(next)
        })
        .await
    }

    /// Renews the lease of a check; whether a client has cancelled the job.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn renew_check(&self, lease: Lease) -> Result<bool, StoreError> {
        self.set_check_lease(lease, Some(self.lease())).await
    }

    /// Lets any server check the end of an attempt, after a pause.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn leave_check(&self, lease: Lease, pause: Option<Duration>) -> Result<(), StoreError> {
        self.set_check_lease(lease, pause).await.map(drop)
    }

    async fn set_check_lease(&self, lease: Lease, lasts: Option<Duration>) -> Result<bool, StoreError> {
        let until = lasts.map(|lasts| self.now_us().saturating_add(micros(lasts)));
        self.write(Durability::ProcessEnd, (lease, until), |_, (lease, until), tx| {
            Box::pin(async move {
                let row = query(
                    "update jobs set lease_expires_at = ?1
                     where seq = ?2 and attempt = ?3 and received_at is not null returning cancel_requested",
                )
                .bind(*until)
                .bind(lease.seq)
                .bind(lease.attempt)
                .fetch_optional(tx)
                .await?;
                Ok(row.ok_or(StoreError::LeaseLost)?.try_get("cancel_requested")?)
            })
        })
        .await
    }

    /// Lets the checks begin again that ran when this server ended, where no other one may run them.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn recover_checks(&self) -> Result<u64, StoreError> {
        if self.is_shared() {
            return Ok(0);
        }
        let store = self.clone();
        self.detached(async move {
            let mut writer = store.quick_writer().await?;
            let recovered = query("update jobs set lease_expires_at = null where received_at is not null");
            Ok(recovered.execute(&mut writer).await?.rows_affected())
        })
        .await
    }

    /// Ends of attempts that wait for their check or are being checked.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn unchecked(&self) -> Result<u64, StoreError> {
        let count: i64 =
            query("select count(*) from jobs where received_at is not null").scalar(self.readers()).await?;
        Ok(count.cast_unsigned())
    }
}

impl Received {
    async fn read(row: &Row, tx: &mut Transaction<'_>) -> Result<Self, StoreError> {
        let lease = lease(row)?;
        let end = if let Some(failure) = row.try_get::<Option<String>>("error")? {
            ReceivedEnd::Failure(rows::json(&failure)?)
        } else {
            let row = query(
                "select path, bytes, sha256, report, report_digest, format_revision, format_lengths,
                     is_whole as artifact_is_whole from artifacts where job = ?",
            )
            .bind(lease.seq)
            .fetch_one(tx)
            .await?;
            ReceivedEnd::Result(rows::artifact(&row)?)
        };
        Ok(Self {
            lease,
            worker: row.try_get("worker")?,
            key: row.try_get("worker_key")?,
            request: rows::checked_text(row, "body", "body_digest").await?,
            started_at: row.try_get("started_at")?,
            at: row.try_get("received_at")?,
            end,
        })
    }
}

/// Ends an attempt for its worker.
async fn begin_check(
    store: &Store,
    lease: Lease,
    progress: &JobProgress,
    failure: Option<&String>,
    tx: &mut Transaction<'_>,
) -> Result<(), StoreError> {
    let moved = query(
        "update jobs set received_at = ?1, lease_expires_at = null, progress = ?2, error = ?3,
             version = version + 1, updated_at = ?1
         where seq = ?4 and attempt = ?5 and state = 'running' and received_at is null returning seq",
    )
    .bind(store.now_us())
    .bind(to_json(progress)?)
    .bind(failure.cloned())
    .bind(lease.seq)
    .bind(lease.attempt)
    .fetch_optional(tx)
    .await?;
    moved.map(drop).ok_or(StoreError::LeaseLost)
}

async fn insert(lease: Lease, artifact: &ArtifactRecord, tx: &mut Transaction<'_>) -> Result<(), StoreError> {
    let report = to_json(&artifact.report)?;
    query(
        "insert into artifacts (job, attempt, path, bytes, sha256, report, report_digest, format_revision,
             format_lengths, owner)
         select seq, attempt, ?2, ?3, ?4, ?5, ?8, ?6, ?7, owner from jobs where seq = ?1",
    )
    .bind(lease.seq)
    .bind(&artifact.path)
    .bind(artifact.bytes.cast_signed())
    .bind(&artifact.sha256)
    .bind(&report)
    .bind(artifact.format_revision)
    .bind(to_json(&artifact.format_lengths)?)
    .bind(bodies::digest(&report))
    .execute(tx)
    .await?;
    Ok(())
}

/// Whether the same result is recorded already, as when the connection to the database went between a commit and its
/// answer. A caller that heard of a lost lease would remove the file that is recorded.
pub(super) async fn recorded_before(
    lease: Lease,
    artifact: &ArtifactRecord,
    tx: &mut Transaction<'_>,
) -> Result<(), StoreError> {
    query("select 1 from artifacts where job = ?1 and attempt = ?2 and path = ?3 and sha256 = ?4")
        .bind(lease.seq)
        .bind(lease.attempt)
        .bind(&artifact.path)
        .bind(&artifact.sha256)
        .fetch_optional(tx)
        .await?
        .map(drop)
        .ok_or(StoreError::LeaseLost)
}

/// Removes the row of a received result. A trigger records its file for the sweeper.
pub(super) async fn delete_artifact(lease: Lease, tx: &mut Transaction<'_>) -> Result<(), StoreError> {
    query("delete from artifacts where job = ? and attempt = ?")
        .bind(lease.seq)
        .bind(lease.attempt)
        .execute(tx)
        .await?;
    Ok(())
}

fn lease(row: &Row) -> Result<Lease, StoreError> {
    let study = row.try_get::<Option<String>>("study_id")?;
    let study = study.as_deref().map(rows::study_id).transpose()?;
    let id = rows::job_id(row.text("id")?)?;
    Ok(Lease { seq: row.try_get("seq")?, id, attempt: row.try_get("attempt")?, study })
}
