//! What can go wrong between a request and a packing.

use crate::memory::OutOfMemory;
use crate::packing::GrowthEnd;
use crate::request::{Amount, FieldError};

/// Why a plan cannot be made: always something the user can change.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// A field contradicts another (a grain larger than the specimen).
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Invalid(Vec<FieldError>),
    /// More grains or memory than the limits allow.
    #[error("{0}")]
    TooLarge(FieldError),
    /// No arrangement of spheres reaches what is requested.
    #[error("{0}")]
    Infeasible(FieldError),
    /// Whole grains miss the requested total volume by more than [`crate::mix::MAX_DEVIATION`].
    #[error("{0}")]
    Coarse(FieldError),
}

/// Why a run ended without a packing.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PackError {
    /// The request cannot be planned.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// [`crate::Control::should_stop`] said so.
    #[error("stopped on request after {placed} of {grains} grains")]
    Stopped {
        /// Grains placed so far.
        placed: u64,
        /// Grains of the mix.
        grains: u64,
    },
    /// The method came to its end before the target. An answer, not a fault.
    #[error("{0}")]
    TargetNotReached(TargetNotReached),
    /// The system refused memory that the run needs.
    #[error("out of memory: the run needs {} MB more", .bytes.div_ceil(1_000_000))]
    OutOfMemory {
        /// Bytes of the allocation that was refused.
        bytes: u64,
    },
    /// The independent check refused the packing: a defect of this program.
    #[error("the packing failed its check: {0}")]
    CheckFailed(String),
}

impl From<OutOfMemory> for PackError {
    fn from(OutOfMemory { bytes }: OutOfMemory) -> Self {
        Self::OutOfMemory { bytes }
    }
}

/// How far a method came that did not reach its target.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TargetNotReached {
    /// Random sequential addition found no place for a grain.
    #[error(transparent)]
    InsertionFailed(InsertionFailed),
    /// The grains did not grow to their size and distance.
    #[error(transparent)]
    GrowthStopped(GrowthStopped),
}

/// How far random sequential addition came.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub struct InsertionFailed {
    /// Grains placed.
    pub placed: u64,
    /// Grains of the mix.
    pub grains: u64,
    /// Diameter of the grain that found no place.
    pub diameter_mm: f64,
    /// Volume fraction of the grains placed (`phi_eff`).
    pub volume_fraction_reached: f64,
    /// Volume fraction asked for (`phi_eff`).
    pub volume_fraction_asked: f64,
    /// Whether it is proven that the grain has no place, rather than none found.
    pub saturation_proven: bool,
    /// Attempts spent on that grain.
    pub attempts: u64,
    /// What says how much aggregate the request has.
    pub amount: Amount,
}

/// Words of advice: how to have less of a mix.
fn less_of(amount: Amount, has_distance: bool) -> &'static str {
    match (amount, has_distance) {
        (Amount::Volume, false) => "lower the volume fraction",
        (Amount::Volume, true) => "lower the volume fraction or the distance",
        (Amount::Count, false) => "lower mix.count, take a larger specimen",
        (Amount::Count, true) => "lower mix.count or the distance, take a larger specimen",
        (Amount::List, false) => "list fewer or smaller diameters, take a larger specimen",
        (Amount::List, true) => "list fewer or smaller diameters, take a larger specimen, lower the distance",
    }
}

impl std::fmt::Display for InsertionFailed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "placed {} of {} grains (volume fraction {:.4} of {:.4}): ",
            self.placed, self.grains, self.volume_fraction_reached, self.volume_fraction_asked
        )?;
        if self.saturation_proven {
            write!(f, "it is proven that no place is left for a grain of {:.4} mm", self.diameter_mm)?;
        } else {
            write!(
                f,
                "no place found for a grain of {:.4} mm in {} attempts; it is not proven that there is none",
                self.diameter_mm, self.attempts
            )?;
        }
        let less = less_of(self.amount, false);
        write!(f, "; grow the grains instead (method \"growth\"), {less}, or try another seed")?;
        if self.placed > 0 {
            write!(f, "; on_limit \"keep\" keeps the grains that were placed")?;
        }
        Ok(())
    }
}

/// What a run that grew grains took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GrowthEffort {
    /// Event-driven molecular dynamics.
    Events {
        /// Events of the run.
        events: u64,
        /// Simulated time of the run.
        simulated_time_s: f64,
    },
    /// Hard-particle Monte Carlo.
    Cycles {
        /// Compression cycles.
        cycles: u64,
        /// Moves tried.
        moves: u64,
    },
}

/// How far growth came.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub struct GrowthStopped {
    /// Grains of the mix.
    pub grains: u64,
    /// Volume fraction of the grains at the size they reached (`phi_eff`).
    pub volume_fraction_reached: f64,
    /// Volume fraction asked for (`phi_eff`).
    pub volume_fraction_asked: f64,
    /// Constant distance reached, where one was asked for.
    pub distance_mm_reached: Option<f64>,
    /// Constant distance asked for.
    pub distance_mm_asked: Option<f64>,
    /// Size reached over size asked for, the distance included.
    pub scale_reached: f64,
    /// What the run took.
    pub effort: GrowthEffort,
    /// What ended the run.
    pub end: GrowthEnd,
    /// What says how much aggregate the request has.
    pub amount: Amount,
}

impl std::fmt::Display for GrowthStopped {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "growth stopped at {:.4} of the final diameters (volume fraction {:.4} of {:.4}",
            self.scale_reached, self.volume_fraction_reached, self.volume_fraction_asked
        )?;
        if let (Some(reached), Some(asked)) = (self.distance_mm_reached, self.distance_mm_asked) {
            write!(f, ", distance {reached:.4} of {asked:.4} mm")?;
        }
        match self.effort {
            GrowthEffort::Events { events, simulated_time_s } => {
                write!(f, ") after {events} events and {simulated_time_s:.3} s of simulated time: ")?;
            }
            GrowthEffort::Cycles { cycles, moves } => {
                write!(f, ") after {cycles} compression cycles and {moves} moves: ")?;
            }
        }
        let less = less_of(self.amount, self.distance_mm_asked.is_some());
        match self.end {
            GrowthEnd::Stalled => {
                write!(f, "it stalled, for the grains jam before their target; {less}, or try another seed")?;
                if matches!(self.effort, GrowthEffort::Events { .. }) {
                    write!(f, " or a lower growth_rate")?;
                }
            }
            GrowthEnd::TimeLimit => write!(f, "the time limit was reached; raise stop.time_s, or {less}")?,
            GrowthEnd::EventLimit => write!(f, "the event limit was reached; raise stop.events, or {less}")?,
            GrowthEnd::SweepLimit => write!(f, "the sweep limit was reached; raise stop.sweeps, or {less}")?,
            GrowthEnd::Target => write!(f, "it ended short of its target; {less}")?,
            GrowthEnd::Finished => {
                write!(f, "it was to finish, and no scale of the sizes keeps the distance")?;
            }
            GrowthEnd::NoStart => {
                write!(f, "random addition found no start, with grains of any smaller size; {less}")?;
            }
        }
        if self.volume_fraction_reached > 0.0 {
            write!(f, "; on_limit \"keep\" keeps the packing that was reached")?;
            if self.amount == Amount::List {
                write!(f, ", and mix.volume_fraction \"maximize\" scales the list to the densest packing")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grain_without_a_place_is_said_to_be_proven_so_or_not() {
        let said_of = |saturation_proven: bool, placed: u64| {
            let failed = InsertionFailed {
                placed,
                grains: 1 + placed,
                diameter_mm: 5.0,
                volume_fraction_reached: 0.0,
                volume_fraction_asked: 0.25,
                saturation_proven,
                attempts: 20_000_000,
                amount: Amount::Volume,
            };
            failed.to_string()
        };
        let said = |saturation_proven: bool| said_of(saturation_proven, 0);
        let start = "placed 0 of 1 grains (volume fraction 0.0000 of 0.2500): ";
        let proven = format!("{start}it is proven that no place is left for a grain of 5.0000 mm");
        assert!(said(true).starts_with(&proven), "{}", said(true));
        let open = format!(
            "{start}no place found for a grain of 5.0000 mm in 20000000 attempts; it is not proven that there is none"
        );
        assert!(said(false).starts_with(&open), "{}", said(false));
        // What is not there cannot be kept.
        assert!(!said(true).contains("on_limit") && !said(false).contains("on_limit"));
        assert!(said_of(true, 7).ends_with("; on_limit \"keep\" keeps the grains that were placed"));
    }

    #[test]
    fn growth_that_ended_early_says_how_far_it_came_and_what_to_change() {
        let not_grown = GrowthStopped {
            grains: 9307,
            volume_fraction_reached: 0.6981,
            volume_fraction_asked: 0.7,
            distance_mm_reached: None,
            distance_mm_asked: None,
            scale_reached: 0.99909,
            effort: GrowthEffort::Events { events: 12_000_000, simulated_time_s: 2.5 },
            end: GrowthEnd::Stalled,
            amount: Amount::Volume,
        };
        assert_eq!(
            TargetNotReached::GrowthStopped(not_grown.clone()).to_string(),
            "growth stopped at 0.9991 of the final diameters (volume fraction 0.6981 of 0.7000) after 12000000 events \
             and 2.500 s of simulated time: it stalled, for the grains jam before their target; lower the volume \
             fraction, or try another seed or a lower growth_rate; on_limit \"keep\" keeps the packing that was reached"
        );
        let limited = GrowthStopped {
            distance_mm_reached: Some(0.92),
            distance_mm_asked: Some(1.0),
            end: GrowthEnd::TimeLimit,
            ..not_grown
        };
        let no_start = GrowthStopped {
            volume_fraction_reached: 0.0,
            scale_reached: 0.0,
            effort: GrowthEffort::Events { events: 0, simulated_time_s: 0.0 },
            end: GrowthEnd::NoStart,
            ..limited.clone()
        };
        let said = no_start.to_string();
        assert!(said.contains("random addition found no start, with grains of any smaller size"), "{said}");
        let said = limited.to_string();
        assert!(said.contains("distance 0.9200 of 1.0000 mm"), "{said}");
        assert!(said.contains("raise stop.time_s, or lower the volume fraction or the distance;"), "{said}");
    }

    #[test]
    fn advice_fits_a_request_that_lists_its_diameters() {
        let failed = InsertionFailed {
            placed: 7,
            grains: 9,
            diameter_mm: 2.0,
            volume_fraction_reached: 0.5,
            volume_fraction_asked: 0.6,
            saturation_proven: true,
            attempts: 3,
            amount: Amount::List,
        };
        for said in [failed.to_string(), TargetNotReached::InsertionFailed(failed.clone()).to_string()] {
            assert!(!said.contains("lower the volume fraction"), "{said}");
            assert!(said.contains("list fewer or smaller diameters"), "{said}");
            assert!(said.contains("method \"growth\"") && said.contains("on_limit \"keep\""), "{said}");
        }
        let counted = InsertionFailed { amount: Amount::Count, ..failed }.to_string();
        assert!(counted.contains("lower mix.count") && !counted.contains("volume fraction,"), "{counted}");
    }
}
