//! The `Host` of requests: exactly one (RFC 9112, section 3.2), and of a known name where a stranger's is dangerous. A
//! target with a host of its own (`GET http://lab/v1/jobs`) counts in its place (section 3.2.2).
//!
//! A server on loopback without API keys trusts every local program. A web page of another site can reach it as well,
//! by a name whose address changes to 127.0.0.1 after the page is loaded (DNS rebinding); its requests carry that name.

use std::net::IpAddr;

use axum::http::{HeaderMap, Uri, Version, header};

use crate::problem::{Fault, Problem};

/// Names that `Host` may have.
#[derive(Debug)]
pub(crate) struct Hosts(Vec<String>);

impl Hosts {
    /// The names and addresses of loopback, and others.
    pub(crate) fn loopback_and(others: &[String]) -> Self {
        Self(others.iter().map(|name| name.trim().to_ascii_lowercase()).collect())
    }

    fn allow(&self, host: &str) -> bool {
        let name = without_port(host).to_ascii_lowercase();
        let bare = name.trim_start_matches('[').trim_end_matches(']');
        let address = bare.parse::<IpAddr>();
        name == "localhost"
            || name.ends_with(".localhost")
            || address.is_ok_and(|address| address.is_loopback())
            || self.0.iter().any(|allowed| allowed == bare)
    }
}

fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) => name,
        _ => host,
    }
}

/// The host, with its port, that a request is for.
pub(crate) fn of_request<'a>(uri: &'a Uri, headers: &'a HeaderMap) -> Option<&'a str> {
    match uri.authority() {
        // Without a user, whom no browser sends.
        Some(authority) => Some(authority.as_str().rsplit('@').next().unwrap_or_default()),
        None => headers.get(header::HOST).map(|host| host.to_str().unwrap_or("?")),
    }
}

/// Checks the `Host` of a request, and that of its target.
///
/// # Errors
/// A problem `validation-error` (400) that names the field.
pub(crate) fn check(
    version: Version,
    uri: &Uri,
    headers: &HeaderMap,
    allowed: Option<&Hosts>,
) -> Result<(), Problem> {
    let mut fields = headers.get_all(header::HOST).iter();
    let foreign = |host: &str| allowed.is_some_and(|allowed| !allowed.allow(host));
    let fault = match (fields.next(), fields.next()) {
        _ if uri.authority().is_some()
            && let Some(host) = of_request(uri, headers)
            && foreign(host) =>
        {
            let shown: String = host.chars().take(100).collect();
            format!(
                "{shown:?} of the request target is not this server: must be localhost, or a name given by --allowed-host"
            )
        }
        (None, _) if version < Version::HTTP_11 => return Ok(()),
        (None, _) => "is missing: HTTP/1.1 requires it".to_owned(),
        (Some(_), Some(_)) => "is given more than once: must be given once".to_owned(),
        (Some(host), None) => match host.to_str() {
            Err(_) => "must be a name or an address".to_owned(),
            Ok(host) if foreign(host) => {
                let shown: String = host.chars().take(100).collect();
                format!("{shown:?} is not this server: must be localhost, or a name given by --allowed-host")
            }
            _ => return Ok(()),
        },
    };
    Err(Problem::parameters(vec![Fault::header("Host", fault)]))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn with(hosts: &[&str]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for host in hosts {
            headers.append(header::HOST, host.parse().unwrap());
        }
        headers
    }

    #[test]
    fn there_is_exactly_one_host() {
        let ok = |version, hosts: &[&str]| check(version, &Uri::from_static("/"), &with(hosts), None).is_ok();
        assert!(ok(Version::HTTP_11, &["anything.example"]));
        assert!(ok(Version::HTTP_10, &[]));
        assert!(!ok(Version::HTTP_11, &[]));
        assert!(!ok(Version::HTTP_11, &["a", "a"]));
    }

    #[test]
    fn on_loopback_only_its_own_names_are_known() {
        let hosts = Hosts::loopback_and(&["Lab.example".into()]);
        let target = |target: &str, host: &str| {
            check(Version::HTTP_11, &target.parse().unwrap(), &with(&[host]), Some(&hosts)).is_ok()
        };
        let ok = |host: &str| target("/", host);
        for good in [
            "localhost",
            "LOCALHOST:8080",
            "a.localhost",
            "127.0.0.1:80",
            "127.1.2.3",
            "[::1]:80",
            "[::1]",
            "lab.example:1",
        ] {
            assert!(ok(good), "{good}");
        }
        for bad in ["evil.example", "localhost.evil.example", "10.0.0.1", "127.0.0.1.evil.example", ""] {
            assert!(!ok(bad), "{bad}");
        }
        for good in ["http://localhost/", "http://lab.example:8080/v1/jobs", "http://[::1]:80/", "/v1/jobs"] {
            assert!(target(good, "localhost"), "{good}");
            assert!(!target(good, "evil.example"), "{good}");
        }
        for bad in
            ["http://evil.example/", "http://evil.example:80/v1/jobs", "http://localhost@evil.example/"]
        {
            assert!(!target(bad, "localhost"), "{bad}");
        }
        let old = check(Version::HTTP_10, &"http://evil.example/".parse().unwrap(), &with(&[]), Some(&hosts));
        assert!(old.is_err(), "HTTP/1.0 needs no Host, but its target may have one");
    }
}
