//! What is made of a job's result and kept with it: asked for, looked at, fetched, called off.

use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use packstone_engine::export::ExportRequest;
use serde::Serialize;
use utoipa::ToSchema;

use crate::exports::{self, ExportRecord, ExportState, NewExport};
use crate::http::app::App;
use crate::http::body;
use crate::http::conditional::Wait;
use crate::http::exports::formats::{self, described, until_finished};
use crate::http::exports::view::{self, Export};
use crate::http::files;
use crate::http::pages::{self, Page};
use crate::http::params::{ExportPath, JobPath, Query};
use crate::http::problems::refused;
use crate::http::problems::sets::{ExportFileProblems, ExportProblems, JobProblems};
use crate::http::response::set;
use crate::http::results::finished;
use crate::http::waiting::{self, Asked, PREFERENCE_APPLIED};
use crate::ids::{ExportId, JobId};
use crate::jobs::store::{StoreError, Wish};
use crate::problem::{Kind, Problem};
use crate::strict_json;

/// Make something of a result
///
/// A mesh, a voxel model, a cut, a lattice model. The same options give the same thing, however often they are asked for:
/// who asks again finds the one that there is. It is made beside the jobs, in its turn, and stays with its job.
#[utoipa::path(
    post, path = "/v1/jobs/{id}/exports", tag = "results", operation_id = "derive",
    params(
        ("id" = String, Path, format = "uuid", description = "Name of the job, which must have succeeded"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: answer when it is made, or after N s (at most 60)"),
    ),
    request_body(content = ExportRequest, content_type = "application/json"),
    responses(
        (status = 201, description = "It will be made; or, after a wait, it is", body = Export,
            headers(("Location" = String, description = "Its path"), ("ETag" = String, description = "Its tag"))),
        (status = 200, description = "There is the same already", body = Export,
            headers(("Location" = String, description = "Its path"), ("ETag" = String, description = "Its tag"))),
        ExportProblems
    )
)]
pub(crate) async fn submit(
    State(app): State<App>,
    JobPath(id): JobPath,
    query: Query,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    query.finish()?;
    let wait = Wait::of(&headers);
    let bytes = body::json_bytes(&app, &headers, body).await?;
    let export = ExportRequest::from_json(&strict_json::parse(&bytes)?)
        .map_err(|faults| Problem::fields(Kind::ValidationError, faults))?;
    let (job, result) = finished(&app, id).await?;
    let new = NewExport::new(&export, &result.sha256);
    formats::check(&app, &job, &export, &new).await?;
    let asked = app.shared.store.request_export(id, new, Wish::Keep).await;
    let (mut record, created) = asked.map_err(|error| refused(error, id))?;
    if created {
        tracing::info!(job_id = %id, export_id = %record.id, kind = record.kind.name(), "taken in");
    }
    if let Some(wait) = wait {
        record = until_finished(&app, &record, wait).await.map_err(|error| refused(error, record.id))?;
    }
    let status = if created { StatusCode::CREATED } else { StatusCode::OK };
    let mut response = view::response(status, &record);
    set(&mut response, header::LOCATION, &view::path(id, record.id));
    if let Some(wait) = wait {
        set(&mut response, PREFERENCE_APPLIED, &wait.applied());
    }
    Ok(response)
}

/// A page of what is made of a result.
#[derive(Serialize, ToSchema)]
pub(crate) struct ExportPage {
    /// Newest first.
    items: Vec<Export>,
    /// Names the next page; `null` on the last one.
    #[schema(required)]
    next_cursor: Option<String>,
}

/// List what is made of a result
///
/// Newest first; what was asked for as a format only, and is there still, among them.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/exports", tag = "results", operation_id = "list_exports",
    params(
        ("id" = String, Path, format = "uuid", description = "Name of the job"),
        ("limit" = Option<i64>, Query, minimum = 1, maximum = 500, description = "Items on the page; 50 when absent"),
        ("cursor" = Option<String>, Query, description = "`next_cursor` of the page before"),
    ),
    responses(
        (status = 200, description = "A page", body = ExportPage,
            headers(("Link" = String, description = "Address of the next page, if there is one"))),
        JobProblems
    )
)]
pub(crate) async fn list(
    State(app): State<App>,
    JobPath(id): JobPath,
    mut query: Query,
) -> Result<Response, Problem> {
    let listing = ("export", id);
    let page = Page::read(&mut query, &listing);
    query.finish()?;
    let store = &app.shared.store;
    let job = store.get(id).await.and_then(|job| job.ok_or(StoreError::NoJob));
    let job = job.map_err(|error| refused(error, id))?;
    let (records, next) = store.list_exports(job.seq, page.before, page.limit).await?;
    let next_cursor = next.map(|seq| pages::cursor(seq, &listing));
    let items = records.iter().map(Export::of).collect();
    let mut response = axum::Json(ExportPage { items, next_cursor: next_cursor.clone() }).into_response();
    if let Some(cursor) = next_cursor {
        set(&mut response, header::LINK, &page.link(&format!("/v1/jobs/{id}/exports"), &[], &cursor));
    }
    Ok(response)
}

/// Ask how something export is
///
/// With `Prefer: wait=N` the answer is held back as that of a job is: until it differs from `If-None-Match` (304 if it
/// never does), or without that field until it is finished.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/exports/{export_id}", tag = "results", operation_id = "get_export",
    params(
        ("id" = String, Path, format = "uuid", description = "Name of the job"),
        ("export_id" = String, Path, format = "uuid", description = "Its name"),
        ("If-None-Match" = Option<String>, Header, description = "Its tag as known"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`, at most 60"),
    ),
    responses(
        (status = 200, description = "How it is", body = Export,
            headers(("ETag" = String, description = "Its tag"))),
        (status = 304, description = "It is as known"),
        JobProblems
    )
)]
pub(crate) async fn get(
    State(app): State<App>,
    ExportPath(job, id): ExportPath,
    query: Query,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    query.finish()?;
    let asked = Asked::of(&headers);
    let store = &app.shared.store;
    let read = move || async move { store.export(job, id).await?.ok_or(StoreError::NoExport) };
    let settled = |record: &ExportRecord| asked.settles(record);
    let answered = async {
        let changes = store.subscribe_export(id);
        let record = waiting::wait_until(&app, asked.wait(), changes, read, settled).await?;
        asked.answer(&record, async { Ok(view::response(StatusCode::OK, &record)) }).await
    };
    answered.await.map_err(|error| refused(error, id))
}

/// Get the file of something export
///
/// Supports `Range` with one part, `If-Range` and `If-None-Match`.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/exports/{export_id}/file", tag = "results", operation_id = "get_export_file",
    params(
        ("id" = String, Path, format = "uuid", description = "Name of the job"),
        ("export_id" = String, Path, format = "uuid", description = "Its name"),
        ("Range" = Option<String>, Header, description = "`bytes=FIRST-LAST`, one part"),
        ("If-Range" = Option<String>, Header, description = "Send the range only if the tag is still this"),
        ("If-None-Match" = Option<String>, Header, description = "Tag of the file as known"),
    ),
    responses(
        (status = 200, description = "The file; its media type is that of the document", body = Vec<u8>,
            content_type = "application/octet-stream", headers(("ETag" = String, description = "Strong tag of the file"))),
        (status = 206, description = "A part of it", body = Vec<u8>, content_type = "application/octet-stream",
            headers(("Content-Range" = String, description = "Which part, and of how much"))),
        (status = 304, description = "The file is as known"),
        ExportFileProblems
    )
)]
pub(crate) async fn file(
    State(app): State<App>,
    ExportPath(job, id): ExportPath,
    query: Query,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    query.finish()?;
    let record = find(&app, job, id).await?;
    let not_ready = |state: ExportState| {
        Problem::new(Kind::ResultNotReady, format!("{id} is {}", state.name()))
            .with("state", state.name().into())
            .with_header("retry-after", "1")
    };
    match record.state {
        ExportState::Succeeded => {}
        ExportState::Queued | ExportState::Running => return Err(not_ready(record.state)),
        ExportState::Failed => {
            let why = exports::failure(&record).detail;
            return Err(Problem::new(Kind::ExportFailed, format!("{id} failed: {why}"))
                .with("export_error", record.error.unwrap_or_default()));
        }
    }
    // What an earlier version made is handed out all the same.
    let (media_type, ending) = record
        .export()
        .map_or(("application/octet-stream", "bin"), |export| (export.media_type(), export.file_extension()));
    let described = described(media_type, &record.key, &format!("{id}.{ending}"));
    if let Some(response) = described.not_modified(&headers) {
        return Ok(response);
    }
    let Some((file, length)) = formats::open(&app, &record).await? else {
        return Err(not_ready(ExportState::Queued));
    };
    let part = described.part(&method, &headers, length)?;
    described.respond(part, |range| files::send_file(&app, file, range)).await
}

/// Delete something export
///
/// Whatever its state: what is being made is called off.
#[utoipa::path(
    delete, path = "/v1/jobs/{id}/exports/{export_id}", tag = "results", operation_id = "delete_export",
    params(
        ("id" = String, Path, format = "uuid", description = "Name of the job"),
        ("export_id" = String, Path, format = "uuid", description = "Its name"),
    ),
    responses((status = 204, description = "It is gone"), JobProblems)
)]
pub(crate) async fn delete(
    State(app): State<App>,
    ExportPath(job, id): ExportPath,
    query: Query,
) -> Result<Response, Problem> {
    query.finish()?;
    let file = app.shared.store.delete_export(job, id).await.map_err(|error| refused(error, id))?;
    if let Some(path) = file
        && let Err(error) = app.shared.artifacts.remove(&path)
    {
        tracing::warn!(%error, export_id = %id, "the file is left to the sweeper");
    }
    tracing::info!(job_id = %job, export_id = %id, "deleted");
    Ok(StatusCode::NO_CONTENT.into_response())
}

async fn find(app: &App, job: JobId, id: ExportId) -> Result<ExportRecord, Problem> {
    let found = app.shared.store.export(job, id).await.and_then(|found| found.ok_or(StoreError::NoExport));
    found.map_err(|error| refused(error, id))
}
