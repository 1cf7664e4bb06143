//! Space on the file system of the data directory: how much is free, how much must stay free, and a reserve for the
//! transactions that free some.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use rustix::fs::{FallocateFlags, fallocate, statvfs};

/// Free space that is kept by default, unless the file system is small.
const DEFAULT_MIN_FREE_BYTES: u64 = 1 << 30;
/// Share of a small file system that is kept free by default.
const DEFAULT_MIN_FREE_SHARE: f64 = 0.05;
/// Length of the reserve, unless the file system is small.
const RESERVE_BYTES: u64 = 4 << 20;
/// Least length of the reserve: the write-ahead log of a deletion is some hundred kilobytes.
const LEAST_RESERVE_BYTES: u64 = 256 << 10;
/// Name of the file by which the end of a shortage is found out, in the data directory.
const TRIAL: &str = "trial";
/// Share of a small file system that the reserve takes.
const RESERVE_SHARE: f64 = 0.02;

/// Whether an I/O error says that no space is left, or none within the user's quota.
pub(crate) fn is_full(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge
    )
}

/// Whether an error of reading a file is one of the machine at this moment, and says nothing about the file: no
/// descriptors, no memory, a failing disk.
pub(crate) fn is_passing(error: &io::Error) -> bool {
    !matches!(
        error.kind(),
        io::ErrorKind::NotFound
            | io::ErrorKind::InvalidData
            | io::ErrorKind::UnexpectedEof
            | io::ErrorKind::InvalidInput
    )
}

/// Whether a write failed for want of space and none has succeeded since. Clones share it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shortage(Arc<AtomicBool>);

impl Shortage {
    /// Notes a write that failed for want of space.
    pub(crate) fn note(&self) {
        self.0.store(true, Ordering::Release);
    }

    /// Whether such a failure was noted and no trial has succeeded since.
    pub(crate) fn is_noted(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }

    fn clear(&self) {
        self.0.store(false, Ordering::Release);
    }
}

/// Size of a file system, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Space {
    /// What this process may still write.
    pub(crate) free: u64,
    /// All of it.
    pub(crate) total: u64,
}

impl Space {
    /// That of the file system of a folder.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn of(folder: &Path) -> io::Result<Self> {
        let found = statvfs(folder)?;
        Ok(Self {
            free: found.f_bavail.saturating_mul(found.f_frsize),
            total: found.f_blocks.saturating_mul(found.f_frsize),
        })
    }
}

/// The file system of another machine as it was last seen: nobody waits for its answer. Clones share it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Elsewhere(Arc<Mutex<Option<Space>>>);

impl Elsewhere {
    /// Keeps what was seen.
    pub(crate) fn set(&self, space: Option<Space>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = space;
    }

    fn get(&self) -> Option<Space> {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The file system of the data directory.
#[derive(Clone, Debug)]
pub(crate) struct Disk {
    root: PathBuf,
    /// The file system of another folder that files are written to.
    files: Elsewhere,
    min_free_bytes: Option<u64>,
    shortage: Shortage,
}

impl Disk {
    /// The file system below `root`, of which `min_free_bytes` stay free; by default 1 GiB, at most 5 %. Failures for
    /// want of space are noted in `shortage`.
    pub(crate) fn new(root: PathBuf, min_free_bytes: Option<u64>, shortage: Shortage) -> Self {
        Self { root, files: Elsewhere::default(), min_free_bytes, shortage }
    }

    /// The same, where results and exports are written to this folder, whose file system bounds them too.
    pub(crate) fn with_files_in(self, files: Elsewhere) -> Self {
        Self { files, ..self }
    }

    /// Notes a write that failed, if it failed for want of space.
    pub(crate) fn note_failure(&self, error: &io::Error) {
        if is_full(error) {
            self.shortage.note();
        }
    }

    /// Whether writes fail for want of space. After a failure this writes a trial file of 256 KiB, which is what a
    /// transaction may need; a trial that succeeds ends the shortage. Blocks the thread.
    pub(crate) fn is_short(&self) -> bool {
        if !self.shortage.is_noted() {
            return false;
        }
        let file = self.root.join(TRIAL);
        let tried = write_zeros(&file, LEAST_RESERVE_BYTES);
        if let Err(error) = std::fs::remove_file(&file)
            && error.kind() != io::ErrorKind::NotFound
        {
            tracing::warn!(%error, "the trial file could not be removed");
        }
        match tried {
            Ok(()) => {
                tracing::info!("there is space on the disk again");
                self.shortage.clear();
                false
            }
            Err(error) => {
                tracing::warn!(%error, "the disk is still full");
                true
            }
        }
    }

    /// How large it is and how much of it is free.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn space(&self) -> io::Result<Space> {
        Space::of(&self.root)
    }

    /// Bytes that must stay free.
    pub(crate) fn min_free_bytes(&self, space: Space) -> u64 {
        let share = (space.total as f64 * DEFAULT_MIN_FREE_SHARE) as u64;
        self.min_free_bytes.unwrap_or_else(|| DEFAULT_MIN_FREE_BYTES.min(share))
    }

    /// Bytes that may be written before less is free than must stay free. As much as there can be where the system does
    /// not say: a write that fails is handled too.
    pub(crate) fn room(&self) -> u64 {
        let left = |space: Space| space.free.saturating_sub(self.min_free_bytes(space));
        let spaces = Space::of(&self.root).ok().into_iter().chain(self.files.get());
        spaces.map(left).min().unwrap_or(u64::MAX)
    }
}

/// Writes a file of zeros, down to the disk.
fn write_zeros(file: &Path, bytes: u64) -> io::Result<()> {
    let file = File::create(file)?;
    io::copy(&mut io::Read::take(io::repeat(0), bytes), &mut &file)?;
    file.sync_all()
}

/// A file that takes space until a transaction needs it to free more.
#[derive(Clone, Debug)]
pub(crate) struct Reserve {
    file: PathBuf,
    held: Arc<AtomicBool>,
}

impl Reserve {
    /// The reserve at this place, made where there is space for it.
    pub(crate) fn open(file: PathBuf) -> Self {
        let reserve = Self { file, held: Arc::default() };
        reserve.refill();
        reserve
    }

    /// Gives the space back to the file system; `false` where it has been given already.
    pub(crate) fn release(&self) -> bool {
        if !self.held.swap(false, Ordering::AcqRel) {
            return false;
        }
        match std::fs::remove_file(&self.file) {
            Ok(()) => {
                tracing::warn!("the disk is full: the reserve is released for a deletion");
                true
            }
            Err(error) => {
                tracing::warn!(%error, "the reserve could not be released");
                false
            }
        }
    }

    /// Whether the space is held.
    pub(crate) fn is_held(&self) -> bool {
        self.held.load(Ordering::Acquire)
    }

    /// Takes the space again where there is twice as much of it.
    pub(crate) fn refill(&self) {
        if self.is_held() {
            return;
        }
        match self.allocate() {
            Ok(held) => self.held.store(held, Ordering::Release),
            Err(error) => {
                let _ = std::fs::remove_file(&self.file);
                if !is_full(&error) {
                    tracing::warn!(%error, "no reserve of disk space could be made");
                }
            }
        }
    }

    fn allocate(&self) -> io::Result<bool> {
        let folder = self.file.parent().unwrap_or(Path::new("."));
        let space = Space::of(folder)?;
        let bytes = RESERVE_BYTES.min((space.total as f64 * RESERVE_SHARE) as u64).max(LEAST_RESERVE_BYTES);
        if std::fs::metadata(&self.file).is_ok_and(|found| found.len() >= bytes) {
            return Ok(true);
        }
        if space.free < 2 * bytes {
            return Ok(false);
        }
        let file = File::create(&self.file)?;
        if fallocate(&file, FallocateFlags::empty(), 0, bytes).is_err() {
            // Not every file system can allocate without writing.
            io::copy(&mut io::Read::take(io::repeat(0), bytes), &mut &file)?;
        }
        file.sync_all()?;
        Ok(true)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn what_must_stay_free_is_a_gibibyte_or_a_twentieth() {
        let disk = |min| Disk::new(PathBuf::from("/"), min, Shortage::default());
        let of = |total| Space { free: 0, total };
        assert_eq!(disk(None).min_free_bytes(of(1 << 40)), 1 << 30);
        assert_eq!(disk(None).min_free_bytes(of(20_000_000)), 1_000_000);
        assert_eq!(disk(Some(7)).min_free_bytes(of(1 << 40)), 7);
    }

    #[test]
    fn a_shortage_ends_with_a_write_that_succeeds() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("data");
        let disk = Disk::new(data.clone(), Some(0), Shortage::default());
        disk.note_failure(&io::ErrorKind::PermissionDenied.into());
        assert!(!disk.is_short(), "another failure is no shortage");
        disk.note_failure(&io::ErrorKind::StorageFull.into());
        // The folder is missing: no write can succeed.
        assert!(disk.is_short() && disk.is_short());
        std::fs::create_dir(&data).unwrap();
        assert!(!disk.is_short() && !disk.is_short());
        assert_eq!(std::fs::read_dir(&data).unwrap().count(), 0, "the trial file is removed");
    }

    #[test]
    fn a_reserve_is_released_once_and_refilled() {
        let folder = tempfile::tempdir().unwrap();
        let reserve = Reserve::open(folder.path().join("reserve"));
        assert!(reserve.is_held() && folder.path().join("reserve").exists());
        assert!(reserve.release() && !reserve.release());
        assert!(!folder.path().join("reserve").exists());
        reserve.refill();
        assert!(reserve.release(), "it was held again");
    }
}
