//! Listing the exports of a job.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;
use utoipa::ToSchema;

use crate::http::app::App;
use crate::http::exports::view::Export;
use crate::http::pages::{self, Page};
use crate::http::params::{JobPath, Query};
use crate::http::problems::refused;
use crate::http::problems::sets::JobProblems;
use crate::http::response::set;
use crate::jobs::store::StoreError;
use crate::problem::Problem;

/// A page of the exports of a job.
#[derive(Serialize, ToSchema)]
pub(crate) struct ExportPage {
    /// The exports, newest first.
    items: Vec<Export>,
    /// Where the next page starts; `null` on the last.
    #[schema(required)]
    next_cursor: Option<String>,
}

/// List the exports of a job
///
/// Newest first: those that are kept, and those of the cache that are still there.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/exports", tag = "exports", operation_id = "list_exports",
    params(
        ("id" = String, Path, format = "uuid", description = "ID of the job"),
        ("limit" = Option<i64>, Query, minimum = 1, maximum = 500, description = "Exports on a page; 50 when absent"),
        ("cursor" = Option<String>, Query, pattern = "^[0-9a-f]{32}$", description = "`next_cursor` of the page before"),
    ),
    responses(
        (status = 200, description = "A page", body = ExportPage,
            headers(("Link" = Option<String>, description = "`rel=\"next\"`: the next page, if there is one"))),
        JobProblems
    )
)]
pub(crate) async fn list(
    State(app): State<App>,
    JobPath(id): JobPath,
    mut query: Query,
) -> Result<Response, Problem> {
    let listing = ("exports", id);
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
