//! What jobs and exports have in common as leased tasks: the renewal of the lease, the ends that leave no file, and
//! what becomes of leases that ran out.
//!
//! Each write names the attempt, and changes nothing where another one holds the task. A task that goes back to its
//! queue gets a number of its own for the next attempt wherever another process may take it, though the attempt does
//! not count: a request that comes late finds no other attempt, and no two runs write the same file.

use std::time::Duration;

use super::db::{Durability, Row, Transaction, query};
use super::submit::to_json;
use super::upkeep::Kept;
use super::{Store, StoreError, fault_pause, micros, rows};
use crate::exports::ExportLease;
use crate::failure::Failure;
use crate::jobs::{JobProgress, Lease, StopRequests, WaitReason};

/// How far the time of a file may lie behind that of a row written before it, in µs: file systems take it from a clock
/// of the kernel that ticks every 1 to 10 ms.
const FILE_CLOCK_TICK_US: i64 = 20_000;
/// Most starts of a task, however far its checkpoints come.
const MOST_ATTEMPTS: i64 = 1000;

/// A leased job or export.
#[derive(Clone, Copy, Debug)]
pub(super) struct LeasedTask {
    kind: Kind,
    seq: i64,
    attempt: i64,
}

/// Which of the two tables a task is a row of.
#[derive(Clone, Copy, Debug)]
pub(super) enum Kind {
    Job,
    Export,
}

impl Kind {
    /// What the names of the files of attempts end with.
    fn ending(self) -> &'static str {
        match self {
            Self::Job => "packstone",
            Self::Export => "export",
        }
    }
}

impl From<Lease> for LeasedTask {
    fn from(lease: Lease) -> Self {
        Self { kind: Kind::Job, seq: lease.seq, attempt: lease.attempt }
    }
}

impl From<ExportLease> for LeasedTask {
    fn from(of: ExportLease) -> Self {
        Self { kind: Kind::Export, seq: of.seq, attempt: of.attempt }
    }
}

/// The statement `$text!` of a table: its name, which of its tasks run (not those whose end a worker process has sent
/// already: see [`received`](super::received)), whether another process has the task, whether a client has cancelled
/// it, what stays of the progress when it fails, and what is returned.
macro_rules! of_kind {
    ($kind:expr, $text:ident) => {
        match $kind {
            Kind::Job => $text!(
                "jobs",
                "state = 'running' and received_at is null",
                "worker <> ''",
                "cancel_requested",
                "progress",
                "id, owner, cancel_requested, finish_requested, study, point, replicate,
                 (select studies.id from studies where studies.seq = jobs.study) as study_id"
            ),
            Kind::Export => {
                $text!(
                    "exports",
                    "state = 'running'",
                    "worker <> ''",
                    "false",
                    "null",
                    "id, owner, false as cancel_requested, false as finish_requested"
                )
            }
        }
    };
}

macro_rules! renew {
    ($table:literal, $runs:literal, $elsewhere:literal, $cancelled:literal, $progress:literal, $columns:literal) => {
        concat!(
            "update ",
            $table,
            " set lease_expires_at = ?1, progress = coalesce(?2, progress),
                 version = version + case when ?2 is null then 0 else 1 end,
                 updated_at = case when ?2 is null then updated_at else ?3 end
             where seq = ?4 and attempt = ?5 and ",
            $runs,
            " returning ",
            $columns
        )
    };
}

macro_rules! leave {
    ($table:literal, $runs:literal, $elsewhere:literal, $cancelled:literal, $progress:literal, $columns:literal) => {
        concat!(
            "update ",
            $table,
            " set state = ?1, version = version + 1, updated_at = ?2, lease_expires_at = null, error = ?3,
                 finished_at = case when ?1 = 'queued' then null else ?2 end,
                 started_at = case when ?1 = 'queued' then null else started_at end,
                 progress = case when ?1 = 'queued' then null else ",
            $progress,
            " end,
                 attempt = attempt + case when ?1 = 'queued' and (",
            $elsewhere,
            " or ?6) then 1 else 0 end,
                 max_attempts = max_attempts + case when ?1 = 'queued' and (",
            $elsewhere,
            " or ?6) then 1 else 0 end
             where seq = ?4 and attempt = ?5 and ",
            $runs,
            " returning ",
            $columns
        )
    };
}

macro_rules! count_fault {
    ($table:literal, $runs:literal, $elsewhere:literal, $cancelled:literal, $progress:literal, $columns:literal) => {
        concat!(
            "update ",
            $table,
            " set faults = faults + 1 where seq = ?1 and attempt = ?2 and ",
            $runs,
            " returning faults"
        )
    };
}

macro_rules! pause {
    ($table:literal, $runs:literal, $elsewhere:literal, $cancelled:literal, $progress:literal, $columns:literal) => {
        concat!("update ", $table, " set not_before = ?1 where seq = ?2")
    };
}

/// Has the file of the attempt of each of these tasks removed, which nobody may know.
macro_rules! remove_file {
    ($table:literal, $($which:expr),+) => {
        concat!(
            "insert into removals (path)
             select substr(id, length(id) - 1) || '/' || id || '.' || attempt || '.' || ?3 from ",
            $table,
            " where ",
            $($which,)+
            " on conflict do nothing"
        )
    };
}

/// The attempt may have ended before it was recorded.
macro_rules! note_file {
    ($table:literal, $runs:literal, $elsewhere:literal, $cancelled:literal, $progress:literal, $columns:literal) => {
        remove_file!(
            $table,
            $runs,
            " and coalesce(lease_expires_at, 0) <= ?1 and not (?2 and ",
            $elsewhere,
            ")"
        )
    };
}

/// A worker process may have sent a file of the attempt that could not be recorded.
macro_rules! note_sent_file {
    ($table:literal, $runs:literal, $elsewhere:literal, $cancelled:literal, $progress:literal, $columns:literal) => {
        remove_file!($table, "seq = ?1 and attempt = ?2 and ", $runs, " and ", $elsewhere)
    };
}

/// Raises the last attempt of a task whose attempt `?2` runs no longer.
macro_rules! do_not_count {
    ($table:literal, $runs:literal, $elsewhere:literal, $cancelled:literal, $progress:literal, $columns:literal) => {
        concat!(
            "update ",
            $table,
            " set max_attempts = max_attempts + 1 where id = ?1 and attempt = ?2 and ",
            $runs,
            " and lease_expires_at <= ?3 and not (?4 and ",
            $elsewhere,
            ") and started_at <= ?5 and attempt < ?6"
        )
    };
}

macro_rules! take_back {
    ($table:literal, $runs:literal, $elsewhere:literal, $cancelled:literal, $progress:literal, $columns:literal) => {
        concat!(
            "update ",
            $table,
            " set state = case when ",
            $cancelled,
            " then 'cancelled' when attempt >= max_attempts then 'failed' else 'queued' end,
                 error = case when attempt >= max_attempts and not ",
            $cancelled,
            " then ?3 else null end,
                 finished_at = case when attempt >= max_attempts or ",
            $cancelled,
            " then ?1 else null end,
                 started_at = case when attempt >= max_attempts or ",
            $cancelled,
            " then started_at else null end,
                 attempt = case when attempt >= max_attempts or ",
            $cancelled,
            " then attempt else attempt + 1 end,
                 progress = null, lease_expires_at = null, version = version + 1, updated_at = ?1
             where ",
            $runs,
            " and coalesce(lease_expires_at, 0) <= ?2 and not (?4 and ",
            $elsewhere,
            ") returning ",
            $columns
        )
    };
}

impl LeasedTask {
    async fn renew(
        self,
        store: &Store,
        news: Option<&str>,
        tx: &mut Transaction<'_>,
    ) -> Result<StopRequests, StoreError> {
        let now = store.now_us();
        let row = query(of_kind!(self.kind, renew))
            .bind(now.saturating_add(micros(store.lease())))
            .bind(news)
            .bind(now)
            .bind(self.seq)
            .bind(self.attempt)
            .fetch_optional(tx)
            .await?;
        rows::stop_requests(&row.ok_or(StoreError::LeaseLost)?)
    }

    /// Ends the run without a file, in the state `to` and with the failure as JSON, where there is one. Returns the
    /// owner, and of a job also its place in a study. A file that a worker process has sent is removed later.
    pub(super) async fn leave(
        self,
        store: &Store,
        to: &str,
        error: Option<&str>,
        tx: &mut Transaction<'_>,
    ) -> Result<Row, StoreError> {
        query(of_kind!(self.kind, note_sent_file))
            .bind(self.seq)
            .bind(self.attempt)
            .bind(self.kind.ending())
            .execute(&mut *tx)
            .await?;
        query(of_kind!(self.kind, leave))
            .bind(to)
            .bind(store.now_us())
            .bind(error)
            .bind(self.seq)
            .bind(self.attempt)
            .bind(store.is_shared())
            .fetch_optional(tx)
            .await?
            .ok_or(StoreError::LeaseLost)
    }

    /// Requeues the task after a fault of the machine. The next attempt starts after a pause that doubles with each
    /// fault. A job says `why` it waits. Returns the pause and the owner.
    pub(super) async fn requeue_after_fault(
        self,
        store: &Store,
        why: Option<&WaitReason>,
    ) -> Result<(Duration, String), StoreError> {
        let mut writer = store.writer().await?;
        let mut tx = writer.begin().await?;
        let counted = query(of_kind!(self.kind, count_fault)).bind(self.seq).bind(self.attempt);
        let row = counted.fetch_optional(&mut tx).await?.ok_or(StoreError::LeaseLost)?;
        let pause = fault_pause(row.try_get("faults")?);
        let left = self.leave(store, "queued", None, &mut tx).await?;
        query(of_kind!(self.kind, pause))
            .bind(store.now_us().saturating_add(micros(pause)))
            .bind(self.seq)
            .execute(&mut tx)
            .await?;
        if let Some(why) = why {
            query("update jobs set waits_for = ?1 where seq = ?2")
                .bind(to_json(why)?)
                .bind(self.seq)
                .execute(&mut tx)
                .await?;
        }
        tx.commit().await?;
        Ok((pause, left.try_get("owner")?))
    }
}

/// Takes back the tasks whose lease ran out until then: each returns to its queue with the next attempt, or ends where
/// it has none left, with `exhausted`. Those of other processes are left alone with `only_own`. A file that the attempt
/// has left is removed later. An attempt that has written one of the checkpoints has come further than the one before
/// and does not count.
pub(super) async fn take_back(
    store: &Store,
    kind: Kind,
    exhausted: &Failure,
    (leases_until, only_own): (i64, bool),
    checkpoints: &[Kept],
    tx: &mut Transaction<'_>,
) -> Result<Vec<Row>, StoreError> {
    for kept in checkpoints {
        query(of_kind!(kind, do_not_count))
            .bind(&kept.job)
            .bind(kept.attempt)
            .bind(leases_until)
            .bind(only_own)
            .bind(kept.at_us.saturating_add(FILE_CLOCK_TICK_US))
            .bind(MOST_ATTEMPTS)
            .execute(&mut *tx)
            .await?;
    }
    query(of_kind!(kind, note_file))
        .bind(leases_until)
        .bind(only_own)
        .bind(kind.ending())
        .execute(&mut *tx)
        .await?;
    let taken_back = query(of_kind!(kind, take_back))
        .bind(store.now_us())
        .bind(leases_until)
        .bind(to_json(exhausted)?)
        .bind(only_own);
    Ok(taken_back.fetch_all(tx).await?)
}

impl Store {
    /// Renews a lease, with the progress where there is any; what clients want of the task.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(super) async fn renew_lease(
        &self,
        task: LeasedTask,
        progress: Option<&JobProgress>,
    ) -> Result<StopRequests, StoreError> {
        let news = progress.map(to_json).transpose()?;
        // A lease does not outlive a power cut.
        self.write(Durability::ProcessEnd, (task, news), |store, (task, news), tx| {
            Box::pin(task.renew(store, news.as_deref(), tx))
        })
        .await
    }
}
