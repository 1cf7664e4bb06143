//! The routes, and the layers around them.

use axum::Router;
use axum::http::header;
use axum::middleware;
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;

use crate::http::app::App;
use crate::http::{
    contract, events, exports, jobs, leases, observe, results, service, session, studies, web,
};
use crate::problem::{Kind, Problem};

/// From methods, paths and handlers, as `method "path" => module: name`, makes the function `routes`, which adds them
/// to a router, and in tests the type `Documented`, which is what the handlers say of themselves, and a test that both
/// have the same methods and paths.
macro_rules! routes {
    ($($method:ident $path:literal => $($module:ident)::+: $name:ident,)+) => {
        fn routes(router: Router<App>) -> Router<App> {
            router$(.route($path, axum::routing::$method($($module::)+ $name)))+
        }

        #[cfg(test)]
        #[derive(utoipa::OpenApi)]
        #[openapi(paths($($($module::)+ $name),+))]
        pub(super) struct Documented;

        #[test]
        fn handlers_are_documented_as_they_are_routed() {
            pastey::paste! {$(
                assert_eq!(<$($module::)+ [<__path_ $name>] as utoipa::Path>::path(), $path);
                let methods = <$($module::)+ [<__path_ $name>] as utoipa::Path>::methods();
                assert!(methods == [utoipa::openapi::HttpMethod::[<$method:camel>]], "{}", $path);
            )+}
        }
    };
}

routes! {
    post "/v1/jobs" => jobs::submit: submit,
    get "/v1/jobs" => jobs::list: list,
    get "/v1/jobs/{id}" => jobs::get: get,
    delete "/v1/jobs/{id}" => jobs::actions: delete,
    patch "/v1/jobs/{id}" => jobs::patch: patch,
    get "/v1/jobs/{id}/request" => jobs::get: request,
    post "/v1/plans" => jobs::plans: plan,
    get "/v1/jobs/{id}/events" => jobs::events: events,
    post "/v1/jobs/{id}/cancel" => jobs::actions: cancel,
    post "/v1/jobs/{id}/retry" => jobs::actions: retry,
    get "/v1/jobs/{id}/result" => results: get,
    get "/v1/jobs/{id}/result/summary" => results: summary,
    get "/v1/jobs/{id}/plots/{kind}" => jobs::plots: get,
    get "/v1/jobs/{id}/exports" => exports::list: list,
    get "/v1/jobs/{id}/exports/{type}" => exports::file: get,
    post "/v1/jobs/{id}/exports/{type}" => exports::start: start,
    delete "/v1/jobs/{id}/exports/{type}" => exports::delete: delete,
    get "/v1/jobs/{id}/exports/{type}/status" => exports::status: get,
    post "/v1/studies" => studies::submit: submit,
    get "/v1/studies" => studies::list: list,
    get "/v1/studies/{id}" => studies::get: get,
    delete "/v1/studies/{id}" => studies::actions: delete,
    patch "/v1/studies/{id}" => studies::patch: patch,
    get "/v1/studies/{id}/jobs" => jobs::list: list_of_study,
    get "/v1/studies/{id}/table" => studies::table: get,
    get "/v1/studies/{id}/plots/{kind}" => studies::plots: get,
    post "/v1/studies/{id}/cancel" => studies::actions: cancel,
    post "/v1/studies/{id}/retry" => studies::actions: retry,
    get "/v1/events" => events: events,
    post "/v1/leases" => leases::claim: lease,
    post "/v1/leases/renewals" => leases::renew: renew,
    get "/v1/leases/{job}/{attempt}/checkpoint" => leases::checkpoint: get,
    put "/v1/leases/{job}/{attempt}/checkpoint" => leases::checkpoint: put,
    put "/v1/leases/{job}/{attempt}/result" => leases::result: put,
    post "/v1/leases/{job}/{attempt}/end" => leases::end: end,
    get "/v1/capabilities" => service::meta: capabilities,
    get "/v1/key" => service::key: get,
    post "/session" => session: begin,
    delete "/session" => session: end,
    get "/healthz" => service::meta: health,
    get "/readyz" => service::meta: ready,
    get "/metrics" => service::meta: metrics,
    get "/problems" => service::problem_pages: list,
    get "/problems/{kind}" => service::problem_pages: get,
}

/// The service as a router.
pub(crate) fn router(app: App) -> Router {
    web::add_to(routes(Router::new()), &app)
        .route("/openapi.json", get(openapi_json))
        .fallback(|| async { Problem::new(Kind::NotFound, "there is no such route") })
        .layer(middleware::from_fn_with_state(app.clone(), observe::observe))
        .with_state(app)
}

async fn openapi_json() -> Response {
    ([(header::CONTENT_TYPE, "application/json")], contract::JSON).into_response()
}
