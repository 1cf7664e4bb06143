//! Header fields that make an answer wait or depend: `Prefer: wait`, `If-None-Match`, `If-Range`.

use std::time::Duration;

use axum::http::{HeaderMap, header};

use crate::jobs::store::Target;

/// Longest that an answer is held back.
pub(crate) const MAX_WAIT_S: u64 = 60;

/// A request of the client to hold the answer back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Wait {
    /// As granted, in whole s.
    pub(crate) s: u64,
}

impl Wait {
    /// Reads `Prefer: wait=N` (RFC 7240). What is longer than this service waits is shortened; what
    /// is no number is ignored, as the standard demands of preferences.
    pub(crate) fn of(headers: &HeaderMap) -> Option<Self> {
        headers
            .get_all("prefer")
            .iter()
            .filter_map(|value| value.to_str().ok())
            .flat_map(|value| value.split([',', ';']))
            .filter_map(|preference| preference.split_once('='))
            .find(|(name, _)| name.trim().eq_ignore_ascii_case("wait"))
            .and_then(|(_, value)| value.trim().trim_matches('"').parse::<u64>().ok())
            .map(|s| Self { s: s.min(MAX_WAIT_S) })
    }

    pub(crate) fn duration(self) -> Duration {
        Duration::from_secs(self.s)
    }

    /// What `Preference-Applied` says.
    pub(crate) fn applied(self) -> String {
        format!("wait={}", self.s)
    }
}

/// Whether `If-None-Match` is there.
pub(crate) fn has_if_none_match(headers: &HeaderMap) -> bool {
    headers.contains_key(header::IF_NONE_MATCH)
}

/// Whether `If-None-Match` names `etag` (weak comparison) or anything.
pub(crate) fn none_match_fails(headers: &HeaderMap, etag: &str) -> bool {
    let opaque = |tag: &str| tag.trim().trim_start_matches("W/").to_owned();
    headers
        .get_all(header::IF_NONE_MATCH)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .any(|tag| tag.trim() == "*" || opaque(tag) == opaque(etag))
}

/// The job or study that a request changes, in the versions that its `If-Match` names. Weak tags never match (RFC 9110,
/// section 13.1.1); the tag of a job or study is its version.
pub(crate) fn target<Id>(id: Id, headers: &HeaderMap) -> Target<Id> {
    let mut fields = headers.get_all(header::IF_MATCH).iter().peekable();
    if fields.peek().is_none() {
        return id.into();
    }
    let tags: Vec<&str> = fields
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .map(str::trim)
        .collect();
    if tags.contains(&"*") {
        return id.into();
    }
    let version = |tag: &&str| tag.strip_prefix('"')?.strip_suffix('"')?.parse().ok();
    Target { id, versions: Some(tags.iter().filter_map(version).collect()) }
}

/// Whether `If-Range` lets a range be sent of what has this strong tag. A date never does: nothing
/// here has one.
pub(crate) fn range_allowed(headers: &HeaderMap, etag: &str) -> bool {
    headers.get(header::IF_RANGE).is_none_or(|value| value.as_bytes() == etag.as_bytes())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn headers(name: &'static str, value: &str) -> HeaderMap {
        let mut headers = HeaderMap::new();
        headers.insert(name, value.parse().unwrap());
        headers
    }

    #[test]
    fn wait_is_read_among_other_preferences() {
        for (value, wait) in [
            ("wait=5", Some(5)),
            ("respond-async, wait=10", Some(10)),
            ("return=minimal; wait=7", Some(7)),
            ("WAIT = \"3\"", Some(3)),
            ("wait=600", Some(60)),
            ("wait=-1", None),
            ("wait=soon", None),
            ("waits=5", None),
        ] {
            assert_eq!(Wait::of(&headers("prefer", value)).map(|w| w.s), wait, "{value}");
        }
    }

    #[test]
    fn tags_are_compared_weakly_and_in_lists() {
        for (value, matches) in [
            ("\"a\"", true),
            ("W/\"a\"", true),
            ("\"b\", \"a\"", true),
            ("*", true),
            ("\"b\"", false),
            ("a", false),
        ] {
            assert_eq!(none_match_fails(&headers("if-none-match", value), "\"a\""), matches, "{value}");
        }
        assert!(!none_match_fails(&HeaderMap::new(), "\"a\""));
    }

    #[test]
    fn if_match_names_versions_and_weak_tags_none() {
        let versions = |value: &str| target((), &headers("if-match", value)).versions;
        assert_eq!(target((), &HeaderMap::new()).versions, None);
        assert_eq!(versions("*"), None);
        assert_eq!(versions("\"3\", \"4\""), Some(vec![3, 4]));
        for none in ["W/\"3\"", "3", "\"x\"", ""] {
            assert_eq!(versions(none), Some(Vec::new()), "{none}");
        }
    }

    #[test]
    fn a_range_needs_the_same_strong_tag() {
        assert!(range_allowed(&HeaderMap::new(), "\"a\""));
        assert!(range_allowed(&headers("if-range", "\"a\""), "\"a\""));
        assert!(!range_allowed(&headers("if-range", "W/\"a\""), "\"a\""));
        assert!(!range_allowed(&headers("if-range", "Wed, 21 Oct 2015 07:28:00 GMT"), "\"a\""));
    }
}
