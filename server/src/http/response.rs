//! Small parts of responses that every resource uses.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;
use serde_json::Value;

use crate::http::app::App;
use crate::jobs::moments;
use crate::problem::Problem;

/// Items of a list that are written at once.
pub(crate) const SHORT_LIST: usize = 100;
/// Values of a document beyond which it is long: writing it takes more than a millisecond.
const LONG: usize = 2000;

/// A document as JSON. One that is long is written off the threads that answer.
pub(crate) async fn json<T: Serialize + Send + 'static>(
    app: &App,
    status: StatusCode,
    document: T,
    is_long: bool,
) -> Response {
    if !is_long {
        return (status, axum::Json(document)).into_response();
    }
    let written = app.shared.documents.run(move |_| serde_json::to_vec(&document)).await;
    let written = written.and_then(|written| {
        written.map_err(|error| {
            tracing::error!(%error, "a document cannot be written");
            Problem::internal()
        })
    });
    match written {
        Ok(text) => (status, [(header::CONTENT_TYPE, "application/json")], text).into_response(),
        Err(problem) => problem.into_response(),
    }
}

/// Whether a document is long.
pub(crate) fn is_long(value: &Value) -> bool {
    fn count(value: &Value, left: &mut usize) {
        *left = left.saturating_sub(1);
        let below: &mut dyn Iterator<Item = &Value> = match value {
            Value::Array(items) => &mut items.iter(),
            Value::Object(members) => &mut members.values(),
            _ => return,
        };
        for item in below {
            if *left == 0 {
                return;
            }
            count(item, left);
        }
    }
    let mut left = LONG;
    count(value, &mut left);
    left == 0
}

/// Adds what every answer has: browsers take its type as it says, and no cache gives it to others. A cache may keep
/// what is no error, and asks each time whether it is still right.
pub(crate) fn protect<B>(response: &mut axum::http::Response<B>) {
    let is_error = response.status().is_client_error() || response.status().is_server_error();
    let headers = response.headers_mut();
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    if is_error {
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    } else {
        let private = HeaderValue::from_static("private, no-cache");
        headers.entry(header::CACHE_CONTROL).or_insert(private);
    }
}

/// Sets a header field whose value is known to be plain ASCII.
pub(crate) fn set(response: &mut Response, name: header::HeaderName, value: &str) {
    if let Ok(value) = HeaderValue::from_str(value) {
        response.headers_mut().insert(name, value);
    }
}

/// A moment of the store as clients see it.
pub(crate) fn time(us: i64) -> String {
    moments::text(us)
}

/// A name of the store, in which an empty one stands for none.
pub(crate) fn named(name: &str) -> Option<String> {
    Some(name.to_owned()).filter(|name| !name.is_empty())
}
