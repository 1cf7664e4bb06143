//! The figures of a run for the table of its study, from the report of the engine or from the error of a run that
//! failed.

use packstone_engine::{GrowthEffort, PackError, Report, TargetNotReached};

use super::{Facts, Outcome};

impl Facts {
    /// Of a packing.
    pub(crate) fn of_packing(report: &Report) -> Self {
        let (summary, timings) = (&report.summary, &report.timings_s);
        let grown = report.statistics.edmd;
        let partial = summary.partial.as_ref();
        let requested = partial.and_then(|partial| partial.volume_fraction_requested);
        Self {
            // Not `total` alone, which lacks the time before the checkpoint in a run that was resumed.
            time_s: timings.total.max(
                timings.sampling
                    + timings.rsa
                    + timings.edmd.or(timings.monte_carlo).unwrap_or(0.0)
                    + timings.check,
            ),
            grains: Some(partial.map_or(summary.grains, |partial| partial.grains_requested)),
            volume_fraction_effective: requested.or(Some(summary.volume_fraction_effective)),
            volume_fraction_reached: partial.map(|partial| partial.volume_fraction_reached),
            volume_fraction_with_coating: Some(summary.volume_fraction_with_coating),
            distance_mm: summary.distance_mm,
            events: grown.map(|edmd| edmd.events),
            edmd_s: timings.edmd,
            end: grown
                .map(|edmd| edmd.stop)
                .or(report.statistics.monte_carlo.map(|monte_carlo| monte_carlo.stop)),
            properties: None,
        }
    }

    /// How a study counts the run of these figures, which ended with a packing.
    pub(crate) fn outcome_of_packing(&self) -> Outcome {
        if self.volume_fraction_reached.is_some() { Outcome::Partial } else { Outcome::Succeeded }
    }

    /// Of a run that ended without a packing after `time_s`.
    pub(crate) fn of_failure(error: &PackError, time_s: f64) -> Self {
        match error {
            PackError::TargetNotReached(reached) => Self::of_not_reached(reached, time_s),
            _ => Self { time_s, ..Self::default() },
        }
    }

    /// Of a run whose method ended before its target.
    pub(crate) fn of_not_reached(reached: &TargetNotReached, time_s: f64) -> Self {
        match reached {
            TargetNotReached::InsertionFailed(reached) => Self {
                time_s,
                grains: Some(reached.grains),
                volume_fraction_effective: Some(reached.volume_fraction_asked),
                ..Self::default()
            },
            TargetNotReached::GrowthStopped(reached) => Self {
                time_s,
                grains: Some(reached.grains),
                volume_fraction_effective: Some(reached.volume_fraction_asked),
                distance_mm: reached.distance_mm_reached,
                events: match reached.effort {
                    GrowthEffort::Events { events, .. } => Some(events),
                    GrowthEffort::Cycles { .. } => None,
                },
                end: Some(reached.end),
                ..Self::default()
            },
        }
    }
}

impl Outcome {
    /// How a study counts a run that ended without a packing. A run that was stopped by its time limit is
    /// [`Outcome::TargetNotReached`] instead, which its caller decides.
    pub(crate) fn of_failure(error: &PackError) -> Self {
        match error {
            PackError::TargetNotReached(_) => Self::TargetNotReached,
            PackError::Plan(_)
            | PackError::Stopped { .. }
            | PackError::OutOfMemory { .. }
            | PackError::CheckFailed(_) => Self::Void,
        }
    }
}
