//! Shards of a study: which points each of `n` processes runs, so that several machines share the work.
//!
//! All runs of a point belong to one shard, so that its seeds, its stop rule and the order of its runs are those of a
//! study on one machine. The points are assigned by their forecast, the longest first, each to the shard that has the
//! least work so far (LPT, Graham 1969, doi:10.1137/0117039): no shard has more than `4/3 - 1/(3n)` of the least
//! possible work of the fullest one.

use std::str::FromStr;

use super::{MAX_JOBS, Point, Study};

/// Shard `index` of `count`, counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shard {
    pub(crate) index: usize,
    pub(crate) count: usize,
}

impl FromStr for Shard {
    type Err = String;

    /// Reads `i/n`.
    fn from_str(text: &str) -> Result<Self, String> {
        let malformed = || "must be I/N, for example 0/8: shard I of N, where I counts from 0".to_owned();
        let (index, count) = text.split_once('/').ok_or_else(malformed)?;
        let number = |digits: &str| {
            let plain = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
            plain.then(|| digits.parse::<usize>().ok()).flatten().ok_or_else(malformed)
        };
        let (index, count) = (number(index)?, number(count)?);
        if count == 0 || count > MAX_JOBS {
            return Err(format!("there are 1 to {MAX_JOBS} shards, not {count}"));
        }
        if index >= count {
            return Err(format!(
                "the {count} shards are 0 to {last}, there is no shard {index}: shards count from 0, as \
                 the tasks of `sbatch --array=0-{last}` do",
                last = count - 1
            ));
        }
        Ok(Self { index, count })
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

/// The forecast work of every point in ms of one core, at least 1: all replicates, without regard to stop rules.
pub(crate) fn forecast_ms(study: &Study) -> Vec<u64> {
    let of = |point: &Point| {
        let run_s = point.job.timeout_s.map_or(point.forecast_s, |most| most.min(point.forecast_s));
        ((run_s.max(0.0) * 1e3) as u64).saturating_mul(study.replicates as u64).max(1)
    };
    study.points.iter().map(of).collect()
}

/// The points of each of `count` shards, the longest first. Of equal points the first comes first, of equally full
/// shards the first takes the point.
pub(crate) fn assign(work_ms: &[u64], count: usize) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..work_ms.len()).collect();
    order.sort_by_key(|&point| (std::cmp::Reverse(work_ms[point]), point));
    let mut shards = vec![(0_u64, Vec::new()); count.max(1)];
    for point in order {
        if let Some((load, points)) = shards.iter_mut().min_by_key(|(load, _)| *load) {
            *load = load.saturating_add(work_ms[point]);
            points.push(point);
        }
    }
    shards.into_iter().map(|(_, points)| points).collect()
}

/// The work of the fullest of `count` shards, in ms of one core.
pub(crate) fn longest_ms(work_ms: &[u64], count: usize) -> u64 {
    let load =
        |points: &Vec<usize>| points.iter().fold(0_u64, |sum, &point| sum.saturating_add(work_ms[point]));
    assign(work_ms, count).iter().map(load).max().unwrap_or(0)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_shard_counts_from_zero_and_the_refusal_names_the_range() {
        assert_eq!("0/1".parse(), Ok(Shard { index: 0, count: 1 }));
        assert_eq!("7/8".parse::<Shard>().unwrap().to_string(), "7/8");
        let refused = "8/8".parse::<Shard>().unwrap_err();
        assert!(refused.contains("0 to 7") && refused.contains("--array=0-7"), "{refused}");
        for text in ["", "/", "1", "1/", "/2", "-1/2", "+1/2", "1/2/3", " 1/2", "a/b", "1.0/2"] {
            assert!(text.parse::<Shard>().unwrap_err().contains("I/N"), "{text:?}");
        }
        for text in ["0/0", "0/10001", "0/99999999999999999999"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }

    #[test]
    fn the_longest_point_comes_first_and_ties_go_to_the_first() {
        assert_eq!(assign(&[1, 5, 5, 3, 2], 2), [vec![1, 3], vec![2, 4, 0]]);
        assert_eq!(assign(&[1, 1], 3), [vec![0], vec![1], vec![]]);
        assert_eq!(longest_ms(&[1, 5, 5, 3, 2], 2), 8);
        assert_eq!(longest_ms(&[], 2), 0);
    }

    /// The least work of the fullest shard, by trying every assignment.
    fn least(work: &[u64], loads: &mut [u64]) -> u64 {
        let Some((first, rest)) = work.split_first() else {
            return loads.iter().copied().max().unwrap_or(0);
        };
        let tried = (0..loads.len()).map(|shard| {
            loads[shard] += first;
            let least = least(rest, loads);
            loads[shard] -= first;
            least
        });
        tried.collect::<Vec<_>>().into_iter().min().unwrap()
    }

    proptest! {
        #[test]
        fn every_point_is_in_exactly_one_shard(
            work in prop::collection::vec(prop_oneof![1..9_u64, 1..u64::MAX], 0..200), count in 1..60_usize
        ) {
            let shards = assign(&work, count);
            prop_assert_eq!(shards.len(), count);
            for points in &shards {
                prop_assert!(points.is_sorted_by_key(|&point| std::cmp::Reverse(work[point])));
            }
            let mut all: Vec<usize> = shards.concat();
            all.sort_unstable();
            prop_assert_eq!(all, (0..work.len()).collect::<Vec<_>>());
            prop_assert_eq!(shards, assign(&work, count));
        }

        #[test]
        fn shards_are_as_balanced_as_the_theorem_says(
            work in prop::collection::vec(1..50_u64, 1..8), count in 1..4_usize
        ) {
            let least = least(&work, &mut vec![0; count]);
            let n = count as u64;
            // longest <= (4/3 - 1/(3n)) least, in whole numbers.
            prop_assert!(3 * n * longest_ms(&work, count) <= (4 * n - 1) * least);
        }

        /// No shard has more than the mean and one point: what holds for any number of points.
        #[test]
        fn no_shard_has_more_than_the_mean_and_its_last_point(
            work in prop::collection::vec(1..1_000_000_u64, 1..300), count in 1..40_usize
        ) {
            let mean = work.iter().sum::<u64>() as f64 / count as f64;
            for points in assign(&work, count).iter().filter(|points| !points.is_empty()) {
                let load: u64 = points.iter().map(|&point| work[point]).sum();
                prop_assert!((load - work[*points.last().unwrap()]) as f64 <= mean);
            }
        }
    }
}
