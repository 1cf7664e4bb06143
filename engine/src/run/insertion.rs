//! How much of a random sequential addition is done, predicted while it runs.
//!
//! The work of a grain is the number of draws until one of them finds a place. It grows without bound while the
//! specimen fills: for spheres and other bodies that are added at random, the volume that is left falls as a power of
//! the number of draws (Swendsen 1981, 10.1103/PhysRevA.24.504; Viot et al. 1992, 10.1063/1.463820). With the
//! [`Crowding`] `c` of the size of a grain, its work is taken as `1 + (1 - c / c*)^-4`. The crowding `c*` at which
//! nothing is left is 1 by the model of `plan`, with an error. The run tells more: the nearer `c*` is, the fewer grains
//! take the last half of the work so far. Values of `c*` are weighted by both (Bayes). The power, the error and the
//! weight of the model were chosen on 29 runs near the end of what they reach (`docs/estimates.md`, "Progress").

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

use crate::bayes::means;
use crate::control::Progress;
use crate::elementary::{exp, ln};
use crate::plan::Crowding;

/// Power of what is left by which the work of a grain grows,
const POWER: i32 = 4;
/// and the share that is left at least: the limit of draws ends a run at about this.
const LEAST_LEFT: f64 = 0.02;
/// Values of `ln c*` that are weighted: the first, their number and their step,
const FIRST: f64 = -0.12;
const VALUES: usize = 24;
const STEP: f64 = 0.016;
/// and the standard error of the model.
const ERROR: f64 = 0.08;
/// Grains whose work tells more than the form of the law is worth.
const MOST_TELLING: f64 = 200.0;
/// Least difference of crowding, and of the share of the grains, between two entries of the table of work.
const CROWDING_STEP: f64 = 0.01;
const GRAINS_STEP: f64 = 1.0 / 128.0;

/// The share of its work that a random sequential addition has done.
pub(super) struct Insertion {
    forecast: Forecast,
    /// Looks at the control that the draws for one grain may last; a look comes after a number of draws.
    most_looks: f64,
    noted: Mutex<Noted>,
}

/// What was seen of a run.
#[derive(Debug, Default)]
struct Noted {
    looks: f64,
    /// Grains placed, and the looks until the last of them.
    placed: f64,
    placed_at: f64,
    /// Looks and grains placed, from about half of the work so far on.
    points: VecDeque<[f64; 2]>,
}

impl Insertion {
    /// Of grains of this crowding. For one of them at most so many looks at the control are made, if there is a limit.
    pub(super) fn new(crowding: &[Crowding], most_looks: f64) -> Self {
        Self { forecast: Forecast::new(crowding), most_looks, noted: Mutex::default() }
    }

    /// The share by one more look.
    pub(super) fn fraction(&self, progress: &Progress) -> f64 {
        let mut noted = self.noted.lock().unwrap_or_else(PoisonError::into_inner);
        noted.note(progress.fraction);
        self.forecast.fraction(&noted, self.most_looks)
    }
}

impl Noted {
    /// Notes a look, with the share of the grains that are placed.
    fn note(&mut self, placed: f64) {
        self.looks += 1.0;
        if placed > self.placed {
            (self.placed, self.placed_at) = (placed, self.looks);
        }
        self.points.push_back([self.looks, self.placed]);
        while self.points.get(1).is_some_and(|[looks, _]| *looks <= 0.5 * self.looks) {
            self.points.pop_front();
        }
    }
}

/// The work up to some of the grains, for each value of `c*`.
struct Forecast {
    /// Shares of the grains,
    placed: Vec<f64>,
    /// and the work up to there over the number of grains.
    work: Vec<[f64; VALUES]>,
    grains: f64,
}

impl Forecast {
    fn new(crowding: &[Crowding]) -> Self {
        let grains = crowding.last().map_or(0.0, |last| last.number).max(1.0);
        let mut forecast = Self { placed: vec![0.0], work: vec![[0.0; VALUES]], grains };
        let mut from = 0.0;
        // Sizes that hardly differ are taken together.
        let mut first = None;
        for of in crowding {
            let to = of.number / grains;
            let begin = *first.get_or_insert(of.first);
            let steps = ((of.last - begin).abs() / CROWDING_STEP).max((to - from) / GRAINS_STEP);
            if steps >= 1.0 || to >= 1.0 {
                forecast.add(from, to, [begin, of.last], steps.ceil().max(1.0));
                (from, first) = (to, None);
            }
        }
        forecast
    }

    /// Adds grains from one share to another, in which the crowding rises evenly.
    fn add(&mut self, from: f64, to: f64, [first, last]: [f64; 2], steps: f64) {
        let mut work = self.work.last().copied().unwrap_or([0.0; VALUES]);
        for step in 0..steps as usize {
            let crowding = first + (last - first) * (step as f64 + 0.5) / steps;
            for (value, work) in work.iter_mut().enumerate() {
                let left = (1.0 - crowding / exp(ln_end(value))).max(LEAST_LEFT);
                *work += (1.0 + left.powi(-POWER)) * (to - from) / steps;
            }
            self.placed.push(from + (to - from) * (step as f64 + 1.0) / steps);
            self.work.push(work);
        }
    }

    /// The work up to a share of the grains.
    fn work(&self, placed: f64) -> [f64; VALUES] {
        let after = self.placed.partition_point(|of| *of < placed).clamp(1, self.placed.len().max(2) - 1);
        let (Some(low), Some(high)) = (self.work.get(after - 1), self.work.get(after)) else {
            return [placed; VALUES];
        };
        let [from, to] = [self.placed[after - 1], self.placed[after]];
        let share = ((placed - from) / (to - from)).clamp(0.0, 1.0);
        std::array::from_fn(|value| low[value] + (high[value] - low[value]) * share)
    }

    /// Share of the work that is done.
    fn fraction(&self, noted: &Noted, most_looks: f64) -> f64 {
        let Some(&[half_looks, half]) = noted.points.front() else { return 0.0 };
        if noted.placed >= 1.0 {
            return 1.0;
        }
        let [before, now, all] = [half, noted.placed, 1.0].map(|placed| self.work(placed));
        let odds = |share: f64| ln(share / (1.0 - share));
        let share = |of: f64| of.clamp(1e-3, 1.0 - 1e-3);
        let seen = odds(share(half_looks / noted.looks));
        let telling = ((noted.placed - half) * self.grains).clamp(1.0, MOST_TELLING);
        let limit = (most_looks - (noted.looks - noted.placed_at)).max(0.0);
        let cases = std::array::from_fn::<_, VALUES, _>(|value| {
            let off = odds(share(before[value] / now[value].max(f64::MIN_POSITIVE))) - seen;
            let ln_weight = -0.5 * (ln_end(value) / ERROR).powi(2) - 0.25 * off * off * telling;
            let left = noted.looks * (all[value] - now[value]) / now[value].max(f64::MIN_POSITIVE);
            (ln_weight, [ln(noted.looks / (noted.looks + left.min(limit)))])
        });
        let [ln_fraction] = means(&cases);
        exp(ln_fraction)
    }
}

/// The logarithm of a value of `c*`.
fn ln_end(value: usize) -> f64 {
    FIRST + STEP * value as f64
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use rand::rand_core::SeedableRng as _;
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;
    use crate::control::Step;
    use crate::rng::uniform;

    /// Draws between two looks.
    const DRAWS: f64 = 100.0;

    /// Equal grains that fill the specimen to a crowding.
    fn equal(grains: f64, last: f64) -> [Crowding; 1] {
        [Crowding { number: grains, first: 0.0, last }]
    }

    /// Fractions at each look of a run whose grains take draws at random, by their crowding and that at which nothing
    /// is left; for one grain at most so many looks.
    fn followed(crowding: &[Crowding], end: f64, most_looks: f64, seed: u64) -> Vec<f64> {
        let insertion = Insertion::new(crowding, most_looks);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let total = crowding.last().unwrap().number as usize;
        let (mut fractions, mut draws) = (Vec::new(), 0.0);
        let mut largest = 0.0_f64;
        // As a part reports them, whose fraction never falls.
        let mut look = |placed: usize| {
            largest = largest.max(insertion.fraction(&Progress::counted(Step::Rsa, placed, total, "", "")));
            fractions.push(largest);
        };
        for grain in 0..total {
            let size = crowding.partition_point(|of| of.number <= grain as f64);
            let of = crowding[size];
            let from = size.checked_sub(1).map_or(0.0, |before| crowding[before].number);
            let filled = of.first + (of.last - of.first) * (grain as f64 - from) / (of.number - from);
            let left = (1.0 - filled / end).max(0.0);
            let needs = (1.0 + 3.0 * left.powi(-4)) * -ln(1.0 - uniform(&mut rng));
            let most = most_looks * DRAWS;
            let looks = ((draws + needs.min(most)) / DRAWS) as usize - (draws / DRAWS) as usize;
            (0..looks).for_each(|_| look(grain));
            if needs > most {
                return fractions;
            }
            draws += needs;
        }
        look(total);
        assert_eq!(fractions.last(), Some(&1.0));
        fractions
    }

    /// The middle difference between the fraction and the share of the looks, from 20 to 90 % of them.
    fn off(fractions: &[f64]) -> f64 {
        let looks = fractions.len() as f64;
        assert!(fractions.is_sorted(), "{fractions:?}");
        let share = |look: usize| (look as f64 + 1.0) / looks;
        let mut off: Vec<f64> = (0..fractions.len())
            .filter(|look| (0.2..0.9).contains(&share(*look)))
            .map(|look| (fractions[look] - share(look)).abs())
            .collect();
        off.sort_by(f64::total_cmp);
        off[off.len() / 2]
    }

    /// Whether the specimen is half full or nearly as full as it gets, and whether the model is right or wrong.
    #[test]
    fn the_fraction_follows_the_draws_though_the_model_is_wrong() {
        for (last, end) in [(0.5, 1.0), (0.8, 1.0), (0.97, 1.0), (0.97, 1.08), (0.9, 0.95)] {
            let off = off(&followed(&equal(2000.0, last), end, f64::INFINITY, 7));
            assert!(off < 0.1, "{off} at {last} of {end}");
        }
    }

    /// Coarse grains fill the specimen nearly as far as they can, and fine ones find places between them.
    #[test]
    fn fine_grains_add_little_to_coarse_ones_that_are_crowded() {
        let coarse = Crowding { number: 300.0, first: 0.0, last: 0.9 };
        let fine = Crowding { number: 3000.0, first: 0.3, last: 0.6 };
        let fractions = followed(&[coarse, fine], 1.0, f64::INFINITY, 7);
        assert!(off(&fractions) < 0.1, "{}", off(&fractions));
    }

    /// A grain that finds no place has so many draws, and they are most of the run.
    #[test]
    fn a_run_that_fails_ends_with_the_draws_for_one_grain() {
        let easy = Crowding { number: 200.0, first: 0.0, last: 0.7 };
        let too_large = Crowding { number: 300.0, first: 1.3, last: 1.5 };
        let fractions = followed(&[easy, too_large], 1.0, 5000.0, 7);
        assert!(off(&fractions) < 0.1 && fractions.len() < 6000, "{}", off(&fractions));
    }

    /// Many sizes make a table of few entries, and a run without grains has one.
    #[test]
    fn sizes_that_hardly_differ_share_an_entry() {
        let size = |n: f64| Crowding { number: n, first: n * 1e-5, last: (n + 1.0) * 1e-5 };
        let many: Vec<Crowding> = (0..100_000).map(|n| size(f64::from(n) + 1.0)).collect();
        let forecast = Forecast::new(&many);
        assert!(forecast.placed.len() < 500 && forecast.placed.is_sorted(), "{}", forecast.placed.len());
        assert_eq!(forecast.placed.last(), Some(&1.0));
        assert_eq!(Forecast::new(&[]).fraction(&Noted::default(), 1.0), 0.0);
    }
}
