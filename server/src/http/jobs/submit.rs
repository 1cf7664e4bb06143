//! Submitting a job.

use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::Response;
use packstone_engine::Plan;

use crate::accounts::Caller;
use crate::exports::estimates;
use crate::http::app::App;
use crate::http::body::RequestBody;
use crate::http::conditional::Wait;
use crate::http::jobs::get::wait_until;
use crate::http::jobs::reading::{Submission, read};
use crate::http::jobs::view;
use crate::http::params::{NoParameters, Query};
use crate::http::problems::refused;
use crate::http::response::set;
use crate::http::storage::check_room;
use crate::http::submission::idempotency_key;
use crate::http::waiting::PREFERENCE_APPLIED;
use crate::jobs::store::{IdempotencyKey, NewJob, Submitted};
use crate::planning::Proposal;
use crate::problem::Problem;

/// Submit a job
///
/// The answer comes once the job is safe on disk. `POST /v1/plans` tells beforehand what a job amounts to.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/jobs", tag = "jobs", operation_id = "submit_job",
    params(
        ("Idempotency-Key" = Option<String>, Header, pattern = "^[!-~]{1,255}$", description = "1 to 255 visible ASCII characters. The same key and body give the same job, however often they are sent; the key lives as long as its job"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: answer when the job is finished, or after N s (at most 60)"),
    ),
    request_body(content = crate::jobs::JobRequest, content_type = "application/json"),
    responses(
        (status = 201, description = "The job was accepted; or, after a wait, it is finished", body = view::Job,
            headers(("Location" = String, description = "Path of the job"), ("ETag" = String, description = "Tag of the job"))),
        (status = 200, description = "The job that the same Idempotency-Key brought before", body = view::Job,
            headers(("Location" = String, description = "Path of the job"), ("ETag" = String, description = "Tag of the job"))),
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
    let Submission { request, plan, exports, body_sha256 } =
        read(&app, bytes, app.limits_of(&caller), Proposal::None).await?;
    let by = caller.by.clone();
    let stored_bytes = estimates::stored_bytes(&request, &plan, &exports);
    let idempotency_key = key.map(|key| IdempotencyKey { scope: by.owner.clone(), key, body_sha256 });
    if let Err(refused) = check_room(&app, &by.owner, stored_bytes).await {
        // The job of a repeated submission is there already and needs no more room.
        match &idempotency_key {
            Some(key) if app.shared.store.knows_job_key(key).await? => {}
            _ => return Err(refused),
        }
    }
    let Plan { warnings, estimated_time_s: forecast_s, keeps_checkpoints, most_threads, grains, .. } = plan;
    let new = NewJob { request, warnings, forecast_s, keeps_checkpoints, most_threads, by, idempotency_key };
    let submitted = app.shared.store.submit(new).await?;
    // The answer may be held back, and what was read is stored.
    drop(body);
    let (mut record, status) = match submitted {
        Submitted::Created(record) => {
            tracing::info!(job_id = %record.id, grains, "accepted");
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
    let job = view::whole(&app, &caller, &record, true).await.map_err(|error| refused(error, record.id))?;
    let mut response = view::response(&app, status, &record, job).await;
    set(&mut response, header::LOCATION, &view::path(&record));
    if let Some(wait) = wait {
        set(&mut response, PREFERENCE_APPLIED, &wait.applied());
    }
    Ok(response)
}
