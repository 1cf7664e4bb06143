//! A worker tells that an attempt has ended without a result.

use std::time::Duration;

use axum::Extension;
use axum::extract::State;
use axum::response::{IntoResponse as _, Response};
use jiff::Timestamp;
use packstone_engine::FieldError;

use super::{LeasePath, export, lost, note_end, read, recorded, refused, remove_checkpoints};
use crate::accounts::Caller;
use crate::artifacts::receive::most_bytes_of_result;
use crate::failure::{Failure, FailureCode};
use crate::http::app::App;
use crate::http::body::RequestBody;
use crate::http::params::{NoParameters, Query};
use crate::jobs::store::{Held, StoreError};
use crate::jobs::{JobRecord, Lease, WaitReason};
use crate::metrics::LeaseEvent;
use crate::problem::Problem;
use crate::studies::Facts;
use crate::workers::checks::checking;
use crate::workers::claims::{self, Attempt, Claim};
use crate::workers::documents::{EndOutcome, EndRequest};
use crate::workers::here::run_limit_s;

/// Longest body: a failure with its figures and at most 101 faults.
const MAX_BODY_BYTES: u64 = 1 << 20;

/// End a lease without a result
///
/// The job has failed, was cancelled, or goes back to the queue; or the export. A failure must be one that a worker can
/// know; one that follows from the request of a job is verified before the job fails. A repeated request is answered as
/// the first was.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/leases/{task}/{attempt}/end", tag = "workers", operation_id = "end_lease",
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
    mut body: RequestBody,
) -> Result<Response, Problem> {
    let request: EndRequest = read(body.json(&app, MAX_BODY_BYTES).await?)?;
    let store = &app.shared.store;
    let lease = match store.held(&caller.by.key, path.id, path.attempt).await? {
        Held::Running { lease, .. } => lease,
        Held::RunningExport(lease) => return export::end(&app, lease, request).await,
        Held::Ended => return Ok(recorded().into_response()),
        Held::Lost => return Err(refused(&app, StoreError::LeaseLost)),
    };
    let job = store.get(lease.id).await?.ok_or_else(lost)?;
    let (outcome, ended) = match (request.outcome, request.failure) {
        (EndOutcome::Failed, Some(failure)) => return failed(&app, path, lease, &job, failure).await,
        (EndOutcome::Cancelled, _) if !job.cancel_requested => {
            let fault =
                FieldError::new("/outcome", "no client has cancelled the job: must not be `cancelled`");
            return Err(Failure::invalid(vec![fault]).into());
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
                // No result needs more: the job would wait for ever.
                let bytes = bytes.min(most_bytes_of_result(app.shared.limits.max_grains, 0));
                app.shared.storage.wait_for_room(owner, bytes).await;
            }
            ("requeued", requeued.map(drop))
        }
    };
    ended.map_err(|error| refused(&app, error))?;
    note_end(&app, path, outcome, job.started_at);
    if request.outcome == EndOutcome::Cancelled {
        remove_checkpoints(&app, path);
    }
    Ok(recorded().into_response())
}

/// Ends an attempt with the failure that its worker reports, as far as the worker can know it.
async fn failed(
    app: &App,
    path: LeasePath,
    lease: Lease,
    job: &JobRecord,
    failure: Failure,
) -> Result<Response, Problem> {
    let store = &app.shared.store;
    let ran_us = job.started_at.map_or(0, |at| (Timestamp::now().as_microsecond() - at).max(0));
    let ran = Duration::from_micros(ran_us.unsigned_abs());
    let timeout_s = run_limit_s(job.timeout_s, app.shared.max_run_s);
    let attempt = Attempt { timeout_s, ran, faults: job.faults };
    let claim = claims::checked(failure, attempt).map_err(|fault| {
        app.shared.metrics.lease(LeaseEvent::Refused, 1);
        Failure::invalid(vec![fault])
    })?;
    let (outcome, ended) = match claim {
        // Its end is told when it is verified.
        Claim::ToVerify(failure) => {
            store.receive_failure(lease, failure, checking(0)).await.map_err(|error| refused(app, error))?;
            return Ok(recorded().into_response());
        }
        Claim::Accepted(failure) => {
            let facts = Facts { time_s: ran.as_secs_f64(), ..Facts::default() };
            ("failed", store.fail(lease, &failure, facts).await.map(|()| true))
        }
        Claim::Suspected(failure) => {
            let (job_id, attempt, code) = (path.id, path.attempt, failure.code.name());
            tracing::error!(
                %job_id, attempt, worker = job.worker, code, detail = failure.detail,
                "a worker reports a defect: its program, or its machine, is at fault"
            );
            ("failed", store.retry_after_defect(lease, failure).await)
        }
    };
    let has_ended = ended.map_err(|error| refused(app, error))?;
    note_end(app, path, if has_ended { outcome } else { "requeued" }, job.started_at);
    remove_checkpoints(app, path);
    Ok(recorded().into_response())
}
