//! The ellipsoid as a grain.
//!
//! With the shape matrix `A` and its inverse `M` it is the set of points with `p · M p <= 1`. The section at a height
//! `dz` above the centre is the ellipse around `(A_xz, A_yz) dz / A_zz` with the matrix of the Schur complement of
//! `A_zz`, scaled by `1 - dz² / A_zz`; a chord follows from the quadratic equation along its line.

use nalgebra::{Matrix3, Vector3};

use super::figure::{Ellipse, Figure};
use super::rows::EllipseRows;
use super::{Grain, Rows, Surface, VolumeBelow};
use crate::gap::ellipsoids::Body;
use crate::gap::linear::Symmetric;
use crate::geometry::convex::Lines;
use crate::shape::{Ellipsoid, Pose};

/// The matrices of an ellipsoid in its place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Matrices {
    /// Shape matrix `A` in mm².
    shape_mm2: Matrix3<f64>,
    /// Its inverse `M` in 1/mm².
    inverse: Matrix3<f64>,
}

impl Matrices {
    pub(super) fn new(shape: &Ellipsoid, pose: &Pose) -> Self {
        let inverse_squares = shape.semi_axes_mm().map(|axis| 1.0 / (axis * axis));
        let rotation = pose.rotation();
        let inverse = rotation * Matrix3::from_diagonal(&inverse_squares) * rotation.transpose();
        Self { shape_mm2: shape.matrix_mm2(pose), inverse }
    }
}

/// An ellipsoid in its place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlacedEllipsoid<'a> {
    pub(super) shape: &'a Ellipsoid,
    pub(super) matrices: &'a Matrices,
}

impl PlacedEllipsoid<'_> {
    /// Less than 1 inside.
    fn quadratic(&self, at: &Vector3<f64>) -> f64 {
        at.dot(&(self.matrices.inverse * at))
    }
}

impl<'a> Grain<'a> for PlacedEllipsoid<'a> {
    fn volume_mm3(self) -> f64 {
        self.shape.volume_mm3()
    }

    fn outer_radius_mm(self) -> f64 {
        self.shape.semi_axes_mm().x
    }

    fn inner_radius_mm(self) -> f64 {
        self.shape.semi_axes_mm().z
    }

    fn half_extents_mm(self) -> [f64; 3] {
        self.matrices.shape_mm2.diagonal().map(f64::sqrt).into()
    }

    fn contains(self, at: &Vector3<f64>) -> bool {
        self.quadratic(at) < 1.0
    }

    fn distance_mm(self, at: &Vector3<f64>) -> f64 {
        let [inner_mm, outer_mm] = [self.inner_radius_mm(), self.outer_radius_mm()];
        let scale = self.quadratic(at).sqrt();
        if scale <= 1.0 {
            // The ellipsoid of this scale, widened by the difference of the shortest semi-axes, lies inside.
            return inner_mm * (scale - 1.0);
        }
        let a = &self.matrices.shape_mm2;
        let matrix_mm2 = Symmetric([a.m11, a.m12, a.m13, a.m22, a.m23, a.m33]);
        let own = Body { center_mm: [0.0; 3], matrix_mm2, outer_mm, inner_mm };
        // A ball about the point whose radius is taken off again.
        let square = inner_mm * inner_mm;
        let ball = Symmetric([square, 0.0, 0.0, square, 0.0, square]);
        let at_point = Body { center_mm: (*at).into(), matrix_mm2: ball, outer_mm: inner_mm, inner_mm };
        own.with(&at_point).gap_from(self.normal(at).into()).gap_mm + inner_mm
    }

    fn normal(self, at: &Vector3<f64>) -> Vector3<f64> {
        (self.matrices.inverse * at).try_normalize(0.0).unwrap_or_default()
    }

    fn chord_mm(self, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<[f64; 2]> {
        let image = self.matrices.inverse * along;
        let (a, b) = (along.dot(&image), -from.dot(&image));
        let square = b * b - a * (self.quadratic(from) - 1.0);
        (square > 0.0).then(|| [(b - square.sqrt()) / a, (b + square.sqrt()) / a])
    }

    fn reach_mm(self, along: &Vector3<f64>) -> f64 {
        along.norm() / self.quadratic(along).sqrt()
    }

    fn to_outline_mm(self, at: &Vector3<f64>, normal: &Vector3<f64>) -> f64 {
        // What the quadratic form lacks over its gradient within the plane.
        let gradient = self.matrices.inverse * at * 2.0;
        let within = (gradient - normal * gradient.dot(normal)).norm();
        if within > 0.0 { (1.0 - self.quadratic(at)) / within } else { f64::INFINITY }
    }

    fn section(self, axes: [usize; 3], height_mm: f64) -> Option<([f64; 2], Figure)> {
        let Matrices { shape_mm2, inverse } = self.matrices;
        let (middle, ellipse) = Ellipse::of_section(shape_mm2, inverse, axes, height_mm)?;
        Some((middle, Figure::Ellipse(ellipse)))
    }

    #[inline]
    fn rows<'l>(self, center_mm: [f64; 3], height_mm: f64, _: &'l mut Lines, _: bool) -> Rows<'l>
    where
        'a: 'l,
    {
        let Matrices { shape_mm2: a, inverse: m } = self.matrices;
        let scale = (1.0 - height_mm * height_mm / a.m33).max(0.0);
        Rows::Ellipse(EllipseRows {
            center: [center_mm[0] + a.m13 / a.m33 * height_mm, center_mm[1] + a.m23 / a.m33 * height_mm],
            half_y: (scale * (a.m22 - a.m23 * a.m23 / a.m33).max(0.0)).sqrt(),
            shear: -m.m12 / m.m11,
            half_x: (scale / m.m11).sqrt(),
        })
    }

    fn volume_below(self, axis: usize) -> VolumeBelow<'a> {
        VolumeBelow::of_ellipsoid(self.half_extents_mm()[axis], self.volume_mm3())
    }

    fn surface(self) -> Surface<'a> {
        Surface::Quadric(self.matrices.inverse)
    }
}
