//! Deleting finished jobs by a filter.

use std::time::Duration;

use axum::Extension;
use axum::extract::State;
use serde::Serialize;
use tokio::time::{Instant, sleep};

use crate::accounts::Caller;
use crate::http::app::App;
use crate::http::params::values::{Flag, Labels, Time};
use crate::http::params::{Query, choices, parameters};
use crate::jobs;
use crate::jobs::store::FinishedJobs;
use crate::jobs::sweeper::BATCH_PAUSE;
use crate::problem::{Fault, Problem};

/// A request deletes no longer than this, so that its answer comes before clients and proxies give up.
const MOST_TIME: Duration = Duration::from_secs(20);

choices! {
    /// How a job has ended.
    pub(crate) enum FinishedState {
        /// Its result is stored.
        Succeeded "succeeded",
        /// It ended without a result.
        Failed "failed",
        /// A client cancelled it, or it expired while it waited.
        Cancelled "cancelled",
    }
}

impl FinishedState {
    fn state(self) -> jobs::State {
        match self {
            Self::Succeeded => jobs::State::Succeeded,
            Self::Failed => jobs::State::Failed,
            Self::Cancelled => jobs::State::Cancelled,
        }
    }
}

parameters! {
    /// Finished jobs that are deleted together.
    #[derive(Clone, Debug)]
    pub(crate) struct DeletionParameters {
        /// Only jobs in this state.
        state: Option<FinishedState>,
        /// `key=value`; only jobs with this label; may be repeated, and then all must fit.
        label: Labels,
        /// RFC 3339 time; only jobs that ended before this time.
        before: Option<Time>,
        /// Only count the jobs.
        dry_run: Flag<false>,
    }
}

/// How many jobs were deleted.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct DeletedJobs {
    /// Jobs that were deleted; with `dry_run` those that would be.
    deleted: u64,
    /// Bytes of the results and exports that would be deleted; absent without `dry_run`.
    #[cfg_attr(test, schema(required = false, nullable = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    bytes: Option<u64>,
    /// Jobs were only counted.
    dry_run: bool,
    /// The time of the request was not enough for all jobs: repeat it.
    more: bool,
}

/// Delete finished jobs by a filter
///
/// Deletes the finished jobs that fit all of `state`, `label` and `before`, at least one of which must be given, with
/// their results and exports. Jobs of studies are left to their study, and jobs that wait or run stay. A key with the
/// role `admin` deletes the jobs of all owners, any other key those of its owner. Jobs are deleted a few at a time, for
/// at most 20 s; then `more` is true. `dry_run=true` counts them, and
/// what they take.
#[cfg_attr(test, utoipa::path(
    delete, path = "/v1/jobs", tag = "jobs", operation_id = "delete_jobs",
    params(DeletionParameters),
    responses(
        (status = 200, description = "How many jobs were deleted", body = DeletedJobs),
        crate::http::problems::sets::ListProblems
    )
))]
pub(crate) async fn delete(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    Query(query): Query<DeletionParameters>,
) -> Result<axum::Json<DeletedJobs>, Problem> {
    let DeletionParameters { state, label, before, dry_run } = query;
    if state.is_none() && label.0.is_empty() && before.is_none() {
        let detail = "is missing: at least one of state, label and before must be given";
        return Err(Problem::parameters(vec![Fault::parameter("state", detail)]));
    }
    let which = FinishedJobs {
        state: state.map(FinishedState::state),
        labels: label.0,
        finished_before: before.map(|time| time.0),
        owner: caller.sees_only(),
    };
    let store = &app.shared.store;
    if dry_run.get() {
        let (deleted, bytes) = store.count_matching(&which).await?;
        return Ok(axum::Json(DeletedJobs { deleted, bytes: Some(bytes), dry_run: true, more: false }));
    }
    let until = Instant::now() + MOST_TIME;
    let mut deleted = 0;
    let mut after = 0;
    let more = loop {
        let (removed, last) = store.remove_matching(&which, after).await?;
        let Some(last) = last else { break false };
        after = last;
        deleted += removed.len() as u64;
        app.shared.artifacts.discard(removed.into_iter().flat_map(|job| job.files).collect()).await;
        if Instant::now() >= until || app.shared.shutdown.is_cancelled() {
            break true;
        }
        sleep(BATCH_PAUSE).await;
    };
    tracing::info!(deleted, more, "deleted finished jobs by a filter");
    Ok(axum::Json(DeletedJobs { deleted, bytes: None, dry_run: false, more }))
}
