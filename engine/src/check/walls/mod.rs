//! Gaps between grains and walls.

pub(super) mod ellipsoid;
pub(super) mod polyhedron;
