//! Listing studies, newest first.

use axum::Extension;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;

use crate::accounts::Caller;
use crate::http::app::App;
use crate::http::pages::{self, DamagedItem, PageParameters};
use crate::http::params::values::Labels;
use crate::http::params::{Query, choices, parameters};
use crate::http::response::set;
use crate::http::studies::view::StudySummary;
use crate::jobs::store::{StudyFilter, StudyState};
use crate::problem::Problem;

/// A page of studies.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct StudyPage {
    /// The studies, newest first, without their requests.
    items: Vec<StudySummary>,
    /// Items of the page whose record in the database is damaged; they are left out of `items`. Absent where there are
    /// none.
    #[cfg_attr(test, schema(required = false))]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    damaged: Vec<DamagedItem>,
    /// Where the next page starts; `null` on the last.
    #[cfg_attr(test, schema(required))]
    next_cursor: Option<String>,
}

choices! {
    StudyState,
}

parameters! {
    /// The studies of a list.
    #[derive(Clone, Debug)]
    pub(crate) struct StudyListParameters {
        /// Only studies with jobs left to run (`open`), or without (`finished`).
        state: Option<StudyState>,
        /// `key=value`; only studies with this label; may be repeated, and then all must fit.
        label: Labels,
        ..page: PageParameters,
    }
}

/// List studies
///
/// Newest first. Items are studies without their `request`. A key with the role `admin` sees all studies, any other key
/// those of its owner and those that are shared.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/studies", tag = "studies", operation_id = "list_studies",
    params(StudyListParameters),
    responses(
        (status = 200, description = "A page", body = StudyPage,
            headers(("Link" = Option<String>, description = "`rel=\"next\"`: the next page, if there is one"))),
        crate::http::problems::sets::ListProblems
    )
))]
pub(crate) async fn list(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    Query(mut query): Query<StudyListParameters>,
) -> Result<Response, Problem> {
    let filter =
        StudyFilter { state: query.state, labels: query.label.0.clone(), visible_to: caller.sees_only() };
    let before = query.page.after(&filter)?.map(|item| item.seq);
    let found = app.shared.store.list_studies(&filter, before, query.page.limit.get()).await?;
    let next_cursor = found.next_before.map(|seq| pages::cursor(seq, &filter));
    let link = next_cursor.as_ref().map(|cursor| {
        query.page.turn_to(cursor);
        pages::link("/v1/studies", &query)
    });
    let items = found.studies.iter().map(|study| StudySummary::of(&app, study)).collect();
    let mut response = axum::Json(StudyPage { items, damaged: DamagedItem::all(found.damaged), next_cursor })
        .into_response();
    if let Some(link) = link {
        set(&mut response, header::LINK, &link);
    }
    Ok(response)
}
