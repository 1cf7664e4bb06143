//! Means over values of an unknown that are weighted by how likely they are.

use crate::elementary::exp;

/// Means of several quantities, each with its values by case; a case has the weight `exp(ln_weight)`, and one at least
/// is finite.
pub(crate) fn means<const CASES: usize, const N: usize>(cases: &[(f64, [f64; N]); CASES]) -> [f64; N] {
    // Of the differences from the largest no exponential overflows.
    let most = cases.iter().fold(f64::NEG_INFINITY, |most, (ln_weight, _)| most.max(*ln_weight));
    let (mut weights, mut sums) = (0.0, [0.0; N]);
    for (ln_weight, values) in cases {
        let weight = exp(ln_weight - most);
        weights += weight;
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += weight * value;
        }
    }
    sums.map(|sum| sum / weights)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_count_by_their_weight() {
        let [mean] = means(&[(1000.0, [1.0]), (1000.0 + 3.0_f64.ln(), [5.0]), (-1000.0, [1e9])]);
        assert!((mean - 4.0).abs() < 1e-12, "{mean}");
        assert_eq!(means(&[(-5.0, [2.0, 7.0])]), [2.0, 7.0]);
    }
}
