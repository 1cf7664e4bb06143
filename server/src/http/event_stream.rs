//! Streams of server-sent events as answers.
//!
//! Each begins with a comment, so that a client and the proxies before it see at once that it is there, and asks
//! proxies to pass every event on as it comes: nginx collects answers otherwise.

use std::convert::Infallible;
use std::future::ready;
use std::time::Duration;

use axum::http::{HeaderName, header};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse as _, Response};
use futures_util::StreamExt as _;
use futures_util::stream::{self, Stream};

use crate::http::response::set;

/// Proxies close what is silent for longer.
const KEEP_ALIVE: Duration = Duration::from_secs(15);

/// The events as an answer.
pub(crate) fn event_stream(
    events: impl Stream<Item = Result<Event, Infallible>> + Send + 'static,
) -> Response {
    let begun = stream::once(ready(Ok(Event::default().comment("events follow"))));
    let events = Sse::new(begun.chain(events)).keep_alive(KeepAlive::new().interval(KEEP_ALIVE));
    let mut response = events.into_response();
    set(&mut response, HeaderName::from_static("x-accel-buffering"), "no");
    set(&mut response, header::CACHE_CONTROL, "no-store, no-transform");
    response
}
