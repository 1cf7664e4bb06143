//! The search for the pose of one grain, and what of it counts as attempts.

use rand_xoshiro::Xoshiro256PlusPlus;

use crate::domain::{Domain, Region};
use crate::methods::addition::Attempts;
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
    pub(super) attempts: Attempts,
    pub(super) failed: u64,
}

impl<S> Search<S> {
    /// Counts the textbook attempts that one draw from a volume stands for; says whether the limit is passed.
    ///
    /// Voxels may reach beyond where attempts fall, so that not every draw is an attempt where they are the larger.
    #[inline(always)]
    pub(super) fn count(&mut self, volume_mm3: f64, rng: &mut Xoshiro256PlusPlus) -> bool {
        let p = volume_mm3 / self.attempts_mm3;
        self.attempts.count(p, rng, |rng| !p.is_finite() || uniform(rng) * p < 1.0)
    }
}
