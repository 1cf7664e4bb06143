//! The choice among several free positions of one grain, with probabilities proportional to their weights.

use rand_xoshiro::Xoshiro256PlusPlus;

use crate::elementary::{ln, ln_1p};
use crate::rng::uniform;

/// Places that are chosen among where none was taken before.
const CANDIDATES: u32 = 128;
/// Draws after which those found so far must do.
pub(crate) const MOST_DRAWS: u32 = 1000;

/// One of the places offered, with probabilities proportional to their weights.
///
/// A place is taken at once with the probability that its weight, which is at most 1, says: that is the law of the
/// weights itself. Where wanted places are rare none may be taken in time, and the choice is among all offered:
/// each gets the logarithm of its weight and a number of Gumbel's distribution, and the largest sum is chosen, which
/// has their law as far as that number of places can have it (Gumbel 1954). Neither needs the places to be kept.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Choice<T> {
    chosen: Option<T>,
    most: f64,
    offered: u32,
}

impl<T> Choice<T> {
    pub(crate) fn new() -> Self {
        Self { chosen: None, most: f64::NEG_INFINITY, offered: 0 }
    }

    pub(crate) fn offer(&mut self, place: T, log_weight: f64, rng: &mut Xoshiro256PlusPlus) {
        self.offered += 1;
        // Of 1 - u, for u may be 0 and may not be 1.
        if ln_1p(-uniform(rng)) < log_weight {
            (self.chosen, self.most) = (Some(place), f64::INFINITY);
            return;
        }
        let key = log_weight - ln(-ln_1p(-uniform(rng)));
        if self.chosen.is_none() || key > self.most {
            (self.chosen, self.most) = (Some(place), key);
        }
    }

    /// Whether further places would change nothing, or are not to be looked for.
    pub(crate) fn is_made(&self) -> bool {
        self.most == f64::INFINITY || self.offered >= CANDIDATES
    }

    pub(crate) fn chosen(self) -> Option<T> {
        self.chosen
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};

    /// Offers uniform points of 0..1 until the choice is made.
    fn chosen_point(log_weight: impl Fn(f64) -> f64, rng: &mut Xoshiro256PlusPlus) -> f64 {
        let mut choice = Choice::new();
        while !choice.is_made() {
            let x = uniform(rng);
            choice.offer(x, log_weight(x), rng);
        }
        choice.chosen().unwrap()
    }

    #[test]
    fn points_have_the_density_of_their_weights_whether_taken_at_once_or_chosen() {
        const RUNS: usize = 20_000;
        let mut rng = stream(1, Stream::Rsa);
        // Linear, with a root of its distribution that is known; taken at once, and next to never.
        for scale in [1.0_f64, 1.0e-6] {
            let mut points: Vec<f64> =
                (0..RUNS).map(|_| chosen_point(|x| (scale * x).ln(), &mut rng).powi(2)).collect();
            points.sort_by(f64::total_cmp);
            let n = RUNS as f64;
            let gap =
                points.iter().enumerate().map(|(i, x)| (x - (i as f64 + 0.5) / n).abs()).fold(0.0, f64::max);
            // Kolmogorov: 1.95 has probability 1e-3. Among so few as 128 the law is off by a trifle.
            assert!(gap * n.sqrt() < 2.5, "{scale}: {gap}");
        }
    }

    #[test]
    fn weights_beyond_the_range_of_numbers_still_tell_places_apart() {
        let mut rng = stream(1, Stream::Rsa);
        for _ in 0..100 {
            let mut choice = Choice::new();
            for (place, log_weight) in [("bad", -1.0e6), ("better", -1.0e5), ("worse", -1.0e7)] {
                choice.offer(place, log_weight, &mut rng);
            }
            assert_eq!(choice.chosen(), Some("better"));
        }
    }
}
