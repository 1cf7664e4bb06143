//! The worker pool of `packstone study`: each thread takes the next job from the queue and packs it as `packstone run`
//! does.
//!
//! A thread writes the files of a result and counts the run in the tally of its point. The record of the run is sent to
//! the receiver, which writes the run log.

use std::collections::VecDeque;
use std::fs;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use packstone_engine::export::tables::{EngineInfo, Format, Head};
use packstone_engine::export::{ExportError, Model, Provenance};
use packstone_engine::{Checkpoint, Control, Grains, Limits, PackError, Progress};

use super::super::exports;
use super::super::outputs::Names;
use super::super::run;
use super::run_log::RunRecord;
use crate::checkpoints::{CheckpointWriter, Checkpoints};
use crate::jobs::JobRequest;
use crate::studies::stop::Tally;
use crate::studies::{Facts, Outcome, Study};

/// The attempt in the names of checkpoints; there is only one.
const ATTEMPT: i64 = 1;

/// The shared state of the threads: the queued jobs and the counts of those that ended. A thread counts its run with
/// the lock held, so that no thread starts a job of a point whose stop rule is met.
pub(super) struct SharedState {
    /// Point and replicate of the queued jobs, the next one first.
    pub(super) queue: VecDeque<(usize, usize)>,
    /// How the runs of each point have ended.
    pub(super) tallies: Vec<Tally>,
}

/// The pool, shared by its threads.
pub(super) struct WorkerPool<'a> {
    pub(super) study: &'a Study,
    pub(super) limits: Limits,
    pub(super) state: Mutex<SharedState>,
    /// Number of running jobs.
    pub(super) running: AtomicUsize,
    /// Set to stop the pool: by a signal, or because the run log cannot be written.
    pub(super) stop: &'a AtomicBool,
    /// The fraction of its job that each thread has done, as the bits of a float.
    pub(super) fractions: Vec<AtomicU64>,
    pub(super) checkpoints: Checkpoints,
    /// Folder of the results.
    pub(super) results: PathBuf,
    /// Formats in which every packing is written.
    pub(super) formats: &'a [Format],
}

/// A run that ended.
pub(super) struct Ended {
    pub(super) record: RunRecord,
    /// The fault of the program or the machine that ended it.
    pub(super) fault: Option<String>,
}

impl WorkerPool<'_> {
    /// Runs jobs until the queue is empty, the pool is stopped, or a file cannot be written.
    pub(super) fn work(&self, thread: usize, ended: &Sender<io::Result<Ended>>) {
        while let Some((point, replicate)) = self.next() {
            let sent = match self.run(thread, point, replicate) {
                Ok(Some(run)) => self.count(run, ended),
                Ok(None) => return,
                Err(error) => ended.send(Err(error)).is_ok(),
            };
            self.done(thread, 0.0);
            self.running.fetch_sub(1, Ordering::Relaxed);
            if !sent {
                return;
            }
        }
    }

    /// Counts a run, removes the queued jobs of its point if the stop rule is met, and sends the run. The lock is held,
    /// so that runs arrive in the order in which they were counted.
    fn count(&self, run: Ended, ended: &Sender<io::Result<Ended>>) -> bool {
        let mut state = self.state();
        let point = run.record.point;
        if state.tallies[point].ended(run.record.outcome, &self.study.stop_when) {
            state.queue.retain(|(of, _)| *of != point);
        }
        ended.send(Ok(run)).is_ok()
    }

    /// Number of queued jobs.
    pub(super) fn waiting(&self) -> usize {
        self.state().queue.len()
    }

    /// Number of running jobs.
    pub(super) fn running(&self) -> usize {
        self.running.load(Ordering::Relaxed)
    }

    /// Sum of the fractions that the running jobs have done, each at most 1.
    pub(super) fn fraction_of_running(&self) -> f64 {
        self.fractions.iter().map(|done| f64::from_bits(done.load(Ordering::Relaxed))).sum()
    }

    fn state(&self) -> MutexGuard<'_, SharedState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn next(&self) -> Option<(usize, usize)> {
        let mut state = self.state();
        if self.stop.load(Ordering::Acquire) {
            return None;
        }
        // With the lock held, so that every job is counted either as queued or as running.
        state.queue.pop_front().inspect(|_| {
            self.running.fetch_add(1, Ordering::Relaxed);
        })
    }

    fn done(&self, thread: usize, fraction: f64) {
        if let Some(done) = self.fractions.get(thread) {
            done.store(fraction.to_bits(), Ordering::Relaxed);
        }
    }

    /// Runs a job. Returns `None` where it was stopped.
    fn run(&self, thread: usize, point: usize, replicate: usize) -> io::Result<Option<Ended>> {
        let job = self.study.points[point].replicate(replicate);
        let request = job.packing();
        let id = format!("{point}-{replicate}");
        let resume = self.checkpoints.resume(&id, &request);
        let start = Instant::now();
        let control = Watch {
            pool: self,
            thread,
            deadline: job.timeout_s.map(|s| start + Duration::from_secs_f64(s)),
            timed_out: AtomicBool::new(false),
            writer: self.checkpoints.writer(&id, ATTEMPT),
        };
        let packed = catch_unwind(AssertUnwindSafe(|| {
            packstone_engine::pack_or_resume(&request, &self.limits, resume, &control)
        }));
        let time_s = start.elapsed().as_secs_f64();
        let (outcome, facts, fault) = match &packed {
            Ok(Ok(packing)) => (Outcome::Succeeded, Facts::of_packing(&packing.report), None),
            Ok(Err(PackError::Stopped { .. })) if !control.timed_out.load(Ordering::Relaxed) => {
                return Ok(None);
            }
            Ok(Err(error @ PackError::Stopped { .. })) => {
                (Outcome::TargetNotReached, Facts::of_failure(error, time_s), None)
            }
            Ok(Err(error)) => {
                let outcome = Outcome::of_failure(error);
                let fault = (outcome == Outcome::Void).then(|| error.to_string());
                (outcome, Facts::of_failure(error, time_s), fault)
            }
            // The message went to standard error already.
            Err(_) => {
                let fault = "it came upon a defect of this program".into();
                (Outcome::Void, Facts { time_s, ..Facts::default() }, Some(fault))
            }
        };
        let (mut distance_curve, mut unmade) = (Vec::new(), None);
        if let Ok(Ok(packing)) = packed {
            if replicate == 0 {
                distance_curve = packing.report.distance_curve();
            }
            let head = Head {
                job_id: None,
                request: serde_json::to_value(&job)?,
                engine: EngineInfo::current(),
                report: packing.report,
            };
            match self.export(&id, &job, &head, &packing.grains, &control) {
                Ok(()) => {}
                Err(ExportError::Stopped) => return Ok(None),
                Err(ExportError::Write(error)) => return Err(named(&self.results, &error)),
                Err(error) => unmade = Some(exports::explained(error)),
            }
            self.keep(&id, &head, &packing.grains)?;
        }
        self.checkpoints.remove(&id, ATTEMPT);
        let record = RunRecord { point, replicate, seed: job.seed, outcome, facts, distance_curve };
        Ok(Some(Ended { record, fault: fault.or(unmade) }))
    }

    /// Makes the exports that the job requests.
    fn export(
        &self,
        id: &str,
        job: &JobRequest,
        head: &Head,
        grains: &Grains,
        control: &Watch<'_>,
    ) -> Result<(), ExportError> {
        let items = job.postprocess.items();
        if !items.is_empty() {
            make_folder(&self.results)?;
        }
        // The time limit of the job holds for the packing only.
        let control = Untimed(control);
        let mut names = Names::of(id);
        let provenance = Provenance::from(head);
        let model = Model::new(&job.specimen, grains).with_provenance(&provenance);
        for (_, export) in items {
            let file = self.results.join(names.of_export(export));
            exports::write(export, &model, &self.limits, &control, &file)?;
        }
        Ok(())
    }

    /// Writes a packing in the requested formats.
    fn keep(&self, id: &str, head: &Head, grains: &Grains) -> io::Result<()> {
        for format in self.formats {
            let file = self.results.join(format!("{id}.{}", format.name()));
            run::write(&file, *format, head, grains).map_err(|error| named(&file, &error))?;
        }
        Ok(())
    }
}

/// Control that stops with the pool, has no time limit and reports nothing.
struct Untimed<'a>(&'a Watch<'a>);

impl Control for Untimed<'_> {
    fn report(&self, _: &Progress) {}

    fn should_stop(&self) -> bool {
        self.0.pool.stop.load(Ordering::Acquire)
    }
}

/// Makes a folder; the error names it.
pub(super) fn make_folder(folder: &Path) -> io::Result<()> {
    fs::create_dir_all(folder).map_err(|error| named(folder, &error))
}

fn named(path: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{} cannot be written: {error}", path.display()))
}

/// Control of one run.
struct Watch<'a> {
    pool: &'a WorkerPool<'a>,
    thread: usize,
    deadline: Option<Instant>,
    timed_out: AtomicBool,
    writer: CheckpointWriter,
}

impl Control for Watch<'_> {
    fn report(&self, progress: &Progress) {
        self.pool.done(self.thread, progress.fraction.clamp(0.0, 1.0));
    }

    fn should_stop(&self) -> bool {
        if self.pool.stop.load(Ordering::Acquire) {
            return true;
        }
        if self.deadline.is_some_and(|deadline| Instant::now() >= deadline) {
            self.timed_out.store(true, Ordering::Relaxed);
        }
        self.timed_out.load(Ordering::Relaxed)
    }

    fn wants_checkpoint(&self) -> bool {
        self.writer.is_due()
    }

    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        self.writer.keep(checkpoint);
    }
}
