//! What a study keeps of a run, read off the engine's report or its error.

use packstone_engine::packing::Report;
use packstone_engine::{NotReached, PackError};

use super::{Facts, Outcome};
use crate::problem::Kind;

impl Facts {
    /// Of a packing.
    pub(crate) fn of(report: &Report) -> Self {
        let (summary, edmd) = (&report.summary, report.statistics.edmd);
        Self {
            time_s: report.timings_s.total,
            grains: Some(summary.grains),
            volume_fraction_effective: Some(summary.volume_fraction_effective),
            volume_fraction_with_coating: Some(summary.volume_fraction_with_coating),
            distance_mm: summary.distance_mm,
            events: edmd.map(|edmd| edmd.events),
            edmd_s: edmd.map(|_| report.timings_s.edmd),
            end: edmd.map(|edmd| edmd.stop),
        }
    }

    /// Of a run that ended without one after this time. What it had reached is no packing: of its fractions
    /// nothing is kept.
    pub(crate) fn of_failure(error: &PackError, time_s: f64) -> Self {
        let facts = Self { time_s, ..Self::default() };
        match error {
            PackError::NotReached(NotReached::NotGrown(reached)) => Self {
                grains: Some(reached.grains),
                distance_mm: reached.distance_mm_reached,
                events: Some(reached.events),
                end: Some(reached.end),
                ..facts
            },
            PackError::NotReached(NotReached::NoPlace(reached)) => {
                Self { grains: Some(reached.grains), ..facts }
            }
            _ => facts,
        }
    }
}

impl Outcome {
    /// Of a run that ended with this problem.
    pub(crate) fn of_failure(kind: Kind) -> Self {
        match kind {
            Kind::PackingNotReached | Kind::TimedOut => Self::NotReached,
            _ => Self::Void,
        }
    }

    /// Name in the store.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Succeeded => "succeeded",
            Self::NotReached => "not_reached",
            Self::Void => "void",
        }
    }

    /// The outcome of that name.
    pub(crate) fn from_name(name: &str) -> Option<Self> {
        [Self::Succeeded, Self::NotReached, Self::Void].into_iter().find(|o| o.name() == name)
    }
}
