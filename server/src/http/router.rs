//! The routes, and the layers around them.

use std::sync::LazyLock;

use axum::Router;
use axum::extract::Request;
use axum::http::{Method, Uri, header};
use axum::middleware;
use axum::response::{IntoResponse as _, Redirect, Response};
use axum::routing::get;
use hyper::service::Service as _;
use hyper_util::service::TowerToHyperService;
use serde_json::Value;

use crate::base_path;
use crate::http::app::App;
use crate::http::response::protect;
use crate::http::{
    contract, events, exports, jobs, leases, mixes, observe, results, service, session, shapes, studies, web,
    workers,
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
    delete "/v1/jobs" => jobs::delete_many: delete,
    get "/v1/jobs/{id}" => jobs::get: get,
    delete "/v1/jobs/{id}" => jobs::actions: delete,
    patch "/v1/jobs/{id}" => jobs::patch: patch,
    get "/v1/jobs/{id}/request" => jobs::get: request,
    post "/v1/plans" => jobs::plans: plan,
    post "/v1/mixes/read" => mixes: read,
    post "/v1/mixes/blend" => mixes: blend,
    post "/v1/shapes" => shapes: sample,
    get "/v1/jobs/{id}/events" => jobs::events: events,
    post "/v1/jobs/{id}/cancel" => jobs::actions: cancel,
    post "/v1/jobs/{id}/finish" => jobs::actions: finish,
    post "/v1/jobs/{id}/retry" => jobs::actions: retry,
    get "/v1/jobs/{id}/result" => results: get,
    get "/v1/jobs/{id}/result/summary" => results: summary,
    get "/v1/jobs/{id}/plots/{kind}" => jobs::plots: get,
    get "/v1/jobs/{id}/exports" => exports::list: list,
    get "/v1/jobs/{id}/exports/{type}" => exports::file: get,
    post "/v1/jobs/{id}/exports/{type}" => exports::start: start,
    delete "/v1/jobs/{id}/exports/{type}" => exports::delete: delete,
    get "/v1/jobs/{id}/exports/{type}/script" => exports::script: get,
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
    get "/v1/leases/{task}/{attempt}/checkpoint" => leases::checkpoint: get,
    put "/v1/leases/{task}/{attempt}/checkpoint" => leases::checkpoint: put,
    get "/v1/leases/{task}/{attempt}/result" => leases::export: get,
    put "/v1/leases/{task}/{attempt}/result" => leases::result: put,
    put "/v1/leases/{task}/{attempt}/export" => leases::export: put,
    post "/v1/leases/{task}/{attempt}/end" => leases::end: end,
    get "/v1/workers" => workers: list,
    post "/v1/workers/allow" => workers: allow,
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

/// The service as a router. Below a base path requests are taken with and without it: one proxy removes it, another
/// does not, and probes know nothing of it.
pub(crate) fn router(app: App) -> Router {
    let at_root = at_root(app);
    let base = base_path::get();
    if base.as_str().is_empty() {
        return at_root;
    }
    let at_root = TowerToHyperService::new(at_root);
    Router::new().fallback(async move |mut request: Request| {
        let path = request.uri().path();
        if path == base.as_str() && request.method() == Method::GET {
            // The addresses of its pages are relative to a folder.
            let mut redirect = Redirect::permanent(&base_path::absolute("/")).into_response();
            protect(&mut redirect);
            return redirect;
        }
        let below = base.strip(path);
        if below.len() < path.len() {
            let query = request.uri().query().map(|query| format!("?{query}")).unwrap_or_default();
            let mut parts = request.uri().clone().into_parts();
            parts.path_and_query = format!("{below}{query}").parse().ok();
            if let Ok(uri) = Uri::from_parts(parts) {
                *request.uri_mut() = uri;
            }
        }
        match at_root.call(request).await {
            Ok(response) => response,
            Err(never) => match never {},
        }
    })
}

fn at_root(app: App) -> Router {
    web::add_to(routes(Router::new()), &app)
        .route("/openapi.json", get(openapi_json))
        .fallback(|| async { Problem::new(Kind::NotFound, "there is no such route") })
        .layer(middleware::from_fn_with_state(app.clone(), observe::observe))
        .with_state(app)
}

async fn openapi_json() -> Response {
    /// The document with the address of this server below its host.
    static BELOW: LazyLock<Option<String>> = LazyLock::new(|| {
        let base = base_path::get();
        let mut document: Value = serde_json::from_str(contract::JSON).ok()?;
        *document.pointer_mut("/servers/0/url")? = base.as_str().into();
        (!base.as_str().is_empty()).then(|| document.to_string())
    });
    let document = BELOW.as_deref().unwrap_or(contract::JSON);
    ([(header::CONTENT_TYPE, "application/json")], document).into_response()
}
