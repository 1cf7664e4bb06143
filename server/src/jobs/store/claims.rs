//! Leasing the next job to a worker: whose turn it is, which of the owner's jobs is next, and the lease itself.

use std::time::Duration;

use super::bodies::body_of_job;
use super::checked::MOST_WRONG_RESULTS;
use super::db::{Row, Source, Transaction, either, query};
use super::leases::Claim;
use super::submit::to_json;
use super::{Store, StoreError, micros, rows};
use crate::failure::{Failure, FailureCode};
use crate::jobs::{JobRecord, Lease};

/// The jobs of an owner in the order of the queue, at the time `?1`, without those that have expired: they are
/// cancelled ([`retention`](super::retention)). The index is named, because the planner of SQLite
/// would choose the index of all states and sort the queue at every claim.
macro_rules! line_of_owner {
    ($columns:literal) => {
        concat!(
            "select ",
            $columns,
            " from jobs indexed by jobs_queue
              where jobs.state = 'queued' and jobs.owner = queue_owners.owner
                  and (jobs.not_before is null or jobs.not_before <= ?1)
                  and (jobs.expires_at is null or jobs.expires_at > ?1)
              order by jobs.priority desc, jobs.turn, jobs.seq"
        )
    };
}

/// The number of the job to run next, at the time `?1`: the first job of the owner whose turn it is (see [`turns`]), of
/// those whose jobs are not held back, of which `?2` is a list in JSON. With `within`, the first of the next 250 jobs
/// of the owner for which a worker with `?3` µs left has the time; an owner of whom there is none is passed over. The
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
            " limit 1) as first where first.least_time_us <= ?3), (select line.seq from (",
            line_of_owner!("jobs.seq, jobs.priority, jobs.turn, jobs.least_time_us"),
            " limit 250) as line where line.least_time_us <= ?3
              order by line.priority desc, line.turn, line.seq limit 1)) as seq"
        )
    };
    (of sqlite, $($first_of_owner:tt)+) => {
        concat!(
            "select head.seq from queue_owners cross join jobs as head
             where queue_owners.queued > 0
                 and queue_owners.owner not in (select value from json_each(?2))
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
                 and queue_owners.owner not in (select value from json_each(?2))
             order by greatest(queue_owners.last_start + 1, (select max(last_start) from queue_owners)), head.seq
             limit 1"
        )
    };
}
#[cfg(test)]
pub(super) const NEXT_IN_QUEUE: &str = next_in_queue!(sqlite);
#[cfg(test)]
pub(super) const NEXT_WITHIN: &str = next_in_queue!(sqlite within);

/// Leases a job to a worker, with the columns that [`Claimed::of`] reads. A job that waits has no artifact. Changes
/// nothing where the claim holds another number of leases than `?9`, or an export: then it is a repeated one. Changes
/// nothing either where the process has sent `?10` wrong results.
macro_rules! lease {
    ($next:expr) => {
        concat!(
            "update jobs set state = 'running', version = version + 1, started_at = ?1, updated_at = ?1,
                 lease_expires_at = ?4, progress = null, error = null, engine = ?5, not_before = null, waits_for = null,
                 worker = ?6, worker_key = ?7, claim = ?8
             where seq = (",
            $next,
            ") and ?9 = (
                 select count(*) from jobs as leased
                 where leased.claim = ?8 and leased.worker_key = ?7 and leased.state = 'running'
                     and leased.received_at is null
             ) and not exists (
                 select 1 from exports where claim = ?8 and worker_key = ?7 and state = 'running'
             ) and ?10 > (
                 select count(*) from wrong_results where wrong_results.worker_key = ?7 and wrong_results.worker = ?6
             ) returning *, cast(null as text) as path,
                 (select studies.id from studies where studies.seq = jobs.study) as study_id,
                 ",
            body_of_job!()
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
}

impl Claimed {
    /// The running jobs that a claim has leased before.
    pub(super) async fn before(claim: &Claim, tx: &mut Transaction<'_>) -> Result<Vec<Self>, StoreError> {
        let found = query(rows::select_jobs!(
            concat!(", ", body_of_job!()),
            "where jobs.claim = ? and jobs.worker_key = ? and jobs.state = 'running' and jobs.received_at is null
             order by jobs.seq"
        ))
        .bind(&claim.id)
        .bind(&claim.key)
        .fetch_all(tx)
        .await?;
        let mut claimed = Vec::with_capacity(found.len());
        for row in &found {
            claimed.push(Self::of(row).await?);
        }
        Ok(claimed)
    }

    /// Of a row as [`rows::select_jobs!`] has it, with the request as `body`.
    async fn of(row: &Row) -> Result<Self, StoreError> {
        let job = rows::job(row)?;
        let study = job.study.map(|place| place.id);
        let lease = Lease { seq: job.seq, id: job.id, attempt: job.attempt, study };
        let request = rows::checked_text(row, "body", "body_digest").await?;
        Ok(Self { lease, job, request })
    }
}

/// Ends a job whose row or request is damaged: it would be leased again and again, before all others.
async fn fail_damaged(tx: &mut Transaction<'_>, job: &Row, fault: &str, now: i64) -> Result<(), StoreError> {
    tracing::error!(
        id = job.text("id").unwrap_or(""),
        fault,
        "a queued job is damaged in the database and fails"
    );
    let detail = format!("the record of the job in the database is damaged ({fault}): submit the job again");
    let failure = Failure::new(FailureCode::InternalError, &detail);
    query(
        "update jobs set state = 'failed', version = version + 1, finished_at = ?1, updated_at = ?1,
             lease_expires_at = null, error = ?2
         where seq = ?3",
    )
    .bind(now)
    .bind(to_json(&failure)?)
    .bind(job.try_get::<i64>("seq")?)
    .execute(tx)
    .await?;
    Ok(())
}

/// Who takes a lease.
#[derive(Clone, Copy, Debug)]
pub(super) enum Lessee<'a> {
    /// A worker of this server.
    Here,
    /// A worker in another process, for a claim that has leased so many jobs until now.
    Process(&'a Claim, usize),
}

impl Store {
    /// Leases the next job: of the owner whose turn it is the one of the highest priority, then the smallest virtual
    /// start time. An owner of whom as many jobs run as may is passed over.
    ///
    /// In a database of this server alone the claim is not synchronized to the disk. A power cut that undoes it leaves
    /// the job queued, and the files of the attempt are removed by the sweeper. The next synchronized write includes
    /// the claim.
    pub(crate) async fn claim(&self) -> Result<Option<Claimed>, StoreError> {
        let store = self.clone();
        self.detached(async move {
            let claimed = store
                .write(store.durability_of_leases(), (), |store, (), tx| {
                    Box::pin(store.claim_next(tx, Lessee::Here))
                })
                .await?;
            if let Some(claimed) = &claimed {
                store.notify_job(&claimed.job);
            }
            Ok(claimed)
        })
        .await
    }

    /// Leases the next job; see [`Self::claim`]. None where nothing waits, or the claim is a repeated one.
    pub(super) async fn claim_next(
        &self,
        tx: &mut Transaction<'_>,
        lessee: Lessee<'_>,
    ) -> Result<Option<Claimed>, StoreError> {
        let (worker, key, claim, leased, remaining) = match lessee {
            Lessee::Here => ("", "", None, 0, None),
            Lessee::Process(claim, leased) => {
                (claim.worker.as_str(), claim.key.as_str(), Some(&claim.id), leased as i64, claim.remaining)
            }
        };
        let held_back = to_json(&self.held_back(&mut *tx).await?)?;
        let engine = to_json(&packstone_engine::export::tables::EngineInfo::current())?;
        let now = self.now_us();
        loop {
            let text = match remaining {
                None => either(lease!(next_in_queue!(sqlite)), lease!(next_in_queue!(postgres))),
                Some(_) => {
                    either(lease!(next_in_queue!(sqlite within)), lease!(next_in_queue!(postgres within)))
                }
            };
            let leasing = query(text)
                .bind(now)
                .bind(&held_back)
                .bind(remaining.map(micros))
                .bind(now.saturating_add(micros(self.limits().lease)))
                .bind(&engine)
                .bind(worker)
                .bind(key)
                .bind(claim)
                .bind(leased)
                .bind(MOST_WRONG_RESULTS);
            let Some(row) = leasing.fetch_optional(&mut *tx).await? else { return Ok(None) };
            match Claimed::of(&row).await {
                Err(StoreError::Row(fault)) => fail_damaged(tx, &row, &fault, now).await?,
                claimed => return claimed.map(Some),
            }
        }
    }

    /// Whether a job waits that a worker with so much time left could lease now. Leases nothing.
    ///
    /// # Errors
    /// The database's.
    pub(super) async fn has_claimable_job(&self, remaining: Option<Duration>) -> Result<bool, StoreError> {
        let held_back = self.held_back(self.readers()).await?;
        let text = match remaining {
            None => either(next_in_queue!(sqlite), next_in_queue!(postgres)),
            Some(_) => either(next_in_queue!(sqlite within), next_in_queue!(postgres within)),
        };
        let mut looking = query(text).bind(self.now_us()).bind(to_json(&held_back)?);
        if let Some(remaining) = remaining {
            looking = looking.bind(micros(remaining));
        }
        Ok(looking.fetch_optional(self.readers()).await?.is_some())
    }

    /// The owners of whom as many jobs run as may.
    async fn held_back<'s>(&self, source: impl Source<'s>) -> Result<Vec<String>, StoreError> {
        if !self.accounts().bounds_running() {
            return Ok(Vec::new());
        }
        let found =
            query("select owner, running from queue_owners where queued > 0").fetch_all(source).await?;
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
