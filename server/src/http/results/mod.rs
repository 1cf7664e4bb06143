//! Results: any format, any part, to many at once, out of one stored form.
//!
//! The tag is strong: it is made of the stored file's digest, the format, and the revision of the
//! formats, which together decide every byte. Lengths were counted when the job ended, so that an
//! answer can say its length before its first byte is made.

#[cfg(test)]
mod document;

use std::io::{self, Write};

use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, Method};
use axum::response::{IntoResponse as _, Response};
use packstone_engine::export::tables::{self, Format};
use serde::Serialize;
use serde_json::{Map, Value};
use sha2::{Digest as _, Sha256};

use crate::artifacts::conversions;
use crate::artifacts::read::StoredResult;
use crate::artifacts::stream as conversion;
use crate::disk::is_passing;
use crate::formats::ResultFormat;
use crate::hex;
use crate::http::app::App;
use crate::http::files::{self, Coding, Described, FileName};
use crate::http::negotiation;
use crate::http::params::values::Named;
use crate::http::params::{IdPath, JobPath, NoParameters, Query, parameters};
use crate::http::problems::{of_fault, refused};
use crate::jobs::store::{Fault, StoreError};
use crate::jobs::{ArtifactRecord, JobId, JobRecord, State as JobState};
use crate::page;
use crate::problem::{FailureDocument, Kind, Problem};
use crate::tasks;

/// A result without its request and its spheres.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct ResultSummary {
    /// ID of the job.
    #[cfg_attr(test, schema(format = "uuid"))]
    job_id: String,
    /// What computed the result.
    #[cfg_attr(test, schema(value_type = tables::EngineInfo))]
    engine: Value,
    /// What is known about the packing.
    #[serde(flatten)]
    #[cfg_attr(test, schema(value_type = packstone_engine::packing::Report))]
    report: Map<String, Value>,
}

/// Get a result without its grains
///
/// The figures of the result. The request is at `/v1/jobs/{id}/request`.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/jobs/{id}/result/summary", tag = "results", operation_id = "get_result_summary",
    params(JobPath),
    responses(
        (status = 200, description = "The result without its grains", body = ResultSummary),
        crate::http::problems::sets::SummaryProblems
    )
))]
pub(crate) async fn summary(
    State(app): State<App>,
    IdPath(id): JobPath,
    _: Query<NoParameters>,
) -> Result<Response, Problem> {
    let (job, artifact) = finished(&app, id).await?;
    let summary = ResultSummary { job_id: id.to_string(), engine: job.engine, report: artifact.report };
    Ok(axum::Json(summary).into_response())
}

parameters! {
    /// How a result is wanted.
    #[derive(Debug)]
    pub(crate) struct ResultParameters {
        /// The format; wins over `Accept`.
        format: Option<Named<ResultFormat>>,
    }
}

/// Get a result
///
/// The grains, in the format of `?format=`, or else of `Accept`; JSON when neither says. Supports `Range` with one
/// part, `If-Range` and `If-None-Match`. JSON and CSV are compressed (gzip, with a tag of its own and without ranges)
/// where `Accept-Encoding` takes it and no range is asked for. `view` (`docs/view.md`) is for viewers: 8 bytes a
/// sphere, largest first, so that any prefix of it is a picture. `html` is one file with a viewer and at most a million
/// grains, the largest, to look at without the server. Meshes, voxel models, slices and lattice models are exports, at
/// `/v1/jobs/{id}/exports/{type}`.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/jobs/{id}/result", tag = "results", operation_id = "get_result",
    params(
        JobPath,
        ResultParameters,
        ("Range" = Option<String>, Header, description = "`bytes=FIRST-LAST`, one part"),
        ("If-Range" = Option<String>, Header, description = "Send the range only if the tag is still this"),
        ("If-None-Match" = Option<String>, Header, description = "Tag of the result as known"),
        ("Accept-Encoding" = Option<String>, Header, description = "`gzip`: compressed, where that shortens it"),
    ),
    responses(
        (status = 200, description = "The result",
            content(
                (document::ResultDocument = "application/json"),
                (String = "text/csv"),
                (Vec<u8> = "application/vnd.vtk.legacy"),
                (Vec<u8> = "application/vnd.vtk.polydata+xml"),
                (Vec<u8> = "application/x-npy"),
                (Vec<u8> = "application/vnd.packstone.view"),
                (String = "text/html"),
            ),
            headers(
                ("ETag" = String, description = "Strong tag of the result in this format and coding"),
                ("Content-Encoding" = Option<String>, description = "`gzip`, where that was taken; else absent"))),
        (status = 206, description = "A part of the result",
            content(
                (Vec<u8> = "application/json"),
                (Vec<u8> = "text/csv"),
                (Vec<u8> = "application/vnd.vtk.legacy"),
                (Vec<u8> = "application/vnd.vtk.polydata+xml"),
                (Vec<u8> = "application/x-npy"),
                (Vec<u8> = "application/vnd.packstone.view"),
                (String = "text/html"),
            ),
            headers(("Content-Range" = String, description = "Which part, and of how much"))),
        (status = 304, description = "The result is as known"),
        crate::http::problems::sets::ResultProblems
    )
))]
pub(crate) async fn get(
    State(app): State<App>,
    IdPath(id): JobPath,
    Query(query): Query<ResultParameters>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (job, mut artifact) = finished(&app, id).await?;
    let format = match negotiation::format(query.format.as_ref(), &headers)? {
        ResultFormat::Table(format) => format,
        ResultFormat::Page => return page(&app, &job, artifact, &method, &headers).await,
    };
    let digest = &artifact.sha256[..32.min(artifact.sha256.len())];
    let coding = coding(format, &headers);
    let described = Described {
        etag: coding.tag(&format!("{digest}-{}-{}", format.name(), tables::REVISION)),
        content_type: content_type(format),
        filename: FileName::of(&job, format.name()),
        inline: false,
        negotiated: true,
        coding,
    };
    if let Some(response) = described.not_modified(&headers) {
        return Ok(response);
    }
    if artifact.format_revision != tables::REVISION {
        artifact = recount(&app, &job, artifact).await?;
    }
    let length = *artifact.format_lengths.get(format.name()).ok_or_else(|| {
        tracing::error!(job_id = %id, format = format.name(), "the length of a format is not stored");
        Problem::internal()
    })?;
    let part = described.part(&method, &headers, length)?;
    described.respond(part, |range| send(&app, artifact, (format, coding), range)).await
}

/// The page of a result. Its bytes depend on the scripts of this server too, so that they are made for their tag.
async fn page(
    app: &App,
    job: &JobRecord,
    artifact: ArtifactRecord,
    method: &Method,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    let permit = files::turn(app).await?;
    let artifacts = app.shared.artifacts.clone();
    let (result, measured) = blocking(job.id, move || {
        let _converting = conversions::begin();
        let (result, mut measured) = (artifacts.read(&artifact)?, Measured::default());
        page::write(result.head(), &result, &mut measured)?;
        Ok((result, measured))
    })
    .await?;
    let described = Described {
        etag: format!("\"{}\"", hex::encode(&measured.digest.finalize()[..16])),
        content_type: HeaderValue::from_static("text/html; charset=utf-8"),
        filename: FileName::of(job, "html"),
        inline: false,
        negotiated: true,
        coding: Coding::Never,
    };
    if let Some(response) = described.not_modified(headers) {
        return Ok(response);
    }
    let part = described.part(method, headers, measured.bytes)?;
    // Written once more while it is sent: readers that are slow would hold as many pages in memory.
    let write = move |out: &mut dyn Write| page::write(result.head(), &result, out);
    described
        .respond(part, async |range| {
            Ok(files::body(conversion::start_writing(Box::new(write), "html", range, false, permit)))
        })
        .await
}

/// The digest and the length of what is written.
#[derive(Default)]
struct Measured {
    digest: Sha256,
    bytes: u64,
}

impl Write for Measured {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.digest.update(bytes);
        self.bytes += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Text gets shorter by half and more; the digits of floating-point numbers in binary formats hardly do.
fn coding(format: Format, headers: &HeaderMap) -> Coding {
    match format {
        Format::Json | Format::Csv => Coding::of(headers),
        Format::Vtk | Format::Vtp | Format::Npy | Format::View => Coding::Never,
    }
}

fn content_type(format: Format) -> HeaderValue {
    HeaderValue::from_static(match format {
        Format::Csv => "text/csv; charset=utf-8; header=present",
        other => other.media_type(),
    })
}

/// A job that succeeded and its artifact, or the problem that it did not.
pub(crate) async fn finished(app: &App, id: JobId) -> Result<(JobRecord, ArtifactRecord), Problem> {
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
                .with(|members| members.state = Some(job.state.name()))
                .with_header("retry-after", "1"))
        }
        (JobState::Failed | JobState::Cancelled, _) => {
            Err(Problem::new(Kind::JobFailed, format!("job {id} {}", ended(&job))).with(|members| {
                members.state = Some(job.state.name());
                members.job_error = job.error.as_ref().map(FailureDocument::from);
            }))
        }
    }
}

fn ended(job: &JobRecord) -> String {
    match &job.error {
        Some(failure) => format!("failed: {}", failure.detail),
        None if job.state == JobState::Cancelled => "was cancelled".into(),
        None => "failed".into(),
    }
}

/// The lengths as of this revision of the formats, for a result of an earlier one.
async fn recount(app: &App, job: &JobRecord, artifact: ArtifactRecord) -> Result<ArtifactRecord, Problem> {
    let artifacts = app.shared.artifacts.clone();
    let counted = blocking(job.id, move || {
        let lengths = artifacts.read(&artifact)?.count_lengths()?;
        Ok(ArtifactRecord { format_revision: tables::REVISION, format_lengths: lengths, ..artifact })
    })
    .await?;
    let (store, lengths) = (&app.shared.store, counted.format_lengths.clone());
    store.record_lengths(job.seq, tables::REVISION, lengths).await?;
    Ok(counted)
}

/// Starts to send a part of a result.
async fn send(
    app: &App,
    artifact: ArtifactRecord,
    (format, coding): (Format, Coding),
    part: std::ops::Range<u64>,
) -> Result<Body, Problem> {
    let permit = files::turn(app).await?;
    let artifacts = app.shared.artifacts.clone();
    let path = artifact.path.clone();
    let result: StoredResult = blocking(path, move || artifacts.read(&artifact)).await?;
    Ok(files::body(conversion::start(result, format, part, coding == Coding::Gzip, permit)))
}

/// Reads from disk without holding up others. What fails here is this server's fault, or its disk's.
pub(crate) async fn blocking<T: Send + 'static>(
    what: impl std::fmt::Display,
    read: impl FnOnce() -> io::Result<T> + Send + 'static,
) -> Result<T, Problem> {
    let damaged = |error: &io::Error| {
        tracing::error!(%error, %what, "a stored result is missing or damaged");
        Problem::new(
            Kind::ResultDamaged,
            "the stored result is missing or damaged: retry the job, which packs it again",
        )
    };
    let failed = |error: &dyn std::fmt::Display| {
        tracing::error!(%error, %what, "a stored result is unreadable");
        Problem::new(
            Kind::InternalError,
            "the stored result is missing or damaged; the server's log says how",
        )
    };
    match tasks::blocking(read).await {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) if is_passing(&error) => {
            tracing::error!(%error, %what, "a stored result cannot be read at present");
            Err(of_fault(Fault::Io))
        }
        Ok(Err(error)) => Err(damaged(&error)),
        Err(error) => Err(failed(&error)),
    }
}
