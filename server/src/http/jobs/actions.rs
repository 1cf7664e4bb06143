//! What a client may do to a job: cancel, finish, retry, delete.

use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse as _, Response};

use crate::accounts::Caller;
use crate::http::app::App;
use crate::http::conditional::target;
use crate::http::jobs::view;
use crate::http::params::{IdPath, JobPath, NoParameters, Query};
use crate::http::problems::refused;
use crate::jobs::store::Cancelled;
use crate::jobs::{JobId, JobRecord};
use crate::problem::Problem;
use crate::tasks;

/// Cancel a job
///
/// A waiting job is cancelled at once; a running one is asked to stop, and does within two seconds.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/jobs/{id}/cancel", tag = "jobs", operation_id = "cancel_job",
    params(
        JobPath,
        ("If-Match" = Option<String>, Header, description = "Tag of the job; nothing is done if it has changed since"),
    ),
    responses(
        (status = 200, description = "The job is cancelled", body = view::Job),
        (status = 202, description = "The job was asked to stop", body = view::Job),
        crate::http::problems::sets::ActionProblems
    )
))]
pub(crate) async fn cancel(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    IdPath(id): JobPath,
    _: Query<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let cancelled =
        app.shared.store.cancel(target(id, &headers)).await.map_err(|error| refused(error, id))?;
    let (job, status) = match cancelled {
        Cancelled::Now(job) => {
            // It may have waited for its next attempt.
            remove_checkpoints(&app, id, job.attempt).await;
            (job, StatusCode::OK)
        }
        Cancelled::Soon(job) => (job, StatusCode::ACCEPTED),
    };
    tracing::info!(job_id = %id, state = job.state.name(), "cancel asked for");
    shown(&app, &caller, &job, status).await
}

/// End a run with the packing that it has reached
///
/// The job succeeds within 5 s, beside the time that the check of the packing takes, whatever its `on_limit` says.
/// `summary.partial` of the result tells how far the run came; it is absent where the packing was complete already.
/// The same request once more changes nothing. 409 where nothing can be kept: the job waits, has no grain yet, or has
/// ended.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/jobs/{id}/finish", tag = "jobs", operation_id = "finish_job",
    params(
        JobPath,
        ("If-Match" = Option<String>, Header, description = "Tag of the job; nothing is done if it has changed since"),
    ),
    responses(
        (status = 202, description = "The run was asked to end", body = view::Job),
        (status = 200, description = "The run was asked before, and the job has its result", body = view::Job),
        crate::http::problems::sets::ActionProblems
    )
))]
pub(crate) async fn finish(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    IdPath(id): JobPath,
    _: Query<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = app.shared.store.finish(target(id, &headers)).await.map_err(|error| refused(error, id))?;
    tracing::info!(job_id = %id, state = job.state.name(), "asked to end with what is reached");
    let status = if job.state.is_finished() { StatusCode::OK } else { StatusCode::ACCEPTED };
    shown(&app, &caller, &job, status).await
}

/// Retry a job that failed, was cancelled, or whose stored result is damaged
///
/// It goes back to the queue as its next attempt, with its attempts renewed.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/jobs/{id}/retry", tag = "jobs", operation_id = "retry_job",
    params(
        JobPath,
        ("If-Match" = Option<String>, Header, description = "Tag of the job; nothing is done if it has changed since"),
    ),
    responses(
        (status = 200, description = "The job waits again", body = view::Job),
        crate::http::problems::sets::RetryProblems
    )
))]
pub(crate) async fn retry(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    IdPath(id): JobPath,
    _: Query<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = app
        .shared
        .store
        .retry(target(id, &headers), damaged_result(&app, id).await?)
        .await
        .map_err(|error| refused(error, id))?;
    // Its ended attempts took theirs along, unless the server stopped during the last of them. Who
    // retries wants a new start, which an attempt that is faster than this may miss: then it goes on.
    remove_checkpoints(&app, id, job.attempt - 1).await;
    tracing::info!(job_id = %id, attempt = job.attempt, "retried");
    shown(&app, &caller, &job, StatusCode::OK).await
}

/// The path of the job's result, if the file is missing or not what was stored.
async fn damaged_result(app: &App, id: JobId) -> Result<Option<String>, Problem> {
    let job = app.shared.store.get(id).await.map_err(|error| refused(error, id))?;
    let Some(artifact) = job.and_then(|job| job.artifact) else { return Ok(None) };
    let artifacts = app.shared.artifacts.clone();
    let path = artifact.path.clone();
    let damaged = tasks::blocking(move || artifacts.is_damaged(&artifact)).await;
    Ok(damaged.unwrap_or(false).then_some(path))
}

/// Delete a finished job, its result, and what was made of it
#[cfg_attr(test, utoipa::path(
    delete, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "delete_job",
    params(
        JobPath,
        ("If-Match" = Option<String>, Header, description = "Tag of the job; nothing is done if it has changed since"),
    ),
    responses((status = 204, description = "The job is gone"), crate::http::problems::sets::ActionProblems)
))]
pub(crate) async fn delete(
    State(app): State<App>,
    IdPath(id): JobPath,
    _: Query<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let files = app.shared.store.delete(target(id, &headers)).await.map_err(|error| refused(error, id))?;
    app.shared.artifacts.discard(files).await;
    remove_checkpoints(&app, id, i64::MAX).await;
    tracing::info!(job_id = %id, "deleted");
    Ok(StatusCode::NO_CONTENT.into_response())
}

/// Files are removed on a thread that may block; what fails is logged there, and swept later.
async fn remove_checkpoints(app: &App, id: JobId, until_attempt: i64) {
    let checkpoints = app.shared.checkpoints.clone();
    let _ = tasks::blocking(move || checkpoints.remove(&id.to_string(), until_attempt)).await;
}

async fn shown(
    app: &App,
    caller: &Caller,
    record: &JobRecord,
    status: StatusCode,
) -> Result<Response, Problem> {
    let job = view::whole(app, caller, record, false).await.map_err(|error| refused(error, record.id))?;
    Ok(view::response(app, status, record, job).await)
}
