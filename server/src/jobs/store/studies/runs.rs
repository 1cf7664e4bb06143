//! What became of the runs of a study, and the stop rule that looks at them.

use sqlx::sqlite::SqliteRow;
use sqlx::{Row as _, SqliteConnection};

use super::super::submit::to_json;
use super::super::{StoreError, rows};
use crate::ids::JobId;
use crate::studies::{Facts, Outcome, StopWhen};

/// The flow of a job in the queue: its study, or that of all single jobs.
pub(in super::super) async fn flow_of(connection: &mut SqliteConnection, job: i64) -> Result<i64, StoreError> {
    let row = sqlx::query("select coalesce(study, ?) as flow from jobs where seq = ?")
        .bind(super::super::turns::SINGLE_JOBS)
        .bind(job)
        .fetch_one(connection)
        .await?;
    Ok(row.try_get("flow")?)
}

/// Records the run of a job that ends in this transaction, if it is part of a study: `job` has its `study`,
/// `point` and `replicate`. Returns the jobs that the study's stop rule called off because of it.
pub(in super::super) async fn record(
    connection: &mut SqliteConnection,
    job: &SqliteRow,
    outcome: Outcome,
    facts: &Facts,
    now: i64,
) -> Result<Vec<JobId>, StoreError> {
    let Some(study) = job.try_get::<Option<i64>, _>("study")? else { return Ok(Vec::new()) };
    let point: i64 = job.try_get("point")?;
    sqlx::query(
        "insert or replace into study_runs (study, point, replicate, outcome, facts, ended_at)
         values (?, ?, ?, ?, ?, ?)",
    )
    .bind(study)
    .bind(point)
    .bind(job.try_get::<i64, _>("replicate")?)
    .bind(outcome.name())
    .bind(to_json(facts)?)
    .bind(now)
    .execute(&mut *connection)
    .await?;
    if outcome == Outcome::Void {
        return Ok(Vec::new());
    }
    let rule: String = sqlx::query(
        "update studies set runs = runs + 1, runs_time_s = runs_time_s + ? where seq = ? returning stop_when",
    )
    .bind(facts.time_s)
    .bind(study)
    .fetch_one(&mut *connection)
    .await?
    .try_get("stop_when")?;
    let rule: StopWhen = rows::json(&rule)?;
    if rule == StopWhen::default() || !is_met(connection, rule, study, point).await? {
        return Ok(Vec::new());
    }
    call_off(connection, study, point, now).await
}

/// Whether a point needs no more runs.
async fn is_met(
    connection: &mut SqliteConnection,
    rule: StopWhen,
    study: i64,
    point: i64,
) -> Result<bool, StoreError> {
    let runs = sqlx::query(
        "select outcome from study_runs where study = ? and point = ? and outcome <> 'void' order by ended_at",
    )
    .bind(study)
    .bind(point)
    .fetch_all(connection)
    .await?;
    let outcomes: Result<Vec<Outcome>, StoreError> =
        runs.iter().map(|row| outcome(&row.try_get::<String, _>("outcome")?)).collect();
    Ok(rule.is_met(&outcomes?))
}

/// Cancels what still waits of a point.
async fn call_off(
    connection: &mut SqliteConnection,
    study: i64,
    point: i64,
    now: i64,
) -> Result<Vec<JobId>, StoreError> {
    let cancelled = sqlx::query(
        "update jobs set state = 'cancelled', version = version + 1, finished_at = ?3, updated_at = ?3
         where study = ?1 and point = ?2 and state = 'queued' returning id",
    )
    .bind(study)
    .bind(point)
    .bind(now)
    .fetch_all(&mut *connection)
    .await?;
    if !cancelled.is_empty() {
        sqlx::query("update study_points set stopped_early = 1 where study = ? and point = ?")
            .bind(study)
            .bind(point)
            .execute(&mut *connection)
            .await?;
    }
    cancelled.iter().map(|row| rows::job_id(&row.try_get::<String, _>("id")?)).collect()
}

pub(super) fn outcome(name: &str) -> Result<Outcome, StoreError> {
    Outcome::from_name(name).ok_or_else(|| StoreError::Row(format!("unknown outcome {name:?}")))
}
