//! Copies of checkpoints where several servers keep their files, so that a job goes on from there whichever server runs
//! it next, and if the machine that ran it is gone.
//!
//! A blob is never changed, so each copy has a name of its own: the attempt, and an ID that grows with time. The newest
//! counts, and once it is there those before it go. Every fault here is logged and costs work at most.

use std::collections::HashSet;
use std::fs::File;
use std::io;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::UNIX_EPOCH;

use uuid::Uuid;

use super::COMPLETE;
use crate::blobs::Blobs;
use crate::jobs::store::Kept;

/// Name of the folder.
const FOLDER: &str = "checkpoints";

/// The copies of checkpoints of all servers.
#[derive(Clone, Debug)]
pub(super) struct Shared {
    blobs: Arc<dyn Blobs>,
    /// IDs of jobs that have copies as far as this process knows: of the others it need not ask.
    known: Arc<Mutex<HashSet<String>>>,
}

/// A copy.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Copy {
    pub(super) attempt: i64,
    name: String,
}

impl Shared {
    pub(super) fn new(blobs: Arc<dyn Blobs>) -> Self {
        Self { blobs, known: Arc::default() }
    }

    /// Copies a checkpoint of an attempt, and removes the copies that it makes useless.
    pub(super) fn put(&self, id: &str, attempt: i64, mut file: &File) -> io::Result<()> {
        let name = format!("{FOLDER}/{id}/{attempt}.{}{COMPLETE}", Uuid::now_v7().simple());
        let staged = self.blobs.stage(&name)?;
        io::copy(&mut file, &mut staged.file())?;
        self.known().insert(id.to_owned());
        self.blobs.publish(staged, &name, &|| false)?;
        self.remove_those(id, |copy| copy.attempt <= attempt && copy.name != name)?;
        Ok(())
    }

    /// The newest copy of a checkpoint of a job.
    pub(super) fn newest(&self, id: &str) -> io::Result<Option<Copy>> {
        let newest = self.of(id)?.into_iter().max();
        if newest.is_some() {
            self.known().insert(id.to_owned());
        }
        Ok(newest)
    }

    /// The bytes of a copy.
    pub(super) fn open(&self, copy: &Copy) -> io::Result<File> {
        self.blobs.fetch(&copy.name)
    }

    /// Removes the copies of a job up to those of this attempt, if this process knows of any; those of other processes
    /// are left to the sweeper.
    pub(super) fn remove_known(&self, id: &str, until_attempt: i64) -> io::Result<()> {
        if !self.known().contains(id) {
            return Ok(());
        }
        // Later ones are another attempt's, and may be this process's to remove when it ends.
        if self.remove_those(id, |copy| copy.attempt <= until_attempt)? == 0 {
            self.known().remove(id);
        }
        Ok(())
    }

    /// Removes all copies of a job.
    pub(super) fn remove(&self, id: &str) -> io::Result<()> {
        self.blobs.remove_folder(&format!("{FOLDER}/{id}"))?;
        self.known().remove(id);
        Ok(())
    }

    /// All copies, with the times at which they were written.
    pub(super) fn list(&self) -> io::Result<Vec<Kept>> {
        let listed = self.blobs.list(FOLDER)?.into_iter().filter_map(|file| {
            let (id, copy) = parse(&file.name)?;
            let at = file.written?.duration_since(UNIX_EPOCH).ok()?;
            Some(Kept {
                job: id.to_owned(),
                attempt: copy.attempt,
                at_us: i64::try_from(at.as_micros()).ok()?,
            })
        });
        Ok(listed.collect())
    }

    /// IDs of the jobs that have copies, whole or not.
    pub(super) fn ids(&self) -> io::Result<HashSet<String>> {
        let id =
            |name: &str| Some(name.strip_prefix(FOLDER)?.strip_prefix('/')?.split_once('/')?.0.to_owned());
        Ok(self.blobs.list(FOLDER)?.iter().filter_map(|file| id(&file.name)).collect())
    }

    fn of(&self, id: &str) -> io::Result<Vec<Copy>> {
        let listed = self.blobs.list(&format!("{FOLDER}/{id}"))?;
        Ok(listed.iter().filter_map(|file| Some(parse(&file.name)?.1)).collect())
    }

    /// Removes some of the copies of a job; how many are left.
    fn remove_those(&self, id: &str, which: impl Fn(&Copy) -> bool) -> io::Result<usize> {
        let (removed, left): (Vec<_>, Vec<_>) = self.of(id)?.into_iter().partition(which);
        if !removed.is_empty() {
            self.blobs.remove(&removed.into_iter().map(|copy| copy.name).collect::<Vec<_>>())?;
        }
        Ok(left.len())
    }

    /// One who panicked cannot have left it half-changed.
    fn known(&self) -> std::sync::MutexGuard<'_, HashSet<String>> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The ID of the job, and the copy.
fn parse(name: &str) -> Option<(&str, Copy)> {
    let (id, file) = name.strip_prefix(FOLDER)?.strip_prefix('/')?.split_once('/')?;
    let (attempt, _) = file.strip_suffix(COMPLETE)?.split_once('.')?;
    Some((id, Copy { attempt: attempt.parse().ok()?, name: name.to_owned() }))
}
