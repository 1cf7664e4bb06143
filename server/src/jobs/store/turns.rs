//! Turns in the queue: start-time fair queueing (Goyal, Vin and Cheng 1996) of jobs of unit cost.
//!
//! Jobs of one priority start by turn. A flow is a study, or all single jobs together; its jobs take one
//! turn after the other. Time stands at the turn of the job that started last, and no job gets an earlier one.
//! So flows that wait alternate, however many jobs each has: what comes in while ten thousand jobs of a study
//! wait starts next, and the study still gets every other start. Each priority has a time of its own:
//! what starts by its priority must not take the turns of those that wait below it.

use sqlx::{Row as _, SqliteConnection};

use super::StoreError;

/// The flow of all jobs that belong to no study.
pub(super) const SINGLE_JOBS: i64 = 0;

/// Takes the next `jobs` turns of a flow, and tells the first of them.
pub(super) async fn take(
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

/// A job with this turn starts.
pub(super) async fn pass(
    connection: &mut SqliteConnection,
    priority: i64,
    turn: i64,
) -> Result<(), StoreError> {
    sqlx::query(
        "insert into queue_times (priority, turn) values (?, ?)
         on conflict (priority) do update set turn = max(turn, excluded.turn)",
    )
    .bind(priority)
    .bind(turn)
    .execute(connection)
    .await?;
    Ok(())
}
