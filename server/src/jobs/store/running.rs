//! What is written about a running job: its lease and progress, and its end. Each write names the attempt, and changes
//! nothing where another one holds the job.

use super::db::{Transaction, query};
use super::exports::insert_beforehand;
use super::studies::runs;
use super::submit::to_json;
use super::{Store, StoreError, micros};
use crate::exports::NewExport;
use crate::jobs::{ArtifactRecord, JobId, JobProgress, Lease, State};
use crate::studies::{Facts, Outcome};

/// The renewal of a lease.
pub(super) struct Renewed {
    pub(super) lease: Lease,
    /// Progress as JSON, where there is any.
    pub(super) news: Option<String>,
}

impl Renewed {
    /// Records it; whether a client has cancelled the job.
    pub(super) async fn record(&self, store: &Store, tx: &mut Transaction<'_>) -> Result<bool, StoreError> {
        let now = store.now_us();
        let row = query(
            "update jobs set lease_expires_at = ?1, progress = coalesce(?2, progress),
                 version = version + case when ?2 is null then 0 else 1 end,
                 updated_at = case when ?2 is null then updated_at else ?3 end
             where seq = ?4 and attempt = ?5 and state = 'running' returning cancel_requested",
        )
        .bind(now.saturating_add(micros(store.limits().lease)))
        .bind(&self.news)
        .bind(now)
        .bind(self.lease.seq)
        .bind(self.lease.attempt)
        .fetch_optional(tx)
        .await?;
        Ok(row.ok_or(StoreError::LeaseLost)?.try_get("cancel_requested")?)
    }
}

/// The end of a run with a result.
pub(super) struct Success {
    pub(super) lease: Lease,
    pub(super) artifact: ArtifactRecord,
    pub(super) progress: JobProgress,
    pub(super) facts: Facts,
    pub(super) postprocess: Vec<NewExport>,
}

impl Success {
    /// Records it; the jobs that the stop rule of the study has cancelled because of it.
    pub(super) async fn record(
        &self,
        store: &Store,
        tx: &mut Transaction<'_>,
    ) -> Result<Vec<JobId>, StoreError> {
        let Self { lease, artifact, progress, facts, postprocess } = self;
        let now = store.now_us();
        let moved = query(
            "update jobs set state = 'succeeded', version = version + 1, finished_at = ?1, updated_at = ?1,
                 lease_expires_at = null, error = null, progress = ?4
             where seq = ?2 and attempt = ?3 and state = 'running' returning study, point, replicate",
        )
        .bind(now)
        .bind(lease.seq)
        .bind(lease.attempt)
        .bind(to_json(progress)?)
        .fetch_optional(&mut *tx)
        .await?;
        let Some(moved) = moved else { return self.recorded_before(tx).await };
        query(
            "insert into artifacts (job, attempt, path, bytes, sha256, report, format_revision, format_lengths, owner)
             values (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, (select owner from jobs where seq = ?1))",
        )
        .bind(lease.seq)
        .bind(lease.attempt)
        .bind(&artifact.path)
        .bind(artifact.bytes.cast_signed())
        .bind(&artifact.sha256)
        .bind(to_json(&artifact.report)?)
        .bind(artifact.format_revision)
        .bind(to_json(&artifact.format_lengths)?)
        .execute(&mut *tx)
        .await?;
        insert_beforehand(tx, lease.seq, postprocess, now).await?;
        runs::record(tx, &moved, Outcome::Succeeded, facts, now).await
    }

    /// Whether the same result is recorded already, as when the connection to the database went between a commit and
    /// its answer. A caller that heard of a lost lease would remove the file that is recorded.
    async fn recorded_before(&self, tx: &mut Transaction<'_>) -> Result<Vec<JobId>, StoreError> {
        let Self { lease, artifact, .. } = self;
        query("select 1 from artifacts where job = ?1 and attempt = ?2 and path = ?3 and sha256 = ?4")
            .bind(lease.seq)
            .bind(lease.attempt)
            .bind(&artifact.path)
            .bind(&artifact.sha256)
            .fetch_optional(&mut *tx)
            .await?
            .map(|_| Vec::new())
            .ok_or(StoreError::LeaseLost)
    }
}

/// The end of a run without a result.
pub(super) struct Left {
    pub(super) lease: Lease,
    pub(super) to: State,
    /// The failure as JSON.
    pub(super) error: Option<String>,
    /// How the study counts the run.
    pub(super) run: Option<(Outcome, Facts)>,
}

impl Left {
    /// Records it; the jobs that the stop rule of the study has cancelled because of it.
    pub(super) async fn record(
        &self,
        store: &Store,
        tx: &mut Transaction<'_>,
    ) -> Result<Vec<JobId>, StoreError> {
        let now = store.now_us();
        let moved = query(
            "update jobs set state = ?1, version = version + 1, updated_at = ?2, lease_expires_at = null,
                 error = ?3,
                 finished_at = case when ?1 = 'queued' then null else ?2 end,
                 started_at = case when ?1 = 'queued' then null else started_at end,
                 progress = case when ?1 = 'queued' then null else progress end,
                 attempt = attempt + case when ?1 = 'queued' and (worker <> '' or ?6) then 1 else 0 end,
                 max_attempts = max_attempts
                     + case when ?1 = 'queued' and (worker <> '' or ?6) then 1 else 0 end
             where seq = ?4 and attempt = ?5 and state = 'running' returning study, point, replicate",
        )
        .bind(self.to.name())
        .bind(now)
        .bind(&self.error)
        .bind(self.lease.seq)
        .bind(self.lease.attempt)
        .bind(store.is_shared())
        .fetch_optional(&mut *tx)
        .await?
        .ok_or(StoreError::LeaseLost)?;
        match &self.run {
            Some((outcome, facts)) => runs::record(tx, &moved, *outcome, facts, now).await,
            None => Ok(Vec::new()),
        }
    }
}
