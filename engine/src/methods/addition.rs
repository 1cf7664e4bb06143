//! What random sequential addition of spheres ([`super::rsa`]) and of shaped grains ([`super::rsa_shapes`]) share: how
//! it ends, what counts as an attempt, the choice among free places, and progress.
//!
//! The two differ in what a place is and in what proves that there is none: voxels that spheres cover exactly, and
//! voxels in ellipsoids that the grains hold.

// An attempt is counted for every draw.
#![allow(clippy::inline_always)]

use rand_xoshiro::Xoshiro256PlusPlus;

use super::choice::{Choice, MOST_DRAWS};
use crate::control::{Control, Progress, Step};
use crate::elementary::ln_1p;
use crate::memory::OutOfMemory;
use crate::packing::RsaStatistics;
use crate::rng::uniform;

/// How random sequential addition ended. `P` is a place of a grain: the centre of a sphere in mm, or a pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome<P> {
    /// In the order of the grains, of those that were placed.
    pub placed: Vec<P>,
    /// What was counted.
    pub statistics: RsaStatistics,
    /// Why it ended.
    pub end: End,
}

impl<P> Outcome<P> {
    /// The places and the end; the end is another where the system refused memory for the places.
    pub(super) fn new(placed: Result<Vec<P>, OutOfMemory>, statistics: RsaStatistics, end: End) -> Self {
        match placed {
            Ok(placed) => Self { placed, statistics, end },
            Err(refused) => Self { placed: Vec::new(), statistics, end: refused.into() },
        }
    }
}

/// Why random sequential addition ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// All grains are placed.
    Complete,
    /// The next grain found no place.
    InsertionFailed {
        /// Whether it is proven that there is none.
        saturation_proven: bool,
        /// Attempts spent on it, where their number is limited; else draws.
        attempts: u64,
    },
    /// The control said so.
    Stopped,
    /// The system refused memory.
    OutOfMemory {
        /// Bytes of the allocation that was refused.
        bytes: u64,
    },
}

impl From<OutOfMemory> for End {
    fn from(OutOfMemory { bytes }: OutOfMemory) -> Self {
        Self::OutOfMemory { bytes }
    }
}

/// What one draw, or the search for one grain, has found.
pub(super) enum Found<P> {
    /// A place.
    Place(P),
    /// No place so far.
    NotYet,
    /// No place, and the search is over.
    Nothing { saturation_proven: bool },
    /// The control asked to stop.
    Stopped,
}

/// Attempts of the textbook algorithm that the search for one grain has spent.
pub(super) struct Attempts {
    pub(super) number: u64,
    limit: Option<u64>,
    /// Most draws where attempts have no limit.
    most_draws: u64,
    /// The probability that was last counted for, and the logarithm of that of a miss.
    missed: (f64, f64),
}

impl Attempts {
    pub(super) fn new(limit: Option<u64>, most_draws: u64) -> Self {
        Self { number: 0, limit, most_draws, missed: (f64::NAN, f64::NAN) }
    }

    /// Counts the attempts that one draw stands for; says whether the limit is passed.
    ///
    /// An attempt falls into the voxels with the probability `p`, their share of the volume that attempts fall into.
    /// Those before it that missed the voxels have failed unseen. Voxels may be larger than that volume: `is_attempt`
    /// says then whether the draw is an attempt.
    #[inline(always)]
    pub(super) fn count(
        &mut self,
        p: f64,
        rng: &mut Xoshiro256PlusPlus,
        is_attempt: impl FnOnce(&mut Xoshiro256PlusPlus) -> bool,
    ) -> bool {
        let most = self.limit.unwrap_or(self.most_draws);
        if self.limit.is_some() {
            if p < 1.0 {
                // Many draws are made from one volume.
                if self.missed.0 != p {
                    self.missed = (p, ln_1p(-p));
                }
                let unseen = ln_1p(-uniform(rng)) / self.missed.1;
                // Saturates where nearly nothing is left.
                self.number = self.number.saturating_add(unseen as u64).min(most);
            } else if !is_attempt(rng) {
                return false;
            }
        }
        let spent = self.number == most;
        self.number += u64::from(!spent);
        spent
    }
}

/// Looks for further places beside the first until one is taken for its weight, or chooses among those found.
///
/// Places are uniform in the free space, so that the one taken has a density proportional to the weight there. That
/// the search ends early where places are rare does not depend on where they are.
pub(super) fn choose<P, E>(
    first: P,
    log_weight: impl Fn(&P) -> f64,
    rng: &mut Xoshiro256PlusPlus,
    mut further: impl FnMut(&mut Xoshiro256PlusPlus) -> Result<Found<P>, E>,
) -> Result<Found<P>, E> {
    let mut choice = Choice::new();
    let mut found = Found::Place(first);
    for _ in 0..MOST_DRAWS {
        match found {
            Found::Place(place) => {
                let log_weight = log_weight(&place);
                choice.offer(place, log_weight, rng);
                if choice.is_made() {
                    break;
                }
            }
            Found::NotYet => {}
            // A place is known: nothing is proven, and what is spent is spent.
            Found::Nothing { .. } => break,
            Found::Stopped => return Ok(Found::Stopped),
        }
        found = further(rng)?;
    }
    Ok(choice.chosen().map_or(Found::NotYet, Found::Place))
}

/// Reports how many of the grains are placed; `diameter_mm` is that of a grain by its rank.
pub(super) fn report(control: &dyn Control, placed: usize, total: usize, diameter_mm: impl Fn(usize) -> f64) {
    let present_mm = if total == 0 { 0.0 } else { diameter_mm(placed.min(total - 1)) };
    let message = format!("placing grains of {present_mm:.3} mm");
    control.report(&Progress::counted(Step::Rsa, placed, total, "grains", message));
}
