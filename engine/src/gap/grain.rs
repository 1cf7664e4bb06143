//! What packing methods ask of a shape, whatever its kind: static dispatch to [`super::ellipsoids`], and to
//! [`super::solids`] for polyhedra, alone or among ellipsoids.
//!
//! A grain turns about its centre with its principal axes, the longest first. [`ConvexShape`] is the grain as it lies
//! in these axes, [`Turned`] what pair tests read once it is turned.

use std::fmt::Debug;

use super::linear::{Symmetric, Vector};
use crate::arrays::Each as _;
use crate::shape::Pose;

/// Whether a pair keeps a gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// Whether `s(n) >= g` for the unit vector along `normal`.
    pub is_apart: bool,
    /// The last direction that was looked at, from A to B, of any length.
    pub normal: Vector,
}

/// Where two grains that are too close push each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PushContact {
    /// The unit vector along which they push, from A to B.
    pub normal: Vector,
    /// Values of the support functions, of A along it and of B against it, in mm.
    pub supports_mm: [f64; 2],
    /// From the centres to the points where they push, in mm.
    pub arms_mm: [Vector; 2],
}

/// Quaternions as w, x, y, z.
pub type Orientation = [f64; 4];

/// A shape of grains: an ellipsoid or a convex polyhedron whose origin lies inside.
pub trait ConvexShape: Copy + Debug + Send + Sync {
    /// The shape, turned.
    type Turned: Turned;

    /// Volume in mm³.
    fn volume_mm3(&self) -> f64;

    /// Diameter of the sphere of equal volume in mm.
    fn equivalent_diameter_mm(&self) -> f64;

    /// The shape with all lengths multiplied; `None` where the factor leaves no shape.
    fn scaled(&self, factor: f64) -> Option<Self>;

    /// Whether nothing changes where one takes the place of the other.
    fn is_same(&self, other: &Self) -> bool;

    /// Whether both are the same but for their size.
    fn is_similar(&self, other: &Self) -> bool;

    /// Radius of a sphere around the centre that holds the shape, in mm.
    fn outer_mm(&self) -> f64;

    /// Radius of a sphere around the centre that the shape holds, in mm.
    fn inner_mm(&self) -> f64;

    /// Semi-axes of an ellipsoid along the principal axes that the shape holds, from the longest down, in mm.
    fn inside_mm(&self) -> Vector;

    /// Semi-axes of an ellipsoid along the principal axes that holds the shape, in mm.
    fn around_mm(&self) -> Vector;

    /// The most that the support function changes under a rotation by an angle, in mm.
    fn change_mm(&self, angle: f64) -> f64;

    /// One over the moments of inertia about the principal axes, by one over the mass.
    fn per_inertia(&self, per_mass: f64) -> Vector;

    /// The rotation of the principal axes at a pose, by rows. By default the axes of the shape are principal.
    #[inline(always)]
    fn rows(&self, pose: &Pose) -> [Vector; 3] {
        let r = pose.rotation();
        [0, 1, 2].each(|i| [r[(i, 0)], r[(i, 1)], r[(i, 2)]])
    }

    /// The orientation of the principal axes, of that of the shape.
    #[inline(always)]
    fn to_principal(&self, orientation: Orientation) -> Orientation {
        orientation
    }

    /// The orientation of the shape, of that of the principal axes.
    #[inline(always)]
    fn of_principal(&self, orientation: Orientation) -> Orientation {
        orientation
    }

    /// The shape turned by the rotation of its principal axes.
    fn turned(&self, rows: &[Vector; 3]) -> Self::Turned;
}

/// A turned shape about its centre.
pub trait Turned: Copy + Debug + Send + Sync {
    /// Whether the body is the ellipsoid around it.
    const IS_ELLIPSOID: bool;

    /// Whether the body is a sphere: a rotation changes nothing, and gaps lie along the line of the centres.
    const IS_SPHERE: bool = false;

    /// Whether this body is a sphere, among others that need not be.
    #[inline(always)]
    fn is_sphere(&self) -> bool {
        Self::IS_SPHERE
    }

    /// Shape matrix of an ellipsoid that holds the body, in mm².
    fn around(&self) -> Symmetric;

    /// Support function in mm along a unit vector; along a longer one times its length.
    fn support_mm(&self, n: Vector) -> f64;

    /// The same against the vector.
    fn support_back_mm(&self, n: Vector) -> f64;

    /// Whether the body and another one, whose centre lies at `r` from its own, keep a gap that is not negative, from a
    /// direction that may be near the one that decides.
    fn decide(&self, other: &Self, r: Vector, gap_mm: f64, normal: Vector) -> Decision;

    /// A direction from which to decide a pair that nothing is known of.
    fn first_direction(&self, other: &Self, r: Vector) -> Vector;

    /// Where the two, which are too close along a unit vector, push each other. A polyhedron looks for a better
    /// direction `turns` times.
    fn contact(&self, other: &Self, r: Vector, gap_mm: f64, normal: Vector, turns: u32) -> PushContact;

    /// With the centre at this offset from an axis along z: the distance of the farthest point from the axis in mm, and
    /// the direction to it across the axis.
    fn reach_across_mm(&self, from_axis_mm: [f64; 2]) -> (f64, Vector);
}
