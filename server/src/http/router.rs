//! The routes, and the layers around them.

use std::sync::LazyLock;

use axum::Router;
use axum::handler::Handler;
use axum::http::header;
use axum::middleware;
use axum::response::{IntoResponse as _, Response};
use axum::routing::{MethodFilter, get, on};
use serde_json::Value;
use utoipa::openapi::HttpMethod;
use utoipa::{OpenApi as _, Path};

use crate::http::app::App;
use crate::http::{events, exports, jobs, leases, observe, openapi, results, service, session, studies, web};
use crate::problem::{Kind, Problem};

/// From handlers, as `module: name`, makes the function `routes`, which adds them to a router, and the type
/// `Documented`, which is their documentation. Each handler states its path and method once, for both. To make the
/// documentation takes 60 ms, half of a start: it is made where it is asked for.
macro_rules! handlers {
    ($($($module:ident)::+: $name:ident,)+) => {
        fn routes(router: Router<App>) -> Router<App> {
            pastey::paste! {
                $(let router = route::<$($module::)+ [<__path_ $name>], _>(router, &$($module::)+ $name);)+
            }
            router
        }

        #[derive(utoipa::OpenApi)]
        #[openapi(paths($($($module::)+ $name),+))]
        struct Documented;
    };
}

handlers! {
    jobs::submit: submit,
    jobs::list: list,
    jobs::get: get,
    jobs::actions: delete,
    jobs::patch: patch,
    jobs::get: request,
    jobs::plans: plan,
    jobs::events: events,
    jobs::actions: cancel,
    jobs::actions: retry,
    results: get,
    results: summary,
    jobs::plots: get,
    exports::list: list,
    exports::file: get,
    exports::start: start,
    exports::delete: delete,
    exports::status: get,
    studies::submit: submit,
    studies::list: list,
    studies::get: get,
    studies::actions: delete,
    studies::patch: patch,
    jobs::list: list_of_study,
    studies::table: get,
    studies::plots: get,
    studies::actions: cancel,
    studies::actions: retry,
    events: events,
    leases::claim: lease,
    leases::renew: renew,
    leases::checkpoint: get,
    leases::checkpoint: put,
    leases::result: put,
    leases::end: end,
    service::meta: capabilities,
    service::key: get,
    session: begin,
    session: end,
    service::meta: health,
    service::meta: ready,
    service::meta: metrics,
    service::problem_pages: list,
    service::problem_pages: get,
}

/// The service as a router.
pub(crate) fn router(app: App) -> Router {
    web::add_to(routes(Router::new()), &app)
        .route("/openapi.json", get(openapi_json))
        .fallback(|| async { Problem::new(Kind::NotFound, "there is no such route") })
        .layer(middleware::from_fn_with_state(app.clone(), observe::observe))
        .with_state(app)
}

/// Adds a handler at the path and with the methods that it is documented with.
fn route<P: Path, T: 'static>(router: Router<App>, handler: &impl Handler<T, App>) -> Router<App> {
    let path = P::path();
    P::methods()
        .into_iter()
        .fold(router, |router, method| router.route(&path, on(filter(&method), handler.clone())))
}

fn filter(method: &HttpMethod) -> MethodFilter {
    match method {
        HttpMethod::Get => MethodFilter::GET,
        HttpMethod::Post => MethodFilter::POST,
        HttpMethod::Put => MethodFilter::PUT,
        HttpMethod::Patch => MethodFilter::PATCH,
        HttpMethod::Delete => MethodFilter::DELETE,
        HttpMethod::Head => MethodFilter::HEAD,
        HttpMethod::Options => MethodFilter::OPTIONS,
        HttpMethod::Trace => MethodFilter::TRACE,
    }
}

/// The document of the interface, as it is checked in.
pub(crate) fn document() -> Value {
    openapi::finished(&openapi::base().merge_from(Documented::openapi()))
}

/// The document as JSON, rendered at the first request: that takes longer than the rest of a start.
async fn openapi_json() -> Response {
    static DOCUMENT: LazyLock<String> =
        LazyLock::new(|| serde_json::to_string_pretty(&document()).unwrap_or_default());
    ([(header::CONTENT_TYPE, "application/json")], DOCUMENT.as_str()).into_response()
}
