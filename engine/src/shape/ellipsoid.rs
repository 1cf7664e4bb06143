//! The ellipsoid.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use super::Pose;

/// An ellipsoid by its semi-axes `a >= b >= c`, which lie along x, y and z of the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipsoid {
    semi_axes_mm: Vector3<f64>,
}

impl Ellipsoid {
    /// An ellipsoid by its semi-axes in mm, in any order; `None` unless all are finite and positive.
    #[must_use]
    pub fn new(mut semi_axes_mm: [f64; 3]) -> Option<Self> {
        semi_axes_mm.sort_by(|p, q| q.total_cmp(p));
        let valid = semi_axes_mm.iter().all(|axis| axis.is_finite() && *axis > 0.0);
        valid.then(|| Self { semi_axes_mm: semi_axes_mm.into() })
    }

    /// Semi-axes `a >= b >= c` in mm.
    #[must_use]
    pub fn semi_axes_mm(&self) -> Vector3<f64> {
        self.semi_axes_mm
    }

    /// Volume `4/3 pi a b c` in mm³.
    #[must_use]
    pub fn volume_mm3(&self) -> f64 {
        4.0 / 3.0 * PI * self.semi_axes_mm.product()
    }

    /// Diameter `d_eq = 2 cbrt(a b c)` of the sphere of equal volume, in mm.
    #[must_use]
    pub fn equivalent_diameter_mm(&self) -> f64 {
        2.0 * self.semi_axes_mm.product().cbrt()
    }

    /// Side `D_s = sqrt(2 (b² + c²))` of the smallest square opening that the ellipsoid passes, in mm.
    #[must_use]
    pub fn sieve_size_mm(&self) -> f64 {
        let [_, b, c]: [f64; 3] = self.semi_axes_mm.into();
        (2.0 * (b * b + c * c)).sqrt()
    }

    /// The shape matrix `A = R diag(a², b², c²) Rᵀ` in mm²: the support function along `n` is `sqrt(n · A n)`.
    #[must_use]
    pub fn matrix_mm2(&self, pose: &Pose) -> Matrix3<f64> {
        let rotation = pose.rotation();
        let squares = self.semi_axes_mm.component_mul(&self.semi_axes_mm);
        rotation * Matrix3::from_diagonal(&squares) * rotation.transpose()
    }
}
