//! The file of keys, read again when it has changed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use super::quotas::QuotaWords;
use super::{ApiKey, ApiKeys};
use crate::watched_file::WatchedFile;

/// The file of keys is looked at no more often than this.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Why the file of keys cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum KeysError {
    /// It cannot be read.
    #[error("the API keys file {0} cannot be read: {1}")]
    Unreadable(PathBuf, std::io::Error),
    /// A line is no key.
    #[error("the API keys file {0}, line {1}: {2}")]
    BadLine(PathBuf, usize, String),
    /// It has no line.
    #[error("the API keys file {0} has no key")]
    Empty(PathBuf),
}

impl ApiKeys {
    /// Reads a file with one key a line; empty lines and those that begin with `#` are skipped.
    ///
    /// # Errors
    /// When the file cannot be read, has a faulty line, or no key at all.
    fn read(file: &Path) -> Result<Self, KeysError> {
        let text =
            std::fs::read_to_string(file).map_err(|error| KeysError::Unreadable(file.to_owned(), error))?;
        // Editors of some systems begin a file with a byte order mark.
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        let mut keys: Vec<ApiKey> = Vec::new();
        let mut quotas: BTreeMap<String, QuotaWords> = BTreeMap::new();
        for (number, line) in text.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let faulty = |fault: String| KeysError::BadLine(file.to_owned(), number + 1, fault);
            let key = ApiKey::read(line).map_err(faulty)?;
            let name = &key.caller.by.key;
            if keys.iter().any(|known| known.caller.by.key == *name) {
                return Err(faulty(format!("another key has the name {name:?}: must be a name of its own")));
            }
            quotas.entry(key.caller.by.owner.clone()).or_default().merge(key.quotas).map_err(|quota| {
                let owner = &key.caller.by.owner;
                faulty(format!("a line above gives the owner {owner:?} another {quota}: must be the same"))
            })?;
            keys.push(key);
        }
        if keys.is_empty() { Err(KeysError::Empty(file.to_owned())) } else { Ok(Self { keys, quotas }) }
    }
}

/// The file of keys, read again when it has changed: a key added or removed counts without a restart.
#[derive(Debug)]
pub(crate) struct KeysFile(WatchedFile<ApiKeys>);

impl KeysFile {
    /// Reads the file for the first time.
    ///
    /// # Errors
    /// As [`ApiKeys::read`].
    pub(crate) fn open(path: PathBuf) -> Result<Self, KeysError> {
        Self::looked_at_every(LOOK_EVERY, path)
    }

    fn looked_at_every(time: Duration, path: PathBuf) -> Result<Self, KeysError> {
        WatchedFile::open(path, time, ApiKeys::read).map(Self)
    }

    /// The keys as of at most a second ago. An emptied file opens for nobody; a file that cannot be read or has a
    /// faulty line leaves the keys as they were, with an error in the log.
    pub(crate) fn current(&self) -> Arc<ApiKeys> {
        self.0.current(|path| match ApiKeys::read(path) {
            Ok(keys) => {
                tracing::info!(?keys, "API keys read again");
                Some(keys)
            }
            Err(error @ KeysError::Empty(_)) => {
                tracing::warn!(%error, "no key opens this server any more");
                Some(ApiKeys::default())
            }
            Err(error) => {
                tracing::error!(%error, "the API keys stay as they were");
                None
            }
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::generate;
    use super::*;

    fn read(text: &str) -> Result<ApiKeys, KeysError> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("keys");
        std::fs::write(&file, text).unwrap();
        ApiKeys::read(&file)
    }

    #[test]
    fn a_generated_key_opens_and_no_other() {
        let (key, line) = generate("lab", &[]);
        let (other, other_line) = generate("field", &["role=read".into()]);
        let keys = read(&format!("# keys\n\n{line}\n{other_line}\n")).unwrap();
        assert_eq!(keys.find(&key).unwrap().by.key, "lab");
        assert_eq!(keys.find(&other).unwrap().role, super::super::Role::Read);
        for refused in ["", "abc", &format!("{key}x"), &key[1..]] {
            assert!(keys.find(refused).is_none(), "{refused}");
        }
        assert_eq!(format!("{keys:?}"), "[\"lab\", \"field\"]");
    }

    #[test]
    fn a_changed_file_is_read_again_and_a_faulty_one_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        let write = |text: &str| std::fs::write(&path, text).unwrap();
        let ((key, line), (other, other_line)) = (generate("lab", &[]), generate("field", &[]));
        let opens = |keys: &KeysFile, key: &str| keys.current().find(key).is_some();
        // A byte order mark at the start, as some editors write it.
        write(&format!("\u{feff}{line}\n"));
        let keys = KeysFile::looked_at_every(Duration::ZERO, path.clone()).unwrap();
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
    fn quotas_belong_to_the_owner_and_fall_back_on_those_of_the_server() {
        use super::super::{Accounts, Quotas};
        let line = |name: &str, rest: &str| generate(name, &[rest.into()]).1 + "\n";
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        let text =
            line("a", "owner=lab max_queued=5 max_running=none") + &line("b", "owner=lab max_grains=9");
        std::fs::write(&path, text + &line("c", "max_queued=5")).unwrap();
        let defaults = Quotas { queued: Some(7), running: Some(2), ..Quotas::default() };
        let accounts = Accounts::new(Some(KeysFile::open(path).unwrap()), defaults);
        let lab = Quotas { queued: Some(5), grains: Some(9), ..Quotas::default() };
        assert_eq!(accounts.quotas("lab"), lab);
        assert_eq!(accounts.quotas("c"), Quotas { queued: Some(5), ..defaults });
        assert_eq!(accounts.quotas("gone"), defaults);
        assert!(accounts.bounds_running() && !Accounts::default().bounds_running());
        let twice = line("a", "owner=lab max_queued=5") + &line("b", "owner=lab max_queued=6");
        assert!(matches!(read(&twice), Err(KeysError::BadLine(_, 2, _))));
        for bad in
            ["max_queued=", "max_queued=-1", "max_queued=1.5", "max_queued=1 max_queued=1", "max_bytes=1"]
        {
            assert!(matches!(read(&line("a", bad)), Err(KeysError::BadLine(_, 1, _))), "{bad}");
        }
    }

    #[test]
    fn faulty_files_are_refused_by_line() {
        let (_, line) = generate("a", &[]);
        assert!(matches!(read("\nabc name\n"), Err(KeysError::BadLine(_, 2, _))));
        assert!(matches!(read(&format!("{line}\n{line}")), Err(KeysError::BadLine(_, 2, _))));
        assert!(matches!(read(&format!("{line} rol=read")), Err(KeysError::BadLine(_, 1, _))));
        assert!(matches!(read(line.split(' ').next().unwrap()), Err(KeysError::BadLine(_, 1, _))));
        assert!(matches!(read("# none\n"), Err(KeysError::Empty(_))));
    }
}
