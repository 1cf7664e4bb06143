//! Ellipsoids as bodies of the check.

use std::f64::consts::PI;

use nalgebra::Vector3;

use super::bodies::{Convex, Image, Verdict};
use super::ellipsoid::Body;
use super::ellipsoid_walls::wall_gap;
use super::separation::Pair;
use crate::request::Specimen;
use crate::shape::{Ellipsoid, SizeMeasure};

impl Convex for Body {
    fn center(&self) -> Vector3<f64> {
        self.center
    }

    fn radius(&self) -> f64 {
        self.radius
    }

    fn equivalent_diameter(&self) -> f64 {
        self.equivalent_diameter
    }

    #[inline(always)]
    fn judge(&self, other: &Self, image: &Image, required: f64, enough: f64) -> Verdict {
        Pair::new(self, other, *image).judge(required, enough)
    }

    fn wall_gap(&self, specimen: &Specimen, required: f64, enough: f64) -> (f64, bool) {
        wall_gap(self, specimen, required, enough)
    }
}

/// Size and volume of an ellipsoid.
pub(super) fn size(shape: &Ellipsoid, size: SizeMeasure) -> (f64, f64) {
    let [a, b, c]: [f64; 3] = shape.semi_axes_mm().into();
    let size = match size {
        // The narrowest passage is along the longest axis, the ellipse (b, c) turned by 45 degrees in the square.
        SizeMeasure::Sieve => (2.0 * (b * b + c * c)).sqrt(),
        SizeMeasure::Equivalent => 2.0 * (a * b * c).cbrt(),
    };
    (size, 4.0 / 3.0 * PI * a * b * c)
}
