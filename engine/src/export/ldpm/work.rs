//! How far the work is: stages of a model, each a share of the whole, told to whoever watches.

use crate::control::{Control, Phase, Progress};
use crate::export::{ExportError, go_on};

/// Steps between two looks: about a millisecond of geometry.
const STEPS_PER_LOOK: usize = 1024;
/// Looks between two reports.
pub(super) const LOOKS_PER_REPORT: usize = 16;

/// A stage of the work.
#[derive(Clone, Copy)]
pub(super) struct Work<'a> {
    pub(super) control: &'a dyn Control,
    /// Share of all work done before it, and after.
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) total: usize,
    pub(super) unit: &'static str,
    pub(super) message: &'static str,
}

impl Work<'_> {
    /// Takes a look where step `done` is due for one.
    pub(super) fn look(&self, done: usize) -> Result<(), ExportError> {
        if !done.is_multiple_of(STEPS_PER_LOOK) {
            return Ok(());
        }
        if done.is_multiple_of(STEPS_PER_LOOK * LOOKS_PER_REPORT) {
            self.report(done);
        }
        go_on(self.control)
    }

    /// Says that step `done` is reached.
    pub(super) fn report(&self, done: usize) {
        let share = done as f64 / self.total.max(1) as f64;
        self.control.report(&Progress {
            phase: Phase::Export,
            fraction: self.from + (self.to - self.from) * share.min(1.0),
            done: done as u64,
            total: self.total as u64,
            unit: self.unit,
            message: self.message.into(),
            growth: None,
        });
    }
}

/// Passes on the reports of a part of the work that counts its own from 0 to 1.
pub(super) struct Part<'a> {
    pub(super) control: &'a dyn Control,
    pub(super) from: f64,
    pub(super) to: f64,
}

impl Control for Part<'_> {
    fn report(&self, progress: &Progress) {
        let fraction = self.from + (self.to - self.from) * progress.fraction;
        self.control.report(&Progress { fraction, ..progress.clone() });
    }

    fn should_stop(&self) -> bool {
        self.control.should_stop()
    }
}
