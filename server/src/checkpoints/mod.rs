//! Checkpoints on disk: the state of a run that goes on after the process was killed.
//!
//! A checkpoint is never needed, only welcome: whatever is missing, damaged or of another version
//! means that the job starts anew, and a full disk that it goes on without. What is inside is the
//! engine's; nothing here knows jobs' states or HTTP.
//!
//! **Who may write which file.** A file belongs to one attempt of one job, by its name. An attempt
//! that has lost its lease does not know it yet and may go on to write; it writes under its own
//! name, so it can neither replace nor break a checkpoint of the attempt that followed. Should its file
//! be read by a later attempt, no harm is done: a run is determined by its request, and
//! every checkpoint of it is a state that this run passes. Files left over from such attempts go with the
//! end of the job, or with the sweep.
//!
//! **Several servers** share copies (`shared`) where they share results: of the checkpoint that a run leaves when its
//! process stops, and of one every ten minutes.

mod shared;

use std::collections::{HashMap, HashSet};
use std::fs::{self, File};
use std::io::{self, BufReader, BufWriter, Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::RecvTimeoutError;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use packstone_engine::{Checkpoint, CheckpointError, PackingRequest, Resume, checkpoint};

use self::shared::Shared;
use crate::atomic_file::{self, PARTIAL};
use crate::blobs::Blobs;
use crate::blobs::blocks::{BlockSummer, CheckedBlob};
use crate::jobs::store::Kept;
use crate::tasks;

/// Ending of a complete checkpoint.
const COMPLETE: &str = ".checkpoint";
const BUFFER_BYTES: usize = 1 << 18;
/// The first checkpoint of a run comes no later: a job of minutes should not lose half of them.
const FIRST_AFTER: Duration = Duration::from_secs(5);
/// At least so many times as long as the last checkpoint took must pass before the next: writing a state of
/// gigabytes must not become what the run spends its time with.
const PAUSE_PER_COST: u32 = 10;
/// Time between two copies of the checkpoints of a run to where other servers find them.
const SHARE_EVERY: Duration = Duration::from_mins(10);
/// Time between two looks whether a run is to stop that waits for a checkpoint of another server.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Writes a checkpoint in place of an earlier one of that name. Returns its length in bytes.
///
/// # Errors
/// Those of the disk; the earlier checkpoint is still there then.
pub(crate) fn write(file: &Path, checkpoint: &Checkpoint<'_>) -> io::Result<u64> {
    let write = |file: &File| {
        let mut out = BufWriter::with_capacity(BUFFER_BYTES, file);
        checkpoint.write_to(&mut out)?;
        out.flush()?;
        Ok(file.metadata()?.len())
    };
    atomic_file::write(file, write, || Ok(()))
}

/// Removes a file. A missing one is as good as removed.
pub(crate) fn remove(file: &Path) -> io::Result<()> {
    match fs::remove_file(file) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// When the next checkpoint of a run is due.
#[derive(Debug)]
pub(crate) struct Schedule {
    every: Duration,
    next: Mutex<Instant>,
}

impl Schedule {
    /// A checkpoint every so often; zero means between any two epochs.
    pub(crate) fn new(every: Duration) -> Self {
        Self { every, next: Mutex::new(Instant::now() + every.min(FIRST_AFTER)) }
    }

    /// Whether one is due.
    pub(crate) fn is_due(&self) -> bool {
        Instant::now() >= *self.next.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// One was tried, whether it succeeded or not, and took so long.
    pub(crate) fn tried(&self, took: Duration) {
        let pause = if self.every.is_zero() { Duration::ZERO } else { self.every.max(took * PAUSE_PER_COST) };
        *self.next.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now() + pause;
    }
}

/// The folder of the service's checkpoints.
#[derive(Clone, Debug)]
pub(crate) struct Checkpoints {
    root: PathBuf,
    every: Duration,
    /// Where other servers find copies.
    shared: Option<Shared>,
}

/// A file of the folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Found {
    /// The job's id, as it stands in the name.
    pub(crate) id: String,
    /// The attempt that wrote it.
    pub(crate) attempt: i64,
    /// Whether it is whole.
    pub(crate) complete: bool,
    file: PathBuf,
}

impl Checkpoints {
    /// Opens the folder, and makes it where it is missing. Runs are asked for a checkpoint `every` so often.
    pub(crate) fn open(root: PathBuf, every: Duration) -> io::Result<Self> {
        fs::create_dir_all(&root)?;
        Ok(Self { root, every, shared: None })
    }

    /// The same folder, of which copies go to where other servers find them.
    pub(crate) fn shared_by(self, blobs: Arc<dyn Blobs>) -> Self {
        Self { shared: Some(Shared::new(blobs)), ..self }
    }

    /// Copies the checkpoint that an attempt has kept, if it has, to where other servers find it; does nothing where
    /// there are no others. Blocks the thread.
    pub(crate) fn share(&self, id: &str, attempt: i64) {
        let Some(shared) = &self.shared else { return };
        let put = || match self.kept_by(id, attempt)? {
            Some(file) => shared.put(id, attempt, &File::open(file)?).map(|()| true),
            None => Ok(false),
        };
        match put() {
            Ok(true) => tracing::debug!(id, attempt, "shared a checkpoint"),
            Ok(false) => {}
            Err(error) => {
                tracing::warn!(%error, id, attempt, "a checkpoint was not shared with other servers");
            }
        }
    }

    /// Fetches the newest checkpoint that other servers have shared of a job that has none here. Blocks the thread.
    fn fetch_shared(&self, id: &str) {
        let Some(shared) = &self.shared else { return };
        let fetch = || {
            let Some(copy) = shared.newest(id)? else { return Ok(()) };
            let mut from = shared.open(&copy)?;
            let written = |mut file: &File| io::copy(&mut from, &mut file).map(drop);
            atomic_file::write(&self.file(id, copy.attempt), written, || Ok(()))
        };
        let fetched: io::Result<()> = fetch();
        if let Err(error) = fetched {
            tracing::warn!(%error, id, "a checkpoint of another server was not fetched");
        }
    }

    /// Fetches a checkpoint of a job that another server has shared where there is none here, or until the run is to
    /// stop. Called on a thread of a runtime that may block.
    pub(crate) fn prepare(&self, id: &str, is_stopped: &dyn Fn() -> bool) {
        if self.shared.is_none() || self.of(id).iter().any(|found| found.complete) {
            return;
        }
        let (done, ended) = std::sync::mpsc::channel::<()>();
        let (folder, id) = (self.clone(), id.to_owned());
        tasks::blocking(move || {
            folder.fetch_shared(&id);
            drop(done);
        });
        // Nothing is ever sent: the channel closes when it is done.
        while ended.recv_timeout(LOOK_EVERY) == Err(RecvTimeoutError::Timeout) && !is_stopped() {}
    }

    /// The state from which an attempt of a job goes on: the newest that can be read. What cannot is removed.
    pub(crate) fn resume(&self, id: &str, request: &PackingRequest) -> Option<Resume> {
        self.resume_by(id, |input| Resume::read_from(input, request))
    }

    /// The same of an export with this identity.
    pub(crate) fn resume_export(&self, id: &str, identity: &[u8]) -> Option<Resume> {
        self.resume_by(id, |input| Resume::of_export(input, identity))
    }

    fn resume_by(
        &self,
        id: &str,
        read: impl Fn(&mut dyn io::Read) -> Result<Resume, CheckpointError>,
    ) -> Option<Resume> {
        let (mut found, partial): (Vec<_>, Vec<_>) =
            self.of(id).into_iter().partition(|found| found.complete);
        // Of an attempt that was killed, and on a full disk the room that this one needs. Where it is being
        // written at this moment, by one that lost its lease, that one's rename fails.
        partial.iter().for_each(removed);
        found.sort_by_key(|found| std::cmp::Reverse(found.attempt));
        found.into_iter().find_map(|found| {
            let read = File::open(&found.file)
                .map_err(Into::into)
                .and_then(|file| read(&mut BufReader::with_capacity(BUFFER_BYTES, file)));
            match read {
                Ok(resume) => {
                    tracing::info!(of_attempt = found.attempt, "going on from a checkpoint");
                    Some(resume)
                }
                Err(error) => {
                    tell_useless(&found, &error);
                    None
                }
            }
        })
    }

    /// The file of the checkpoint that an attempt has kept, if it has.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn kept_by(&self, id: &str, attempt: i64) -> io::Result<Option<PathBuf>> {
        let file = self.file(id, attempt);
        Ok(file.try_exists()?.then_some(file))
    }

    /// The newest whole checkpoint of a job, to be sent; that of another server where there is none here. Those that
    /// are damaged are removed. Blocks the thread.
    pub(crate) fn newest(&self, id: &str) -> Option<CheckedBlob> {
        let whole = || self.of(id).into_iter().filter(|found| found.complete).collect::<Vec<_>>();
        let mut found = whole();
        if found.is_empty() {
            self.fetch_shared(id);
            found = whole();
        }
        found.sort_by_key(|found| std::cmp::Reverse(found.attempt));
        found.into_iter().find_map(|found| match open_whole(&found.file) {
            Ok(opened) => Some(opened),
            Err(error) => {
                tell_useless(&found, &error);
                None
            }
        })
    }

    /// Accepts the checkpoint of an attempt that ran elsewhere, piece by piece.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn receive(&self, id: &str, attempt: i64) -> io::Result<Receiving> {
        Ok(Receiving(atomic_file::Pieces::begin(self.file(id, attempt))?))
    }

    fn file(&self, id: &str, attempt: i64) -> PathBuf {
        self.root.join(format!("{id}.{attempt}{COMPLETE}"))
    }

    /// The writer of the checkpoints of one attempt.
    pub(crate) fn writer(&self, id: &str, attempt: i64) -> CheckpointWriter {
        CheckpointWriter {
            folder: self.clone(),
            id: id.to_owned(),
            attempt,
            schedule: Schedule::new(self.every),
            share_next: Mutex::new(Instant::now() + SHARE_EVERY),
            kept: AtomicBool::new(false),
            failing: AtomicBool::new(false),
        }
    }

    /// Removes the checkpoints of a job up to those of this attempt. Later ones are another's.
    pub(crate) fn remove(&self, id: &str, until_attempt: i64) {
        self.of(id).iter().filter(|found| found.attempt <= until_attempt).for_each(removed);
        self.remove_shared(id, until_attempt);
    }

    fn remove_shared(&self, id: &str, until_attempt: i64) {
        if let Some(shared) = &self.shared
            && let Err(error) = shared.remove_known(id, until_attempt)
        {
            tracing::warn!(%error, id, "copies of checkpoints are left to the sweeper");
        }
    }

    /// Removes those of many jobs at once, each up to that of the attempt named.
    pub(crate) fn remove_all(&self, until_attempt: &HashMap<String, i64>) {
        let found = self.list().unwrap_or_else(|error| {
            tracing::warn!(%error, "the folder of checkpoints cannot be read");
            Vec::new()
        });
        let useless =
            |found: &&Found| until_attempt.get(&found.id).is_some_and(|until| found.attempt <= *until);
        found.iter().filter(useless).for_each(removed);
        for (id, until) in until_attempt {
            self.remove_shared(id, *until);
        }
    }

    /// Removes one file that was found.
    pub(crate) fn remove_found(found: &Found) -> io::Result<()> {
        remove(&found.file)
    }

    /// The whole checkpoints with the times at which they were kept, for the count of attempts.
    pub(crate) fn kept(&self) -> io::Result<Vec<Kept>> {
        let since_epoch = |found: &Found| {
            let changed = fs::metadata(&found.file).and_then(|found| found.modified()).ok()?;
            changed.duration_since(std::time::UNIX_EPOCH).ok()
        };
        let kept = self.list()?.into_iter().filter(|found| found.complete).filter_map(|found| {
            let at_us = i64::try_from(since_epoch(&found)?.as_micros()).ok()?;
            Some(Kept { job: found.id, attempt: found.attempt, at_us })
        });
        Ok(kept.collect())
    }

    /// Those of [`Self::kept`] and the copies that servers share, of each attempt the latest. Where these cannot be
    /// listed, an attempt may count that should not. Blocks the thread.
    pub(crate) fn kept_anywhere(&self) -> io::Result<Vec<Kept>> {
        let mut kept = self.kept()?;
        if let Some(shared) = &self.shared {
            match shared.list() {
                Ok(copies) => kept.extend(copies),
                Err(error) => tracing::warn!(%error, "the checkpoints of other servers are not known"),
            }
        }
        // A checkpoint and its copy are one: an attempt must not be counted out twice.
        kept.sort_by(|one, other| {
            (&one.job, one.attempt, other.at_us).cmp(&(&other.job, other.attempt, one.at_us))
        });
        kept.dedup_by(|next, latest| next.job == latest.job && next.attempt == latest.attempt);
        Ok(kept)
    }

    /// IDs of the jobs of which servers share checkpoints. Blocks the thread.
    pub(crate) fn shared_ids(&self) -> io::Result<HashSet<String>> {
        self.shared.as_ref().map_or_else(|| Ok(HashSet::new()), Shared::ids)
    }

    /// Removes what servers share of a job. Blocks the thread.
    pub(crate) fn remove_all_shared(&self, id: &str) -> io::Result<()> {
        self.shared.as_ref().map_or(Ok(()), |shared| shared.remove(id))
    }

    /// Every checkpoint, whole or not.
    pub(crate) fn list(&self) -> io::Result<Vec<Found>> {
        let mut found = Vec::new();
        for entry in fs::read_dir(&self.root)? {
            let entry = entry?;
            let Ok(name) = entry.file_name().into_string() else { continue };
            found.extend(parse(&name).map(|(id, attempt, complete)| Found {
                id: id.to_owned(),
                attempt,
                complete,
                file: entry.path(),
            }));
        }
        Ok(found)
    }

    /// Those of one job. Only running jobs and those that wait for their next attempt have any, so the folder
    /// is small and reading it costs little.
    fn of(&self, id: &str) -> Vec<Found> {
        let mut found = self.list().unwrap_or_else(|error| {
            tracing::warn!(%error, "the folder of checkpoints cannot be read");
            Vec::new()
        });
        found.retain(|found| found.id == id);
        found
    }
}

/// Reads all whole checkpoints in a folder to their ends: how many these are, and what is wrong with which. Blocks the
/// thread.
///
/// # Errors
/// The system's.
pub(crate) fn verify_all(folder: &Path) -> io::Result<(usize, Vec<(String, String)>)> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok((0, Vec::new())),
        entries => entries?,
    };
    let (mut read, mut damaged) = (0, Vec::new());
    for entry in entries {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if !parse(&name).is_some_and(|(_, _, is_whole)| is_whole) {
            continue;
        }
        match open_whole(&entry.path()) {
            // It went with its job.
            Err(CheckpointError::Io(error)) if error.kind() == io::ErrorKind::NotFound => continue,
            Err(error) => damaged.push((name, error.to_string())),
            Ok(_) => {}
        }
        read += 1;
    }
    Ok((read, damaged))
}

/// Removes a checkpoint that nothing can go on from. One that cannot be read, for want of file descriptors for example,
/// may be readable later.
fn tell_useless(found: &Found, error: &CheckpointError) {
    let of_attempt = found.attempt;
    match error {
        CheckpointError::Io(error) if error.kind() != io::ErrorKind::UnexpectedEof => {
            tracing::warn!(%error, of_attempt, "a checkpoint could not be read");
        }
        error => {
            tracing::warn!(%error, of_attempt, "a checkpoint is of no use, and removed");
            removed(found);
        }
    }
}

/// Opens a checkpoint, and makes sure that it is whole; so is what is read of it afterwards.
fn open_whole(path: &Path) -> Result<CheckedBlob, CheckpointError> {
    let mut file = File::open(path)?;
    let mut summed = Summed { from: &file, sums: BlockSummer::default() };
    checkpoint::verify(&mut BufReader::with_capacity(BUFFER_BYTES, &mut summed))?;
    let sums = Arc::new(summed.sums.finish());
    file.rewind()?;
    // The next one who opens it verifies it again.
    Ok(CheckedBlob::new(Box::new(file), path.display().to_string(), sums, Arc::new(|| {})))
}

/// Sums the blocks of a file while it is read.
struct Summed<'a> {
    from: &'a File,
    sums: BlockSummer,
}

impl io::Read for Summed<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.from.read(into)?;
        self.sums.update(&into[..read]);
        Ok(read)
    }
}

/// A checkpoint that comes piece by piece. Dropped before it is finished, it leaves nothing.
#[derive(Debug)]
pub(crate) struct Receiving(atomic_file::Pieces);

impl Receiving {
    /// Writes the next piece.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn write(&mut self, piece: &[u8]) -> io::Result<()> {
        self.0.write(piece)
    }

    /// Keeps the checkpoint, if it is whole.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidData`] where it is not; the system's.
    pub(crate) fn finish(self) -> io::Result<()> {
        self.0.finish_checked(|file| {
            checkpoint::verify(&mut BufReader::with_capacity(BUFFER_BYTES, file)).map_err(|error| match error
            {
                CheckpointError::Io(error) => error,
                error => io::Error::new(io::ErrorKind::InvalidData, error.to_string()),
            })
        })
    }
}

fn removed(found: &Found) {
    if let Err(error) = remove(&found.file) {
        tracing::warn!(%error, file = %found.file.display(), "a checkpoint is left to the sweeper");
    }
}

/// Id, attempt, and whether it is whole.
fn parse(name: &str) -> Option<(&str, i64, bool)> {
    let whole = name.strip_suffix(PARTIAL);
    let (id, attempt) = whole.unwrap_or(name).strip_suffix(COMPLETE)?.rsplit_once('.')?;
    Some((id, attempt.parse().ok()?, whole.is_none()))
}

/// Writes the checkpoints of one attempt, on its packing thread.
#[derive(Debug)]
pub(crate) struct CheckpointWriter {
    folder: Checkpoints,
    id: String,
    attempt: i64,
    schedule: Schedule,
    /// When the next copy for other servers is due.
    share_next: Mutex<Instant>,
    kept: AtomicBool,
    failing: AtomicBool,
}

impl CheckpointWriter {
    /// Whether a checkpoint is due.
    pub(crate) fn is_due(&self) -> bool {
        self.schedule.is_due()
    }

    /// Keeps one. Where that fails the run goes on, and may find room for the next.
    pub(crate) fn keep(&self, checkpoint: &Checkpoint<'_>) {
        let start = Instant::now();
        let file = self.folder.file(&self.id, self.attempt);
        match write(&file, checkpoint) {
            Ok(bytes) => {
                let took_s = start.elapsed().as_secs_f64();
                tracing::debug!(bytes, took_s, "kept a checkpoint");
                self.failing.store(false, Ordering::Relaxed);
                // Only now are those of earlier attempts of no more use.
                if !self.kept.swap(true, Ordering::Relaxed) {
                    self.folder.remove(&self.id, self.attempt - 1);
                }
                self.share();
            }
            // Once: a disk stays full for longer than the time between two checkpoints.
            Err(error) if !self.failing.swap(true, Ordering::Relaxed) => {
                tracing::warn!(%error, "a checkpoint could not be kept; the run goes on without");
            }
            Err(_) => {}
        }
        self.schedule.tried(start.elapsed());
    }

    /// Copies the checkpoint for other servers where one is due, on another thread: the run goes on.
    fn share(&self) {
        let mut next = self.share_next.lock().unwrap_or_else(PoisonError::into_inner);
        if self.folder.shared.is_none() || Instant::now() < *next {
            return;
        }
        *next = Instant::now() + SHARE_EVERY;
        let (folder, id, attempt) = (self.folder.clone(), self.id.clone(), self.attempt);
        tasks::blocking(move || folder.share(&id, attempt));
    }
}

#[cfg(test)]
mod tests;
