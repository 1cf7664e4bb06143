//! Least squares on the simplex: shares that are at least 0 and sum to 1.
//!
//! Method: active sets as in Lawson and Hanson (1974), Solving Least Squares Problems, chapter 23, with the sum as a
//! condition: the shares that are not 0 minimise the squares by themselves, and one more is added where this lowers
//! them. Limits of a band make a function of pieces of squares; its minimum is found by Newton steps of weighted least
//! squares with a search along each. A library that solves quadratic programs (clarabel) brings three versions of a
//! parser of Rust into the build and answers shares of 1e-10 in place of 0; these two short methods are exact to
//! rounding.

use nalgebra::{DMatrix, DVector};

/// Weight of the distance to the middle of a band beside that of the distance to the band.
const MIDDLE: f64 = 1.0e-6;
/// Rounding of a derivative, over the largest entry of the matrix.
const ROUNDING: f64 = 1.0e-14;
/// Most Newton steps.
const MOST_STEPS: usize = 1000;
/// Halvings of the interval in which a search along a step ends.
const HALVINGS: usize = 60;

/// A sieve and what is to pass it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub(super) sieve_mm: f64,
    pub(super) low: f64,
    pub(super) high: f64,
}

impl Limits {
    /// Weight and target of a row, where this passes.
    fn row(&self, passing: f64) -> (f64, f64) {
        let middle = 0.5 * (self.low + self.high);
        let broken = if passing <= self.low {
            self.low
        } else if passing >= self.high {
            self.high
        } else {
            return (MIDDLE, middle);
        };
        (1.0 + MIDDLE, (broken + MIDDLE * middle) / (1.0 + MIDDLE))
    }
}

/// The shares of stockpiles, each given by what passes each sieve, that come nearest to the limits.
pub(super) fn shares(passing: &[Vec<f64>], limits: &[Limits]) -> Vec<f64> {
    let matrix = DMatrix::from_fn(limits.len(), passing.len(), |row, column| passing[column][row]);
    let middle =
        DVector::from_iterator(limits.len(), limits.iter().map(|limit| 0.5 * (limit.low + limit.high)));
    // The stockpile that is nearest by itself, then the blend that is nearest to the middle.
    let square = |column: usize| (matrix.column(column) - &middle).norm_squared();
    let best = (0..passing.len()).min_by(|&a, &b| square(a).total_cmp(&square(b))).unwrap_or(0);
    let mut x = DVector::zeros(passing.len());
    x[best] = 1.0;
    x = on_simplex(&matrix, &middle, x);
    for _ in 0..MOST_STEPS {
        let rows: Vec<(f64, f64)> =
            (&matrix * &x).iter().zip(limits).map(|(passing, limit)| limit.row(*passing)).collect();
        let weighted = |row: usize| rows[row].0.sqrt();
        let scaled = DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| weighted(i) * matrix[(i, j)]);
        let target = DVector::from_fn(matrix.nrows(), |i, _| weighted(i) * rows[i].1);
        let step = on_simplex(&scaled, &target, x.clone()) - &x;
        if step.amax() <= f64::EPSILON {
            break;
        }
        // The derivative along the step rises and is linear in pieces.
        let direction = &matrix * &step;
        let slope = |part: f64| -> f64 {
            let at = &matrix * (&x + part * &step);
            let of_row = |row: usize| {
                let (weight, target) = limits[row].row(at[row]);
                weight * (at[row] - target) * direction[row]
            };
            (0..limits.len()).map(of_row).sum()
        };
        let part = if slope(1.0) <= 0.0 { 1.0 } else { root(slope) };
        x += part * step;
    }
    x.iter().map(|share| share.max(0.0)).collect()
}

/// Where a function that rises from below 0 to above it between 0 and 1 is 0.
fn root(f: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        *(if f(middle) < 0.0 { &mut low } else { &mut high }) = middle;
    }
    high
}

/// The `x` with entries of at least 0 and a sum of 1 that minimises `|A x - b|`, found from another such `x`.
fn on_simplex(matrix: &DMatrix<f64>, target: &DVector<f64>, mut x: DVector<f64>) -> DVector<f64> {
    let count = matrix.ncols();
    let mut used: Vec<usize> = (0..count).filter(|&column| x[column] > 0.0).collect();
    let tolerance = ROUNDING * matrix.amax().max(1.0) * matrix.nrows() as f64;
    let mut added = None;
    // Each round lowers the squares, so that no set of columns comes twice.
    loop {
        loop {
            let z = on_plane(matrix, target, &used);
            let shrinking = used.iter().zip(&z).filter(|(_, share)| **share <= 0.0);
            let part = shrinking.map(|(&column, share)| x[column] / (x[column] - share)).reduce(f64::min);
            let Some(part) = part.filter(|part| *part < 1.0) else {
                for (&column, share) in used.iter().zip(&z) {
                    x[column] = share.max(0.0);
                }
                break;
            };
            if part == 0.0 && added.is_some_and(|column: usize| x[column] == 0.0) {
                // The column that was added is a blend of the others but for rounding.
                return x;
            }
            for (&column, share) in used.iter().zip(&z) {
                x[column] += part * (share - x[column]);
            }
            used.retain(|&column| {
                if x[column] <= f64::EPSILON {
                    x[column] = 0.0;
                }
                x[column] > 0.0
            });
        }
        let gradient = matrix.tr_mul(&(matrix * &x - target));
        let level = x.dot(&gradient);
        let unused = (0..count).filter(|column| !used.contains(column));
        let Some(next) = unused.min_by(|&a, &b| gradient[a].total_cmp(&gradient[b])) else { return x };
        if gradient[next] >= level - tolerance {
            return x;
        }
        used.push(next);
        added = Some(next);
    }
}

/// The entries of `x` in these columns, with a sum of 1 and of any sign, that minimise `|A x - b|`; the others are 0.
fn on_plane(matrix: &DMatrix<f64>, target: &DVector<f64>, used: &[usize]) -> Vec<f64> {
    let base = matrix.column(used[0]);
    let differences = DMatrix::from_fn(matrix.nrows(), used.len() - 1, |row, other| {
        matrix[(row, used[other + 1])] - base[row]
    });
    let mut shares = vec![0.0; used.len()];
    if used.len() > 1 {
        let decomposition = differences.svd(true, true);
        // Both factors were asked for, so that a solution exists.
        if let Ok(others) = decomposition.solve(&(target - base), f64::EPSILON) {
            shares[1..].copy_from_slice(others.as_slice());
        }
    }
    shares[0] = 1.0 - shares[1..].iter().sum::<f64>();
    shares
}
