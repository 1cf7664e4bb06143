//! The file of keys, read again when it has changed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::quotas::QuotaWords;
use super::{ApiKey, ApiKeys};
use crate::watched_file::{Change, TextError, WatchedFile};

/// Why the file of keys cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum KeysError {
    /// Its text cannot be used.
    #[error("the API keys file {0} {1}")]
    Text(PathBuf, TextError),
    /// A line is no key.
    #[error("the API keys file {0}, line {1}: {2}")]
    BadLine(PathBuf, usize, String),
    /// It has no line.
    #[error("the API keys file {0} has no key")]
    Empty(PathBuf),
}

impl ApiKeys {
    /// Reads a text with one key a line; empty lines and those that begin with `#` are skipped.
    ///
    /// Each line names all rights of its key, and the quotas of an owner stand in the first line of that owner: the
    /// beginning of a text, up to any of its lines, gives no key more than the whole text does.
    ///
    /// # Errors
    /// The number of a faulty line and its fault.
    pub(super) fn read(text: &str) -> Result<Self, (usize, String)> {
        let mut keys: Vec<ApiKey> = Vec::new();
        let mut quotas: BTreeMap<String, (usize, QuotaWords)> = BTreeMap::new();
        for (number, line) in (1..).zip(text.lines()) {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let faulty = |fault: String| (number, fault);
            let key = ApiKey::read(line).map_err(faulty)?;
            let name = &key.caller.by.key;
            if keys.iter().any(|known| known.caller.by.key == *name) {
                return Err(faulty(format!("another key has the name {name:?}: must be a name of its own")));
            }
            if let Some(same) = keys.iter().find(|known| known.sha256 == key.sha256) {
                let same = &same.caller.by.key;
                return Err(faulty(format!("it is the key of {same:?} as well: must be a key of its own")));
            }
            let owner = &key.caller.by.owner;
            let (first, known) = *quotas.entry(owner.clone()).or_insert((number, key.quotas));
            if let Some(quota) = key.quotas.beyond(known) {
                return Err(faulty(format!(
                    "{quota}= of the owner {owner:?} must stand in the first line of that owner, which is line \
                     {first}, or be the same there"
                )));
            }
            keys.push(key);
        }
        let quotas = quotas.into_iter().map(|(owner, (_, words))| (owner, words)).collect();
        Ok(Self { keys, quotas })
    }

    /// Reads the text of a file.
    fn read_file(path: &Path, text: Result<String, TextError>) -> Result<Self, KeysError> {
        let text = text.map_err(|error| KeysError::Text(path.to_owned(), error))?;
        let keys =
            Self::read(&text).map_err(|(line, fault)| KeysError::BadLine(path.to_owned(), line, fault))?;
        if keys.keys.is_empty() { Err(KeysError::Empty(path.to_owned())) } else { Ok(keys) }
    }
}

/// The file of keys, read again when it has changed: a key added or removed counts without a restart.
#[derive(Debug)]
pub(crate) struct KeysFile(WatchedFile<ApiKeys>);

impl KeysFile {
    /// Reads the file for the first time.
    ///
    /// # Errors
    /// When the file cannot be read, is cut, has a faulty line, or no key at all.
    pub(crate) fn open(path: PathBuf) -> Result<Self, KeysError> {
        WatchedFile::open(path, ApiKeys::read_file).map(Self)
    }

    /// The keys as of the last look at the file.
    pub(crate) fn current(&self) -> Arc<ApiKeys> {
        self.0.current()
    }

    /// Looks at the file. One that cannot be used, has a faulty line, or no key, leaves the keys as they were, with an
    /// error in the log: it may be cut, or not be written yet. Blocks the thread.
    pub(super) fn look(&self) {
        match self.0.look(ApiKeys::read_file) {
            None => {}
            Some(Ok(Change { before, now })) => {
                let gone: Vec<&str> =
                    before.names().filter(|name| !now.names().any(|known| known == *name)).collect();
                tracing::info!(keys = ?now, removed = ?gone, "API keys read again");
            }
            Some(Err(error)) => tracing::error!(%error, "the API keys stay as they were"),
        }
    }

    /// Whether the keys in force are not those of the file as it is now.
    pub(super) fn is_faulty(&self) -> bool {
        self.0.is_faulty()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::{Accounts, Caller, Quotas, Role, generate};
    use super::*;

    fn line_of(name: &str, rest: &str) -> (String, String) {
        generate(name, &[rest.into()])
    }

    #[test]
    fn a_generated_key_opens_and_no_other() {
        let (key, line) = line_of("lab", "role=admin");
        let (other, other_line) = line_of("field", "role=read");
        let keys = ApiKeys::read(&format!("# keys\n\n{line}\n{other_line}\n")).unwrap();
        assert_eq!(keys.find(&key).unwrap().by.key, "lab");
        assert_eq!(keys.find(&other).unwrap().role, Role::Read);
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
        let ((key, line), (other, other_line)) =
            (line_of("lab", "role=admin"), line_of("field", "role=read"));
        let opens = |keys: &KeysFile, key: &str| {
            keys.look();
            keys.current().find(key).is_some()
        };
        // A byte order mark at the start, as some editors write it.
        write(&format!("\u{feff}{line}\n"));
        let keys = KeysFile::open(path.clone()).unwrap();
        assert!(opens(&keys, &key) && !opens(&keys, &other));
        write(&format!("# both\n{line}\n{other_line}\n"));
        assert!(opens(&keys, &key) && opens(&keys, &other));
        for unusable in ["nonsense", "", "# only a comment\n", &line, "\0\0\0\0"] {
            write(unusable);
            assert!(opens(&keys, &key) && opens(&keys, &other), "{unusable:?}");
            assert!(keys.is_faulty(), "{unusable:?}");
        }
        write(&format!("{other_line}\n"));
        assert!(!opens(&keys, &key) && opens(&keys, &other) && !keys.is_faulty());
    }

    /// What every key of a text may do, and the quotas of its owner.
    fn rights(keys: &ApiKeys, secrets: &[String]) -> Vec<Option<(Caller, Quotas)>> {
        let of = |caller: &Caller| {
            let quotas = keys.quotas.get(&caller.by.owner).copied().unwrap_or_default();
            (caller.clone(), quotas.over(Quotas::default()))
        };
        secrets.iter().map(|secret| keys.find(secret).map(of)).collect()
    }

    #[test]
    fn no_beginning_of_a_file_gives_a_right_that_its_lines_do_not_name() {
        let (secrets, lines): (Vec<String>, Vec<String>) = [
            line_of("root", "role=admin"),
            line_of(
                "anna",
                "role=submit owner=lab max_queued=100 max_running=12 max_requests_per_second=12.5",
            ),
            line_of("the bert", "owner=lab role=read"),
            line_of("carl", "max_grains=none max_stored_bytes=500000 role=submit"),
            line_of("gauge", "role=metrics"),
        ]
        .into_iter()
        .unzip();
        for text in [format!("# of the lab\n{}\n", lines.join("\n")), format!("{}\r\n", lines.join("\r\n"))] {
            let whole = rights(&ApiKeys::read(&text).unwrap(), &secrets);
            assert!(whole.iter().all(Option::is_some));
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("keys");
            std::fs::write(&path, &text).unwrap();
            let running = KeysFile::open(path.clone()).unwrap();
            let mut kept = 0;
            for end in 0..=text.len() {
                std::fs::write(&path, &text.as_bytes()[..end]).unwrap();
                running.look();
                let found = rights(&running.current(), &secrets);
                assert_eq!(found.len(), whole.len());
                for (found, whole) in found.iter().zip(&whole) {
                    assert!(found.is_none() || found == whole, "{:?}: {found:?}", &text[..end]);
                }
                // Within a line the file is refused: those in force stay, and a start fails.
                if !text[..end].ends_with('\n') {
                    assert!(
                        running.is_faulty() && KeysFile::open(path.clone()).is_err(),
                        "{:?}",
                        &text[..end]
                    );
                    kept += 1;
                }
                std::fs::write(&path, &text).unwrap();
                running.look();
                assert_eq!(rights(&running.current(), &secrets), whole);
            }
            assert!(kept > 300);
        }
    }

    #[test]
    fn quotas_belong_to_the_owner_and_fall_back_on_those_of_the_server() {
        let line = |name: &str, rest: &str| line_of(name, &format!("role=submit {rest}")).1 + "\n";
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        let text = line("a", "owner=lab max_queued=5 max_running=none max_grains=9")
            + &line("b", "owner=lab max_grains=9");
        std::fs::write(&path, text + &line("c", "max_queued=5")).unwrap();
        let defaults = Quotas { queued: Some(7), running: Some(2), ..Quotas::default() };
        let accounts = Accounts::new(Some(KeysFile::open(path).unwrap()), defaults);
        let lab = Quotas { queued: Some(5), grains: Some(9), ..Quotas::default() };
        assert_eq!(accounts.quotas("lab"), lab);
        assert_eq!(accounts.quotas("c"), Quotas { queued: Some(5), ..defaults });
        assert_eq!(accounts.quotas("gone"), defaults);
        assert!(accounts.bounds_running() && !Accounts::default().bounds_running());
        for (first, second) in
            [("max_queued=5", "max_queued=6"), ("", "max_queued=6"), ("", "max_grains=none")]
        {
            let twice = line("a", &format!("owner=lab {first}")) + &line("b", &format!("owner=lab {second}"));
            let (at, fault) = ApiKeys::read(&twice).err().unwrap();
            assert!(at == 2 && fault.contains("which is line 1"), "{fault}");
        }
        for bad in
            ["max_queued=", "max_queued=-1", "max_queued=1.5", "max_queued=1 max_queued=1", "max_bytes=1"]
        {
            assert!(matches!(ApiKeys::read(&line("a", bad)), Err((1, _))), "{bad}");
        }
    }

    #[test]
    fn faulty_files_are_refused_by_line() {
        let read = |text: &str| ApiKeys::read(text).err().map(|(line, _)| line);
        let line = line_of("a", "role=admin").1;
        assert_eq!(read("\nabc name\n"), Some(2));
        assert_eq!(read(&format!("{line}\n{line}")), Some(2));
        let (digest, _) = line.split_once(' ').unwrap();
        assert_eq!(read(&format!("{line}\n{digest} b role=read")), Some(2), "a key of two names");
        assert_eq!(read(&format!("{line} rol=read")), Some(1));
        assert_eq!(read(digest), Some(1));
        let empty = ApiKeys::read_file(Path::new("keys"), Ok("# none\n".into()));
        assert!(matches!(empty, Err(KeysError::Empty(_))));
    }
}
