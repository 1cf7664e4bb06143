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
pub(crate) mod stream;
pub(crate) mod write;

use std::collections::HashSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Ending of a complete result.
const RESULT: &str = ".packstone";
/// Ending of a complete file that was made of one.
const DERIVED: &str = ".export";
/// What follows the ending of one that is being written.
const PARTIAL: &str = ".tmp";

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
        self.claim(id, attempt, DERIVED)
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
                if [RESULT, DERIVED].iter().any(|ending| complete.ends_with(ending)) {
                    found.push((path.clone(), complete.to_owned()));
                }
            }
        }
        let in_flight = self.in_flight.lock().unwrap_or_else(PoisonError::into_inner);
        found.retain(|(_, complete)| !in_flight.contains(complete));
        Ok(found)
    }

    fn locate(&self, path: &str) -> PathBuf {
        self.root.join(path)
    }
}

/// Makes the entries of a folder survive a power cut.
fn sync_dir(folder: &Path) -> io::Result<()> {
    fs::File::open(folder)?.sync_all()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

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
