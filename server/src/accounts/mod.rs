//! Who uses the service: API keys with their owners, roles and quotas, as the file of keys names them.
//!
//! The server knows only SHA-256 digests of keys, so that its configuration opens nothing. Keys are 256 random bits
//! from the operating system, so that a digest without salt or stretching is enough.

mod add;
mod file;
mod line;
mod quotas;
mod rate;

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use serde::Serialize;
use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq as _;

use crate::hex;

pub(crate) use add::{AddError, add_line};
pub(crate) use file::{KeysError, KeysFile};
pub(crate) use quotas::Quotas;
use quotas::{QuotaWords, Word};
use rate::Admitted;
pub(crate) use rate::Rate;

const DIGEST_BYTES: usize = 32;

/// SHA-256 of a key.
pub(crate) type KeyDigest = [u8; DIGEST_BYTES];

/// The digest of a key.
pub(crate) fn digest(key: &str) -> KeyDigest {
    Sha256::digest(key.as_bytes()).into()
}

/// What an API key may do. `Metrics` may read the metrics and `Worker` may lease jobs and end them, nothing else; each
/// of the others may do what those before it may but these two, an administrator all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, ValueEnum)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub(crate) enum Role {
    /// Reads the metrics of the service; reads and changes nothing else.
    Metrics,
    /// Leases jobs of all owners, runs them and ends them; reads and changes nothing else.
    Worker,
    /// Reads jobs and studies of its owner, and what others share; changes nothing.
    Read,
    /// Submits jobs and studies as well, and changes those of its owner.
    Submit,
    /// Reads and changes the jobs and studies of all owners, and reads the metrics of the service.
    Admin,
}

impl Role {
    const ALL: [Self; 5] = [Self::Metrics, Self::Worker, Self::Read, Self::Submit, Self::Admin];

    /// Name in the file of keys and in the interface.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Metrics => "metrics",
            Self::Worker => "worker",
            Self::Read => "read",
            Self::Submit => "submit",
            Self::Admin => "admin",
        }
    }
}

/// A key and its owner: who submits.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Submitter {
    /// Name of the API key; empty where the server asks for none.
    pub(crate) key: String,
    /// Whose the jobs and studies are; empty where the server asks for no key.
    pub(crate) owner: String,
}

/// The user behind a request.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Caller {
    pub(crate) by: Submitter,
    pub(crate) role: Role,
    /// What the file of keys says of the requests in a second.
    requests_per_second: Word<f64>,
}

/// The one user of a server that asks for no key: without a name, and may do all.
impl Default for Caller {
    fn default() -> Self {
        Self { by: Submitter::default(), role: Role::Admin, requests_per_second: Word::Absent }
    }
}

impl Caller {
    /// The owner whose jobs and studies a listing for this caller is limited to, beside the shared ones; none for an
    /// administrator.
    pub(crate) fn sees_only(&self) -> Option<String> {
        (self.role < Role::Admin).then(|| self.by.owner.clone())
    }
}

/// The keys that open this server.
pub(crate) struct ApiKeys {
    keys: Vec<ApiKey>,
    /// What the file says of quotas, by owner.
    quotas: BTreeMap<String, QuotaWords>,
}

struct ApiKey {
    caller: Caller,
    quotas: QuotaWords,
    sha256: KeyDigest,
}

impl fmt::Debug for ApiKeys {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.names()).finish()
    }
}

impl ApiKeys {
    /// Names of the keys.
    fn names(&self) -> impl Iterator<Item = &str> {
        self.keys.iter().map(|key| key.caller.by.key.as_str())
    }

    /// The user whose key this is.
    pub(crate) fn find(&self, key: &str) -> Option<&Caller> {
        let digest = digest(key);
        self.find_by(|known| known.ct_eq(&digest).into())
    }

    /// Whether a key still has this name, owner and role.
    pub(crate) fn has(&self, caller: &Caller) -> bool {
        self.keys.iter().any(|key| key.caller.by == caller.by && key.caller.role == caller.role)
    }

    /// The user whose key has the digest that is recognised.
    pub(crate) fn find_by(&self, is_it: impl Fn(&KeyDigest) -> bool) -> Option<&Caller> {
        // Every key is compared, so that the time tells nothing about which was met.
        let mut found = None;
        for known in &self.keys {
            if is_it(&known.sha256) {
                found = Some(&known.caller);
            }
        }
        found
    }
}

/// The users of a server and what they may take.
#[derive(Debug, Default)]
pub(crate) struct Accounts {
    keys: Option<KeysFile>,
    /// Quotas of an owner for whom the file of keys says nothing.
    defaults: Quotas,
    /// Requests in a second of a key for which the file of keys says nothing.
    requests_per_second: Option<f64>,
    /// Requests of a key at once.
    burst: Option<u32>,
    admitted: Admitted,
}

impl Accounts {
    /// The users that a file of keys names; one user without a name where there is none.
    pub(crate) fn new(keys: Option<KeysFile>, defaults: Quotas) -> Self {
        Self { keys, defaults, ..Self::default() }
    }

    /// Bounds the requests of each key; without a bound where `per_second` is `None`.
    pub(crate) fn with_rate(self, per_second: Option<f64>, burst: Option<u32>) -> Self {
        Self { requests_per_second: per_second, burst, ..self }
    }

    /// How many requests a caller may send; `None` where there is no bound.
    pub(crate) fn rate_of(&self, caller: &Caller) -> Option<Rate> {
        let per_second = caller.requests_per_second.over(self.requests_per_second)?;
        Some(Rate::new(per_second, self.burst))
    }

    /// Admits a request of a caller.
    ///
    /// # Errors
    /// The rate that the caller exceeds, and the time after which the next request will be admitted.
    pub(crate) fn admit(&self, caller: &Caller) -> Result<(), (Rate, Duration)> {
        let Some(rate) = self.rate_of(caller) else { return Ok(()) };
        self.admitted.admit(&caller.by.key, rate, Instant::now()).map_err(|wait| (rate, wait))
    }

    /// The keys as of the last look at their file; `None` where the server asks for none.
    pub(crate) fn keys(&self) -> Option<Arc<ApiKeys>> {
        self.keys.as_ref().map(KeysFile::current)
    }

    /// Reads the file of keys again if it has changed. Blocks the thread.
    pub(crate) fn look_at_keys(&self) {
        if let Some(keys) = &self.keys {
            keys.look();
        }
    }

    /// Whether the keys in force are not those of the file as it is now, because it cannot be used.
    pub(crate) fn is_keys_file_faulty(&self) -> bool {
        self.keys.as_ref().is_some_and(KeysFile::is_faulty)
    }

    /// What the jobs of an owner may take.
    pub(crate) fn quotas(&self, owner: &str) -> Quotas {
        let words = self.keys().and_then(|keys| keys.quotas.get(owner).copied());
        words.unwrap_or_default().over(self.defaults)
    }

    /// Whether the number of running jobs of any owner is bounded.
    pub(crate) fn bounds_running(&self) -> bool {
        self.defaults.running.is_some()
            || self.keys().is_some_and(|keys| keys.quotas.values().any(QuotaWords::bounds_running))
    }
}

/// A fresh key and the line for the file of keys; `words` are what the line says besides the name.
pub(crate) fn generate(name: &str, words: &[String]) -> (String, String) {
    let secret: [u8; 32] = rand::random();
    let key = format!("packstone_{}", hex::encode(&secret));
    let mut line = format!("{} {name}", hex::sha256(key.as_bytes()));
    for word in words {
        line.push(' ');
        line.push_str(word);
    }
    (key, line)
}

/// Reads a number of requests in a second.
///
/// # Errors
/// What is wrong, in one sentence.
pub(crate) fn read_rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(rate) if (0.001..=1e6).contains(&rate) => Ok(rate),
        _ => Err("must be a number from 0.001 to 1000000".into()),
    }
}

/// Checks the name of a key: words without an equals sign, by which the file tells them from the rest of a line.
///
/// # Errors
/// What is wrong, in one sentence.
pub(crate) fn checked_name(text: &str) -> Result<String, String> {
    let name = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if name.is_empty() || text.chars().any(char::is_control) || name.contains('=') {
        return Err("must be one line of text without an equals sign".into());
    }
    Ok(name)
}

/// Checks the name of an owner: one word without an equals sign.
///
/// # Errors
/// What is wrong, in one sentence.
pub(crate) fn checked_owner(text: &str) -> Result<String, String> {
    let name = checked_name(text)?;
    if name.contains(' ') { Err("must be one word".into()) } else { Ok(name) }
}
