//! Listing studies, newest first.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;
use utoipa::ToSchema;

use crate::http::app::App;
use crate::http::pages::{self, Page};
use crate::http::params::{Query, shown};
use crate::http::problems::sets::ListProblems;
use crate::http::response::set;
use crate::http::studies::view::StudySummary;
use crate::jobs::store::{StudyFilter, StudyState};
use crate::problem::Problem;

/// A page of studies.
#[derive(Serialize, ToSchema)]
pub(crate) struct StudyPage {
    /// The studies, newest first, without their requests.
    items: Vec<StudySummary>,
    /// Where the next page starts; `null` on the last.
    #[schema(required)]
    next_cursor: Option<String>,
}

/// Whether any job of a study is left to run.
#[derive(ToSchema)]
#[schema(as = StudyState, rename_all = "snake_case")]
#[allow(dead_code)]
pub(crate) enum StateParameter {
    /// Some wait or run.
    Open,
    /// All have ended.
    Finished,
}

/// List studies
///
/// Newest first. Items are studies without their `request`.
#[utoipa::path(
    get, path = "/v1/studies", tag = "studies", operation_id = "list_studies",
    params(
        ("state" = Option<StateParameter>, Query, description = "Only studies with jobs left to run (`open`), or without (`finished`)"),
        ("label" = Option<Vec<String>>, Query, explode, description = "`key=value`; only studies with this label; may be repeated, and then all must fit", example = json!(["series=TB-7"])),
        ("limit" = Option<i64>, Query, minimum = 1, maximum = 500, description = "Studies on a page; 50 when absent"),
        ("cursor" = Option<String>, Query, pattern = "^[0-9a-f]{32}$", description = "`next_cursor` of the page before, with the same filters"),
    ),
    responses(
        (status = 200, description = "A page", body = StudyPage,
            headers(("Link" = Option<String>, description = "`rel=\"next\"`: the next page, if there is one"))),
        ListProblems
    )
)]
pub(crate) async fn list(State(app): State<App>, mut query: Query) -> Result<Response, Problem> {
    let mut filter = StudyFilter::default();
    if let Some(name) = query.one("state") {
        filter.state = StudyState::from_name(&name);
        if filter.state.is_none() {
            query.fault("state", format!("{} is unknown: must be one of open, finished", shown(&name)));
        }
    }
    filter.labels = pages::labels(&mut query);
    let page = Page::read(&mut query, &filter);
    query.finish()?;
    let found = app.shared.store.list_studies(&filter, page.before, page.limit).await?;
    let next_cursor = found.next_before.map(|seq| pages::cursor(seq, &filter));
    let link = next_cursor.as_ref().map(|cursor| {
        let state = filter.state.map(|state| ("state", state.name().to_owned()));
        let parameters: Vec<_> = state.into_iter().chain(pages::label_filters(&filter.labels)).collect();
        page.link("/v1/studies", &parameters, cursor)
    });
    let items = found.studies.iter().map(|study| StudySummary::of(&app, study)).collect();
    let mut response = axum::Json(StudyPage { items, next_cursor }).into_response();
    if let Some(link) = link {
        set(&mut response, header::LINK, &link);
    }
    Ok(response)
}
