//! Result files, and files of what is made of results: one per attempt, written once, never changed.
//!
//! A file appears under its final name only when it is complete and on disk, and is an artifact only
//! once the store refers to it; whatever else lies in the folder is left over from a crash and is
//! swept. The form inside the file is the engine's; nothing here knows jobs' states or HTTP.

mod exports;
#[cfg(test)]
#[path = "tests.rs"]
mod on_disk;
pub(crate) mod read;
pub(crate) mod receive;
pub(crate) mod stream;
pub(crate) mod write;

use std::collections::HashSet;
use std::fs;
use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use jiff::civil::Date;

use crate::atomic_file::PARTIAL;

/// Ending of a complete result.
const RESULT: &str = ".packstone";
/// Ending of a complete export.
const EXPORT: &str = ".export";
/// Ending of a complete export of revision 1.
const EXPORT_1: &str = ".derived";
/// Name of the folder, beside the one of results, to which files are moved that the database does not know.
const QUARANTINE: &str = "quarantine";

/// The folder of results.
#[derive(Clone, Debug)]
pub(crate) struct Artifacts {
    root: PathBuf,
    in_flight: Arc<Mutex<HashSet<String>>>,
    verified: Arc<Mutex<HashSet<String>>>,
}

/// Keeps the sweeper off a result between its first byte and its commit.
#[derive(Debug)]
pub(crate) struct InFlight {
    path: String,
    in_flight: Arc<Mutex<HashSet<String>>>,
}

impl Drop for InFlight {
    fn drop(&mut self) {
        self.in_flight.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.path);
    }
}

impl Artifacts {
    /// Opens the folder, and makes it where it is missing.
    pub(crate) fn open(root: PathBuf) -> io::Result<Self> {
        fs::create_dir_all(&root)?;
        Ok(Self { root, in_flight: Arc::default(), verified: Arc::default() })
    }

    /// Claims the place of the result of an attempt, relative to the folder.
    pub(crate) fn begin(&self, id: &str, attempt: i64) -> InFlight {
        self.claim(id, attempt, RESULT)
    }

    /// Claims the place of a file that an attempt makes of a result.
    pub(crate) fn begin_export(&self, id: &str, attempt: i64) -> InFlight {
        self.claim(id, attempt, EXPORT)
    }

    /// Two digits of the id's random end keep the folders small.
    fn claim(&self, id: &str, attempt: i64, ending: &str) -> InFlight {
        let fan = &id[id.len().saturating_sub(2)..];
        let path = format!("{fan}/{id}.{attempt}{ending}");
        self.in_flight.lock().unwrap_or_else(PoisonError::into_inner).insert(path.clone());
        InFlight { path, in_flight: Arc::clone(&self.in_flight) }
    }

    /// Removes a result that nothing refers to. A missing one is as good as removed.
    pub(crate) fn remove(&self, path: &str) -> io::Result<()> {
        self.verified.lock().unwrap_or_else(PoisonError::into_inner).remove(path);
        match fs::remove_file(self.root.join(path)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        }
    }

    /// Results and partial results that no attempt is writing at the moment of the listing or later,
    /// as pairs of the file's path and that of the complete result it would be.
    ///
    /// The order matters: a file seen here and no longer in flight afterwards is either committed,
    /// so that the store refers to it, or left over.
    pub(crate) fn settled(&self) -> io::Result<Vec<(String, String)>> {
        let mut found = Vec::new();
        for folder in fs::read_dir(&self.root)? {
            let folder = folder?;
            if !folder.file_type()?.is_dir() {
                continue;
            }
            for file in fs::read_dir(folder.path())? {
                let file = file?;
                let (Ok(folder), Ok(name)) =
                    (folder.file_name().into_string(), file.file_name().into_string())
                else {
                    continue;
                };
                let path = format!("{folder}/{name}");
                let complete = path.strip_suffix(PARTIAL).unwrap_or(&path);
                if [RESULT, EXPORT, EXPORT_1].iter().any(|ending| complete.ends_with(ending)) {
                    found.push((path.clone(), complete.to_owned()));
                }
            }
        }
        let in_flight = self.in_flight.lock().unwrap_or_else(PoisonError::into_inner);
        found.retain(|(_, complete)| !in_flight.contains(complete));
        Ok(found)
    }

    /// The ids of the jobs that complete results belong to, by their names, with the paths of the results.
    pub(crate) fn results(&self) -> io::Result<Vec<(String, String)>> {
        let results = self.settled()?.into_iter().filter_map(|(path, complete)| {
            let name = complete.rsplit('/').next()?.strip_suffix(RESULT)?;
            let (id, _attempt) = name.rsplit_once('.')?;
            (path == complete).then(|| (id.to_owned(), path))
        });
        Ok(results.collect())
    }

    /// Moves a file that the database does not know to the quarantine, and returns where it lies there. A missing one
    /// is as good as moved.
    pub(crate) fn quarantine(&self, path: &str, today: Date) -> io::Result<Option<PathBuf>> {
        let to = self.quarantine_root().join(today.to_string()).join(path);
        if let Some(folder) = to.parent() {
            fs::create_dir_all(folder)?;
        }
        self.verified.lock().unwrap_or_else(PoisonError::into_inner).remove(path);
        match fs::rename(self.locate(path), &to) {
            Ok(()) => Ok(Some(to)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Removes what has been in the quarantine for more than so many days, and returns the folders removed.
    pub(crate) fn empty_quarantine(&self, today: Date, days: u32) -> io::Result<Vec<PathBuf>> {
        let mut removed = Vec::new();
        let entries = match fs::read_dir(self.quarantine_root()) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(removed),
            entries => entries?,
        };
        for entry in entries {
            let entry = entry?;
            let since: Option<Date> = entry.file_name().to_str().and_then(|name| name.parse().ok());
            let age = since.and_then(|since| today.since(since).ok()).map(|age| i64::from(age.get_days()));
            if age.is_some_and(|age| age > i64::from(days)) {
                fs::remove_dir_all(entry.path())?;
                removed.push(entry.path());
            }
        }
        Ok(removed)
    }

    fn quarantine_root(&self) -> PathBuf {
        self.root.with_file_name(QUARANTINE)
    }

    fn locate(&self, path: &str) -> PathBuf {
        self.root.join(path)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_quarantine_is_emptied_after_its_days() {
        let folder = tempfile::tempdir().unwrap();
        let artifacts = Artifacts::open(folder.path().join("artifacts")).unwrap();
        fs::create_dir(folder.path().join("artifacts/ab")).unwrap();
        fs::write(folder.path().join("artifacts/ab/xab.1.packstone"), "x").unwrap();
        let day = |text: &str| text.parse::<Date>().unwrap();
        let moved = artifacts.quarantine("ab/xab.1.packstone", day("2026-03-28")).unwrap().unwrap();
        assert_eq!(moved, folder.path().join("quarantine/2026-03-28/ab/xab.1.packstone"));
        assert_eq!(fs::read(&moved).unwrap(), b"x");
        assert_eq!(artifacts.quarantine("ab/xab.1.packstone", day("2026-03-28")).unwrap(), None);
        assert!(artifacts.empty_quarantine(day("2026-04-04"), 7).unwrap().is_empty());
        assert_eq!(artifacts.empty_quarantine(day("2026-04-05"), 7).unwrap().len(), 1);
        assert!(!moved.exists());
    }

    #[test]
    fn what_is_in_flight_is_not_settled() {
        let folder = tempfile::tempdir().unwrap();
        let artifacts = Artifacts::open(folder.path().join("artifacts")).unwrap();
        fs::create_dir(folder.path().join("artifacts/ab")).unwrap();
        for name in [
            "ab/xab.1.packstone",
            "ab/xab.2.packstone.tmp",
            "ab/notes.txt",
            "ab/notes.tmp",
            "ab/yab.1.export",
            "ab/yab.2.export.tmp",
        ] {
            fs::write(folder.path().join("artifacts").join(name), "x").unwrap();
        }
        let writing = artifacts.begin("xab", 2);
        let deriving = artifacts.begin_export("yab", 2);
        let mut settled = artifacts.settled().unwrap();
        settled.sort();
        let itself = |path: &str| (path.to_owned(), path.to_owned());
        assert_eq!(settled, [itself("ab/xab.1.packstone"), itself("ab/yab.1.export")]);
        drop((writing, deriving));
        let mut settled: Vec<String> =
            artifacts.settled().unwrap().into_iter().map(|(path, _)| path).collect();
        settled.sort();
        let all = ["ab/xab.1.packstone", "ab/xab.2.packstone.tmp", "ab/yab.1.export", "ab/yab.2.export.tmp"];
        assert_eq!(settled, all);
        artifacts.remove("ab/xab.1.packstone").unwrap();
        artifacts.remove("ab/xab.1.packstone").unwrap();
    }
}
