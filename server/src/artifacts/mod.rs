//! Result files, and files of what is made of results: one per attempt, written once, never changed.
//!
//! A file appears under its final name only when it is complete and durable, and is an artifact only
//! once the store refers to it; whatever else lies there is left over from a crash and is
//! swept. Where the files lie is for [`Blobs`] to know. The form inside the file is the engine's; nothing here knows
//! jobs' states or HTTP.

pub(crate) mod conversions;
mod exports;
mod known;
#[cfg(test)]
#[path = "tests.rs"]
mod on_disk;
pub(crate) mod read;
pub(crate) mod receive;
pub(crate) mod stream;
pub(crate) mod write;

use std::collections::{BTreeSet, HashSet};
use std::fs;
use std::io;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use jiff::civil::Date;

use self::known::Known;
use crate::blobs::blocks::OnDamage;
use crate::blobs::{Blobs, Files, Listed, PARTIAL};
use crate::tasks;

/// Ending of a complete result.
const RESULT: &str = ".packstone";
/// Ending of a complete export.
const EXPORT: &str = ".export";
/// Name of the folder of results and exports.
const FOLDER: &str = crate::blobs::RESULTS;
/// Name of the folder, beside the one of results, to which files are moved that the database does not know.
const QUARANTINE: &str = "quarantine";
/// Name of the folder of the checkpoints, beside it.
const CHECKPOINTS: &str = "checkpoints";

/// The results and exports.
#[derive(Clone, Debug)]
pub(crate) struct Artifacts {
    blobs: Arc<dyn Blobs>,
    in_flight: Arc<Mutex<HashSet<String>>>,
    known: Known,
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

/// A result or an export, or a part of one, that no attempt of this process is writing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Settled {
    /// Where it lies, relative to the folder of results.
    pub(crate) path: String,
    /// The path of the complete file that it is or would be.
    pub(crate) complete: String,
}

impl Settled {
    /// Whether it was written to its end.
    pub(crate) fn is_complete(&self) -> bool {
        self.path == self.complete
    }

    /// The ID of the job or the export, and the attempt that wrote it, by its name.
    pub(crate) fn attempt(&self) -> Option<(&str, i64)> {
        let name = self.complete.rsplit('/').next()?;
        let name = [RESULT, EXPORT].iter().find_map(|ending| name.strip_suffix(ending))?;
        let (id, attempt) = name.rsplit_once('.')?;
        Some((id, attempt.parse().ok()?))
    }

    /// Reads the path of a file; `None` for what is neither a result nor an export.
    fn read(path: &str) -> Option<Self> {
        let is_file = |path: &str| [RESULT, EXPORT].iter().any(|ending| path.ends_with(ending));
        let complete = match path.strip_suffix(PARTIAL) {
            None => path,
            // In a shared folder with a name of its own besides.
            Some(staged) => {
                Some(staged).filter(|staged| is_file(staged)).or(Some(staged.rsplit_once('.')?.0))?
            }
        };
        is_file(complete).then(|| Self { path: path.to_owned(), complete: complete.to_owned() })
    }
}

impl Artifacts {
    /// The results and exports of these blobs.
    pub(crate) fn new(blobs: Arc<dyn Blobs>) -> Self {
        Self { blobs, in_flight: Arc::default(), known: Known::default() }
    }

    /// Those below a directory of this process alone; their folder is made where it is missing.
    ///
    /// # Errors
    /// The system's.
    #[cfg(test)]
    pub(crate) fn open(directory: &Path) -> io::Result<Self> {
        fs::create_dir_all(directory.join(FOLDER))?;
        Ok(Self::new(Arc::new(Files::alone(directory.to_owned()))))
    }

    /// Those below a directory that is emptied before anybody opens it again: they may be lost with the power, and are
    /// not synchronized with the disk.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn scratch(directory: &Path) -> io::Result<Self> {
        fs::create_dir_all(directory.join(FOLDER))?;
        Ok(Self::new(Arc::new(Files::scratch(directory.to_owned()))))
    }

    /// Claims the place of the result of an attempt, relative to the folder.
    pub(crate) fn begin(&self, id: &str, attempt: i64) -> InFlight {
        self.claim(id, attempt, RESULT)
    }

    /// Claims the place of a file that an attempt makes of a result.
    pub(crate) fn begin_export(&self, id: &str, attempt: i64) -> InFlight {
        self.claim(id, attempt, EXPORT)
    }

    /// The path of the result of an attempt, relative to the folder.
    pub(crate) fn path_of_result(id: &str, attempt: i64) -> String {
        path_of(id, attempt, RESULT)
    }

    fn claim(&self, id: &str, attempt: i64, ending: &str) -> InFlight {
        let path = path_of(id, attempt, ending);
        self.in_flight.lock().unwrap_or_else(PoisonError::into_inner).insert(path.clone());
        InFlight { path, in_flight: Arc::clone(&self.in_flight) }
    }

    /// Removes files that nothing refers to. Missing ones are as good as removed. Blocks the thread.
    ///
    /// # Errors
    /// Those of the storage.
    pub(crate) fn remove(&self, paths: &[String]) -> io::Result<()> {
        for path in paths {
            self.forget(path);
        }
        self.blobs.remove(&paths.iter().map(|path| blob(path)).collect::<Vec<_>>())
    }

    /// Removes files that nothing refers to, on a thread that may block. What cannot be removed is left to the sweeper.
    pub(crate) async fn discard(&self, paths: Vec<String>) {
        if paths.is_empty() {
            return;
        }
        let artifacts = self.clone();
        let removed = tasks::blocking(move || {
            artifacts.remove(&paths).inspect_err(|error| {
                let path = paths.first();
                tracing::warn!(%error, files = paths.len(), path, "files are left to the sweeper");
            })
        });
        if let Err(error) = removed.await {
            tracing::error!(%error, "files are left to the sweeper");
        }
    }

    /// What no attempt of this process is writing at the moment of the listing or later. Where other processes write
    /// too, only files that are at least so old by the clock of the storage. Blocks the thread.
    ///
    /// The order matters: a file seen here and no longer in flight afterwards is either committed,
    /// so that the store refers to it, or left over.
    ///
    /// # Errors
    /// Those of the storage.
    pub(crate) fn settled(&self, least_age: Duration) -> io::Result<Vec<Settled>> {
        // Before the listing: what is written meanwhile is younger.
        let by_age = self.blobs.is_shared() && !least_age.is_zero();
        let written_until = if by_age { self.blobs.now()?.checked_sub(least_age) } else { None };
        let old = |written: Option<SystemTime>| {
            written_until.is_none_or(|until| written.is_some_and(|at| at <= until))
        };
        let found = self.dated()?.into_iter().filter(|(_, written)| old(*written));
        Ok(found.map(|(file, _)| file).collect())
    }

    /// What no attempt of this process is writing at the moment of the listing or later, with the times at which it was
    /// written where these are told. Blocks the thread.
    ///
    /// # Errors
    /// Those of the storage.
    pub(crate) fn dated(&self) -> io::Result<Vec<(Settled, Option<SystemTime>)>> {
        let listed = self.blobs.list(FOLDER)?;
        let read = |file: &Listed| {
            let path = file.name.strip_prefix(FOLDER)?.strip_prefix('/')?;
            Some((Settled::read(path)?, file.written))
        };
        let mut found: Vec<_> = listed.iter().filter_map(read).collect();
        let in_flight = self.in_flight.lock().unwrap_or_else(PoisonError::into_inner);
        found.retain(|(file, _)| !in_flight.contains(&file.complete));
        Ok(found)
    }

    /// Whether other processes may write files here.
    pub(crate) fn are_shared(&self) -> bool {
        self.blobs.is_shared()
    }

    /// Looks whether the place of the files answers and is still the same. Blocks the thread, for seconds at most.
    pub(crate) fn look(&self) {
        self.blobs.look();
    }

    /// What is wrong with the place of the files, by the last look.
    pub(crate) fn trouble(&self) -> Option<String> {
        self.blobs.trouble()
    }

    /// Removes the folders that hold no file any more. Blocks the thread.
    ///
    /// # Errors
    /// Those of the storage.
    pub(crate) fn remove_empty_folders(&self) -> io::Result<()> {
        [FOLDER, QUARANTINE, CHECKPOINTS]
            .iter()
            .try_for_each(|folder| self.blobs.remove_empty_folders(folder))
    }

    /// The blobs below, where other processes use them too.
    pub(crate) fn shared(&self) -> Option<Arc<dyn Blobs>> {
        self.blobs.is_shared().then(|| Arc::clone(&self.blobs))
    }

    /// The ids of the jobs that complete results belong to, by their names, with the paths of the results. Blocks the
    /// thread.
    ///
    /// # Errors
    /// Those of the storage.
    pub(crate) fn results(&self) -> io::Result<Vec<(String, String)>> {
        let results = self.settled(Duration::ZERO)?.into_iter().filter_map(|file| {
            let is_result = file.is_complete() && file.path.ends_with(RESULT);
            let id = file.attempt()?.0.to_owned();
            is_result.then_some((id, file.path))
        });
        Ok(results.collect())
    }

    /// Moves a file that the database does not know to the quarantine, and tells where it lies there. A missing one
    /// is as good as moved. Blocks the thread.
    ///
    /// # Errors
    /// Those of the storage.
    pub(crate) fn quarantine(&self, path: &str, today: Date) -> io::Result<Option<String>> {
        let to = format!("{QUARANTINE}/{today}/{path}");
        self.forget(path);
        Ok(self.blobs.rename(&blob(path), &to)?.then(|| self.blobs.shown(&to)))
    }

    /// Removes what has been in the quarantine for more than so many days, and tells what that was. Blocks the thread.
    ///
    /// # Errors
    /// Those of the storage.
    pub(crate) fn empty_quarantine(&self, today: Date, days: u32) -> io::Result<Vec<String>> {
        let listed = self.blobs.list(QUARANTINE)?;
        let since: BTreeSet<Date> = listed
            .iter()
            .filter_map(|file| file.name.split('/').nth(1)?.parse().ok())
            .filter(|since: &Date| {
                today.since(*since).is_ok_and(|age| i64::from(age.get_days()) > i64::from(days))
            })
            .collect();
        let mut removed = Vec::new();
        for since in since {
            let folder = format!("{QUARANTINE}/{since}");
            self.blobs.remove_folder(&folder)?;
            removed.push(self.blobs.shown(&folder));
        }
        Ok(removed)
    }

    fn forget(&self, path: &str) {
        self.known.forget(path);
        self.blobs.forget(&blob(path));
    }

    /// What is to be done where a block of a file is damaged: the next reader compares the SHA-256 of the whole file.
    fn on_damage(&self, path: &str) -> OnDamage {
        let (artifacts, path) = (self.clone(), path.to_owned());
        Arc::new(move || artifacts.forget(&path))
    }
}

/// Two digits of the id's random end keep the folders small.
fn path_of(id: &str, attempt: i64, ending: &str) -> String {
    let fan = &id[id.len().saturating_sub(2)..];
    format!("{fan}/{id}.{attempt}{ending}")
}

/// The name of the blob of a file.
fn blob(path: &str) -> String {
    format!("{FOLDER}/{path}")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_quarantine_is_emptied_after_its_days() {
        let folder = tempfile::tempdir().unwrap();
        let artifacts = Artifacts::open(folder.path()).unwrap();
        fs::create_dir(folder.path().join("artifacts/ab")).unwrap();
        fs::write(folder.path().join("artifacts/ab/xab.1.packstone"), "x").unwrap();
        let day = |text: &str| text.parse::<Date>().unwrap();
        let moved = artifacts.quarantine("ab/xab.1.packstone", day("2026-03-28")).unwrap().unwrap();
        let there = folder.path().join("quarantine/2026-03-28/ab/xab.1.packstone");
        assert_eq!(moved, there.display().to_string());
        assert_eq!(fs::read(&there).unwrap(), b"x");
        assert_eq!(artifacts.quarantine("ab/xab.1.packstone", day("2026-03-28")).unwrap(), None);
        assert!(artifacts.empty_quarantine(day("2026-04-04"), 7).unwrap().is_empty());
        assert_eq!(artifacts.empty_quarantine(day("2026-04-05"), 7).unwrap().len(), 1);
        assert!(!there.exists());
    }

    #[test]
    fn what_is_in_flight_is_not_settled() {
        let folder = tempfile::tempdir().unwrap();
        let artifacts = Artifacts::open(folder.path()).unwrap();
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
        let settled = || {
            let settled = artifacts.settled(Duration::ZERO).unwrap();
            let mut paths: Vec<String> = settled.into_iter().map(|file| file.path).collect();
            paths.sort();
            paths
        };
        assert_eq!(settled(), ["ab/xab.1.packstone", "ab/yab.1.export"]);
        drop((writing, deriving));
        let all = ["ab/xab.1.packstone", "ab/xab.2.packstone.tmp", "ab/yab.1.export", "ab/yab.2.export.tmp"];
        assert_eq!(settled(), all);
        artifacts.remove(&["ab/xab.1.packstone".into()]).unwrap();
        artifacts.remove(&["ab/xab.1.packstone".into()]).unwrap();
    }

    #[test]
    fn a_file_is_of_an_attempt_by_its_name() {
        for (path, complete, attempt) in [
            ("ab/xab.1.packstone", "ab/xab.1.packstone", Some(("xab", 1))),
            ("ab/xab.12.export.tmp", "ab/xab.12.export", Some(("xab", 12))),
            ("ab/xab.12.export.0192af.tmp", "ab/xab.12.export", Some(("xab", 12))),
            ("ab/xab.last.packstone", "ab/xab.last.packstone", None),
        ] {
            let read = Settled::read(path).unwrap();
            assert_eq!((read.complete.as_str(), read.attempt()), (complete, attempt), "{path}");
            assert_eq!(read.is_complete(), path == complete);
        }
        for other in ["notes.txt", "ab/notes.tmp", "ab/xab.1.packstone.gz", "clock.0192af.tmp"] {
            assert_eq!(Settled::read(other), None, "{other}");
        }
    }
}
