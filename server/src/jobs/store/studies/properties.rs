//! Effective properties of the runs of a study: from the reports of the exports that the jobs request, which end after
//! their jobs.

use packstone_engine::export::{ExportReport, ExportType};

use super::super::db::{Transaction, query};
use super::super::submit::to_json;
use super::super::{StoreError, rows};
use crate::ids::StudyId;
use crate::studies::{Facts, PropertyFacts};

/// Records the properties of the run of a job, in the transaction that ends the export `seq` of this job: those of all
/// exports that the request of the job names and that are made. Returns the study, or `None` where the job is part of
/// none, or its request does not name the export, or the export computes no properties.
pub(in crate::jobs::store) async fn record(
    tx: &mut Transaction<'_>,
    seq: i64,
    now: i64,
) -> Result<Option<StudyId>, StoreError> {
    // Those that a client requests later are no part of the study: they are not heavy.
    let place = query(
        "select exports.job, studies.id, jobs.study, jobs.point, jobs.replicate
         from exports join jobs on jobs.seq = exports.job join studies on studies.seq = jobs.study
         where exports.seq = ? and exports.heavy and exports.type = ?",
    )
    .bind(seq)
    .bind(ExportType::Properties.name())
    .fetch_optional(&mut *tx)
    .await?;
    let Some(place) = place else { return Ok(None) };
    let (job, study): (i64, i64) = (place.try_get("job")?, place.try_get("study")?);
    let (point, replicate): (i64, i64) = (place.try_get("point")?, place.try_get("replicate")?);
    touch_study_of(tx, job, now).await?;
    let id = rows::study_id(place.text("id")?)?;
    let reports = query(
        "select report from exports where job = ? and heavy and type = ? and state = 'succeeded' order by seq",
    )
    .bind(job)
    .bind(ExportType::Properties.name())
    .fetch_all(&mut *tx)
    .await?;
    let reports: Vec<ExportReport> =
        reports.iter().map(|row| rows::json(row.text("report")?)).collect::<Result<_, _>>()?;
    let Some(properties) = PropertyFacts::of_reports(reports) else { return Ok(Some(id)) };
    let run = query("select facts from study_runs where study = ? and point = ? and replicate = ?")
        .bind(study)
        .bind(point)
        .bind(replicate)
        .fetch_optional(&mut *tx)
        .await?;
    let Some(run) = run else { return Ok(Some(id)) };
    let facts: Facts = rows::json(run.text("facts")?)?;
    let facts = Facts { properties: Some(properties), ..facts };
    query("update study_runs set facts = ? where study = ? and point = ? and replicate = ?")
        .bind(to_json(&facts)?)
        .bind(study)
        .bind(point)
        .bind(replicate)
        .execute(tx)
        .await?;
    Ok(Some(id))
}

/// Increments the version of the study of a job, whose table has changed.
pub(in crate::jobs::store) async fn touch_study_of(
    tx: &mut Transaction<'_>,
    job: i64,
    now: i64,
) -> Result<(), StoreError> {
    query(
        "update studies set version = version + 1, updated_at = ?
         where seq = (select study from jobs where seq = ?)",
    )
    .bind(now)
    .bind(job)
    .execute(tx)
    .await?;
    Ok(())
}

/// The number of runs of each point whose properties are still to be computed.
pub(super) async fn waiting(
    tx: &mut Transaction<'_>,
    study: i64,
    points: usize,
) -> Result<Vec<u64>, StoreError> {
    let mut waiting = vec![0; points];
    let found = query(
        "select jobs.point, count(distinct jobs.seq) as waiting from exports join jobs on jobs.seq = exports.job
         where exports.state in ('queued', 'running') and exports.heavy and exports.type = ? and jobs.study = ?
         group by jobs.point",
    )
    .bind(ExportType::Properties.name())
    .bind(study)
    .fetch_all(tx)
    .await?;
    for row in &found {
        if let Some(waiting) = waiting.get_mut(row.try_get::<u32>("point")? as usize) {
            *waiting = row.try_get::<i64>("waiting")?.cast_unsigned();
        }
    }
    Ok(waiting)
}
