//! Submitting a study.

use std::sync::Arc;

use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::Response;
use bytes::Bytes;
use jiff::Timestamp;
use packstone_engine::Limits;
use serde_json::Value;

use crate::accounts::Caller;
use crate::failure::Failure;
use crate::http::app::App;
use crate::http::body::RequestBody;
use crate::http::conditional::Wait;
use crate::http::params::{NoParameters, Query};
use crate::http::problems::refused;
use crate::http::response::set;
use crate::http::storage::check_room;
use crate::http::studies::get::wait_until;
use crate::http::studies::view;
use crate::http::submission::{content_sha256, idempotency_key, read_apart};
use crate::http::waiting::PREFERENCE_APPLIED;
use crate::http::webhooks;
use crate::jobs::request;
use crate::jobs::store::{IdempotencyKey, NewStudy, StudyState, SubmittedStudy};
use crate::planning::Planner;
use crate::problem::Problem;
use crate::strict_json;
use crate::studies::Study;

/// Submit a study: many jobs at once
///
/// Either a `list` of jobs, or a `template` with a `grid` of values for some of its fields, of which every
/// combination is a point, and a `zip` of values that run together; each point is packed `replicates` times. All jobs
/// are accepted or none, and the answer comes once they are safe on disk. A fault points to the entry of the request
/// that brought it, and names the point.
///
/// Seeds: the job of replicate `r` of a point has as seed the first 53 bits of the SHA-256 of the UTF-8 text made of
/// one line each for the study's `seed`, then for every column that is not at or below `/method`, in order, its
/// pointer, `=` and its value as compact JSON, and last `r` (without an end of line). For a list the job's index stands
/// for the columns, and a job that names its own seed keeps it while `replicates` is 1. So points that differ in their
/// method pack the same grains, and a study that is refined keeps the packings it had.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/studies", tag = "studies", operation_id = "submit_study",
    params(
        ("Idempotency-Key" = Option<String>, Header, pattern = "^[!-~]{1,255}$", description = "1 to 255 visible ASCII characters. The same key and body give the same study, however often they are sent; the key lives as long as its study. Keys of jobs are others"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: answer when the study is finished, or after N s (at most 60)"),
    ),
    request_body(content = Study, content_type = "application/json"),
    responses(
        (status = 201, description = "The study was accepted; or, after a wait, it is finished", body = view::Study,
            headers(("Location" = String, description = "Path of the study"), ("ETag" = String, description = "Tag of the study"))),
        (status = 200, description = "The study that the same Idempotency-Key brought before", body = view::Study),
        crate::http::problems::sets::SubmitProblems
    )
))]
pub(crate) async fn submit(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    _: Query<NoParameters>,
    headers: HeaderMap,
    mut body: RequestBody,
) -> Result<Response, Problem> {
    let key = idempotency_key(&headers)?;
    let wait = Wait::of(&headers);
    let bytes = body.read(app.shared.max_body_bytes).await?;
    let Submission { study, request, body_sha256 } = read(&app, bytes, app.limits_of(&caller)).await?;
    let by = caller.by.clone();
    let idempotency_key = key.map(|key| IdempotencyKey { scope: by.owner.clone(), key, body_sha256 });
    if let Err(refused) = check_room(&app, &by.owner, study.stored_bytes()).await {
        // The study of a repeated submission is there already and needs no more room.
        match &idempotency_key {
            Some(key) if app.shared.store.knows_study_key(key).await? => {}
            _ => return Err(refused),
        }
    }
    let submitted = app.shared.store.submit_study(NewStudy { study, request, by, idempotency_key }).await?;
    // The answer may be held back, and what was read is stored.
    drop(body);
    let (mut record, status) = match submitted {
        SubmittedStudy::Created(record) => {
            tracing::info!(study_id = %record.id, jobs = record.jobs(), "accepted");
            app.shared.metrics.study_submitted(record.jobs());
            (record, StatusCode::CREATED)
        }
        SubmittedStudy::Existing(record) => (record, StatusCode::OK),
    };
    let id = record.id;
    let answered = async {
        if let Some(wait) = wait {
            record = wait_until(&app, id, wait, |study| study.state() == StudyState::Finished).await?;
        }
        view::response(&app, &caller, status, &record, true).await
    };
    let mut response = answered.await.map_err(|error| refused(error, id))?;
    set(&mut response, header::LOCATION, &view::path(id));
    if let Some(wait) = wait {
        set(&mut response, PREFERENCE_APPLIED, &wait.applied());
    }
    Ok(response)
}

struct Submission {
    study: Study,
    request: Value,
    body_sha256: String,
}

/// Reads and expands a submission: off the threads that answer and few at a time, for a short request may
/// stand for ten thousand jobs.
async fn read(app: &App, bytes: Bytes, limits: Limits) -> Result<Submission, Problem> {
    let shared = Arc::clone(&app.shared);
    let submission = read_apart(app, move |go_on| read_now(&bytes, &limits, &shared.planner, go_on)).await?;
    webhooks::check(&app.shared.webhook_rules, submission.study.webhook_url.as_ref())?;
    Ok(submission)
}

fn read_now(
    bytes: &[u8],
    limits: &Limits,
    planner: &Planner,
    go_on: &dyn Fn() -> bool,
) -> Result<Submission, Failure> {
    let value = strict_json::parse(bytes)?;
    let (seed, now) = (request::draw_seed(), Some(Timestamp::now()));
    let study = Study::read_while(&value, seed, now, limits, planner, go_on)?;
    Ok(Submission { request: study.recorded(&value), study, body_sha256: content_sha256(value) })
}
