//! The state transitions of a job.
//!
//! Each is one transaction whose update names the state it leaves; those of a running job also name
//! the attempt, so that a worker that lost its lease changes nothing.

use super::db::{Durability, query};
use super::exports::{end_of_retried, files_of_job};
use super::leased::LeasedTask;
use super::running::{Left, Success};
use super::studies::runs;
use super::submit::to_json;
use super::{Store, StoreError, Target, rows, turns};
use crate::exports::NewExport;
use crate::failure::Failure;
use crate::jobs::{ArtifactRecord, JobId, JobProgress, JobRecord, Lease, State, StopRequests, WaitReason};
use crate::studies::{Facts, Outcome};

/// The effect of a cancellation.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Cancelled {
    /// The job was queued and is cancelled now.
    Now(JobRecord),
    /// The job is running; its worker will see the cancellation.
    Soon(JobRecord),
}

impl Store {
    /// Renews a lease, and records the progress where there is any; what clients want of the job.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn heartbeat(
        &self,
        lease: Lease,
        progress: Option<JobProgress>,
    ) -> Result<StopRequests, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let requests = store.renew_lease(lease.into(), progress.as_ref()).await?;
            if progress.is_some() {
                store.notify(lease.id);
            }
            Ok(requests)
        })
        .await
    }

    /// Ends a job with its result, which is on disk already, and queues the exports that its request lists. The facts
    /// of the run are recorded in its study.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn succeed(
        &self,
        lease: Lease,
        artifact: ArtifactRecord,
        progress: JobProgress,
        facts: Facts,
        postprocess: Vec<NewExport>,
    ) -> Result<(), StoreError> {
        let store = self.clone();
        self.detached(async move {
            let has_exports = !postprocess.is_empty();
            let success = Success { lease, artifact, progress, facts, postprocess };
            let called_off = store
                .write(Durability::PowerCut, success, |store, success, tx| {
                    Box::pin(success.record(store, tx))
                })
                .await?;
            store.notify_lease(lease);
            store.notify_all(&called_off);
            store.wake_worker_for_held_back();
            if has_exports {
                store.wake_export_workers();
            }
            Ok(())
        })
        .await
    }

    /// Ends a job without a result. The facts of the run are recorded in its study.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn fail(&self, lease: Lease, failure: &Failure, facts: Facts) -> Result<(), StoreError> {
        let document = to_json(failure)?;
        let run = (runs::outcome_of(failure.code), facts);
        self.leave_running(lease, State::Failed, Some(document), Some(run)).await?;
        Ok(())
    }

    /// Ends a job that its client has cancelled.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn finish_cancelled(&self, lease: Lease) -> Result<(), StoreError> {
        self.leave_running(lease, State::Cancelled, None, None).await?;
        Ok(())
    }

    /// Requeues a job whose run was interrupted by the stop of its worker; the attempt does not count. In another
    /// process, and where other servers may take the job, it gets a number of its own all the same: a request about it
    /// that comes late finds no other attempt, and no two runs write the same file.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn give_back(&self, lease: Lease) -> Result<(), StoreError> {
        self.leave_running(lease, State::Queued, None, None).await?;
        Ok(())
    }

    /// Requeues a job that met a fault of the machine. The attempt does not count, as in [`Self::give_back`]; the next
    /// one starts after a pause that doubles with each fault, or when [`Self::end_pauses`] ends it. Returns the owner.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn requeue_after_fault(
        &self,
        lease: Lease,
        why: WaitReason,
    ) -> Result<String, StoreError> {
        let store = self.clone();
        let (pause, owner) = self
            .detached(async move {
                let requeued = LeasedTask::from(lease).requeue_after_fault(&store, Some(&why)).await?;
                store.notify_lease(lease);
                store.wake_worker_for_held_back();
                Ok(requeued)
            })
            .await?;
        tracing::warn!(pause_s = pause.as_secs(), "a fault of the machine: the job is requeued");
        self.wake_worker_after(pause);
        Ok(owner)
    }

    /// Ends the pauses of the jobs of an owner that met faults of the machine; how many they were.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn end_pauses(&self, owner: String) -> Result<u64, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let mut writer = store.quick_writer().await?;
            let ended = query(
                "update jobs set not_before = null, version = version + 1, updated_at = ?2
                 where state = 'queued' and owner = ?1 and not_before > ?2 returning id",
            )
            .bind(owner)
            .bind(store.now_us())
            .fetch_all(&mut writer)
            .await?;
            drop(writer);
            for row in &ended {
                // The reason to wait has gone from what clients see.
                store.notify(rows::job_id(row.text("id")?)?);
            }
            if !ended.is_empty() {
                store.wake_worker();
            }
            Ok(ended.len() as u64)
        })
        .await
    }

    async fn leave_running(
        &self,
        lease: Lease,
        to: State,
        error: Option<String>,
        run: Option<(Outcome, Facts)>,
    ) -> Result<(), StoreError> {
        let store = self.clone();
        self.detached(async move {
            let left = Left { lease, to, error, run };
            let called_off = store
                .write(Durability::PowerCut, left, |store, left, tx| Box::pin(left.record(store, tx)))
                .await?;
            store.notify_lease(lease);
            store.notify_all(&called_off);
            if to == State::Queued {
                store.wake_worker();
            } else {
                store.wake_worker_for_held_back();
            }
            Ok(())
        })
        .await
    }

    /// Cancels a queued job, or requests the worker of a running job to stop.
    ///
    /// # Errors
    /// [`StoreError::NoJob`], [`StoreError::Forbidden`] where it is finished, or the database's.
    pub(crate) async fn cancel(&self, job: impl Into<Target<JobId>>) -> Result<Cancelled, StoreError> {
        let target = job.into();
        self.freeing(move |store| {
            let target = target.clone();
            async move {
                let mut writer = store.writer().await?;
                let mut tx = writer.begin().await?;
                let before = rows::by_id(&mut tx, target.id).await?;
                target.check(before.version)?;
                if before.state.is_finished() {
                    return Err(StoreError::Forbidden(before.state));
                }
                query(
                    "update jobs set cancel_requested = true,
                     version = version + case when cancel_requested then 0 else 1 end,
                     updated_at = case when cancel_requested then updated_at else ?2 end,
                     finished_at = case when state = 'queued' then ?2 else finished_at end,
                     state = case when state = 'queued' then 'cancelled' else state end
                 where seq = ?1",
                )
                .bind(before.seq)
                .bind(store.now_us())
                .execute(&mut tx)
                .await?;
                let job = rows::by_seq(&mut tx, before.seq).await?;
                tx.commit().await?;
                drop(writer);
                store.notify_job(&job);
                // A worker whose time is limited looks at the first jobs of the queue only.
                store.wake_worker();
                store.wake_checks();
                Ok(if job.state.is_finished() { Cancelled::Now(job) } else { Cancelled::Soon(job) })
            }
        })
        .await
    }

    /// Asks the worker of a running job to end the run with the packing that it has reached. Once asked, the same
    /// request changes nothing more, also after the end.
    ///
    /// # Errors
    /// [`StoreError::NoJob`], [`StoreError::NothingReached`] where there is no packing to end with, or the database's.
    pub(crate) async fn finish(&self, job: impl Into<Target<JobId>>) -> Result<JobRecord, StoreError> {
        let (store, target) = (self.clone(), job.into());
        self.detached(async move {
            let mut writer = store.writer().await?;
            let mut tx = writer.begin().await?;
            let before = rows::by_id(&mut tx, target.id).await?;
            target.check(before.version)?;
            if before.finish_requested && before.has_or_may_have_result() {
                return Ok(before);
            }
            if let Some(why) = before.reached_nothing() {
                return Err(StoreError::NothingReached(before.state, why));
            }
            query(
                "update jobs set finish_requested = true, version = version + 1, updated_at = ?2 where seq = ?1",
            )
            .bind(before.seq)
            .bind(store.now_us())
            .execute(&mut tx)
            .await?;
            let job = rows::by_seq(&mut tx, before.seq).await?;
            tx.commit().await?;
            drop(writer);
            store.notify_job(&job);
            Ok(job)
        })
        .await
    }

    /// Requeues a failed or cancelled job, with all its attempts; a succeeded one where its result at the path
    /// `damaged` is no longer what was stored.
    ///
    /// # Errors
    /// [`StoreError::NoJob`], [`StoreError::Forbidden`], [`StoreError::QueueFull`], or the database's.
    pub(crate) async fn retry(
        &self,
        job: impl Into<Target<JobId>>,
        damaged: Option<String>,
    ) -> Result<JobRecord, StoreError> {
        let (store, target) = (self.clone(), job.into());
        self.detached(async move {
            let mut writer = store.writer().await?;
            let mut tx = writer.begin().await?;
            let before = rows::by_id(&mut tx, target.id).await?;
            target.check(before.version)?;
            let is_damaged =
                damaged.is_some() && damaged == before.artifact.as_ref().map(|found| found.path.clone());
            let may_retry = before.state.may_retry() || (before.state == State::Succeeded && is_damaged);
            if !may_retry {
                return Err(StoreError::Forbidden(before.state));
            }
            query("delete from artifacts where job = ?").bind(before.seq).execute(&mut tx).await?;
            let exports = end_of_retried(&mut tx, before.seq, store.now_us()).await?;
            store.check_queue(&mut tx, &before.owner, 1).await?;
            let number = runs::flow_of(&mut tx, before.seq).await?;
            let flow = turns::Flow { owner: &before.owner, number, priority: before.priority };
            let turn = turns::assign_start_times(&mut tx, flow, 1).await?;
            query(
                "update jobs set state = 'queued', version = version + 1, updated_at = ?2,
                     max_attempts = attempt + attempt_budget, attempt = attempt + 1, cancel_requested = false,
                     finish_requested = false, started_at = null, finished_at = null, progress = null, error = null, turn = ?3,
                     faults = 0, not_before = null
                 where seq = ?1",
            )
            .bind(before.seq)
            .bind(store.now_us())
            .bind(turn)
            .execute(&mut tx)
            .await?;
            let job = rows::by_seq(&mut tx, before.seq).await?;
            tx.commit().await?;
            drop(writer);
            store.notify_job(&job);
            for id in exports {
                store.notify_export(id);
            }
            store.wake_worker();
            Ok(job)
        })
        .await
    }

    /// Removes a finished job with its exports, and returns the paths of the files, which no row refers to any more.
    ///
    /// # Errors
    /// [`StoreError::NoJob`], [`StoreError::Forbidden`] where it is not finished, or the database's.
    pub(crate) async fn delete(&self, job: impl Into<Target<JobId>>) -> Result<Vec<String>, StoreError> {
        let target = job.into();
        self.freeing(move |store| {
            let target = target.clone();
            async move {
                let mut writer = store.writer().await?;
                let mut tx = writer.begin().await?;
                let job = rows::by_id(&mut tx, target.id).await?;
                target.check(job.version)?;
                if !job.state.is_finished() {
                    return Err(StoreError::Forbidden(job.state));
                }
                let (mut files, export) = files_of_job(&mut tx, job.seq).await?;
                query("delete from jobs where seq = ?").bind(job.seq).execute(&mut tx).await?;
                tx.commit().await?;
                drop(writer);
                store.notify(job.id);
                for id in export {
                    store.notify_export(id);
                }
                files.extend(job.artifact.map(|artifact| artifact.path));
                Ok(files)
            }
        })
        .await
    }
}
