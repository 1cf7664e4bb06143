//! A worker sends the result of an attempt. The job succeeds once it is checked.

use std::time::Instant;

use axum::Extension;
use axum::body::Body;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse as _, Response};
use tracing::Instrument as _;

use super::checkpoint::{check_length, of_disk};
use super::{LeasePath, lost, recorded, refused, running, upload};
use crate::accounts::Caller;
use crate::artifacts::receive::{Expected, ReceiveError, most_bytes_of_result};
use crate::http::app::App;
use crate::http::body::linger;
use crate::http::params::values::Sha256;
use crate::http::params::{Query, parameters};
use crate::jobs::store::StoreError;
use crate::metrics::CheckOutcome;
use crate::problem::{Fault, Problem};
use crate::tasks;
use crate::workers::checks::checking;

parameters! {
    /// What the file is.
    #[derive(Debug)]
    pub(crate) struct ResultParameters {
        /// SHA-256 of the file, in hexadecimal.
        sha256: Sha256,
    }
}

/// End a lease with its result
///
/// The body is the stored form of the packing. The server refuses what has another digest, is not whole, or is of
/// another request. What it accepts is checked after the answer: the job runs on, and succeeds if the packing is right;
/// if not, it is requeued, and the wrong result counts for the worker. A repeated request is answered as the first was.
#[cfg_attr(test, utoipa::path(
    put, path = "/v1/leases/{task}/{attempt}/result", tag = "workers", operation_id = "put_result",
    params(LeasePath, ResultParameters),
    request_body(content_type = "application/octet-stream", description = "The stored form of the result"),
    responses(
        (status = 200, description = "The result is received", body = super::LeaseEnded),
        crate::http::problems::sets::LeaseFileProblems
    )
))]
pub(crate) async fn put(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    path: LeasePath,
    Query(ResultParameters { sha256: Sha256(sha256) }): Query<ResultParameters>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    // A worker that goes before it has its answer must not leave a file that nobody records.
    let taken = take_in(app, caller.by.key.clone(), path, sha256, headers, body);
    tasks::spawn(taken.in_current_span()).await.unwrap_or_else(|error| {
        tracing::error!(%error, "taking in a result panicked");
        Err(Problem::internal())
    })
}

/// Reads a result, and ends its lease with it.
async fn take_in(
    app: App,
    key: String,
    path: LeasePath,
    sha256: String,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    // Before the look at the lease: a request that waited for the one before it finds that the attempt has ended. Were
    // it to take the file in once more, it would find its lease lost at the end, and remove what is recorded.
    let _alone = app.receive_alone(format!("result of {}", path.id))?;
    let Some(lease) = running(&app, &key, path).await? else {
        linger(body);
        return Ok(recorded().into_response());
    };
    let began = Instant::now();
    let store = &app.shared.store;
    let job = store.get(lease.id).await?.ok_or_else(lost)?;
    let request = store.request_text(job.seq).await?;
    let most_bytes = most_bytes_of_result(app.shared.limits.max_grains, request.len() as u64);
    let most_bytes = app.shared.storage.room(&job.owner).await?.0.min(most_bytes);
    check_length(&headers, most_bytes)?;
    let expected = Expected { job: path.id.to_string(), request, sha256, most_bytes };
    let (artifacts, disk) = (app.shared.artifacts.clone(), app.shared.disk.clone());
    let place = artifacts.begin(&path.id.to_string(), path.attempt);
    let received = upload::take(&app, body, move |pieces| {
        let next = || pieces.next().map(|piece| piece.map_err(|_| ReceiveError::Broken));
        (artifacts.receive(&place, &expected, next), place)
    });
    let (received, place) = received.await?;
    let received = match received {
        Ok(received) => received,
        Err(ReceiveError::Io(error)) => return Err(of_disk(&error, &disk)),
        Err(error) => {
            let fault = error.to_string();
            if let ReceiveError::Unexpected(_) = error {
                let (checks, metrics) = (&app.shared.checks, &app.shared.metrics);
                metrics.result_checked(CheckOutcome::Wrong, began.elapsed());
                let refusal = checks.refuse(lease, &job.worker, &key, &fault).await;
                refusal.map_err(|error| refused(&app, error))?;
            }
            return Err(Problem::parameters(vec![Fault::parameter("sha256", fault)]));
        }
    };
    let file = received.artifact.path.clone();
    let ended = store.receive_result(lease, received.artifact, checking(received.grains)).await;
    drop(place);
    if let Err(error) = ended {
        // Where several servers take results in, another may have got the same one and record it; after an error of the
        // database the file may be recorded nevertheless: then the sweeper decides, after an hour.
        if matches!(error, StoreError::LeaseLost) && !app.shared.artifacts.are_shared() {
            app.shared.artifacts.discard(vec![file]).await;
        }
        return Err(refused(&app, error));
    }
    tracing::info!(job_id = %path.id, attempt = path.attempt, worker = job.worker, "received a result");
    Ok(recorded().into_response())
}
