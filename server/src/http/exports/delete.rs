//! Removing an export, or cancelling one that is being made.

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse as _, Response};
use packstone_engine::export::ExportType;

use crate::http::app::App;
use crate::http::exports::ExportOptions;
use crate::http::exports::address::{ExportPath, Target};
use crate::http::exports::making::find;
use crate::http::params::Query;
use crate::http::problems::refused;
use crate::http::problems::sets::ExportStatusProblems;
use crate::problem::Problem;

/// Delete an export
///
/// Whatever its state: an export that is being made is cancelled.
#[utoipa::path(
    delete, path = "/v1/jobs/{id}/exports/{type}", tag = "exports", operation_id = "delete_export",
    params(
        ("id" = String, Path, format = "uuid", description = "ID of the job, which must have succeeded"),
        ("type" = ExportType, Path, description = "Type of the export"),
        ("format" = Option<String>, Query, description = "File format; the first of the type's formats in `/v1/capabilities` when absent"),
        ("options" = Option<ExportOptions>, Query, style = Form, explode, description = "Options of the type and format"),
    ),
    responses((status = 204, description = "The export is removed"), ExportStatusProblems)
)]
pub(crate) async fn delete(
    State(app): State<App>,
    path: ExportPath,
    query: Query,
) -> Result<Response, Problem> {
    let target = Target::read(&app, path, query).await?;
    let id = find(&app, &target).await?.id;
    let file =
        app.shared.store.delete_export(path.job, id).await.map_err(|error| refused(error, path.job))?;
    if let Some(path) = file
        && let Err(error) = app.shared.artifacts.remove(&path)
    {
        tracing::warn!(%error, export_id = %id, "the file is left to the sweeper");
    }
    tracing::info!(job_id = %path.job, export_id = %id, "deleted");
    Ok(StatusCode::NO_CONTENT.into_response())
}
