//! How a run talks to whoever started it: progress out, the wish to stop in.
//!
//! The engine knows nothing of clocks, stores or users; it reports often and cheaply, and the
//! receiver decides what to keep and how to count time.

use serde::Serialize;

/// What a run is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Drawing the diameters.
    Take,
    /// Placing grains by random sequential addition.
    Rsa,
    /// The independent check.
    Verify,
    /// Writing the result. The engine never reports it; whoever stores the result does.
    Write,
}

/// Where a run stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// What the run is doing.
    pub phase: Phase,
    /// Share of the whole run's work done, 0..=1, never falling within a run.
    pub fraction: f64,
    /// Units done in this phase.
    pub done: u64,
    /// Units in this phase.
    pub total: u64,
    /// What `done` and `total` count, as `grains`.
    pub unit: &'static str,
    /// One line for a person; may be empty.
    pub message: String,
}

/// Receives progress and answers whether to go on. Called every few milliseconds from the thread
/// that packs, so both must be cheap.
pub trait Control {
    /// Takes notice of the progress.
    fn report(&self, progress: &Progress);
    /// Whether the run should stop; it then ends with [`crate::PackError::Stopped`].
    fn should_stop(&self) -> bool;
}

/// Control of a run that nobody watches and nothing stops.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unattended;

impl Control for Unattended {
    fn report(&self, _: &Progress) {}
    fn should_stop(&self) -> bool {
        false
    }
}
