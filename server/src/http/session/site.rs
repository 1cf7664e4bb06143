//! Which page a request comes from, as its browser says.
//!
//! Browsers send `Sec-Fetch-Site` to addresses that they take for safe: with TLS, and of the own machine. To others
//! they send `Origin` with every request that may change something, which is then compared with `Host`. Scripts of a
//! page can set neither.

use axum::http::{HeaderMap, header};

/// Which page a request comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Site {
    /// A page of this server.
    Own,
    /// A page of another site, or none.
    Other,
    /// It does not say.
    Unknown,
}

impl Site {
    /// The page that a request with these header fields comes from.
    pub(crate) fn of(headers: &HeaderMap) -> Self {
        let text = |name: &str| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
        match (text("sec-fetch-site"), text(header::ORIGIN.as_str()), text(header::HOST.as_str())) {
            (Some("same-origin"), _, _) => Self::Own,
            (Some(_), _, _) | (None, Some(_), None) => Self::Other,
            (None, Some(origin), Some(host)) => {
                let authority = origin.split_once("://").map_or("", |(_, authority)| authority);
                if !host.is_empty() && authority.eq_ignore_ascii_case(host) { Self::Own } else { Self::Other }
            }
            (None, None, _) => Self::Unknown,
        }
    }
}

/// Whether the browser that sent the request reaches this server by TLS: it says so in `Origin`, and a trusted proxy in
/// `X-Forwarded-Proto`.
pub(crate) fn is_by_tls(headers: &HeaderMap, trust_proxy: bool) -> bool {
    let text = |name: &str| headers.get(name).and_then(|value| value.to_str().ok()).unwrap_or_default();
    text(header::ORIGIN.as_str()).starts_with("https://")
        || trust_proxy && text("x-forwarded-proto").eq_ignore_ascii_case("https")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn with(fields: &[(&'static str, &str)]) -> HeaderMap {
        fields.iter().map(|(name, value)| (name.parse().unwrap(), value.parse().unwrap())).collect()
    }

    #[test]
    fn browsers_say_where_a_request_comes_from() {
        for (fields, site) in [
            (&[("sec-fetch-site", "same-origin")][..], Site::Own),
            (&[("sec-fetch-site", "same-site")], Site::Other),
            (
                &[("sec-fetch-site", "cross-site"), ("origin", "http://lab:80"), ("host", "lab:80")],
                Site::Other,
            ),
            (&[("sec-fetch-site", "none")], Site::Other),
            (&[("origin", "http://Lab:8080"), ("host", "lab:8080")], Site::Own),
            (&[("origin", "http://lab:8081"), ("host", "lab:8080")], Site::Other),
            (&[("origin", "null"), ("host", "")], Site::Other),
            (&[("origin", "https://evil.example"), ("host", "lab")], Site::Other),
            (&[("host", "lab")], Site::Unknown),
        ] {
            assert_eq!(Site::of(&with(fields)), site, "{fields:?}");
        }
    }

    #[test]
    fn tls_is_known_by_the_origin_and_by_a_trusted_proxy() {
        let forwarded = with(&[("x-forwarded-proto", "https")]);
        assert!(is_by_tls(&forwarded, true) && !is_by_tls(&forwarded, false));
        assert!(is_by_tls(&with(&[("origin", "https://lab")]), false));
        assert!(!is_by_tls(&with(&[("origin", "http://lab")]), true));
    }
}
