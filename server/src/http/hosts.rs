//! The `Host` of requests: exactly one (RFC 9112, section 3.2), and of a known name where a stranger's is dangerous.
//!
//! A server on loopback without API keys trusts every local program. A web page of another site can reach it as well,
//! by a name whose address changes to 127.0.0.1 after the page is loaded (DNS rebinding); its requests carry that name.

use std::net::IpAddr;

use axum::http::{HeaderMap, Version, header};

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

/// Checks the `Host` of a request.
///
/// # Errors
/// A problem `validation-error` (400) that names the field.
pub(crate) fn check(version: Version, headers: &HeaderMap, allowed: Option<&Hosts>) -> Result<(), Problem> {
    let mut fields = headers.get_all(header::HOST).iter();
    let fault = match (fields.next(), fields.next()) {
        (None, _) if version < Version::HTTP_11 => return Ok(()),
        (None, _) => "is missing: HTTP/1.1 requires it".to_owned(),
        (Some(_), Some(_)) => "is given more than once: must be given once".to_owned(),
        (Some(host), None) => match (host.to_str(), allowed) {
            (Err(_), _) => "must be a name or an address".to_owned(),
            (Ok(host), Some(allowed)) if !allowed.allow(host) => {
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
        let ok = |version, hosts: &[&str]| check(version, &with(hosts), None).is_ok();
        assert!(ok(Version::HTTP_11, &["anything.example"]));
        assert!(ok(Version::HTTP_10, &[]));
        assert!(!ok(Version::HTTP_11, &[]));
        assert!(!ok(Version::HTTP_11, &["a", "a"]));
    }

    #[test]
    fn on_loopback_only_its_own_names_are_known() {
        let hosts = Hosts::loopback_and(&["Lab.example".into()]);
        let ok = |host: &str| check(Version::HTTP_11, &with(&[host]), Some(&hosts)).is_ok();
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
    }
}
