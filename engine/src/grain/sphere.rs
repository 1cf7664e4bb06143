//! The sphere as a grain.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use super::figure::Figure;
use super::rows::Disc;
use super::{Grain, Rows, Surface, VolumeBelow};
use crate::geometry::convex::Lines;

/// A sphere.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sphere {
    pub(super) radius_mm: f64,
}

impl<'a> Grain<'a> for Sphere {
    fn volume_mm3(self) -> f64 {
        let d = 2.0 * self.radius_mm;
        PI / 6.0 * d * d * d
    }

    fn outer_radius_mm(self) -> f64 {
        self.radius_mm
    }

    fn inner_radius_mm(self) -> f64 {
        self.radius_mm
    }

    fn half_extents_mm(self) -> [f64; 3] {
        [self.radius_mm; 3]
    }

    fn contains(self, at: &Vector3<f64>) -> bool {
        at.norm_squared() < self.radius_mm * self.radius_mm
    }

    fn distance_mm(self, at: &Vector3<f64>) -> f64 {
        at.norm() - self.radius_mm
    }

    fn normal(self, at: &Vector3<f64>) -> Vector3<f64> {
        at.try_normalize(0.0).unwrap_or_default()
    }

    fn chord_mm(self, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<[f64; 2]> {
        let middle = -from.dot(along);
        let square = self.radius_mm * self.radius_mm - (from.norm_squared() - middle * middle);
        (square > 0.0).then(|| [middle - square.sqrt(), middle + square.sqrt()])
    }

    fn reach_mm(self, _: &Vector3<f64>) -> f64 {
        self.radius_mm
    }

    fn to_outline_mm(self, at: &Vector3<f64>, normal: &Vector3<f64>) -> f64 {
        let height = at.dot(normal);
        let disc = (self.radius_mm * self.radius_mm - height * height).max(0.0).sqrt();
        disc - (at - normal * height).norm()
    }

    fn section(self, _: [usize; 3], height_mm: f64) -> Option<([f64; 2], Figure)> {
        let (radius, height) = (self.radius_mm, height_mm.abs());
        (height < radius).then(|| {
            let radius_mm = ((radius - height) * (radius + height)).sqrt();
            ([0.0; 2], Figure::Circle { radius_mm })
        })
    }

    #[inline]
    fn rows<'l>(self, center_mm: [f64; 3], height_mm: f64, _: &'l mut Lines, _: bool) -> Rows<'l>
    where
        'a: 'l,
    {
        let radius = self.radius_mm;
        Rows::Disc(Disc {
            center: [center_mm[0], center_mm[1]],
            radius: ((radius - height_mm) * (radius + height_mm)).max(0.0).sqrt(),
        })
    }

    fn volume_below(self, _: usize) -> VolumeBelow<'a> {
        VolumeBelow::of_ellipsoid(self.radius_mm, self.volume_mm3())
    }

    fn surface(self) -> Surface<'a> {
        Surface::Quadric(Matrix3::from_diagonal_element(1.0 / (self.radius_mm * self.radius_mm)))
    }
}
