//! The API key of a request, or the session that stands for one.

use axum::http::{HeaderMap, Method, header};
use jiff::Timestamp;

use crate::accounts::{ApiKeys, Caller};
use crate::http::session::{Sessions, Site};
use crate::problem::{Kind, Problem};

/// The user whose key a request carries, or whose session. A key in the header wins over a session, which browsers send
/// by themselves: what may change something is taken by a session from pages of this server only.
///
/// # Errors
/// A problem `unauthorized`, which does not tell a missing key from a wrong one's nearness, or `forbidden`.
pub(crate) fn caller(
    keys: &ApiKeys,
    sessions: &Sessions,
    method: &Method,
    headers: &HeaderMap,
    site: Site,
) -> Result<Caller, Problem> {
    let Some(field) = headers.get(header::AUTHORIZATION) else {
        return of_session(keys, sessions, method, headers, site);
    };
    let key = field.to_str().ok().and_then(bearer).unwrap_or_default();
    of_key(keys, key)
}

/// The user of a key.
///
/// # Errors
/// `unauthorized`.
pub(crate) fn of_key(keys: &ApiKeys, key: &str) -> Result<Caller, Problem> {
    keys.find(key).cloned().ok_or_else(|| refusal("the API key is unknown", INVALID))
}

fn of_session(
    keys: &ApiKeys,
    sessions: &Sessions,
    method: &Method,
    headers: &HeaderMap,
    site: Site,
) -> Result<Caller, Problem> {
    if !Sessions::has_cookie(headers) {
        return Err(refusal("the request carries no API key", "Bearer realm=\"packstone\""));
    }
    let ended = || refusal("the session has ended: send the API key to POST /session again", INVALID);
    let caller = sessions.caller(keys, headers, Timestamp::now().as_second()).ok_or_else(ended)?;
    let reads = [Method::GET, Method::HEAD, Method::OPTIONS].contains(method);
    if reads || site == Site::Own {
        return Ok(caller);
    }
    let detail = "a session changes something for pages of this server only: Sec-Fetch-Site must be same-origin, or \
                  Origin this server; programs send the API key in Authorization";
    Err(Problem::new(Kind::Forbidden, detail))
}

/// What is told of a key or a session that is not known.
const INVALID: &str = "Bearer realm=\"packstone\", error=\"invalid_token\"";

fn refusal(detail: &str, challenge: &str) -> Problem {
    Problem::new(Kind::Unauthorized, detail).with_header("www-authenticate", challenge)
}

fn bearer(field: &str) -> Option<&str> {
    let (scheme, key) = field.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| key.trim())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::accounts::{KeysFile, generate};

    #[test]
    fn a_key_comes_as_bearer_and_in_no_other_way() {
        let folder = tempfile::tempdir().unwrap();
        let (key, line) = generate("lab", &["role=admin".into()]);
        let path = folder.path().join("keys");
        std::fs::write(&path, line + "\n").unwrap();
        let keys = KeysFile::open(path).unwrap().current();
        let with = |authorization: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::AUTHORIZATION, authorization.parse().unwrap());
            caller(&keys, &Sessions::default(), &Method::GET, &headers, Site::Unknown)
        };
        assert_eq!(with(&format!("Bearer {key}")).unwrap().by.key, "lab");
        assert_eq!(with(&format!("bearer {key}")).unwrap().by.key, "lab");
        for refused in ["Bearer", "Bearer ", "Basic abc", &format!("Bearer {key}x"), &key] {
            let problem = with(refused).unwrap_err();
            assert_eq!(problem.status, 401, "{refused}");
            assert_eq!(problem.headers[0].0, "www-authenticate");
        }
        let without = HeaderMap::new();
        assert!(caller(&keys, &Sessions::default(), &Method::GET, &without, Site::Unknown).is_err());
    }
}
