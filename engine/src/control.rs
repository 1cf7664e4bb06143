//! How a run talks to whoever started it: progress out, requests to stop in.
//!
//! The engine knows nothing of clocks, stores or users; it reports often and cheaply, and the
//! receiver decides what to keep and how to count time.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use serde::{Deserialize, Serialize};

use crate::checkpoint::Checkpoint;

/// What a run is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Step {
    /// Drawing the diameters.
    Sampling,
    /// Placing grains by random sequential addition.
    Rsa,
    /// Growing grains by event-driven molecular dynamics.
    Edmd,
    /// Growing grains by hard-particle Monte Carlo.
    MonteCarlo,
    /// The independent check.
    Check,
    /// Making a model of the finished packing: a mesh, voxels, a lattice.
    Export,
    /// Writing the result. The engine never reports it; whoever stores the result does.
    Write,
}

/// Where a run stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// What the run is doing.
    pub step: Step,
    /// Share of the whole run's work done, 0..=1, never falling within a run.
    pub fraction: f64,
    /// Units done in this step.
    pub done: u64,
    /// Units in this step.
    pub total: u64,
    /// What `done` and `total` count, as `grains`.
    pub unit: &'static str,
    /// One line for a person; may be empty.
    pub message: String,
    /// How far the grains have grown, while they do.
    pub growth: Option<Growth>,
}

impl Progress {
    /// That of work which is counted: `fraction` is the share that is done, and 0 where there is nothing to do.
    pub(crate) fn counted(
        step: Step,
        done: usize,
        total: usize,
        unit: &'static str,
        message: impl Into<String>,
    ) -> Self {
        Self {
            step,
            fraction: done as f64 / total.max(1) as f64,
            done: done as u64,
            total: total as u64,
            unit,
            message: message.into(),
            growth: None,
        }
    }
}

/// How far the grains have grown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Growth {
    /// Volume of the grains at their present size over that of the specimen.
    pub volume_fraction: f64,
    /// Constant distance that all grains keep at present, where one is asked for.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub distance_mm: Option<f64>,
    /// Events so far; of hard-particle Monte Carlo the moves tried.
    pub events: u64,
    /// Events per second of wall-clock time, lately.
    pub events_per_s: f64,
    /// Pressure over that of an ideal gas of the same density and energy; `null` while nothing can be
    /// said. It grows without bound where the grains jam.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub reduced_pressure: Option<f64>,
    /// Whether the remaining time follows from the fraction: not where the grains are likely to jam before their
    /// target, and not where there is no target and no limit.
    pub predictable: bool,
}

/// Why a run is to end with what it has reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finish {
    /// Somebody asked for it.
    Requested,
    /// The time that the job may take is over.
    TimedOut,
}

/// Receives progress and answers whether to go on. Called every few milliseconds from the threads
/// that work, so all but [`Control::keep_checkpoint`] must be cheap.
pub trait Control: Sync {
    /// Takes notice of the progress.
    fn report(&self, progress: &Progress);
    /// Whether the run should stop; it then ends with [`crate::PackError::Stopped`].
    fn should_stop(&self) -> bool;
    /// Whether the run should end with what it has reached, as a partial packing, and why; the check goes on. It
    /// counts whatever the request says of limits. Once it is some it must stay so.
    fn should_finish(&self) -> Option<Finish> {
        None
    }
    /// Whether a checkpoint is wanted of growth that ended before its target and whose packing is kept: who has it can
    /// go on later.
    fn wants_last_checkpoint(&self) -> bool {
        false
    }
    /// Whether a checkpoint is due. Asked between compression cycles; the answer does not change
    /// the packing.
    fn wants_checkpoint(&self) -> bool {
        false
    }
    /// Keeps a checkpoint that was wanted. The receiver handles errors of saving it; the run goes on.
    fn keep_checkpoint(&self, _checkpoint: &Checkpoint<'_>) {}
}

/// A part of a whole run: its fraction is mapped to a range of the whole's, and everything else is passed on.
///
/// The fraction never falls, also where the part starts again with other values.
pub struct Part<'a> {
    whole: &'a dyn Control,
    from: f64,
    to: f64,
    /// The fraction of the part by its progress, where it is not the one that is reported.
    fraction: Option<&'a (dyn Fn(&Progress) -> f64 + Sync)>,
    /// The largest fraction of the part that was reported, as the bits of a float.
    largest: AtomicU64,
}

impl<'a> Part<'a> {
    /// The part of a whole from one fraction to another.
    pub fn new(whole: &'a dyn Control, from: f64, to: f64) -> Self {
        Self { whole, from, to, fraction: None, largest: AtomicU64::new(0) }
    }

    /// The same part with its fraction computed from each progress.
    pub(crate) fn with_fraction(self, fraction: &'a (dyn Fn(&Progress) -> f64 + Sync)) -> Self {
        Self { fraction: Some(fraction), ..self }
    }

    /// The largest fraction of the whole that was reported.
    pub fn reached(&self) -> f64 {
        self.from + (self.to - self.from) * f64::from_bits(self.largest.load(Ordering::Relaxed))
    }
}

impl Control for Part<'_> {
    fn report(&self, progress: &Progress) {
        let fraction = self.fraction.map_or(progress.fraction, |of| of(progress));
        // Bits of floats that are not negative have the order of the floats.
        self.largest.fetch_max(fraction.max(0.0).to_bits(), Ordering::Relaxed);
        self.whole.report(&Progress { fraction: self.reached(), ..progress.clone() });
    }

    fn should_stop(&self) -> bool {
        self.whole.should_stop()
    }

    fn should_finish(&self) -> Option<Finish> {
        self.whole.should_finish()
    }

    fn wants_last_checkpoint(&self) -> bool {
        self.whole.wants_last_checkpoint()
    }

    fn wants_checkpoint(&self) -> bool {
        self.whole.wants_checkpoint()
    }

    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        self.whole.keep_checkpoint(checkpoint);
    }
}

/// Control of random addition that stops where the run is to finish, once there is a grain to finish with.
pub(crate) struct StopToFinish<'a> {
    whole: &'a dyn Control,
    has_grains: AtomicBool,
}

impl<'a> StopToFinish<'a> {
    /// Control of a random addition that is a part of this run.
    pub(crate) fn new(whole: &'a dyn Control) -> Self {
        Self { whole, has_grains: AtomicBool::new(false) }
    }

    /// Why random addition was stopped to finish with the grains that are placed; `None` where it was not.
    pub(crate) fn finish(&self) -> Option<Finish> {
        self.whole.should_finish().filter(|_| !self.whole.should_stop())
    }
}

impl Control for StopToFinish<'_> {
    fn report(&self, progress: &Progress) {
        self.has_grains.fetch_or(progress.done > 0, Ordering::Relaxed);
        self.whole.report(progress);
    }

    fn should_stop(&self) -> bool {
        let finishes = self.has_grains.load(Ordering::Relaxed) && self.whole.should_finish().is_some();
        finishes || self.whole.should_stop()
    }
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

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    #[derive(Default)]
    struct Heard(Mutex<Vec<f64>>);

    impl Control for Heard {
        fn report(&self, progress: &Progress) {
            if let Ok(mut heard) = self.0.lock() {
                heard.push(progress.fraction);
            }
        }
        fn should_stop(&self) -> bool {
            true
        }
        fn wants_checkpoint(&self) -> bool {
            true
        }
    }

    fn at(fraction: f64) -> Progress {
        let (step, message) = (Step::Export, String::new());
        Progress { step, fraction, done: 0, total: 0, unit: "", message, growth: None }
    }

    #[test]
    fn a_part_maps_its_fraction_and_never_falls() {
        let heard = Heard::default();
        let part = Part::new(&heard, 0.5, 1.0);
        for fraction in [0.0, 0.5, 0.25, -1.0, f64::NAN, 1.0] {
            part.report(&at(fraction));
        }
        assert!(part.should_stop() && part.wants_checkpoint());
        assert_eq!(part.reached(), 1.0);
        let squared = |progress: &Progress| progress.fraction * progress.fraction;
        Part::new(&heard, 0.0, 1.0).with_fraction(&squared).report(&at(0.5));
        let heard = heard.0.into_inner().unwrap_or_default();
        assert_eq!(heard, [0.5, 0.75, 0.75, 0.75, 0.75, 1.0, 0.25]);
    }

    #[test]
    fn threads_share_a_part() {
        let heard = Heard::default();
        let part = Part::new(&heard, 0.0, 1.0);
        std::thread::scope(|scope| {
            for thread in 0..4 {
                let part = &part;
                scope.spawn(move || {
                    for i in 0..100 {
                        part.report(&at(f64::from(4 * i + thread) / 400.0));
                    }
                });
            }
        });
        assert_eq!(part.reached(), 399.0 / 400.0);
    }
}
