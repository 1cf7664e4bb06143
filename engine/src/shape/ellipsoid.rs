//! The ellipsoid.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use super::carlson::rg;
use super::{Form, Pose, Zingg};
use crate::elementary::cbrt;
use crate::sorting;

/// An ellipsoid by its semi-axes `a >= b >= c`, which lie along x, y and z of the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipsoid {
    semi_axes_mm: Vector3<f64>,
}

impl Ellipsoid {
    /// The ellipsoid with all lengths multiplied; `None` where the factor leaves none.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Option<Self> {
        Self::new((self.semi_axes_mm() * factor).into())
    }

    /// An ellipsoid by its semi-axes in mm, in any order; `None` unless all are finite and positive.
    #[must_use]
    pub fn new(mut semi_axes_mm: [f64; 3]) -> Option<Self> {
        sorting::descending(&mut semi_axes_mm);
        let valid = semi_axes_mm.iter().all(|axis| axis.is_finite() && *axis > 0.0);
        valid.then(|| Self { semi_axes_mm: semi_axes_mm.into() })
    }

    /// A sphere by its diameter in mm; `None` unless it is finite and positive.
    #[must_use]
    pub fn sphere(diameter_mm: f64) -> Option<Self> {
        Self::new([diameter_mm / 2.0; 3])
    }

    /// The ellipsoid of a form by its equivalent diameter in mm (see [`Self::equivalent_diameter_mm`]); `None` unless
    /// the diameter is finite and positive and both ratios lie above 0 and are at most 1.
    ///
    /// The equivalent diameter of the result is exact for spheres, else it may miss by a few units in the last place.
    #[must_use]
    pub fn with_equivalent_diameter(diameter_mm: f64, form: Form) -> Option<Self> {
        is_valid(diameter_mm, form)
            .then(|| Self::of_equivalent_diameter(diameter_mm, form))
            .and_then(|shape| Self::new(shape.semi_axes_mm.into()))
    }

    /// The ellipsoid of a form by its sieve size in mm (see [`Self::sieve_size_mm`]); `None` unless the size is finite
    /// and positive and both ratios lie above 0 and are at most 1.
    ///
    /// The sieve size of the result is exact for spheres, else it may miss by a few units in the last place.
    #[must_use]
    pub fn with_sieve_size(size_mm: f64, form: Form) -> Option<Self> {
        is_valid(size_mm, form)
            .then(|| Self::of_sieve_size(size_mm, form))
            .and_then(|shape| Self::new(shape.semi_axes_mm.into()))
    }

    pub(super) fn of_equivalent_diameter(diameter_mm: f64, Form { elongation, flatness }: Form) -> Self {
        // a b c = a³ (b/a)² (c/b).
        let a = diameter_mm / 2.0 / cbrt(elongation * elongation * flatness);
        let b = a * elongation;
        Self { semi_axes_mm: Vector3::new(a, b, b * flatness) }
    }

    pub(super) fn of_sieve_size(size_mm: f64, Form { elongation, flatness }: Form) -> Self {
        let b = size_mm / (2.0 * (1.0 + flatness * flatness)).sqrt();
        Self { semi_axes_mm: Vector3::new(b / elongation, b, b * flatness) }
    }

    /// Semi-axes `a >= b >= c` in mm.
    #[must_use]
    pub fn semi_axes_mm(&self) -> Vector3<f64> {
        self.semi_axes_mm
    }

    /// Ratios of the axes.
    #[must_use]
    pub fn form(&self) -> Form {
        let [a, b, c] = self.semi_axes_mm.into();
        Form { elongation: b / a, flatness: c / b }
    }

    /// Elongation `Ei = b/a`.
    #[must_use]
    pub fn elongation(&self) -> f64 {
        self.form().elongation
    }

    /// Flatness `Fi = c/b`.
    #[must_use]
    pub fn flatness(&self) -> f64 {
        self.form().flatness
    }

    /// Length over thickness, `a/c`.
    #[must_use]
    pub fn length_over_thickness(&self) -> f64 {
        self.semi_axes_mm.x / self.semi_axes_mm.z
    }

    /// The class of Zingg by the ratios of the axes.
    #[must_use]
    pub fn zingg(&self) -> Zingg {
        self.form().zingg()
    }

    /// Volume `4/3 pi a b c` in mm³.
    #[must_use]
    pub fn volume_mm3(&self) -> f64 {
        4.0 / 3.0 * PI * self.semi_axes_mm.product()
    }

    /// Diameter `d_eq = 2 cbrt(a b c)` of the sphere of equal volume, in mm; exactly `2 a` of a sphere.
    #[must_use]
    pub fn equivalent_diameter_mm(&self) -> f64 {
        let [a, b, c] = self.semi_axes_mm.into();
        2.0 * a * cbrt((b / a) * (c / a))
    }

    /// Sieve size `D_s = sqrt(2 (b² + c²))` in mm: the edge of the smallest square opening that the ellipsoid passes.
    ///
    /// Moved along its long axis the ellipsoid casts the ellipse (b, c) as its shadow. The half-widths of the box
    /// around that ellipse have squares that add to `b² + c²` at any turn, so that the smallest square holds it at 45
    /// degrees, with a half-width of `sqrt((b² + c²) / 2)`. No motion does better: when the centre passes the opening,
    /// the section in its plane is a central ellipse with semi-axes of at least `b` and at least `c`.
    #[must_use]
    pub fn sieve_size_mm(&self) -> f64 {
        let Form { flatness, .. } = self.form();
        self.semi_axes_mm.y * (2.0 * (1.0 + flatness * flatness)).sqrt()
    }

    /// Surface area in mm²: `4 pi R_G(a²b², a²c², b²c²)` with Carlson's symmetric integral `R_G`
    /// (<https://dlmf.nist.gov/19.33>, equation 19.33.1; the integral: DOI 10.1007/BF02198293).
    #[must_use]
    pub fn surface_mm2(&self) -> f64 {
        let [a, b, c] = self.semi_axes_mm.into();
        let (p, q) = (b / a, c / a);
        let (ab, ac, bc) = (p * p, q * q, p * q * (p * q));
        4.0 * PI * a * a * rg(ab, ac, bc)
    }

    /// Mean of the width over all directions in mm: `2 R_G(a², b², c²)`.
    #[must_use]
    pub fn mean_width_mm(&self) -> f64 {
        let [a, b, c] = self.semi_axes_mm.into();
        let (p, q) = (b / a, c / a);
        2.0 * a * rg(1.0, p * p, q * q)
    }

    /// Sphericity of Wadell: surface of the sphere of equal volume over that of the grain (H. Wadell, J. Geol. 40,
    /// 443-451, 1932, DOI 10.1086/623964).
    #[must_use]
    pub fn sphericity(&self) -> f64 {
        let d = self.equivalent_diameter_mm();
        PI * d * d / self.surface_mm2()
    }

    /// Roundness of Wadell: radius of the sphere that fits into the corners over that of the largest inscribed sphere.
    ///
    /// The definition is that of Zheng, He and Alimohammadi (Acta Geotechnica 16, 2021, DOI 10.1007/s11440-020-01004-9)
    /// for bodies in space. The corners of an ellipsoid are where it is curved most, the ends of the long axis. Its
    /// radii of curvature are `b²/a` and `c²/a` there, so that a sphere of the radius `c²/a` fits; the largest
    /// inscribed one has the radius `c`. The roundness is `c/a`, 1 of a sphere.
    #[must_use]
    pub fn roundness(&self) -> f64 {
        self.semi_axes_mm.z / self.semi_axes_mm.x
    }

    /// The shape matrix `A = R diag(a², b², c²) Rᵀ` in mm²: the support function along `n` is `sqrt(n · A n)`.
    #[must_use]
    pub fn matrix_mm2(&self, pose: &Pose) -> Matrix3<f64> {
        let rotation = pose.rotation();
        let squares = self.semi_axes_mm.component_mul(&self.semi_axes_mm);
        rotation * Matrix3::from_diagonal(&squares) * rotation.transpose()
    }

    /// Support function `h(n)` in mm: how far the ellipsoid reaches from its centre along the unit vector `n`.
    #[must_use]
    pub fn support_mm(&self, pose: &Pose, direction: &Vector3<f64>) -> f64 {
        self.semi_axes_mm.component_mul(&pose.rotation().tr_mul(direction)).norm()
    }
}

fn is_valid(size_mm: f64, Form { elongation, flatness }: Form) -> bool {
    let is_ratio = |ratio: f64| ratio > 0.0 && ratio <= 1.0;
    size_mm.is_finite() && size_mm > 0.0 && is_ratio(elongation) && is_ratio(flatness)
}

#[cfg(test)]
#[path = "ellipsoid_tests.rs"]
mod tests;
