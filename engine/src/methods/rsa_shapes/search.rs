//! The search for the pose of one grain, and what of it counts as attempts.

use rand_xoshiro::Xoshiro256PlusPlus;

use crate::domain::{Domain, Region};
use crate::elementary::ln_1p;
use crate::rng::uniform;

/// Where the centre of an attempt lies, before the grain is held against walls and other grains.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AttemptsIn {
    /// Anywhere in the specimen: what `attempts_per_grain` of a request counts.
    Specimen,
    /// Where the largest sphere about the centre that the grain holds keeps its distance from the walls: no other
    /// centre is possible. Starts of growth count so.
    Reach,
}

/// The search for one grain.
pub(super) struct Search<S> {
    pub(super) grain: usize,
    pub(super) shape: S,
    pub(super) d_mm: f64,
    pub(super) wall_gap_mm: f64,
    pub(super) domain: Domain,
    /// Where a centre is possible.
    pub(super) region: Region,
    /// Volume that attempts fall into, in mm³.
    pub(super) attempts_mm3: f64,
    pub(super) attempts: u64,
    pub(super) failed: u64,
    pub(super) limit: Option<u64>,
    pub(super) most_draws: u64,
}

impl<S> Search<S> {
    /// Counts the textbook attempts that one draw from so much volume stands for; says whether the limit is passed.
    ///
    /// Attempts come as often per volume as draws: one over `p`, the volume of the voxels over that which attempts fall
    /// into, per draw. Those that missed the voxels have failed unseen. Voxels may reach beyond where attempts fall;
    /// where they are larger, not every draw is an attempt.
    #[inline(always)]
    pub(super) fn count(&mut self, volume_mm3: f64, rng: &mut Xoshiro256PlusPlus) -> bool {
        let Some(limit) = self.limit else {
            let spent = self.attempts == self.most_draws;
            self.attempts += u64::from(!spent);
            return spent;
        };
        let p = volume_mm3 / self.attempts_mm3;
        if p < 1.0 {
            let unseen = ln_1p(-uniform(rng)) / ln_1p(-p);
            self.attempts = self.attempts.saturating_add(unseen as u64).min(limit);
        } else if p.is_finite() && uniform(rng) * p >= 1.0 {
            return false;
        }
        let spent = self.attempts == limit;
        self.attempts += u64::from(!spent);
        spent
    }
}
