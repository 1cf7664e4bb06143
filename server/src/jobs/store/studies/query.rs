//! Reading studies, and what their tables are made of.

use std::collections::{BTreeMap, HashMap};

use serde_json::Value;

use super::super::bodies::composed_body;
use super::super::db::{QueryBuilder, Row, Transaction, query};
use super::super::rows::DamagedRow;
use super::super::{Store, StoreError, rows};
use super::{StudyRecord, StudyState, StudyWarning, properties, runs};
use crate::ids::StudyId;
use crate::studies::table::Rest;
use crate::studies::{Keys, Run, Table};
use crate::tasks;

/// Which studies a listing wants.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct StudyFilter {
    pub(crate) state: Option<StudyState>,
    /// Keys and values that a study must all have.
    pub(crate) labels: Vec<(String, String)>,
    /// Only studies of this owner, and those that are shared.
    pub(crate) visible_to: Option<String>,
}

/// One page of a listing, newest study first.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct StudyPage {
    pub(crate) studies: Vec<StudyRecord>,
    /// Studies of the page that cannot be read.
    pub(crate) damaged: Vec<DamagedRow>,
    /// Studies below this number follow; `None` on the last page.
    pub(crate) next_before: Option<i64>,
}

impl Store {
    /// The study, or `None` where there is none (any more).
    pub(crate) async fn study(&self, id: StudyId) -> Result<Option<StudyRecord>, StoreError> {
        let row = query("select * from studies where id = ?")
            .bind(id.to_string())
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(StudyRecord::read).transpose()
    }

    /// The request of a study as submitted, with its seed. It never changes.
    ///
    /// # Errors
    /// [`StoreError::NoStudy`], or the database's.
    pub(crate) async fn study_request(&self, seq: i64) -> Result<Value, StoreError> {
        let text = concat!(
            "select ",
            composed_body!(),
            " as body, r.digest from study_requests as r
                 left join study_parts as p on p.study = r.study and p.part = r.part
             where r.study = ?"
        );
        let row = query(text).bind(seq).fetch_optional(self.readers()).await?.ok_or(StoreError::NoStudy)?;
        rows::checked_document(&row, "body", "digest").await
    }

    /// Warnings of the plans of a study, each text once, of at most `limit` different lists of them: those of the first
    /// replicates, for all of a point have the same. They leave with these jobs.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn study_warnings(&self, seq: i64, limit: u32) -> Result<Vec<StudyWarning>, StoreError> {
        let found = query(
            "select warnings, count(*) as points, min(point) as point from jobs
             where study = ? and replicate = 0 and warnings <> '[]' group by warnings order by min(point) limit ?",
        )
        .bind(seq)
        .bind(limit)
        .fetch_all(self.readers())
        .await?;
        let mut warnings: Vec<StudyWarning> = Vec::new();
        let mut known: HashMap<String, usize> = HashMap::new();
        for row in &found {
            let (points, point): (i64, i64) = (row.try_get("points")?, row.try_get("point")?);
            let texts: Vec<String> = rows::json(row.text("warnings")?)?;
            for detail in texts {
                let at = *known.entry(detail.clone()).or_insert(warnings.len());
                match warnings.get_mut(at) {
                    Some(warning) => warning.points += points.cast_unsigned(),
                    None => warnings.push(StudyWarning {
                        detail,
                        points: points.cast_unsigned(),
                        point: point.cast_unsigned(),
                    }),
                }
            }
        }
        Ok(warnings)
    }

    /// A page of at most `limit` studies below number `before`.
    pub(crate) async fn list_studies(
        &self,
        filter: &StudyFilter,
        before: Option<i64>,
        limit: u32,
    ) -> Result<StudyPage, StoreError> {
        let query = list_query(filter, before.unwrap_or(i64::MAX), i64::from(limit) + 1);
        let rows = query.build().fetch_all(self.readers()).await?;
        let (mut studies, mut damaged) = (Vec::new(), Vec::new());
        for row in rows.iter().take(limit as usize) {
            rows::or_damaged(row, StudyRecord::read(row), &mut studies, &mut damaged)?;
        }
        let next_before = rows::next_before(&rows, limit)?;
        Ok(StudyPage { studies, damaged, next_before })
    }

    /// How many studies have jobs left to run.
    pub(crate) async fn open_studies(&self) -> Result<u64, StoreError> {
        let row = query("select count(*) as open from studies where finished_at is null")
            .fetch_one(self.readers())
            .await?;
        Ok(row.try_get::<i64>("open")? as u64)
    }

    /// What the runs of a study came to so far.
    pub(crate) async fn study_table(&self, study: &StudyRecord) -> Result<Table, StoreError> {
        // One snapshot for both: a run must not be missing because it ended between them.
        let mut tx = self.readers().begin().await?;
        let points = query(
            "select key_values, stopped_early, is_whole from study_points where study = ? order by point",
        )
        .bind(study.seq)
        .fetch_all(&mut tx)
        .await?;
        let ended =
            query("select point, replicate, outcome, facts, is_whole from study_runs where study = ?")
                .bind(study.seq)
                .fetch_all(&mut tx)
                .await?;
        let waiting = properties::waiting(&mut tx, study.seq, points.len()).await?;
        tx.commit().await?;
        let key_columns = study.key_columns.clone();
        let replicates = u64::from(study.replicates);
        let table = tasks::blocking(move || {
            let runs = ended.iter().map(run).collect::<Result<Vec<_>, _>>()?;
            let mut keys = Keys { columns: key_columns, values: Vec::with_capacity(points.len()) };
            let mut rest = Vec::with_capacity(points.len());
            let mut ended = vec![0; points.len()];
            for run in &runs {
                if let Some(ended) = ended.get_mut(run.point) {
                    *ended += 1;
                }
            }
            for (row, ended) in points.iter().zip(ended) {
                rows::check_whole(row, "is_whole")?;
                keys.values.push(rows::json(row.text("key_values")?)?);
                let stopped_early = row.try_get::<i64>("stopped_early")? as u64;
                rest.push(Rest { waiting: replicates.saturating_sub(ended + stopped_early), stopped_early });
            }
            Ok::<_, StoreError>(Table::new(&keys, &runs, &rest).with_waiting_properties(&waiting))
        });
        table.await?
    }

    /// The engine's reports on the first replicate of each point that has one, by point.
    pub(crate) async fn study_reports(&self, seq: i64) -> Result<BTreeMap<usize, Value>, StoreError> {
        let reports = query(
            "select jobs.point, artifacts.report from jobs indexed by jobs_by_point
                 join artifacts on artifacts.job = jobs.seq
             where jobs.study = ? and jobs.replicate = 0 and jobs.state = 'succeeded'",
        )
        .bind(seq)
        .fetch_all(self.readers())
        .await?;
        reports
            .iter()
            .map(|row| Ok((row.try_get::<u32>("point")? as usize, rows::json(row.text("report")?)?)))
            .collect()
    }
}

fn run(row: &Row) -> Result<Run, StoreError> {
    rows::check_whole(row, "is_whole")?;
    Ok(Run {
        point: row.try_get::<u32>("point")? as usize,
        replicate: row.try_get::<u32>("replicate")? as usize,
        outcome: runs::outcome(row.text("outcome")?)?,
        facts: rows::json(row.text("facts")?)?,
    })
}

/// The study of that number, which the caller knows to exist.
pub(super) async fn by_seq(tx: &mut Transaction<'_>, seq: i64) -> Result<StudyRecord, StoreError> {
    let row = query("select * from studies where seq = ?").bind(seq).fetch_optional(tx).await?;
    StudyRecord::read(&row.ok_or(StoreError::NoStudy)?)
}

/// The study of that id.
pub(super) async fn by_id(tx: &mut Transaction<'_>, id: StudyId) -> Result<StudyRecord, StoreError> {
    let row = query("select * from studies where id = ?").bind(id.to_string()).fetch_optional(tx).await?;
    StudyRecord::read(&row.ok_or(StoreError::NoStudy)?)
}

/// Each is the range of one index; what of it a further filter drops is few: studies are.
fn list_query(filter: &StudyFilter, before: i64, limit: i64) -> QueryBuilder {
    let mut query = QueryBuilder::new("select studies.* from ");
    match filter.labels.split_first() {
        None => query.push("studies where studies.seq < ").push_bind(before),
        Some(((key, value), _)) => query
            .push("study_labels cross join studies where studies.seq = study_labels.study and study_labels.key = ")
            .push_bind(key.clone())
            .push(" and study_labels.value = ")
            .push_bind(value.clone())
            .push(" and study_labels.study < ")
            .push_bind(before),
    };
    match filter.state {
        None => {}
        Some(StudyState::Open) => {
            query.push(" and studies.finished_at is null");
        }
        Some(StudyState::Finished) => {
            query.push(" and studies.finished_at is not null");
        }
    }
    if let Some(owner) = &filter.visible_to {
        query.push(" and (studies.owner = ").push_bind(owner.clone()).push(" or studies.shared)");
    }
    for (key, value) in filter.labels.iter().skip(1) {
        query.push(" and exists (select 1 from study_labels as other where other.key = ");
        query.push_bind(key.clone()).push(" and other.value = ").push_bind(value.clone());
        query.push(" and other.study = studies.seq)");
    }
    let order = if filter.labels.is_empty() { "studies.seq" } else { "study_labels.study" };
    query.push(" order by ").push(order).push(" desc limit ").push_bind(limit);
    query
}

/// The statement behind a listing, for a look at its plan.
#[cfg(test)]
pub(super) fn list_sql(filter: &StudyFilter) -> String {
    list_query(filter, i64::MAX, 1).sql().to_owned()
}
