//! Exports that a worker makes: the result that one is made from, the file that it sends, and the end without one.

use std::io;
use std::time::Duration;

use axum::Extension;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::{IntoResponse as _, Response};
use jiff::Timestamp;
use packstone_engine::FieldError;
use packstone_engine::export::{ExportReport, ExportRequest};
use packstone_engine::request::{Materials, Specimen};
use tracing::Instrument as _;

use super::checkpoint::{check_length, of_disk};
use super::{LeasePath, lost, making, recorded, refused, remove_checkpoints, upload};
use crate::accounts::Caller;
use crate::artifacts::Artifacts;
use crate::artifacts::receive::{ExpectedExport, ReceiveError};
use crate::exports::{ExportLease, StoredFile};
use crate::failure::Failure;
use crate::http::app::App;
use crate::http::body::linger;
use crate::http::files::send_file;
use crate::http::params::values::{Sha256, WholeNumber};
use crate::http::params::{NoParameters, Query, parameters};
use crate::jobs::store::{ClaimedExport, MOST_WRONG_RESULTS, Refused, StoreError};
use crate::metrics::{CheckOutcome, LeaseEvent};
use crate::problem::{Fault, Problem};
use crate::tasks;
use crate::workers::claims::{self, Claim};
use crate::workers::documents::{EndOutcome, EndRequest};

/// Bytes of a report: at most more than any has.
type ReportBytes = WholeNumber<1, { 4 << 20 }, 1>;

parameters! {
    /// What the file is.
    #[derive(Debug)]
    pub(crate) struct ExportFileParameters {
        /// SHA-256 of the file, in hexadecimal.
        sha256: Sha256,
        /// Bytes of the report before it. It must be given.
        report_bytes: Option<ReportBytes>,
    }
}

/// Get the result that an export is made from
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/leases/{task}/{attempt}/result", tag = "workers", operation_id = "get_leased_result",
    params(LeasePath),
    responses(
        (status = 200, description = "The stored form of the result", content_type = "application/octet-stream"),
        crate::http::problems::sets::CheckpointProblems
    )
))]
pub(crate) async fn get(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    path: LeasePath,
    _: Query<NoParameters>,
) -> Result<Response, Problem> {
    let lease = making(&app, &caller.by.key, path).await?.ok_or_else(lost)?;
    let ClaimedExport { result, .. } = leased(&app, lease).await?;
    let artifacts = app.shared.artifacts.clone();
    let opened = tasks::blocking(move || {
        let stored = StoredFile { path: result.path, bytes: result.bytes, sha256: result.sha256 };
        artifacts.open_export(&stored).map(|file| (file, stored.bytes))
    });
    let opened = opened.await.map_err(|_| Problem::internal())?;
    let (file, length) = opened.map_err(|error| of_disk(&error, &app.shared.disk))?;
    let mut response = send_file(&app, file, 0..length).await?.into_response();
    let fields = response.headers_mut();
    fields.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/octet-stream"));
    fields.insert(header::CONTENT_LENGTH, HeaderValue::from(length));
    Ok(response)
}

/// End a lease with an export
///
/// The body is the report of the export, as JSON of `report_bytes` bytes, and the file behind it. The server refuses
/// what has another digest, or a report that is none of this export or does not agree with the packing: then the export
/// is requeued, and the wrong result counts for the worker. A repeated request is answered as the first was.
#[cfg_attr(test, utoipa::path(
    put, path = "/v1/leases/{task}/{attempt}/export", tag = "workers", operation_id = "put_export",
    params(LeasePath, ExportFileParameters),
    request_body(content_type = "application/octet-stream", description = "The report, and the file behind it"),
    responses(
        (status = 200, description = "The export is stored", body = super::LeaseEnded),
        crate::http::problems::sets::LeaseFileProblems
    )
))]
pub(crate) async fn put(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    path: LeasePath,
    Query(parameters): Query<ExportFileParameters>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    // A worker that goes before it has its answer must not leave a file that nobody records.
    let taken = take_in(app, caller.by.key.clone(), path, parameters, headers, body);
    tasks::spawn(taken.in_current_span()).await.unwrap_or_else(|error| {
        tracing::error!(%error, "taking in an export panicked");
        Err(Problem::internal())
    })
}

/// Reads an export, and ends its lease with it.
async fn take_in(
    app: App,
    key: String,
    path: LeasePath,
    parameters: ExportFileParameters,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let ExportFileParameters { sha256: Sha256(sha256), report_bytes } = parameters;
    let Some(report_bytes) = report_bytes.map(WholeNumber::get) else {
        let fault = Fault::parameter("report_bytes", "is missing: must be given".to_owned());
        return Err(Problem::parameters(vec![fault]));
    };
    // Before the look at the lease, as of results.
    let _alone = app.receive_alone(format!("export {}", path.id))?;
    let Some(lease) = making(&app, &key, path).await? else {
        linger(body);
        return Ok(recorded().into_response());
    };
    let claimed = leased(&app, lease).await?;
    let most_bytes = app.shared.storage.room(&claimed.export.owner).await?.0;
    check_length(&headers, most_bytes.saturating_add(report_bytes.into()))?;
    let expected = ExpectedExport { sha256, report_bytes: report_bytes as usize, most_bytes };
    let (artifacts, disk) = (app.shared.artifacts.clone(), app.shared.disk.clone());
    let place = artifacts.begin_export(&lease.id.to_string(), lease.attempt);
    let worker = claimed.export.worker.clone();
    let started_at = claimed.export.started_at;
    let kind = claimed.export.kind.name();
    let received = upload::take(&app, body, move |pieces| {
        let next = || pieces.next().map(|piece| piece.map_err(|_| ReceiveError::Broken));
        let check = |report: &ExportReport, bytes| check_report(&artifacts, &claimed, report, bytes);
        (artifacts.receive_export(&place, &expected, next, check), place)
    });
    let (received, place) = received.await?;
    let (file, report) = match received {
        Ok(received) => received,
        Err(ReceiveError::Io(error)) => return Err(of_disk(&error, &disk)),
        Err(error) => {
            let fault = error.to_string();
            if let ReceiveError::Unexpected(_) = error {
                refuse(&app, lease, (&worker, &key), &fault).await.map_err(|error| refused(&app, error))?;
            }
            return Err(Problem::parameters(vec![Fault::parameter("sha256", fault)]));
        }
    };
    let (stored, report) =
        (file.path.clone(), serde_json::to_value(&report).map_err(|_| Problem::internal())?);
    let ended = app.shared.store.export_made(lease, file, report).await;
    drop(place);
    if let Err(error) = ended {
        // As of results: another server may record the same file.
        if matches!(error, StoreError::LeaseLost) && !app.shared.artifacts.are_shared() {
            app.shared.artifacts.discard(vec![stored]).await;
        }
        return Err(refused(&app, error));
    }
    tracing::info!(export_id = %lease.id, attempt = lease.attempt, worker, "received an export");
    remove_checkpoints(&app, path);
    app.shared.metrics.export_ended(kind, "succeeded", since(started_at));
    Ok(recorded().into_response())
}

/// The export of a lease, with the result that it is made from.
///
/// # Errors
/// `lease-lost`, or the store's.
async fn leased(app: &App, lease: ExportLease) -> Result<ClaimedExport, Problem> {
    app.shared.store.leased_export(lease).await.map_err(|error| refused(app, error))
}

/// Checks a report against the packing, the options and the materials that it is said to be of.
fn check_report(
    artifacts: &Artifacts,
    claimed: &ClaimedExport,
    report: &ExportReport,
    bytes: u64,
) -> Result<(), ReceiveError> {
    let stored = artifacts.read(&claimed.result)?;
    let unreadable = |what: &str| io::Error::other(format!("the stored {what} is unreadable"));
    let export = ExportRequest::from_json(&claimed.export.options).map_err(|_| unreadable("request"))?;
    let request = &stored.head().request;
    let materials = Materials::of_request(request);
    let specimen = Specimen::from_json(&request["specimen"]).map_err(|_| unreadable("specimen"))?;
    let volume_fraction = stored.head().report.summary.volume_fraction_effective;
    export
        .check_report(&specimen, volume_fraction, materials.as_ref(), report, bytes)
        .map_err(ReceiveError::Unexpected)
}

/// Requeues an export of which a worker has sent what is wrong, counts it for the worker, and names both in the log.
async fn refuse(
    app: &App,
    lease: ExportLease,
    (worker, key): (&str, &str),
    fault: &str,
) -> Result<(), StoreError> {
    app.shared.metrics.result_checked(CheckOutcome::Wrong, Duration::ZERO);
    let Refused { of_worker: wrong_results, has_failed } =
        app.shared.store.refuse_export(lease, fault).await?;
    let (export_id, attempt) = (lease.id, lease.attempt);
    tracing::error!(%export_id, attempt, worker, key, fault, wrong_results, has_failed, "a worker sent a wrong result");
    if wrong_results == MOST_WRONG_RESULTS {
        tracing::error!(
            worker,
            key,
            wrong_results,
            "the worker gets no job until an administrator allows it again"
        );
    }
    Ok(())
}

/// Ends an attempt without an export.
pub(super) async fn end(app: &App, lease: ExportLease, request: EndRequest) -> Result<Response, Problem> {
    let store = &app.shared.store;
    let claimed = leased(app, lease).await?;
    let (outcome, ended) = match (request.outcome, request.failure) {
        (EndOutcome::Failed, Some(failure)) => {
            let claim = claims::of_export(failure, claimed.faults).map_err(|fault| {
                app.shared.metrics.lease(LeaseEvent::Refused, 1);
                Failure::invalid(vec![fault])
            })?;
            match claim {
                Claim::Suspected(failure) => {
                    let (export_id, attempt, code) = (lease.id, lease.attempt, failure.code.name());
                    tracing::error!(
                        %export_id, attempt, worker = claimed.export.worker, code, detail = failure.detail,
                        "a worker reports a defect: its program, or its machine, is at fault"
                    );
                    ("failed", store.retry_export_after_defect(lease, failure).await.map(drop))
                }
                Claim::Accepted(failure) | Claim::ToVerify(failure) => {
                    ("failed", store.export_failed(lease, &failure).await)
                }
            }
        }
        (EndOutcome::Cancelled, _) => {
            let fault = FieldError::new("/outcome", "an export is deleted: must not be `cancelled`");
            return Err(Failure::invalid(vec![fault]).into());
        }
        (EndOutcome::Released, _) => ("given_back", store.export_requeued(lease).await),
        (EndOutcome::Faulted | EndOutcome::Failed, _) => {
            ("requeued", store.export_requeued_after_fault(lease).await)
        }
    };
    ended.map_err(|error| refused(app, error))?;
    if outcome == "failed" {
        remove_checkpoints(app, LeasePath { id: lease.id.into(), attempt: lease.attempt });
    }
    let took = since(claimed.export.started_at);
    tracing::info!(export_id = %lease.id, attempt = lease.attempt, outcome, took_s = took.as_secs_f64(), "a lease ended");
    app.shared.metrics.export_ended(claimed.export.kind.name(), outcome, took);
    Ok(recorded().into_response())
}

/// The time since a moment in microseconds since the Unix epoch.
fn since(at: Option<i64>) -> Duration {
    let now = Timestamp::now().as_microsecond();
    Duration::from_micros(at.map_or(0, |at| (now - at).max(0)).unsigned_abs())
}
