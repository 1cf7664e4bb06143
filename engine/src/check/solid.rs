//! Bodies of either kind in one packing, as the check sees them.

use nalgebra::Vector3;

use super::bodies::{Convex, Direction, Image, Verdict};
use super::ellipsoid;
use super::mixed_separation;
use super::polyhedron::Polyhedron;
use super::{polyhedron_separation, separation};
use crate::request::Specimen;
use crate::shape::{Pose, SolidRef};

/// A grain with position and orientation.
#[derive(Clone, Debug)]
pub(super) enum Body {
    Ellipsoid(ellipsoid::Body),
    Polyhedron(Polyhedron),
}

impl Body {
    /// `None` where the numbers describe no body in space.
    pub(super) fn new(shape: &SolidRef<'_>, pose: &Pose) -> Option<Self> {
        match shape {
            SolidRef::Ellipsoid(shape) => ellipsoid::Body::new(shape, pose).map(Self::Ellipsoid),
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

impl Convex for Body {
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

    #[inline(always)]
    fn judge(&self, other: &Self, image: &Image, required: f64, enough: f64) -> Verdict {
        match (self, other) {
            (Self::Ellipsoid(a), Self::Ellipsoid(b)) => {
                separation::Pair::new(a, b, *image).judge(required, enough)
            }
            (Self::Polyhedron(a), Self::Polyhedron(b)) => {
                polyhedron_separation::Pair::new(a, b, *image).judge(required, enough)
            }
            (Self::Ellipsoid(a), Self::Polyhedron(b)) => {
                mixed_separation::Pair::new(a, b, *image).judge(required, enough)
            }
            (Self::Polyhedron(a), Self::Ellipsoid(b)) => {
                // The polyhedron is the moved one then, by as much the other way.
                let image = Image { steps: image.steps.map(|step| -step), ..*image };
                let back = |of: Direction| Direction { normal: -of.normal, separation: of.separation };
                match mixed_separation::Pair::new(b, a, image).judge(required, enough) {
                    Verdict::Clear => Verdict::Clear,
                    Verdict::Keeps(direction) => Verdict::Keeps(back(direction)),
                    Verdict::TooClose(direction) => Verdict::TooClose(back(direction)),
                }
            }
        }
    }

    fn wall_gap(&self, specimen: &Specimen, required: f64, enough: f64) -> (f64, bool) {
        match self {
            Self::Ellipsoid(body) => body.wall_gap(specimen, required, enough),
            Self::Polyhedron(body) => body.wall_gap(specimen, required, enough),
        }
    }
}
