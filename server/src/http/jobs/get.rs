//! The state of a job, with long polls, and its request.

use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;

use crate::accounts::Caller;
use crate::http::app::App;
use crate::http::conditional::Wait;
use crate::http::jobs::polled::RECENT;
use crate::http::jobs::view;
use crate::http::params::values::Flag;
use crate::http::params::{IdPath, JobPath, NoParameters, Query, choices, parameters};
use crate::http::problems::refused;
use crate::http::response::{is_long, json};
use crate::http::waiting::{self, Asked};
use crate::jobs::store::StoreError;
use crate::jobs::{self, JobId, JobRecord};
use crate::problem::Problem;

choices! {
    /// What a job or a study has besides, where it is asked for.
    pub(crate) enum Include {
        /// Its request, with the defaults filled in.
        Request "request",
    }
}

parameters! {
    /// What the answer has besides.
    #[derive(Debug)]
    pub(crate) struct IncludeParameters {
        /// What the answer has besides.
        include: Option<Include>,
    }
}

parameters! {
    /// What the answer about a job has besides.
    #[derive(Debug)]
    pub(crate) struct JobParameters {
        /// The job has its `overview`: what the request packs, in a few words.
        overview: Flag<false>,
        ..include: IncludeParameters,
    }
}

impl IncludeParameters {
    /// Whether the request is asked for.
    pub(crate) fn with_request(&self) -> bool {
        self.include == Some(Include::Request)
    }
}

/// Get a job
///
/// With `Prefer: wait=N` the answer is held back for at most N s: until the job differs from `If-None-Match` (304 if it
/// never does), or without that field until the job is finished. The request, which may be long, is left out unless
/// `include=request` asks for it; it is at `/v1/jobs/{id}/request`, too.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "get_job",
    params(
        JobPath,
        JobParameters,
        ("If-None-Match" = Option<String>, Header, description = "Tag of the job as known"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`, at most 60"),
    ),
    responses(
        (status = 200, description = "The job", body = view::Job,
            headers(("ETag" = String, description = "Tag of the job"))),
        (status = 304, description = "The job is as known"),
        crate::http::problems::sets::JobProblems
    )
))]
pub(crate) async fn get(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    IdPath(id): JobPath,
    Query(query): Query<JobParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let asked = Asked::of(&headers);
    let answered = Box::pin(async {
        let record = wait_until(&app, id, asked.wait(), |job| asked.settles(job)).await?;
        if record.state == jobs::State::Running && !record.worker.is_empty() {
            app.shared.polled.note(id, RECENT);
        }
        let whole = Box::pin(async {
            let mut job = view::whole(&app, &caller, &record, query.include.with_request()).await?;
            if query.overview.get() {
                job.set_overview(record.overview.clone());
            }
            Ok(view::response(&app, StatusCode::OK, &record, job).await)
        });
        asked.answer(&record, whole).await
    });
    answered.await.map_err(|error| refused(error, id))
}

/// Get the request of a job
///
/// As submitted, with its defaults and its seed filled in, but without its `webhook_url`: submitted again, it gives the
/// same packing.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/jobs/{id}/request", tag = "jobs", operation_id = "get_job_request",
    params(JobPath),
    responses(
        (status = 200, description = "The request", body = jobs::JobRequest),
        crate::http::problems::sets::JobProblems
    )
))]
pub(crate) async fn request(
    State(app): State<App>,
    IdPath(id): JobPath,
    _: Query<NoParameters>,
) -> Result<Response, Problem> {
    let store = &app.shared.store;
    let found = async {
        let record = store.get(id).await?.ok_or(StoreError::NoJob)?;
        store.request(record.seq).await
    };
    let request = found.await.map_err(|error| refused(error, id))?;
    let is_long = is_long(&request);
    Ok(json(&app, StatusCode::OK, request, is_long).await)
}

/// Waits until a job is in the awaited state, the time is over, or the server stops; the job as it is then.
pub(crate) async fn wait_until(
    app: &App,
    id: JobId,
    wait: Wait,
    reached: impl Fn(&JobRecord) -> bool,
) -> Result<JobRecord, StoreError> {
    let store = &app.shared.store;
    let read = move || async move { store.get(id).await?.ok_or(StoreError::NoJob) };
    waiting::wait_until(app, wait, store.subscribe(id), read, reached).await
}
