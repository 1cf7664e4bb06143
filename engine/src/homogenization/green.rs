//! The inverse of the discrete operator of a homogeneous medium, at each frequency (Green operator).
//!
//! For `B^T C_0 B` with the gradient `B` of the stencil and an isotropic `C_0`, the symbol of `D_ij = B_i^* B_j` is a
//! product over the axes of `s = 2 (1 - cos x) / h^2` and `g = sin x / h`, which belong to derivatives, and of a mean
//! value `m`: `D_xx = s_x m_y m_z`, `D_xy = g_x g_y m_z`. The rotated scheme has `m = (1 + cos x) / 2`, and fully
//! integrated hexahedra have `m = (2 + cos x) / 3`. With `(lambda + mu) D + mu tr(D) 1` off and on the diagonal this is
//! a symmetric matrix of real numbers, whose inverse is computed where it is needed.

use std::f64::consts::PI;

use num_traits::Zero as _;

use super::Scheme;
use super::lanes::{Lanes, WIDTH};
use crate::elementary::sin_cos;

/// Factors of the symbol along an axis, at each frequency.
#[derive(Clone, Debug)]
struct Axis {
    s: Vec<f32>,
    g: Vec<f32>,
    m: Vec<f32>,
}

impl Axis {
    /// Those of the first frequencies, in as many places as `length` with zeros at the end.
    fn new(n: usize, h: f64, frequencies: usize, length: usize, scheme: Scheme) -> Self {
        let mut axis = Self { s: vec![0.0; length], g: vec![0.0; length], m: vec![0.0; length] };
        for k in 0..frequencies {
            // Half of the phase from a node to the next; exactly 0 and 1 at the highest frequency.
            let (sin, cos) = if 2 * k == n { (1.0, 0.0) } else { sin_cos(PI * k as f64 / n as f64) };
            axis.s[k] = (4.0 * sin * sin / (h * h)) as f32;
            axis.g[k] = (2.0 * sin * cos / h) as f32;
            axis.m[k] = match scheme {
                Scheme::Rotated => (cos * cos) as f32,
                Scheme::Hexahedra => ((1.0 + 2.0 * cos * cos) / 3.0) as f32,
            };
        }
        axis
    }
}

/// An isotropic medium without contrasts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reference {
    /// First constant of Lamé; 0 of a medium that conducts.
    pub(super) lambda: f64,
    /// Shear modulus, or conductivity.
    pub(super) mu: f64,
}

/// The Green operator of a medium on a grid.
#[derive(Clone, Debug)]
pub(super) struct Green {
    axes: [Axis; 3],
    lambda: f32,
    mu: f32,
    /// 1 over the number of voxels: two transforms multiply by the latter.
    scale: f32,
}

/// Real and imaginary parts of four numbers.
pub(super) type Complex = realfft::num_complex::Complex<Lanes>;

impl Green {
    /// The operator for spectra whose rows along x have `length` numbers.
    pub(super) fn new(
        shape: [usize; 3],
        spacing: [f64; 3],
        length: usize,
        scheme: Scheme,
        reference: Reference,
    ) -> Self {
        let [nx, ny, nz] = shape;
        let axes = [
            Axis::new(nx, spacing[0], nx / 2 + 1, length, scheme),
            Axis::new(ny, spacing[1], ny, ny, scheme),
            Axis::new(nz, spacing[2], nz, nz, scheme),
        ];
        let scale = 1.0 / (nx * ny * nz) as f64;
        Self { axes, lambda: reference.lambda as f32, mu: reference.mu as f32, scale: scale as f32 }
    }

    /// Applies the operator at the frequencies `x..x + 4`, `y`, `z`.
    #[inline(always)]
    pub(super) fn apply<const D: usize>(&self, [x, y, z]: [usize; 3], forces: [Complex; D]) -> [Complex; D] {
        let of_x = |row: &[f32]| Lanes::load(&row[x..x + WIDTH]);
        let splat = |row: &[f32], at: usize| Lanes::splat(row[at]);
        let [ax, ay, az] = &self.axes;
        let (sx, gx, mx) = (of_x(&ax.s), of_x(&ax.g), of_x(&ax.m));
        let (sy, gy, my) = (splat(&ay.s, y), splat(&ay.g, y), splat(&ay.m, y));
        let (sz, gz, mz) = (splat(&az.s, z), splat(&az.g, z), splat(&az.m, z));
        let (xx, yy, zz) = (sx * my * mz, mx * sy * mz, mx * my * sz);
        let inverse_trace = (xx + yy + zz).inverse_or_zero();
        let mu = Lanes::splat(self.mu);
        let scale = Lanes::splat(self.scale) * inverse_trace;
        let mut out = [Complex { re: Lanes::zero(), im: Lanes::zero() }; D];
        if D == 1 {
            let factor = scale / mu;
            out[0] = Complex { re: factor * forces[0].re, im: factor * forces[0].im };
            return out;
        }
        // The matrix over the trace of D, which leaves numbers of the order of the moduli.
        let both = Lanes::splat(self.lambda + self.mu);
        let (a, b, c) =
            (mu + both * xx * inverse_trace, mu + both * yy * inverse_trace, mu + both * zz * inverse_trace);
        let off = both * inverse_trace;
        let (d, e, f) = (off * gx * gy * mz, off * gx * gz * my, off * gy * gz * mx);
        // Cofactors of the symmetric matrix (a d e; d b f; e f c).
        let (xx, xy, xz) = (b * c - f * f, e * f - d * c, d * f - e * b);
        let (yy, yz, zz) = (a * c - e * e, d * e - a * f, a * b - d * d);
        let scale = scale / (a * xx + d * xy + e * xz);
        let part = |of: fn(&Complex) -> Lanes| {
            let [p, q, r] = [0, 1, 2].map(|i| scale * of(&forces[i]));
            [xx * p + xy * q + xz * r, xy * p + yy * q + yz * r, xz * p + yz * q + zz * r]
        };
        let (re, im) = (part(|force| force.re), part(|force| force.im));
        for i in 0..D {
            out[i] = Complex { re: re[i], im: im[i] };
        }
        out
    }
}
