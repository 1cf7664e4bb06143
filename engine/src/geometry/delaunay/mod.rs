//! The Delaunay tetrahedralisation of points in space, exact and in one canonical form.
//!
//! Incremental insertion (Bowyer and Watson) with a vertex at infinity for the hull, exact predicates and a
//! perturbation for points on a common sphere, so that coplanar faces and lattices are cases like any other.
//! Bowyer (1981), DOI 10.1093/comjnl/24.2.162, and Watson (1981), DOI 10.1093/comjnl/24.2.167; the predicates are
//! those of Shewchuk (1997), DOI 10.1007/PL00009321, by way of the crate `robust`.
//!
//! ```
//! use packstone_engine::{Unattended, geometry::delaunay::{NONE, delaunay}};
//!
//! let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
//! let made = delaunay(&points, &Unattended)?;
//! assert_eq!(made.nodes, [[0, 1, 2, 3]]);
//! assert_eq!(made.neighbors, [[NONE; 4]]);
//! # Ok::<(), packstone_engine::geometry::delaunay::DelaunayError>(())
//! ```

mod build;
mod canonical;
mod order;
mod predicates;
pub mod topology;

#[cfg(test)]
mod tests;

use thiserror::Error;

use crate::control::{Control, Progress, Step};
use crate::memory::OutOfMemory;

pub use predicates::{inside_circumsphere, orientation};

/// No tetrahedron: what is beyond a face of the hull.
pub const NONE: u32 = u32::MAX;

/// The nodes of the face opposite each node of a tetrahedron, counter-clockwise seen from outside it.
pub const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// Coordinates beyond this, and those other than zero below its inverse, are refused: the exact predicates
/// multiply five of them, and must neither overflow nor lose the last bit.
pub const LARGEST_MM: f64 = 1e35;

/// The tetrahedra of some points. They fill the convex hull, every point is a node of some, and no point
/// lies inside the circumsphere of any.
///
/// Where more than four points lie on a common empty sphere, there are several such tetrahedralisations;
/// this is the one that results when the points are lifted a little, each by far more than all those that
/// come before it in the lexicographic order of coordinates. So it depends on the points alone, not on
/// their numbers; these only name the nodes and sort the tetrahedra.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Delaunay {
    /// Four nodes each, `det(x2 - x1, x3 - x1, x4 - x1) > 0`: in ascending order, but for the last two
    /// where orientation asks for it. The tetrahedra are in lexicographic order of these.
    pub nodes: Vec<[u32; 4]>,
    /// The tetrahedron across the face opposite each node; [`NONE`] on the hull.
    pub neighbors: Vec<[u32; 4]>,
}

/// Why there is no tetrahedralisation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum DelaunayError {
    /// Fewer than four points.
    #[error("{points} points make no tetrahedron; at least four are needed")]
    TooFew {
        /// How many there are.
        points: usize,
    },
    /// All points lie in one plane.
    #[error("all points lie in one plane")]
    Coplanar,
    /// Two points are the same.
    #[error("points {first} and {second} are the same")]
    Duplicate {
        /// Number of the one point.
        first: u32,
        /// Number of the other, larger.
        second: u32,
    },
    /// A coordinate that is not finite, or so large or small that exact arithmetic would not be exact.
    #[error(
        "point {point} has a coordinate that is not a number between {LARGEST_MM:e} mm and its inverse in magnitude, or 0"
    )]
    Coordinate {
        /// Number of the point.
        point: u32,
    },
    /// More points or tetrahedra than numbers of 32 bits can name.
    #[error("more than {} tetrahedra", build::MOST_SLOTS)]
    TooMany,
    /// [`Control::should_stop`] said so.
    #[error("stopped")]
    Stopped,
    /// The system refused memory.
    #[error("out of memory: the tetrahedra need {} MB more", .bytes.div_ceil(1_000_000))]
    OutOfMemory {
        /// Bytes of the allocation that was refused.
        bytes: u64,
    },
}

impl From<OutOfMemory> for DelaunayError {
    fn from(OutOfMemory { bytes }: OutOfMemory) -> Self {
        Self::OutOfMemory { bytes }
    }
}

/// Memory that [`delaunay`] takes for so many points at its peak, what it returns included, where they are
/// spread like grains. Points on two curves can make tetrahedra by the square of their number.
pub fn memory_bytes(points: u64) -> u64 {
    300 * points
}

/// The Delaunay tetrahedralisation. Its fraction of progress runs from 0 to 1.
///
/// # Errors
/// [`DelaunayError`].
pub fn delaunay(points_mm: &[[f64; 3]], control: &dyn Control) -> Result<Delaunay, DelaunayError> {
    check(points_mm)?;
    let order = order::insertion_order(points_mm)?;
    go_on(control)?;
    let raw = build::build(points_mm, order, control)?;
    let made = canonical::canonical(raw, control)?;
    report(control, 1.0, points_mm.len(), points_mm.len());
    Ok(made)
}

fn check(points_mm: &[[f64; 3]]) -> Result<(), DelaunayError> {
    if points_mm.len() < 4 {
        return Err(DelaunayError::TooFew { points: points_mm.len() });
    }
    if points_mm.len() > build::MOST_SLOTS as usize {
        return Err(DelaunayError::TooMany);
    }
    let fits = |x: f64| x == 0.0 || (x.abs() <= LARGEST_MM && x.abs() >= 1.0 / LARGEST_MM);
    match points_mm.iter().position(|p| !p.iter().all(|&x| fits(x))) {
        Some(point) => Err(DelaunayError::Coordinate { point: point as u32 }),
        None => Ok(()),
    }
}

fn go_on(control: &dyn Control) -> Result<(), DelaunayError> {
    if control.should_stop() { Err(DelaunayError::Stopped) } else { Ok(()) }
}

/// Tells how many points are in, and the share of the time that is spent.
fn report(control: &dyn Control, fraction: f64, done: usize, total: usize) {
    let counted = Progress::counted(Step::Export, done, total, "points", "Delaunay tetrahedralisation");
    control.report(&Progress { fraction, ..counted });
}
