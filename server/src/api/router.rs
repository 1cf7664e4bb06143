//! The routes, and the layers around them.

use axum::Router;
use axum::http::{HeaderValue, header};
use axum::middleware;
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;
use serde_json::Value;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::{
    App, exports, formats, job_actions, job_events, job_list, jobs, meta, observe, openapi, plots,
    problem_pages, results, studies, study_actions, study_list, study_table,
};
use crate::problem::{Kind, Problem};

/// The service as a router.
pub(crate) fn router(app: App) -> Router {
    let (router, document) = documented().split_for_parts();
    // Rendered once: it does not change while the process lives.
    let document = serde_json::to_string_pretty(&openapi::finished(&document)).unwrap_or_default();
    router
        .route("/openapi.json", get(move || async move { openapi_json(document) }))
        .fallback(|| async { Problem::new(Kind::NotFound, "there is no such route") })
        .layer(middleware::from_fn_with_state(app.clone(), observe::observe))
        .with_state(app)
}

/// The document of the interface, as it is checked in.
pub(super) fn document() -> Value {
    openapi::finished(&documented().into_openapi())
}

fn documented() -> OpenApiRouter<App> {
    OpenApiRouter::with_openapi(openapi::base())
        .routes(routes!(jobs::submit, job_list::list))
        .routes(routes!(jobs::get, job_actions::delete))
        .routes(routes!(job_events::events))
        .routes(routes!(job_actions::cancel))
        .routes(routes!(job_actions::retry))
        .routes(routes!(results::get))
        .routes(routes!(results::summary))
        .routes(routes!(plots::of_job))
        .routes(routes!(formats::slice_svg))
        .routes(routes!(formats::slice_png))
        .routes(routes!(formats::slice_json))
        .routes(routes!(formats::slice_geo))
        .routes(routes!(exports::submit, exports::list))
        .routes(routes!(exports::get, exports::delete))
        .routes(routes!(exports::file))
        .routes(routes!(studies::submit, study_list::list))
        .routes(routes!(studies::get, study_actions::delete))
        .routes(routes!(job_list::list_of_study))
        .routes(routes!(study_table::get))
        .routes(routes!(plots::of_study))
        .routes(routes!(study_actions::cancel))
        .routes(routes!(study_actions::retry))
        .routes(routes!(meta::capabilities))
        .routes(routes!(meta::health))
        .routes(routes!(meta::ready))
        .routes(routes!(meta::metrics))
        .routes(routes!(problem_pages::list))
        .routes(routes!(problem_pages::get))
}

fn openapi_json(document: String) -> Response {
    let mut response = document.into_response();
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static("application/json"));
    response
}
