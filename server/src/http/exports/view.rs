//! An export as clients see it.

use axum::http::{StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use packstone_engine::export::ExportType;
use serde::Serialize;
use serde_json::Value;

use crate::base_path;
use crate::exports::{ExportRecord, ExportState};
use crate::http::exports::address::{file_path, script_path, status_path};
use crate::http::response::{named, set, time};
use crate::http::waiting::Changing;
use crate::ids::JobId;
use crate::problem::FailureDocument;

/// An export: a file that is made, or to be made, of a result.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct Export {
    /// ID of the job of whose result it is made.
    #[cfg_attr(test, schema(format = "uuid"))]
    job_id: String,
    /// Its type.
    r#type: ExportType,
    /// Its file format.
    format: String,
    /// The request, with the defaults filled in.
    #[cfg_attr(test, schema(value_type = packstone_engine::export::ExportRequest))]
    options: Value,
    /// Where it stands.
    state: ExportState,
    /// Whether it stays with its job. Else it is part of a cache: it may be dropped at any time, and is made again when
    /// it is requested again.
    kept: bool,
    /// Name of the worker process that makes or made it, in the slots of packings; `null` for the server itself, and
    /// while it waits.
    #[cfg_attr(test, schema(required))]
    worker: Option<String>,
    /// How far it is while it is being made.
    #[cfg_attr(test, schema(value_type = Option<crate::jobs::JobProgress>, required))]
    progress: Option<Value>,
    /// Media type of the file; `null` for an export of an earlier version whose options this version does not know.
    #[cfg_attr(test, schema(required))]
    media_type: Option<&'static str>,
    /// Length of the file.
    #[cfg_attr(test, schema(required))]
    bytes: Option<u64>,
    /// SHA-256 of the file, in hexadecimal.
    #[cfg_attr(test, schema(required, pattern = "^[0-9a-f]{64}$"))]
    sha256: Option<String>,
    /// The figures of the export.
    #[cfg_attr(test, schema(value_type = Option<packstone_engine::export::ExportReport>, required))]
    report: Option<Value>,
    /// Why it failed.
    #[cfg_attr(test, schema(required))]
    error: Option<FailureDocument>,
    /// When it was requested first (RFC 3339, UTC).
    #[cfg_attr(test, schema(format = DateTime))]
    created_at: String,
    /// When its latest attempt started.
    #[cfg_attr(test, schema(format = DateTime, required))]
    started_at: Option<String>,
    /// When it was made, or failed.
    #[cfg_attr(test, schema(format = DateTime, required))]
    finished_at: Option<String>,
    /// When it last changed.
    #[cfg_attr(test, schema(format = DateTime))]
    updated_at: String,
    /// Addresses of what belongs to it.
    links: ExportLinks,
}

/// Addresses of what belongs to an export.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct ExportLinks {
    /// This document.
    #[serde(rename = "self")]
    this: String,
    /// The file.
    file: String,
    /// The script that opens the file, of meshes for Gmsh: it belongs beside the file.
    #[cfg_attr(test, schema(required = false, nullable = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    script: Option<String>,
    /// The job.
    job: String,
}

/// An export that is kept with a job.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct ExportLink {
    /// Its type.
    r#type: ExportType,
    /// Its file format.
    format: String,
    /// Addresses of what belongs to it.
    links: ExportLinks,
}

impl ExportLinks {
    fn of(job: JobId, kind: ExportType, options: &Value) -> Self {
        Self {
            this: status_path(job, kind, options),
            file: file_path(job, kind, options),
            script: script_path(job, kind, options),
            job: base_path::absolute(&format!("/v1/jobs/{job}")),
        }
    }
}

fn format_of(options: &Value) -> String {
    options["format"].as_str().unwrap_or_default().to_owned()
}

impl ExportLink {
    pub(crate) fn of(job: JobId, kind: ExportType, options: &Value) -> Self {
        Self { r#type: kind, format: format_of(options), links: ExportLinks::of(job, kind, options) }
    }
}

impl Export {
    pub(crate) fn of(record: &ExportRecord) -> Self {
        Self {
            job_id: record.job.to_string(),
            r#type: record.kind,
            format: format_of(&record.options),
            options: record.options.clone(),
            state: record.state,
            kept: record.kept,
            worker: named(&record.worker).filter(|_| record.state != ExportState::Queued),
            progress: record.progress.clone(),
            media_type: record.export().map(|export| export.media_type()),
            bytes: record.file.as_ref().map(|file| file.bytes),
            sha256: record.file.as_ref().map(|file| file.sha256.clone()),
            report: record.report.clone(),
            error: record.error.as_ref().map(FailureDocument::from),
            created_at: time(record.created_at),
            started_at: record.started_at.map(time),
            finished_at: record.finished_at.map(time),
            updated_at: time(record.updated_at),
            links: ExportLinks::of(record.job, record.kind, &record.options),
        }
    }
}

/// The export as a response with its tag, and a hint when to come back while it is not finished.
pub(crate) fn response(status: StatusCode, record: &ExportRecord) -> Response {
    let mut response = (status, axum::Json(Export::of(record))).into_response();
    set(&mut response, header::ETAG, &record.etag());
    if !record.state.is_finished() {
        set(&mut response, header::RETRY_AFTER, "2");
    }
    response
}

/// The answer in the place of a file that is not made yet. Its tag would be taken for that of the file, so it has none.
pub(crate) fn not_yet(record: &ExportRecord) -> Response {
    let mut response = response(StatusCode::ACCEPTED, record);
    response.headers_mut().remove(header::ETAG);
    let document = status_path(record.job, record.kind, &record.options);
    set(&mut response, header::CONTENT_LOCATION, &document);
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
