//! Reading jobs.

use std::collections::BTreeMap;

use serde_json::Value;
use sqlx::{QueryBuilder, Row as _, Sqlite};

use super::rows::select_jobs;
use super::submit::to_json;
use super::{Store, StoreError, now_us, rows};
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
    /// Only jobs whose name contains this text.
    pub(crate) name: Option<String>,
    /// Only jobs with this method in their request.
    pub(crate) method: Option<String>,
    /// Only jobs that were submitted at this time or later, in microseconds since the Unix epoch.
    pub(crate) created_after: Option<i64>,
    /// Only jobs that were submitted before this time, in microseconds since the Unix epoch.
    pub(crate) created_before: Option<i64>,
    /// Oldest job first instead of newest first.
    pub(crate) oldest_first: bool,
}

/// One page of a listing.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Page {
    pub(crate) jobs: Vec<JobRecord>,
    /// Jobs beyond this number follow; `None` on the last page.
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

    /// A page of at most `limit` jobs beyond number `before` in the order of the filter.
    ///
    /// Every combination of state, study and labels is the range of one index, further labels are looked up in
    /// another: such a page costs no more than its length. Name, method and time of submission are tested for each job
    /// of that range.
    pub(crate) async fn list(
        &self,
        filter: &Filter,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Page, StoreError> {
        let mut query = list_query(filter, before.unwrap_or(filter.start()), i64::from(limit) + 1);
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
        self.detached(async move {
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

impl Filter {
    /// The number before the first page.
    fn start(&self) -> i64 {
        if self.oldest_first { i64::MIN } else { i64::MAX }
    }

    /// Limits a query to the jobs beyond number `before`, which `column` holds, and adds the filters without an index.
    fn push(&self, query: &mut QueryBuilder<Sqlite>, column: &str, before: i64) {
        query.push(column).push(if self.oldest_first { " > " } else { " < " }).push_bind(before);
        if let Some(name) = &self.name {
            query.push(" and instr(jobs.name, ").push_bind(name.clone()).push(") > 0");
        }
        if let Some(method) = &self.method {
            query.push(" and jobs.method = ").push_bind(method.clone());
        }
        if let Some(after) = self.created_after {
            query.push(" and jobs.created_at >= ").push_bind(after);
        }
        if let Some(until) = self.created_before {
            query.push(" and jobs.created_at < ").push_bind(until);
        }
    }

    /// Adds order and length of the page.
    fn push_end(&self, query: &mut QueryBuilder<Sqlite>, column: &str, limit: i64) {
        query.push(" order by ").push(column).push(if self.oldest_first {
            " limit "
        } else {
            " desc limit "
        });
        query.push_bind(limit);
    }
}

fn list_query(filter: &Filter, before: i64, limit: i64) -> QueryBuilder<Sqlite> {
    if let Some(study) = filter.study {
        return list_of_study(study, filter, before, limit);
    }
    let Some(((key, value), others)) = filter.labels.split_first() else {
        let mut query = QueryBuilder::new(select_jobs!("where "));
        filter.push(&mut query, "jobs.seq", before);
        if let Some(state) = filter.state {
            query.push(" and jobs.state = ").push_bind(state.name());
        }
        filter.push_end(&mut query, "jobs.seq", limit);
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
    filter.push(query.push(" and "), "job_labels.job", before);
    if let Some(state) = filter.state {
        query.push(" and job_labels.state = ").push_bind(state.name());
    }
    for (key, value) in others {
        query.push(" and exists (select 1 from job_labels as other where other.key = ");
        query.push_bind(key.clone()).push(" and other.value = ").push_bind(value.clone());
        query.push(" and other.job = job_labels.job)");
    }
    filter.push_end(&mut query, "job_labels.job", limit);
    query
}

/// A study has its own index; labels are looked up for each of its jobs, of which there are not many.
fn list_of_study(study: StudyId, filter: &Filter, before: i64, limit: i64) -> QueryBuilder<Sqlite> {
    let mut query = QueryBuilder::new(select_jobs!(
        "where jobs.study = (select known.seq from studies as known where known.id = "
    ));
    query.push_bind(study.to_string()).push(") and ");
    filter.push(&mut query, "jobs.seq", before);
    if let Some(state) = filter.state {
        query.push(" and jobs.state = ").push_bind(state.name());
    }
    for (key, value) in &filter.labels {
        query.push(" and exists (select 1 from job_labels as other where other.key = ");
        query.push_bind(key.clone()).push(" and other.value = ").push_bind(value.clone());
        query.push(" and other.job = jobs.seq)");
    }
    filter.push_end(&mut query, "jobs.seq", limit);
    query
}

/// The statement behind a listing, for a look at its plan.
#[cfg(test)]
pub(super) fn list_sql(filter: &Filter) -> String {
    use sqlx::Execute as _;
    list_query(filter, filter.start(), 1).build().sql().as_str().to_owned()
}
