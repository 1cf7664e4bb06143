//! The fraction of a run that is done and the time it is likely to take from here.
//!
//! The engine predicts the fraction of the work (`docs/estimates.md`, "Progress"). The remaining time follows from the
//! time since the fraction was first known, `t (1 - f) / (f - f0)`, where `f0` is the fraction that the run, or this
//! part of it, started with.

use std::time::Duration;

use packstone_engine::{Progress, Step};

/// Below this fraction no remaining time is given: the prediction is too uncertain.
const ETA_FROM_FRACTION: f64 = 0.02;
/// Growth that starts beyond this fraction follows a random sequential addition that did not reach its target, whose
/// time says nothing about that of the growth.
const ANEW_FROM_FRACTION: f64 = 0.5;

/// The fraction of one run that is done, and its remaining time.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RemainingTime {
    /// The run continues from a checkpoint, and its first fraction is not known yet.
    resumed: bool,
    growing: bool,
    /// Fraction and time that the remaining time is counted from.
    from_fraction: f64,
    from: Duration,
    /// The largest fraction so far.
    fraction: f64,
    /// The remaining time does not follow from the fraction.
    unpredictable: bool,
}

impl RemainingTime {
    /// The run turned out to continue from a checkpoint.
    pub(crate) fn resumed(&mut self) {
        self.resumed = true;
    }

    /// Takes notice of progress, `elapsed` after the start of the run.
    pub(crate) fn follow(&mut self, progress: &Progress, elapsed: Duration) {
        let starts_growing = matches!(progress.step, Step::Edmd | Step::MonteCarlo) && !self.growing;
        let anew = starts_growing && (self.resumed || self.fraction > ANEW_FROM_FRACTION);
        if progress.fraction > self.fraction {
            self.fraction = progress.fraction.min(1.0);
        }
        if anew {
            (self.from_fraction, self.from, self.resumed) = (self.fraction, elapsed, false);
        }
        self.growing |= starts_growing;
        self.unpredictable = progress.growth.is_some_and(|growth| !growth.predictable);
    }

    /// Share of the work that is done; it never falls.
    pub(crate) fn fraction(&self) -> f64 {
        self.fraction
    }

    /// Remaining time in s, to a tenth; `None` while it cannot be predicted.
    pub(crate) fn eta_s(&self, elapsed: Duration) -> Option<f64> {
        if self.fraction >= 1.0 {
            return Some(0.0);
        }
        let done = self.fraction - self.from_fraction;
        let known = done >= ETA_FROM_FRACTION && !self.unpredictable;
        known.then(|| {
            let seconds = elapsed.saturating_sub(self.from).as_secs_f64() * (1.0 - self.fraction) / done;
            (seconds * 10.0).round() / 10.0
        })
    }
}

#[cfg(test)]
mod tests {
    use packstone_engine::Growth;

    use super::*;

    const ELAPSED: Duration = Duration::from_secs(10);

    fn progress(step: Step, fraction: f64) -> Progress {
        Progress { step, fraction, done: 1, total: 2, unit: "grains", message: String::new(), growth: None }
    }

    fn after(remaining: &mut RemainingTime, step: Step, fraction: f64) -> (f64, Option<f64>) {
        remaining.follow(&progress(step, fraction), ELAPSED);
        (remaining.fraction(), remaining.eta_s(ELAPSED))
    }

    #[test]
    fn progress_never_falls_and_the_eta_waits_for_a_basis() {
        let mut remaining = RemainingTime::default();
        assert_eq!(after(&mut remaining, Step::Rsa, 0.01), (0.01, None));
        assert_eq!(after(&mut remaining, Step::Rsa, 0.5), (0.5, Some(10.0)));
        assert_eq!(after(&mut remaining, Step::Rsa, 0.4), (0.5, Some(10.0)));
        assert_eq!(after(&mut remaining, Step::Rsa, f64::NAN), (0.5, Some(10.0)));
        assert_eq!(after(&mut remaining, Step::Rsa, 7.0), (1.0, Some(0.0)));
    }

    #[test]
    fn the_pace_counts_from_where_the_run_continued() {
        let mut remaining = RemainingTime::default();
        remaining.resumed();
        let second = |s| Duration::from_secs(s);
        remaining.follow(&progress(Step::Sampling, 0.0), second(1));
        remaining.follow(&progress(Step::Edmd, 0.6), second(2));
        assert_eq!((remaining.fraction(), remaining.eta_s(second(2))), (0.6, None));
        remaining.follow(&progress(Step::Edmd, 0.8), second(12));
        assert_eq!(remaining.eta_s(second(12)), Some(10.0));
    }

    #[test]
    fn growth_after_a_failed_random_addition_has_a_pace_of_its_own() {
        let mut remaining = RemainingTime::default();
        remaining.follow(&progress(Step::Rsa, 0.9), ELAPSED);
        remaining.follow(&progress(Step::Edmd, 0.9), ELAPSED);
        assert_eq!(remaining.eta_s(ELAPSED), None);
        remaining.follow(&progress(Step::Edmd, 0.95), 3 * ELAPSED);
        assert_eq!(remaining.eta_s(3 * ELAPSED), Some(20.0));
    }

    #[test]
    fn a_run_that_is_likely_to_jam_has_no_eta() {
        let growth = Growth {
            volume_fraction: 0.7,
            distance_mm: None,
            events: 1,
            events_per_s: 1.0,
            reduced_pressure: None,
            predictable: false,
        };
        let mut remaining = RemainingTime::default();
        remaining.follow(&Progress { growth: Some(growth), ..progress(Step::Edmd, 0.4) }, ELAPSED);
        assert_eq!((remaining.fraction(), remaining.eta_s(ELAPSED)), (0.4, None));
        remaining.follow(&progress(Step::Edmd, 0.5), ELAPSED);
        assert_eq!(remaining.eta_s(ELAPSED), Some(10.0));
    }
}
