//! What all submissions share: the `Idempotency-Key` and the digest of a body's content.

use std::time::Duration;

use axum::http::HeaderMap;
use serde_json::Value;
use tokio::time::timeout;

use crate::failure::Failure;
use crate::hex;
use crate::http::app::App;
use crate::http::client;
use crate::http::computing::busy;
use crate::problem::{Fault, Problem};

/// Longest `Idempotency-Key`.
const MAX_KEY_CHARS: usize = 255;

/// How long a large body waits until it may be read.
const LONGEST_WAIT: Duration = Duration::from_secs(10);

/// Reads a large or costly body on a thread that computes, few of them at once. `read` gets a function that tells
/// whether the client still waits: the reading ends early if it does not. A reading keeps its place until it ends, so
/// clients that hang up cannot start more of them.
pub(crate) async fn read_apart<T: Send + 'static>(
    app: &App,
    read: impl FnOnce(&dyn Fn() -> bool) -> Result<T, Failure> + Send + 'static,
) -> Result<T, Problem> {
    let place = timeout(LONGEST_WAIT, app.shared.large_bodies.wait(&client::current())).await;
    let Ok(place) = place else { return Err(busy()) };
    let reading = app.shared.compute.run(move |turn| {
        let _place = place;
        read(&|| turn.go_on())
    });
    Ok(reading.await??)
}

/// Digest of what a document says, whatever the order of its keys and its spaces.
pub(crate) fn content_sha256(mut value: Value) -> String {
    value.sort_all_objects();
    hex::sha256(value.to_string().as_bytes())
}

/// The `Idempotency-Key`, if there is one.
pub(crate) fn idempotency_key(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let Some(value) = headers.get("idempotency-key") else { return Ok(None) };
    let bytes = value.as_bytes();
    let visible = bytes.iter().all(u8::is_ascii_graphic);
    if !(1..=MAX_KEY_CHARS).contains(&bytes.len()) || !visible {
        let what =
            if visible { format!("has {} characters", bytes.len()) } else { "has other characters".into() };
        let bound =
            format!("{what}: must have at least 1 and at most {MAX_KEY_CHARS} visible ASCII characters");
        return Err(Problem::parameters(vec![Fault::header("Idempotency-Key", bound)]));
    }
    Ok(value.to_str().ok().map(str::to_owned))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_content_of_a_body_does_not_depend_on_its_form() {
        let digest = |value| content_sha256(value);
        assert_eq!(
            digest(json!({"a": {"b": 1, "c": 2}, "d": 3})),
            digest(json!({"d": 3, "a": {"c": 2, "b": 1}}))
        );
        assert_ne!(digest(json!({"a": 1})), digest(json!({"a": 2})));
    }

    #[test]
    fn keys_are_visible_and_bounded() {
        let key = |value: &str| {
            let mut headers = HeaderMap::new();
            headers.insert("idempotency-key", value.parse().unwrap());
            idempotency_key(&headers)
        };
        assert_eq!(idempotency_key(&HeaderMap::new()).unwrap(), None);
        assert_eq!(key("a-1").unwrap(), Some("a-1".into()));
        assert!(key(&"x".repeat(255)).is_ok());
        for bad in ["", "a b", &"x".repeat(256), "ü"] {
            let problem = key(bad).unwrap_err();
            assert_eq!((problem.status, problem.errors[0].header.as_deref()), (400, Some("Idempotency-Key")));
        }
    }
}
