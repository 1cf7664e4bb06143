//! Adding a line to the file of keys while a service may read it.
//!
//! The file is replaced by a whole one (`rename`), so that no reader sees a part of a line. Two commands at once take
//! turns: each locks the file and makes sure, once it holds the lock, that the file still has its name.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Write as _};
use std::os::unix::fs::{MetadataExt as _, fchown};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::ApiKeys;
use crate::atomic_file;
use crate::watched_file::{TextError, text_of};

/// Longest time to wait for another command that adds a line.
const LOCK_WITHIN: Duration = Duration::from_secs(30);
/// Pause before the lock is tried again.
const TRY_AGAIN: Duration = Duration::from_millis(20);

/// Why a line was not added. The file is as it was.
#[derive(Debug, thiserror::Error)]
pub(crate) enum AddError {
    /// The file is not one that a service would read.
    #[error("{0} {1}")]
    Text(PathBuf, TextError),
    /// The file, or the file with the new line, has a fault.
    #[error("{0}, line {1}: {2}")]
    BadLine(PathBuf, usize, String),
    /// Another process holds the lock.
    #[error("{0} is locked by another process for more than {1:?}")]
    Locked(PathBuf, Duration),
    /// The owner of the file would change.
    #[error("{0} belongs to user {1} and group {2}, which this user cannot give to the new file: {3}")]
    Owner(PathBuf, u32, u32, io::Error),
    /// The system refused something.
    #[error("{0} cannot be written: {1}")]
    Unwritten(PathBuf, io::Error),
    /// What was to be done before the file is replaced failed.
    #[error(transparent)]
    Before(io::Error),
    /// The system refused something of the replacement.
    #[error(transparent)]
    Replacement(#[from] io::Error),
}

/// Adds a line to the file of keys, and makes the file where there is none. Its mode and its owner stay. `before` runs
/// once everything is written and the file is about to be replaced; its failure leaves the file as it was.
///
/// # Errors
/// See [`AddError`]. The line is checked with the file as a whole: a name that is taken is refused.
pub(crate) fn add_line(
    file: &Path,
    line: &str,
    before: impl FnOnce() -> io::Result<()>,
) -> Result<(), AddError> {
    // A link stays a link: what it leads to is replaced.
    let path = &file.canonicalize().unwrap_or_else(|_| file.to_owned());
    let unwritten = |error| AddError::Unwritten(file.to_owned(), error);
    let locked = lock(path, file)?;
    let mut text = text_of(path).map_err(|error| AddError::Text(file.to_owned(), error))?;
    let bad_line = |(line, fault)| AddError::BadLine(file.to_owned(), line, fault);
    ApiKeys::read(&text).map_err(bad_line)?;
    text.push_str(line);
    text.push('\n');
    ApiKeys::read(&text).map_err(bad_line)?;
    let found = locked.metadata().map_err(unwritten)?;
    let write = |mut new: &File| {
        let made = new.metadata().map_err(unwritten)?;
        if (made.uid(), made.gid()) != (found.uid(), found.gid()) {
            fchown(new, Some(found.uid()), Some(found.gid()))
                .map_err(|error| AddError::Owner(file.to_owned(), found.uid(), found.gid(), error))?;
        }
        new.set_permissions(found.permissions()).map_err(unwritten)?;
        new.write_all(text.as_bytes()).map_err(unwritten)
    };
    atomic_file::write(path, write, || before().map_err(AddError::Before)).map_err(|error| match error {
        AddError::Replacement(error) => unwritten(error),
        error => error,
    })
}

/// Locks the file under this name, which is made where it is missing.
fn lock(path: &Path, shown: &Path) -> Result<File, AddError> {
    let unwritten = |error| AddError::Unwritten(shown.to_owned(), error);
    let begin = Instant::now();
    loop {
        let file = OpenOptions::new().read(true).append(true).create(true).open(path).map_err(unwritten)?;
        // A device must not be replaced, and a pipe has no end.
        if !file.metadata().map_err(unwritten)?.is_file() {
            return Err(AddError::Text(shown.to_owned(), TextError::Irregular));
        }
        match file.try_lock() {
            Ok(()) => {
                let identity = |found: std::fs::Metadata| (found.dev(), found.ino());
                let (own, named) = (file.metadata().map_err(unwritten)?, std::fs::metadata(path));
                if named.is_ok_and(|named| identity(named) == identity(own)) {
                    return Ok(file);
                }
                // Another command has replaced it meanwhile.
            }
            Err(TryLockError::WouldBlock) if begin.elapsed() < LOCK_WITHIN => std::thread::sleep(TRY_AGAIN),
            Err(TryLockError::WouldBlock) => return Err(AddError::Locked(shown.to_owned(), LOCK_WITHIN)),
            Err(TryLockError::Error(error)) => return Err(unwritten(error)),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::super::generate;
    use super::*;

    fn line(name: &str) -> String {
        generate(name, &["role=read".into()]).1
    }

    #[test]
    fn a_line_is_added_to_a_whole_file_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        let read = || std::fs::read_to_string(&path).unwrap();
        let (anna, bert) = (line("anna"), line("bert"));
        add_line(&path, &anna, || Ok(())).unwrap();
        std::fs::set_permissions(&path, PermissionsExt::from_mode(0o640)).unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&path, &link).unwrap();
        add_line(&link, &bert, || Ok(())).unwrap();
        let both = format!("{anna}\n{bert}\n");
        assert_eq!(read(), both);
        assert_eq!(std::fs::metadata(&path).unwrap().mode() & 0o777, 0o640);
        assert!(link.is_symlink());
        let taken = add_line(&path, &line("anna"), || Ok(())).unwrap_err().to_string();
        assert!(taken.contains("line 3") && taken.contains("\"anna\""), "{taken}");
        let unread = add_line(&path, &line("carl"), || Err(io::ErrorKind::BrokenPipe.into()));
        assert!(unread.is_err() && read() == both);
        let pipe = folder.path().join("pipe");
        rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
        let refused = add_line(&pipe, &line("carl"), || Ok(())).unwrap_err().to_string();
        assert!(refused.contains("is not a regular file"), "{refused}");
        std::fs::remove_file(&pipe).unwrap();
        std::fs::write(&path, &anna).unwrap();
        let cut = add_line(&path, &line("carl"), || Ok(())).unwrap_err().to_string();
        assert!(cut.contains("has no line break"), "{cut}");
        assert_eq!(read(), anna);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no partial file is left");
    }

    #[test]
    fn lines_that_are_added_at_once_are_all_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        std::thread::scope(|scope| {
            for i in 0..16 {
                let path = &path;
                scope.spawn(move || add_line(path, &line(&format!("key {i}")), || Ok(())).unwrap());
            }
        });
        assert_eq!(std::fs::read_to_string(&path).unwrap().lines().count(), 16);
    }
}
