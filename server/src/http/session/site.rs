//! Which page a request comes from, as its browser says, and what pages of other sites must not do.
//!
//! Browsers send `Sec-Fetch-Site` to addresses that they take for safe: with TLS, and of the own machine. To others
//! they send `Origin` with every request that may change something, which is then compared with the host of the
//! request. Scripts of a page can set neither, and programs (curl, Python) send neither.

use axum::http::{HeaderMap, Method, Uri, header};

use crate::http::hosts;
use crate::problem::{Kind, Problem};

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
    /// The page that a request for this target with these header fields comes from. Behind a trusted proxy the host
    /// is the one that the browser names to the proxy.
    pub(crate) fn of(uri: &Uri, headers: &HeaderMap, trust_proxy: bool) -> Self {
        let text = |name: &str| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
        let forwarded = text("x-forwarded-host").filter(|_| trust_proxy);
        let forwarded = forwarded.and_then(|hosts| hosts.rsplit(',').next()).map(str::trim);
        let host = forwarded.or_else(|| hosts::of_request(uri, headers));
        match (text("sec-fetch-site"), text(header::ORIGIN.as_str()), host) {
            (Some("same-origin"), _, _) => Self::Own,
            (Some(_), _, _) | (None, Some(_), None) => Self::Other,
            (None, Some(origin), Some(host)) => {
                let authority = origin.split_once("://").map_or("", |(_, authority)| authority);
                if !host.is_empty() && authority.eq_ignore_ascii_case(host) { Self::Own } else { Self::Other }
            }
            (None, None, _) => Self::Unknown,
        }
    }

    /// Refuses a request of another site's page that changes something.
    ///
    /// # Errors
    /// `forbidden`.
    pub(crate) fn check(self, method: &Method) -> Result<(), Problem> {
        let reads = [Method::GET, Method::HEAD, Method::OPTIONS].contains(method);
        if reads || self != Self::Other { Ok(()) } else { Err(refusal()) }
    }

    /// Refuses work that a page of another site starts by embedding an address. A link that a person follows is no
    /// such request.
    ///
    /// # Errors
    /// `forbidden`.
    pub(crate) fn check_start(self, headers: &HeaderMap) -> Result<(), Problem> {
        let is_link = headers.get("sec-fetch-mode").is_some_and(|mode| mode == "navigate");
        if self != Self::Other || is_link { Ok(()) } else { Err(refusal()) }
    }
}

fn refusal() -> Problem {
    let detail = "a page of another site changes nothing here: Sec-Fetch-Site must be same-origin or Origin must be \
                  this server, or both must be absent, as programs send it";
    Problem::new(Kind::Forbidden, detail)
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
            assert_eq!(Site::of(&Uri::from_static("/"), &with(fields), false), site, "{fields:?}");
        }
    }

    #[test]
    fn the_host_of_the_target_and_that_of_a_trusted_proxy_win_over_the_field() {
        let fields = [("origin", "http://lab"), ("host", "127.0.0.1:8080"), ("x-forwarded-host", "a, lab")];
        let headers = with(&fields);
        let relative = Uri::from_static("/v1/jobs");
        assert_eq!(Site::of(&relative, &headers, false), Site::Other);
        assert_eq!(Site::of(&relative, &headers, true), Site::Own);
        assert_eq!(Site::of(&Uri::from_static("http://lab/v1/jobs"), &headers, false), Site::Own);
        let own = with(&[("origin", "http://lab"), ("host", "lab")]);
        assert_eq!(Site::of(&Uri::from_static("http://other/v1/jobs"), &own, false), Site::Other);
    }

    #[test]
    fn another_site_s_page_reads_and_links_and_does_nothing_else() {
        for method in [Method::POST, Method::PUT, Method::PATCH, Method::DELETE, Method::TRACE] {
            assert!(Site::Other.check(&method).is_err(), "{method}");
            assert!(Site::Own.check(&method).is_ok() && Site::Unknown.check(&method).is_ok(), "{method}");
        }
        for method in [Method::GET, Method::HEAD, Method::OPTIONS] {
            assert!(Site::Other.check(&method).is_ok(), "{method}");
        }
        assert!(Site::Other.check_start(&with(&[("sec-fetch-mode", "navigate")])).is_ok());
        assert!(Site::Other.check_start(&with(&[("sec-fetch-mode", "no-cors")])).is_err());
        assert!(Site::Unknown.check_start(&with(&[])).is_ok());
    }

    #[test]
    fn tls_is_known_by_the_origin_and_by_a_trusted_proxy() {
        let forwarded = with(&[("x-forwarded-proto", "https")]);
        assert!(is_by_tls(&forwarded, true) && !is_by_tls(&forwarded, false));
        assert!(is_by_tls(&with(&[("origin", "https://lab")]), false));
        assert!(!is_by_tls(&with(&[("origin", "http://lab")]), true));
    }
}
