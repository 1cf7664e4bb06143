//! The state of one export, with long polls.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;

use crate::exports::ExportRecord;
use crate::http::app::App;
use crate::http::exports::ExportOptions;
use crate::http::exports::address::{ExportPath, Target};
use crate::http::exports::making::find;
use crate::http::exports::view;
use crate::http::params::Query;
use crate::http::problems::refused;
use crate::http::waiting::{self, Asked};
use crate::jobs::store::StoreError;
use crate::problem::Problem;

/// Get the state of an export
///
/// With `Prefer: wait=N` the answer is held back as that of a job is: until the export differs from `If-None-Match`
/// (304 if it never does), or without that field until it is finished. 404 says that nobody has asked for the export
/// yet.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/jobs/{id}/exports/{type}/status", tag = "exports", operation_id = "get_export_status",
    params(
        ExportPath,
        ExportOptions,
        ("If-None-Match" = Option<String>, Header, description = "Tag of the export's document as known"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`, at most 60"),
    ),
    responses(
        (status = 200, description = "The export", body = view::Export,
            headers(("ETag" = String, description = "Tag of the export's document"))),
        (status = 304, description = "The export is as known"),
        crate::http::problems::sets::ExportStatusProblems
    )
))]
pub(crate) async fn get(
    State(app): State<App>,
    path: ExportPath,
    Query(options): Query<ExportOptions>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let target = Target::read(&app, path, &options).await?;
    let asked = Asked::of(&headers);
    let (job, id) = (path.job, find(&app, &target).await?.id);
    let store = &app.shared.store;
    let read = move || async move { store.export(job, id).await?.ok_or(StoreError::NoExport) };
    let settled = |record: &ExportRecord| asked.settles(record);
    let answered = async {
        let changes = store.subscribe_export(id);
        let record = waiting::wait_until(&app, asked.wait(), changes, read, settled).await?;
        asked.answer(&record, async { Ok(view::response(StatusCode::OK, &record)) }).await
    };
    answered.await.map_err(|error| refused(error, path.job))
}
