//! Copies of objects on a disk of this machine, for what is read in many small pieces: bounded, and those used longest
//! ago go.

use std::collections::VecDeque;
use std::fs::{self, File};
use std::io;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use uuid::Uuid;

use super::super::{PARTIAL, Staged};
use crate::disk::Disk;

/// Most bytes of copies that are kept for the next reader.
const MOST_BYTES: u64 = 1 << 30;
/// Most copies that are kept; each has an open file.
const MOST_COPIES: usize = 32;

/// A copy of an object; the file goes with it.
#[derive(Debug)]
struct Copy {
    name: String,
    length: u64,
    file: Staged,
}

/// The copies of a process.
#[derive(Debug)]
pub(super) struct Copies {
    scratch: PathBuf,
    disk: Disk,
    /// The one used last comes first.
    kept: Mutex<VecDeque<Copy>>,
}

impl Copies {
    /// Copies in the folder `scratch`, within the room of its disk.
    pub(super) fn new(scratch: PathBuf, disk: Disk) -> Self {
        Self { scratch, disk, kept: Mutex::default() }
    }

    /// Opens the copy of an object, if there is one.
    pub(super) fn open(&self, name: &str) -> Option<File> {
        let mut kept = self.kept();
        let found = kept.iter().position(|copy| copy.name == name)?;
        let copy = kept.remove(found)?;
        let opened = copy.open();
        kept.push_front(copy);
        opened.ok()
    }

    /// Makes a copy of an object of that length by `copy`, and opens it.
    ///
    /// # Errors
    /// Those of `copy` and the disk; [`io::ErrorKind::StorageFull`] where there is no room for it.
    pub(super) fn make(
        &self,
        name: &str,
        length: u64,
        copy: impl FnOnce(&File) -> io::Result<()>,
    ) -> io::Result<File> {
        while self.disk.room() < length {
            if self.kept().pop_back().is_none() {
                return Err(io::ErrorKind::StorageFull.into());
            }
        }
        fs::create_dir_all(&self.scratch)?;
        let file = Staged::create(self.scratch.join(format!("{}{PARTIAL}", Uuid::now_v7().simple())))?;
        copy(file.file())?;
        let copy = Copy { name: name.to_owned(), length, file };
        let opened = copy.open()?;
        let mut kept = self.kept();
        kept.retain(|other| other.name != name);
        kept.push_front(copy);
        while kept.len() > MOST_COPIES || kept.iter().map(|copy| copy.length).sum::<u64>() > MOST_BYTES {
            kept.pop_back();
        }
        Ok(opened)
    }

    /// Removes the copy of an object.
    pub(super) fn forget(&self, name: &str) {
        self.kept().retain(|copy| copy.name != name);
    }

    /// One who panicked cannot have left it half-changed.
    fn kept(&self) -> MutexGuard<'_, VecDeque<Copy>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Copy {
    /// A file with a position of its own.
    fn open(&self) -> io::Result<File> {
        File::open(self.file.path.as_deref().ok_or(io::ErrorKind::NotFound)?)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::io::{Read as _, Write as _};

    use super::*;
    use crate::disk::Shortage;

    fn copies(folder: &std::path::Path, min_free: u64) -> Copies {
        let disk = Disk::new(folder.to_owned(), Some(min_free), Shortage::default());
        Copies::new(folder.join("scratch"), disk)
    }

    #[test]
    fn copies_used_longest_ago_go() {
        let folder = tempfile::tempdir().unwrap();
        let copies = copies(folder.path(), 0);
        let make = |name: &str, length: u64| {
            copies.make(name, length, |mut file| file.write_all(name.as_bytes())).map(drop)
        };
        make("first", MOST_BYTES / 2).unwrap();
        make("second", MOST_BYTES / 2).unwrap();
        let mut text = String::new();
        copies.open("first").unwrap().read_to_string(&mut text).unwrap();
        assert_eq!(text, "first");
        make("third", 1).unwrap();
        assert!(copies.open("second").is_none() && copies.open("first").is_some());
        copies.forget("first");
        assert!(copies.open("first").is_none());
        // Longer than all that is kept together: it is read once.
        make("longest", MOST_BYTES + 1).unwrap();
        assert!(copies.open("longest").is_none() && copies.open("third").is_none());
        let failed = copies.make("failed", 1, |_| Err(io::ErrorKind::TimedOut.into()));
        assert_eq!(failed.unwrap_err().kind(), io::ErrorKind::TimedOut);
        assert_eq!(fs::read_dir(folder.path().join("scratch")).unwrap().count(), 0);
    }

    #[test]
    fn a_copy_needs_room_on_the_disk() {
        let folder = tempfile::tempdir().unwrap();
        let copies = copies(folder.path(), u64::MAX);
        let refused = copies.make("first", 1, |_| Ok(())).unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::StorageFull);
    }
}
