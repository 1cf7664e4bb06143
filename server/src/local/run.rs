//! Control of one packing in the process of a caller: progress, checkpoints, and the request to stop.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use packstone_engine::request::OnLimit;
use packstone_engine::{Checkpoint, Control, Finish, Progress, Step};

use crate::checkpoints::{self, Schedule};
use crate::config::DEFAULT_CHECKPOINT_EVERY_S;
use crate::failure::Failure;
use crate::jobs::JobProgress;
use crate::remaining_time::RemainingTime;

/// Longest time that a run goes on after the request to stop, to write a last checkpoint.
const LAST_CHECKPOINT_WITHIN: Duration = Duration::from_secs(5);

/// Control of one packing, which any thread may ask for the progress or to stop.
#[derive(Debug)]
pub struct Run {
    every: Duration,
    state: Mutex<State>,
    stop: AtomicBool,
    /// The run is to end with what it has reached.
    finish: AtomicBool,
    /// The run is in a step that keeps checkpoints, and has a file for them.
    keeps: AtomicBool,
    /// A last checkpoint was written, or could not be.
    kept_last: AtomicBool,
}

#[derive(Debug)]
struct State {
    started: Instant,
    stopped_at: Option<Instant>,
    /// When the time limit of the job ends it, and whether it then ends with what it has reached.
    deadline: Option<Instant>,
    keeps_at_deadline: bool,
    checkpoint: Option<(PathBuf, Schedule)>,
    latest: Option<Progress>,
    remaining: RemainingTime,
    /// Why the last checkpoint could not be written.
    fault: Option<String>,
}

impl State {
    fn is_late(&self) -> bool {
        self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }
}

impl Default for Run {
    fn default() -> Self {
        Self::with_checkpoint_every(Duration::from_secs_f64(DEFAULT_CHECKPOINT_EVERY_S))
    }
}

impl Run {
    /// A run that keeps a checkpoint every so often, where its job has a file for it; zero is at every opportunity.
    pub fn with_checkpoint_every(every: Duration) -> Self {
        let state = State {
            started: Instant::now(),
            stopped_at: None,
            deadline: None,
            keeps_at_deadline: false,
            checkpoint: None,
            latest: None,
            remaining: RemainingTime::default(),
            fault: None,
        };
        Self {
            every,
            state: Mutex::new(state),
            stop: AtomicBool::new(false),
            finish: AtomicBool::new(false),
            keeps: AtomicBool::new(false),
            kept_last: AtomicBool::new(false),
        }
    }

    /// Asks the run to stop: at once, or where it keeps checkpoints after a last one, which takes at most 5 s.
    pub fn stop(&self) {
        let mut state = self.lock();
        state.stopped_at.get_or_insert_with(Instant::now);
        self.stop.store(true, Ordering::Release);
    }

    /// Asks the run to end with what it has reached, as a partial packing.
    pub fn finish(&self) {
        self.finish.store(true, Ordering::Release);
    }

    /// The progress since the last call, as JSON in the form of a job's `progress`; `None` without news.
    pub fn take_progress(&self) -> Option<String> {
        let mut state = self.lock();
        let progress = state.latest.take()?;
        let elapsed = state.started.elapsed();
        let progress = JobProgress {
            fraction: state.remaining.fraction(),
            step: progress.step,
            done: progress.done,
            total: progress.total,
            unit: progress.unit.to_owned(),
            message: progress.message,
            eta_s: state.remaining.eta_s(elapsed),
            growth: progress.growth,
        };
        serde_json::to_string(&progress).ok()
    }

    /// The fraction of the work that is done, and the seconds that are expected to be left.
    pub(crate) fn fraction_and_eta_s(&self) -> (f64, Option<f64>) {
        let state = self.lock();
        (state.remaining.fraction(), state.remaining.eta_s(state.started.elapsed()))
    }

    /// Why the last checkpoint could not be written, if so; told once.
    pub fn take_fault(&self) -> Option<String> {
        self.lock().fault.take()
    }

    /// The run begins, with a file for its checkpoints and a time limit or without, at which it ends as `on_limit`
    /// says.
    pub(crate) fn begin(
        &self,
        checkpoint: Option<&Path>,
        resumed: bool,
        timeout_s: Option<f64>,
        on_limit: OnLimit,
    ) {
        let mut state = self.lock();
        state.started = Instant::now();
        state.deadline = timeout_s.map(|s| state.started + Duration::from_secs_f64(s));
        state.keeps_at_deadline = on_limit == OnLimit::Keep;
        state.checkpoint = checkpoint.map(|file| (file.to_owned(), Schedule::new(self.every)));
        if resumed {
            state.remaining.resumed();
        }
    }

    /// The failure of a run that its time limit ended; `None` where [`stop`](Self::stop) did.
    pub(crate) fn timed_out(&self, timeout_s: Option<f64>) -> Option<Failure> {
        let fraction = self.lock().remaining.fraction();
        timeout_s.filter(|_| !self.is_stopping()).map(|timeout_s| Failure::timed_out(timeout_s, fraction))
    }

    /// Time since the run began, in s.
    pub(super) fn time_s(&self) -> f64 {
        self.lock().started.elapsed().as_secs_f64()
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_stopping(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }
}

impl Control for Run {
    fn report(&self, progress: &Progress) {
        let mut state = self.lock();
        let elapsed = state.started.elapsed();
        state.remaining.follow(progress, elapsed);
        let grows = matches!(progress.step, Step::Edmd | Step::MonteCarlo);
        self.keeps.store(grows && state.checkpoint.is_some(), Ordering::Release);
        state.latest = Some(progress.clone());
    }

    fn should_stop(&self) -> bool {
        if !self.is_stopping() {
            let state = self.lock();
            return !state.keeps_at_deadline && state.is_late();
        }
        let waits = self.keeps.load(Ordering::Acquire) && !self.kept_last.load(Ordering::Acquire);
        !waits || self.lock().stopped_at.is_some_and(|at| at.elapsed() > LAST_CHECKPOINT_WITHIN)
    }

    fn should_finish(&self) -> Option<Finish> {
        if self.finish.load(Ordering::Acquire) {
            return Some(Finish::Requested);
        }
        let state = self.lock();
        (state.keeps_at_deadline && state.is_late()).then_some(Finish::TimedOut)
    }

    fn wants_last_checkpoint(&self) -> bool {
        self.lock().checkpoint.is_some()
    }

    fn wants_checkpoint(&self) -> bool {
        let state = self.lock();
        state.checkpoint.as_ref().is_some_and(|(_, schedule)| self.is_stopping() || schedule.is_due())
    }

    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        // Asked before it is written: a request that comes meanwhile has another one written.
        let is_last = self.is_stopping();
        let Some(file) = self.lock().checkpoint.as_ref().map(|(file, _)| file.clone()) else { return };
        let start = Instant::now();
        let written = checkpoints::write(&file, checkpoint);
        let mut state = self.lock();
        state.fault = written.err().map(|error| format!("{} cannot be written: {error}", file.display()));
        if let Some((_, schedule)) = &state.checkpoint {
            schedule.tried(start.elapsed());
        }
        if is_last {
            self.kept_last.store(true, Ordering::Release);
        }
    }
}
