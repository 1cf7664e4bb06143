//! Asking how a job is, with long polls.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;

use crate::http::app::App;
use crate::http::conditional::Wait;
use crate::http::jobs::view::{self, Job};
use crate::http::params::{JobPath, Query};
use crate::http::problems::refused;
use crate::http::problems::sets::JobProblems;
use crate::http::waiting::{self, Asked};
use crate::jobs::store::StoreError;
use crate::jobs::{JobId, JobRecord};
use crate::problem::Problem;

/// Ask how a job is
///
/// With `Prefer: wait=N` the answer is held back for at most N s: until the job differs from
/// `If-None-Match` (304 if it never does), or without that field until the job is finished.
#[utoipa::path(
    get, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "get_job",
    params(
        ("id" = String, Path, format = "uuid", description = "Name of the job"),
        ("If-None-Match" = Option<String>, Header, description = "Tag of the job as known"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`, at most 60"),
    ),
    responses(
        (status = 200, description = "The job", body = Job,
            headers(("ETag" = String, description = "Tag of the job"))),
        (status = 304, description = "The job is as known"),
        JobProblems
    )
)]
pub(crate) async fn get(
    State(app): State<App>,
    JobPath(id): JobPath,
    query: Query,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    query.finish()?;
    let asked = Asked::of(&headers);
    let answered = async {
        let record = wait_until(&app, id, asked.wait(), |job| asked.settles(job)).await?;
        let whole = async {
            let job = view::whole(&app, &record).await?;
            Ok(view::response(StatusCode::OK, &record, &job))
        };
        asked.answer(&record, whole).await
    };
    answered.await.map_err(|error| refused(error, id))
}

/// Waits until a job is as wished, the time is over, or the server stops; the job as it is then.
pub(crate) async fn wait_until(
    app: &App,
    id: JobId,
    wait: Wait,
    wished: impl Fn(&JobRecord) -> bool,
) -> Result<JobRecord, StoreError> {
    let store = &app.shared.store;
    let read = move || async move { store.get(id).await?.ok_or(StoreError::NoJob) };
    waiting::wait_until(app, wait, store.subscribe(id), read, wished).await
}
