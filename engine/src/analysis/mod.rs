//! What engineers look for in a packing beyond its check: the grading it came out with, how close grains
//! stand, how a wall thins them out, how far sizes are apart, and whether the packing is random.
//!
//! Pure functions over the grains of a packing and a [`Specimen`](crate::request::Specimen), for whoever draws or
//! tabulates them. They judge nothing: whether a packing is valid is [`crate::check`]'s question.

pub mod depth_profile;
pub mod grading;
mod neighbors;
pub mod quality;
pub mod radial;
mod separation;
pub(crate) mod shapes;

pub use depth_profile::{DepthProfile, Surface, depth_profiles};
pub use grading::{GradingCurve, GradingPoint, SizedGrain, grading};
pub use quality::{QualityError, QualityReport, quality};
pub use radial::{PairCorrelation, RadialOptions, SizeRange, radial};
pub use separation::separation;
pub use shapes::{MeasuredGrain, measured_grains, shape_report};

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod shaped_tests;
#[cfg(test)]
mod tests;
