//! A worker tells that an attempt has ended without a result.

use axum::Extension;
use axum::body::Body;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse as _, Response};

use super::{LeasePath, note_end, read, recorded, refused, remove_checkpoints, running};
use crate::accounts::Caller;
use crate::failure::{Failure, FailureCode};
use crate::http::app::App;
use crate::http::body;
use crate::http::params::{NoParameters, Query};
use crate::jobs::WaitReason;
use crate::problem::Problem;
use crate::workers::documents::{EndOutcome, EndRequest};

/// End a lease without a result
///
/// The job has failed, was cancelled, or goes back to the queue. A repeated request is answered as the first was.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/leases/{job}/{attempt}/end", tag = "workers", operation_id = "end_lease",
    params(LeasePath),
    request_body = EndRequest,
    responses(
        (status = 200, description = "The end is recorded", body = super::LeaseEnded),
        crate::http::problems::sets::LeaseEndProblems
    )
))]
pub(crate) async fn end(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    path: LeasePath,
    _: Query<NoParameters>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let request: EndRequest = read(body::json(&app, &headers, body).await?)?;
    let Some(lease) = running(&app, &caller.by.key, path).await? else {
        return Ok(recorded().into_response());
    };
    let store = &app.shared.store;
    let job = store.get(path.id).await?;
    let (outcome, ended) = match (request.outcome, request.failure) {
        (EndOutcome::Failed, Some(failure)) => {
            ("failed", store.fail(lease, &failure, request.facts.unwrap_or_default()).await)
        }
        (EndOutcome::Cancelled, _) => ("cancelled", store.finish_cancelled(lease).await),
        (EndOutcome::Released, _) => ("given_back", store.give_back(lease).await),
        (EndOutcome::Faulted | EndOutcome::Failed, failure) => {
            let is_memory = |failure: &Failure| failure.code == FailureCode::OutOfMemory;
            let why = match request.needed_bytes {
                Some(bytes) => app.shared.storage.why_it_waits(lease.id, bytes).await,
                None if failure.as_ref().is_some_and(is_memory) => WaitReason::memory(),
                None => WaitReason::machine(),
            };
            let requeued = store.requeue_after_fault(lease, why).await;
            if let (Ok(owner), Some(bytes)) = (&requeued, request.needed_bytes) {
                app.shared.storage.wait_for_room(owner, bytes).await;
            }
            ("requeued", requeued.map(drop))
        }
    };
    ended.map_err(|error| refused(&app, error))?;
    note_end(&app, path, outcome, job.and_then(|job| job.started_at));
    if matches!(request.outcome, EndOutcome::Failed | EndOutcome::Cancelled) {
        remove_checkpoints(&app, path);
    }
    Ok(recorded().into_response())
}
