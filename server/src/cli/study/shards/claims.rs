//! The claims of a study's points by processes that share nothing but a folder.
//!
//! A point is run by one process at a time. The process claims it by creating the file `POINT.GENERATION.jsonl`, which
//! fails if the file exists, and then appends the runs of the point to this file, which nobody else writes. Its first
//! line names the process, and its last one says that the process has released the point; each begins with its sum
//! ([`summed_lines`]). A released point, and one
//! whose process is dead, is taken up by the next generation. Only exclusive creation, rename and synchronization are
//! used, which NFS and Lustre have; no locks and no clocks of other machines.
//!
//! **Who is dead.** A process of the same machine is dead if the system has no process of this number and start. A
//! process of another machine is observed: it appends a byte to its file `NAME.beat` every [`BEAT_EVERY`], and is held
//! for dead if the file has not grown for [`DEAD_AFTER`]. A process that was suspended for longer may so be taken for
//! dead. That costs time and nothing else: runs are deterministic, and every process writes under names of its own
//! generation until it renames a complete result.

use std::collections::HashMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::super::run_log::{RunRecord, SYNC_EVERY};
use super::super::summed_lines;
use super::files::{BEAT, FOLDER, named};
use crate::atomic_file::{self, PARTIAL};
use crate::cli::process::Process;
use crate::studies::stop::Tally;
use crate::studies::{Outcome, Study};
use crate::telemetry::say;

/// Interval of the signs of life.
pub(super) const BEAT_EVERY: Duration = Duration::from_secs(10);
/// A process of another machine that gave no sign of life for so long is dead.
pub(super) const DEAD_AFTER: Duration = Duration::from_mins(1);
/// A file that another process creates is complete after this time, or never.
pub(super) const COMPLETE_WITHIN: Duration = Duration::from_mins(1);
/// Pause before a file that another process creates is looked at again.
pub(super) const LOOK_AGAIN: Duration = Duration::from_millis(50);

/// A line of the log of a point.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Line {
    Claim(Process),
    Run(RunRecord),
    Released(bool),
}

/// The log of one generation of a point.
pub(in super::super) struct PointLog {
    pub(in super::super) path: PathBuf,
    pub(in super::super) point: usize,
    /// Counts from 1.
    pub(in super::super) generation: i64,
    /// In the order in which they ended.
    pub(in super::super) runs: Vec<RunRecord>,
    holder: Option<Process>,
    released: bool,
    bytes: u64,
}

impl PointLog {
    /// Reads a log; `None` where there is none. An incomplete last line is left out.
    fn read(path: PathBuf, point: usize, generation: i64, study: &Study) -> io::Result<Option<Self>> {
        let mut text = Vec::new();
        match File::open(&path).and_then(|mut file| file.read_to_end(&mut text)) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(named(&path, "read", &error)),
            Ok(_) => {}
        }
        let mut log = Self {
            path,
            point,
            generation,
            runs: Vec::new(),
            holder: None,
            released: false,
            bytes: text.len() as u64,
        };
        let complete = text.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
        for (i, line) in text[..complete].split(|byte| *byte == b'\n').enumerate() {
            if line.is_empty() {
                continue;
            }
            let damaged = |what: &str| {
                let text = format!("{}: line {}: {what}; remove the line", log.path.display(), i + 1);
                io::Error::new(ErrorKind::InvalidData, text)
            };
            match summed_lines::read(line).map_err(|what| damaged(&what))? {
                Line::Claim(process) => log.holder = Some(process),
                Line::Run(record) => {
                    if record.point != point || !record.is_of(study) {
                        return Err(damaged("the study has no such run"));
                    }
                    log.runs.push(record);
                }
                Line::Released(_) => log.released = true,
            }
        }
        Ok(Some(log))
    }

    /// The process that runs the point now, as far as the log tells.
    pub(in super::super) fn holder(&self) -> Option<String> {
        let holder = self.holder.as_ref().filter(|_| !self.released)?;
        (holder.is_alive() != Some(false)).then(|| holder.to_string())
    }
}

/// All logs in a folder of a study, by point and generation.
pub(in super::super) fn logs(out: &Path, study: &Study) -> io::Result<Vec<PointLog>> {
    let folder = out.join(FOLDER);
    let entries = match fs::read_dir(&folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(|error| named(&folder, "read", &error))?,
    };
    let mut found: Vec<(usize, i64)> = Vec::new();
    for entry in entries {
        let name = entry?.file_name();
        let Some((point, generation)) =
            name.to_str().and_then(|name| name.strip_suffix(".jsonl")?.split_once('.'))
        else {
            continue;
        };
        found.extend(point.parse().ok().zip(generation.parse().ok()));
    }
    found.sort_unstable();
    let read = |(point, generation)| {
        PointLog::read(log_path(&folder, point, generation), point, generation, study).transpose()
    };
    found.into_iter().filter_map(read).collect()
}

/// The runs that count, each once, in the order in which they ended: void ones are to be repeated.
pub(in super::super) fn settled<'a>(runs: impl IntoIterator<Item = &'a RunRecord>) -> Vec<RunRecord> {
    let mut known = std::collections::HashSet::new();
    runs.into_iter()
        .filter(|run| run.outcome != Outcome::Void && known.insert((run.point, run.replicate)))
        .cloned()
        .collect()
}

/// What came of an attempt to claim a point.
#[derive(Debug, PartialEq)]
pub(in super::super) enum Claimed {
    /// It is this process's, after these runs of it.
    Held(Vec<RunRecord>),
    /// Nothing of it is left to run.
    Finished(Vec<RunRecord>),
    /// Another process runs it.
    Taken(String),
    /// Another process has claimed it, and it is not known yet whether this process lives.
    Unknown,
}

/// A point that this process runs.
struct Held {
    generation: i64,
    log: File,
    synced: Instant,
}

/// What was seen of a process of another machine.
struct Seen {
    bytes: u64,
    since: Instant,
    /// It has given a sign of life since this process looks.
    lives: bool,
}

/// The claims of this process.
pub(in super::super) struct Claims<'a> {
    folder: PathBuf,
    study: &'a Study,
    /// Runs of each point that were made without shards.
    earlier: Vec<Vec<RunRecord>>,
    process: Process,
    dead_after: Duration,
    held: Mutex<HashMap<usize, Held>>,
    seen: Mutex<HashMap<String, Seen>>,
    beaten: Mutex<Option<Instant>>,
}

impl<'a> Claims<'a> {
    /// Opens the claims of a study in its folder. `earlier` are the runs that were made there without shards.
    pub(super) fn open(
        out: &Path,
        study: &'a Study,
        earlier: &[RunRecord],
        dead_after: Duration,
    ) -> io::Result<Self> {
        let folder = out.join(FOLDER);
        fs::create_dir_all(&folder).map_err(|error| named(&folder, "made", &error))?;
        let mut by_point = vec![Vec::new(); study.points.len()];
        for run in earlier {
            by_point[run.point].push(run.clone());
        }
        let claims = Self {
            folder,
            study,
            earlier: by_point,
            process: Process::current(),
            dead_after,
            held: Mutex::default(),
            seen: Mutex::default(),
            beaten: Mutex::default(),
        };
        claims.beat();
        Ok(claims)
    }

    /// Claims a point that this process does not hold.
    pub(in super::super) fn claim(&self, point: usize) -> io::Result<Claimed> {
        let begin = Instant::now();
        loop {
            let logs = self.logs_of(point)?;
            let runs = settled(self.earlier[point].iter().chain(logs.iter().flat_map(|log| &log.runs)));
            if self.is_finished(&runs) {
                return Ok(Claimed::Finished(runs));
            }
            if let Some(last) = logs.last().filter(|log| !log.released) {
                match self.is_alive(last)? {
                    Some(true) => return Ok(Claimed::Taken(last.holder().unwrap_or_else(unnamed))),
                    None => return Ok(Claimed::Unknown),
                    Some(false) => {
                        let holder = last.holder.as_ref().map_or_else(unnamed, ToString::to_string);
                        say(&format!("point {point} is taken over from {holder}, which is dead"));
                    }
                }
            }
            let generation = logs.last().map_or(1, |log| log.generation + 1);
            let path = log_path(&self.folder, point, generation);
            match OpenOptions::new().append(true).create_new(true).open(&path) {
                Ok(log) => {
                    let mut held = Held { generation, log, synced: Instant::now() };
                    held.add(&Line::Claim(self.process.clone())).map_err(|e| named(&path, "written", &e))?;
                    held.log.sync_data()?;
                    atomic_file::sync_folder(&self.folder)?;
                    lock(&self.held).insert(point, held);
                    return Ok(Claimed::Held(runs));
                }
                // Another process was faster; over NFS its file may take some time to be seen.
                Err(error)
                    if error.kind() == ErrorKind::AlreadyExists && begin.elapsed() < COMPLETE_WITHIN =>
                {
                    std::thread::sleep(LOOK_AGAIN);
                }
                Err(error) => return Err(named(&path, "made", &error)),
            }
        }
    }

    fn logs_of(&self, point: usize) -> io::Result<Vec<PointLog>> {
        let read = |generation| {
            PointLog::read(log_path(&self.folder, point, generation), point, generation, self.study)
                .transpose()
        };
        (1..).map_while(read).collect()
    }

    fn is_finished(&self, runs: &[RunRecord]) -> bool {
        let mut tally = Tally::default();
        for run in runs {
            tally.ended(run.outcome, &self.study.stop_when);
        }
        tally.stopped || runs.len() >= self.study.replicates
    }

    /// Whether the process of a log lives; `None` while that is not known.
    fn is_alive(&self, log: &PointLog) -> io::Result<Option<bool>> {
        if let Some(alive) = log.holder.as_ref().and_then(Process::is_alive) {
            return Ok(Some(alive));
        }
        // Of a process that died before it wrote its name only the log itself can be observed.
        let (observed, bytes) = match &log.holder {
            Some(holder) => (holder.name.clone(), self.beats_of(&holder.name)?),
            None => (log.path.display().to_string(), log.bytes),
        };
        let mut seen = lock(&self.seen);
        let entry = seen.entry(observed).or_insert(Seen { bytes, since: Instant::now(), lives: false });
        if bytes != entry.bytes {
            *entry = Seen { bytes, since: Instant::now(), lives: true };
        }
        let silent = entry.since.elapsed() >= self.dead_after;
        Ok(if silent { Some(false) } else { entry.lives.then_some(true) })
    }

    fn beats_of(&self, name: &str) -> io::Result<u64> {
        let path = self.beat_path(name);
        // Opened, because NFS asks the server for the length then.
        match File::open(&path).and_then(|file| file.metadata()) {
            Ok(found) => Ok(found.len()),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(0),
            Err(error) => Err(named(&path, "read", &error)),
        }
    }

    fn beat_path(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}{BEAT}"))
    }

    /// Gives a sign of life if one is due. Returns the points that another process has taken over.
    pub(in super::super) fn beat(&self) -> Vec<usize> {
        let mut beaten = lock(&self.beaten);
        if beaten.is_some_and(|at| at.elapsed() < BEAT_EVERY) {
            return Vec::new();
        }
        *beaten = Some(Instant::now());
        let path = self.beat_path(&self.process.name);
        let append = || OpenOptions::new().create(true).append(true).open(&path)?.write_all(b".");
        if let Err(error) = append() {
            // Others take this process for dead and run its points too, which costs time and no more.
            say(&format!("warning: {} cannot be written: {error}", path.display()));
        }
        let held = lock(&self.held);
        let lost = |(&point, held): (&usize, &Held)| {
            log_path(&self.folder, point, held.generation + 1).exists().then_some(point)
        };
        held.iter().filter_map(lost).collect()
    }

    /// The generation of a point that this process holds.
    pub(in super::super) fn generation(&self, point: usize) -> Option<i64> {
        lock(&self.held).get(&point).map(|held| held.generation)
    }

    /// Appends a run of a point that this process holds.
    pub(in super::super) fn add(&self, record: &RunRecord) -> io::Result<()> {
        match lock(&self.held).get_mut(&record.point) {
            Some(held) => {
                held.add(&Line::Run(record.clone()))?;
                if held.synced.elapsed() >= SYNC_EVERY {
                    held.synced = Instant::now();
                    held.log.sync_data()?;
                }
                Ok(())
            }
            None => Err(io::Error::other(format!("point {} is not held", record.point))),
        }
    }

    /// Releases a point, if it is held.
    pub(in super::super) fn release(&self, point: usize) -> io::Result<()> {
        match lock(&self.held).remove(&point) {
            Some(mut held) => {
                held.add(&Line::Released(true))?;
                held.log.sync_data()
            }
            None => Ok(()),
        }
    }

    /// Releases all points and ends the signs of life.
    pub(super) fn close(&self) -> io::Result<()> {
        let points: Vec<usize> = lock(&self.held).keys().copied().collect();
        points.into_iter().try_for_each(|point| self.release(point))?;
        let _ = fs::remove_file(self.beat_path(&self.process.name));
        Ok(())
    }

    /// The folder in which a run of this process makes its files, until they are complete. Those of other generations
    /// are left alone: their process may not be dead.
    pub(in super::super) fn staging(
        &self,
        point: usize,
        replicate: usize,
        generation: i64,
    ) -> io::Result<PathBuf> {
        let folder = self.folder.join(format!("{point}-{replicate}.{generation}{PARTIAL}"));
        fs::create_dir_all(&folder).map_err(|error| named(&folder, "made", &error))?;
        Ok(folder)
    }
}

impl Held {
    /// Appends a line in one call, so that a kill rarely leaves an incomplete one.
    fn add(&mut self, line: &Line) -> io::Result<()> {
        self.log.write_all(summed_lines::line(line)?.as_bytes())
    }
}

fn log_path(folder: &Path, point: usize, generation: i64) -> PathBuf {
    folder.join(format!("{point}.{generation}.jsonl"))
}

fn unnamed() -> String {
    "a process that gave no name".into()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "claims_tests.rs"]
mod tests;
