//! Reading JSON bodies: what may be sent, how long, how fast.

use std::time::Duration;

use axum::body::Body;
use axum::http::{HeaderMap, header};
use bytes::{Bytes, BytesMut};
use http_body_util::BodyExt as _;
use serde_json::Value;
use tokio::time::{Instant, timeout, timeout_at};

use crate::http::app::{App, SMALL_BODY_BYTES};
use crate::http::params::shown;
use crate::problem::{Kind, Problem};
use crate::strict_json;
use crate::tasks;

/// Longest pause between two pieces of a body.
const IDLE: Duration = Duration::from_secs(30);
/// Longest time that a whole body may take.
const WHOLE: Duration = Duration::from_mins(5);
/// Bytes and time spent on the rest of a body that was refused: a client that still writes would
/// lose the answer to a connection reset.
const LINGER_BYTES: usize = 64 << 20;
const LINGER: Duration = Duration::from_secs(5);

/// Reads a JSON body as bytes.
///
/// # Errors
/// `unsupported-media-type`, `payload-too-large` without reading it all, `request-timeout`.
pub(crate) async fn json_bytes(app: &App, headers: &HeaderMap, body: Body) -> Result<Bytes, Problem> {
    if let Err(problem) = check_headers(headers, app.shared.max_body_bytes) {
        linger(body);
        return Err(problem);
    }
    collect(body, app.shared.max_body_bytes).await
}

/// Reads a JSON body. One that is long is parsed off the threads that answer.
///
/// # Errors
/// Those of [`json_bytes`], and `malformed-json`.
pub(crate) async fn json(app: &App, headers: &HeaderMap, body: Body) -> Result<Value, Problem> {
    let bytes = json_bytes(app, headers, body).await?;
    if bytes.len() <= SMALL_BODY_BYTES {
        return Ok(strict_json::parse(&bytes)?);
    }
    Ok(app.shared.documents.run(move |_| strict_json::parse(&bytes)).await??)
}

/// Refuses what need not be read to be refused.
fn check_headers(headers: &HeaderMap, max_bytes: u64) -> Result<(), Problem> {
    let text = |name| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
    if let Some(encoding) = text(header::CONTENT_ENCODING)
        && !encoding.trim().eq_ignore_ascii_case("identity")
    {
        return Err(Problem::new(
            Kind::UnsupportedMediaType,
            format!("Content-Encoding {} is not read: must be identity", shown(encoding)),
        )
        .with_header("accept-encoding", "identity"));
    }
    let content_type = text(header::CONTENT_TYPE);
    if !content_type.is_some_and(is_json) {
        let found = content_type.map_or("is missing".to_owned(), |t| format!("{} is not read", shown(t)));
        return Err(Problem::new(
            Kind::UnsupportedMediaType,
            format!("Content-Type {found}: must be application/json"),
        ));
    }
    let length = text(header::CONTENT_LENGTH).and_then(|length| length.parse::<u64>().ok());
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

async fn collect(mut body: Body, max_bytes: u64) -> Result<Bytes, Problem> {
    let mut collected = BytesMut::new();
    let end = Instant::now() + WHOLE;
    loop {
        let next = end.min(Instant::now() + IDLE);
        let Ok(frame) = timeout_at(next, body.frame()).await else {
            let (idle, whole) = (IDLE.as_secs(), WHOLE.as_secs());
            let detail = format!("the body paused for more than {idle} s or took more than {whole} s");
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
        let problem = collect(Body::from(vec![b' '; 11]), 10).await.err();
        assert_eq!(problem.map(|p| p.status), Some(413));
        assert_eq!(collect(Body::from(vec![b' '; 10]), 10).await.map(|b| b.len()), Ok(10));
    }
}
