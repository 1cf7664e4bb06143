//! Submitting a job.

use axum::Extension;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use bytes::Bytes;
use jiff::Timestamp;
use packstone_engine::{Limits, Plan};

use crate::http::app::{App, LARGE_BODY_BYTES};
use crate::http::body;
use crate::http::conditional::Wait;
use crate::http::jobs::get::wait_until;
use crate::http::jobs::view::{self, Job};
use crate::http::observe::Caller;
use crate::http::openapi;
use crate::http::params::Query;
use crate::http::problems::refused;
use crate::http::problems::sets::SubmitProblems;
use crate::http::response::set;
use crate::http::storage::check_room;
use crate::http::submission::{content_sha256, idempotency_key};
use crate::http::waiting::PREFERENCE_APPLIED;
use crate::jobs::store::{IdempotencyKey, NewJob, Submitted};
use crate::jobs::{JobRequest, request};
use crate::problem::{Kind, Problem};
use crate::storage::Storage;
use crate::strict_json;

/// Submit a job, or ask what one would amount to
///
/// The answer comes once the job is safe on disk. With `dry_run=true` nothing is stored, and the
/// answer is the plan: expected grains, fractions, memory, and whether the mix can fit at all.
#[utoipa::path(
    post, path = "/v1/jobs", tag = "jobs", operation_id = "submit_job",
    params(
        ("dry_run" = Option<bool>, Query, description = "Only plan: store and run nothing"),
        ("Idempotency-Key" = Option<String>, Header, pattern = "^[!-~]{1,255}$", description = "1 to 255 visible ASCII characters. The same key and body give the same job, however often they are sent; the key lives as long as its job"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: answer when the job is finished, or after N s (at most 60)"),
    ),
    request_body(content = JobRequest, content_type = "application/json"),
    responses(
        (status = 201, description = "The job was taken in; or, after a wait, it is finished", body = Job,
            headers(("Location" = String, description = "Path of the job"), ("ETag" = String, description = "Tag of the job"))),
        (status = 200, description = "With `dry_run=true` the plan; else the job that the same Idempotency-Key brought before",
            body = openapi::JobOrPlan),
        SubmitProblems
    )
)]
pub(crate) async fn submit(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    mut query: Query,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let dry_run = query.flag("dry_run");
    query.finish()?;
    let key = idempotency_key(&headers)?;
    let wait = Wait::of(&headers);
    let bytes = body::json_bytes(&app, &headers, body).await?;
    let Submission { request, plan, body_sha256 } = read(&app, bytes, dry_run).await?;
    if dry_run {
        return Ok(axum::Json(plan).into_response());
    }
    let owner = caller.0;
    check_room(&app, &owner, Storage::bytes_of_result(plan.grains)).await?;
    let idempotency_key = key.map(|key| IdempotencyKey { scope: owner.clone(), key, body_sha256 });
    let submitted =
        app.shared.store.submit(NewJob { request, warnings: plan.warnings, owner, idempotency_key }).await?;
    let (mut record, status) = match submitted {
        Submitted::Created(record) => {
            tracing::info!(job_id = %record.id, grains = plan.grains, "taken in");
            app.shared.metrics.job_submitted();
            (record, StatusCode::CREATED)
        }
        Submitted::Existing(record) => (record, StatusCode::OK),
    };
    if let Some(wait) = wait {
        let id = record.id;
        record = wait_until(&app, id, wait, |job| job.state.is_finished())
            .await
            .map_err(|error| refused(error, id))?;
    }
    let job = view::whole(&app, &record).await.map_err(|error| refused(error, record.id))?;
    let mut response = view::response(status, &record, &job);
    set(&mut response, header::LOCATION, &view::path(&record));
    if let Some(wait) = wait {
        set(&mut response, PREFERENCE_APPLIED, &wait.applied());
    }
    Ok(response)
}

struct Submission {
    request: JobRequest,
    plan: Plan,
    body_sha256: String,
}

/// Reads and plans a submission. Large ones are put aside, so that they do not hold up answers to
/// others, and few at a time.
async fn read(app: &App, bytes: Bytes, dry_run: bool) -> Result<Submission, Problem> {
    let limits = app.shared.limits;
    if bytes.len() <= LARGE_BODY_BYTES {
        return read_now(&bytes, &limits, dry_run);
    }
    let Ok(_turn) = app.shared.large_bodies.acquire().await else {
        return Err(Problem::internal());
    };
    tokio::task::spawn_blocking(move || read_now(&bytes, &limits, dry_run)).await.unwrap_or_else(|error| {
        tracing::error!(%error, "a submission was not read to its end");
        Err(Problem::internal())
    })
}

fn read_now(bytes: &[u8], limits: &Limits, dry_run: bool) -> Result<Submission, Problem> {
    let value = strict_json::parse(bytes)?;
    let request = JobRequest::read(&value, request::draw_seed(), Some(Timestamp::now()))
        .map_err(|faults| Problem::fields(Kind::ValidationError, faults))?;
    let packing = request.packing();
    let mut plan = Plan::new(&packing, limits)?;
    request.check_postprocess(limits)?;
    if dry_run {
        plan = plan.with_proposal(&packing);
    }
    Ok(Submission { request, plan, body_sha256: content_sha256(value) })
}
