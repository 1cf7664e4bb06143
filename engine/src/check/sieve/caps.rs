//! Caps of directions in which a body is surely as wide as a square.
//!
//! Let `v` be a unit direction and `d_k` differences of two corners with `d_k . v >= s`, and let
//! `kappa = min over unit vectors t at right angles to v of max_k d_k . t` be positive: a local minimum of the width.
//! In the direction `cos(a) v + sin(a) t` the width is at least `s cos(a) + kappa sin(a)`, which is at least `s` where
//! `tan(a / 2) <= kappa / s`.
//!
//! Where one side of the least square is such a minimum, the other is free to turn, and all squares on the way are
//! equally small. Caps leave these out at once.

use super::linear::{Linear, lower_bound};
use super::{V, ends, frame_of};

/// Half of the side of the square of directions about one in which a minimum is looked for.
const REACH: f64 = 0.05;
/// Most steps to a minimum, and most differences that one step finds.
const STEPS: usize = 20;
const DIFFERENCES: usize = 60;
/// Widths that are equal, over the width.
const EQUAL: f64 = 1.0e-11;

/// Directions about an axis and its opposite.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cap {
    axis: V,
    /// Tangent of half of the angle of the cap.
    half_tan: f64,
}

impl Cap {
    /// The cap about the minimum of the width nearest to a direction, in which the width is at least `side`; `None`
    /// where there is no such minimum close by.
    pub(super) fn near(corners: &[V], direction: &V, side: f64) -> Option<Self> {
        let (axis, differences) = narrowest(corners, direction)?;
        let width = differences.iter().map(|d| d.dot(&axis)).fold(f64::NEG_INFINITY, f64::max);
        let active: Vec<V> =
            differences.into_iter().filter(|d| d.dot(&axis) >= width * (1.0 - EQUAL)).collect();
        let least = active.iter().map(|d| d.dot(&axis)).fold(f64::INFINITY, f64::min);
        if least < side {
            return None;
        }
        let slope = least_slope(&axis, &active)?;
        (slope > 0.0).then(|| Self { axis, half_tan: slope / least })
    }

    /// Whether all directions within an angle of one lie in the cap; `half_tan` is the tangent of half of the angle.
    pub(super) fn holds(&self, direction: &V, half_tan: f64) -> bool {
        let (difference, sum) = ((direction - self.axis).norm(), (direction + self.axis).norm());
        let (difference, sum) = if difference < sum { (difference, sum) } else { (sum, difference) };
        let away = difference / sum;
        away * half_tan < 1.0 && (away + half_tan) / (1.0 - away * half_tan) <= self.half_tan
    }
}

/// The minimum of the width nearest to a direction, with the differences that matter there.
///
/// The width of all multiples of directions is convex, so that its least value on the plane that touches the sphere is
/// that of a linear programme; a direction that is least on its own plane is a minimum.
fn narrowest(corners: &[V], direction: &V) -> Option<(V, Vec<V>)> {
    let mut axis = *direction;
    for _ in 0..STEPS {
        let [u, w] = frame_of(&axis);
        let mut differences: Vec<V> = Vec::new();
        let mut place = axis;
        for _ in 0..DIFFERENCES {
            let ([from, to], _) = ends(corners, &place);
            let difference = corners[to as usize] - corners[from as usize];
            if differences.contains(&difference) {
                break;
            }
            differences.push(difference);
            let functions: Vec<Linear> = differences
                .iter()
                .map(|d| Linear { value: d.dot(&axis), slope: [REACH * d.dot(&u), REACH * d.dot(&w), 0.0] })
                .collect();
            let at = lower_bound(&functions)?.at;
            place = axis + (u * at[0] + w * at[1]) * REACH;
        }
        let next = place.normalize();
        let moved = (next - axis).norm();
        axis = next;
        if moved < 1.0e-13 {
            return Some((axis, differences));
        }
    }
    None
}

/// The least, over all directions at right angles to an axis, of the largest product with the vectors; `None` where
/// there are fewer than two.
fn least_slope(axis: &V, vectors: &[V]) -> Option<f64> {
    let [u, w] = frame_of(axis);
    let flat: Vec<[f64; 2]> = vectors.iter().map(|d| [d.dot(&u), d.dot(&w)]).collect();
    let mut least: Option<f64> = None;
    for (i, a) in flat.iter().enumerate() {
        for b in &flat[..i] {
            // The largest product is least where two are equal.
            let [x, y] = [b[1] - a[1], a[0] - b[0]];
            let length = (x * x + y * y).sqrt();
            if length <= 0.0 {
                continue;
            }
            for sign in [1.0, -1.0] {
                let along = |d: &[f64; 2]| sign * (d[0] * x + d[1] * y) / length;
                let slope = flat.iter().map(along).fold(f64::NEG_INFINITY, f64::max);
                least = Some(least.map_or(slope, |least| least.min(slope)));
            }
        }
    }
    least
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_cube_is_as_wide_as_an_edge_in_all_directions() {
        let corners: Vec<V> = (0..8).map(|i| V::from_fn(|axis, _| f64::from(i >> axis & 1))).collect();
        let cap = Cap::near(&corners, &V::new(0.02, 0.03, 1.0).normalize(), 1.0).unwrap();
        assert!((cap.axis - V::z()).norm() < 1e-12, "{cap:?}");
        // The width along (sin a, 0, cos a) is sin a + cos a, which some of the differences show up to a smaller angle.
        assert!(cap.half_tan > 0.1 && cap.half_tan < 1.0 + 1e-9, "{cap:?}");
        assert!(cap.holds(&-V::z(), 0.09) && !cap.holds(&V::x(), 0.01));
        assert!(cap.holds(&V::new(0.02, 0.0, 1.0).normalize(), 0.01), "{cap:?}");
        assert!(Cap::near(&corners, &V::z(), 1.000_1).is_none());
    }
}
