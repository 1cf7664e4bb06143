//! The choice among several free places for one grain, by their weights.
//!
//! It knows weights alone; it must never know what they mean.

use rand_xoshiro::Xoshiro256PlusPlus;

use crate::rng::uniform;

/// Places that are chosen among.
pub(super) const CANDIDATES: u32 = 32;
/// Draws after which those found so far must do.
pub(super) const MOST_DRAWS: u32 = 1000;

/// One of the places offered, with probabilities proportional to their weights.
///
/// Each gets the logarithm of its weight and a number of Gumbel's distribution; the largest sum is chosen, which has
/// that law (Gumbel 1954), and neither needs the places to be kept nor overflows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Choice<T> {
    chosen: Option<T>,
    most: f64,
    /// Places offered so far.
    pub(super) offered: u32,
}

impl<T> Choice<T> {
    pub(super) fn new() -> Self {
        Self { chosen: None, most: f64::NEG_INFINITY, offered: 0 }
    }

    pub(super) fn offer(&mut self, place: T, log_weight: f64, rng: &mut Xoshiro256PlusPlus) {
        // Of 1 - u, for u may be 0 and may not be 1.
        let gumbel = -(-(-uniform(rng)).ln_1p()).ln();
        self.offered += 1;
        if self.chosen.is_none() || log_weight + gumbel > self.most {
            (self.chosen, self.most) = (Some(place), log_weight + gumbel);
        }
    }

    pub(super) fn chosen(self) -> Option<T> {
        self.chosen
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};

    #[test]
    fn places_are_chosen_by_their_weights() {
        const RUNS: u32 = 40_000;
        let weights = [1.0, 2.0, 5.0, 0.0];
        let mut rng = stream(1, Stream::Rsa);
        let mut chosen = [0_u32; 4];
        for _ in 0..RUNS {
            let mut choice = Choice::new();
            for (i, weight) in weights.iter().enumerate() {
                choice.offer(i, f64::ln(*weight), &mut rng);
            }
            chosen[choice.chosen().unwrap()] += 1;
        }
        for (n, weight) in chosen.iter().zip(weights) {
            let p: f64 = weight / 8.0;
            let off = (f64::from(*n) - p * f64::from(RUNS)) / (f64::from(RUNS) * p * (1.0 - p)).sqrt().max(1.0);
            assert!(off.abs() < 4.0, "{chosen:?}");
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
