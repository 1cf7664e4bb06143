//! Geometry of points: cell grids, tetrahedra and exact predicates.

pub mod cells;
pub mod delaunay;
