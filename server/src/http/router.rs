//! The routes, and the layers around them.

use axum::Router;
use axum::http::{HeaderValue, header};
use axum::middleware;
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::http::app::App;
use crate::http::{events, exports, jobs, leases, observe, openapi, results, service, session, studies, web};
use crate::problem::{Kind, Problem};

/// The service as a router.
pub(crate) fn router(app: App) -> Router {
    let (router, document) = documented().split_for_parts();
    // Rendered once: it does not change while the process lives.
    let document = serde_json::to_string_pretty(&openapi::finished(&document)).unwrap_or_default();
    web::add_to(router, &app)
        .route("/openapi.json", get(move || async move { openapi_json(document) }))
        .fallback(|| async { Problem::new(Kind::NotFound, "there is no such route") })
        .layer(middleware::from_fn_with_state(app.clone(), observe::observe))
        .with_state(app)
}

/// The routes with their documentation.
pub(crate) fn documented() -> OpenApiRouter<App> {
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

fn openapi_json(document: String) -> Response {
    let mut response = document.into_response();
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static("application/json"));
    response
}
