//! The path below which clients find this service, where a proxy serves it below a path of its host
//! (`--base-path /packstone`).
//!
//! Pages and scripts have relative addresses. What must be absolute begins with this path: `Location`, `Link`, the
//! members `links` and `type` of documents, cookies, the servers of `openapi.json`, and the links of webhooks. A
//! process serves below one path, which is set once before the first request.

use std::str::FromStr;
use std::sync::OnceLock;

/// Longest base path, in characters.
const MAX_CHARS: usize = 200;

static BASE: OnceLock<BasePath> = OnceLock::new();

/// A path without a slash at its end; empty where the service lies at the root of its host.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct BasePath(String);

impl FromStr for BasePath {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let path = text.trim_end_matches('/');
        if path.is_empty() && !text.is_empty() {
            return Ok(Self::default());
        }
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-._~".contains(c);
        let is_segment =
            |part: &str| !part.is_empty() && part != "." && part != ".." && part.chars().all(is_plain);
        let is_path = path.strip_prefix('/').is_some_and(|below| below.split('/').all(is_segment));
        if !is_path || path.len() > MAX_CHARS {
            return Err(format!(
                "must be a path of at most {MAX_CHARS} characters that begins with a slash, of letters, digits, \"-\", \
                 \".\", \"_\" and \"~\", as /packstone"
            ));
        }
        Ok(Self(path.to_owned()))
    }
}

impl BasePath {
    /// The path, empty at the root.
    pub(crate) fn as_str(&self) -> &str {
        &self.0
    }

    /// What follows this path in another: the rest with its slash, and the same path where it lies elsewhere.
    pub(crate) fn strip<'a>(&self, path: &'a str) -> &'a str {
        match path.strip_prefix(self.as_str()) {
            Some(rest) if rest.starts_with('/') => rest,
            _ => path,
        }
    }
}

/// Sets the base path of this process. Only the first call counts.
pub(crate) fn set(path: BasePath) {
    let _ = BASE.set(path);
}

/// The base path of this process.
pub(crate) fn get() -> &'static BasePath {
    BASE.get_or_init(BasePath::default)
}

/// A path of the service as clients find it.
pub(crate) fn absolute(path: &str) -> String {
    format!("{}{path}", get().as_str())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_base_path_is_a_plain_path() {
        for (given, path) in
            [("/", ""), ("/packstone", "/packstone"), ("/lab/packstone_2/", "/lab/packstone_2")]
        {
            assert_eq!(given.parse::<BasePath>().unwrap().as_str(), path);
        }
        let long = format!("/{}", "a".repeat(MAX_CHARS));
        for bad in
            ["", "packstone", "//", "/a//b", "/a b", "/..", "/a/./b", "/a?b", "/a;b", "/ü", "/a%20b", &long]
        {
            let parsed = bad.parse::<BasePath>();
            assert!(parsed.is_err() || bad == "//", "{bad}");
        }
    }

    #[test]
    fn what_lies_elsewhere_keeps_its_path() {
        let base: BasePath = "/packstone".parse().unwrap();
        for (path, stripped) in [
            ("/packstone/v1/jobs", "/v1/jobs"),
            ("/packstone/", "/"),
            ("/packstone", "/packstone"),
            ("/packstones/v1", "/packstones/v1"),
            ("/v1/jobs", "/v1/jobs"),
        ] {
            assert_eq!(base.strip(path), stripped);
        }
        assert_eq!(BasePath::default().strip("/v1/jobs"), "/v1/jobs");
    }
}
