//! Shapes of grains: what a grain is before it has a position.
//!
//! A shape knows its volume, its sieve size and its support function; it knows neither specimens nor packings.

mod carlson;
mod ellipsoid;
mod form;
mod indices;
pub mod polyhedron;
mod pose;
mod quantile;
pub mod ratios;
mod sampler;
mod solid;
mod target;

pub use ellipsoid::Ellipsoid;
pub use form::{Form, SizeMeasure, Zingg};
pub use indices::{
    BodyAxis, CaliperSizes, FlakinessFraction, flakiness_fractions, flakiness_index, orientation_tensor,
    shape_index,
};
pub(crate) use polyhedron::Principal;
pub use polyhedron::{Polyhedron, PolyhedronFault, ScaledPolyhedron};
pub use pose::Pose;
pub use ratios::{AxisRatios, RatioDistribution, RatioLaw};
pub use sampler::RatioSampler;
pub use solid::{Solid, SolidRef};
