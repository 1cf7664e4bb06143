//! Changing a job: name, labels, priority, expiry and webhook, by a JSON merge patch (RFC 7396).

use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use jiff::Timestamp;

use crate::accounts::Caller;
use crate::failure::Failure;
use crate::http::app::App;
use crate::http::body::{PATCH_BYTES, RequestBody};
use crate::http::conditional::target;
use crate::http::jobs::view;
use crate::http::params::{IdPath, JobPath, NoParameters, Query};
use crate::http::problems::refused;
use crate::http::webhooks;
use crate::jobs::request::{Change, JobPatch};
use crate::problem::Problem;

/// Change a job
///
/// A JSON merge patch (RFC 7396): absent fields stay, `null` removes a name, an expiry, a label or a `webhook_url`.
/// The priority can be changed while the job waits. A changed `webhook_url` counts for the next end of the job. The
/// request of the job stays as it was submitted.
#[cfg_attr(test, utoipa::path(
    patch, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "patch_job",
    params(
        JobPath,
        ("If-Match" = Option<String>, Header,
            description = "Tag of the job; the change is made only if the job still has it"),
    ),
    request_body(content = JobPatch, content_type = "application/merge-patch+json"),
    responses(
        (status = 200, description = "The job after the change", body = view::Job,
            headers(("ETag" = String, description = "Tag of the job"))),
        crate::http::problems::sets::PatchProblems
    )
))]
pub(crate) async fn patch(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    IdPath(id): JobPath,
    _: Query<NoParameters>,
    headers: HeaderMap,
    mut body: RequestBody,
) -> Result<Response, Problem> {
    let value = body.json(&app, PATCH_BYTES).await?;
    let patch = JobPatch::read(&value, Timestamp::now()).map_err(Failure::invalid)?;
    if let Change::Set(url) = &patch.webhook_url {
        webhooks::check(&app.shared.webhook_rules, Some(url))?;
        if app.shared.store.get(id).await?.is_some_and(|job| job.study.is_some()) {
            return Err(webhooks::of_a_study().into());
        }
    }
    let changed = app.shared.store.patch(target(id, &headers), patch).await;
    let record = changed.map_err(|error| refused(error, id))?;
    tracing::info!(job_id = %id, "changed");
    let job = view::whole(&app, &caller, &record, false).await.map_err(|error| refused(error, id))?;
    Ok(view::response(&app, StatusCode::OK, &record, job).await)
}
