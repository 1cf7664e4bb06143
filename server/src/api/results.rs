//! Results: any format, any part, to many at once, out of one stored form.
//!
//! The tag is strong: it is made of the stored file's digest, the format, and the revision of the
//! formats, which together decide every byte. Lengths were counted when the job ended, so that an
//! answer can say its length before its first byte is made.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use futures_util::stream;
use packstone_engine::format::{self, EngineInfo, Format};
use packstone_engine::packing::Report;
use serde::Serialize;
use serde_json::{Map, Value};
use tokio::time::timeout;
use utoipa::ToSchema;

use super::App;
use super::conditional;
use super::job_view::set;
use super::negotiation;
use super::openapi::{self, ResultProblems, SummaryProblems};
use super::params::{JobPath, Query};
use super::problem::refused;
use super::ranges::Asked;
use crate::artifacts::read::StoredResult;
use crate::artifacts::stream as conversion;
use crate::jobs::store::StoreError;
use crate::jobs::{ArtifactRecord, JobId, JobRecord, JobRequest, State as JobState};
use crate::problem::{Kind, Problem};

/// How long a download waits for another to end before it is refused.
const TURN: Duration = Duration::from_secs(10);

/// A result without its spheres.
#[derive(Serialize, ToSchema)]
pub(super) struct ResultSummary {
    /// The job.
    #[schema(format = "uuid")]
    job_id: String,
    /// The request as submitted, with its defaults filled in.
    #[schema(value_type = JobRequest)]
    request: Value,
    /// What computed the result.
    #[schema(value_type = EngineInfo)]
    engine: Value,
    /// What is known about the packing.
    #[serde(flatten)]
    #[schema(value_type = Report)]
    report: Map<String, Value>,
}

/// Get a result without its spheres
#[utoipa::path(
    get, path = "/v1/jobs/{id}/result/summary", tag = "results", operation_id = "get_result_summary",
    params(("id" = String, Path, format = "uuid", description = "Name of the job")),
    responses((status = 200, description = "The result without its spheres", body = ResultSummary), SummaryProblems)
)]
pub(super) async fn summary(
    State(app): State<App>,
    JobPath(id): JobPath,
    query: Query,
) -> Result<Response, Problem> {
    query.finish()?;
    let (job, artifact) = finished(&app, id).await?;
    let request = app.shared.store.request(job.seq).await.map_err(|error| refused(error, id))?;
    let summary =
        ResultSummary { job_id: id.to_string(), request, engine: job.engine, report: artifact.report };
    Ok(axum::Json(summary).into_response())
}

/// Get a result
///
/// In the format of `?format=`, or else of `Accept`; JSON when neither says. Supports `Range` with
/// one part, `If-Range` and `If-None-Match`.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/result", tag = "results", operation_id = "get_result",
    params(
        ("id" = String, Path, format = "uuid", description = "Name of the job"),
        ("format" = Option<Format>, Query, description = "The format; wins over `Accept`"),
        ("Range" = Option<String>, Header, description = "`bytes=FIRST-LAST`, one part"),
        ("If-Range" = Option<String>, Header, description = "Send the range only if the tag is still this"),
        ("If-None-Match" = Option<String>, Header, description = "Tag of the result as known"),
    ),
    responses(
        (status = 200, description = "The result",
            content(
                (openapi::ResultDocument = "application/json"),
                (String = "text/csv"),
                (Vec<u8> = "application/vnd.vtk.legacy"),
                (Vec<u8> = "application/vnd.vtk.polydata+xml"),
                (Vec<u8> = "application/x-npy"),
            ),
            headers(("ETag" = String, description = "Strong tag of the result in this format"))),
        (status = 206, description = "A part of the result",
            content(
                (Vec<u8> = "application/json"),
                (Vec<u8> = "text/csv"),
                (Vec<u8> = "application/vnd.vtk.legacy"),
                (Vec<u8> = "application/vnd.vtk.polydata+xml"),
                (Vec<u8> = "application/x-npy"),
            ),
            headers(("Content-Range" = String, description = "Which part, and of how much"))),
        (status = 304, description = "The result is as known"),
        ResultProblems
    )
)]
pub(super) async fn get(
    State(app): State<App>,
    JobPath(id): JobPath,
    mut query: Query,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let asked_format = query.one("format");
    query.finish()?;
    let (job, mut artifact) = finished(&app, id).await?;
    let format = negotiation::format(asked_format.as_deref(), &headers)?;
    let etag = format!(
        "\"{}-{}-{}\"",
        &artifact.sha256[..32.min(artifact.sha256.len())],
        format.name(),
        format::REVISION
    );
    if conditional::none_match_fails(&headers, &etag) {
        let mut response = StatusCode::NOT_MODIFIED.into_response();
        describe(&mut response, &etag);
        return Ok(response);
    }
    if artifact.format_revision != format::REVISION {
        artifact = recount(&app, &job, artifact).await?;
    }
    let length = *artifact.format_lengths.get(format.name()).ok_or_else(|| {
        tracing::error!(job_id = %id, format = format.name(), "the length of a format is not stored");
        Problem::internal()
    })?;
    let range = headers
        .get(header::RANGE)
        .filter(|_| method == Method::GET && conditional::range_allowed(&headers, &etag))
        .map(|value| value.to_str().unwrap_or_default());
    let (status, part) = match Asked::of(range, length) {
        Asked::Whole => (StatusCode::OK, 0..length),
        Asked::Part(part) => (StatusCode::PARTIAL_CONTENT, part),
        Asked::Beyond => {
            let detail = format!("the result has {length} bytes in this format: the range must begin below");
            return Err(Problem::new(Kind::RangeNotSatisfiable, detail)
                .with_header("content-range", format!("bytes */{length}")));
        }
    };
    let (first, bytes) = (part.start, part.end - part.start);
    let body =
        if method == Method::HEAD { Body::empty() } else { send(&app, artifact, format, part).await? };
    let mut response = (status, body).into_response();
    describe(&mut response, &etag);
    let fields = response.headers_mut();
    fields.insert(header::CONTENT_TYPE, content_type(format));
    fields.insert(header::CONTENT_LENGTH, HeaderValue::from(bytes));
    let filename = format!("attachment; filename=\"{id}.{}\"", format.name());
    set(&mut response, header::CONTENT_DISPOSITION, &filename);
    if status == StatusCode::PARTIAL_CONTENT {
        let range = format!("bytes {first}-{}/{length}", first + bytes - 1);
        set(&mut response, header::CONTENT_RANGE, &range);
    }
    Ok(response)
}

fn describe(response: &mut Response, etag: &str) {
    set(response, header::ETAG, etag);
    set(response, header::ACCEPT_RANGES, "bytes");
    set(response, header::VARY, "accept");
}

fn content_type(format: Format) -> HeaderValue {
    HeaderValue::from_static(match format {
        Format::Csv => "text/csv; charset=utf-8; header=present",
        other => other.media_type(),
    })
}

/// A job that succeeded and its artifact, or the problem that it did not.
pub(super) async fn finished(app: &App, id: JobId) -> Result<(JobRecord, ArtifactRecord), Problem> {
    let job = app.shared.store.get(id).await.and_then(|job| job.ok_or(StoreError::NoJob));
    let job = job.map_err(|error| refused(error, id))?;
    match (job.state, &job.artifact) {
        (JobState::Succeeded, Some(artifact)) => {
            let artifact = artifact.clone();
            Ok((job, artifact))
        }
        (JobState::Succeeded, None) => {
            tracing::error!(job_id = %id, "a job succeeded without an artifact");
            Err(Problem::internal())
        }
        (JobState::Queued | JobState::Running, _) => {
            Err(Problem::new(Kind::ResultNotReady, format!("job {id} is {}", job.state.name()))
                .with("state", job.state.name().into())
                .with_header("retry-after", "1"))
        }
        (JobState::Failed | JobState::Cancelled, _) => {
            let problem = Problem::new(Kind::JobFailed, format!("job {id} {}", ended(&job)))
                .with("state", job.state.name().into());
            Err(match job.error {
                Some(error) => problem.with("job_error", error),
                None => problem,
            })
        }
    }
}

fn ended(job: &JobRecord) -> String {
    let why = job.error.as_ref().and_then(|error| error.get("detail")).and_then(Value::as_str);
    match why {
        Some(why) => format!("failed: {why}"),
        None if job.state == JobState::Cancelled => "was cancelled".into(),
        None => "failed".into(),
    }
}

/// The lengths as of this revision of the formats, for a result of an earlier one.
async fn recount(app: &App, job: &JobRecord, artifact: ArtifactRecord) -> Result<ArtifactRecord, Problem> {
    let artifacts = app.shared.artifacts.clone();
    let counted = blocking(job.id, move || {
        let lengths = artifacts.read(&artifact)?.count_lengths()?;
        Ok(ArtifactRecord { format_revision: format::REVISION, format_lengths: lengths, ..artifact })
    })
    .await?;
    let (store, lengths) = (&app.shared.store, counted.format_lengths.clone());
    store.record_lengths(job.seq, format::REVISION, lengths).await?;
    Ok(counted)
}

/// Starts to send a part of a result.
async fn send(
    app: &App,
    artifact: ArtifactRecord,
    format: Format,
    part: std::ops::Range<u64>,
) -> Result<Body, Problem> {
    let turn = timeout(TURN, Arc::clone(&app.shared.downloads).acquire_owned()).await;
    let Ok(Ok(permit)) = turn else {
        let most = app.shared.max_downloads;
        return Err(Problem::new(Kind::Busy, format!("{most} results are being sent, as many as may"))
            .with_header("retry-after", "10"));
    };
    let artifacts = app.shared.artifacts.clone();
    let path = artifact.path.clone();
    let result: StoredResult = blocking(path, move || artifacts.read(&artifact)).await?;
    let blocks = conversion::start(result, format, part, permit);
    Ok(Body::from_stream(stream::unfold(blocks, |mut blocks| async move {
        blocks.recv().await.map(|block| (block, blocks))
    })))
}

/// Reads from disk without holding up others. What fails here is this server's fault, or its disk's.
pub(super) async fn blocking<T: Send + 'static>(
    what: impl std::fmt::Display,
    read: impl FnOnce() -> io::Result<T> + Send + 'static,
) -> Result<T, Problem> {
    let failed = |error: &dyn std::fmt::Display| {
        tracing::error!(%error, %what, "a stored result is unreadable");
        Problem::new(
            Kind::InternalError,
            "the stored result is missing or damaged; the server's log says how",
        )
    };
    match tokio::task::spawn_blocking(read).await {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => Err(failed(&error)),
        Err(error) => Err(failed(&error)),
    }
}
