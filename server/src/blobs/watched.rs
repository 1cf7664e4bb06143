//! Blobs on another machine, whose storage may stop answering: no thread of the service waits for it without end.
//!
//! Each call runs on one of a few threads of its own, and its caller waits for a bounded time. Besides, the mark of the
//! place ([`owner`]) is read every two seconds: it says whether the storage answers, and whether it is still the place
//! of this database and not, for example, the empty folder below a file system that is not mounted. Where it is not,
//! the service is not ready, and calls are refused at once.

use std::collections::VecDeque;
use std::fmt;
use std::fs::File;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

use super::owner::{self, Owner};
use super::{Blob, Blobs, Listed, Shown, Staged};
use crate::disk::{Elsewhere, Space, is_passing};

/// Most threads that call the storage.
const MOST_THREADS: usize = 32;
/// Most calls that run or wait for a thread.
const MOST_CALLS: usize = 128;
/// A thread without work ends after this time.
const IDLE: Duration = Duration::from_secs(10);
/// Time for a call that moves no bytes. A bucket is asked several times within it.
const CALL: Duration = Duration::from_secs(90);
/// Time for a call about many blobs.
const LONG_CALL: Duration = Duration::from_mins(10);
/// Bytes that a storage takes in a second at least.
const LEAST_SPEED: u64 = 256 << 10;
/// Time for a look at the mark.
const LOOK: Duration = Duration::from_secs(5);
/// Time between two looks whether a call is to stop.
const STOP_EVERY: Duration = Duration::from_millis(100);

type Work = Box<dyn FnOnce() + Send>;

/// Blobs that are watched.
pub(crate) struct Watched {
    inner: Arc<dyn Blobs>,
    owner: Owner,
    threads: Arc<Threads>,
    trouble: Mutex<Option<String>>,
    /// When the storage answered last.
    answered: Mutex<Instant>,
    space: Elsewhere,
}

impl fmt::Debug for Watched {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Watched").field("inner", &self.inner).finish_non_exhaustive()
    }
}

impl Watched {
    /// Watches a place of that database, and keeps its free space in `space`.
    pub(crate) fn new(inner: Arc<dyn Blobs>, owner: Owner, space: Elsewhere) -> Self {
        let answered = Mutex::new(Instant::now());
        Self { inner, owner, threads: Arc::default(), trouble: Mutex::default(), answered, space }
    }

    /// Runs a call on a thread of its own, unless the storage is in trouble.
    fn call<T: Send + 'static>(
        &self,
        longest: Duration,
        work: impl FnOnce(&dyn Blobs) -> io::Result<T> + Send + 'static,
    ) -> io::Result<T> {
        self.call_until(longest, &|| false, |blobs, _| work(blobs))
    }

    fn call_until<T: Send + 'static>(
        &self,
        longest: Duration,
        is_stopped: &dyn Fn() -> bool,
        work: impl FnOnce(&dyn Blobs, &AtomicBool) -> io::Result<T> + Send + 'static,
    ) -> io::Result<T> {
        if let Some(trouble) = self.trouble() {
            return Err(io::Error::new(io::ErrorKind::TimedOut, trouble));
        }
        self.run(longest, is_stopped, work)
    }

    fn run<T: Send + 'static>(
        &self,
        longest: Duration,
        is_stopped: &dyn Fn() -> bool,
        work: impl FnOnce(&dyn Blobs, &AtomicBool) -> io::Result<T> + Send + 'static,
    ) -> io::Result<T> {
        let (sender, receiver) = sync_channel(1);
        let inner = Arc::clone(&self.inner);
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let runs = self.threads.run(Box::new(move || {
            // Its caller may have given up.
            let _ = sender.send(work(&*inner, &stopped));
        }));
        if !runs {
            return Err(self.late("has so many calls to answer that no other is made"));
        }
        let end = Instant::now() + longest;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            match receiver.recv_timeout(left.min(STOP_EVERY)) {
                Ok(ended) => {
                    if ended.as_ref().map_or_else(|error| !is_passing(error), |_| true) {
                        *self.answered.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
                    }
                    return ended;
                }
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(io::Error::other("a call to the storage ended by a defect"));
                }
                Err(RecvTimeoutError::Timeout) if left.is_zero() => {
                    stop.store(true, Ordering::Release);
                    return Err(self.late(&format!("has not answered within {} s", longest.as_secs())));
                }
                Err(RecvTimeoutError::Timeout) if is_stopped() => stop.store(true, Ordering::Release),
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    fn late(&self, what: &str) -> io::Error {
        let text = format!("the place of files {} {what}", self.inner.shown("").trim_end_matches('/'));
        io::Error::new(io::ErrorKind::TimedOut, text)
    }

    /// What is wrong with the place, if anything.
    fn look_at_mark(&self) -> Option<String> {
        let begun = Instant::now();
        let place = self.inner.shown("").trim_end_matches('/').to_owned();
        let seen = self.run(LOOK, &|| false, |blobs, _| {
            let owner = owner::read(blobs)?;
            blobs.check()?;
            Ok((owner, blobs.space()?))
        });
        match seen {
            Ok((theirs, space)) if theirs.database == self.owner.database => {
                self.space.set(space);
                None
            }
            Ok((theirs, _)) => {
                Some(format!("the place of files {place} belongs to the database {theirs} now"))
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => Some(format!(
                "the place of files {place} has no {} any more: it is another one, or its file system is not mounted",
                owner::MARK
            )),
            // The storage has answered another call meanwhile: what kept this one is over.
            Err(_) if *self.answered.lock().unwrap_or_else(PoisonError::into_inner) > begun => None,
            Err(error) if error.kind() == io::ErrorKind::TimedOut => Some(error.to_string()),
            Err(error) => Some(format!("the place of files {place} cannot be read: {error}")),
        }
    }

    fn noted(&self) -> MutexGuard<'_, Option<String>> {
        self.trouble.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Blobs for Watched {
    fn stage(&self, name: &str) -> io::Result<Staged> {
        let name = name.to_owned();
        self.call(CALL, move |blobs| blobs.stage(&name))
    }

    fn publish(&self, staged: Staged, name: &str, is_stopped: &dyn Fn() -> bool) -> io::Result<()> {
        let bytes = staged.file().metadata()?.len();
        let longest = CALL + Duration::from_secs(bytes / LEAST_SPEED);
        let (name, owner) = (name.to_owned(), self.owner.clone());
        self.call_until(longest, is_stopped, move |blobs, stop| {
            blobs.publish(staged, &name, &|| stop.load(Ordering::Acquire))?;
            // In another folder of the same name, the file would go with that folder.
            check_place(blobs, &owner)
        })
    }

    fn fetch(&self, name: &str) -> io::Result<File> {
        let name = name.to_owned();
        // A bucket hands out a copy, for whose bytes it has its own bounds.
        let longest = if self.inner.is_remote() { LONG_CALL } else { CALL };
        self.call(longest, move |blobs| blobs.fetch(&name))
    }

    fn forget(&self, name: &str) {
        self.inner.forget(name);
    }

    fn is_remote(&self) -> bool {
        self.inner.is_remote()
    }

    fn open(&self, name: &str) -> io::Result<Box<dyn Blob>> {
        let name = name.to_owned();
        self.call(CALL, move |blobs| blobs.open(&name))
    }

    fn url(&self, name: &str, shown: &Shown<'_>, valid: Duration) -> io::Result<Option<String>> {
        let name = name.to_owned();
        let (content_type, disposition) = (shown.content_type.to_owned(), shown.disposition.to_owned());
        self.call(CALL, move |blobs| {
            let shown = Shown { content_type: &content_type, disposition: &disposition };
            blobs.url(&name, &shown, valid)
        })
    }

    fn remove(&self, names: &[String]) -> io::Result<()> {
        let (names, owner) = (names.to_owned(), self.owner.clone());
        self.call(LONG_CALL, move |blobs| {
            blobs.remove(&names)?;
            // A missing file counts as removed. Another folder in the place, or none, misses every file: their removal
            // must not be forgotten.
            check_place(blobs, &owner)
        })
    }

    fn remove_folder(&self, folder: &str) -> io::Result<()> {
        let folder = folder.to_owned();
        self.call(LONG_CALL, move |blobs| blobs.remove_folder(&folder))
    }

    fn remove_empty_folders(&self, folder: &str) -> io::Result<()> {
        let folder = folder.to_owned();
        self.call(LONG_CALL, move |blobs| blobs.remove_empty_folders(&folder))
    }

    fn rename(&self, from: &str, to: &str) -> io::Result<bool> {
        let (from, to) = (from.to_owned(), to.to_owned());
        self.call(LONG_CALL, move |blobs| blobs.rename(&from, &to))
    }

    fn list(&self, folder: &str) -> io::Result<Vec<Listed>> {
        let folder = folder.to_owned();
        self.call(LONG_CALL, move |blobs| blobs.list(&folder))
    }

    fn is_shared(&self) -> bool {
        self.inner.is_shared()
    }

    fn now(&self) -> io::Result<SystemTime> {
        self.call(CALL, |blobs| blobs.now())
    }

    fn check(&self) -> io::Result<()> {
        self.call(CALL, |blobs| blobs.check())
    }

    fn shown(&self, name: &str) -> String {
        self.inner.shown(name)
    }

    fn space(&self) -> io::Result<Option<Space>> {
        self.call(CALL, |blobs| blobs.space())
    }

    fn look(&self) {
        let found = self.look_at_mark();
        let mut noted = self.noted();
        match (&*noted, &found) {
            (None, Some(trouble)) => tracing::error!(trouble, "files cannot be read or written"),
            (Some(_), None) => {
                tracing::info!(place = self.inner.shown(""), "files can be read and written again");
            }
            _ => {}
        }
        *noted = found;
    }

    fn trouble(&self) -> Option<String> {
        self.noted().clone()
    }
}

/// Makes sure, after a change, that it was made in the place of that database. A bucket is not moved.
fn check_place(blobs: &dyn Blobs, owner: &Owner) -> io::Result<()> {
    if blobs.is_remote() || owner::read(blobs).is_ok_and(|theirs| theirs.database == owner.database) {
        return Ok(());
    }
    let what = format!("the place of files {} is not the one that was opened", blobs.shown(""));
    Err(io::Error::new(io::ErrorKind::TimedOut, what))
}

/// A few threads that call the storage.
#[derive(Default)]
struct Threads {
    state: Mutex<State>,
    wake: Condvar,
}

#[derive(Default)]
struct State {
    queue: VecDeque<Work>,
    threads: usize,
    idle: usize,
}

impl Threads {
    /// Runs something, unless too much runs or waits already.
    fn run(self: &Arc<Self>, work: Work) -> bool {
        let mut state = self.state();
        if state.threads - state.idle + state.queue.len() >= MOST_CALLS {
            return false;
        }
        state.queue.push_back(work);
        if state.queue.len() > state.idle && state.threads < MOST_THREADS {
            let threads = Arc::clone(self);
            let started = thread::Builder::new().name("blobs".into()).spawn(move || threads.work());
            if started.is_ok() {
                state.threads += 1;
            } else if state.threads == 0 {
                state.queue.pop_back();
                return false;
            }
        }
        drop(state);
        self.wake.notify_one();
        true
    }

    fn work(&self) {
        let mut state = self.state();
        loop {
            if let Some(work) = state.queue.pop_front() {
                drop(state);
                // The hook has logged it; the caller learns of it by the channel.
                let _ = catch_unwind(AssertUnwindSafe(work));
                state = self.state();
                continue;
            }
            state.idle += 1;
            let waited = self.wake.wait_timeout(state, IDLE).unwrap_or_else(PoisonError::into_inner);
            state = waited.0;
            state.idle -= 1;
            if waited.1.timed_out() && state.queue.is_empty() {
                state.threads -= 1;
                return;
            }
        }
    }

    /// One who panicked cannot have left it half-changed.
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::{Files, RESULTS};
    use super::*;

    fn watched(folder: &std::path::Path) -> Watched {
        let owner = Owner { database: "first".into(), store: "here".into() };
        let files = Files::shared(folder.to_owned()).unwrap();
        owner::claim(&files, &owner).unwrap();
        Watched::new(Arc::new(files), owner, Elsewhere::default())
    }

    #[test]
    fn a_removal_from_another_place_is_an_error() {
        let parent = tempfile::tempdir().unwrap();
        let (folder, away) = (parent.path().join("files"), parent.path().join("away"));
        std::fs::create_dir(&folder).unwrap();
        let watched = watched(&folder);
        let names = ["artifacts/a".to_owned()];
        watched.remove(&names).unwrap();
        // No look has found it yet.
        std::fs::rename(&folder, &away).unwrap();
        watched.remove(&names).unwrap_err();
        std::fs::create_dir(&folder).unwrap();
        watched.remove(&names).unwrap_err();
        std::fs::remove_dir(&folder).unwrap();
        std::fs::rename(&away, &folder).unwrap();
        watched.remove(&names).unwrap();
    }

    #[test]
    fn a_file_that_another_place_has_taken_is_not_published_and_one_that_was_moved_is_not_removed() {
        let parent = tempfile::tempdir().unwrap();
        let (folder, away) = (parent.path().join("files"), parent.path().join("away"));
        std::fs::create_dir(&folder).unwrap();
        let places: [Box<dyn Blobs>; 2] =
            [Box::new(watched(&folder)), Box::new(Files::alone(folder.clone()))];
        for (number, blobs) in places.iter().enumerate() {
            std::fs::rename(&folder, &away).unwrap();
            std::fs::create_dir(&folder).unwrap();
            let name = format!("artifacts/{number}");
            let staged = blobs.stage(&name).unwrap();
            let error = blobs.publish(staged, &name, &|| false).unwrap_err();
            assert!(is_passing(&error), "{error}");
            std::fs::remove_dir_all(&folder).unwrap();
            std::fs::rename(&away, &folder).unwrap();
            blobs.publish(blobs.stage(&name).unwrap(), &name, &|| false).unwrap();
            std::fs::rename(&folder, &away).unwrap();
            let error = blobs.remove(std::slice::from_ref(&name)).unwrap_err();
            assert!(is_passing(&error), "{error}");
            std::fs::rename(&away, &folder).unwrap();
            blobs.fetch(&name).unwrap();
            blobs.remove(std::slice::from_ref(&name)).unwrap();
            assert_eq!(blobs.fetch(&name).unwrap_err().kind(), io::ErrorKind::NotFound);
        }
    }

    #[test]
    fn a_call_that_hangs_does_not_hold_its_caller() {
        let folder = tempfile::tempdir().unwrap();
        let watched = watched(folder.path());
        let (release, held) = sync_channel::<()>(0);
        let held = Arc::new(Mutex::new(held));
        let hang = || {
            let held = Arc::clone(&held);
            watched.run(Duration::from_millis(1), &|| false, move |_, _| {
                held.lock().unwrap().recv().map_err(io::Error::other)
            })
        };
        for _ in 0..MOST_CALLS {
            let error = hang().unwrap_err();
            assert!(
                error.kind() == io::ErrorKind::TimedOut && error.to_string().contains("has not answered"),
                "{error}"
            );
        }
        assert!(hang().unwrap_err().to_string().contains("so many calls"));
        watched.look();
        let trouble = watched.trouble().unwrap();
        assert!(trouble.contains(&folder.path().display().to_string()), "{trouble}");
        // Without a thread, and at once.
        assert_eq!(watched.fetch("x").unwrap_err().to_string(), trouble);
        // All hanging calls end.
        drop(release);
        let is_busy = || {
            let state = watched.threads.state();
            !state.queue.is_empty() || state.threads > state.idle
        };
        while is_busy() {
            thread::yield_now();
        }
        watched.look();
        assert_eq!(watched.trouble(), None);
        assert_eq!(watched.fetch("x").unwrap_err().kind(), io::ErrorKind::NotFound);
        assert!(watched.threads.state().threads <= MOST_THREADS);
    }

    #[test]
    fn a_folder_of_results_that_is_moved_is_told_and_not_made_again() {
        let parent = tempfile::tempdir().unwrap();
        let root = parent.path();
        let owner = Owner { database: "first".into(), store: "here".into() };
        let files = || Files::shared(root.to_owned()).unwrap().keeping(RESULTS).unwrap();
        owner::claim(&files(), &owner).unwrap();
        let watched = Watched::new(Arc::new(files()), owner, Elsewhere::default());
        let alone = Files::alone(root.to_owned()).keeping(RESULTS).unwrap();
        let name = "artifacts/ab/x";
        alone.publish(alone.stage(name).unwrap(), name, &|| false).unwrap();
        watched.look();
        assert_eq!(watched.trouble(), None);
        let (results, away) = (root.join(RESULTS), root.join("away"));
        for is_replaced in [false, true] {
            std::fs::rename(&results, &away).unwrap();
            if is_replaced {
                std::fs::create_dir_all(results.join("ab")).unwrap();
            }
            // Neither is missing.
            for error in [
                alone.fetch(name).unwrap_err(),
                alone.open(name).unwrap_err(),
                alone.list(RESULTS).unwrap_err(),
                alone.remove(&[name.to_owned()]).unwrap_err(),
                alone.rename(name, "quarantine/x").unwrap_err(),
            ] {
                assert!(is_passing(&error) && error.to_string().contains("artifacts was moved"), "{error}");
            }
            if !is_replaced {
                assert!(is_passing(&alone.stage("artifacts/cd/y").unwrap_err()));
                assert!(!results.exists(), "nothing is made in its place");
            }
            watched.look();
            assert!(watched.trouble().unwrap().contains("artifacts was moved"), "{:?}", watched.trouble());
            if is_replaced {
                std::fs::remove_dir_all(&results).unwrap();
            }
            std::fs::rename(&away, &results).unwrap();
            alone.fetch(name).unwrap();
            watched.look();
            assert_eq!(watched.trouble(), None);
        }
    }

    #[test]
    fn a_place_that_is_replaced_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("blobs");
        let watched = watched(&place);
        watched.look();
        assert_eq!(watched.trouble(), None);
        let aside = folder.path().join("aside");
        std::fs::rename(&place, &aside).unwrap();
        watched.look();
        assert!(watched.trouble().unwrap().contains("owner.json any more"), "{:?}", watched.trouble());
        assert_eq!(watched.stage("x").unwrap_err().kind(), io::ErrorKind::TimedOut);
        assert!(!place.exists(), "nothing is written there");
        let other = Files::shared(place.clone()).unwrap();
        owner::claim(&other, &Owner { database: "second".into(), store: "there".into() }).unwrap();
        watched.look();
        assert!(watched.trouble().unwrap().contains("second at there now"), "{:?}", watched.trouble());
        std::fs::remove_dir_all(&place).unwrap();
        std::fs::rename(&aside, &place).unwrap();
        watched.look();
        assert_eq!(watched.trouble(), None);
        watched.stage("x").unwrap();
    }
}
