//! Asking how a study is, with long polls.

use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;

use crate::accounts::Caller;
use crate::http::app::App;
use crate::http::conditional::Wait;
use crate::http::jobs::get::IncludeParameters;
use crate::http::params::{IdPath, Query, StudyPath};
use crate::http::problems::refused;
use crate::http::studies::view;
use crate::http::waiting::{self, Asked};
use crate::ids::StudyId;
use crate::jobs::store::{StoreError, StudyRecord};
use crate::problem::Problem;

/// Get a study
///
/// With `Prefer: wait=N` the answer is held back for at most N s: until the study differs from
/// `If-None-Match` (304 if it never does), or without that field until the study is finished. The request, which may be
/// long, is left out unless `include=request` asks for it.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/studies/{id}", tag = "studies", operation_id = "get_study",
    params(
        StudyPath,
        IncludeParameters,
        ("If-None-Match" = Option<String>, Header, description = "Tag of the study as known"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`, at most 60"),
    ),
    responses(
        (status = 200, description = "The study", body = view::Study,
            headers(("ETag" = String, description = "Tag of the study"))),
        (status = 304, description = "The study is as known"),
        crate::http::problems::sets::StudyProblems
    )
))]
pub(crate) async fn get(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    IdPath(id): StudyPath,
    Query(query): Query<IncludeParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let asked = Asked::of(&headers);
    let answered = async {
        let record = wait_until(&app, id, asked.wait(), |study| asked.settles(study)).await?;
        let whole = view::response(&app, &caller, StatusCode::OK, &record, query.with_request());
        asked.answer(&record, whole).await
    };
    answered.await.map_err(|error| refused(error, id))
}

/// Waits until a study is in the awaited state, the time is over, or the server stops; the study as it is then.
pub(crate) async fn wait_until(
    app: &App,
    id: StudyId,
    wait: Wait,
    reached: impl Fn(&StudyRecord) -> bool,
) -> Result<StudyRecord, StoreError> {
    let store = &app.shared.store;
    let read = move || async move { store.study(id).await?.ok_or(StoreError::NoStudy) };
    waiting::wait_until(app, wait, store.subscribe_study(id), read, reached).await
}
