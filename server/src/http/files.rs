//! What is handed out as a file: whole or in part, with a strong tag, as RFC 9110 has it.
//!
//! Its length is known before its first byte is sent. Whose bytes they are, and where they come from, is for others
//! to know.

use std::fmt::Write as _;
use std::io;
use std::ops::Range;
use std::time::Duration;

use axum::body::Body;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use bytes::Bytes;
use futures_util::stream;
use tokio::sync::mpsc;
use tokio::time::timeout;

use crate::artifacts::stream as sending;
use crate::blobs::Blob;
use crate::fair_places::Place;
use crate::http::app::App;
use crate::http::client;
use crate::http::coding::takes_gzip;
use crate::http::conditional;
use crate::http::problems::of_fault;
use crate::http::ranges::Asked;
use crate::http::response::set;
use crate::jobs::store::Fault;
use crate::jobs::{JobRecord, Overview};
use crate::problem::{Kind, Problem};
use crate::tasks;

/// How long a download waits for another to end before it is refused.
const TURN: Duration = Duration::from_secs(10);

/// Longest part of a file name that comes from the name of a job, in characters.
const MAX_NAME_CHARS: usize = 60;

/// The name under which a client saves a file: what the job is called or packs, its seed, and the settings that the
/// ending has; and for old clients the same in ASCII.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct FileName {
    name: String,
    ascii: String,
}

impl FileName {
    /// The name of a file of a job, with an ending. A job without a name is called by its mix.
    pub(crate) fn of(job: &JobRecord, ending: &str) -> Self {
        let called = job.name.clone().or_else(|| job.overview.as_ref().map(Overview::file_stem));
        Self::named(called.as_deref(), job.seed.cast_unsigned(), &job.id.to_string(), ending)
    }

    fn named(called: Option<&str>, seed: u64, id: &str, ending: &str) -> Self {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "_.".contains(c);
        // Accents may be marks of their own.
        let is_letter = |c: char| is_plain(c) || c.is_alphanumeric() || ('\u{300}'..='\u{36f}').contains(&c);
        let with = |is_allowed: &dyn Fn(char) -> bool| match slug(called.unwrap_or_default(), is_allowed) {
            slug if slug.is_empty() => format!("{id}.{ending}"),
            slug => format!("{slug}-seed{seed}.{ending}"),
        };
        Self { name: with(&is_letter), ascii: with(&is_plain) }
    }

    /// The same in ASCII alone.
    pub(crate) fn into_ascii(self) -> String {
        self.ascii
    }

    /// A name that is plain ASCII.
    pub(crate) fn plain(name: String) -> Self {
        Self { ascii: name.clone(), name }
    }

    /// `Content-Disposition` of a file that is shown, or saved (RFC 6266; the encoding of RFC 8187).
    pub(crate) fn disposition(&self, inline: bool) -> String {
        let how = if inline { "inline" } else { "attachment" };
        let mut disposition = format!("{how}; filename=\"{}\"", self.ascii);
        if self.name != self.ascii {
            disposition.push_str("; filename*=UTF-8''");
            for byte in self.name.bytes() {
                match byte {
                    b'-' | b'_' | b'.' => disposition.push(byte.into()),
                    _ if byte.is_ascii_alphanumeric() => disposition.push(byte.into()),
                    // Writing to a string cannot fail.
                    _ => _ = write!(disposition, "%{byte:02X}"),
                }
            }
        }
        disposition
    }
}

/// A text with hyphens in the places of what is not allowed, one for several, and none at its ends.
fn slug(text: &str, is_allowed: &dyn Fn(char) -> bool) -> String {
    let mut slug: String =
        text.chars().map(|c| if is_allowed(c) { c } else { '-' }).take(MAX_NAME_CHARS).collect();
    while slug.contains("--") {
        slug = slug.replace("--", "-");
    }
    slug.trim_matches(|c| "-.".contains(c)).to_owned()
}

/// What a file is called and how it is shown.
#[derive(Clone, Debug)]
pub(crate) struct Described {
    /// Strong tag.
    pub(crate) etag: String,
    pub(crate) content_type: HeaderValue,
    pub(crate) filename: FileName,
    /// Shown by a browser instead of saved.
    pub(crate) inline: bool,
    /// Whether `Accept` had a say in it.
    pub(crate) negotiated: bool,
    /// Whether it is sent shorter to those who take that.
    pub(crate) coding: Coding,
}

/// The coding in which a file is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Coding {
    /// None, whoever asks.
    Never,
    /// None, and gzip to others.
    Identity,
    /// Gzip, which has a tag of its own. Its length is not known before its end, and it has no ranges.
    Gzip,
}

impl Coding {
    /// Of a file that gets shorter, in the answer to such a request. What asks for a range gets it of the plain bytes.
    pub(crate) fn of(headers: &HeaderMap) -> Self {
        let gzip = takes_gzip(headers) && !headers.contains_key(header::RANGE);
        if gzip { Self::Gzip } else { Self::Identity }
    }

    /// The strong tag of what has that tag without a coding.
    pub(crate) fn tag(self, tag: &str) -> String {
        match self {
            Self::Gzip => format!("\"{tag}-gzip\""),
            Self::Never | Self::Identity => format!("\"{tag}\""),
        }
    }
}

/// What is sent of a file.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    status: StatusCode,
    range: Range<u64>,
    length: u64,
    /// With its bytes, and not for their head alone.
    with_body: bool,
}

impl Described {
    /// The answer to who has it already, if that is who asks.
    pub(crate) fn not_modified(&self, headers: &HeaderMap) -> Option<Response> {
        conditional::none_match_fails(headers, &self.etag).then(|| {
            let mut response = StatusCode::NOT_MODIFIED.into_response();
            self.describe(&mut response);
            response
        })
    }

    /// What is asked for of a file of that length.
    ///
    /// # Errors
    /// `range-not-satisfiable`.
    pub(crate) fn part(&self, method: &Method, headers: &HeaderMap, length: u64) -> Result<Part, Problem> {
        let range = headers
            .get(header::RANGE)
            .filter(|_| method == Method::GET && conditional::range_allowed(headers, &self.etag))
            .map(|value| value.to_str().unwrap_or_default());
        let (status, range) = match Asked::of(range, length) {
            Asked::Whole => (StatusCode::OK, 0..length),
            Asked::Part(part) => (StatusCode::PARTIAL_CONTENT, part),
            Asked::Beyond => {
                let detail = format!("it has {length} bytes in this format: the range must begin below");
                return Err(Problem::new(Kind::RangeNotSatisfiable, detail)
                    .with_header("content-range", format!("bytes */{length}")));
            }
        };
        Ok(Part { status, range, length, with_body: method != Method::HEAD })
    }

    /// The answer with what `send` sends of that part.
    pub(crate) async fn respond<Sending>(
        &self,
        part: Part,
        send: impl FnOnce(Range<u64>) -> Sending,
    ) -> Result<Response, Problem>
    where
        Sending: Future<Output = Result<Body, Problem>>,
    {
        let Part { status, range, length, with_body } = part;
        let (first, bytes) = (range.start, range.end - range.start);
        let body = if with_body {
            send(range).await?
        } else if self.coding == Coding::Gzip {
            // An empty body would be said to have a length of 0.
            Body::from_stream(stream::empty::<io::Result<Bytes>>())
        } else {
            Body::empty()
        };
        let mut response = (status, body).into_response();
        self.describe(&mut response);
        let fields = response.headers_mut();
        fields.insert(header::CONTENT_TYPE, self.content_type.clone());
        if self.coding == Coding::Gzip {
            fields.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
        } else {
            fields.insert(header::CONTENT_LENGTH, HeaderValue::from(bytes));
        }
        set(&mut response, header::CONTENT_DISPOSITION, &self.disposition());
        if self.inline {
            // A browser that opens it must not run what a viewer of pictures would not.
            set(&mut response, header::CONTENT_SECURITY_POLICY, "default-src 'none'; sandbox");
        }
        if status == StatusCode::PARTIAL_CONTENT {
            let range = format!("bytes {first}-{}/{length}", first + bytes - 1);
            set(&mut response, header::CONTENT_RANGE, &range);
        }
        Ok(response)
    }

    /// `Content-Disposition`.
    pub(crate) fn disposition(&self) -> String {
        self.filename.disposition(self.inline)
    }

    fn describe(&self, response: &mut Response) {
        set(response, header::ETAG, &self.etag);
        set(response, header::ACCEPT_RANGES, if self.coding == Coding::Gzip { "none" } else { "bytes" });
        match (self.negotiated, self.coding) {
            (true, Coding::Never) => set(response, header::VARY, "accept"),
            (true, _) => set(response, header::VARY, "accept, accept-encoding"),
            (false, Coding::Never) => {}
            (false, _) => set(response, header::VARY, "accept-encoding"),
        }
    }
}

/// Waits to be one of those to whom results are sent.
///
/// # Errors
/// `busy`.
pub(crate) async fn turn(app: &App) -> Result<Place, Problem> {
    if let Ok(place) = timeout(TURN, app.shared.downloads.wait(&client::current())).await {
        return Ok(place);
    }
    let most = app.shared.max_downloads;
    let of_one = (most / 2).max(1);
    let detail = format!("{most} results are being sent, as many as may, or {of_one} to this address or key");
    Err(Problem::new(Kind::Busy, detail).with_header("retry-after", "10"))
}

/// Blocks as they come, as a body.
pub(crate) fn body(blocks: mpsc::Receiver<io::Result<Bytes>>) -> Body {
    Body::from_stream(stream::unfold(blocks, |mut blocks| async move {
        blocks.recv().await.map(|block| (block, blocks))
    }))
}

/// A part of a file as it lies.
///
/// # Errors
/// `busy`, or `not-ready` where the storage cannot be read at present.
pub(crate) async fn send_file(app: &App, file: Box<dyn Blob>, range: Range<u64>) -> Result<Body, Problem> {
    let permit = turn(app).await?;
    let length = range.end - range.start;
    let bytes =
        tasks::blocking(move || file.read(range)).await.unwrap_or_else(|error| Err(io::Error::other(error)));
    let bytes = bytes.map_err(|error| {
        tracing::error!(%error, "a file cannot be read at present");
        of_fault(Fault::Io)
    })?;
    Ok(body(sending::start_file(bytes, length, permit)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_plain_and_have_mix_and_seed() {
        let id = "01900000-0000-7000-8000-0123456789ab";
        for (name, disposition) in [
            (None, "filename=\"01900000-0000-7000-8000-0123456789ab.npy\""),
            (Some("A16, 70pct, cube 150mm"), "filename=\"A16-70pct-cube-150mm-seed7.npy\""),
            (Some("A16 cube"), "filename=\"A16-cube-seed7.npy\""),
            (Some("../../etc/passwd"), "filename=\"etc-passwd-seed7.npy\""),
            (Some("\"; rm\r\n"), "filename=\"rm-seed7.npy\""),
            (
                Some("Würfel, 0.70"),
                "filename=\"W-rfel-0.70-seed7.npy\"; filename*=UTF-8''W%C3%BCrfel-0.70-seed7.npy",
            ),
            (
                Some("Wu\u{308}rfel"),
                "filename=\"Wu-rfel-seed7.npy\"; filename*=UTF-8''Wu%CC%88rfel-seed7.npy",
            ),
            (
                Some("日本"),
                "filename=\"01900000-0000-7000-8000-0123456789ab.npy\"; \
                 filename*=UTF-8''%E6%97%A5%E6%9C%AC-seed7.npy",
            ),
            // What turns the direction of writing could hide an ending.
            (Some("a\u{202e}gpj"), "filename=\"a-gpj-seed7.npy\""),
        ] {
            let named = FileName::named(name, 7, id, "npy");
            assert_eq!(named.disposition(false), format!("attachment; {disposition}"), "{name:?}");
            assert!(named.disposition(true).starts_with("inline; "));
        }
    }
}
