//! The cookie of a session: what it holds, who can make it, and when it ends.
//!
//! Its value is `EXPIRES.NONCE.SIGNATURE`: the time of its end in seconds since the Unix epoch, 16 random bytes, and
//! the HMAC-SHA256 of both and of the digest of the API key, by a secret that the process draws at its start. The key
//! that it stands for is the one of the file of keys with which the signature is right, so that a session ends with its
//! key, and with the process.

use std::collections::BTreeSet;
use std::fmt;
use std::sync::{Mutex, PoisonError};

use axum::http::{HeaderMap, header};
use hmac::{Hmac, Mac as _};
use sha2::Sha256;

use crate::accounts::{ApiKeys, Caller, KeyDigest};
use crate::hex;

/// Name of the cookie.
pub(crate) const COOKIE: &str = "packstone_session";
/// How long a session lasts, in s.
pub(crate) const SESSION_S: i64 = 12 * 3600;
/// Most sessions that are remembered as ended before their time; beyond, those that would end first are forgotten.
const MOST_ENDED: usize = 100_000;

/// A cookie as it was sent.
struct Cookie<'a> {
    expires: i64,
    /// What is signed beside the digest of the key.
    text: &'a str,
    signature: Vec<u8>,
}

impl<'a> Cookie<'a> {
    fn read(value: &'a str) -> Option<Self> {
        let (text, signature) = value.rsplit_once('.')?;
        let (expires, nonce) = text.split_once('.')?;
        hex::decode(nonce)?;
        Some(Self { expires: expires.parse().ok()?, text, signature: hex::decode(signature)? })
    }
}

/// The sessions of this process.
pub(crate) struct Sessions {
    secret: Hmac<Sha256>,
    /// Sessions that were ended before their time, by that time and what is signed of them.
    ended: Mutex<BTreeSet<(i64, String)>>,
}

impl fmt::Debug for Sessions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Sessions")
    }
}

impl Default for Sessions {
    fn default() -> Self {
        let secret = Hmac::new_from_slice(&rand::random::<[u8; 32]>());
        Self {
            secret: secret.unwrap_or_else(|_| unreachable!("HMAC takes any key")),
            ended: Mutex::default(),
        }
    }
}

impl Sessions {
    /// The value of the cookie of a new session for the key of this digest.
    pub(crate) fn begin(&self, key: &KeyDigest, now_s: i64) -> String {
        let nonce: [u8; 16] = rand::random();
        let text = format!("{}.{}", now_s + SESSION_S, hex::encode(&nonce));
        let signature = hex::encode(&self.signed(&text, key).finalize().into_bytes());
        format!("{text}.{signature}")
    }

    fn signed(&self, text: &str, key: &KeyDigest) -> Hmac<Sha256> {
        let mut mac = self.secret.clone();
        mac.update(text.as_bytes());
        mac.update(key);
        mac
    }

    /// Whether a request carries the cookie of a session, of whatever value.
    pub(crate) fn has_cookie(headers: &HeaderMap) -> bool {
        cookies(headers).next().is_some()
    }

    /// The user whose session the cookies of a request name; `None` where there is none, or it has ended.
    pub(crate) fn caller(&self, keys: &ApiKeys, headers: &HeaderMap, now_s: i64) -> Option<Caller> {
        cookies(headers).find_map(|value| self.caller_of(keys, &Cookie::read(value)?, now_s))
    }

    fn caller_of(&self, keys: &ApiKeys, cookie: &Cookie<'_>, now_s: i64) -> Option<Caller> {
        let ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
        if cookie.expires <= now_s || ended.contains(&(cookie.expires, cookie.text.to_owned())) {
            return None;
        }
        drop(ended);
        let is_right =
            |key: &KeyDigest| self.signed(cookie.text, key).verify_slice(&cookie.signature).is_ok();
        keys.find_by(is_right).cloned()
    }

    /// Ends the sessions that the cookies of a request name.
    pub(crate) fn end(&self, keys: &ApiKeys, headers: &HeaderMap, now_s: i64) {
        for cookie in cookies(headers).filter_map(Cookie::read) {
            if self.caller_of(keys, &cookie, now_s).is_none() {
                continue;
            }
            let mut ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
            ended.retain(|(expires, _)| *expires > now_s);
            ended.insert((cookie.expires, cookie.text.to_owned()));
            if ended.len() > MOST_ENDED {
                ended.pop_first();
            }
        }
    }
}

/// The values of the cookies of this name.
fn cookies(headers: &HeaderMap) -> impl Iterator<Item = &str> {
    headers
        .get_all(header::COOKIE)
        .iter()
        .filter_map(|field| field.to_str().ok())
        .flat_map(|field| field.split(';'))
        .filter_map(|pair| pair.trim().split_once('='))
        .filter(|(name, _)| *name == COOKIE)
        .map(|(_, value)| value)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::accounts::{KeysFile, digest, generate};

    fn with(value: &str) -> HeaderMap {
        let mut headers = HeaderMap::new();
        headers.insert(header::COOKIE, format!("a=b; {COOKIE}={value}").parse().unwrap());
        headers
    }

    #[test]
    fn a_session_is_its_key_s_until_either_ends() {
        let folder = tempfile::tempdir().unwrap();
        let ((key, line), (other, other_line)) =
            (generate("lab", &["role=admin".into()]), generate("field", &["role=admin".into()]));
        let file = |name: &str, lines: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, lines).unwrap();
            KeysFile::open(path).unwrap().current()
        };
        let (both, without) =
            (file("both", &format!("{line}\n{other_line}\n")), file("one", &format!("{other_line}\n")));
        let sessions = Sessions::default();
        let value = sessions.begin(&digest(&key), 1000);
        let name = |sessions: &Sessions, keys: &ApiKeys, value: &str, now_s: i64| {
            sessions.caller(keys, &with(value), now_s).map(|caller| caller.by.key)
        };
        assert_eq!(name(&sessions, &both, &value, 1000).as_deref(), Some("lab"));
        assert_eq!(name(&sessions, &both, &value, 1000 + SESSION_S - 1).as_deref(), Some("lab"));
        assert_eq!(name(&sessions, &both, &value, 1000 + SESSION_S), None, "its time is over");
        assert_eq!(name(&sessions, &without, &value, 1000), None, "its key is gone");
        assert_eq!(
            name(&Sessions::default(), &both, &value, 1000),
            None,
            "another process has another secret"
        );
        let of_other = sessions.begin(&digest(&other), 1000);
        assert_eq!(name(&sessions, &both, &of_other, 1000).as_deref(), Some("field"));
        let (text, signature) = value.rsplit_once('.').unwrap();
        let (_, nonce) = text.split_once('.').unwrap();
        for forged in [
            format!("{}.{nonce}.{signature}", 1001 + SESSION_S),
            format!("{text}."),
            format!("{text}.{}", &signature[..62]),
            format!("{text}.{}", of_other.rsplit_once('.').unwrap().1),
            text.to_owned(),
            key,
            String::new(),
            "..".to_owned(),
        ] {
            assert_eq!(name(&sessions, &both, &forged, 1000), None, "{forged}");
        }
        let second = sessions.begin(&digest(&other), 1000);
        sessions.end(&both, &with(&of_other), 1000);
        assert_eq!(name(&sessions, &both, &of_other, 1001), None, "it was ended");
        assert_eq!(
            name(&sessions, &both, &second, 1001).as_deref(),
            Some("field"),
            "another of the same key"
        );
    }
}
