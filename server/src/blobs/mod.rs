//! Blobs: files with a name that is given once and content that never changes, wherever they lie.
//!
//! A blob is staged first, as a file on a disk of this machine, and then published under its name, where it is seen
//! whole or not at all. [`Files`] keeps blobs in a folder of this service or in one that several share, [`Objects`]
//! in a bucket of S3. All pass the same tests (`conformance`).
//!
//! Every method blocks its thread: call them on one that may.

pub(crate) mod blocks;
#[cfg(test)]
mod conformance;
mod files;
mod objects;
pub(crate) mod owner;
mod place;
mod watched;

use std::fmt;
use std::fs::{self, File};
use std::io::{self, Read};
use std::ops::Range;
use std::path::PathBuf;
use std::time::{Duration, SystemTime};

pub(crate) use files::{Files, open_regular};
pub(crate) use objects::Objects;
pub(crate) use place::{OpenError, Place};
pub(crate) use watched::Watched;

use crate::disk::Space;

/// Name of the folder of results and exports.
pub(crate) const RESULTS: &str = "artifacts";
/// What the name of a blob that is being written ends with.
pub(crate) const PARTIAL: &str = crate::atomic_file::PARTIAL;

/// Where blobs are kept. Names are paths below its root, with `/` between folders.
pub(crate) trait Blobs: fmt::Debug + Send + Sync {
    /// Begins a blob: an empty file to write to, which goes if it is not published.
    ///
    /// # Errors
    /// The system's.
    fn stage(&self, name: &str) -> io::Result<Staged>;

    /// Gives what was staged its name, durably.
    ///
    /// # Errors
    /// [`io::ErrorKind::AlreadyExists`] where a blob has that name, which stays as it is;
    /// [`io::ErrorKind::ConnectionAborted`] where `is_stopped` said so before the end; else those of the storage.
    fn publish(&self, staged: Staged, name: &str, is_stopped: &dyn Fn() -> bool) -> io::Result<()>;

    /// The bytes of a blob as a file on this machine.
    ///
    /// # Errors
    /// [`io::ErrorKind::NotFound`], or those of the storage.
    fn fetch(&self, name: &str) -> io::Result<File>;

    /// Forgets what this process has kept of a blob, so that the next look is at the storage.
    fn forget(&self, _name: &str) {}

    /// Whether blobs lie on another machine, so that those that are sent as they lie are not copied here first.
    fn is_remote(&self) -> bool {
        false
    }

    /// A blob that is to be sent as it lies.
    ///
    /// # Errors
    /// [`io::ErrorKind::NotFound`], or those of the storage.
    fn open(&self, name: &str) -> io::Result<Box<dyn Blob>>;

    /// A URL at which a blob can be had without this service for so long. `None` where there is no such thing.
    ///
    /// # Errors
    /// Those of the storage.
    fn url(&self, _name: &str, _shown: &Shown<'_>, _valid: Duration) -> io::Result<Option<String>> {
        Ok(None)
    }

    /// Removes blobs. Missing ones are as good as removed.
    ///
    /// # Errors
    /// Those of the storage; some may have been removed then.
    fn remove(&self, names: &[String]) -> io::Result<()>;

    /// Removes all blobs in a folder and the folders below it.
    ///
    /// # Errors
    /// Those of the storage; some may have been removed then.
    fn remove_folder(&self, folder: &str) -> io::Result<()>;

    /// Removes the folders below a folder that hold nothing.
    ///
    /// # Errors
    /// Those of the storage; some may have been removed then.
    fn remove_empty_folders(&self, _folder: &str) -> io::Result<()> {
        Ok(())
    }

    /// Gives a blob another name. `false` where there is none of that name.
    ///
    /// # Errors
    /// Those of the storage.
    fn rename(&self, from: &str, to: &str) -> io::Result<bool>;

    /// All blobs in a folder and the folders below it, and what is staged there.
    ///
    /// # Errors
    /// Those of the storage.
    fn list(&self, folder: &str) -> io::Result<Vec<Listed>>;

    /// Whether other processes may have blobs here that are being written or wait for their row.
    fn is_shared(&self) -> bool;

    /// The time by the clock of the storage, to which the times of [`Listed`] compare.
    ///
    /// # Errors
    /// Those of the storage.
    fn now(&self) -> io::Result<SystemTime>;

    /// How a name is shown to the operator.
    fn shown(&self, name: &str) -> String;

    /// The size of the file system that they lie in, where there is one.
    ///
    /// # Errors
    /// Those of the storage.
    fn space(&self) -> io::Result<Option<Space>> {
        Ok(None)
    }

    /// Makes sure that no folder of it was moved away.
    ///
    /// # Errors
    /// One was, or those of the storage.
    fn check(&self) -> io::Result<()> {
        Ok(())
    }

    /// Looks whether the storage answers and is still the same, where that may change.
    fn look(&self) {}

    /// What is wrong with the storage, by the last look.
    fn trouble(&self) -> Option<String> {
        None
    }
}

/// A blob that is being sent.
pub(crate) trait Blob: fmt::Debug + Send {
    /// Its length in bytes.
    ///
    /// # Errors
    /// Those of the storage.
    fn length(&self) -> io::Result<u64>;

    /// Starts to read a part. An error that can be told before the first byte is told here.
    ///
    /// # Errors
    /// Those of the storage.
    fn read(self: Box<Self>, range: Range<u64>) -> io::Result<Box<dyn Read + Send>>;
}

/// How a client that gets a blob from the storage is to see it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shown<'a> {
    /// `Content-Type`.
    pub(crate) content_type: &'a str,
    /// `Content-Disposition`.
    pub(crate) disposition: &'a str,
}

/// A blob, or what is staged, as a listing shows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Listed {
    /// Its name.
    pub(crate) name: String,
    /// When it was last written, by the clock of the storage; not told where all is this process's.
    pub(crate) written: Option<SystemTime>,
}

/// A file that is being written and has no name yet. Dropped, it goes.
#[derive(Debug)]
pub(crate) struct Staged {
    file: File,
    /// Taken when it has got its name.
    path: Option<PathBuf>,
}

impl Staged {
    /// Begins a file that must not exist.
    fn create(path: PathBuf) -> io::Result<Self> {
        let file = File::options().read(true).write(true).create_new(true).open(&path)?;
        Ok(Self { file, path: Some(path) })
    }

    /// What is written to.
    pub(crate) fn file(&self) -> &File {
        &self.file
    }
}

impl Drop for Staged {
    fn drop(&mut self) {
        if let Some(path) = &self.path {
            // The space of what a full disk cut off is given back; what cannot be removed is left to the sweeper.
            let _ = fs::remove_file(path);
        }
    }
}
