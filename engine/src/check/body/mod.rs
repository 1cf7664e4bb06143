//! Grains as the check sees them, computed from the stored numbers alone.

mod ellipsoid;
mod polyhedron;

pub(super) use ellipsoid::Ellipsoid;
pub(super) use polyhedron::Polyhedron;
