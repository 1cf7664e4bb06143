//! A lower bound of the largest of some linear functions of three variables over a cube.
//!
//! The least value of `max_k (a_k + g_k . u)` over `|u_i| <= 1` is a linear programme. Its dual is solved by the
//! simplex method (G. B. Dantzig, Linear Programming and Extensions, 1963, chapters 5 and 6). The bound is then
//! evaluated from the multipliers `x >= 0`, `sum x = 1`, that the method ended with: `sum x_k a_k - sum_i |sum_k x_k
//! g_ki|`. It holds for any such multipliers, so that no fault of the method makes it wrong.

use crate::arrays::{self, Each as _};

/// Most exchanges of a column of the basis.
const EXCHANGES: usize = 60;
/// What rounding leaves of a gain, over the values of the functions.
const ROUNDING: f64 = 1.0e-14;

/// A linear function of a point of the cube.
#[derive(Clone, Copy, Debug)]
pub(super) struct Linear {
    pub(super) value: f64,
    pub(super) slope: [f64; 3],
}

/// What is known of the largest of some functions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bound {
    /// A value that the largest function has at least, everywhere.
    pub(super) least: f64,
    /// Where it is about as small as it gets.
    pub(super) at: [f64; 3],
}

/// A column of the programme: a function, or a side of the cube.
#[derive(Clone, Copy, Debug, Default)]
enum Column {
    #[default]
    None,
    Function(usize),
    Side(usize, f64),
}

/// Bounds the largest of some functions from below; `None` where there are none.
pub(super) fn lower_bound(functions: &[Linear]) -> Option<Bound> {
    let (highest, first) =
        functions.iter().enumerate().max_by(|(_, a), (_, b)| a.value.total_cmp(&b.value))?;
    // The basis of this function and the sides that balance its slope, and the inverse of its matrix.
    let mut basis = [Column::Function(highest); 4];
    let mut inverse = [[0.0; 4]; 4];
    let mut shares = [0.0, 0.0, 0.0, 1.0];
    for axis in 0..3 {
        let sign = if first.slope[axis] > 0.0 { -1.0 } else { 1.0 };
        basis[axis] = Column::Side(axis, sign);
        shares[axis] = first.slope[axis].abs();
        inverse[axis][axis] = sign;
        inverse[axis][3] = -sign * first.slope[axis];
    }
    inverse[3][3] = 1.0;
    let entries = |column: Column| match column {
        Column::Function(k) => {
            let [x, y, z] = functions[k].slope;
            ([x, y, z, 1.0], functions[k].value)
        }
        Column::Side(axis, sign) => (arrays::from_fn(|i| if i == axis { sign } else { 0.0 }), -1.0),
        Column::None => ([0.0; 4], 0.0),
    };
    let scale = functions.iter().map(|f| f.value.abs() + f.slope[0].abs()).fold(0.0, f64::max);
    let mut prices = [0.0; 4];
    for _ in 0..EXCHANGES {
        let costs = basis.each(|column| entries(column).1);
        prices = arrays::from_fn(|j| (0..4).map(|i| costs[i] * inverse[i][j]).sum());
        let (mut entering, mut most) = (Column::None, ROUNDING * scale);
        for (k, function) in functions.iter().enumerate() {
            let gain = function.value - product(&function.slope, &prices) - prices[3];
            if gain > most {
                (entering, most) = (Column::Function(k), gain);
            }
        }
        for (axis, price) in prices.iter().enumerate().take(3) {
            let gain = price.abs() - 1.0;
            if gain > most.max(ROUNDING) {
                (entering, most) = (Column::Side(axis, -price.signum()), gain);
            }
        }
        if matches!(entering, Column::None) {
            break;
        }
        let (entries, _) = entries(entering);
        let change: [f64; 4] = inverse.each(|row| (0..4).map(|j| row[j] * entries[j]).sum());
        let ratio =
            |i: usize| if change[i] > 1.0e-13 { shares[i].max(0.0) / change[i] } else { f64::INFINITY };
        let Some(leaving) = (0..4).min_by(|&i, &j| ratio(i).total_cmp(&ratio(j))) else { break };
        let step = ratio(leaving);
        if !step.is_finite() {
            break;
        }
        let pivot = inverse[leaving].each(|x| x / change[leaving]);
        for i in (0..4).filter(|&i| i != leaving) {
            shares[i] -= step * change[i];
            inverse[i] = arrays::from_fn(|j| inverse[i][j] - change[i] * pivot[j]);
        }
        (inverse[leaving], shares[leaving], basis[leaving]) = (pivot, step, entering);
    }
    let (mut value, mut slope, mut sum) = (0.0, [0.0; 3], 0.0);
    for (column, share) in basis.iter().zip(shares) {
        if let Column::Function(k) = *column {
            let share = share.max(0.0);
            sum += share;
            value += share * functions[k].value;
            slope = arrays::from_fn(|i| slope[i] + share * functions[k].slope[i]);
        }
    }
    let least = if sum > 0.0 {
        (value - slope.iter().map(|x: &f64| x.abs()).sum::<f64>()) / sum
    } else {
        f64::NEG_INFINITY
    };
    Some(Bound { least, at: arrays::from_fn(|i| (-prices[i]).clamp(-1.0, 1.0)) })
}

fn product(slope: &[f64; 3], prices: &[f64; 4]) -> f64 {
    slope[0] * prices[0] + slope[1] * prices[1] + slope[2] * prices[2]
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream, uniform};

    #[test]
    fn the_bound_is_the_least_value_of_the_largest_function() {
        let mut rng = stream(1, Stream::Shape);
        let mut number = || 2.0 * uniform(&mut rng) - 1.0;
        for round in 0..300 {
            let functions: Vec<Linear> = (0..=round % 20)
                .map(|_| Linear { value: 3.0 + 0.1 * number(), slope: [number(), number(), number()] })
                .collect();
            let largest = |u: &[f64; 3]| {
                let value = |f: &Linear| f.value + f.slope[0] * u[0] + f.slope[1] * u[1] + f.slope[2] * u[2];
                functions.iter().map(value).fold(f64::NEG_INFINITY, f64::max)
            };
            let bound = lower_bound(&functions).unwrap();
            assert!((largest(&bound.at) - bound.least).abs() < 1e-12, "{functions:?}");
            for _ in 0..200 {
                assert!(largest(&[number(), number(), number()]) >= bound.least - 1e-12, "{functions:?}");
            }
        }
        assert!(lower_bound(&[]).is_none());
    }
}
