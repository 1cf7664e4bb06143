//! The confidence interval of a success rate: the score interval of Wilson (1927,
//! <https://doi.org/10.1080/01621459.1927.10502953>), which lies within 0..1 and has nearly its nominal coverage for
//! few runs and for rates near 0 and 1 (Newcombe 1998).

/// 97.5 % quantile of the normal distribution: both tails together have 5 %.
const Z: f64 = 1.959_963_984_540_054;

/// The 95 % interval of a success rate, from `successes` of `runs`; `None` without runs.
pub(crate) fn wilson(successes: u64, runs: u64) -> Option<[f64; 2]> {
    if runs == 0 {
        return None;
    }
    let n = runs as f64;
    let rate = successes as f64 / n;
    let z2 = Z * Z;
    let middle = (rate + z2 / (2.0 * n)) / (1.0 + z2 / n);
    let half = Z / (1.0 + z2 / n) * (rate * (1.0 - rate) / n + z2 / (4.0 * n * n)).sqrt();
    // The ends 0 and 1 are exact.
    let low = if successes == 0 { 0.0 } else { (middle - half).max(0.0) };
    let high = if successes == runs { 1.0 } else { (middle + half).min(1.0) };
    Some([low, high])
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_published_one() {
        // Newcombe (1998), table I, method 3: score without continuity correction.
        for (successes, runs, low, high) in [
            (81, 263, 0.2553, 0.3662),
            (15, 148, 0.0624, 0.1605),
            (0, 20, 0.0, 0.1611),
            (1, 29, 0.0061, 0.1718),
        ] {
            let [found_low, found_high] = wilson(successes, runs).unwrap();
            assert!((found_low - low).abs() < 5.1e-5, "{successes}/{runs}: {found_low}");
            assert!((found_high - high).abs() < 5.1e-5, "{successes}/{runs}: {found_high}");
        }
    }

    #[test]
    fn it_holds_the_rate_mirrors_and_narrows() {
        assert_eq!(wilson(0, 0), None);
        for runs in 1..200_u64 {
            for successes in 0..=runs {
                let [low, high] = wilson(successes, runs).unwrap();
                let rate = successes as f64 / runs as f64;
                assert!((0.0..=rate).contains(&low) && (rate..=1.0).contains(&high), "{successes}/{runs}");
                let [mirrored, _] = wilson(runs - successes, runs).unwrap();
                assert!((high - (1.0 - mirrored)).abs() < 1e-12, "{successes}/{runs}");
                let [more_low, more_high] = wilson(2 * successes, 2 * runs).unwrap();
                assert!(more_high - more_low < high - low, "{successes}/{runs}");
            }
        }
    }
}
