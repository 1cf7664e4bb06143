//! The state transitions of a job.
//!
//! Each is one transaction whose update names the state it leaves; those of a running job also name
//! the attempt, so that a worker that lost its lease changes nothing.

use super::db::{Transaction, either, query};
use super::exports::{files_of_job, insert_beforehand};
use super::leases::Claim;
use super::studies::runs;
use super::submit::to_json;
use super::writer::Writing;
use super::{Store, StoreError, Target, fault_pause, micros, rows, turns};
use crate::exports::NewExport;
use crate::failure::Failure;
use crate::jobs::{ArtifactRecord, JobId, JobProgress, JobRecord, Lease, State};
use crate::studies::{Facts, Outcome};

/// The jobs of an owner in the order of the queue, at the time `?1`. The index is named, because the planner of SQLite
/// would choose the index of all states and sort the queue at every claim.
macro_rules! line_of_owner {
    ($columns:literal) => {
        concat!(
            "select ",
            $columns,
            " from jobs indexed by jobs_queue
              where jobs.state = 'queued' and jobs.owner = queue_owners.owner
                  and (jobs.not_before is null or jobs.not_before <= ?1)
              order by jobs.priority desc, jobs.turn, jobs.seq"
        )
    };
}

/// The number of the job to run next, at the time `?1`: the first job of the owner whose turn it is (see [`turns`]), of
/// those whose jobs are not held back, of which `?4` is a list in JSON. With `within`, the first of the next 250 jobs
/// of the owner for which a worker with `?8` µs left has the time; an owner of whom there is none is passed over. The
/// very first is looked at alone: it fits in most cases, and the others are sorted once more.
macro_rules! next_in_queue {
    ($database:ident) => {
        next_in_queue!(of $database, line_of_owner!("jobs.seq"))
    };
    ($database:ident within) => {
        next_in_queue!(
            of $database,
            "select coalesce((select first.seq from (",
            line_of_owner!("jobs.seq, jobs.least_time_us"),
            " limit 1) as first where first.least_time_us <= ?8), (select line.seq from (",
            line_of_owner!("jobs.seq, jobs.priority, jobs.turn, jobs.least_time_us"),
            " limit 250) as line where line.least_time_us <= ?8
              order by line.priority desc, line.turn, line.seq limit 1)) as seq"
        )
    };
    (of sqlite, $($first_of_owner:tt)+) => {
        concat!(
            "select head.seq from queue_owners cross join jobs as head
             where queue_owners.queued > 0
                 and queue_owners.owner not in (select value from json_each(?4))
                 and head.seq = (",
            $($first_of_owner)+,
            " limit 1)
             order by max(queue_owners.last_start + 1, (select max(last_start) from queue_owners)), head.seq limit 1"
        )
    };
    (of postgres, $($first_of_owner:tt)+) => {
        concat!(
            "select head.seq from queue_owners cross join lateral (",
            $($first_of_owner)+,
            " limit 1) as head
             where queue_owners.queued > 0 and head.seq is not null
                 and queue_owners.owner not in (select value from json_each(?4))
             order by greatest(queue_owners.last_start + 1, (select max(last_start) from queue_owners)), head.seq
             limit 1"
        )
    };
}
#[cfg(test)]
pub(super) const NEXT_IN_QUEUE: &str = next_in_queue!(sqlite);
#[cfg(test)]
pub(super) const NEXT_WITHIN: &str = next_in_queue!(sqlite within);

/// Leases a job to a worker.
macro_rules! lease {
    ($next:expr) => {
        concat!(
            "update jobs set state = 'running', version = version + 1, started_at = ?1, updated_at = ?1,
                 lease_expires_at = ?2, progress = null, error = null, engine = ?3, not_before = null,
                 worker = ?5, worker_key = ?6, claim = ?7
             where seq = (",
            $next,
            ") returning seq, owner, priority, turn"
        )
    };
}

/// A job that is leased to the caller.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Claimed {
    pub(crate) lease: Lease,
    pub(crate) job: JobRecord,
    /// The request as stored.
    pub(crate) request: String,
    /// Faults of the machine that earlier runs have met.
    pub(crate) faults: i64,
}

impl Claimed {
    /// A running job with its request, as the one who leases it gets it.
    pub(super) async fn read(tx: &mut Transaction<'_>, seq: i64) -> Result<Self, StoreError> {
        let row = query(
            "select faults, (select body from job_requests where job = seq) as body from jobs where seq = ?",
        )
        .bind(seq)
        .fetch_one(&mut *tx)
        .await?;
        let job = rows::by_seq(tx, seq).await?;
        let study = job.study.map(|place| place.id);
        let lease = Lease { seq: job.seq, id: job.id, attempt: job.attempt, study };
        Ok(Self { lease, job, request: row.try_get("body")?, faults: row.try_get("faults")? })
    }
}

/// Who takes a lease.
#[derive(Clone, Copy, Debug)]
pub(super) enum Lessee<'a> {
    /// A worker of this server.
    Here,
    /// A worker in another process.
    Process(&'a Claim),
}

/// The answer to the report of a worker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Heartbeat {
    /// A client has cancelled the job.
    pub(crate) cancel_requested: bool,
}

/// The effect of a cancellation.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Cancelled {
    /// The job was queued and is cancelled now.
    Now(JobRecord),
    /// The job is running; its worker will see the cancellation.
    Soon(JobRecord),
}

impl Store {
    /// Leases the next job: of the owner whose turn it is the one of the highest priority, then the smallest virtual
    /// start time. An owner of whom as many jobs run as may is passed over.
    ///
    /// The claim is not synchronized to the disk. A power cut that undoes it leaves the job queued, and the files of
    /// the attempt are removed by the sweeper. The next synchronized write includes the claim.
    pub(crate) async fn claim(&self) -> Result<Option<Claimed>, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let mut writer = store.quick_writer().await?;
            let claimed = store.claim_next(&mut writer, Lessee::Here).await?;
            drop(writer);
            if let Some(claimed) = &claimed {
                store.notify_job(&claimed.job);
            }
            Ok(claimed)
        })
        .await
    }

    /// Renews a lease, and records the progress where there is any.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn heartbeat(
        &self,
        lease: Lease,
        progress: Option<JobProgress>,
    ) -> Result<Heartbeat, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let news = progress.as_ref().map(to_json).transpose()?;
            let mut writer = store.writer().await?;
            let now = store.now_us();
            let row = query(
                "update jobs set lease_expires_at = ?1, progress = coalesce(?2, progress),
                     version = version + case when ?2 is null then 0 else 1 end,
                     updated_at = case when ?2 is null then updated_at else ?3 end
                 where seq = ?4 and attempt = ?5 and state = 'running' returning cancel_requested",
            )
            .bind(now.saturating_add(micros(store.limits().lease)))
            .bind(&news)
            .bind(now)
            .bind(lease.seq)
            .bind(lease.attempt)
            .fetch_optional(&mut writer)
            .await?;
            drop(writer);
            let cancel_requested = row.ok_or(StoreError::LeaseLost)?.try_get("cancel_requested")?;
            if news.is_some() {
                store.notify(lease.id);
            }
            Ok(Heartbeat { cancel_requested })
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
            let mut writer = store.writer().await?;
            let mut tx = writer.begin().await?;
            let now = store.now_us();
            let moved = query(
                "update jobs set state = 'succeeded', version = version + 1, finished_at = ?1, updated_at = ?1,
                     lease_expires_at = null, error = null, progress = ?4
                 where seq = ?2 and attempt = ?3 and state = 'running' returning study, point, replicate",
            )
            .bind(now)
            .bind(lease.seq)
            .bind(lease.attempt)
            .bind(to_json(&progress)?)
            .fetch_optional(&mut tx)
            .await?
            .ok_or(StoreError::LeaseLost)?;
            query(
                "insert into artifacts (job, attempt, path, bytes, sha256, report, format_revision, format_lengths,
                     owner)
                 values (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, (select owner from jobs where seq = ?1))",
            )
            .bind(lease.seq)
            .bind(lease.attempt)
            .bind(&artifact.path)
            .bind(artifact.bytes.cast_signed())
            .bind(&artifact.sha256)
            .bind(to_json(&artifact.report)?)
            .bind(artifact.format_revision)
            .bind(to_json(&artifact.format_lengths)?)
            .execute(&mut tx)
            .await?;
            insert_beforehand(&mut tx, lease.seq, &postprocess, now).await?;
            let called_off = runs::record(&mut tx, &moved, Outcome::Succeeded, &facts, now).await?;
            tx.commit().await?;
            drop(writer);
            store.notify_lease(lease);
            store.notify_all(&called_off);
            store.wake_worker_for_held_back();
            if !postprocess.is_empty() {
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
    /// process it gets a number of its own all the same, so that a repeated request about it finds no other attempt.
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
    pub(crate) async fn requeue_after_fault(&self, lease: Lease) -> Result<String, StoreError> {
        let store = self.clone();
        let (pause, owner) = self.detached(async move {
            let mut writer = store.writer().await?;
            let mut tx = writer.begin().await?;
            let now = store.now_us();
            let row = query(
                "update jobs set faults = faults + 1 where seq = ? and attempt = ? and state = 'running'
                 returning faults, owner",
            )
            .bind(lease.seq)
            .bind(lease.attempt)
            .fetch_optional(&mut tx)
            .await?
            .ok_or(StoreError::LeaseLost)?;
            let pause = fault_pause(row.try_get("faults")?);
            query(
                "update jobs set state = 'queued', version = version + 1, updated_at = ?1, lease_expires_at = null,
                     started_at = null, progress = null, not_before = ?2,
                     attempt = attempt + case when worker <> '' then 1 else 0 end,
                     max_attempts = max_attempts + case when worker <> '' then 1 else 0 end
                 where seq = ?3",
            )
            .bind(now)
            .bind(now.saturating_add(micros(pause)))
            .bind(lease.seq)
            .execute(&mut tx)
            .await?;
            tx.commit().await?;
            drop(writer);
            store.notify_lease(lease);
            store.wake_worker_for_held_back();
            Ok((pause, row.try_get("owner")?))
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
                "update jobs set not_before = null where state = 'queued' and owner = ? and not_before > ?",
            )
            .bind(owner)
            .bind(store.now_us())
            .execute(&mut writer)
            .await?
            .rows_affected();
            drop(writer);
            if ended > 0 {
                store.wake_worker();
            }
            Ok(ended)
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
            let mut writer = store.writer().await?;
            let mut tx = writer.begin().await?;
            let now = store.now_us();
            let moved = query(
                "update jobs set state = ?1, version = version + 1, updated_at = ?2, lease_expires_at = null,
                     error = ?3,
                     finished_at = case when ?1 = 'queued' then null else ?2 end,
                     started_at = case when ?1 = 'queued' then null else started_at end,
                     progress = case when ?1 = 'queued' then null else progress end,
                     attempt = attempt + case when ?1 = 'queued' and worker <> '' then 1 else 0 end,
                     max_attempts = max_attempts + case when ?1 = 'queued' and worker <> '' then 1 else 0 end
                 where seq = ?4 and attempt = ?5 and state = 'running' returning study, point, replicate",
            )
            .bind(to.name())
            .bind(now)
            .bind(error)
            .bind(lease.seq)
            .bind(lease.attempt)
            .fetch_optional(&mut tx)
            .await?
            .ok_or(StoreError::LeaseLost)?;
            let called_off = match run {
                Some((outcome, facts)) => runs::record(&mut tx, &moved, outcome, &facts, now).await?,
                None => Vec::new(),
            };
            tx.commit().await?;
            drop(writer);
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
                    "update jobs set cancel_requested = true, version = version + case when cancel_requested then 0 else 1 end,
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
                Ok(if job.state.is_finished() { Cancelled::Now(job) } else { Cancelled::Soon(job) })
            }
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
            store.check_queue(&mut tx, &before.owner, 1).await?;
            let number = runs::flow_of(&mut tx, before.seq).await?;
            let flow = turns::Flow { owner: &before.owner, number, priority: before.priority };
            let turn = turns::assign_start_times(&mut tx, flow, 1).await?;
            query(
                "update jobs set state = 'queued', version = version + 1, updated_at = ?2,
                     max_attempts = attempt + attempt_budget, attempt = attempt + 1, cancel_requested = false,
                     started_at = null, finished_at = null, progress = null, error = null, turn = ?3,
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

    /// Leases the next job; see [`Self::claim`].
    pub(super) async fn claim_next(
        &self,
        writer: &mut Writing<'_>,
        lessee: Lessee<'_>,
    ) -> Result<Option<Claimed>, StoreError> {
        let (worker, key, claim) = match lessee {
            Lessee::Here => ("", "", None),
            Lessee::Process(claim) => (claim.worker.as_str(), claim.key.as_str(), Some(&claim.id)),
        };
        let mut tx = writer.begin().await?;
        let held_back = self.held_back(&mut tx).await?;
        let now = self.now_us();
        let remaining = match lessee {
            Lessee::Here => None,
            Lessee::Process(claim) => claim.remaining,
        };
        let text = match remaining {
            None => either(lease!(next_in_queue!(sqlite)), lease!(next_in_queue!(postgres))),
            Some(_) => either(lease!(next_in_queue!(sqlite within)), lease!(next_in_queue!(postgres within))),
        };
        let mut leasing = query(text)
            .bind(now)
            .bind(now.saturating_add(micros(self.limits().lease)))
            .bind(to_json(&packstone_engine::export::tables::EngineInfo::current())?)
            .bind(to_json(&held_back)?)
            .bind(worker)
            .bind(key)
            .bind(claim);
        if let Some(remaining) = remaining {
            leasing = leasing.bind(micros(remaining));
        }
        let row = leasing.fetch_optional(&mut tx).await?;
        let Some(row) = row else {
            tx.rollback().await?;
            return Ok(None);
        };
        let (owner, priority): (String, i64) = (row.try_get("owner")?, row.try_get("priority")?);
        turns::advance_virtual_time(&mut tx, &owner, priority, row.try_get("turn")?).await?;
        let claimed = Claimed::read(&mut tx, row.try_get("seq")?).await?;
        tx.commit().await?;
        Ok(Some(claimed))
    }

    /// The owners of whom as many jobs run as may.
    async fn held_back(&self, tx: &mut Transaction<'_>) -> Result<Vec<String>, StoreError> {
        if !self.accounts().bounds_running() {
            return Ok(Vec::new());
        }
        let found = query("select owner, running from queue_owners where queued > 0").fetch_all(tx).await?;
        let mut held_back = Vec::new();
        for row in found {
            let (owner, running): (String, i64) = (row.try_get("owner")?, row.try_get("running")?);
            if self.accounts().quotas(&owner).running.is_some_and(|most| running as u64 >= most) {
                held_back.push(owner);
            }
        }
        Ok(held_back)
    }
}
