//! Which grains a Monte Carlo swap move tries to exchange: pairs of similar size (Berthier, Coslovich, Ninarello and
//! Ozawa 2016, DOI 10.1103/PhysRevLett.116.238002).
//!
//! Grains are ranked by size, from the largest down. The largest relative difference of sizes that is tried, the
//! window, is steered to a share of accepted swaps. Whether two grains can be exchanged is up to the method.

use rand_xoshiro::Xoshiro256PlusPlus;

use crate::memory::{OutOfMemory, make_room, refill};
use crate::rng::uniform;

/// Share of accepted swaps that the window of sizes is steered to.
const ACCEPTED_AIM: f64 = 0.3;
const LEAST_WINDOW: f64 = 1e-7;
const MOST_WINDOW: f64 = 0.3;
/// Fewest tries by which the window is changed.
const FEWEST_TRIES: u64 = 20;

/// The pairs of a packing.
#[derive(Clone, Debug)]
pub(crate) struct SwapPairs {
    /// Where the grain of each rank is.
    site: Vec<u32>,
    /// The lowest rank that each rank may change places with.
    limit: Vec<u32>,
    /// Largest relative difference of two sizes that is tried.
    pub(crate) window: f64,
    /// Swaps tried so far.
    pub(crate) tried: u64,
    /// Swaps made so far.
    pub(crate) accepted: u64,
}

impl SwapPairs {
    pub(crate) fn new(window: f64) -> Self {
        Self { site: Vec::new(), limit: Vec::new(), window, tried: 0, accepted: 0 }
    }

    /// Takes notice of the rank of the grain at each site, and of the sizes by rank, falling, in any unit.
    ///
    /// # Errors
    /// The system refused memory.
    pub(crate) fn prepare(&mut self, ranks: &[u32], sizes: &[f64]) -> Result<(), OutOfMemory> {
        refill(&mut self.site, ranks.len(), 0)?;
        for (site, &rank) in ranks.iter().enumerate() {
            self.site[rank as usize] = site as u32;
        }
        self.limit.clear();
        make_room(&mut self.limit, sizes.len())?;
        let mut largest = 0;
        for &size in sizes {
            while sizes[largest] > size * (1.0 + self.window) {
                largest += 1;
            }
            self.limit.push(largest as u32);
        }
        Ok(())
    }

    /// Draws the ranks of two grains, the larger first; they may be the same.
    #[inline]
    pub(crate) fn draw(&self, rng: &mut Xoshiro256PlusPlus) -> [usize; 2] {
        let smaller = (uniform(rng) * self.limit.len() as f64) as usize;
        let largest = self.limit[smaller] as usize;
        [largest + (uniform(rng) * (smaller - largest) as f64) as usize, smaller]
    }

    /// Where the grain of a rank is.
    #[inline]
    pub(crate) fn site(&self, rank: usize) -> usize {
        self.site[rank] as usize
    }

    /// Takes notice that the grains of two ranks were exchanged.
    #[inline]
    pub(crate) fn exchange(&mut self, [larger, smaller]: [usize; 2]) {
        self.site.swap(larger, smaller);
    }

    /// Counts the swaps of a sweep, and steers the window.
    pub(crate) fn count(&mut self, tried: u64, accepted: u64) {
        self.tried += tried;
        self.accepted += accepted;
        if tried >= FEWEST_TRIES {
            let share = accepted as f64 / tried as f64;
            let factor = if share < ACCEPTED_AIM { 0.7 } else { 1.3 };
            self.window = (self.window * factor).clamp(LEAST_WINDOW, MOST_WINDOW);
        }
    }
}
