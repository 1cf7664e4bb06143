//! Something export as clients see it.

use axum::http::{StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use packstone_engine::export::{ExportReport, ExportRequest, ExportType};
use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use crate::exports::{ExportRecord, ExportState};
use crate::http::response::{set, time};
use crate::http::waiting::Changing;
use crate::ids::{ExportId, JobId};
use crate::jobs::JobProgress;
use crate::problem::ProblemDocument;

/// Something made of a result, or to be made.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Export {
    /// Its name (UUIDv7).
    #[schema(format = "uuid")]
    id: String,
    /// The job of whose result it is made.
    #[schema(format = "uuid")]
    job_id: String,
    /// What it is.
    r#type: ExportType,
    /// What was asked for, with its defaults filled in.
    #[schema(value_type = ExportRequest)]
    options: Value,
    /// Where it stands.
    state: ExportState,
    /// Whether it stays with its job. What was asked for as a format only is a cache, may go any time, and is made again
    /// when it is asked for.
    kept: bool,
    /// How far it is while it is being made.
    #[schema(value_type = Option<JobProgress>, required)]
    progress: Option<Value>,
    /// Media type of the file; `null` where this version does not know what was asked of an earlier one.
    #[schema(required)]
    media_type: Option<&'static str>,
    /// Length of the file.
    #[schema(required)]
    bytes: Option<u64>,
    /// SHA-256 of the file, in hexadecimal.
    #[schema(required, pattern = "^[0-9a-f]{64}$")]
    sha256: Option<String>,
    /// What is worth knowing about it.
    #[schema(value_type = Option<ExportReport>, required)]
    report: Option<Value>,
    /// Why it could not be made.
    #[schema(value_type = Option<ProblemDocument>, required)]
    error: Option<Value>,
    /// When it was asked for first (RFC 3339, UTC).
    #[schema(format = DateTime)]
    created_at: String,
    /// When it was begun.
    #[schema(format = DateTime, required)]
    started_at: Option<String>,
    /// When it was done, or failed.
    #[schema(format = DateTime, required)]
    finished_at: Option<String>,
    /// When it last changed.
    #[schema(format = DateTime)]
    updated_at: String,
    /// Where to go from here.
    links: ExportLinks,
}

/// Where to go from something export.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ExportLinks {
    /// It itself.
    #[serde(rename = "self")]
    this: String,
    /// Its file.
    file: String,
    /// The job of whose result it is made.
    job: String,
}

/// Something that is kept of a job's result.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ExportLink {
    /// Its name.
    #[schema(format = "uuid")]
    id: String,
    /// What it is.
    r#type: ExportType,
    /// Where it is.
    links: ExportLinks,
}

impl ExportLinks {
    fn of(job: JobId, id: ExportId) -> Self {
        let this = path(job, id);
        Self { file: format!("{this}/file"), job: format!("/v1/jobs/{job}"), this }
    }
}

impl ExportLink {
    pub(crate) fn of(job: JobId, id: ExportId, kind: ExportType) -> Self {
        Self { id: id.to_string(), r#type: kind, links: ExportLinks::of(job, id) }
    }
}

impl Export {
    pub(crate) fn of(record: &ExportRecord) -> Self {
        Self {
            id: record.id.to_string(),
            job_id: record.job.to_string(),
            r#type: record.kind,
            options: record.options.clone(),
            state: record.state,
            kept: record.kept,
            progress: record.progress.clone(),
            media_type: record.export().map(|export| export.media_type()),
            bytes: record.file.as_ref().map(|file| file.bytes),
            sha256: record.file.as_ref().map(|file| file.sha256.clone()),
            report: record.report.clone(),
            error: record.error.clone(),
            created_at: time(record.created_at),
            started_at: record.started_at.map(time),
            finished_at: record.finished_at.map(time),
            updated_at: time(record.updated_at),
            links: ExportLinks::of(record.job, record.id),
        }
    }
}

/// As a response with its tag, and a hint when to come back while it is not finished.
pub(crate) fn response(status: StatusCode, record: &ExportRecord) -> Response {
    let mut response = (status, axum::Json(Export::of(record))).into_response();
    set(&mut response, header::ETAG, &record.etag());
    if !record.state.is_finished() {
        set(&mut response, header::RETRY_AFTER, "1");
    }
    response
}

impl Changing for ExportRecord {
    /// It changes with everything that clients see.
    fn etag(&self) -> String {
        format!("\"{}\"", self.version)
    }

    fn is_finished(&self) -> bool {
        self.state.is_finished()
    }
}

/// The path.
pub(crate) fn path(job: JobId, id: ExportId) -> String {
    format!("/v1/jobs/{job}/exports/{id}")
}
