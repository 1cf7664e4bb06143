//! Spheres as convex shapes: the nearest directions of a pair lie along the line of the centres, so that one `s(n)`
//! decides.

use std::f64::consts::PI;

use super::grain::{ConvexShape, Decision, PushContact, Turned};
use super::linear::{Symmetric, Vector, dot, norm, scaled};
use crate::shape::Pose;

/// A sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Diameter in mm.
    pub d_mm: f64,
}

/// A sphere about its centre, ready for pair tests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    radius_mm: f64,
}

impl ConvexShape for Sphere {
    type Turned = Ball;

    fn volume_mm3(&self) -> f64 {
        PI / 6.0 * self.d_mm.powi(3)
    }

    #[inline(always)]
    fn equivalent_diameter_mm(&self) -> f64 {
        self.d_mm
    }

    fn scaled(&self, factor: f64) -> Option<Self> {
        let d_mm = self.d_mm * factor;
        (d_mm > 0.0 && d_mm.is_finite()).then_some(Self { d_mm })
    }

    #[inline(always)]
    fn is_same(&self, other: &Self) -> bool {
        self == other
    }

    #[inline(always)]
    fn is_similar(&self, _: &Self) -> bool {
        true
    }

    #[inline(always)]
    fn outer_mm(&self) -> f64 {
        self.d_mm / 2.0
    }

    #[inline(always)]
    fn inner_mm(&self) -> f64 {
        self.d_mm / 2.0
    }

    #[inline(always)]
    fn inside_mm(&self) -> Vector {
        [self.d_mm / 2.0; 3]
    }

    #[inline(always)]
    fn around_mm(&self) -> Vector {
        [self.d_mm / 2.0; 3]
    }

    #[inline(always)]
    fn change_mm(&self, _: f64) -> f64 {
        0.0
    }

    #[inline(always)]
    fn per_inertia(&self, per_mass: f64) -> Vector {
        [10.0 * per_mass / (self.d_mm * self.d_mm); 3]
    }

    #[inline(always)]
    fn rows(&self, _: &Pose) -> [Vector; 3] {
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    }

    #[inline(always)]
    fn turned(&self, _: &[Vector; 3]) -> Ball {
        Ball { radius_mm: self.d_mm / 2.0 }
    }
}

impl Turned for Ball {
    const IS_ELLIPSOID: bool = true;
    const IS_SPHERE: bool = true;

    #[inline(always)]
    fn around(&self) -> Symmetric {
        let square = self.radius_mm * self.radius_mm;
        Symmetric([square, 0.0, 0.0, square, 0.0, square])
    }

    #[inline(always)]
    fn support_mm(&self, n: Vector) -> f64 {
        self.radius_mm * norm(n)
    }

    #[inline(always)]
    fn support_back_mm(&self, n: Vector) -> f64 {
        self.radius_mm * norm(n)
    }

    #[inline(always)]
    fn decide(&self, other: &Self, r: Vector, gap_mm: f64, _: Vector) -> Decision {
        let normal = scaled(r, 1.0 / norm(r));
        let is_apart = dot(r, normal) - self.radius_mm - other.radius_mm >= gap_mm;
        Decision { is_apart, normal }
    }

    #[inline(always)]
    fn first_direction(&self, _: &Self, r: Vector) -> Vector {
        r
    }

    #[inline(always)]
    fn contact(&self, other: &Self, _: Vector, _: f64, normal: Vector, _: u32) -> PushContact {
        PushContact {
            normal,
            supports_mm: [self.radius_mm, other.radius_mm],
            arms_mm: [scaled(normal, self.radius_mm), scaled(normal, -other.radius_mm)],
        }
    }

    fn reach_across_mm(&self, [x, y]: [f64; 2]) -> (f64, Vector) {
        let from_axis = norm([x, y, 0.0]);
        let direction = if from_axis > 0.0 { [x / from_axis, y / from_axis, 0.0] } else { [1.0, 0.0, 0.0] };
        (from_axis + self.radius_mm, direction)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::properties::properties;
    use crate::shape::Ellipsoid;

    const ROWS: [Vector; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    properties! {
        /// A sphere is the ellipsoid of equal semi-axes, to every question.
        #[test]
        fn spheres_answer_as_ellipsoids_of_equal_axes(
            diameters in [0.1..10.0, 0.1..10.0_f64],
            r in [-8.0..8.0, -8.0..8.0, -8.0..8.0_f64],
            gap in 0.0..2.0_f64,
        ) {
            prop_assume!(norm(r) > 1e-3);
            let spheres = diameters.map(|d_mm| Sphere { d_mm });
            let balls = spheres.map(|sphere| sphere.turned(&ROWS));
            let ellipsoids = diameters.map(|d| Ellipsoid::new([d / 2.0; 3]));
            let [Some(a), Some(b)] = ellipsoids else { return Err(TestCaseError::fail("no ellipsoid")) };
            let turned = [a, b].map(|ellipsoid| ConvexShape::turned(&ellipsoid, &ROWS));
            let excess = norm(r) - (diameters[0] + diameters[1]) / 2.0 - gap;
            prop_assume!(excess.abs() > 1e-9);
            let decision = balls[0].decide(&balls[1], r, gap, [0.0, 0.0, 1.0]);
            prop_assert_eq!(decision.is_apart, excess > 0.0);
            prop_assert_eq!(turned[0].decide(&turned[1], r, gap, r).is_apart, excess > 0.0);
            prop_assert!((spheres[0].volume_mm3() / ConvexShape::volume_mm3(&a) - 1.0).abs() < 1e-12);
            let along = scaled(r, 1.0 / norm(r));
            prop_assert!((balls[0].support_mm(r) - turned[0].support_mm(r)).abs() < 1e-9);
            let one = balls[0].contact(&balls[1], r, gap, along, 1);
            let other = turned[0].contact(&turned[1], r, gap, along, 1);
            for k in 0..3 {
                prop_assert!((one.arms_mm[0][k] - other.arms_mm[0][k]).abs() < 1e-9);
                prop_assert!((one.arms_mm[1][k] - other.arms_mm[1][k]).abs() < 1e-9);
            }
            let (reach, direction) = balls[0].reach_across_mm([r[0], r[1]]);
            prop_assert!((reach - norm([r[0], r[1], 0.0]) - diameters[0] / 2.0).abs() < 1e-12);
            prop_assert!((norm(direction) - 1.0).abs() < 1e-12);
        }
    }
}
