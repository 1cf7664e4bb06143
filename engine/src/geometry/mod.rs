//! Geometry that knows no grains: points, tetrahedra, exact predicates.

pub mod delaunay;
