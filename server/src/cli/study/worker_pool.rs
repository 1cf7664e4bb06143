//! The worker pool of `packstone study`: each thread takes the next job from the queue and packs it as `packstone run`
//! does.
//!
//! A thread writes the files of a result and counts the run in the tally of its point. The record of the run is sent to
//! the receiver, which writes the run log. A pool that runs a shard claims a point before its first run.
//!
//! A stop is requested by a signal. Runs that grow grains then go on to their next checkpoint, at most for
//! [`LAST_CHECKPOINT_WITHIN`], so that no work is lost; runs that are being checked or exported end within that time
//! or are stopped; the others stop at once.

use std::collections::{HashMap, HashSet, VecDeque};
use std::fs;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use packstone_engine::export::tables::{self, EngineInfo, Format, Head};
use packstone_engine::export::{ExportError, ExportReport, Model, Provenance};
use packstone_engine::{
    Checkpoint, Control, Finish, Grains, Limits, PackError, Progress, Step, TemplateCache,
};
use sha2::{Digest as _, Sha256};

use super::super::exports;
use super::super::outputs::Names;
use super::super::run;
use super::run_log::RunRecord;
use super::shards::claims::{Claimed, Claims};
use super::shards::files::publish;
use crate::checkpoints::{CheckpointWriter, Checkpoints};
use crate::exports::distance_kept;
use crate::formats::ResultFormat;
use crate::hex;
use crate::jobs::JobRequest;
use crate::studies::stop::Tally;
use crate::studies::{Facts, Outcome, PropertyFacts, Study};

/// The attempt in the names of checkpoints without shards; there is only one.
const ATTEMPT: i64 = 1;
/// Longest time that a run goes on after a signal to write a last checkpoint.
const LAST_CHECKPOINT_WITHIN: Duration = Duration::from_secs(20);
/// Interval at which the claim of another machine's process is looked at.
const LOOK_AT_CLAIMS_EVERY: Duration = Duration::from_secs(2);
/// Interval at which a thread that waits for claims looks for a signal.
const LOOK_FOR_STOP_EVERY: Duration = Duration::from_millis(100);

/// The shared state of the threads: the queued jobs and the counts of those that ended. A thread counts its run with
/// the lock held, so that no thread starts a job of a point whose stop rule is met.
pub(super) struct SharedState {
    /// Point and replicate of the queued jobs, the next one first.
    pub(super) queue: VecDeque<(usize, usize)>,
    /// How the runs of each point have ended.
    pub(super) tallies: Vec<Tally>,
    /// Number of running jobs of each point that has any.
    running_of: HashMap<usize, usize>,
    /// Number of jobs that were taken from the queue and whose ends the receiver has not noted.
    open: usize,
    /// Points of a shard whose claim by another process is observed.
    observed: Vec<usize>,
    observed_at: Instant,
}

impl SharedState {
    /// Of these jobs, the next one first, after runs that ended so.
    pub(super) fn new(queue: VecDeque<(usize, usize)>, tallies: Vec<Tally>) -> Self {
        Self {
            queue,
            tallies,
            running_of: HashMap::new(),
            open: 0,
            observed: Vec::new(),
            observed_at: Instant::now(),
        }
    }
}

/// The pool, shared by its threads.
pub(super) struct WorkerPool<'a> {
    pub(super) study: &'a Study,
    pub(super) limits: Limits,
    /// Templates of angular grains, which all runs of the study share.
    pub(super) templates: TemplateCache,
    pub(super) state: Mutex<SharedState>,
    /// Set to stop the pool: by a signal, or because the run log cannot be written.
    pub(super) stop: &'a AtomicBool,
    /// The fraction of its job that each thread has done, as the bits of a float.
    pub(super) fractions: Vec<AtomicU64>,
    pub(super) checkpoints: Checkpoints,
    /// Folder of the results.
    pub(super) results: PathBuf,
    /// Formats in which every packing is written.
    pub(super) formats: &'a [ResultFormat],
    /// The claims of a shard.
    pub(super) claims: Option<&'a Claims<'a>>,
    /// When the pool was stopped, as its threads saw it first.
    pub(super) stopped: OnceLock<Instant>,
}

/// What the threads send.
pub(super) enum Message {
    /// A run ended.
    Ended(Box<Ended>),
    /// Runs of a point that other processes have made.
    Found(Vec<RunRecord>),
    /// A point of a shard is run by another process, which is described.
    Taken { point: usize, by: String },
}

/// A run that ended.
pub(super) struct Ended {
    pub(super) record: RunRecord,
    /// The fault of the program or the machine that ended it.
    pub(super) fault: Option<String>,
    /// Whether no job of its point is left.
    pub(super) is_last: bool,
}

/// What a thread does next.
enum Next {
    Run(usize, usize),
    /// Look again: the queue has changed.
    Again,
    /// Wait for the claims that are observed.
    Wait,
    End,
}

impl WorkerPool<'_> {
    /// Runs jobs until the queue is empty, the pool is stopped, or a file cannot be written.
    pub(super) fn work(&self, thread: usize, sender: &Sender<io::Result<Message>>) {
        loop {
            let (point, replicate) = match self.next(sender) {
                Ok(Next::Run(point, replicate)) => (point, replicate),
                Ok(Next::Again) => continue,
                Ok(Next::Wait) => {
                    std::thread::sleep(LOOK_FOR_STOP_EVERY);
                    continue;
                }
                Ok(Next::End) => return,
                Err(error) => {
                    let _ = sender.send(Err(error));
                    return;
                }
            };
            let sent = match self.run(thread, point, replicate) {
                Ok(Some(run)) => self.count(run, sender),
                Ok(None) => return,
                Err(error) => {
                    self.note_end();
                    sender.send(Err(error)).is_ok()
                }
            };
            self.done(thread, 0.0);
            if !sent {
                return;
            }
        }
    }

    /// Counts a run, removes the queued jobs of its point if the stop rule is met, and sends the run. The lock is held,
    /// so that runs arrive in the order in which they were counted.
    fn count(&self, mut run: Ended, sender: &Sender<io::Result<Message>>) -> bool {
        let mut state = self.state();
        let point = run.record.point;
        if state.tallies[point].ended(run.record.outcome, &self.study.stop_when) {
            state.queue.retain(|(of, _)| *of != point);
        }
        let running = state.running_of.entry(point).or_default();
        *running = running.saturating_sub(1);
        run.is_last = *running == 0 && state.queue.iter().all(|(of, _)| *of != point);
        sender.send(Ok(Message::Ended(Box::new(run)))).is_ok()
    }

    /// Removes the queued jobs of a point that another process has taken over.
    pub(super) fn leave(&self, point: usize) {
        self.state().queue.retain(|(of, _)| *of != point);
    }

    /// How long ago the pool was stopped, if it was.
    fn stopped_for(&self) -> Option<Duration> {
        let stopped = self.stop.load(Ordering::Acquire);
        stopped.then(|| self.stopped.get_or_init(Instant::now).elapsed())
    }

    /// The receiver has noted the end of a run.
    pub(super) fn note_end(&self) {
        let mut state = self.state();
        state.open = state.open.saturating_sub(1);
    }

    /// Number of jobs whose ends are still to be noted: those of the queue and those that were taken from it.
    pub(super) fn left(&self) -> usize {
        let state = self.state();
        state.queue.len() + state.open
    }

    /// Sum of the fractions that the running jobs have done, each at most 1.
    pub(super) fn fraction_of_running(&self) -> f64 {
        self.fractions.iter().map(|done| f64::from_bits(done.load(Ordering::Relaxed))).sum()
    }

    fn state(&self) -> MutexGuard<'_, SharedState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn next(&self, sender: &Sender<io::Result<Message>>) -> io::Result<Next> {
        let mut state = self.state();
        if self.stop.load(Ordering::Acquire) {
            return Ok(Next::End);
        }
        let Some(&(point, replicate)) = state.queue.front() else {
            if state.observed.is_empty() {
                return Ok(Next::End);
            }
            if state.observed_at.elapsed() < LOOK_AT_CLAIMS_EVERY {
                return Ok(Next::Wait);
            }
            state.observed_at = Instant::now();
            let observed = std::mem::take(&mut state.observed);
            state.queue = observed.into_iter().flat_map(|point| self.jobs_of(point)).collect();
            return Ok(Next::Again);
        };
        if let Some(claims) = self.claims
            && claims.generation(point).is_none()
        {
            // With the lock held: the other threads have nothing to do until the point is claimed, or not.
            let claimed = claims.claim(point)?;
            return Ok(self.claimed(&mut state, point, claimed, sender));
        }
        // With the lock held, so that every job is counted either as queued or as open.
        state.queue.pop_front();
        *state.running_of.entry(point).or_default() += 1;
        state.open += 1;
        Ok(Next::Run(point, replicate))
    }

    /// The jobs of a point in their order.
    fn jobs_of(&self, point: usize) -> impl Iterator<Item = (usize, usize)> + use<> {
        (0..self.study.replicates).map(move |replicate| (point, replicate))
    }

    /// Updates the queue after an attempt to claim a point.
    fn claimed(
        &self,
        state: &mut SharedState,
        point: usize,
        claimed: Claimed,
        sender: &Sender<io::Result<Message>>,
    ) -> Next {
        let message = match claimed {
            Claimed::Held(runs) => {
                let ended: HashSet<usize> = runs.iter().map(|run| run.replicate).collect();
                state.queue.retain(|(of, replicate)| *of != point || !ended.contains(replicate));
                for run in &runs {
                    state.tallies[point].ended(run.outcome, &self.study.stop_when);
                }
                Message::Found(runs)
            }
            Claimed::Finished(runs) => {
                state.queue.retain(|(of, _)| *of != point);
                Message::Found(runs)
            }
            Claimed::Taken(by) => {
                state.queue.retain(|(of, _)| *of != point);
                Message::Taken { point, by }
            }
            Claimed::Unknown => {
                state.queue.retain(|(of, _)| *of != point);
                state.observed.push(point);
                return Next::Again;
            }
        };
        // Without a receiver there is nothing more to do.
        if sender.send(Ok(message)).is_ok() { Next::Again } else { Next::End }
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
        let attempt = self.claims.and_then(|claims| claims.generation(point)).unwrap_or(ATTEMPT);
        let resume = self.checkpoints.resume(&id, &request);
        let most = self.limits.threads;
        let limits =
            Limits { threads: job.threads().map_or(most, |threads| threads.min(most)), ..self.limits };
        let start = Instant::now();
        let control = Watch {
            pool: self,
            thread,
            deadline: job.timeout_s.map(|s| start + Duration::from_secs_f64(s)),
            keeps: !job.on_limit.is_fail(),
            timed_out: AtomicBool::new(false),
            writer: self.checkpoints.writer(&id, attempt),
            step: AtomicU8::new(BEFORE_GROWTH),
            kept_last: AtomicBool::new(false),
        };
        let packed = catch_unwind(AssertUnwindSafe(|| {
            packstone_engine::pack_or_resume(&request, &limits, &self.templates, resume, &control)
        }));
        let time_s = start.elapsed().as_secs_f64();
        let (outcome, mut facts, fault) = match &packed {
            Ok(Ok(packing)) => {
                let facts = Facts::of_packing(&packing.report);
                (facts.outcome_of_packing(), facts, None)
            }
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
        let mut digest = None;
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
            // What several processes may write is complete before it has its name.
            let staging = match self.claims {
                Some(claims) => Some(claims.staging(point, replicate, attempt)?),
                None => None,
            };
            let folder = staging.as_deref().unwrap_or(&self.results);
            match self.export(&id, folder, &job, &head, &packing.grains, &control) {
                Ok(reports) => facts.properties = PropertyFacts::of_reports(reports),
                Err(ExportError::Stopped) => return Ok(None),
                Err(ExportError::Write(error)) => return Err(named(folder, &error)),
                Err(error) => unmade = Some(exports::explained(error)),
            }
            let mut of_grains = digest_of(outcome, &facts)?;
            tables::write(Format::Npy, &head, &packing.grains, &mut of_grains)?;
            digest = Some(of_grains);
            self.keep(&id, folder, &head, &packing.grains)?;
            if let Some(staging) = &staging {
                publish(staging, &self.results)?;
            }
        }
        self.checkpoints.remove(&id, attempt);
        let digest = digest.map_or_else(|| digest_of(outcome, &facts), Ok)?;
        let digest = (outcome != Outcome::Void).then(|| hex::encode(&digest.finalize()));
        let record = RunRecord { point, replicate, seed: job.seed, outcome, facts, digest, distance_curve };
        Ok(Some(Ended { record, fault: fault.or(unmade), is_last: false }))
    }

    /// Makes the exports that the job requests, and returns their reports.
    fn export(
        &self,
        id: &str,
        folder: &Path,
        job: &JobRequest,
        head: &Head,
        grains: &Grains,
        control: &Watch<'_>,
    ) -> Result<Vec<ExportReport>, ExportError> {
        let items = job.postprocess.items();
        if !items.is_empty() {
            make_folder(folder)?;
        }
        // The time limit of the job holds for the packing only.
        let control = Untimed(control);
        let mut names = Names::of(id);
        let provenance = Provenance::from(head);
        let model = Model::new(&job.specimen, grains)
            .with_distance(distance_kept(head))
            .with_provenance(&provenance)
            .with_materials(job.materials.as_ref())
            .with_mesher(&crate::gmsh::Installed);
        let made = items.into_iter().map(|(_, export)| {
            let file = folder.join(names.of_export(export));
            exports::write(export, &model, &self.limits, None, &control, &file)
        });
        made.collect()
    }

    /// Writes a packing in the requested formats.
    fn keep(&self, id: &str, folder: &Path, head: &Head, grains: &Grains) -> io::Result<()> {
        for format in self.formats {
            let file = folder.join(format!("{id}.{}", format.name()));
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
        self.0.pool.stopped_for().is_some_and(|since| since >= LAST_CHECKPOINT_WITHIN)
    }
}

/// Makes a folder; the error names it.
pub(super) fn make_folder(folder: &Path) -> io::Result<()> {
    fs::create_dir_all(folder).map_err(|error| named(folder, &error))
}

fn named(path: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{} cannot be written: {error}", path.display()))
}

/// The digest of a run, to which that of its grains is added: equal for equal runs, whatever time they took.
fn digest_of(outcome: Outcome, facts: &Facts) -> io::Result<Sha256> {
    let facts = Facts { time_s: 0.0, edmd_s: None, ..facts.clone() };
    Ok(Sha256::new().chain_update(serde_json::to_vec(&(outcome, facts))?))
}

// Phases of a run as a stop distinguishes them.
/// Nothing can be kept of it.
const BEFORE_GROWTH: u8 = 0;
/// A checkpoint can be kept.
const GROWTH: u8 = 1;
/// It is about to end.
const AFTER_GROWTH: u8 = 2;

/// Control of one run.
struct Watch<'a> {
    pool: &'a WorkerPool<'a>,
    thread: usize,
    deadline: Option<Instant>,
    /// What is reached at the deadline is kept.
    keeps: bool,
    timed_out: AtomicBool,
    writer: CheckpointWriter,
    /// The last one that was reported.
    step: AtomicU8,
    /// A checkpoint has been kept since the pool was stopped.
    kept_last: AtomicBool,
}

impl Watch<'_> {
    fn is_past_deadline(&self) -> bool {
        if self.deadline.is_some_and(|deadline| Instant::now() >= deadline) {
            self.timed_out.store(true, Ordering::Relaxed);
        }
        self.timed_out.load(Ordering::Relaxed)
    }
}

impl Control for Watch<'_> {
    fn report(&self, progress: &Progress) {
        let step = match progress.step {
            Step::Sampling | Step::Rsa => BEFORE_GROWTH,
            Step::Edmd | Step::MonteCarlo => GROWTH,
            Step::Check | Step::Export | Step::Write => AFTER_GROWTH,
        };
        self.step.store(step, Ordering::Relaxed);
        self.pool.done(self.thread, progress.fraction.clamp(0.0, 1.0));
    }

    fn should_stop(&self) -> bool {
        if let Some(since) = self.pool.stopped_for() {
            let nothing_to_keep = self.step.load(Ordering::Relaxed) == BEFORE_GROWTH;
            return nothing_to_keep
                || self.kept_last.load(Ordering::Relaxed)
                || since >= LAST_CHECKPOINT_WITHIN;
        }
        !self.keeps && self.is_past_deadline()
    }

    fn should_finish(&self) -> Option<Finish> {
        (self.keeps && self.is_past_deadline()).then_some(Finish::TimedOut)
    }

    fn wants_checkpoint(&self) -> bool {
        let last = self.pool.stopped_for().is_some() && !self.kept_last.load(Ordering::Relaxed);
        last || self.writer.is_due()
    }

    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        let is_last = self.pool.stopped_for().is_some();
        self.writer.keep(checkpoint);
        if is_last {
            self.kept_last.store(true, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::mpsc;

    use serde_json::json;

    use super::*;

    #[test]
    fn every_job_is_counted_once_at_any_moment() {
        let request = json!({
            "seed": 1, "replicates": 100,
            "template": {
                "specimen": {"type": "box", "size_mm": [20, 20, 20]},
                "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.1}
            },
        });
        let study = Study::read(&request, 1, None, &Limits::default()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let queue: VecDeque<_> = study.order().collect();
        let jobs = queue.len();
        let stop = AtomicBool::new(false);
        let pool = WorkerPool {
            study: &study,
            limits: Limits::default(),
            templates: TemplateCache::default(),
            state: Mutex::new(SharedState::new(queue, vec![Tally::default(); study.points.len()])),
            stop: &stop,
            fractions: vec![AtomicU64::default(), AtomicU64::default()],
            checkpoints: Checkpoints::open(folder.path().join("checkpoints"), Duration::MAX).unwrap(),
            results: folder.path().to_owned(),
            formats: &[],
            claims: None,
            stopped: OnceLock::new(),
        };
        let (sender, receiver) = mpsc::channel();
        let mut ended = 0;
        std::thread::scope(|scope| {
            for thread in 0..2 {
                let (sender, pool) = (sender.clone(), &pool);
                scope.spawn(move || pool.work(thread, &sender));
            }
            drop(sender);
            while let Ok(message) = receiver.recv() {
                assert!(matches!(message, Ok(Message::Ended(_))));
                pool.note_end();
                ended += 1;
                for _ in 0..100 {
                    assert_eq!(ended + pool.left(), jobs);
                }
            }
        });
        assert_eq!((ended, pool.left()), (jobs, 0));
    }
}
