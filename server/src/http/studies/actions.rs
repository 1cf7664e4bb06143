//! What a client may do to a study as a whole: cancel, retry, delete.

use std::collections::HashMap;

use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse as _, Response};

use crate::accounts::Caller;
use crate::http::app::App;
use crate::http::conditional::target;
use crate::http::params::values::RetriedStates;
use crate::http::params::{IdPath, NoParameters, Query, StudyPath, parameters};
use crate::http::problems::refused;
use crate::http::studies::view;
use crate::jobs::store::StudyState;
use crate::problem::Problem;
use crate::tasks;

/// Cancel a study
///
/// Waiting jobs are cancelled at once; running ones are asked to stop, and do within two seconds.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/studies/{id}/cancel", tag = "studies", operation_id = "cancel_study",
    params(
        StudyPath,
        ("If-Match" = Option<String>, Header, description = "Tag of the study; nothing is done if it has changed since"),
    ),
    responses(
        (status = 200, description = "The study is finished", body = view::Study),
        (status = 202, description = "Its last jobs were asked to stop", body = view::Study),
        crate::http::problems::sets::ActionProblems
    )
))]
pub(crate) async fn cancel(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    IdPath(id): StudyPath,
    _: Query<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let study =
        app.shared.store.cancel_study(target(id, &headers)).await.map_err(|error| refused(error, id))?;
    let status = match study.state() {
        StudyState::Finished => StatusCode::OK,
        StudyState::Open => StatusCode::ACCEPTED,
    };
    tracing::info!(study_id = %id, "cancel asked for");
    view::response(&app, &caller, status, &study, false).await.map_err(|error| refused(error, id))
}

parameters! {
    /// What of a study is retried.
    #[derive(Debug)]
    pub(crate) struct RetryParameters {
        /// In which states: `failed`, `cancelled`, or both, separated by a comma.
        state: RetriedStates,
    }
}

/// Retry what failed of a study
///
/// Its failed jobs, with `state=failed,cancelled` the cancelled ones too, go back to the queue as their next attempts,
/// with their attempts renewed; their earlier runs leave the table. Where there are none, the study stays as it is.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/studies/{id}/retry", tag = "studies", operation_id = "retry_study",
    params(
        StudyPath,
        ("If-Match" = Option<String>, Header, description = "Tag of the study; nothing is done if it has changed since"),
        RetryParameters,
    ),
    responses(
        (status = 200, description = "The study, whose jobs wait again", body = view::Study),
        crate::http::problems::sets::StudyRetryProblems
    )
))]
pub(crate) async fn retry(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    IdPath(id): StudyPath,
    Query(RetryParameters { state: RetriedStates(states) }): Query<RetryParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (study, retried) = app
        .shared
        .store
        .retry_study(target(id, &headers), states)
        .await
        .map_err(|error| refused(error, id))?;
    // As for a single job: who retries wants a new start.
    let until = retried.iter().map(|(job, attempt)| (job.to_string(), attempt - 1)).collect();
    remove_checkpoints(&app, until).await;
    tracing::info!(study_id = %id, jobs = retried.len(), "retried");
    view::response(&app, &caller, StatusCode::OK, &study, false).await.map_err(|error| refused(error, id))
}

/// Delete a finished study with its jobs and their results
///
/// The answer does not wait until the files of ten thousand results have left the disk.
#[cfg_attr(test, utoipa::path(
    delete, path = "/v1/studies/{id}", tag = "studies", operation_id = "delete_study",
    params(
        StudyPath,
        ("If-Match" = Option<String>, Header, description = "Tag of the study; nothing is done if it has changed since"),
    ),
    responses(
        (status = 204, description = "The study and its jobs are gone"),
        crate::http::problems::sets::ActionProblems
    )
))]
pub(crate) async fn delete(
    State(app): State<App>,
    IdPath(id): StudyPath,
    _: Query<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let removed =
        app.shared.store.delete_study(target(id, &headers)).await.map_err(|error| refused(error, id))?;
    tracing::info!(study_id = %id, jobs = removed.len(), "deleted");
    remove_checkpoints(&app, removed.iter().map(|job| (job.id.to_string(), i64::MAX)).collect()).await;
    let artifacts = app.shared.artifacts.clone();
    // Nothing refers to them any more: should the server stop meanwhile, the rest is swept at the next start.
    let files = removed.into_iter().flat_map(|job| job.files).collect();
    tasks::spawn(async move { artifacts.discard(files).await });
    Ok(StatusCode::NO_CONTENT.into_response())
}

/// Removes checkpoints of these jobs up to those of the attempt named, on a thread that may block; what fails is
/// logged there, and swept later.
async fn remove_checkpoints(app: &App, until_attempt: HashMap<String, i64>) {
    let checkpoints = app.shared.checkpoints.clone();
    let _ = tasks::blocking(move || checkpoints.remove_all(&until_attempt)).await;
}
