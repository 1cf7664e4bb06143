//! What is written about the end of a running job. Each write names the attempt, and changes
//! nothing where another one holds the job.

use super::bodies;
use super::db::{Transaction, either, query};
use super::exports::insert_beforehand;
use super::leased::LeasedTask;
use super::received::recorded_before;
use super::studies::runs;
use super::submit::to_json;
use super::{Store, StoreError};
use crate::exports::NewExport;
use crate::jobs::{ArtifactRecord, JobId, JobProgress, Lease, State};
use crate::studies::{Facts, Outcome};

/// Records the result of an attempt that runs. The end follows in one message: PostgreSQL takes both as one statement,
/// SQLite as one text.
macro_rules! insert_artifact {
    () => {
        "insert into artifacts (job, attempt, path, bytes, sha256, report, report_digest, format_revision,
             format_lengths, owner)
         select seq, attempt, ?5, ?6, ?7, ?8, ?11, ?9, ?10, owner from jobs
         where seq = ?2 and attempt = ?3 and state = 'running'"
    };
}

/// Ends an attempt that runs.
macro_rules! succeed {
    () => {
        "update jobs set state = 'succeeded', version = version + 1, finished_at = ?1, updated_at = ?1,
             lease_expires_at = null, error = null, progress = ?4
         where seq = ?2 and attempt = ?3 and state = 'running' returning study, point, replicate"
    };
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
        let (now, report) = (store.now_us(), to_json(&artifact.report)?);
        let moved = query(either(
            concat!(insert_artifact!(), "; ", succeed!()),
            concat!("with stored as (", insert_artifact!(), ") ", succeed!()),
        ))
        .bind(now)
        .bind(lease.seq)
        .bind(lease.attempt)
        .bind(to_json(progress)?)
        .bind(&artifact.path)
        .bind(artifact.bytes.cast_signed())
        .bind(&artifact.sha256)
        .bind(&report)
        .bind(artifact.format_revision)
        .bind(to_json(&artifact.format_lengths)?)
        .bind(bodies::digest(&report))
        .fetch_optional(&mut *tx)
        .await?;
        let Some(moved) = moved else {
            return recorded_before(*lease, artifact, tx).await.map(|()| Vec::new());
        };
        insert_beforehand(tx, lease.seq, postprocess, now).await?;
        runs::record(tx, &moved, facts.outcome_of_packing(), facts, now).await
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
        let Self { lease, to, error, run } = self;
        let moved = LeasedTask::from(*lease).leave(store, to.name(), error.as_deref(), tx).await?;
        match run {
            Some((outcome, facts)) => runs::record(tx, &moved, *outcome, facts, store.now_us()).await,
            None => Ok(Vec::new()),
        }
    }
}
