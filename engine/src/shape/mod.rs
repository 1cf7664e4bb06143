//! Shapes of grains: what a grain is before it has a position.
//!
//! A shape knows its volume, its sieve size and its support function; it knows neither specimens nor packings.

mod ellipsoid;
mod pose;

pub use ellipsoid::Ellipsoid;
pub use pose::Pose;
