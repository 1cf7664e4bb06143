//! The URL of a webhook, as a submission names it.

use std::fmt;

use hyper::Uri;
use packstone_engine::request::decode::At;
use serde::{Serialize, Serializer};
use url::{Host, Position, Url};

use crate::http_client::Origin;

/// Longest URL of a webhook, in characters.
pub(crate) const MAX_URL_CHARS: usize = 2000;

/// An absolute URL with the scheme http or https, without user information and fragment.
///
/// It may contain a token: only the host is written to logs.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct WebhookUrl {
    url: Url,
    host: Host<String>,
    origin: Origin,
}

impl WebhookUrl {
    /// Reads the URL at a place of a request; a fault is recorded there.
    pub(crate) fn read(at: &At<'_>) -> Option<Self> {
        let text = at.string()?;
        Self::parse(text).map_err(|fault| at.fault(fault)).ok()
    }

    /// Parses a URL as browsers do (WHATWG), so that a number such as `0x7f000001` is known as the address it stands
    /// for.
    ///
    /// # Errors
    /// What is wrong, as one sentence without its subject. It does not contain the path and the query.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let chars = text.chars().count();
        if !(1..=MAX_URL_CHARS).contains(&chars) {
            return Err(format!("has {chars} characters: must have at least 1 and at most {MAX_URL_CHARS}"));
        }
        if let Some(c) = text.chars().find(|c| !c.is_ascii_graphic()) {
            return Err(format!("has the character U+{:04X}: must have visible ASCII characters", c as u32));
        }
        let url = Url::parse(text)
            .map_err(|error| format!("is no URL ({error}): must be one as https://example.org/hook"))?;
        if !matches!(url.scheme(), "http" | "https") {
            return Err(format!("has the scheme {:?}: must be http or https", url.scheme()));
        }
        if !url.username().is_empty() || url.password().is_some() {
            return Err("has a user name or a password: must have none".into());
        }
        if url.fragment().is_some() {
            return Err("has a fragment (#): must have none".into());
        }
        if url.port() == Some(0) {
            return Err("has port 0: must be from 1 to 65535".into());
        }
        let host = url.host().map(|host| host.to_owned());
        let host = host.ok_or("has no host: must be one as https://example.org/hook")?;
        let uri: Uri = url.as_str().parse().map_err(|error| format!("is no URL ({error})"))?;
        let origin = Origin::of(&uri)?;
        Ok(Self { url, host, origin })
    }

    /// The whole URL, normalized.
    pub(crate) fn as_str(&self) -> &str {
        self.url.as_str()
    }

    /// Where to connect.
    pub(crate) fn origin(&self) -> &Origin {
        &self.origin
    }

    /// Path and query.
    pub(crate) fn target(&self) -> &str {
        &self.url[Position::BeforePath..Position::AfterQuery]
    }

    /// Name or address of the receiver.
    pub(crate) fn host(&self) -> &Host<String> {
        &self.host
    }

    /// Name or address of the receiver, an IPv6 address in brackets.
    pub(crate) fn host_text(&self) -> String {
        self.host.to_string()
    }
}

impl fmt::Debug for WebhookUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}://{}/...", self.url.scheme(), self.host)
    }
}

impl Serialize for WebhookUrl {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.as_str())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn urls_are_absolute_and_bounded() {
        for (text, fault) in [
            (String::new(), "has 0 characters: must have at least 1 and at most 2000"),
            (
                format!("https://a.example/{}", "x".repeat(1983)),
                "has 2001 characters: must have at least 1 and at most 2000",
            ),
            ("https://a.example/ü".into(), "has the character U+00FC: must have visible ASCII characters"),
            ("https://a.example/\n".into(), "has the character U+000A: must have visible ASCII characters"),
            (
                "hook".into(),
                "is no URL (relative URL without a base): must be one as https://example.org/hook",
            ),
            ("https://".into(), "is no URL (empty host): must be one as https://example.org/hook"),
            (
                "http://1.2.3.4.5/".into(),
                "is no URL (invalid IPv4 address): must be one as https://example.org/hook",
            ),
            ("ftp://a.example/".into(), "has the scheme \"ftp\": must be http or https"),
            ("file:///etc/passwd".into(), "has the scheme \"file\": must be http or https"),
            ("https://u@a.example/".into(), "has a user name or a password: must have none"),
            ("https://:p@a.example/".into(), "has a user name or a password: must have none"),
            ("https://a.example/#x".into(), "has a fragment (#): must have none"),
            ("https://a.example:0/".into(), "has port 0: must be from 1 to 65535"),
        ] {
            assert_eq!(WebhookUrl::parse(&text).unwrap_err(), fault, "{text}");
        }
        let longest = format!("https://a.example/{}", "x".repeat(1982));
        assert_eq!(WebhookUrl::parse(&longest).unwrap().as_str(), longest);
    }

    #[test]
    fn all_forms_of_an_address_are_known() {
        for (text, host) in [
            ("http://127.0.0.1/", "127.0.0.1"),
            ("http://0x7f.1/", "127.0.0.1"),
            ("http://2130706433/", "127.0.0.1"),
            ("http://0177.0.0.1/", "127.0.0.1"),
            ("http://127.0.0.1./", "127.0.0.1"),
            ("http://%31%32%37.0.0.1/", "127.0.0.1"),
            ("http://[::FFFF:127.0.0.1]/", "[::ffff:7f00:1]"),
            ("http:a.EXAMPLE", "a.example"),
            ("http:\\\\a.example\\x@b", "a.example"),
        ] {
            assert_eq!(WebhookUrl::parse(text).unwrap().host_text(), host, "{text}");
        }
    }

    #[test]
    fn the_path_and_the_query_are_not_shown_by_accident() {
        let url = WebhookUrl::parse("https://a.example/hooks/secret?token=secret").unwrap();
        assert_eq!(format!("{url:?}"), "https://a.example/...");
    }
}
