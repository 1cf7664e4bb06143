//! Signatures of webhooks as Standard Webhooks defines them (<https://www.standardwebhooks.com>), and the file of
//! secrets.
//!
//! The signature is `v1,` and the Base64 of HMAC-SHA256 over `ID.TIMESTAMP.BODY`; the key is what stands in Base64
//! behind `whsec_`. Each secret of the file signs, so that a receiver can change from one to the next.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use hmac::{Hmac, Mac as _};
use sha2::Sha256;

use crate::watched_file::{Change, TextError, WatchedFile};

/// What a secret begins with.
const PREFIX: &str = "whsec_";
/// Bytes of a secret, at least and at most, by the standard.
const SECRET_BYTES: std::ops::RangeInclusive<usize> = 24..=64;
/// Most secrets of a file: each makes the header longer.
const MAX_SECRETS: usize = 8;

/// Why the file of secrets cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SecretsError {
    /// Its text cannot be used.
    #[error("the webhook secret file {0} {1}")]
    Text(PathBuf, TextError),
    /// A line is no secret.
    #[error("the webhook secret file {0}, line {1}: {2}")]
    BadLine(PathBuf, usize, String),
    /// It has no line, or too many.
    #[error("the webhook secret file {0} has {1} secrets: must have at least 1 and at most {MAX_SECRETS}")]
    Count(PathBuf, usize),
}

/// Secrets that sign.
#[derive(Clone)]
pub(crate) struct Secrets(Vec<Hmac<Sha256>>);

impl Secrets {
    /// The header `webhook-signature` of a message; `timestamp` is in seconds since the Unix epoch.
    pub(crate) fn sign(&self, id: &str, timestamp: i64, body: &str) -> String {
        let of = |key: &Hmac<Sha256>| {
            let mut mac = key.clone();
            mac.update(format!("{id}.{timestamp}.").as_bytes());
            mac.update(body.as_bytes());
            format!("v1,{}", BASE64_STANDARD.encode(mac.finalize().into_bytes()))
        };
        self.0.iter().map(of).collect::<Vec<_>>().join(" ")
    }

    /// Reads a file with one secret a line; empty lines and those that begin with `#` are skipped.
    fn read(file: &Path, text: Result<String, TextError>) -> Result<Self, SecretsError> {
        let text = text.map_err(|error| SecretsError::Text(file.to_owned(), error))?;
        let mut secrets = Vec::new();
        for (number, line) in text.lines().enumerate() {
            let line = line.trim();
            if !line.is_empty() && !line.starts_with('#') {
                let secret = read_secret(line)
                    .map_err(|fault| SecretsError::BadLine(file.to_owned(), number + 1, fault))?;
                secrets.push(secret);
            }
        }
        if !(1..=MAX_SECRETS).contains(&secrets.len()) {
            return Err(SecretsError::Count(file.to_owned(), secrets.len()));
        }
        Ok(Self(secrets))
    }
}

impl fmt::Debug for Secrets {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} secrets", self.0.len())
    }
}

fn read_secret(line: &str) -> Result<Hmac<Sha256>, String> {
    let must =
        format!("must be {PREFIX} and the Base64 of 24 to 64 bytes, as `packstone webhook-secret` prints it");
    let encoded = line.strip_prefix(PREFIX).ok_or_else(|| format!("does not begin with {PREFIX}: {must}"))?;
    let key = BASE64_STANDARD.decode(encoded).map_err(|_| format!("is no Base64: {must}"))?;
    if !SECRET_BYTES.contains(&key.len()) {
        return Err(format!("has {} bytes: {must}", key.len()));
    }
    Hmac::new_from_slice(&key).map_err(|error| format!("{error}: {must}"))
}

/// A fresh secret of 256 random bits, as a line of the file.
pub(crate) fn generate() -> String {
    let secret: [u8; 32] = rand::random();
    format!("{PREFIX}{}", BASE64_STANDARD.encode(secret))
}

/// The file of secrets, read again when it has changed.
#[derive(Debug)]
pub(crate) struct SecretsFile(WatchedFile<Secrets>);

impl SecretsFile {
    /// Reads the file for the first time.
    ///
    /// # Errors
    /// When the file cannot be read, is cut, has a faulty line, no secret or too many.
    pub(crate) fn open(path: PathBuf) -> Result<Self, SecretsError> {
        WatchedFile::open(path, Secrets::read).map(Self)
    }

    /// The secrets as of the last look at the file.
    pub(crate) fn current(&self) -> Arc<Secrets> {
        self.0.current()
    }

    /// Looks at the file. One that cannot be used leaves the secrets as they were, with an error in the log. Blocks the
    /// thread.
    pub(crate) fn look(&self) {
        match self.0.look(Secrets::read) {
            None => {}
            Some(Ok(Change { now, .. })) => tracing::info!(secrets = ?now, "webhook secrets read again"),
            Some(Err(error)) => tracing::error!(%error, "the webhook secrets stay as they were"),
        }
    }

    /// Whether the secrets in force are not those of the file as it is now, because it cannot be used.
    pub(crate) fn is_faulty(&self) -> bool {
        self.0.is_faulty()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::watched_file::text_of;

    const EXAMPLE: &str = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";
    /// ID, time and body of the example.
    const MESSAGE: (&str, i64, &str) =
        ("msg_p5jXN8AQM9LWM0D4loKWxJek", 1_614_265_330, "{\"test\": 2432232314}");
    const SIGNATURE: &str = "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=";

    fn read(path: &Path) -> Result<Secrets, SecretsError> {
        Secrets::read(path, text_of(path))
    }

    fn file(text: &str) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("secrets");
        std::fs::write(&path, text).unwrap();
        (folder, path)
    }

    fn sign(secrets: &Secrets) -> String {
        secrets.sign(MESSAGE.0, MESSAGE.1, MESSAGE.2)
    }

    #[test]
    fn the_example_of_the_standard_has_its_signature() {
        let (_folder, path) = file(&format!("# of the receiver\n\n{EXAMPLE}\n"));
        assert_eq!(sign(&read(&path).unwrap()), SIGNATURE);
    }

    #[test]
    fn all_secrets_of_a_file_sign() {
        let other = generate();
        let (_folder, path) = file(&format!("{other}\n{EXAMPLE}\n"));
        let secrets = read(&path).unwrap();
        let signed = sign(&secrets);
        let (first, second) = signed.split_once(' ').unwrap();
        assert!(first.starts_with("v1,") && first != second);
        assert_eq!(second, SIGNATURE);
        assert_eq!(format!("{secrets:?}"), "2 secrets");
    }

    #[test]
    fn faulty_files_are_refused_without_their_contents() {
        let short = format!("{PREFIX}{}", BASE64_STANDARD.encode([1; 23]));
        let long = format!("{PREFIX}{}", BASE64_STANDARD.encode([1; 65]));
        for bad in ["secret", "whsec_!", &short, &long] {
            let (_folder, path) = file(&format!("{EXAMPLE}\n{bad}\n"));
            let error = read(&path).unwrap_err();
            assert!(matches!(error, SecretsError::BadLine(_, 2, _)), "{error}");
            assert!(!error.to_string().contains(&short[PREFIX.len()..]), "{error}");
        }
        for text in ["# none\n".to_owned(), format!("{EXAMPLE}\n").repeat(9)] {
            let (_folder, path) = file(&text);
            assert!(matches!(read(&path), Err(SecretsError::Count(..))));
        }
    }

    #[test]
    fn a_changed_file_is_read_again_and_a_faulty_one_changes_nothing() {
        let (_folder, path) = file(&(generate() + "\n"));
        let secrets = SecretsFile::open(path.clone()).unwrap();
        let signed = || {
            secrets.look();
            sign(&secrets.current())
        };
        assert_ne!(signed(), SIGNATURE);
        std::fs::write(&path, format!("{EXAMPLE}\n")).unwrap();
        assert_eq!(signed(), SIGNATURE);
        // Of a secret of 32 bytes the first 40 characters are a shorter secret.
        let other = generate();
        for end in 0..=other.len() {
            std::fs::write(&path, &other[..end]).unwrap();
            assert!(signed() == SIGNATURE && secrets.is_faulty(), "{end}");
            assert!(SecretsFile::open(path.clone()).is_err(), "{end}");
        }
        std::fs::remove_file(&path).unwrap();
        assert_eq!(signed(), SIGNATURE);
    }
}
