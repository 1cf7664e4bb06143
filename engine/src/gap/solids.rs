//! Bodies of either kind: gaps of any two shaped grains, and both kinds as grains of packing methods.
//!
//! A pair of one kind is decided as [`super::ellipsoids`] and [`super::polyhedra`] do. For an ellipsoid and a
//! polyhedron the direction comes from the algorithm of Gilbert, Johnson and Keerthi on differences of a vertex and a
//! point of the ellipsoid; its steps converge to the direction of the gap instead of ending there. What counts is
//! `s(n) >= g`, as for all pairs: a pair that is undecided after the last step is too close.

use super::ellipsoids::{self, Gap};
use super::grain::{ConvexShape, Decision, Orientation, PushContact, Turned};
use super::linear::{Symmetric, Vector, norm, scaled};
use super::polyhedra::{self, Contact, Core, Pair, TurnedPolyhedron};
use super::spheres::{Ball, Sphere};
use super::walls;
use crate::arrays::Each as _;
use crate::request::Specimen;
use crate::shape::{Ellipsoid, Pose, SolidRef};

/// A grain in its place.
#[derive(Clone, Copy, Debug)]
pub enum Body<'a> {
    /// An ellipsoid.
    Ellipsoid(ellipsoids::Body),
    /// A convex polyhedron.
    Polyhedron(polyhedra::Body<'a>),
}

impl<'a> Body<'a> {
    /// A shape at a pose.
    #[must_use]
    pub fn new(shape: SolidRef<'a>, pose: &Pose) -> Self {
        match shape {
            SolidRef::Ellipsoid(ellipsoid) => Self::Ellipsoid(ellipsoids::Body::new(&ellipsoid, pose)),
            SolidRef::Polyhedron(polyhedron) => {
                Self::Polyhedron(polyhedra::Body::new(polyhedron.template, polyhedron.scale_mm, pose))
            }
        }
    }

    /// The ellipsoid, where it is one.
    #[must_use]
    pub fn ellipsoid(&self) -> Option<&ellipsoids::Body> {
        match self {
            Self::Ellipsoid(body) => Some(body),
            Self::Polyhedron(_) => None,
        }
    }

    /// Centre in mm.
    #[must_use]
    pub fn center_mm(&self) -> Vector {
        match self {
            Self::Ellipsoid(body) => body.center_mm,
            Self::Polyhedron(body) => body.center_mm.into(),
        }
    }

    /// Radius of the sphere around the centre that holds the body, in mm.
    #[must_use]
    pub fn outer_mm(&self) -> f64 {
        match self {
            Self::Ellipsoid(body) => body.outer_mm,
            Self::Polyhedron(body) => body.outer_mm,
        }
    }

    /// Smallest clear distance to the walls in mm, negative where the body reaches beyond one; infinite without walls.
    #[must_use]
    pub fn wall_gap_mm(&self, specimen: &Specimen) -> f64 {
        match self {
            Self::Ellipsoid(body) => body.wall_gap_mm(specimen),
            Self::Polyhedron(body) => {
                walls::wall_gap_mm(body.center_mm.into(), &body.turned, &specimen.domain())
            }
        }
    }

    /// Whether this body and another keep a gap that is not negative.
    #[must_use]
    pub fn is_apart(&self, other: &Self, gap_mm: f64) -> bool {
        match (self, other) {
            (Self::Ellipsoid(a), Self::Ellipsoid(b)) => a.with(b).decide(gap_mm).is_apart,
            (Self::Polyhedron(a), Self::Polyhedron(b)) => a.with(b).decide(gap_mm).is_apart,
            (Self::Ellipsoid(a), Self::Polyhedron(b)) => of_both(a, b).decide(gap_mm).is_apart,
            (Self::Polyhedron(a), Self::Ellipsoid(b)) => of_both(b, a).decide(gap_mm).is_apart,
        }
    }

    /// The gap of this body and another, or the least depth to which they overlap.
    #[must_use]
    pub fn contact(&self, other: &Self) -> Contact {
        match (self, other) {
            (Self::Ellipsoid(a), Self::Ellipsoid(b)) => {
                let Gap { gap_mm, normal } = a.with(b).gap();
                let [on_a, on_b] = [a, b].each(|body| body.matrix_mm2.core_support(&normal.into()).1);
                Contact { gap_mm, normal: normal.into(), points_mm: [on_a, -on_b] }
            }
            (Self::Polyhedron(a), Self::Polyhedron(b)) => a.with(b).contact(),
            (Self::Ellipsoid(a), Self::Polyhedron(b)) => of_both(a, b).contact(),
            (Self::Polyhedron(a), Self::Ellipsoid(b)) => {
                let Contact { gap_mm, normal, points_mm: [on_b, on_a] } = of_both(b, a).contact();
                Contact { gap_mm, normal: -normal, points_mm: [on_a, on_b] }
            }
        }
    }
}

fn of_both<'a>(
    a: &'a ellipsoids::Body,
    b: &'a polyhedra::Body<'a>,
) -> Pair<'a, Symmetric, TurnedPolyhedron<'a>> {
    let r = b.center_mm - nalgebra::Vector3::from(a.center_mm);
    Pair { a: &a.matrix_mm2, b: &b.turned, r }
}

/// A grain of either kind, turned.
#[derive(Clone, Copy, Debug)]
pub enum TurnedSolid<'a> {
    /// A sphere, which most grains of a mixture may be.
    Ball(Ball),
    /// An ellipsoid by its shape matrix.
    Ellipsoid(Symmetric),
    /// A polyhedron.
    Polyhedron(TurnedPolyhedron<'a>),
}

/// Dispatches to the shape of either kind.
macro_rules! of_shape {
    ($of:expr, $shape:ident => $value:expr) => {
        match $of {
            SolidRef::Ellipsoid($shape) => $value,
            SolidRef::Polyhedron($shape) => $value,
        }
    };
}

/// Dispatches to the turned shape of either kind.
macro_rules! of_turned {
    ($of:expr, $turned:ident => $value:expr) => {
        match $of {
            TurnedSolid::Ball($turned) => $value,
            TurnedSolid::Ellipsoid($turned) => $value,
            TurnedSolid::Polyhedron($turned) => $value,
        }
    };
}

impl<'a> ConvexShape for SolidRef<'a> {
    type Turned = TurnedSolid<'a>;

    fn volume_mm3(&self) -> f64 {
        self.volume_mm3()
    }

    fn equivalent_diameter_mm(&self) -> f64 {
        self.equivalent_diameter_mm()
    }

    fn scaled(&self, factor: f64) -> Option<Self> {
        match self {
            Self::Ellipsoid(shape) => shape.scaled(factor).map(Self::Ellipsoid),
            Self::Polyhedron(shape) => shape.scaled(factor).map(Self::Polyhedron),
        }
    }

    #[inline(always)]
    fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Ellipsoid(one), Self::Ellipsoid(other)) => one.is_same(other),
            (Self::Polyhedron(one), Self::Polyhedron(other)) => one.is_same(other),
            _ => false,
        }
    }

    #[inline(always)]
    fn is_similar(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Ellipsoid(one), Self::Ellipsoid(other)) => one.is_similar(other),
            (Self::Polyhedron(one), Self::Polyhedron(other)) => one.is_similar(other),
            _ => false,
        }
    }

    #[inline(always)]
    fn outer_mm(&self) -> f64 {
        of_shape!(self, shape => shape.outer_mm())
    }

    #[inline(always)]
    fn inner_mm(&self) -> f64 {
        of_shape!(self, shape => shape.inner_mm())
    }

    #[inline(always)]
    fn inside_mm(&self) -> Vector {
        of_shape!(self, shape => shape.inside_mm())
    }

    #[inline(always)]
    fn around_mm(&self) -> Vector {
        of_shape!(self, shape => shape.around_mm())
    }

    #[inline(always)]
    fn change_mm(&self, angle: f64) -> f64 {
        of_shape!(self, shape => shape.change_mm(angle))
    }

    #[inline(always)]
    fn per_inertia(&self, per_mass: f64) -> Vector {
        of_shape!(self, shape => shape.per_inertia(per_mass))
    }

    #[inline(always)]
    fn rows(&self, pose: &Pose) -> [Vector; 3] {
        of_shape!(self, shape => shape.rows(pose))
    }

    fn to_principal(&self, orientation: Orientation) -> Orientation {
        of_shape!(self, shape => shape.to_principal(orientation))
    }

    fn of_principal(&self, orientation: Orientation) -> Orientation {
        of_shape!(self, shape => shape.of_principal(orientation))
    }

    #[inline(always)]
    fn turned(&self, rows: &[Vector; 3]) -> TurnedSolid<'a> {
        match self {
            Self::Ellipsoid(shape) => match sphere_of(shape) {
                Some(sphere) => TurnedSolid::Ball(sphere.turned(rows)),
                None => TurnedSolid::Ellipsoid(shape.turned(rows)),
            },
            Self::Polyhedron(shape) => TurnedSolid::Polyhedron(shape.turned(rows)),
        }
    }
}

impl TurnedSolid<'_> {
    /// The same; a sphere as an ellipsoid.
    #[inline(always)]
    fn of_two_kinds(&self) -> Self {
        match self {
            Self::Ball(ball) => Self::Ellipsoid(ball.around()),
            other => *other,
        }
    }
}

impl Turned for TurnedSolid<'_> {
    const IS_ELLIPSOID: bool = false;

    #[inline(always)]
    fn is_sphere(&self) -> bool {
        matches!(self, Self::Ball(_))
    }

    #[inline(always)]
    fn around(&self) -> Symmetric {
        of_turned!(self, turned => turned.around())
    }

    #[inline(always)]
    fn support_mm(&self, n: Vector) -> f64 {
        of_turned!(self, turned => turned.support_mm(n))
    }

    #[inline(always)]
    fn support_back_mm(&self, n: Vector) -> f64 {
        of_turned!(self, turned => turned.support_back_mm(n))
    }

    fn decide(&self, other: &Self, r: Vector, gap_mm: f64, normal: Vector) -> Decision {
        match (self, other) {
            (Self::Polyhedron(a), Self::Polyhedron(b)) => a.decide(b, r, gap_mm, normal),
            (Self::Ellipsoid(a), Self::Ellipsoid(b)) => a.decide(b, r, gap_mm, normal),
            (Self::Ellipsoid(a), Self::Polyhedron(b)) => decide_both(a, b, r, gap_mm, normal),
            (Self::Polyhedron(a), Self::Ellipsoid(b)) => {
                let found = decide_both(b, a, opposite(r), gap_mm, opposite(normal));
                Decision { normal: opposite(found.normal), ..found }
            }
            (Self::Ball(a), Self::Ball(b)) => a.decide(b, r, gap_mm, normal),
            (Self::Ball(_), _) | (_, Self::Ball(_)) => {
                self.of_two_kinds().decide(&other.of_two_kinds(), r, gap_mm, normal)
            }
        }
    }

    /// That of the ellipsoids around the two.
    #[inline(always)]
    fn first_direction(&self, other: &Self, r: Vector) -> Vector {
        let (a, b) = (self.around(), other.around());
        let (h_a, h_b) = (a.quadratic(r).sqrt(), b.quadratic(r).sqrt());
        Symmetric::blend(&a, &b, h_a / (h_a + h_b)).solve(r)
    }

    fn contact(&self, other: &Self, r: Vector, gap_mm: f64, normal: Vector, turns: u32) -> PushContact {
        match (self, other) {
            (Self::Polyhedron(a), Self::Polyhedron(b)) => a.contact(b, r, gap_mm, normal, turns),
            (Self::Ellipsoid(a), Self::Ellipsoid(b)) => {
                let n = a.decide(b, r, gap_mm, normal).normal;
                a.contact(b, r, gap_mm, scaled(n, 1.0 / norm(n)), turns)
            }
            (Self::Ellipsoid(a), Self::Polyhedron(b)) => contact_both(a, b, r, gap_mm, normal, turns),
            (Self::Polyhedron(a), Self::Ellipsoid(b)) => {
                let found = contact_both(b, a, opposite(r), gap_mm, opposite(normal), turns);
                let ([h_b, h_a], [arm_b, arm_a]) = (found.supports_mm, found.arms_mm);
                PushContact {
                    normal: opposite(found.normal),
                    supports_mm: [h_a, h_b],
                    arms_mm: [arm_a, arm_b],
                }
            }
            (Self::Ball(a), Self::Ball(b)) => {
                let along = scaled(r, 1.0 / norm(r));
                a.contact(b, r, gap_mm, along, turns)
            }
            (Self::Ball(_), _) | (_, Self::Ball(_)) => {
                self.of_two_kinds().contact(&other.of_two_kinds(), r, gap_mm, normal, turns)
            }
        }
    }

    fn reach_across_mm(&self, from_axis_mm: [f64; 2]) -> (f64, Vector) {
        of_turned!(self, turned => turned.reach_across_mm(from_axis_mm))
    }
}

/// The sphere that an ellipsoid is, if it is one.
#[inline(always)]
fn sphere_of(shape: &Ellipsoid) -> Option<Sphere> {
    let axes = shape.semi_axes_mm();
    (axes.x == axes.z).then(|| Sphere { d_mm: 2.0 * axes.x })
}

#[inline(always)]
fn opposite(n: Vector) -> Vector {
    [-n[0], -n[1], -n[2]]
}

/// Whether an ellipsoid and a polyhedron keep a gap.
fn decide_both(a: &Symmetric, b: &TurnedPolyhedron<'_>, r: Vector, gap_mm: f64, normal: Vector) -> Decision {
    let found = Pair { a, b, r: r.into() }.decide_from(gap_mm, &normal.into());
    Decision { is_apart: found.is_apart, normal: found.normal.into() }
}

/// Where an ellipsoid and a polyhedron push each other.
fn contact_both(
    a: &Symmetric,
    b: &TurnedPolyhedron<'_>,
    r: Vector,
    gap_mm: f64,
    normal: Vector,
    turns: u32,
) -> PushContact {
    Pair { a, b, r: r.into() }.push_contact(gap_mm, normal, turns)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "solids_tests.rs"]
mod tests;
