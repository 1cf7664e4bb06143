//! The API key of a worker: of its file, which an operator may replace while the worker runs.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use hyper::header::HeaderValue;

/// Longest file of a key that is read.
const MOST_BYTES: u64 = 1 << 16;

/// Why there is no key in a file.
#[derive(Debug, thiserror::Error)]
pub(crate) enum KeyError {
    /// It cannot be read.
    #[error("it cannot be read: {0}")]
    Unread(#[from] io::Error),
    /// It holds something else.
    #[error("it must have one line of ASCII, the API key")]
    NoKey,
}

/// The key as the worker sends it.
#[derive(Debug, Default)]
pub(super) struct ApiKey {
    file: Option<PathBuf>,
    authorization: Mutex<Option<HeaderValue>>,
}

impl ApiKey {
    /// That of a file; without one there is none.
    ///
    /// # Errors
    /// The file has no key.
    pub(super) fn of(file: Option<&Path>) -> Result<Self, KeyError> {
        let authorization = file.map(read).transpose()?;
        Ok(Self { file: file.map(Path::to_owned), authorization: Mutex::new(authorization) })
    }

    /// The field of a request.
    pub(super) fn authorization(&self) -> Option<HeaderValue> {
        self.authorization.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Reads the file again after the server has refused a request with `sent`; whether there is another key now.
    /// Blocks the thread for the moment that a small file takes.
    pub(super) fn has_changed(&self, sent: Option<&HeaderValue>) -> bool {
        let Some(file) = &self.file else { return false };
        match read(file) {
            Ok(found) => {
                let is_other = Some(&found) != sent;
                *self.authorization.lock().unwrap_or_else(PoisonError::into_inner) = Some(found);
                if is_other {
                    tracing::info!(file = %file.display(), "the key was refused; the file has another one now");
                }
                is_other
            }
            Err(error) => {
                tracing::warn!(%error, file = %file.display(), "the key was refused, and its file has no other one");
                false
            }
        }
    }
}

fn read(file: &Path) -> Result<HeaderValue, KeyError> {
    let mut text = String::new();
    File::open(file)?.take(MOST_BYTES).read_to_string(&mut text)?;
    let key = text.trim();
    if key.is_empty() || key.contains(char::is_whitespace) {
        return Err(KeyError::NoKey);
    }
    let mut value = HeaderValue::try_from(format!("Bearer {key}")).map_err(|_| KeyError::NoKey)?;
    value.set_sensitive(true);
    Ok(value)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_key_that_was_replaced_is_read_again_and_a_bad_file_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("key");
        assert!(matches!(ApiKey::of(Some(&file)), Err(KeyError::Unread(_))));
        std::fs::write(&file, "two words\n").unwrap();
        assert!(matches!(ApiKey::of(Some(&file)), Err(KeyError::NoKey)));
        std::fs::write(&file, "first\n").unwrap();
        let key = ApiKey::of(Some(&file)).unwrap();
        let first = key.authorization();
        assert_eq!(first.as_ref().unwrap(), "Bearer first");
        assert!(!key.has_changed(first.as_ref()));
        std::fs::write(&file, "").unwrap();
        assert!(!key.has_changed(first.as_ref()));
        assert_eq!(key.authorization(), first);
        std::fs::write(&file, "second\n").unwrap();
        assert!(key.has_changed(first.as_ref()));
        assert_eq!(key.authorization().unwrap(), "Bearer second");
        // Another request has read it already.
        assert!(key.has_changed(first.as_ref()));
        let none = ApiKey::of(None).unwrap();
        assert!(none.authorization().is_none() && !none.has_changed(None));
    }
}
