//! What the check asks of a grain ([`Body`]), and its answers for ellipsoids and polyhedra, alone or mixed.

use nalgebra::Vector3;

use super::body::{Ellipsoid, Polyhedron};
use super::region::SpecimenRegion;
use super::separation::{Direction, Image, Verdict, ellipsoids, mixed, polyhedra};
use super::walls;
use crate::arrays::Each as _;
use crate::shape::{Pose, SolidRef};

/// A convex body in its place, in a region of some kind.
pub trait Body<R>: Sync {
    /// Its centre in mm.
    fn center(&self) -> Vector3<f64>;

    /// Radius in mm of a sphere around the centre that holds the body.
    fn radius(&self) -> f64;

    /// Diameter in mm of the sphere of equal volume.
    fn equivalent_diameter(&self) -> f64;

    /// The support function: how far the body reaches from its centre along a unit vector.
    fn reach(&self, direction: &Vector3<f64>) -> f64;

    /// Whether this body and an image of another keep a gap. A pair that is surely at least `enough` apart is clear.
    fn judge(&self, other: &Self, image: &Image, required: f64, enough: f64) -> Verdict;

    /// Gap between the body and the nearest wall, and whether it is at least `required`. Walls farther away than
    /// `enough` may be left out of the gap.
    fn wall_gap(&self, region: &R, required: f64, enough: f64) -> (f64, bool);
}

impl Body<SpecimenRegion> for Ellipsoid {
    fn center(&self) -> Vector3<f64> {
        self.center
    }

    fn radius(&self) -> f64 {
        self.radius
    }

    fn equivalent_diameter(&self) -> f64 {
        self.equivalent_diameter
    }

    fn reach(&self, direction: &Vector3<f64>) -> f64 {
        direction.dot(&(self.matrix * direction)).max(0.0).sqrt()
    }

    #[inline(always)]
    fn judge(&self, other: &Self, image: &Image, required: f64, enough: f64) -> Verdict {
        ellipsoids::Pair::new(self, other, *image).judge(required, enough)
    }

    fn wall_gap(&self, region: &SpecimenRegion, required: f64, enough: f64) -> (f64, bool) {
        walls::ellipsoid::wall_gap(self, region, required, enough)
    }
}

/// A grain with position and orientation.
#[derive(Clone, Debug)]
pub(super) enum MixedBody<'a> {
    Ellipsoid(Ellipsoid),
    Polyhedron(Polyhedron<'a>),
}

impl<'a> MixedBody<'a> {
    /// `None` where the numbers describe no body in space.
    pub(super) fn new(shape: &SolidRef<'a>, pose: &Pose) -> Option<Self> {
        match shape {
            SolidRef::Ellipsoid(shape) => Ellipsoid::new(shape, pose).map(Self::Ellipsoid),
            SolidRef::Polyhedron(shape) => Polyhedron::new(shape, pose).map(Self::Polyhedron),
        }
    }

    /// Volume in mm³, by a formula of the check.
    pub(super) fn own_volume(&self) -> f64 {
        match self {
            Self::Ellipsoid(body) => body.own_volume(),
            Self::Polyhedron(body) => body.volume,
        }
    }
}

impl Body<SpecimenRegion> for MixedBody<'_> {
    fn center(&self) -> Vector3<f64> {
        match self {
            Self::Ellipsoid(body) => body.center,
            Self::Polyhedron(body) => body.center,
        }
    }

    fn radius(&self) -> f64 {
        match self {
            Self::Ellipsoid(body) => body.radius,
            Self::Polyhedron(body) => body.radius,
        }
    }

    fn equivalent_diameter(&self) -> f64 {
        match self {
            Self::Ellipsoid(body) => body.equivalent_diameter,
            Self::Polyhedron(body) => body.equivalent_diameter,
        }
    }

    fn reach(&self, direction: &Vector3<f64>) -> f64 {
        match self {
            Self::Ellipsoid(body) => body.reach(direction),
            Self::Polyhedron(body) => {
                let along = body.points.iter().map(|p| (p - body.center).dot(direction));
                along.fold(f64::NEG_INFINITY, f64::max) + body.rounding
            }
        }
    }

    #[inline(always)]
    fn judge(&self, other: &Self, image: &Image, required: f64, enough: f64) -> Verdict {
        match (self, other) {
            (Self::Ellipsoid(a), Self::Ellipsoid(b)) => {
                ellipsoids::Pair::new(a, b, *image).judge(required, enough)
            }
            (Self::Polyhedron(a), Self::Polyhedron(b)) => {
                polyhedra::Pair::new(a, b, *image).judge(required, enough)
            }
            (Self::Ellipsoid(a), Self::Polyhedron(b)) => {
                mixed::Pair::new(a, b, *image).judge(required, enough)
            }
            (Self::Polyhedron(a), Self::Ellipsoid(b)) => {
                // The polyhedron is the moved one then, by as much the other way.
                let image = Image { steps: image.steps.each(|step| -step), ..*image };
                let back = |of: Direction| Direction { normal: -of.normal, separation: of.separation };
                match mixed::Pair::new(b, a, image).judge(required, enough) {
                    Verdict::Clear => Verdict::Clear,
                    Verdict::Keeps(direction) => Verdict::Keeps(back(direction)),
                    Verdict::TooClose(direction) => Verdict::TooClose(back(direction)),
                }
            }
        }
    }

    fn wall_gap(&self, region: &SpecimenRegion, required: f64, enough: f64) -> (f64, bool) {
        match self {
            Self::Ellipsoid(body) => body.wall_gap(region, required, enough),
            Self::Polyhedron(body) => walls::polyhedron::wall_gap(body, region, required),
        }
    }
}
