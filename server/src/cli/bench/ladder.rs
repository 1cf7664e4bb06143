//! The highest amount that at least half of the seeds reach, found from below.
//!
//! It knows rungs and verdicts; it must never know what is packed.

/// Rungs that are tried one after another, in thousandths so that each is an exact decimal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Ladder {
    pub(super) first: u32,
    pub(super) step: u32,
}

/// How far a climb came.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Climb {
    /// The rungs tried, from below. All but the last were reached; the last was not, unless there is
    /// none above.
    pub(super) rungs: Vec<Rung>,
}

/// What seeds did on one rung; those that could not change the verdict were left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Rung {
    pub(super) thousandths: u32,
    pub(super) succeeded: u64,
    pub(super) tried: u64,
    pub(super) reached: bool,
}

impl Ladder {
    /// Climbs as long as at least half of the seeds reach a rung.
    pub(super) fn climb<E>(
        self,
        seeds: u64,
        mut reaches: impl FnMut(u32, u64) -> Result<bool, E>,
    ) -> Result<Climb, E> {
        let mut climb = Climb::default();
        let mut thousandths = self.first;
        while thousandths < 1000 {
            let (mut succeeded, mut tried) = (0, 0);
            // Until half have succeeded, or so many have failed that half can't any more.
            while 2 * succeeded < seeds && 2 * (tried - succeeded) <= seeds {
                tried += 1;
                succeeded += u64::from(reaches(thousandths, tried)?);
            }
            let reached = 2 * succeeded >= seeds;
            climb.rungs.push(Rung { thousandths, succeeded, tried, reached });
            if !reached {
                break;
            }
            thousandths += self.step;
        }
        Ok(climb)
    }
}

impl Climb {
    /// The last rung that was reached.
    pub(super) fn top(&self) -> Option<Rung> {
        self.rungs.iter().rfind(|rung| rung.reached).copied()
    }

    /// The rung that was not.
    pub(super) fn missed(&self) -> Option<Rung> {
        self.rungs.last().filter(|rung| !rung.reached).copied()
    }
}

impl Rung {
    /// The amount.
    pub(super) fn fraction(&self) -> f64 {
        f64::from(self.thousandths) / 1000.0
    }
}

impl std::fmt::Display for Climb {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let missed = self.missed();
        match (self.top(), missed) {
            (Some(top), _) => write!(f, "{:.3}", top.fraction())?,
            (None, Some(missed)) => write!(f, "below {:.3}", missed.fraction())?,
            (None, None) => write!(f, "nothing tried")?,
        }
        match missed {
            Some(missed) => {
                write!(f, " ({} of {} at {:.3})", missed.succeeded, missed.tried, missed.fraction())
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Climbs where a seed reaches what `limit` says for it, and tells which runs that took.
    fn climb(ladder: Ladder, seeds: u64, limit: impl Fn(u64) -> u32) -> (Climb, Vec<(u32, u64)>) {
        let mut runs = Vec::new();
        let climbed = ladder.climb::<std::convert::Infallible>(seeds, |rung, seed| {
            runs.push((rung, seed));
            Ok(rung <= limit(seed))
        });
        let Ok(climbed) = climbed;
        (climbed, runs)
    }

    const LADDER: Ladder = Ladder { first: 700, step: 5 };

    #[test]
    fn the_last_rung_that_half_of_the_seeds_reach_is_the_top() {
        // Of five seeds, three reach 0.710 and two 0.720.
        let (climbed, _) = climb(LADDER, 5, |seed| [720, 705, 710, 720, 700][seed as usize - 1]);
        assert_eq!(climbed.top().map(|rung| rung.thousandths), Some(710));
        assert_eq!(climbed.missed().map(|rung| rung.thousandths), Some(715));
        assert_eq!(climbed.to_string(), "0.710 (2 of 5 at 0.715)");
    }

    #[test]
    fn half_is_enough_where_the_number_of_seeds_is_even() {
        let (climbed, _) = climb(LADDER, 4, |seed| if seed <= 2 { 705 } else { 0 });
        assert_eq!(climbed.top().map(|rung| rung.thousandths), Some(705));
    }

    #[test]
    fn seeds_that_cannot_change_the_verdict_are_skipped() {
        let (_, runs) = climb(LADDER, 5, |_| 700);
        assert_eq!(runs, [(700, 1), (700, 2), (700, 3), (705, 1), (705, 2), (705, 3)]);
        let (_, runs) = climb(LADDER, 4, |_| 700);
        assert_eq!(runs, [(700, 1), (700, 2), (705, 1), (705, 2), (705, 3)]);
        let (_, runs) = climb(LADDER, 1, |_| 700);
        assert_eq!(runs, [(700, 1), (705, 1)]);
    }

    #[test]
    fn a_first_rung_that_is_missed_is_an_upper_bound() {
        let (climbed, runs) = climb(LADDER, 5, |_| 0);
        assert_eq!(climbed.top(), None);
        assert_eq!(climbed.to_string(), "below 0.700 (0 of 3 at 0.700)");
        assert_eq!(runs.len(), 3);
    }

    #[test]
    fn a_ladder_ends_below_one() {
        let (climbed, _) = climb(Ladder { first: 990, step: 4 }, 1, |_| 1000);
        assert_eq!(climbed.rungs.iter().map(|rung| rung.thousandths).collect::<Vec<_>>(), [990, 994, 998]);
        assert_eq!(climbed.to_string(), "0.998");
    }

    #[test]
    fn a_failure_ends_the_climb() {
        let mut runs = 0;
        let climbed = LADDER.climb(5, |rung, _| {
            runs += 1;
            if rung > 700 { Err("broken") } else { Ok(true) }
        });
        assert_eq!((climbed, runs), (Err("broken"), 4));
    }
}
