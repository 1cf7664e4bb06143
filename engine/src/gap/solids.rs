//! Bodies of either kind: gaps of any two grains that are no spheres.

use super::ellipsoids::{self, Gap};
use super::linear::Vector;
use super::polyhedra::{self, Contact, Core, Pair};
use super::walls;
use crate::request::Specimen;
use crate::shape::{Pose, SolidRef};

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
            Self::Polyhedron(body) => walls::wall_gap_mm(body.center_mm.into(), &body.turned, specimen),
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
                let [on_a, on_b] = [a, b].map(|body| body.matrix_mm2.core_support(&normal.into()).1);
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
) -> Pair<'a, super::linear::Symmetric, polyhedra::TurnedPolyhedron<'a>> {
    let r = b.center_mm - nalgebra::Vector3::from(a.center_mm);
    Pair { a: &a.matrix_mm2, b: &b.turned, r }
}
