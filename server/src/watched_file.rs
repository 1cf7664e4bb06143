//! A file of settings that is read again when it has changed, without a restart.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

/// What a file says, as of its last change that could be read.
#[derive(Debug)]
pub(crate) struct WatchedFile<T> {
    path: PathBuf,
    /// Time between two looks at the file.
    look_every: Duration,
    state: Mutex<State<T>>,
}

#[derive(Debug)]
struct State<T> {
    content: Arc<T>,
    stamp: Option<Stamp>,
    looked: Instant,
}

/// Time of change and length of the file that was read last.
type Stamp = (SystemTime, u64);

impl<T> WatchedFile<T> {
    /// Reads the file for the first time.
    ///
    /// # Errors
    /// Those of `read`.
    pub(crate) fn open<E>(
        path: PathBuf,
        look_every: Duration,
        read: impl FnOnce(&Path) -> Result<T, E>,
    ) -> Result<Self, E> {
        // A change between the two is seen at the next look.
        let stamp = stamp(&path);
        let content = Arc::new(read(&path)?);
        Ok(Self { path, look_every, state: Mutex::new(State { content, stamp, looked: Instant::now() }) })
    }

    /// What the file says, as of at most the time between two looks ago. Where it has changed, `read` tells what it
    /// says now; without an answer, all stays as it was until the next change.
    pub(crate) fn current(&self, read: impl FnOnce(&Path) -> Option<T>) -> Arc<T> {
        // One who panicked cannot have left it half-changed.
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if state.looked.elapsed() >= self.look_every {
            state.looked = Instant::now();
            let stamp = stamp(&self.path);
            if stamp != state.stamp {
                state.stamp = stamp;
                if let Some(content) = read(&self.path) {
                    state.content = Arc::new(content);
                }
            }
        }
        Arc::clone(&state.content)
    }
}

fn stamp(path: &Path) -> Option<Stamp> {
    let metadata = std::fs::metadata(path).ok()?;
    Some((metadata.modified().ok()?, metadata.len()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_change_is_read_once_and_one_that_says_nothing_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("settings");
        std::fs::write(&path, "one").unwrap();
        let read = |path: &Path| std::fs::read_to_string(path);
        let watched = WatchedFile::open(path.clone(), Duration::ZERO, read).unwrap();
        assert_eq!(*watched.current(|_| panic!("nothing has changed")), "one");
        std::fs::write(&path, "three").unwrap();
        assert_eq!(*watched.current(|path| read(path).ok()), "three");
        std::fs::write(&path, "").unwrap();
        assert_eq!(*watched.current(|_| None), "three");
        assert_eq!(*watched.current(|_| panic!("it was read already")), "three");
        let rare = WatchedFile::open(path.clone(), Duration::from_hours(1), read).unwrap();
        std::fs::write(&path, "two").unwrap();
        assert_eq!(*rare.current(|_| panic!("too soon")), "");
        assert!(WatchedFile::open(folder.path().join("none"), Duration::ZERO, read).is_err());
    }
}
