//! Grains as geometry: what points, lines and planes meet of a grain in its place, whatever its kind.
//!
//! [`Grain`] says what a grain is to everything that measures, draws or exports a packing. Each kind of grain
//! implements it in a file of its own ([`sphere`], [`ellipsoid`], [`polyhedron`]); [`placed`] lists the kinds and holds
//! the grains of a packing. Slices, voxels, lattices, pictures and effective properties ask a grain and do not look at
//! its kind. What still does is listed in `engine/tests/layers.rs`.
//!
//! Points and directions are in mm along the axes of the specimen. Points are seen from the centre of the grain, so
//! that the images of a grain in a periodic box are the same grain about other centres.

mod below;
mod ellipsoid;
pub(crate) mod figure;
mod placed;
mod polyhedron;
mod rows;
mod sphere;

use nalgebra::{Matrix3, Vector3};

use crate::geometry::convex::Lines;
pub(crate) use below::VolumeBelow;
use figure::Figure;
pub(crate) use placed::{PlacedGrain, PlacedGrains};
pub(crate) use polyhedron::FlatFaces;
pub(crate) use rows::{RowLines, Rows};

/// A grain in its place.
pub(crate) trait Grain<'a>: Copy {
    /// Volume in mm³.
    fn volume_mm3(self) -> f64;

    /// Radius of the smallest sphere about the centre that holds the grain.
    fn outer_radius_mm(self) -> f64;

    /// Radius of a sphere about the centre within the grain.
    fn inner_radius_mm(self) -> f64;

    /// Half of the extents along x, y and z; the farther half where both differ.
    fn half_extents_mm(self) -> [f64; 3];

    /// Whether a point lies inside.
    fn contains(self, at: &Vector3<f64>) -> bool;

    /// Distance of a point from the surface; of a point inside minus a length that the surface is at least away.
    fn distance_mm(self, at: &Vector3<f64>) -> f64;

    /// Outward normal at a point of the surface, a unit vector; near the surface that of the nearby part, and zero
    /// at a centre about which all are alike.
    fn normal(self, at: &Vector3<f64>) -> Vector3<f64>;

    /// Where the line through a point along a unit vector enters the grain and leaves it; `None` where it misses.
    fn chord_mm(self, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<[f64; 2]>;

    /// Distance of the surface from the centre along a vector, which is not zero.
    fn reach_mm(self, along: &Vector3<f64>) -> f64;

    /// Distance, to first order, from a point inside to the outline of the section by the plane through it with a unit
    /// normal.
    fn to_outline_mm(self, at: &Vector3<f64>, normal: &Vector3<f64>) -> f64;

    /// The section by the plane across the last of the axes `u, v, w` at a height above the centre, and the middle of
    /// the section along `u` and `v`; `None` where the plane does not meet the grain.
    fn section(self, axes: [usize; 3], height_mm: f64) -> Option<([f64; 2], Figure)>;

    /// The section at a height above the centre as rows along x, of the grain moved to a centre. `lines` is
    /// working memory for the lines along x through the grain; with `is_aimed` it holds those of this grain already.
    fn rows<'l>(self, center_mm: [f64; 3], height_mm: f64, lines: &'l mut Lines, is_aimed: bool) -> Rows<'l>
    where
        'a: 'l;

    /// The volume below planes across an axis.
    fn volume_below(self, axis: usize) -> VolumeBelow<'a>;

    /// What the surface is, for computations that have a closed form for some surfaces.
    fn surface(self) -> Surface<'a>;
}

/// What the surface of a grain is.
#[derive(Clone, Copy)]
pub(crate) enum Surface<'a> {
    /// The points `p` with `p · M p = 1`, by the matrix `M` in 1/mm².
    Quadric(Matrix3<f64>),
    /// Flat faces.
    Flat(FlatFaces<'a>),
    /// Another surface.
    Curved,
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
