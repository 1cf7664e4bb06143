//! A file of settings that is read again when it has changed, without a restart.
//!
//! A file that is being written, or that a full disk cut off, must not be believed: the last line of a file of settings
//! ends with a line break, so that a file that is cut within a line is told from a whole one. A file that cannot be
//! used leaves the settings as they were.
//!
//! The content itself is compared, not the time and the length of the file: both may stay the same when it changes.
//! Who needs the settings takes them from memory ([`WatchedFile::current`]); one task reads the file
//! ([`WatchedFile::look`]), so that a disk that does not answer holds up that task and no request.

use std::fs::{File, OpenOptions};
use std::io::{self, Read as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::{Duration, Instant};

use rustix::fs::OFlags;
use sha2::{Digest as _, Sha256};

/// Longest file of settings: a hundred thousand keys.
const MOST_BYTES: u64 = 16 << 20;
/// A look that takes longer is a fault of the disk.
const LOOK_WITHIN: Duration = Duration::from_secs(10);

/// Why the text of a file of settings cannot be used, as the end of a sentence that names the file.
#[derive(Debug, thiserror::Error)]
pub(crate) enum TextError {
    /// It cannot be read.
    #[error("cannot be read: {0}")]
    Unreadable(#[from] io::Error),
    /// It is a folder, a pipe or a device.
    #[error("is not a regular file")]
    Irregular,
    /// It is no settings.
    #[error("is longer than {MOST_BYTES} bytes")]
    TooLong,
    /// It is in another encoding.
    #[error("is not UTF-8")]
    Encoding,
    /// Its last line is incomplete.
    #[error(
        "ends within line {0}, which has no line break: the file is being written, or was cut off. Check the line, and \
         end it with a line break"
    )]
    NoEnd(usize),
}

/// The text of a file of settings, without a byte order mark, as editors of some systems write one.
///
/// # Errors
/// See [`TextError`].
pub(crate) fn text_of(path: &Path) -> Result<String, TextError> {
    checked(read(path)?)
}

fn read(path: &Path) -> Result<Vec<u8>, TextError> {
    read_all(File::open(path)?)
}

/// Reads a regular file; does not wait for the writer of a pipe.
fn read_regular(path: &Path) -> Result<Vec<u8>, TextError> {
    let flags = OFlags::NONBLOCK.bits().cast_signed();
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path)?;
    if file.metadata()?.is_file() { read_all(file) } else { Err(TextError::Irregular) }
}

fn read_all(file: File) -> Result<Vec<u8>, TextError> {
    let mut bytes = Vec::new();
    file.take(MOST_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MOST_BYTES { Err(TextError::TooLong) } else { Ok(bytes) }
}

fn checked(bytes: Vec<u8>) -> Result<String, TextError> {
    let text = String::from_utf8(bytes).map_err(|_| TextError::Encoding)?;
    if !text.is_empty() && !text.ends_with('\n') {
        return Err(TextError::NoEnd(text.lines().count()));
    }
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

/// What a file says, as of its last change that could be used.
#[derive(Debug)]
pub(crate) struct WatchedFile<T> {
    path: PathBuf,
    /// Whether it was a pipe at the start, which can be read once.
    is_pipe: bool,
    state: Mutex<State<T>>,
    /// Held by the look that is under way.
    look: Mutex<()>,
}

#[derive(Debug)]
struct State<T> {
    content: Arc<T>,
    /// What the last look saw, usable or not.
    seen: Seen,
    /// Why the file as it is now is not used.
    fault: Option<String>,
    /// When the look began that has not ended yet.
    looking: Option<Instant>,
}

/// What a look at the file saw: the digest of its content, or why it could not be read.
#[derive(Debug, PartialEq, Eq)]
enum Seen {
    Content([u8; 32]),
    Unread(String),
}

impl Seen {
    fn of(read: &Result<Vec<u8>, TextError>) -> Self {
        match read {
            Ok(bytes) => Self::Content(Sha256::digest(bytes).into()),
            Err(error) => Self::Unread(error.to_string()),
        }
    }
}

impl<T> WatchedFile<T> {
    /// Reads the file for the first time.
    ///
    /// # Errors
    /// Those of the text, and those of `parse`.
    pub(crate) fn open<E>(
        path: PathBuf,
        parse: impl FnOnce(&Path, Result<String, TextError>) -> Result<T, E>,
    ) -> Result<Self, E> {
        let is_pipe = std::fs::metadata(&path).is_ok_and(|found| !found.is_file() && !found.is_dir());
        let read = read(&path);
        let seen = Seen::of(&read);
        let content = Arc::new(parse(&path, read.and_then(checked))?);
        let state = State { content, seen, fault: None, looking: None };
        Ok(Self { path, is_pipe, state: Mutex::new(state), look: Mutex::default() })
    }

    /// What the file said when it was read last and could be used.
    pub(crate) fn current(&self) -> Arc<T> {
        Arc::clone(&self.state().content)
    }

    /// Reads the file again. Where it is not as the last look saw it, `parse` says what it means: the new settings,
    /// with those before, or why it cannot be used; the settings stay as they were then. A pipe and the like are read
    /// once, by [`Self::open`]. Returns at once while another look is under way. Blocks the thread.
    pub(crate) fn look<E: std::fmt::Display>(
        &self,
        parse: impl FnOnce(&Path, Result<String, TextError>) -> Result<T, E>,
    ) -> Option<Result<Change<T>, E>> {
        let _under_way = match self.look.try_lock() {
            Ok(guard) => guard,
            Err(TryLockError::Poisoned(guard)) => guard.into_inner(),
            Err(TryLockError::WouldBlock) => return None,
        };
        self.state().looking = Some(Instant::now());
        let read = if self.is_pipe { None } else { Some(read_regular(&self.path)) };
        let mut state = self.state();
        state.looking = None;
        let read = read?;
        let seen = Seen::of(&read);
        if seen == state.seen {
            return None;
        }
        state.seen = seen;
        Some(match parse(&self.path, read.and_then(checked)) {
            Ok(content) => {
                state.fault = None;
                let now = Arc::new(content);
                let before = std::mem::replace(&mut state.content, Arc::clone(&now));
                Ok(Change { before, now })
            }
            Err(error) => {
                state.fault = Some(error.to_string());
                Err(error)
            }
        })
    }

    /// Whether the settings in force are not those of the file as it is now, because it cannot be used or read.
    pub(crate) fn is_faulty(&self) -> bool {
        let state = self.state();
        state.fault.is_some() || state.looking.is_some_and(|since| since.elapsed() > LOOK_WITHIN)
    }

    fn state(&self) -> MutexGuard<'_, State<T>> {
        // One who panicked cannot have left it half-changed.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Settings that have changed.
#[derive(Debug)]
pub(crate) struct Change<T> {
    pub(crate) before: Arc<T>,
    pub(crate) now: Arc<T>,
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::fs::FileTimes;
    use std::time::SystemTime;

    use super::*;

    fn parse(_: &Path, text: Result<String, TextError>) -> Result<String, TextError> {
        let text = text?;
        if text.contains("bad") { Err(TextError::TooLong) } else { Ok(text) }
    }

    #[test]
    fn a_change_is_read_once_and_a_file_that_cannot_be_used_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("settings");
        std::fs::write(&path, "\u{feff}one\n").unwrap();
        let watched = WatchedFile::open(path.clone(), parse).unwrap();
        assert_eq!(*watched.current(), "one\n");
        assert!(watched.look(parse).is_none(), "nothing has changed");
        std::fs::write(&path, "three\n").unwrap();
        let Change { before, now } = watched.look(parse).unwrap().unwrap();
        assert_eq!((before.as_str(), now.as_str()), ("one\n", "three\n"));
        for unusable in ["bad\n", "four", "f\u{0}", "\u{feff}"] {
            std::fs::write(&path, unusable).unwrap();
            assert!(watched.look(parse).unwrap().is_err(), "{unusable:?}");
            assert!(watched.look(parse).is_none(), "it was read already");
            assert!(watched.is_faulty() && *watched.current() == "three\n");
        }
        std::fs::write(&path, [b'f', 0xff, b'\n']).unwrap();
        assert!(watched.look(parse).unwrap().is_err());
        std::fs::remove_file(&path).unwrap();
        assert!(watched.look(parse).unwrap().is_err() && *watched.current() == "three\n");
        // A pipe that nobody writes, a device without end and a folder in its place.
        rustix::fs::mknodat(rustix::fs::CWD, &path, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
        assert!(watched.look(parse).unwrap().unwrap_err().to_string().contains("regular"));
        std::fs::remove_file(&path).unwrap();
        std::os::unix::fs::symlink("/dev/zero", &path).unwrap();
        assert!(watched.look(parse).is_none() && watched.is_faulty(), "it is the same fault");
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(&path).unwrap();
        assert!(watched.look(parse).is_none() && watched.is_faulty());
        std::fs::remove_dir(&path).unwrap();
        std::fs::write(&path, "three\n").unwrap();
        assert!(watched.look(parse).unwrap().is_ok() && !watched.is_faulty());
        assert!(WatchedFile::open(folder.path().join("none"), parse).is_err());
    }

    #[test]
    fn a_change_that_keeps_time_and_length_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("settings");
        let time = FileTimes::new().set_modified(SystemTime::UNIX_EPOCH + Duration::from_hours(400_000));
        let write = |text: &str| {
            let mut file = File::create(&path).unwrap();
            io::Write::write_all(&mut file, text.as_bytes()).unwrap();
            file.set_times(time).unwrap();
        };
        write("one\n");
        let watched = WatchedFile::open(path.clone(), parse).unwrap();
        write("two\n");
        assert_eq!(*watched.look(parse).unwrap().unwrap().now, "two\n");
    }
}
