//! The API key of a request.

use axum::http::{HeaderMap, header};

use crate::accounts::{ApiKeys, Caller};
use crate::problem::{Kind, Problem};

/// The user whose key a request carries.
///
/// # Errors
/// A problem `unauthorized`, which does not tell a missing key from a wrong one's nearness.
pub(crate) fn caller(keys: &ApiKeys, headers: &HeaderMap) -> Result<Caller, Problem> {
    let Some(field) = headers.get(header::AUTHORIZATION) else {
        return Err(refusal("the request carries no API key", "Bearer realm=\"packstone\""));
    };
    let key = field.to_str().ok().and_then(bearer).unwrap_or_default();
    let unknown = || refusal("the API key is unknown", "Bearer realm=\"packstone\", error=\"invalid_token\"");
    keys.find(key).cloned().ok_or_else(unknown)
}

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
        let (key, line) = generate("lab", &[]);
        let path = folder.path().join("keys");
        std::fs::write(&path, line).unwrap();
        let keys = KeysFile::open(path).unwrap().current();
        let with = |authorization: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::AUTHORIZATION, authorization.parse().unwrap());
            caller(&keys, &headers)
        };
        assert_eq!(with(&format!("Bearer {key}")).unwrap().by.key, "lab");
        assert_eq!(with(&format!("bearer {key}")).unwrap().by.key, "lab");
        for refused in ["Bearer", "Bearer ", "Basic abc", &format!("Bearer {key}x"), &key] {
            let problem = with(refused).unwrap_err();
            assert_eq!(problem.status, 401, "{refused}");
            assert_eq!(problem.headers[0].0, "www-authenticate");
        }
        assert!(caller(&keys, &HeaderMap::new()).is_err());
    }
}
