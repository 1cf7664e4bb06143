//! Reading jobs.

use std::collections::BTreeMap;

use serde_json::Value;
use sqlx::{QueryBuilder, Row as _, Sqlite};

use super::rows::select_jobs;
use super::submit::to_json;
use super::{Store, StoreError, detached, now_us, rows};
use crate::ids::StudyId;
use crate::jobs::{JobId, JobRecord, State};

/// Which jobs a listing wants.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Filter {
    pub(crate) state: Option<State>,
    /// Keys and values that a job must all have.
    pub(crate) labels: Vec<(String, String)>,
    /// Only jobs of this study.
    pub(crate) study: Option<StudyId>,
}

/// One page of a listing, newest job first.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Page {
    pub(crate) jobs: Vec<JobRecord>,
    /// Jobs below this number follow; `None` on the last page.
    pub(crate) next_before: Option<i64>,
}

impl Store {
    /// The job, or `None` where there is none (any more).
    pub(crate) async fn get(&self, id: JobId) -> Result<Option<JobRecord>, StoreError> {
        let row = sqlx::query(select_jobs!("where jobs.id = ?"))
            .bind(id.to_string())
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(rows::job).transpose()
    }

    /// The request of a job as stored. It never changes.
    ///
    /// # Errors
    /// [`StoreError::NoJob`], or the database's.
    pub(crate) async fn request(&self, seq: i64) -> Result<Value, StoreError> {
        let row = sqlx::query("select body from job_requests where job = ?")
            .bind(seq)
            .fetch_optional(self.readers())
            .await?
            .ok_or(StoreError::NoJob)?;
        serde_json::from_str(row.try_get("body")?).map_err(|error| StoreError::Row(error.to_string()))
    }

    /// A page of at most `limit` jobs below number `before`.
    ///
    /// Every combination of filters is the range of one index, further labels are looked up in
    /// another: no page costs more than its length, however many jobs there are.
    pub(crate) async fn list(
        &self,
        filter: &Filter,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Page, StoreError> {
        let mut query = list_query(filter, before.unwrap_or(i64::MAX), i64::from(limit) + 1);
        let rows = query.build().fetch_all(self.readers()).await?;
        let mut jobs = rows.iter().map(rows::job).collect::<Result<Vec<_>, _>>()?;
        let more = jobs.len() > limit as usize;
        jobs.truncate(limit as usize);
        let next_before = jobs.last().filter(|_| more).map(|job| job.seq);
        Ok(Page { jobs, next_before })
    }

    /// How long the job that was taken in first has waited, of those that wait.
    pub(crate) async fn queue_age(&self) -> Result<std::time::Duration, StoreError> {
        let oldest: Option<i64> = sqlx::query_scalar(
            "select created_at from jobs indexed by jobs_by_state where state = 'queued' order by seq limit 1",
        )
        .fetch_optional(self.readers())
        .await?;
        let waited_us = oldest.map_or(0, |created_at| now_us().saturating_sub(created_at).max(0));
        Ok(std::time::Duration::from_micros(waited_us.cast_unsigned()))
    }

    /// How many jobs are in each state.
    pub(crate) async fn counts(&self) -> Result<BTreeMap<State, u64>, StoreError> {
        let rows = sqlx::query("select state, jobs from job_counts").fetch_all(self.readers()).await?;
        rows.iter()
            .map(|row| {
                let state = rows::state(&row.try_get::<String, _>("state")?)?;
                Ok((state, row.try_get::<i64, _>("jobs")? as u64))
            })
            .collect()
    }

    /// Records the lengths of all formats as of a new revision of them.
    pub(crate) async fn record_lengths(
        &self,
        seq: i64,
        revision: u32,
        lengths: BTreeMap<String, u64>,
    ) -> Result<(), StoreError> {
        let store = self.clone();
        detached(async move {
            let mut writer = store.writer().await?;
            sqlx::query("update artifacts set format_revision = ?, format_lengths = ? where job = ?")
                .bind(revision)
                .bind(to_json(&lengths)?)
                .bind(seq)
                .execute(&mut *writer)
                .await?;
            Ok(())
        })
        .await
    }
}

fn list_query(filter: &Filter, before: i64, limit: i64) -> QueryBuilder<Sqlite> {
    if let Some(study) = filter.study {
        return list_of_study(study, filter, before, limit);
    }
    let Some(((key, value), others)) = filter.labels.split_first() else {
        let mut query = QueryBuilder::new(select_jobs!("where jobs.seq < "));
        query.push_bind(before);
        if let Some(state) = filter.state {
            query.push(" and jobs.state = ").push_bind(state.name());
        }
        query.push(" order by jobs.seq desc limit ").push_bind(limit);
        return query;
    };
    // `cross join` keeps the planner from leaving the labels' index, which the order relies on.
    let mut query = QueryBuilder::new(
        "select jobs.*, artifacts.path, artifacts.bytes, artifacts.sha256, artifacts.report,
             artifacts.format_revision, artifacts.format_lengths, studies.id as study_id
         from job_labels cross join jobs on jobs.seq = job_labels.job
             left join artifacts on artifacts.job = jobs.seq
             left join studies on studies.seq = jobs.study
         where job_labels.key = ",
    );
    query.push_bind(key.clone()).push(" and job_labels.value = ").push_bind(value.clone());
    query.push(" and job_labels.job < ").push_bind(before);
    if let Some(state) = filter.state {
        query.push(" and job_labels.state = ").push_bind(state.name());
    }
    for (key, value) in others {
        query.push(" and exists (select 1 from job_labels as other where other.key = ");
        query.push_bind(key.clone()).push(" and other.value = ").push_bind(value.clone());
        query.push(" and other.job = job_labels.job)");
    }
    query.push(" order by job_labels.job desc limit ").push_bind(limit);
    query
}

/// A study has its own index; labels are looked up for each of its jobs, of which there are not many.
fn list_of_study(study: StudyId, filter: &Filter, before: i64, limit: i64) -> QueryBuilder<Sqlite> {
    let mut query = QueryBuilder::new(select_jobs!(
        "where jobs.study = (select known.seq from studies as known where known.id = "
    ));
    query.push_bind(study.to_string()).push(") and jobs.seq < ").push_bind(before);
    if let Some(state) = filter.state {
        query.push(" and jobs.state = ").push_bind(state.name());
    }
    for (key, value) in &filter.labels {
        query.push(" and exists (select 1 from job_labels as other where other.key = ");
        query.push_bind(key.clone()).push(" and other.value = ").push_bind(value.clone());
        query.push(" and other.job = jobs.seq)");
    }
    query.push(" order by jobs.seq desc limit ").push_bind(limit);
    query
}

/// The statement behind a listing, for a look at its plan.
#[cfg(test)]
pub(super) fn list_sql(filter: &Filter) -> String {
    use sqlx::Execute as _;
    list_query(filter, i64::MAX, 1).build().sql().as_str().to_owned()
}
