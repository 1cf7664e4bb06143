//! Starting an export without waiting for it.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::Response;

use crate::http::app::App;
use crate::http::body;
use crate::http::conditional::Wait;
use crate::http::exports::ExportOptions;
use crate::http::exports::address::{ExportPath, Target, file_path, status_path};
use crate::http::exports::making::until_finished;
use crate::http::exports::view;
use crate::http::params::values::Flag;
use crate::http::params::{Query, parameters};
use crate::http::problems::refused;
use crate::http::response::set;
use crate::http::waiting::PREFERENCE_APPLIED;
use crate::jobs::store::Retention;
use crate::problem::Problem;

parameters! {
    /// Which export is started, and whether it stays.
    #[derive(Debug)]
    pub(crate) struct StartParameters {
        /// Whether the file stays with its job.
        keep: Flag<true>,
        ..export: ExportOptions,
    }
}

/// Start an export
///
/// The answer does not wait for the file, unless `Prefer: wait=N` says so. The same options name the same export: a
/// request for one that exists finds it. With `keep=true`, the default, the file stays with its job; else it is part of
/// a cache. The request has no body.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/jobs/{id}/exports/{type}", tag = "exports", operation_id = "start_export",
    params(
        ExportPath,
        StartParameters,
        ("Prefer" = Option<String>, Header, description = "`wait=N`: answer when the export is finished, or after N s (at most 60)"),
    ),
    responses(
        (status = 202, description = "The export waits or is being made", body = view::Export,
            headers(("Location" = String, description = "Address of the file"), ("ETag" = String, description = "Tag of the export's document"),
                ("Retry-After" = String, description = "Seconds after which to ask again"))),
        (status = 200, description = "The export is finished: made or failed", body = view::Export,
            headers(("Location" = String, description = "Address of the file"), ("ETag" = String, description = "Tag of the export's document"))),
        crate::http::problems::sets::ExportStartProblems
    )
))]
pub(crate) async fn start(
    State(app): State<App>,
    path: ExportPath,
    Query(query): Query<StartParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    body::expect_none(&headers)?;
    let target = Target::read(&app, path, &query.export).await?;
    target.check(&app).await?;
    let retention = if query.keep.get() { Retention::Kept } else { Retention::Cached };
    let asked = app.shared.store.request_export(path.job, target.new.clone(), retention).await;
    let (mut record, created) = asked.map_err(|error| refused(error, path.job))?;
    if created {
        tracing::info!(job_id = %path.job, export_id = %record.id, kind = record.kind.name(), "accepted");
    }
    let wait = Wait::of(&headers);
    if let Some(wait) = wait {
        record = until_finished(&app, &record, wait).await.map_err(|error| refused(error, path.job))?;
    }
    let status = if record.state.is_finished() { StatusCode::OK } else { StatusCode::ACCEPTED };
    let mut response = view::response(status, &record);
    set(&mut response, header::LOCATION, &file_path(path.job, path.kind, &record.options));
    set(&mut response, header::CONTENT_LOCATION, &status_path(path.job, path.kind, &record.options));
    if let Some(wait) = wait {
        set(&mut response, PREFERENCE_APPLIED, &wait.applied());
    }
    Ok(response)
}
