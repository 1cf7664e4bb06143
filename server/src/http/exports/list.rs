//! Listing the exports of a job.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;

use crate::http::app::App;
use crate::http::exports::view::Export;
use crate::http::pages::{self, DamagedItem, PageParameters};
use crate::http::params::{IdPath, JobPath, Query};
use crate::http::problems::refused;
use crate::http::response::set;
use crate::jobs::store::StoreError;
use crate::problem::Problem;

/// A page of the exports of a job.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct ExportPage {
    /// The exports, newest first.
    items: Vec<Export>,
    /// Items of the page whose record in the database is damaged; they are left out of `items`. Absent where there are
    /// none.
    #[cfg_attr(test, schema(required = false))]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    damaged: Vec<DamagedItem>,
    /// Where the next page starts; `null` on the last.
    #[cfg_attr(test, schema(required))]
    next_cursor: Option<String>,
}

/// List the exports of a job
///
/// Newest first: those that are kept, and those of the cache that are still there.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/jobs/{id}/exports", tag = "exports", operation_id = "list_exports",
    params(JobPath, PageParameters),
    responses(
        (status = 200, description = "A page", body = ExportPage,
            headers(("Link" = Option<String>, description = "`rel=\"next\"`: the next page, if there is one"))),
        crate::http::problems::sets::JobProblems
    )
))]
pub(crate) async fn list(
    State(app): State<App>,
    IdPath(id): JobPath,
    Query(mut page): Query<PageParameters>,
) -> Result<Response, Problem> {
    let listing = ("exports", id);
    let before = page.after(&listing)?.map(|item| item.seq);
    let store = &app.shared.store;
    let job = store.get(id).await.and_then(|job| job.ok_or(StoreError::NoJob));
    let job = job.map_err(|error| refused(error, id))?;
    let found = store.list_exports(job.seq, before, page.limit.get()).await?;
    let next_cursor = found.next_before.map(|seq| pages::cursor(seq, &listing));
    let items = found.exports.iter().map(Export::of).collect();
    let mut response = axum::Json(ExportPage {
        items,
        damaged: DamagedItem::all(found.damaged),
        next_cursor: next_cursor.clone(),
    })
    .into_response();
    if let Some(cursor) = next_cursor {
        page.turn_to(&cursor);
        set(&mut response, header::LINK, &pages::link(&format!("/v1/jobs/{id}/exports"), &page));
    }
    Ok(response)
}
