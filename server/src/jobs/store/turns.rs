//! Start-time fair queueing of jobs of unit cost (Goyal, Vin and Cheng 1996, <https://doi.org/10.1145/248156.248171>).
//!
//! Jobs of one priority start in the order of their virtual start times, the column `turn`. A flow is a study, or all
//! single jobs together; its jobs have consecutive start times, S(k) = max(V, S(k-1) + 1). The virtual time V is the
//! start time of the job that started last. So waiting flows alternate, however many jobs each has: a job that is
//! submitted while ten thousand jobs of a study wait starts next, and the study still gets every other start. Each
//! priority has a virtual time of its own, so that jobs of a higher priority do not advance that of a lower one.

use sqlx::{Row as _, SqliteConnection};

use super::StoreError;

/// The flow of all jobs that belong to no study.
pub(super) const SINGLE_JOBS: i64 = 0;

/// Assigns the next `jobs` virtual start times of a flow, and returns the first of them.
pub(super) async fn assign_start_times(
    connection: &mut SqliteConnection,
    flow: i64,
    priority: i64,
    jobs: i64,
) -> Result<i64, StoreError> {
    let last: i64 = sqlx::query(
        "insert into queue_flows (flow, priority, last_turn)
         values (?1, ?2, coalesce((select turn from queue_times where priority = ?2), 0) + ?3 - 1)
         on conflict (flow, priority) do update set last_turn =
             max(last_turn + 1, coalesce((select turn from queue_times where priority = ?2), 0)) + ?3 - 1
         returning last_turn",
    )
    .bind(flow)
    .bind(priority)
    .bind(jobs)
    .fetch_one(connection)
    .await?
    .try_get("last_turn")?;
    Ok(last - jobs + 1)
}

/// Advances the virtual time of a priority to the virtual start time of a job that starts.
pub(super) async fn advance_virtual_time(
    connection: &mut SqliteConnection,
    priority: i64,
    start_time: i64,
) -> Result<(), StoreError> {
    sqlx::query(
        "insert into queue_times (priority, turn) values (?, ?)
         on conflict (priority) do update set turn = max(turn, excluded.turn)",
    )
    .bind(priority)
    .bind(start_time)
    .execute(connection)
    .await?;
    Ok(())
}
