//! Reading bodies, of JSON or of a file: what may be sent, how long, how fast, and how much memory they hold together.

use std::convert::Infallible;
use std::time::Duration;

use axum::body::Body;
use axum::extract::{FromRequest, Request};
use axum::http::{HeaderMap, header};
use bytes::{Bytes, BytesMut};
use http_body_util::BodyExt as _;
use serde_json::Value;
use tokio::time::{Instant, timeout, timeout_at};

use crate::http::app::{App, SMALL_BODY_BYTES};
use crate::http::observe::client_address;
use crate::http::pace::Pace;
use crate::http::params::shown;
use crate::memory_budget::{Exceeded, Reservation, UNCOUNTED_BYTES};
use crate::problem::{Kind, Problem};
use crate::strict_json;
use crate::tasks;

/// Longest body of a change of a job or a study: 32 labels of the longest text have 41 kB.
pub(crate) const PATCH_BYTES: u64 = 64 << 10;
/// Longest time that a whole body may take.
const WHOLE: Duration = Duration::from_mins(5);
/// Bytes and time spent on the rest of a body that was refused: a client that still writes would
/// lose the answer to a connection reset.
const LINGER_BYTES: usize = 64 << 20;
const LINGER: Duration = Duration::from_secs(5);

/// The body of a request, unread. Its memory counts until this is dropped: a handler keeps it to its end, for what it
/// has read from the body takes memory, too.
pub(crate) struct RequestBody {
    headers: HeaderMap,
    body: Body,
    /// Longest body that the server reads, whatever the route.
    longest: u64,
    memory: Reservation,
}

impl FromRequest<App> for RequestBody {
    type Rejection = Infallible;

    async fn from_request(request: Request, app: &App) -> Result<Self, Infallible> {
        let client = client_address(&request, app.shared.trust_proxy);
        let memory = app.shared.memory_budget.reservation(Some(&client));
        let (parts, body) = request.into_parts();
        Ok(Self { headers: parts.headers, body, longest: app.shared.max_body_bytes, memory })
    }
}

impl RequestBody {
    /// Reads the body, which is JSON and may have so many bytes on its route.
    ///
    /// # Errors
    /// `unsupported-media-type` and `payload-too-large` without reading it all, `request-timeout`, `busy` where the
    /// memory for bodies is used up.
    pub(crate) async fn read(&mut self, max_bytes: u64) -> Result<Bytes, Problem> {
        let is_json = check_json(&self.headers);
        self.read_checked(is_json, max_bytes).await
    }

    /// The same of a body of any media type.
    ///
    /// # Errors
    /// Those of [`Self::read`].
    pub(crate) async fn read_file(&mut self, max_bytes: u64) -> Result<Bytes, Problem> {
        self.read_checked(Ok(()), max_bytes).await
    }

    async fn read_checked(
        &mut self,
        media_type: Result<(), Problem>,
        max_bytes: u64,
    ) -> Result<Bytes, Problem> {
        let (body, max_bytes) = (std::mem::take(&mut self.body), max_bytes.min(self.longest));
        let checked = check_encoding(&self.headers).and(media_type);
        if let Err(problem) = checked.and_then(|()| check_length(&self.headers, max_bytes)) {
            linger(body);
            return Err(problem);
        }
        collect(body, max_bytes, &mut self.memory).await
    }

    /// Reads a body of JSON, parsed: where it is long, off the threads that answer.
    ///
    /// # Errors
    /// Those of [`Self::read`], and `malformed-json`.
    pub(crate) async fn json(&mut self, app: &App, max_bytes: u64) -> Result<Value, Problem> {
        let bytes = self.read(max_bytes).await?;
        if bytes.len() <= SMALL_BODY_BYTES {
            return Ok(strict_json::parse(&bytes)?);
        }
        Ok(app.shared.documents.run(move |_| strict_json::parse(&bytes)).await??)
    }
}

fn text(headers: &HeaderMap, name: header::HeaderName) -> Option<&str> {
    headers.get(name).map(|value| value.to_str().unwrap_or("?"))
}

fn check_encoding(headers: &HeaderMap) -> Result<(), Problem> {
    if let Some(encoding) = text(headers, header::CONTENT_ENCODING)
        && !encoding.trim().eq_ignore_ascii_case("identity")
    {
        return Err(Problem::new(
            Kind::UnsupportedMediaType,
            format!("Content-Encoding {} is not read: must be identity", shown(encoding)),
        )
        .with_header("accept-encoding", "identity"));
    }
    Ok(())
}

fn check_json(headers: &HeaderMap) -> Result<(), Problem> {
    let content_type = text(headers, header::CONTENT_TYPE);
    if !content_type.is_some_and(is_json) {
        let found = content_type.map_or("is missing".to_owned(), |t| format!("{} is not read", shown(t)));
        return Err(Problem::new(
            Kind::UnsupportedMediaType,
            format!("Content-Type {found}: must be application/json"),
        ));
    }
    Ok(())
}

fn check_length(headers: &HeaderMap, max_bytes: u64) -> Result<(), Problem> {
    let length = text(headers, header::CONTENT_LENGTH).and_then(|length| length.parse::<u64>().ok());
    match length {
        Some(length) if length > max_bytes => Err(too_large(&format!("{length} bytes"), max_bytes)),
        _ => Ok(()),
    }
}

/// Refuses a body where the route has none: its sender would believe it was read.
///
/// # Errors
/// `unsupported-media-type`.
pub(crate) fn expect_none(headers: &HeaderMap) -> Result<(), Problem> {
    let length = headers.get(header::CONTENT_LENGTH);
    if headers.contains_key(header::TRANSFER_ENCODING) || length.is_some_and(|length| length != "0") {
        let detail = "the request has a body: this route reads none, its options are query parameters";
        return Err(Problem::new(Kind::UnsupportedMediaType, detail).with_header("connection", "close"));
    }
    Ok(())
}

fn too_large(found: &str, max_bytes: u64) -> Problem {
    Problem::new(Kind::PayloadTooLarge, format!("the body has {found}: must have at most {max_bytes} bytes"))
        .with(|members| members.max_bytes = Some(max_bytes))
        .with_header("connection", "close")
}

/// `application/json` or a `+json` type, in UTF-8.
fn is_json(content_type: &str) -> bool {
    let mut parts = content_type.split(';').map(str::trim);
    let media_type = parts.next().unwrap_or_default().to_ascii_lowercase();
    let json = media_type == "application/json"
        || media_type
            .split_once('/')
            .is_some_and(|(top, sub)| top == "application" && sub.ends_with("+json"));
    json && parts.filter_map(|p| p.split_once('=')).all(|(name, value)| {
        !name.trim().eq_ignore_ascii_case("charset")
            || value.trim().trim_matches('"').eq_ignore_ascii_case("utf-8")
    })
}

async fn collect(mut body: Body, max_bytes: u64, memory: &mut Reservation) -> Result<Bytes, Problem> {
    let mut collected = BytesMut::new();
    let end = Instant::now() + WHOLE;
    let mut pace = Pace::new();
    loop {
        let Ok(frame) = timeout_at(end.min(pace.deadline()), body.frame()).await else {
            let detail = format!(
                "the body arrives too slowly: it {} and may take at most {} s",
                Pace::bound(),
                WHOLE.as_secs()
            );
            return Err(Problem::new(Kind::RequestTimeout, detail).with_header("connection", "close"));
        };
        match frame {
            None => return Ok(collected.freeze()),
            Some(Ok(frame)) => {
                let Ok(data) = frame.into_data() else { continue };
                if (collected.len() + data.len()) as u64 > max_bytes {
                    linger(body);
                    return Err(too_large("more bytes than are read", max_bytes));
                }
                if let Err(exceeded) = memory.grow(data.len() as u64) {
                    // Freed before the rest is awaited.
                    drop((collected, data));
                    memory.clear();
                    linger(body);
                    return Err(no_memory(exceeded).with_header("connection", "close"));
                }
                pace.arrived(data.len(), memory.bytes() <= UNCOUNTED_BYTES);
                collected.extend_from_slice(&data);
            }
            Some(Err(error)) => {
                tracing::debug!(%error, "a body ended early");
                return Err(Problem::new(Kind::MalformedJson, "the body ended early")
                    .with_header("connection", "close"));
            }
        }
    }
}

/// The answer where the memory for requests and answers is used up.
pub(crate) fn no_memory(exceeded: Exceeded) -> Problem {
    Problem::new(Kind::Busy, exceeded.to_string()).with_header("retry-after", "5")
}

/// Takes in some more of a body that was refused, behind the answer's back.
pub(crate) fn linger(mut body: Body) {
    tasks::spawn(timeout(LINGER, async move {
        let mut taken = 0;
        while taken < LINGER_BYTES
            && let Some(Ok(frame)) = body.frame().await
        {
            taken += frame.data_ref().map_or(0, Bytes::len);
        }
    }));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory_budget::MemoryBudget;

    #[test]
    fn only_utf8_json_is_json() {
        for good in [
            "application/json",
            "Application/JSON; charset=UTF-8",
            "application/vnd.lab+json;charset=\"utf-8\"",
        ] {
            assert!(is_json(good), "{good}");
        }
        for bad in ["", "text/json", "application/json; charset=latin1", "application/jsonp", "text/x+json"] {
            assert!(!is_json(bad), "{bad}");
        }
    }

    #[tokio::test]
    async fn a_body_without_a_length_is_bounded_too() {
        let mut memory = MemoryBudget::new(0, 0).reservation(None);
        let problem = collect(Body::from(vec![b' '; 11]), 10, &mut memory).await.err();
        assert_eq!(problem.map(|p| p.status), Some(413));
        assert_eq!(collect(Body::from(vec![b' '; 10]), 10, &mut memory).await.map(|b| b.len()), Ok(10));
    }

    #[tokio::test]
    async fn a_body_beyond_the_memory_for_bodies_is_refused_and_holds_nothing() {
        let budget = MemoryBudget::new(1 << 20, 1 << 20);
        let (mut first, mut second) = (budget.reservation(None), budget.reservation(None));
        let megabyte = || Body::from(vec![b' '; 1 << 20]);
        assert!(collect(megabyte(), 1 << 30, &mut first).await.is_ok());
        let problem = collect(megabyte(), 1 << 30, &mut second).await.err();
        assert_eq!(problem.map(|p| (p.kind, p.headers[0].0)), Some((Kind::Busy, "retry-after")));
        assert_eq!(second.bytes(), 0);
        drop(first);
        assert!(collect(megabyte(), 1 << 30, &mut second).await.is_ok());
    }
}
