//! Ellipsoids and walls: planes by the support function, the lateral surface of a cylinder by the farthest point from
//! its axis.
//!
//! Seen along the axis of the cylinder, the ellipsoid is the ellipse `c + L u`, `|u| <= 1`, where `c` leads from the
//! axis to the centre and `P = L L^T` is the upper left block of the shape matrix. For every `l` above the larger
//! eigenvalue of `P`, weak duality gives
//!
//! ```text
//! max |c + L u|^2 <= D(l) = l (1 + c^T (l I - P)^-1 c)
//! ```
//!
//! and the least `D` is the maximum (the S-lemma: one quadratic constraint). So `D(l) <= (R - g)^2` for one `l` proves
//! that the grain keeps the gap `g` from a surface of radius `R`. In the principal axes, with eigenvalues `p_k`, the
//! best `l` is the zero of `1 - sum c_k^2 p_k / (l - p_k)^2`, found by bisection. The proof is that of the inequality
//! for `P` itself, in double-double arithmetic where floating point cannot decide.

use nalgebra::{Matrix2, Vector2};

use crate::arrays::Each as _;
use crate::check::body::Ellipsoid;
use crate::check::double_double::DoubleDouble;
use crate::check::region::SpecimenRegion;
use crate::check::separation::{ERROR, EXACT_ERROR};
use crate::elementary::{atan2, cos, sin};

/// Gap between an ellipsoid and the nearest wall, and whether it is at least `required`. Walls farther away than
/// `enough` may be left out of the gap.
pub(in crate::check) fn wall_gap(
    body: &Ellipsoid,
    region: &SpecimenRegion,
    required: f64,
    enough: f64,
) -> (f64, bool) {
    let planes = region.plane_walls().map(|(axis, length)| plane_gap(body, axis, length, required));
    let planes = planes.fold((f64::INFINITY, true), both);
    match region.lateral_mm {
        Some(radius) => both(planes, lateral_gap(body, radius, required, enough.max(required))),
        None => planes,
    }
}

fn both(a: (f64, bool), b: (f64, bool)) -> (f64, bool) {
    (a.0.min(b.0), a.1 && b.1)
}

/// Gap to the planes at 0 and at `length` across an axis.
fn plane_gap(body: &Ellipsoid, axis: usize, length: f64, required: f64) -> (f64, bool) {
    let (x, h) = (body.center[axis], body.axes.column(axis).norm());
    let gap = (x - h).min((length - x) - h);
    let scale = length + x.abs() + body.radius + required;
    let (excess, error) = (gap - required, ERROR * scale);
    let keeps = excess >= error || (excess >= -error && keeps_plane(body, axis, length, required, scale));
    (gap, keeps)
}

fn keeps_plane(body: &Ellipsoid, axis: usize, length: f64, required: f64, scale: f64) -> bool {
    let square = body.exact_axes().each(|row| row[axis] * row[axis]);
    let inset = (square[0] + square[1] + square[2]).sqrt() + required.into();
    let x = body.center[axis];
    let distances = [DoubleDouble::from(x), DoubleDouble::difference(length, x)];
    distances.into_iter().all(|distance| (distance - inset).to_f64() >= -EXACT_ERROR * scale)
}

/// Gap to the lateral surface of a cylinder whose axis is at `x = y = radius`; a bound on it that is larger than
/// `enough`, if there is one.
fn lateral_gap(body: &Ellipsoid, radius: f64, required: f64, enough: f64) -> (f64, bool) {
    let c = Vector2::new(body.center.x - radius, body.center.y - radius);
    let scale = radius + c.norm() + body.radius + required;
    let bound = radius - (c.norm() + body.radius);
    if bound > enough + ERROR * scale {
        return (bound, true);
    }
    let p: Matrix2<f64> = body.matrix.fixed_view::<2, 2>(0, 0).into();
    let farthest = Farthest::new(&p, &c);
    let gap = radius - farthest.distance;
    let (excess, error) = (gap - required, ERROR * scale * (2.0 + farthest.condition));
    let keeps = excess >= error || (excess >= -error && keeps_lateral(body, radius, required, &farthest));
    (gap, keeps)
}

/// The farthest point of an ellipse.
#[derive(Clone, Copy, Debug)]
struct Farthest {
    distance: f64,
    /// The multiplier `l`.
    multiplier: f64,
    /// How much rounding the formula for `D` enlarges.
    condition: f64,
}

impl Farthest {
    fn new(p: &Matrix2<f64>, c: &Vector2<f64>) -> Self {
        let mean = 0.5 * (p.m11 + p.m22);
        let half = Vector2::new(0.5 * (p.m11 - p.m22), p.m12);
        let spread = half.norm();
        let (large, small) = (mean + spread, mean - spread);
        // Half the angle of (difference, off-diagonal) is that of the larger axis.
        let angle = 0.5 * atan2(half.y, half.x);
        let axis = Vector2::new(cos(angle), sin(angle));
        let along = axis.dot(c).powi(2);
        let across = axis.perp(c).powi(2);
        // With t = l - large; it falls in t.
        let slope = |t: f64| along * large / (t * t) + across * small / (t + 2.0 * spread).powi(2) - 1.0;
        let (mut low, mut high) = (0.0, (along * large + across * small).sqrt());
        for _ in 0..200 {
            let t = 0.5 * (low + high);
            if t <= low || t >= high {
                break;
            }
            if slope(t) > 0.0 { low = t } else { high = t }
        }
        let share = |part: f64, of: f64| if part > 0.0 { part / of } else { 0.0 };
        let square = (large + high) * (1.0 + share(along, high) + share(across, high + 2.0 * spread));
        // Rounding of P must leave l above its eigenvalues.
        let t = high.max(64.0 * f64::EPSILON * large);
        Self { distance: square.sqrt(), multiplier: large + t, condition: (large + t) / t }
    }
}

/// `D(l) <= T^2`, `T = R - g`, as `T^2 det M >= l (det M + c^T adj(M) c)` with `M = l I - P` and `det M > 0`.
fn keeps_lateral(body: &Ellipsoid, radius: f64, required: f64, farthest: &Farthest) -> bool {
    let center = [0, 1].each(|k| DoubleDouble::difference(body.center[k], radius));
    let axes = body.exact_axes();
    let entry =
        |i: usize, j: usize| axes[0][i] * axes[0][j] + axes[1][i] * axes[1][j] + axes[2][i] * axes[2][j];
    let room = DoubleDouble::difference(radius, required);
    if room.to_f64() < 0.0 {
        return false;
    }
    let is_central = center.iter().all(|c| c.to_f64() == 0.0);
    // A central ellipse fits if its matrix is at most T^2 I.
    let l = if is_central { room * room } else { farthest.multiplier.into() };
    let (m11, m22, m12) = (l - entry(0, 0), l - entry(1, 1), -entry(0, 1));
    let determinant = m11 * m22 - m12 * m12;
    let l2 = (l * l).to_f64();
    let lengths2 =
        (room * room).to_f64() + l.to_f64() + (center[0] * center[0] + center[1] * center[1]).to_f64();
    if is_central {
        let least = -EXACT_ERROR * lengths2;
        return m11.to_f64() >= least && m22.to_f64() >= least && determinant.to_f64() >= least * lengths2;
    }
    if m11.to_f64() <= 0.0 || determinant.to_f64() <= EXACT_ERROR * l2 {
        return false;
    }
    let [x, y] = center;
    let form = m22 * x * x + m11 * y * y - DoubleDouble::from(2.0) * m12 * x * y;
    let excess = (room * room - l) * determinant - l * form;
    let error = EXACT_ERROR * l2 * lengths2;
    // Where M is near singular the rounding error stands for more than the last digits of a length.
    let is_regular = determinant.to_f64() >= l2 / 65536.0;
    excess.to_f64() >= if is_regular { -error } else { error }
}
