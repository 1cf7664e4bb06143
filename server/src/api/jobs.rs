//! Submitting a job, and asking how it is.

use axum::Extension;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use bytes::Bytes;
use jiff::Timestamp;
use packstone_engine::{Limits, Plan};
use serde_json::Value;

use super::conditional::Wait;
use super::job_view::{self, Job, set};
use super::observe::Caller;
use super::openapi::{self, JobProblems, SubmitProblems};
use super::params::{JobPath, Query};
use super::problem::refused;
use super::waiting::{self, Asked, PREFERENCE_APPLIED};
use super::{App, LARGE_BODY_BYTES, body};
use crate::hex;
use crate::jobs::store::{IdempotencyKey, NewJob, StoreError, Submitted};
use crate::jobs::{JobId, JobRecord, JobRequest, request};
use crate::problem::{Fault, Kind, Problem};
use crate::strict_json;

const MAX_KEY_CHARS: usize = 255;

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
pub(super) async fn submit(
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
    let idempotency_key = key.map(|key| IdempotencyKey { scope: caller.0, key, body_sha256 });
    let submitted = app.shared.store.submit(NewJob { request, idempotency_key }).await?;
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
    let job = job_view::whole(&app, &record).await.map_err(|error| refused(error, record.id))?;
    let mut response = job_view::response(status, &record, &job);
    set(&mut response, header::LOCATION, &job_view::path(&record));
    if let Some(wait) = wait {
        set(&mut response, PREFERENCE_APPLIED, &wait.applied());
    }
    Ok(response)
}

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
pub(super) async fn get(
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
            let job = job_view::whole(&app, &record).await?;
            Ok(job_view::response(StatusCode::OK, &record, &job))
        };
        asked.answer(&record, whole).await
    };
    answered.await.map_err(|error| refused(error, id))
}

/// Waits until a job is as wished, the time is over, or the server stops; the job as it is then.
async fn wait_until(
    app: &App,
    id: JobId,
    wait: Wait,
    wished: impl Fn(&JobRecord) -> bool,
) -> Result<JobRecord, StoreError> {
    let store = &app.shared.store;
    let read = move || async move { store.get(id).await?.ok_or(StoreError::NoJob) };
    waiting::wait_until(app, wait, store.subscribe(id), read, wished).await
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

/// Digest of what a document says, whatever the order of its keys and its spaces.
pub(super) fn content_sha256(mut value: Value) -> String {
    value.sort_all_objects();
    hex::sha256(value.to_string().as_bytes())
}

/// The `Idempotency-Key`, if there is one.
pub(super) fn idempotency_key(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let Some(value) = headers.get("idempotency-key") else { return Ok(None) };
    let bytes = value.as_bytes();
    let visible = bytes.iter().all(u8::is_ascii_graphic);
    if !(1..=MAX_KEY_CHARS).contains(&bytes.len()) || !visible {
        let what =
            if visible { format!("has {} characters", bytes.len()) } else { "has other characters".into() };
        let bound =
            format!("{what}: must have at least 1 and at most {MAX_KEY_CHARS} visible ASCII characters");
        return Err(Problem::parameters(vec![Fault::header("Idempotency-Key", bound)]));
    }
    Ok(value.to_str().ok().map(str::to_owned))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_content_of_a_body_does_not_depend_on_its_form() {
        let digest = |value| content_sha256(value);
        assert_eq!(
            digest(json!({"a": {"b": 1, "c": 2}, "d": 3})),
            digest(json!({"d": 3, "a": {"c": 2, "b": 1}}))
        );
        assert_ne!(digest(json!({"a": 1})), digest(json!({"a": 2})));
    }

    #[test]
    fn keys_are_visible_and_bounded() {
        let key = |value: &str| {
            let mut headers = HeaderMap::new();
            headers.insert("idempotency-key", value.parse().unwrap());
            idempotency_key(&headers)
        };
        assert_eq!(idempotency_key(&HeaderMap::new()).unwrap(), None);
        assert_eq!(key("a-1").unwrap(), Some("a-1".into()));
        assert!(key(&"x".repeat(255)).is_ok());
        for bad in ["", "a b", &"x".repeat(256), "ü"] {
            let problem = key(bad).unwrap_err();
            assert_eq!((problem.status, problem.errors[0].header.as_deref()), (400, Some("Idempotency-Key")));
        }
    }
}
