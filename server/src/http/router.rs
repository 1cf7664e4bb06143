//! The routes, and the layers around them.

use std::sync::LazyLock;

use axum::Router;
use axum::http::header;
use axum::middleware;
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;
use serde_json::Value;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::http::app::App;
use crate::http::{events, exports, jobs, leases, observe, openapi, results, service, session, studies, web};
use crate::problem::{Kind, Problem};

/// The service as a router.
pub(crate) fn router(app: App) -> Router {
    let (router, _) = documented().split_for_parts();
    web::add_to(router, &app)
        .route("/openapi.json", get(openapi_json))
        .fallback(|| async { Problem::new(Kind::NotFound, "there is no such route") })
        .layer(middleware::from_fn_with_state(app.clone(), observe::observe))
        .with_state(app)
}

/// The routes with their documentation.
fn documented() -> OpenApiRouter<App> {
    OpenApiRouter::with_openapi(openapi::base())
        .routes(routes!(jobs::submit::submit, jobs::list::list))
        .routes(routes!(jobs::get::get, jobs::actions::delete, jobs::patch::patch))
        .routes(routes!(jobs::get::request))
        .routes(routes!(jobs::plans::plan))
        .routes(routes!(jobs::events::events))
        .routes(routes!(jobs::actions::cancel))
        .routes(routes!(jobs::actions::retry))
        .routes(routes!(results::get))
        .routes(routes!(results::summary))
        .routes(routes!(jobs::plots::get))
        .routes(routes!(exports::list::list))
        .routes(routes!(exports::file::get, exports::start::start, exports::delete::delete))
        .routes(routes!(exports::status::get))
        .routes(routes!(studies::submit::submit, studies::list::list))
        .routes(routes!(studies::get::get, studies::actions::delete, studies::patch::patch))
        .routes(routes!(jobs::list::list_of_study))
        .routes(routes!(studies::table::get))
        .routes(routes!(studies::plots::get))
        .routes(routes!(studies::actions::cancel))
        .routes(routes!(studies::actions::retry))
        .routes(routes!(events::events))
        .routes(routes!(leases::claim::lease))
        .routes(routes!(leases::renew::renew))
        .routes(routes!(leases::checkpoint::get, leases::checkpoint::put))
        .routes(routes!(leases::result::put))
        .routes(routes!(leases::end::end))
        .routes(routes!(service::meta::capabilities))
        .routes(routes!(service::key::get))
        .routes(routes!(session::begin, session::end))
        .routes(routes!(service::meta::health))
        .routes(routes!(service::meta::ready))
        .routes(routes!(service::meta::metrics))
        .routes(routes!(service::problem_pages::list))
        .routes(routes!(service::problem_pages::get))
}

/// The document of the interface, as it is checked in.
pub(crate) fn document() -> Value {
    openapi::finished(&documented().into_openapi())
}

/// The document as JSON, rendered at the first request: that takes longer than the rest of a start.
async fn openapi_json() -> Response {
    static DOCUMENT: LazyLock<String> =
        LazyLock::new(|| serde_json::to_string_pretty(&document()).unwrap_or_default());
    ([(header::CONTENT_TYPE, "application/json")], DOCUMENT.as_str()).into_response()
}
