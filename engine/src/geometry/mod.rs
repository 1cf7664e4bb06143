//! Geometry: cell grids, periodic images, tetrahedra and exact predicates of points, and rounded polyhedra.

pub mod cells;
pub(crate) mod convex;
pub mod delaunay;
pub(crate) mod images;
