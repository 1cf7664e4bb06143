//! Vectors and symmetric matrices of three dimensions, as plain arrays: what a pair test needs and nothing else.

use crate::arrays;

/// A vector; its unit follows from its use.
pub type Vector = [f64; 3];

/// The scalar product.
#[inline(always)]
#[must_use]
pub fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The length.
#[inline(always)]
#[must_use]
pub fn norm(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

/// `a + b`.
#[inline(always)]
#[must_use]
pub fn sum(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
#[inline(always)]
#[must_use]
pub fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The square of the distance of two points.
#[inline(always)]
#[must_use]
pub fn distance2(a: Vector, b: Vector) -> f64 {
    let r = minus(a, b);
    dot(r, r)
}

/// The vector of length 1 along one that is not zero.
#[inline(always)]
#[must_use]
pub fn unit(a: Vector) -> Vector {
    let length = norm(a);
    [a[0] / length, a[1] / length, a[2] / length]
}

/// A multiple.
#[inline(always)]
#[must_use]
pub fn scaled(a: Vector, factor: f64) -> Vector {
    [a[0] * factor, a[1] * factor, a[2] * factor]
}

/// The vector product `a × b`.
#[inline(always)]
#[must_use]
pub fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A symmetric matrix by its components xx, xy, xz, yy, yz, zz.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Symmetric(pub [f64; 6]);

impl Symmetric {
    /// The matrix `R diag(d) Rᵀ` of a rotation by its rows and three eigenvalues.
    #[inline(always)]
    #[must_use]
    pub fn rotated_diagonal(rows: &[Vector; 3], d: Vector) -> Self {
        let scaled = |row: Vector| [row[0] * d[0], row[1] * d[1], row[2] * d[2]];
        let (x, y, z) = (scaled(rows[0]), scaled(rows[1]), scaled(rows[2]));
        Self([
            dot(x, rows[0]),
            dot(x, rows[1]),
            dot(x, rows[2]),
            dot(y, rows[1]),
            dot(y, rows[2]),
            dot(z, rows[2]),
        ])
    }

    /// `n · M n`.
    #[inline(always)]
    #[must_use]
    pub fn quadratic(&self, n: Vector) -> f64 {
        dot(n, self.times(n))
    }

    /// `M v`.
    #[inline(always)]
    #[must_use]
    pub fn times(&self, v: Vector) -> Vector {
        let [xx, xy, xz, yy, yz, zz] = self.0;
        [
            xx * v[0] + xy * v[1] + xz * v[2],
            xy * v[0] + yy * v[1] + yz * v[2],
            xz * v[0] + yz * v[1] + zz * v[2],
        ]
    }

    /// `(1 - share) a + share b`.
    #[inline(always)]
    #[must_use]
    pub fn blend(a: &Self, b: &Self, share: f64) -> Self {
        let rest = 1.0 - share;
        Self(arrays::from_fn(|i| rest * a.0[i] + share * b.0[i]))
    }

    /// The vector `n` with `M n = r`, by cofactors; the matrix must be positive definite.
    #[inline(always)]
    #[must_use]
    pub fn solve(&self, r: Vector) -> Vector {
        let [xx, xy, xz, yy, yz, zz] = self.0;
        let c_xx = yy * zz - yz * yz;
        let c_xy = xz * yz - xy * zz;
        let c_xz = xy * yz - xz * yy;
        let c_yy = xx * zz - xz * xz;
        let c_yz = xy * xz - xx * yz;
        let c_zz = xx * yy - xy * xy;
        let inverse = 1.0 / (xx * c_xx + xy * c_xy + xz * c_xz);
        let n = Self([c_xx, c_xy, c_xz, c_yy, c_yz, c_zz]).times(r);
        scaled(n, inverse)
    }
}
