//! An ellipsoid as the check sees it: axes, support function and rounding errors from the stored numbers alone.
//!
//! With the centre `x`, the semi-axes `a_k` and the columns `R_k` of the rotation of the stored quaternion `q`, divided
//! by `|q|^2`, the support function is `h(n) = |v|`, `v_k = a_k R_k . n`. It is evaluated in this form, in which
//! rounding costs at most 46 units (`2^-53`) of `a |n|`: 20 of each column, 4 of the products, times `sqrt 3` for three
//! axes, and 3 of the norm. The form `sqrt(n . A n)` would lose the square of the ratio of the axes.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Quaternion, Vector3};

use crate::arrays::{self, Each as _};
use crate::check::double_double::{DoubleDouble, Vector, dot};
use crate::elementary::cbrt;
use crate::shape::{self, Pose};

/// An ellipsoid with position and orientation.
#[derive(Clone, Copy, Debug)]
pub(in crate::check) struct Ellipsoid {
    pub(in crate::check) center: Vector3<f64>,
    semi_axes: Vector3<f64>,
    /// Stored quaternion in the order w, x, y, z.
    quaternion: [f64; 4],
    /// Rows `a_k R_k`.
    pub(in crate::check) axes: Matrix3<f64>,
    /// Shape matrix `A`; it only helps to find directions.
    pub(in crate::check) matrix: Matrix3<f64>,
    /// Largest semi-axis, the radius of the sphere around the body.
    pub(in crate::check) radius: f64,
    /// Diameter of the sphere of equal volume.
    pub(in crate::check) equivalent_diameter: f64,
}

impl Ellipsoid {
    /// `None` where the numbers describe no ellipsoid in space.
    pub(in crate::check) fn new(shape: &shape::Ellipsoid, pose: &Pose) -> Option<Self> {
        let semi_axes = shape.semi_axes_mm();
        let &Quaternion { coords } = pose.orientation.quaternion();
        let quaternion = [coords.w, coords.x, coords.y, coords.z];
        let norm2: f64 = quaternion.iter().map(|q| q * q).sum();
        let valid = semi_axes.iter().all(|a| a.is_finite() && *a > 0.0)
            && pose.center_mm.iter().all(|x| x.is_finite())
            && (1.0e-30..1.0e30).contains(&norm2);
        if !valid {
            return None;
        }
        let axes = Matrix3::from_diagonal(&semi_axes) * rotation(quaternion, norm2).transpose();
        Some(Self {
            center: pose.center_mm,
            semi_axes,
            quaternion,
            axes,
            matrix: axes.transpose() * axes,
            radius: semi_axes.max(),
            equivalent_diameter: 2.0 * cbrt(semi_axes[0] * semi_axes[1] * semi_axes[2]),
        })
    }

    /// Volume in mm³.
    pub(in crate::check) fn own_volume(&self) -> f64 {
        let [a, b, c]: [f64; 3] = self.semi_axes.into();
        4.0 / 3.0 * PI * a * b * c
    }

    /// `v` of the module's head, whose length is the support function.
    #[inline(always)]
    pub(in crate::check) fn scaled(&self, n: &Vector3<f64>) -> Vector3<f64> {
        self.axes * n
    }

    /// A vector from the centre in the frame in which the ellipsoid is the unit ball.
    pub(in crate::check) fn unstretched(&self, p: &Vector3<f64>) -> Vector3<f64> {
        (self.axes * p).component_div(&self.semi_axes.component_mul(&self.semi_axes))
    }

    /// Support function `h(n)`.
    #[inline(always)]
    pub(in crate::check) fn support(&self, n: &Vector3<f64>) -> f64 {
        self.scaled(n).norm()
    }

    /// The rows `a_k R_k` in double-double arithmetic.
    pub(in crate::check) fn exact_axes(&self) -> [Vector; 3] {
        let product = |i: usize, j: usize| DoubleDouble::product(self.quaternion[i], self.quaternion[j]);
        let [[ww, xx], [yy, zz]] = [[product(0, 0), product(1, 1)], [product(2, 2), product(3, 3)]];
        let [xy, xz, yz] = [product(1, 2), product(1, 3), product(2, 3)];
        let [wx, wy, wz] = [product(0, 1), product(0, 2), product(0, 3)];
        let norm2 = ww + xx + yy + zz;
        let two = DoubleDouble::from(2.0);
        let columns = [
            [(ww + xx) - (yy + zz), two * (xy + wz), two * (xz - wy)],
            [two * (xy - wz), (ww + yy) - (xx + zz), two * (yz + wx)],
            [two * (xz + wy), two * (yz - wx), (ww + zz) - (xx + yy)],
        ];
        arrays::from_fn(|k| {
            let scale = DoubleDouble::from(self.semi_axes[k]) / norm2;
            columns[k].each(|entry| scale * entry)
        })
    }

    /// `v` of the module's head in double-double arithmetic.
    pub(in crate::check) fn exact_scaled(axes: &[Vector; 3], n: &Vector) -> Vector {
        arrays::from_fn(|k| dot(&axes[k], n))
    }
}

/// The rotation of a quaternion w, x, y, z, divided by the square of its norm.
fn rotation([w, x, y, z]: [f64; 4], norm2: f64) -> Matrix3<f64> {
    let scale = 2.0 / norm2;
    let turned = |p: f64, q: f64| scale * (p + q);
    Matrix3::from_rows(&[
        Vector3::new(1.0 - turned(y * y, z * z), turned(x * y, -(w * z)), turned(x * z, w * y)).transpose(),
        Vector3::new(turned(x * y, w * z), 1.0 - turned(x * x, z * z), turned(y * z, -(w * x))).transpose(),
        Vector3::new(turned(x * z, -(w * y)), turned(y * z, w * x), 1.0 - turned(x * x, y * y)).transpose(),
    ])
}
