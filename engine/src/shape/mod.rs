//! Shapes of grains: what a grain is before it has a position.
//!
//! A shape knows its volume, its sieve size and its support function; it knows neither specimens nor packings.

mod carlson;
mod ellipsoid;
mod form;
mod indices;
pub mod polyhedron;
#[cfg(test)]
pub(crate) mod polyhedron_samples;
mod pose;
mod quantile;
pub mod ratios;
mod sampler;
mod target;
mod template;

pub use ellipsoid::Ellipsoid;
pub use form::{Form, SizeMeasure, Zingg};
pub use indices::{BodyAxis, flakiness_index, orientation_tensor, shape_index};
pub use polyhedron::Polyhedron;
pub use pose::Pose;
pub use ratios::{AxisRatios, RatioDistribution, RatioLaw};
pub use sampler::RatioSampler;
pub use template::{ConvexPolyhedron, PolyhedronFault, ScaledPolyhedron};
