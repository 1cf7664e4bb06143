//! The rule that stops the runs of a point of a study.
//!
//! The caller counts every run that ends in the [`Tally`] of its point, in the order in which the runs end. When the
//! rule is met, the caller cancels the queued jobs of the point. Running jobs continue, and are counted.

use serde::{Deserialize, Serialize};

use super::interval::wilson;
use super::{Outcome, StopWhen};

/// Fewest runs from which the width of the interval is evaluated.
const LEAST_RUNS_OF_A_RATE: u64 = 5;

/// How the runs of one point have ended so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Tally {
    /// Runs that count: all but the void ones.
    pub(crate) runs: u64,
    pub(crate) successes: u64,
    /// Runs that did not reach their packing since the last success.
    pub(crate) failed_in_a_row: u64,
    /// The rule has been met. It stays met, whatever later runs give.
    pub(crate) stopped: bool,
}

impl Tally {
    /// Counts a run that ended, and returns whether the rule is met.
    pub(crate) fn ended(&mut self, outcome: Outcome, rule: &StopWhen) -> bool {
        match outcome {
            Outcome::Succeeded => {
                self.runs += 1;
                self.successes += 1;
                self.failed_in_a_row = 0;
            }
            Outcome::Partial | Outcome::TargetNotReached => {
                self.runs += 1;
                self.failed_in_a_row += 1;
            }
            Outcome::Void => return self.stopped,
        }
        let failed = rule.failed_in_a_row.is_some_and(|most| self.failed_in_a_row >= u64::from(most));
        let known = self.runs >= LEAST_RUNS_OF_A_RATE
            && rule.interval_width.is_some_and(|width| {
                wilson(self.successes, self.runs).is_some_and(|[low, high]| high - low < width)
            });
        self.stopped |= failed || known;
        self.stopped
    }
}

#[cfg(test)]
mod tests {
    use Outcome::{Partial, Succeeded, TargetNotReached, Void};

    use super::*;

    fn after(outcomes: &[Outcome], rule: &StopWhen) -> Vec<bool> {
        let mut tally = Tally::default();
        outcomes.iter().map(|outcome| tally.ended(*outcome, rule)).collect()
    }

    #[test]
    fn failures_count_in_a_row_and_void_runs_neither_add_nor_break_it() {
        let rule = StopWhen { failed_in_a_row: Some(2), interval_width: None };
        assert_eq!(
            after(&[TargetNotReached, Succeeded, Partial, Void, TargetNotReached, Succeeded], &rule),
            [false, false, false, false, true, true]
        );
        assert_eq!(after(&[Void; 10], &rule), [false; 10]);
    }

    #[test]
    fn a_narrow_interval_stops_from_five_runs_on() {
        let wide = StopWhen { failed_in_a_row: None, interval_width: Some(1.0) };
        assert_eq!(after(&[Succeeded; 5], &wide), [false, false, false, false, true]);
        // Of n successes only, the interval's width is z^2 / (n + z^2): below 0.2 from 16 on.
        let narrow = StopWhen { failed_in_a_row: None, interval_width: Some(0.2) };
        let met = after(&[Succeeded; 20], &narrow).iter().position(|stopped| *stopped);
        assert_eq!(met, Some(15));
    }

    #[test]
    fn without_a_rule_nothing_stops() {
        assert_eq!(after(&[TargetNotReached; 100], &StopWhen::default()), [false; 100]);
    }
}
