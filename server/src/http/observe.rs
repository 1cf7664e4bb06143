//! What happens around every request: its id, its log line, its count, its key, and the form of
//! its errors.
//!
//! Errors are written here and only here, those of the framework too: whatever leaves with an error
//! status and without a problem becomes one. So no answer of this service is plain text by accident.

use std::net::SocketAddr;
use std::panic::AssertUnwindSafe;
use std::time::Instant;

use axum::body::Body;
use axum::extract::{ConnectInfo, MatchedPath, Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use futures_util::FutureExt as _;
use tracing::Instrument as _;
use uuid::Uuid;

use crate::accounts::{Caller, Rate};
use crate::http::app::App;
use crate::http::auditing::Audited;
use crate::http::problems::{PROBLEM_JSON, Unwritten, unusable};
use crate::http::response::protect;
use crate::http::session::Site;
use crate::http::{access, auth, client, hosts, session, web};
use crate::problem::{Kind, Problem};

const REQUEST_ID: &str = "x-request-id";
/// Longest path, name of a program or address in a log line, in characters.
const MAX_LOGGED_CHARS: usize = 256;
/// Longest id of a request that is taken over from the client.
const MAX_REQUEST_ID_CHARS: usize = 128;
/// Routes that need no key: probes have none.
pub(crate) const OPEN_ROUTES: [&str; 2] = ["/healthz", "/readyz"];

/// The problem with which the connection has a request refused, in the extensions of the request, so that all problems
/// are written and counted here.
#[derive(Clone)]
pub(crate) struct Refused(pub(crate) Problem);

/// Whether a route needs no key and is not counted against rates: pages hold no data.
fn is_open(route: &str) -> bool {
    OPEN_ROUTES.contains(&route) || web::is_of_pages(route)
}

/// The middleware; outermost, and around the fallback too.
pub(crate) async fn observe(State(app): State<App>, mut request: Request, next: Next) -> Response {
    let started = Instant::now();
    let id = request_id(request.headers());
    let method = request.method().clone();
    // Paths have no end and may hold anything; metrics and logs get the route.
    let route = request
        .extensions()
        .get::<MatchedPath>()
        .map_or_else(|| access::UNKNOWN_ROUTE.into(), |m| m.as_str().to_owned());
    let path: String = request.uri().path().chars().take(MAX_LOGGED_CHARS).collect();
    let not_found = web::NotFound::of(&app, &method, request.uri(), request.headers());
    let client = client_address(&request, app.shared.trust_proxy);
    let agent = logged(request.headers(), header::USER_AGENT.as_str());
    let span = tracing::info_span!("request", request_id = id, %method, path);
    let mut key = String::new();
    let mut audited = None;
    let mut response = async {
        let (uri, headers) = (request.uri(), request.headers());
        let known = hosts::check(request.version(), uri, headers, app.shared.hosts.as_ref());
        let site = Site::of(uri, headers, app.shared.trust_proxy);
        let refused = request.extensions_mut().remove::<Refused>();
        let admitted = async {
            if let Some(Refused(problem)) = refused {
                return Err(problem);
            }
            known?;
            site.check(&method)?;
            let caller = authorize(&app, &route, &method, request.headers(), site)?;
            key.clone_from(&caller.by.key);
            admit(&app, &route, &caller)?;
            if !is_open(&route) {
                app.shared.store.usable().map_err(|why| unusable(&why))?;
            }
            audited = Audited::begin(&app, (&method, &route, &path), &id, &client, &caller);
            access::check(&app, &caller, &route, &mut request).await?;
            Ok::<_, Problem>(caller)
        };
        match admitted.await {
            Ok(caller) => {
                let of = client::client(&client, &caller.by);
                request.extensions_mut().insert(caller);
                request.extensions_mut().insert(site);
                let answer = client::answering(of, next.run(request));
                AssertUnwindSafe(answer).catch_unwind().await.unwrap_or_else(|_| {
                    tracing::error!("the handler panicked");
                    Problem::internal().into_response()
                })
            }
            Err(problem) => problem.into_response(),
        }
    }
    .instrument(span.clone())
    .await;
    if let Some(session::Begun(by)) = response.extensions().get() {
        key.clone_from(&by.key);
    }
    let status = response.status();
    if status.is_client_error() || status.is_server_error() {
        response = write_problem(response, &id);
        if let Some(page) = &not_found
            && (route == access::UNKNOWN_ROUTE || web::is_of_pages(&route))
        {
            response = page.in_place_of(response);
        }
    }
    if let Some(told) = audited.and_then(|audited| audited.answered(&response)) {
        told.await;
    }
    if let Ok(id) = HeaderValue::try_from(id) {
        response.headers_mut().insert(REQUEST_ID, id);
    }
    protect(&mut response);
    let took = started.elapsed();
    app.shared.metrics.request_answered(known_method(&method), &route, status.as_u16(), took);
    let took_ms = (took.as_secs_f64() * 1e5).round() / 1e2;
    span.in_scope(|| {
        if status.is_server_error() {
            tracing::warn!(status = status.as_u16(), took_ms, client, key, agent, "answered");
        } else {
            tracing::info!(status = status.as_u16(), took_ms, client, key, agent, "answered");
        }
    });
    response
}

/// The address of the client: that of the connection, or behind a trusted proxy the last entry of `X-Forwarded-For`,
/// which is the one that the proxy itself wrote.
pub(crate) fn client_address<B>(request: &Request<B>, trust_proxy: bool) -> String {
    let forwarded = || {
        let field = request.headers().get_all("x-forwarded-for").iter().next_back()?.to_str().ok()?;
        let last = field.rsplit(',').next()?.trim();
        (!last.is_empty()).then(|| last.chars().take(MAX_LOGGED_CHARS).collect::<String>())
    };
    let connection =
        || request.extensions().get::<ConnectInfo<SocketAddr>>().map(|info| info.0.ip().to_string());
    trust_proxy.then(forwarded).flatten().or_else(connection).unwrap_or_default()
}

/// A header field for the log, shortened.
fn logged(headers: &HeaderMap, name: &str) -> String {
    let text = headers.get(name).map(|value| String::from_utf8_lossy(value.as_bytes()));
    text.unwrap_or_default().chars().take(MAX_LOGGED_CHARS).collect()
}

/// Methods have no end either: a client may invent them.
fn known_method(method: &Method) -> &'static str {
    match method.as_str() {
        "GET" => "GET",
        "HEAD" => "HEAD",
        "POST" => "POST",
        "PUT" => "PUT",
        "PATCH" => "PATCH",
        "DELETE" => "DELETE",
        _ => "other",
    }
}

fn authorize(
    app: &App,
    route: &str,
    method: &Method,
    headers: &HeaderMap,
    site: Site,
) -> Result<Caller, Problem> {
    let sessions = &app.shared.sessions;
    match app.shared.accounts.keys() {
        Some(keys) if route == session::ROUTE => Ok(session::caller(sessions, &keys, method, headers)),
        Some(keys) if !is_open(route) => auth::caller(&keys, sessions, method, headers, site),
        _ => Ok(Caller::default()),
    }
}

/// Refuses a caller who sends too many requests. Probes and pages are not counted.
pub(crate) fn admit(app: &App, route: &str, caller: &Caller) -> Result<(), Problem> {
    if is_open(route) {
        return Ok(());
    }
    app.shared.accounts.admit(caller).map_err(|(rate, wait)| {
        app.shared.metrics.request_over_rate();
        let who = match caller.by.key.as_str() {
            "" => "all clients together".to_owned(),
            key => format!("the API key {key:?}"),
        };
        let Rate { per_second, burst } = rate;
        let detail = format!("{who} may send {per_second} requests a second on average, and {burst} at once");
        let seconds = wait.as_secs_f64().ceil().max(1.0);
        Problem::new(Kind::TooManyRequests, detail).with_header("retry-after", format!("{seconds:.0}"))
    })
}

/// The client's id of the request where it is fit for a log line, else a fresh one.
fn request_id(headers: &HeaderMap) -> String {
    let sane = |id: &&str| {
        (1..=MAX_REQUEST_ID_CHARS).contains(&id.len())
            && id.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_.".contains(&b))
    };
    headers
        .get(REQUEST_ID)
        .and_then(|value| value.to_str().ok())
        .filter(sane)
        .map_or_else(|| Uuid::now_v7().to_string(), str::to_owned)
}

fn write_problem(mut response: Response, request_id: &str) -> Response {
    let problem = match response.extensions_mut().remove::<Unwritten>() {
        Some(Unwritten(problem)) => *problem,
        None => of_framework(response.status()),
    };
    let document = problem.document(Some(format!("urn:packstone:request:{request_id}")));
    let body = serde_json::to_string(&document).unwrap_or_default();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
    headers.insert(header::CONTENT_LENGTH, HeaderValue::from(body.len()));
    *response.body_mut() = Body::from(body);
    response
}

/// The problem behind an error that the framework answered with by itself.
fn of_framework(status: StatusCode) -> Problem {
    match status {
        StatusCode::NOT_FOUND => Problem::new(Kind::NotFound, "there is no such route"),
        StatusCode::METHOD_NOT_ALLOWED => {
            Problem::new(Kind::MethodNotAllowed, "the route exists, but not with this method")
        }
        _ => {
            tracing::error!(status = status.as_u16(), "an error without a problem");
            let mut problem = Problem::internal();
            problem.status = status.as_u16();
            problem
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn only_sane_request_ids_are_taken_over() {
        let with = |id: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(REQUEST_ID, HeaderValue::from_bytes(id.as_bytes()).unwrap());
            request_id(&headers)
        };
        assert_eq!(with("lab-7.a_B"), "lab-7.a_B");
        for bad in ["", "a b", "a\"b", "ü", &"x".repeat(129)] {
            assert_eq!(with(bad).len(), 36, "{bad}");
        }
        assert_eq!(request_id(&HeaderMap::new()).len(), 36);
    }
}
