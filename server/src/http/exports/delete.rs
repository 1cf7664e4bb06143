//! Removing an export, or cancelling one that is being made.

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse as _, Response};

use crate::http::app::App;
use crate::http::exports::ExportOptions;
use crate::http::exports::address::{ExportPath, Target};
use crate::http::exports::making::find;
use crate::http::params::Query;
use crate::http::problems::refused;
use crate::problem::Problem;

/// Delete an export
///
/// Whatever its state: an export that is being made is cancelled.
#[cfg_attr(test, utoipa::path(
    delete, path = "/v1/jobs/{id}/exports/{type}", tag = "exports", operation_id = "delete_export",
    params(
        ExportPath,
        ExportOptions,
    ),
    responses(
        (status = 204, description = "The export is removed"),
        crate::http::problems::sets::ExportStatusProblems
    )
))]
pub(crate) async fn delete(
    State(app): State<App>,
    path: ExportPath,
    Query(options): Query<ExportOptions>,
) -> Result<Response, Problem> {
    let target = Target::read(&app, path, &options).await?;
    let id = find(&app, &target).await?.id;
    let file =
        app.shared.store.delete_export(path.job, id).await.map_err(|error| refused(error, path.job))?;
    app.shared.artifacts.discard(Vec::from_iter(file)).await;
    tracing::info!(job_id = %path.job, export_id = %id, "deleted");
    Ok(StatusCode::NO_CONTENT.into_response())
}
