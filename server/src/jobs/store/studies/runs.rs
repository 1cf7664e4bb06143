//! What became of the runs of a study, and the stop rule that looks at them.

use super::super::db::{Row, Transaction, query};
use super::super::submit::to_json;
use super::super::turns::SINGLE_JOBS;
use super::super::{StoreError, rows};
use crate::failure::FailureCode;
use crate::ids::JobId;
use crate::studies::stop::Tally;
use crate::studies::{Facts, Outcome, StopWhen};

/// Outcomes with their names in the store.
const OUTCOMES: [(Outcome, &str); 4] = [
    (Outcome::Succeeded, "succeeded"),
    (Outcome::Partial, "partial"),
    (Outcome::TargetNotReached, "not_reached"),
    (Outcome::Void, "void"),
];

/// How a study counts a job that failed so.
pub(in super::super) fn outcome_of(code: FailureCode) -> Outcome {
    match code {
        FailureCode::TargetNotReached | FailureCode::TimedOut => Outcome::TargetNotReached,
        _ => Outcome::Void,
    }
}

/// The flow of a job in the queue: its study, or that of all single jobs.
pub(in super::super) async fn flow_of(tx: &mut Transaction<'_>, job: i64) -> Result<i64, StoreError> {
    let row = query("select coalesce(study, ?) as flow from jobs where seq = ?")
        .bind(SINGLE_JOBS)
        .bind(job)
        .fetch_one(tx)
        .await?;
    Ok(row.try_get("flow")?)
}

/// Records the run of a job that ends in this transaction, if it is part of a study: `job` has its `study`,
/// `point` and `replicate`. Returns the jobs that the study's stop rule cancelled because of it.
pub(in super::super) async fn record(
    tx: &mut Transaction<'_>,
    job: &Row,
    outcome: Outcome,
    facts: &Facts,
    now: i64,
) -> Result<Vec<JobId>, StoreError> {
    let Some(study) = job.try_get::<Option<i64>>("study")? else { return Ok(Vec::new()) };
    let point: i64 = job.try_get("point")?;
    query(
        "insert into study_runs (study, point, replicate, outcome, facts, ended_at) values (?, ?, ?, ?, ?, ?)
         on conflict (study, point, replicate) do update set
             outcome = excluded.outcome, facts = excluded.facts, ended_at = excluded.ended_at",
    )
    .bind(study)
    .bind(point)
    .bind(job.try_get::<i64>("replicate")?)
    .bind(OUTCOMES.iter().find(|(known, _)| *known == outcome).map(|(_, name)| *name))
    .bind(to_json(facts)?)
    .bind(now)
    .execute(&mut *tx)
    .await?;
    if outcome == Outcome::Void {
        return Ok(Vec::new());
    }
    let study_row = query(
        "update studies set runs = runs + 1, runs_time_s = runs_time_s + ? where seq = ? returning stop_when",
    )
    .bind(facts.time_s)
    .bind(study)
    .fetch_one(&mut *tx)
    .await?;
    let rule: StopWhen = rows::json(study_row.text("stop_when")?)?;
    if rule == StopWhen::default() || !is_met(tx, &rule, study, point).await? {
        return Ok(Vec::new());
    }
    call_off(tx, study, point, now).await
}

/// Whether a point needs no more runs. The runs are asked for anew each time, because a retry takes some back;
/// as one row, because a point may have thousands.
async fn is_met(
    tx: &mut Transaction<'_>,
    rule: &StopWhen,
    study: i64,
    point: i64,
) -> Result<bool, StoreError> {
    let row = query(
        "select string_agg(outcome, ',' order by ended_at) as outcomes from study_runs where study = ? and point = ?",
    )
    .bind(study)
    .bind(point)
    .fetch_one(tx)
    .await?;
    let mut tally = Tally::default();
    let mut met = false;
    for name in row.text("outcomes")?.split(',') {
        met = tally.ended(outcome(name)?, rule);
    }
    Ok(met)
}

/// Cancels what still waits of a point. No client asked for it: by that these jobs are known as called off.
async fn call_off(
    tx: &mut Transaction<'_>,
    study: i64,
    point: i64,
    now: i64,
) -> Result<Vec<JobId>, StoreError> {
    let cancelled = query(
        "update jobs set state = 'cancelled', version = version + 1, finished_at = ?3, updated_at = ?3
         where study = ?1 and point = ?2 and state = 'queued' returning id",
    )
    .bind(study)
    .bind(point)
    .bind(now)
    .fetch_all(tx)
    .await?;
    cancelled.iter().map(|row| rows::job_id(row.text("id")?)).collect()
}

/// The outcome of that name.
pub(in super::super) fn outcome(name: &str) -> Result<Outcome, StoreError> {
    let known = OUTCOMES.iter().find(|(_, known)| *known == name);
    known.map(|(outcome, _)| *outcome).ok_or_else(|| StoreError::Row(format!("unknown outcome {name:?}")))
}
