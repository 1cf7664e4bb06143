//! API keys: who may use the service. Every key sees and may change everything; its name goes into the log.
//!
//! The server knows only SHA-256 digests of keys, so that its configuration opens nothing. Keys are 256 random bits
//! from the operating system, so that a digest without salt or stretching is enough.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use axum::http::{HeaderMap, header};
use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;

use crate::hex;
use crate::problem::{Kind, Problem};

const DIGEST_BYTES: usize = 32;
/// The file of keys is looked at no more often than this.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// The keys that open this server.
pub(crate) struct ApiKeys(Vec<ApiKey>);

struct ApiKey {
    name: String,
    sha256: [u8; DIGEST_BYTES],
}

impl fmt::Debug for ApiKeys {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.0.iter().map(|key| &key.name)).finish()
    }
}

/// Why the file of keys cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum KeysError {
    /// It cannot be read.
    #[error("the API keys file {0} cannot be read: {1}")]
    Unreadable(PathBuf, std::io::Error),
    /// A line is no key.
    #[error(
        "the API keys file {0}, line {1}: must be a SHA-256 of 64 hexadecimal digits, a space and a name of its own"
    )]
    BadLine(PathBuf, usize),
    /// It has no line.
    #[error("the API keys file {0} has no key")]
    Empty(PathBuf),
}

impl ApiKeys {
    /// Reads a file with one `SHA256 NAME` a line; empty lines and those that begin with `#` are
    /// skipped.
    ///
    /// # Errors
    /// When the file cannot be read, has a faulty line, or no key at all.
    pub(crate) fn read(file: &Path) -> Result<Self, KeysError> {
        let text =
            std::fs::read_to_string(file).map_err(|error| KeysError::Unreadable(file.to_owned(), error))?;
        // Editors of some systems begin a file with a byte order mark.
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        let mut keys: Vec<ApiKey> = Vec::new();
        for (number, line) in text.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let key = parse_line(line).filter(|key| keys.iter().all(|k| k.name != key.name));
            keys.push(key.ok_or_else(|| KeysError::BadLine(file.to_owned(), number + 1))?);
        }
        if keys.is_empty() { Err(KeysError::Empty(file.to_owned())) } else { Ok(Self(keys)) }
    }

    /// The name of the key that a request carries.
    ///
    /// # Errors
    /// A problem `unauthorized`, which does not tell a missing key from a wrong one's nearness.
    pub(crate) fn check(&self, headers: &HeaderMap) -> Result<&str, Problem> {
        let Some(field) = headers.get(header::AUTHORIZATION) else {
            return Err(refusal("the request carries no API key", "Bearer realm=\"packstone\""));
        };
        let key = field.to_str().ok().and_then(bearer).unwrap_or_default();
        let digest = Sha256::digest(key.as_bytes());
        // Every key is compared, so that the time tells nothing about which was met.
        let mut found = None;
        for known in &self.0 {
            if bool::from(known.sha256.ct_eq(&digest)) {
                found = Some(known.name.as_str());
            }
        }
        found.ok_or_else(|| {
            refusal("the API key is unknown", "Bearer realm=\"packstone\", error=\"invalid_token\"")
        })
    }
}

/// The file of keys, read again when it has changed: a key added or removed counts without a restart.
#[derive(Debug)]
pub(crate) struct KeysFile {
    path: PathBuf,
    state: Mutex<KeysState>,
}

#[derive(Debug)]
struct KeysState {
    keys: Arc<ApiKeys>,
    /// Time of change and length of the file that was read last.
    stamp: Option<(SystemTime, u64)>,
    looked: Instant,
}

impl KeysFile {
    /// Reads the file for the first time.
    ///
    /// # Errors
    /// As [`ApiKeys::read`].
    pub(crate) fn open(path: PathBuf) -> Result<Self, KeysError> {
        let stamp = stamp(&path);
        let keys = Arc::new(ApiKeys::read(&path)?);
        Ok(Self { path, state: Mutex::new(KeysState { keys, stamp, looked: Instant::now() }) })
    }

    /// The keys as of at most a second ago. An emptied file opens for nobody; a file that cannot be read or has a
    /// faulty line leaves the keys as they were, with an error in the log.
    pub(crate) fn current(&self) -> Arc<ApiKeys> {
        self.as_of(LOOK_EVERY)
    }

    fn as_of(&self, age: Duration) -> Arc<ApiKeys> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if state.looked.elapsed() >= age {
            state.looked = Instant::now();
            let stamp = stamp(&self.path);
            if stamp != state.stamp {
                state.stamp = stamp;
                match ApiKeys::read(&self.path) {
                    Ok(keys) => {
                        tracing::info!(?keys, "API keys read again");
                        state.keys = Arc::new(keys);
                    }
                    Err(error @ KeysError::Empty(_)) => {
                        tracing::warn!(%error, "no key opens this server any more");
                        state.keys = Arc::new(ApiKeys(Vec::new()));
                    }
                    Err(error) => tracing::error!(%error, "the API keys stay as they were"),
                }
            }
        }
        Arc::clone(&state.keys)
    }
}

fn stamp(path: &Path) -> Option<(SystemTime, u64)> {
    let metadata = std::fs::metadata(path).ok()?;
    Some((metadata.modified().ok()?, metadata.len()))
}

fn refusal(detail: &str, challenge: &str) -> Problem {
    Problem::new(Kind::Unauthorized, detail).with_header("www-authenticate", challenge)
}

fn bearer(field: &str) -> Option<&str> {
    let (scheme, key) = field.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| key.trim())
}

fn parse_line(line: &str) -> Option<ApiKey> {
    let (digest, name) = line.split_once(char::is_whitespace)?;
    let sha256 = hex::decode(digest)?.try_into().ok()?;
    Some(ApiKey { name: name.trim().to_owned(), sha256 })
}

/// A fresh key and the line for the file of keys.
pub(crate) fn generate(name: &str) -> (String, String) {
    let secret: [u8; 32] = rand::random();
    let key = format!("packstone_{}", hex::encode(&secret));
    let line = format!("{} {name}", hex::sha256(key.as_bytes()));
    (key, line)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<ApiKeys, KeysError> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("keys");
        std::fs::write(&file, text).unwrap();
        ApiKeys::read(&file)
    }

    fn with(authorization: &str) -> HeaderMap {
        let mut headers = HeaderMap::new();
        headers.insert(header::AUTHORIZATION, authorization.parse().unwrap());
        headers
    }

    #[test]
    fn a_generated_key_opens_and_no_other() {
        let (key, line) = generate("lab");
        let (other, other_line) = generate("field");
        let keys = read(&format!("# keys\n\n{line}\n{other_line}\n")).unwrap();
        assert_eq!(keys.check(&with(&format!("Bearer {key}"))).unwrap(), "lab");
        assert_eq!(keys.check(&with(&format!("bearer {other}"))).unwrap(), "field");
        for refused in ["Bearer", "Bearer ", "Basic abc", &format!("Bearer {key}x"), &key] {
            let problem = keys.check(&with(refused)).unwrap_err();
            assert_eq!(problem.status, 401, "{refused}");
            assert_eq!(problem.headers[0].0, "www-authenticate");
        }
        assert!(keys.check(&HeaderMap::new()).is_err());
        assert_eq!(format!("{keys:?}"), "[\"lab\", \"field\"]");
    }

    #[test]
    fn a_changed_file_is_read_again_and_a_faulty_one_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        let write = |text: &str| std::fs::write(&path, text).unwrap();
        let ((key, line), (other, other_line)) = (generate("lab"), generate("field"));
        let opens = |keys: &KeysFile, key: &str| {
            keys.as_of(Duration::ZERO).check(&with(&format!("Bearer {key}"))).is_ok()
        };
        // A byte order mark at the start, as some editors write it.
        write(&format!("\u{feff}{line}\n"));
        let keys = KeysFile::open(path.clone()).unwrap();
        assert!(opens(&keys, &key) && !opens(&keys, &other));
        write(&format!("# both\n{line}\n{other_line}\n"));
        assert!(opens(&keys, &key) && opens(&keys, &other));
        write("nonsense");
        assert!(opens(&keys, &key) && opens(&keys, &other));
        write(&format!("{other_line}\n"));
        assert!(!opens(&keys, &key) && opens(&keys, &other));
        write("");
        assert!(!opens(&keys, &key) && !opens(&keys, &other));
    }

    #[test]
    fn faulty_files_are_refused_by_line() {
        let (_, line) = generate("a");
        assert!(matches!(read("\nabc name\n"), Err(KeysError::BadLine(_, 2))));
        assert!(matches!(read(&format!("{line}\n{line}")), Err(KeysError::BadLine(_, 2))));
        assert!(matches!(read(line.split(' ').next().unwrap()), Err(KeysError::BadLine(_, 1))));
        assert!(matches!(read("# none\n"), Err(KeysError::Empty(_))));
    }
}
