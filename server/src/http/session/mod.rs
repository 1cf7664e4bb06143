//! Sessions of browsers: an API key is exchanged for a cookie, because event streams, pictures and plain downloads
//! carry no header, and because a key is not to be kept by a page.
//!
//! The cookie is `HttpOnly` and `SameSite=Strict`, and `Secure` where the browser reaches the server by TLS. It stands
//! for the key in every request without `Authorization`.

mod cookie;
mod site;

use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use jiff::Timestamp;
use packstone_engine::request::decode::{At, Faults};

use crate::accounts::{ApiKeys, Caller, Submitter, digest};
use crate::base_path;
use crate::failure::Failure;
use crate::http::app::App;
use crate::http::body::RequestBody;
use crate::http::params::{NoParameters, Query};
use crate::http::response::set;
use crate::http::{auth, observe};
use crate::problem::Problem;

pub(crate) use cookie::{COOKIE, Sessions};
pub(crate) use site::Site;

/// The route of sessions.
pub(crate) const ROUTE: &str = "/session";
/// Longest body: it holds one key, and is read before the client has shown any.
const MAX_BODY_BYTES: u64 = 4 << 10;

/// Who has begun a session, in the extensions of the answer: for the logs.
#[derive(Clone)]
pub(crate) struct Begun(pub(crate) Submitter);

/// The request of a session.
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[expect(dead_code, reason = "it is read by hand, so that its faults have places")]
pub(crate) struct SessionRequest {
    /// The API key.
    key: String,
}

/// The user of a request about sessions, which needs no key: whose session is to be ended, if it has one.
pub(crate) fn caller(sessions: &Sessions, keys: &ApiKeys, method: &Method, headers: &HeaderMap) -> Caller {
    let is_end = method == Method::DELETE;
    let known = is_end.then(|| sessions.caller(keys, headers, Timestamp::now().as_second())).flatten();
    known.unwrap_or_default()
}

/// Begin a session
///
/// Exchanges an API key for a cookie that stands for it in requests of a browser, for 12 h at most: a session ends with
/// its key, by `DELETE /session`, and when the server is started again. Requests that may change something are taken by
/// the cookie from pages of this server only (`Sec-Fetch-Site: same-origin`, or `Origin`), others are refused with 403.
/// Where the server asks for no key there is nothing to exchange, and no cookie is set.
#[cfg_attr(test, utoipa::path(
    post, path = "/session", tag = "service", operation_id = "begin_session",
    request_body = SessionRequest,
    responses(
        (status = 204, description = "The session has begun",
            headers(("Set-Cookie" = String, description = "The cookie `packstone_session`"))),
        crate::http::problems::sets::SessionProblems
    )
))]
pub(crate) async fn begin(
    State(app): State<App>,
    _: Query<NoParameters>,
    headers: HeaderMap,
    mut body: RequestBody,
) -> Result<Response, Problem> {
    let key = read(&body.json(&app, MAX_BODY_BYTES).await?)?;
    let mut response = StatusCode::NO_CONTENT.into_response();
    let Some(keys) = app.shared.accounts.keys() else { return Ok(response) };
    let caller = auth::of_key(&keys, &key)?;
    observe::admit(&app, ROUTE, &caller)?;
    let value = app.shared.sessions.begin(&digest(&key), Timestamp::now().as_second());
    set_cookie(&app, &headers, &mut response, &value, cookie::SESSION_S);
    response.extensions_mut().insert(Begun(caller.by));
    Ok(response)
}

/// End a session
///
/// The cookie is of no use any more, and the browser is told to forget it. It is no fault if there is no session.
#[cfg_attr(test, utoipa::path(
    delete, path = "/session", tag = "service", operation_id = "end_session",
    responses(
        (status = 204, description = "There is no session",
            headers(("Set-Cookie" = String, description = "The cookie `packstone_session`, which is over"))),
        crate::http::problems::sets::OpenProblems
    )
))]
pub(crate) async fn end(
    State(app): State<App>,
    Extension(_): Extension<Caller>,
    _: Query<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    if let Some(keys) = app.shared.accounts.keys() {
        app.shared.sessions.end(&keys, &headers, Timestamp::now().as_second());
    }
    let mut response = StatusCode::NO_CONTENT.into_response();
    set_cookie(&app, &headers, &mut response, "", 0);
    Ok(response)
}

fn read(value: &serde_json::Value) -> Result<String, Problem> {
    let faults = Faults::default();
    let mut key = None;
    if let Some(mut object) = At::root(value, &faults).object() {
        key = object.required("key").and_then(|at| at.string().map(str::to_owned));
        object.finish();
    }
    match key {
        Some(key) if faults.count() == 0 => Ok(key),
        _ => Err(Failure::invalid(faults.into_vec()).into()),
    }
}

fn set_cookie(app: &App, headers: &HeaderMap, response: &mut Response, value: &str, seconds: i64) {
    let secure = if site::is_by_tls(headers, app.shared.trust_proxy) { "; Secure" } else { "" };
    let path = if base_path::get().as_str().is_empty() { "/" } else { base_path::get().as_str() };
    let cookie =
        format!("{COOKIE}={value}; Path={path}; Max-Age={seconds}; HttpOnly; SameSite=Strict{secure}");
    set(response, header::SET_COOKIE, &cookie);
    set(response, header::CACHE_CONTROL, "no-store");
}
