//! Shapes of grains: what a grain is before it has a position.
//!
//! A shape knows its volume, its sieve size and its support function; it knows neither specimens nor packings.

mod carlson;
mod ellipsoid;
mod figures;
mod form;
mod indices;
mod parallel;
pub mod polyhedron;
mod pose;
mod quantile;
pub mod ratios;
mod sampler;
mod size_measure;
mod solid;
mod target;

pub use ellipsoid::Ellipsoid;
pub use figures::ShapeFigures;
pub use form::{Form, Zingg};
pub use indices::{
    BodyAxis, CaliperSizes, FlakinessFraction, flakiness_fractions, flakiness_index, orientation_tensor,
    shape_index,
};
pub use parallel::ParallelBody;
pub(crate) use polyhedron::Principal;
pub use polyhedron::{Polyhedron, PolyhedronFault, ScaledPolyhedron};
pub use pose::Pose;
pub use ratios::{AxisRatios, RatioDistribution, RatioLaw};
pub use sampler::RatioSampler;
pub use size_measure::SizeMeasure;
pub use solid::{Solid, SolidRef};

/// Volume of a sphere of diameter `d`, in the cube of the unit of `d`.
#[must_use]
pub fn sphere_volume(d: f64) -> f64 {
    std::f64::consts::FRAC_PI_6 * d * d * d
}

/// Relative error of sizes and ratios that were computed from others, which a limit must not see.
const ROUNDING: f64 = 1.0e-9;

/// Whether a positive quantity that was computed exceeds a limit by more than rounding: a grain with the ratio 3:1 is
/// not more than three times as long as thick.
pub(crate) fn exceeds(quantity: f64, limit: f64) -> bool {
    quantity > limit * (1.0 + ROUNDING)
}
