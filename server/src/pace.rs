//! How long a run is likely to take from here, by the share of its work that it has done so far.

use std::time::Duration;

use packstone_engine::{Phase, Progress};

/// Before this share of the work, the time that is left is a guess not worth showing.
const ETA_FROM_FRACTION: f64 = 0.02;

/// The pace of one run.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pace {
    /// The run goes on from a checkpoint, and where it started is not known yet.
    resumed: bool,
    /// What earlier attempts have done; it took none of this run's time.
    done_before: f64,
    /// The largest fraction so far.
    fraction: f64,
}

impl Pace {
    /// The run turned out to go on from a checkpoint.
    pub(crate) fn resumed(&mut self) {
        self.resumed = true;
    }

    /// Takes notice of progress.
    pub(crate) fn follow(&mut self, progress: &Progress) {
        if progress.fraction > self.fraction {
            self.fraction = progress.fraction.min(1.0);
        }
        if self.resumed && progress.phase == Phase::Edmd {
            self.done_before = self.fraction;
            self.resumed = false;
        }
    }

    /// Share of the work done; never falls, whatever the engine says.
    pub(crate) fn fraction(&self) -> f64 {
        self.fraction
    }

    /// Seconds that the rest is likely to take, to a tenth; nothing while there is too little to go by.
    pub(crate) fn eta_s(&self, elapsed: Duration) -> Option<f64> {
        let done = self.fraction - self.done_before;
        (done >= ETA_FROM_FRACTION || self.fraction >= 1.0)
            .then(|| if done > 0.0 { elapsed.as_secs_f64() * (1.0 - self.fraction) / done } else { 0.0 })
            .map(|s| (s * 10.0).round() / 10.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ELAPSED: Duration = Duration::from_secs(10);

    fn after(pace: &mut Pace, phase: Phase, fraction: f64) -> (f64, Option<f64>) {
        pace.follow(&Progress {
            phase,
            fraction,
            done: 1,
            total: 2,
            unit: "grains",
            message: String::new(),
            growth: None,
        });
        (pace.fraction(), pace.eta_s(ELAPSED))
    }

    #[test]
    fn progress_never_falls_and_the_eta_waits_for_a_basis() {
        let mut pace = Pace::default();
        assert_eq!(after(&mut pace, Phase::Rsa, 0.01), (0.01, None));
        assert_eq!(after(&mut pace, Phase::Rsa, 0.5), (0.5, Some(10.0)));
        assert_eq!(after(&mut pace, Phase::Rsa, 0.4), (0.5, Some(10.0)));
        assert_eq!(after(&mut pace, Phase::Rsa, f64::NAN), (0.5, Some(10.0)));
        assert_eq!(after(&mut pace, Phase::Rsa, 7.0), (1.0, Some(0.0)));
    }

    #[test]
    fn what_was_done_before_is_no_part_of_the_pace() {
        let mut pace = Pace::default();
        pace.resumed();
        assert_eq!(after(&mut pace, Phase::Sampling, 0.0), (0.0, None));
        assert_eq!(after(&mut pace, Phase::Edmd, 0.6), (0.6, None));
        assert_eq!(after(&mut pace, Phase::Edmd, 0.8), (0.8, Some(10.0)));
        assert_eq!(after(&mut pace, Phase::Check, 1.0), (1.0, Some(0.0)));
    }
}
