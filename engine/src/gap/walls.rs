//! A grain and the walls of a specimen.
//!
//! A plane wall with the inward normal `m` at the offset `o` is kept at the distance `x · m - h(m) - o`. In a cylinder
//! the clearance is its radius less the distance of the grain's farthest point from the axis. Across the axis an
//! ellipsoid is an ellipse with the centre `c` and the squared semi-axes `e_1 >= e_2`. In their directions its farthest
//! point maximizes `|c + diag(sqrt(e)) v|²` over `|v| = 1`; the dual function
//!
//! ```text
//! D(t) = |c|² + t + sum of e_i c_i² / (t - e_i),   t >= e_1
//! ```
//!
//! is at least the square of that distance for every `t`, and equal to it at its minimum (the trust-region problem;
//! Moré and Sorensen 1983, DOI 10.1137/0904038). So whatever `t` the iteration ends with, the clearance is proven.

use super::grain::Turned;
use super::linear::{Symmetric, Vector};
use crate::arrays::{self, Each as _};
use crate::domain::{Domain, Face, Lateral};

/// Most steps of Newton's method; few are needed.
const MOST_STEPS: u32 = 30;
/// Directions in the plane of the cylinder's section with the squared semi-axes of the ellipse.
const ACROSS: usize = 2;

/// Smallest clear distance of a grain to the walls in mm, negative where it reaches beyond one; infinite without walls.
#[must_use]
pub fn wall_gap_mm(center_mm: Vector, grain: &impl Turned, domain: &Domain) -> f64 {
    let gap_mm = |wall| match wall {
        Face::Plane(plane) => plane.distance_mm(center_mm) - grain.support_back_mm(plane.normal.into()),
        Face::Lateral(Lateral { center_mm: [x, y], radius_mm }) => {
            radius_mm - grain.reach_across_mm([center_mm[0] - x, center_mm[1] - y]).0
        }
    };
    domain.walls().map(gap_mm).fold(f64::INFINITY, smaller)
}

/// The smaller of two distances. A distance that is no number is less than all: it proves nothing, and must not be
/// passed over as [`f64::min`] does.
#[inline(always)]
fn smaller(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NEG_INFINITY } else { a.min(b) }
}

/// Of an ellipsoid by its shape matrix, with its centre at this offset from an axis along z: distance of the farthest
/// point from the axis, and the direction to it.
pub(super) fn farthest_of_ellipsoid(matrix_mm2: &Symmetric, from_axis_mm: [f64; 2]) -> (f64, Vector) {
    let [xx, xy, _, yy, ..] = matrix_mm2.0;
    let c = from_axis_mm;
    // Eigenvalues and vectors of the section; the smaller one by the determinant, which does not cancel.
    let half = (xx - yy) / 2.0;
    let root = (half * half + xy * xy).sqrt();
    let larger = (xx + yy) / 2.0 + root;
    let e = [larger, (xx * yy - xy * xy) / larger];
    let first = if half >= 0.0 { [half + root, xy] } else { [xy, root - half] };
    let length = (first[0] * first[0] + first[1] * first[1]).sqrt();
    let first = if length > 0.0 { [first[0] / length, first[1] / length] } else { [1.0, 0.0] };
    let second = [-first[1], first[0]];
    let along = [c[0] * first[0] + c[1] * first[1], c[0] * second[0] + c[1] * second[1]];
    // Weights of the constraint |v| = 1, which holds at the root of 1 / |v(t)| = 1; it is met from below. One that the
    // sum with its squared semi-axis does not show counts as none: `e_i + w_i` is no `t` above `e_i` then. It adds
    // `t - e_i + w_i² / (t - e_i)` to D, which is `2 w_i` at that `t`.
    let weights: [f64; ACROSS] = arrays::from_fn(|i| e[i].sqrt() * along[i].abs());
    let w: [f64; ACROSS] = arrays::from_fn(|i| if e[i] + weights[i] > e[i] { weights[i] } else { 0.0 });
    let left_out: f64 = (0..ACROSS).map(|i| 2.0 * (weights[i] - w[i])).sum();
    let mut t = (e[0] + w[0]).max(e[1] + w[1]);
    let value = |t: f64| {
        let part = |i: usize| if w[i] > 0.0 { w[i] * w[i] / (t - e[i]) } else { 0.0 };
        along[0] * along[0] + along[1] * along[1] + t + part(0) + part(1) + left_out
    };
    let mut least = value(t);
    for _ in 0..MOST_STEPS {
        let part = |i: usize| if w[i] > 0.0 { w[i] / (t - e[i]) } else { 0.0 };
        let v = [part(0), part(1)];
        let norm2 = v[0] * v[0] + v[1] * v[1];
        let slope = (0..ACROSS).map(|i| if v[i] > 0.0 { v[i] * v[i] / (t - e[i]) } else { 0.0 }).sum::<f64>();
        if norm2 <= 1.0 || slope <= 0.0 {
            break;
        }
        t += norm2 * (norm2.sqrt() - 1.0) / slope;
        let next = value(t);
        // Not where it is no number.
        if next < least {
            least = next;
        } else {
            break;
        }
    }
    // The point: v_1 takes what is left where the centre lies on the short axis.
    let v_1 = if w[1] > 0.0 { (w[1] / (t - e[1])).min(1.0) } else { 0.0 };
    let v_0 = (1.0 - v_1 * v_1).max(0.0).sqrt();
    let point = [along[0].abs() + e[0].sqrt() * v_0, along[1].abs() + e[1].sqrt() * v_1];
    let signed = [point[0].copysign(along[0]), point[1].copysign(along[1])];
    let across = [0, 1].each(|a| signed[0] * first[a] + signed[1] * second[a]);
    let length = (across[0] * across[0] + across[1] * across[1]).sqrt();
    (least.sqrt(), [across[0] / length, across[1] / length, 0.0])
}
