//! Shapes of grains: what a grain is before it has a position.
//!
//! A shape knows its volume, its sieve size and its support function; it knows neither specimens nor packings.

mod carlson;
mod ellipsoid;
mod form;
mod pose;

pub use ellipsoid::Ellipsoid;
pub use form::{Form, SizeMeasure, Zingg};
pub use pose::Pose;
