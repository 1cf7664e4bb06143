//! Progress of an export that counts its steps.

use crate::control::{Control, Progress, Step};

/// Pieces of work, each a fraction of a millisecond, between two reports.
pub(super) const PIECES_PER_REPORT: usize = 16;

/// Steps of a piece of work; a [`Part`](crate::control::Part) makes them a part of a whole.
#[derive(Clone, Copy)]
pub(super) struct Steps<'a> {
    pub(super) control: &'a dyn Control,
    pub(super) total: usize,
    /// What is counted.
    pub(super) unit: &'static str,
    pub(super) message: &'static str,
}

impl Steps<'_> {
    /// Reports that `done` steps are done.
    pub(super) fn report(&self, done: usize) {
        let counted = Progress::counted(Step::Export, done, self.total, self.unit, self.message);
        let fraction = if self.total == 0 { 1.0 } else { counted.fraction.min(1.0) };
        self.control.report(&Progress { fraction, ..counted });
    }
}
