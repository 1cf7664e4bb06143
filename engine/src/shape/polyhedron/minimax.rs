//! The least of the largest of some linear functions of three variables, within a cube: a linear programme, solved by
//! the simplex method on its dual, whose bases have four columns.
//!
//! Minimise `t` so that `value_k + slope_k . w <= t` for all planes and `|w_i| <= reach`. The dual is: maximise the sum
//! of `x_j cost_j` over columns with `x >= 0` and `sum x_j column_j = (0, 0, 0, 1)`; planes have the column
//! `(slope, 1)` and the cost `value`, bounds `(+-e_i, 0)` and `-reach`.

use nalgebra::{Matrix4, Vector3, Vector4};

use crate::arrays::Each as _;

/// Most exchanges of a column.
const EXCHANGES: usize = 100;
/// What rounding leaves of a violation, over the largest value.
const ROUNDING: f64 = 1.0e-13;

/// A linear function of three variables.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    pub(super) value: f64,
    pub(super) slope: Vector3<f64>,
}

/// The point of the cube where the largest of the planes is least, and its value there. Without planes it is the
/// centre and no value.
pub(super) fn least_maximum(planes: &[Plane], reach: f64) -> (Vector3<f64>, f64) {
    let highest = |p: &Plane, q: &Plane| p.value.total_cmp(&q.value);
    let Some(first) = planes.iter().copied().max_by(highest) else {
        return (Vector3::zeros(), f64::NEG_INFINITY);
    };
    let of_plane = |plane: &Plane| (plane.slope.push(1.0), plane.value);
    let bound = |axis: usize, sign: f64| {
        let mut column = Vector4::zeros();
        column[axis] = sign;
        (column, -reach)
    };
    // The plane and the bounds that balance its slope.
    let mut basis = [of_plane(&first); 4];
    let mut shares = Vector4::new(0.0, 0.0, 0.0, 1.0);
    for axis in 0..3 {
        basis[axis] = bound(axis, if first.slope[axis] > 0.0 { -1.0 } else { 1.0 });
        shares[axis] = first.slope[axis].abs();
    }
    let mut answer = (Vector3::zeros(), first.value);
    let tolerance = ROUNDING * planes.iter().map(|plane| plane.value.abs()).fold(0.0, f64::max);
    for _ in 0..EXCHANGES {
        let matrix = Matrix4::from_columns(&basis.each(|(column, _)| column));
        let Some(inverse) = matrix.try_inverse() else { break };
        let costs = Vector4::from(basis.each(|(_, cost)| cost));
        let prices = inverse.tr_mul(&costs);
        answer = (-prices.xyz(), prices.w);
        let excess = |&(column, cost): &(Vector4<f64>, f64)| cost - column.dot(&prices);
        let bounds = (0..3).flat_map(|axis| [bound(axis, 1.0), bound(axis, -1.0)]);
        let mut entering = None;
        let mut most = tolerance;
        for column in planes.iter().map(of_plane).chain(bounds) {
            let excess = excess(&column);
            if excess > most {
                (entering, most) = (Some(column), excess);
            }
        }
        let Some(entering) = entering else { break };
        let way = inverse * entering.0;
        let ratio = |i: usize| if way[i] > 1e-14 { shares[i].max(0.0) / way[i] } else { f64::INFINITY };
        let Some(leaving) = (0..4).min_by(|&i, &j| ratio(i).total_cmp(&ratio(j))) else { break };
        let step = ratio(leaving);
        if !step.is_finite() {
            break;
        }
        shares -= way * step;
        shares[leaving] = step;
        basis[leaving] = entering;
    }
    // Rounding must not lead out of the cube.
    (answer.0.map(|x| x.clamp(-reach, reach)), answer.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream, uniform};

    fn plane(value: f64, slope: [f64; 3]) -> Plane {
        Plane { value, slope: slope.into() }
    }

    #[test]
    fn corners_and_bounds_are_found() {
        // A pyramid with its tip at (0.1, 0.2, 0.3).
        let tip = Vector3::new(0.1, 0.2, 0.3);
        let slopes =
            [[1.0, 1.0, 1.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 1.0], [0.5, -0.5, -2.0]].map(Vector3::from);
        let planes = slopes.map(|slope| Plane { value: 2.0 - slope.dot(&tip), slope });
        let (at, value) = least_maximum(&planes, 1.0);
        assert!((at - tip).norm() < 1e-12 && (value - 2.0).abs() < 1e-12, "{at} {value}");
        // Out of reach: the corner of the cube.
        let (at, value) = least_maximum(&[plane(1.0, [1.0, -2.0, 3.0])], 0.1);
        assert!((at - Vector3::new(-0.1, 0.1, -0.1)).norm() < 1e-15 && (value - 0.4).abs() < 1e-15);
        assert_eq!(least_maximum(&[], 0.1), (Vector3::zeros(), f64::NEG_INFINITY));
        assert_eq!(least_maximum(&[plane(1.0, [0.0; 3])], 0.1).1, 1.0);
    }

    #[test]
    fn no_point_of_the_cube_is_lower() {
        let mut rng = stream(1, Stream::Shape);
        for round in 0..200 {
            let mut number = || 2.0 * uniform(&mut rng) - 1.0;
            let planes: Vec<Plane> = (0..=round % 20)
                .map(|_| plane(3.0 + 0.1 * number(), [number(), number(), number()]))
                .collect();
            let largest = |at: &Vector3<f64>| {
                planes.iter().map(|p| p.value + p.slope.dot(at)).fold(f64::NEG_INFINITY, f64::max)
            };
            let (at, value) = least_maximum(&planes, 0.1);
            assert!((largest(&at) - value).abs() < 1e-12, "{planes:?}");
            for _ in 0..300 {
                let other = Vector3::new(number(), number(), number()) * 0.1;
                assert!(largest(&other) > value - 1e-12, "{planes:?}: {other}");
            }
        }
    }
}
