//! What can go wrong between a request and a packing.

use crate::request::FieldError;

/// Why a plan cannot be made: always something the user can change.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// A field contradicts another (a grain larger than the specimen).
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Invalid(Vec<FieldError>),
    /// More grains or memory than the limits allow.
    #[error("{0}")]
    TooLarge(FieldError),
    /// No arrangement of spheres reaches what is asked for.
    #[error("{0}")]
    Infeasible(FieldError),
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
    NotReached(NotReached),
    /// The independent check refused the packing: a defect of this program.
    #[error("the packing failed its check: {0}")]
    CheckFailed(String),
}

/// How far a method came that did not reach its target.
#[derive(Clone, Debug, PartialEq)]
pub struct NotReached {
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
    pub proven: bool,
    /// Attempts spent on that grain.
    pub attempts: u64,
}

impl std::fmt::Display for NotReached {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "placed {} of {} grains (volume fraction {:.4} of {:.4}): ",
            self.placed, self.grains, self.volume_fraction_reached, self.volume_fraction_asked
        )?;
        if self.proven {
            write!(f, "it is proven that no place is left for a grain of {:.4} mm", self.diameter_mm)
        } else {
            write!(
                f,
                "no place found for a grain of {:.4} mm in {} attempts",
                self.diameter_mm, self.attempts
            )
        }
    }
}
