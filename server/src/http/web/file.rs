//! One file of the pages with its forms, and the answer that hands it out.

use std::io::Write as _;

use axum::body::Body;
use axum::http::header::{self, HeaderName};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse as _, Response};
use bytes::Bytes;
use flate2::Compression;
use flate2::write::GzEncoder;
use sha2::{Digest as _, Sha256};

use super::table::media_type;
use crate::hex;
use crate::http::coding::takes_gzip;
use crate::http::conditional;
use crate::http::response::set;
use crate::web_files::plain;

/// What a page may do: run scripts and styles of this server, show its pictures, and talk to it; nothing else.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; \
                      base-uri 'none'; form-action 'self'; frame-ancestors 'none'; require-trusted-types-for 'script'";

/// Header fields of every page and asset, beside those of the cache.
pub(super) const SAFETY: [(HeaderName, &str); 4] = [
    (header::CONTENT_SECURITY_POLICY, POLICY),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
];

/// Bytes of the digest in a tag.
const TAG_BYTES: usize = 16;

/// A form of a file as it is sent.
#[derive(Clone, Debug)]
struct Form {
    bytes: Bytes,
    /// Strong tag: of the digest of the plain bytes, and of the coding.
    etag: String,
}

/// A file with the forms in which it is sent.
#[derive(Clone, Debug)]
pub(crate) struct WebFile {
    media_type: &'static str,
    plain: Form,
    /// None where it would not be shorter.
    gzip: Option<Form>,
}

impl WebFile {
    /// The file of that name with these bytes.
    pub(crate) fn new(name: &str, bytes: Vec<u8>) -> Self {
        let gzip = compressed(&bytes).filter(|short| short.len() < bytes.len());
        Self::of_forms(name, bytes.into(), gzip.map(Bytes::from))
    }

    /// The file of that name with the bytes that these are with gzip.
    pub(crate) fn compiled(name: &str, gzip: &'static [u8]) -> Self {
        Self::of_forms(name, plain(gzip).into(), Some(Bytes::from_static(gzip)))
    }

    /// The file of the documents of that name with these bytes, which are its own or those with gzip.
    pub(crate) fn of_document(name: &str, bytes: &'static [u8]) -> Self {
        if name.rsplit('.').next() == Some("png") {
            Self::of_forms(name, Bytes::from_static(bytes), None)
        } else {
            Self::compiled(name, bytes)
        }
    }

    fn of_forms(name: &str, bytes: Bytes, gzip: Option<Bytes>) -> Self {
        let digest = hex::encode(&Sha256::digest(&bytes)[..TAG_BYTES]);
        Self {
            media_type: media_type(name),
            plain: Form { bytes, etag: format!("\"{digest}\"") },
            gzip: gzip.map(|bytes| Form { bytes, etag: format!("\"{digest}-gzip\"") }),
        }
    }

    /// The answer to a request with these header fields.
    pub(crate) fn answer(&self, headers: &HeaderMap) -> Response {
        let gzip = self.gzip.as_ref().filter(|_| takes_gzip(headers));
        let form = gzip.unwrap_or(&self.plain);
        let mut response = if conditional::none_match_fails(headers, &form.etag) {
            StatusCode::NOT_MODIFIED.into_response()
        } else {
            let mut response = Response::new(Body::from(form.bytes.clone()));
            set(&mut response, header::CONTENT_TYPE, self.media_type);
            set(&mut response, header::CONTENT_LENGTH, &form.bytes.len().to_string());
            if gzip.is_some() {
                set(&mut response, header::CONTENT_ENCODING, "gzip");
            }
            response
        };
        set(&mut response, header::ETAG, &form.etag);
        // A browser asks each time, so that a page never meets the script of another version.
        set(&mut response, header::CACHE_CONTROL, "no-cache");
        set(&mut response, header::VARY, "accept-encoding");
        for (name, value) in SAFETY {
            set(&mut response, name, value);
        }
        response
    }
}

fn compressed(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).ok()?;
    encoder.finish().ok()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_forms_hold_the_same_bytes_and_differ_by_their_tags() {
        let text = "a line of a page\n".repeat(50);
        let file = WebFile::new("a.css", text.clone().into());
        let gzip = file.gzip.unwrap();
        assert_eq!(plain(&gzip.bytes), text.as_bytes());
        assert_ne!(gzip.etag, file.plain.etag);
        assert!(WebFile::new("a.css", b"x".to_vec()).gzip.is_none(), "what gets longer is sent as it is");
    }
}
