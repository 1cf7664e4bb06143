//! Small parts of responses that every resource uses.

use axum::http::{HeaderValue, header};
use axum::response::Response;
use jiff::Timestamp;

/// Sets a header field whose value is known to be plain ASCII.
pub(crate) fn set(response: &mut Response, name: header::HeaderName, value: &str) {
    if let Ok(value) = HeaderValue::from_str(value) {
        response.headers_mut().insert(name, value);
    }
}

/// A moment of the store as clients see it.
pub(crate) fn time(us: i64) -> String {
    Timestamp::from_microsecond(us).unwrap_or_default().to_string()
}

/// A name of the store, in which an empty one stands for none.
pub(crate) fn named(name: &str) -> Option<String> {
    Some(name.to_owned()).filter(|name| !name.is_empty())
}
