//! Reading jobs.

use std::collections::BTreeMap;

use serde_json::Value;

use super::bodies::body_of_job;
use super::db::{QueryBuilder, Row, query};
use super::rows::{DamagedRow, select_jobs};
use super::submit::to_json;
use super::{Store, StoreError, rows};
use crate::ids::StudyId;
use crate::jobs::{JobId, JobRecord, State};

/// What stands for the end of a job that has not ended, before the end of every other.
const NOT_FINISHED: i64 = 0;

/// Most jobs that a listing counts: a count walks them all.
const MOST_COUNTED: i64 = 10_000;
/// Name and title of a job without regard to case: SQLite itself knows the case of ASCII letters alone.
const FOLDED_NAMES: &str = "replace(replace(replace(replace(lower(coalesce(jobs.name, '') || ', ' \
     || coalesce(jobs.title, '')), 'Ä', 'ä'), 'Ö', 'ö'), 'Ü', 'ü'), 'É', 'é')";

/// Which jobs a listing wants.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Filter {
    pub(crate) state: Option<State>,
    /// Keys and values that a job must all have.
    pub(crate) labels: Vec<(String, String)>,
    /// Only jobs of this study.
    pub(crate) study: Option<StudyId>,
    /// Only jobs whose name or title contains this text, in upper or lower case.
    pub(crate) name: Option<String>,
    /// Only jobs with this method in their request.
    pub(crate) method: Option<String>,
    /// Only jobs that were submitted at this time or later, in microseconds since the Unix epoch.
    pub(crate) created_after: Option<i64>,
    /// Only jobs that were submitted before this time, in microseconds since the Unix epoch.
    pub(crate) created_before: Option<i64>,
    /// Only jobs of this owner, and those that are shared.
    pub(crate) visible_to: Option<String>,
    /// In which order.
    pub(crate) order: Order,
}

/// Whose a job or a study is, and whether others may read it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Holder {
    pub(crate) owner: String,
    pub(crate) shared: bool,
}

impl Holder {
    pub(super) fn read(row: &Row) -> Result<Self, StoreError> {
        Ok(Self { owner: row.try_get("owner")?, shared: row.try_get("shared")? })
    }
}

/// What the jobs of an owner take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Usage {
    /// Jobs that wait.
    pub(crate) queued: u64,
    /// Jobs that run.
    pub(crate) running: u64,
    /// Bytes of results, kept exports and requests.
    pub(crate) stored_bytes: u64,
}

/// By what a listing is ordered. Jobs that are equal in it are in the order of their submission.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum SortKey {
    /// When they were submitted.
    #[default]
    Created,
    /// Their priority.
    Priority,
    /// When they ended; those that have not ended come before all others.
    Finished,
}

/// The order of a listing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Order {
    pub(crate) key: SortKey,
    /// Backwards: the last job of the order comes first.
    pub(crate) descending: bool,
}

/// Newest first.
impl Default for Order {
    fn default() -> Self {
        Self { key: SortKey::Created, descending: true }
    }
}

/// The place of an item in the order of a listing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Position {
    /// What the listing is ordered by; 0 where that is the number alone.
    pub(crate) key: i64,
    /// Number of the item, which no other has.
    pub(crate) seq: i64,
}

impl From<i64> for Position {
    fn from(seq: i64) -> Self {
        Self { key: 0, seq }
    }
}

/// The jobs that a filter leaves, and what their results take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Totals {
    /// Jobs that were counted.
    pub(crate) jobs: u64,
    /// Whether there are no more.
    pub(crate) is_all: bool,
    /// Bytes of their results, without exports.
    pub(crate) bytes: u64,
}

/// One page of a listing.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Page {
    pub(crate) jobs: Vec<JobRecord>,
    /// Jobs of the page that cannot be read.
    pub(crate) damaged: Vec<DamagedRow>,
    /// The jobs beyond this position follow; `None` on the last page.
    pub(crate) next_after: Option<Position>,
}

impl Store {
    /// The job, or `None` where there is none (any more).
    pub(crate) async fn get(&self, id: JobId) -> Result<Option<JobRecord>, StoreError> {
        let row = query(select_jobs!("where jobs.id = ?"))
            .bind(id.to_string())
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(rows::job).transpose()
    }

    /// Whose the job is, or `None` where there is none (any more).
    pub(crate) async fn holder_of_job(&self, id: JobId) -> Result<Option<Holder>, StoreError> {
        let row = query("select owner, shared from jobs where id = ?")
            .bind(id.to_string())
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(Holder::read).transpose()
    }

    /// Whose the study is, or `None` where there is none (any more).
    pub(crate) async fn holder_of_study(&self, id: StudyId) -> Result<Option<Holder>, StoreError> {
        let row = query("select owner, shared from studies where id = ?")
            .bind(id.to_string())
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(Holder::read).transpose()
    }

    /// The request of a job as stored. It never changes.
    ///
    /// # Errors
    /// [`StoreError::NoJob`], or the database's.
    pub(crate) async fn request(&self, seq: i64) -> Result<Value, StoreError> {
        rows::checked_document(&self.request_row(seq).await?, "body", "body_digest").await
    }

    /// The same as JSON text.
    ///
    /// # Errors
    /// Those of [`Self::request`].
    pub(crate) async fn request_text(&self, seq: i64) -> Result<String, StoreError> {
        rows::checked_text(&self.request_row(seq).await?, "body", "body_digest").await
    }

    async fn request_row(&self, seq: i64) -> Result<Row, StoreError> {
        let found = query(concat!("select ", body_of_job!(), " from jobs where jobs.seq = ?"));
        found.bind(seq).fetch_optional(self.readers()).await?.ok_or(StoreError::NoJob)
    }

    /// A page of at most `limit` jobs beyond the position `after` in the order of the filter.
    ///
    /// In the order of submission every combination of state, study and labels is the range of one index, further
    /// labels are looked up in another: such a page costs no more than its length. Each of the other orders has one
    /// index, of which the filters are tested for each job; with a study, a label, or the states `queued` and `running`
    /// the jobs that these leave are sorted. Name, method and time of submission are always tested for each job.
    pub(crate) async fn list(
        &self,
        filter: &Filter,
        after: Option<Position>,
        limit: u32,
    ) -> Result<Page, StoreError> {
        let after = after.unwrap_or(filter.order.start());
        let query = list_query(filter, after, i64::from(limit) + 1);
        let rows = query.build().fetch_all(self.readers()).await?;
        let (mut jobs, mut damaged) = (Vec::new(), Vec::new());
        for row in rows.iter().take(limit as usize) {
            rows::or_damaged(row, rows::job(row), &mut jobs, &mut damaged)?;
        }
        let last = rows.get(limit as usize).and_then(|_| rows.get(limit.saturating_sub(1) as usize));
        let next_after = last.map(|row| filter.order.position(row)).transpose()?;
        Ok(Page { jobs, damaged, next_after })
    }

    /// The jobs that a filter leaves, of which at most [`MOST_COUNTED`] are counted.
    pub(crate) async fn totals(&self, filter: &Filter) -> Result<Totals, StoreError> {
        let unordered = Filter { order: Order::default(), ..filter.clone() };
        let mut counted = list_query(&unordered, unordered.order.start(), MOST_COUNTED + 1);
        counted
            .prepend("select count(*) as jobs, cast(coalesce(sum(bytes), 0) as bigint) as bytes from (")
            .push(") as counted");
        let row = counted.build().fetch_one(self.readers()).await?;
        let jobs = row.try_get::<i64>("jobs")?;
        Ok(Totals {
            jobs: jobs.min(MOST_COUNTED).cast_unsigned(),
            is_all: jobs <= MOST_COUNTED,
            bytes: row.try_get::<i64>("bytes")?.cast_unsigned(),
        })
    }

    /// What the jobs of an owner take.
    pub(crate) async fn usage_of(&self, owner: &str) -> Result<Usage, StoreError> {
        let row = query("select queued, running, request_bytes from queue_owners where owner = ?")
            .bind(owner)
            .fetch_optional(self.readers())
            .await?;
        let count = |column| -> Result<u64, StoreError> {
            let count = row.as_ref().map(|row| row.try_get::<i64>(column)).transpose()?;
            Ok(count.unwrap_or(0) as u64)
        };
        let stored: i64 = query(
            "select cast(coalesce(sum(bytes), 0) as bigint) from stored_bytes where owner = ? and kind <> 'cache'",
        )
        .bind(owner)
        .scalar(self.readers())
        .await?;
        let stored_bytes = stored as u64 + count("request_bytes")?;
        Ok(Usage { queued: count("queued")?, running: count("running")?, stored_bytes })
    }

    /// How long the job that was accepted first has waited, of those that wait.
    pub(crate) async fn queue_age(&self) -> Result<std::time::Duration, StoreError> {
        let oldest: Option<i64> = query(
            "select created_at from jobs indexed by jobs_by_state where state = 'queued' order by seq limit 1",
        )
        .optional_scalar(self.readers())
        .await?;
        let waited_us = oldest.map_or(0, |created_at| self.now_us().saturating_sub(created_at).max(0));
        Ok(std::time::Duration::from_micros(waited_us.cast_unsigned()))
    }

    /// How many jobs wait.
    pub(crate) async fn queued(&self) -> Result<u64, StoreError> {
        let queued: Option<i64> = query("select jobs from job_counts where state = 'queued'")
            .optional_scalar(self.readers())
            .await?;
        Ok(queued.unwrap_or(0).cast_unsigned())
    }

    /// How many jobs are in each state.
    pub(crate) async fn counts(&self) -> Result<BTreeMap<State, u64>, StoreError> {
        let rows = query("select state, jobs from job_counts").fetch_all(self.readers()).await?;
        rows.iter()
            .map(|row| {
                let state = rows::state(row.text("state")?)?;
                Ok((state, row.try_get::<i64>("jobs")? as u64))
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
            query("update artifacts set format_revision = ?, format_lengths = ? where job = ?")
                .bind(revision)
                .bind(to_json(&lengths)?)
                .bind(seq)
                .execute(&mut writer)
                .await?;
            Ok(())
        })
        .await
    }
}

impl Order {
    /// The position before the first page.
    fn start(self) -> Position {
        let end = if self.descending { i64::MAX } else { i64::MIN };
        Position { key: end, seq: end }
    }

    /// The position of the job of a row.
    fn position(self, job: &Row) -> Result<Position, StoreError> {
        let key = match self.key {
            SortKey::Created => 0,
            SortKey::Priority => job.try_get("priority")?,
            SortKey::Finished => job.try_get::<Option<i64>>("finished_at")?.unwrap_or(NOT_FINISHED),
        };
        Ok(Position { key, seq: job.try_get("seq")? })
    }

    /// What comes before the number in the order: the expressions of the indices.
    fn expression(self) -> Option<&'static str> {
        match self.key {
            SortKey::Created => None,
            SortKey::Priority => Some("jobs.priority"),
            SortKey::Finished => Some("coalesce(jobs.finished_at, 0)"),
        }
    }

    /// Limits a query to the jobs beyond a position; `seq` is the column with their numbers.
    fn push_after(self, query: &mut QueryBuilder, seq: &str, after: Position) {
        let beyond = if self.descending { " < " } else { " > " };
        match self.expression() {
            None => query.push(seq).push(beyond).push_bind(after.seq),
            // The first of the two conditions is the range of the index.
            Some(key) => query
                .push(key)
                .push(beyond.trim_end())
                .push("= ")
                .push_bind(after.key)
                .push(format!(" and ({key}, {seq}){beyond}("))
                .push_bind(after.key)
                .push(", ")
                .push_bind(after.seq)
                .push(")"),
        };
    }

    /// Adds order and length of the page.
    fn push_end(self, query: &mut QueryBuilder, seq: &str, limit: i64) {
        let direction = if self.descending { " desc" } else { "" };
        query.push(" order by ");
        if let Some(key) = self.expression() {
            query.push(key).push(direction).push(", ");
        }
        query.push(seq).push(direction).push(" limit ").push_bind(limit);
    }
}

impl Filter {
    /// Limits a query to the jobs beyond a position, and adds the filters without an index; `seq` is the column with
    /// the numbers of the jobs.
    fn push(&self, query: &mut QueryBuilder, seq: &str, after: Position) {
        self.order.push_after(query, seq, after);
        if self.name.as_ref().is_some_and(String::is_empty) {
            query.push(" and jobs.name is not null");
        } else if let Some(name) = &self.name {
            query.push(" and replace(").push(FOLDED_NAMES).push(", ").push_bind(name.to_lowercase());
            query.push(", '') <> ").push(FOLDED_NAMES);
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
}

impl Filter {
    /// Adds the condition that the owner may see a job.
    fn push_visible(&self, query: &mut QueryBuilder) {
        if let Some(owner) = &self.visible_to {
            query.push(" and (jobs.owner = ").push_bind(owner.clone()).push(" or jobs.shared)");
        }
    }
}

fn list_query(filter: &Filter, after: Position, limit: i64) -> QueryBuilder {
    if let Some(study) = filter.study {
        return list_of_study(study, filter, after, limit);
    }
    let Some(((key, value), others)) = filter.labels.split_first() else {
        if let Some(owner) = &filter.visible_to {
            return list_of_owner(owner, filter, after, limit);
        }
        let mut query = QueryBuilder::new(select_jobs!("where "));
        filter.push(&mut query, "jobs.seq", after);
        if let Some(state) = filter.state {
            // Jobs that have ended are many: they are walked in their order. An expression keeps the index by state
            // out of it.
            let walked = filter.order.expression().is_some() && state.is_finished();
            query.push(if walked { " and jobs.state || '' = " } else { " and jobs.state = " });
            query.push_bind(state.name());
        }
        filter.order.push_end(&mut query, "jobs.seq", limit);
        return query;
    };
    // `cross join` keeps the planner from leaving the labels' index, which the order relies on.
    let mut query = QueryBuilder::new(
        "select jobs.*, artifacts.path, artifacts.bytes, artifacts.sha256, artifacts.report,
             artifacts.report_digest, artifacts.format_revision, artifacts.format_lengths,
             artifacts.is_whole as artifact_is_whole, studies.id as study_id
         from job_labels cross join jobs left join artifacts on artifacts.job = jobs.seq
             left join studies on studies.seq = jobs.study
         where jobs.seq = job_labels.job and job_labels.key = ",
    );
    query.push_bind(key.clone()).push(" and job_labels.value = ").push_bind(value.clone());
    filter.push(query.push(" and "), "job_labels.job", after);
    filter.push_visible(&mut query);
    if let Some(state) = filter.state {
        query.push(" and job_labels.state = ").push_bind(state.name());
    }
    for (key, value) in others {
        query.push(" and exists (select 1 from job_labels as other where other.key = ");
        query.push_bind(key.clone()).push(" and other.value = ").push_bind(value.clone());
        query.push(" and other.job = job_labels.job)");
    }
    filter.order.push_end(&mut query, "job_labels.job", limit);
    query
}

/// Two ranges, each of one index and as long as a page: the jobs of the owner, and those that others share.
fn list_of_owner(owner: &str, filter: &Filter, after: Position, limit: i64) -> QueryBuilder {
    let mut query = QueryBuilder::new(select_jobs!(
        "where jobs.seq in (select seq from (select jobs.seq from jobs indexed by jobs_by_owner where jobs.owner = "
    ));
    query.push_bind(owner.to_owned());
    let rest = |query: &mut QueryBuilder| {
        filter.push(query.push(" and "), "jobs.seq", after);
        if let Some(state) = filter.state {
            query.push(" and jobs.state || '' = ").push_bind(state.name());
        }
        filter.order.push_end(query, "jobs.seq", limit);
    };
    rest(&mut query);
    query.push(
        ") as own union all select seq from (select jobs.seq from jobs indexed by jobs_shared where jobs.shared \
         and jobs.owner <> ",
    );
    query.push_bind(owner.to_owned());
    rest(&mut query);
    query.push(") as shared)");
    filter.order.push_end(&mut query, "jobs.seq", limit);
    query
}

/// A study has its own index; labels are looked up for each of its jobs, of which there are not many.
fn list_of_study(study: StudyId, filter: &Filter, after: Position, limit: i64) -> QueryBuilder {
    let mut query = QueryBuilder::new(select_jobs!(
        "where jobs.study = (select known.seq from studies as known where known.id = "
    ));
    query.push_bind(study.to_string()).push(") and ");
    filter.push(&mut query, "jobs.seq", after);
    filter.push_visible(&mut query);
    if let Some(state) = filter.state {
        query.push(" and jobs.state = ").push_bind(state.name());
    }
    for (key, value) in &filter.labels {
        query.push(" and exists (select 1 from job_labels as other where other.key = ");
        query.push_bind(key.clone()).push(" and other.value = ").push_bind(value.clone());
        query.push(" and other.job = jobs.seq)");
    }
    filter.order.push_end(&mut query, "jobs.seq", limit);
    query
}

/// The statement behind a listing, for a look at its plan.
#[cfg(test)]
pub(super) fn list_sql(filter: &Filter) -> String {
    list_query(filter, filter.order.start(), 1).sql().to_owned()
}
