//! Geometry of points: tetrahedra and exact predicates.

pub mod delaunay;
