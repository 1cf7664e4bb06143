//! The engine's view of the one who runs it: progress goes out, the request to stop comes in.
//!
//! The packing thread calls this every few milliseconds, so it is a short lock and an atomic. What
//! to do with either is decided by the runner, which also owns every clock.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use packstone_engine::{Checkpoint, Control, Finish, Progress, Step};

use crate::checkpoints::CheckpointWriter;
use crate::jobs::StopRequests;

/// Why a run is to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stop {
    /// A client cancelled the job.
    Cancelled = 1,
    /// The job ran longer than its `timeout_s`.
    TimedOut = 2,
    /// The server stops.
    Shutdown = 3,
    /// Another attempt took the job over.
    LeaseLost = 4,
}

/// Control of one run.
#[derive(Debug, Default)]
pub(crate) struct RunControl {
    stop: AtomicU8,
    /// Why the run is to end with what it has reached: 0 where it is not, else one more than the reason.
    finish: AtomicU8,
    /// What is reached at the time limit of the job is kept.
    keeps_past_deadline: AtomicBool,
    latest: Mutex<Option<Progress>>,
    checkpoints: Option<CheckpointWriter>,
    resumed: AtomicBool,
    /// The run is in a step that keeps checkpoints.
    growing: AtomicBool,
    /// Share of the work done, as the bits of a float.
    fraction: AtomicU64,
    /// The next checkpoint is wanted at once, and is the last.
    last_checkpoint: AtomicBool,
}

impl RunControl {
    /// Control of a run whose checkpoints are kept.
    pub(crate) fn with_checkpoints(checkpoints: CheckpointWriter) -> Self {
        Self { checkpoints: Some(checkpoints), ..Self::default() }
    }

    /// Asks the run to stop. The first reason stays.
    pub(crate) fn stop(&self, reason: Stop) {
        // An error means that there is a reason already.
        let _ = self.stop.compare_exchange(0, reason as u8, Ordering::AcqRel, Ordering::Acquire);
    }

    /// Why the run is to stop, if it is.
    pub(crate) fn stopped(&self) -> Option<Stop> {
        match self.stop.load(Ordering::Acquire) {
            0 => None,
            1 => Some(Stop::Cancelled),
            2 => Some(Stop::TimedOut),
            3 => Some(Stop::Shutdown),
            _ => Some(Stop::LeaseLost),
        }
    }

    /// Asks the run to end with the packing that it has reached. The first reason stays.
    pub(crate) fn finish(&self, reason: Finish) {
        // An error means that there is a reason already.
        let _ = self.finish.compare_exchange(0, 1 + reason as u8, Ordering::AcqRel, Ordering::Acquire);
    }

    /// Does what clients want.
    pub(crate) fn follow(&self, requests: StopRequests) {
        if requests.cancel {
            self.stop(Stop::Cancelled);
        } else if requests.finish {
            self.finish(Finish::Requested);
        }
    }

    /// Says that a run which reaches its time limit ends with its packing.
    pub(crate) fn keep_past_deadline(&self) {
        self.keeps_past_deadline.store(true, Ordering::Release);
    }

    /// The time that the run may take is over.
    pub(crate) fn reach_deadline(&self) {
        if self.keeps_past_deadline.load(Ordering::Acquire) {
            self.finish(Finish::TimedOut);
        } else {
            self.stop(Stop::TimedOut);
        }
    }

    /// Whether the run was asked to stop, or to end with what it has reached.
    pub(crate) fn is_ending(&self) -> bool {
        self.should_stop() || self.should_finish().is_some()
    }

    /// Asks for a last checkpoint, after which the run stops as for [`Stop::Shutdown`]. Returns `false` where the run
    /// is in no step that keeps one.
    pub(crate) fn stop_after_checkpoint(&self) -> bool {
        let keeps = self.checkpoints.is_some() && self.growing.load(Ordering::Acquire);
        self.last_checkpoint.store(keeps, Ordering::Release);
        keeps
    }

    /// Share of the work done, as last reported.
    pub(crate) fn fraction(&self) -> f64 {
        f64::from_bits(self.fraction.load(Ordering::Acquire))
    }

    /// Says that the run goes on from a checkpoint.
    pub(crate) fn resumed(&self) {
        self.resumed.store(true, Ordering::Release);
    }

    /// Whether that was said since the last call.
    pub(crate) fn take_resumed(&self) -> bool {
        self.resumed.swap(false, Ordering::AcqRel)
    }

    /// The latest progress, if there was any since the last call.
    pub(crate) fn take_progress(&self) -> Option<Progress> {
        self.latest.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

impl Control for RunControl {
    fn report(&self, progress: &Progress) {
        self.fraction.store(progress.fraction.to_bits(), Ordering::Release);
        self.growing.store(matches!(progress.step, Step::Edmd | Step::MonteCarlo), Ordering::Release);
        *self.latest.lock().unwrap_or_else(PoisonError::into_inner) = Some(progress.clone());
    }

    fn should_stop(&self) -> bool {
        self.stop.load(Ordering::Acquire) != 0
    }

    fn should_finish(&self) -> Option<Finish> {
        match self.finish.load(Ordering::Acquire) {
            0 => None,
            reason if reason == 1 + Finish::TimedOut as u8 => Some(Finish::TimedOut),
            _ => Some(Finish::Requested),
        }
    }

    fn wants_checkpoint(&self) -> bool {
        let wanted =
            |writer: &CheckpointWriter| self.last_checkpoint.load(Ordering::Acquire) || writer.is_due();
        self.checkpoints.as_ref().is_some_and(wanted)
    }

    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        if let Some(writer) = &self.checkpoints {
            writer.keep(checkpoint);
            if self.last_checkpoint.load(Ordering::Acquire) {
                self.stop(Stop::Shutdown);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_reason_to_stop_stays() {
        let control = RunControl::default();
        assert!(!control.should_stop());
        control.stop(Stop::TimedOut);
        control.stop(Stop::Cancelled);
        assert!(control.should_stop());
        assert_eq!(control.stopped(), Some(Stop::TimedOut));
    }

    #[test]
    fn a_run_that_is_kept_ends_with_its_packing_at_its_time_limit_or_when_asked() {
        let kept = RunControl::default();
        kept.keep_past_deadline();
        assert!(!kept.is_ending() && kept.should_finish().is_none());
        kept.reach_deadline();
        assert!(kept.is_ending() && !kept.should_stop());
        assert_eq!(kept.should_finish(), Some(Finish::TimedOut));
        kept.follow(StopRequests { cancel: false, finish: true });
        assert_eq!(kept.should_finish(), Some(Finish::TimedOut), "the first reason stays");
        kept.follow(StopRequests { cancel: true, finish: true });
        assert_eq!(kept.stopped(), Some(Stop::Cancelled), "who cancels wants no result");

        let other = RunControl::default();
        other.reach_deadline();
        assert_eq!((other.stopped(), other.should_finish()), (Some(Stop::TimedOut), None));
        let asked = RunControl::default();
        asked.follow(StopRequests { cancel: false, finish: true });
        assert_eq!((asked.stopped(), asked.should_finish()), (None, Some(Finish::Requested)));
    }
}
