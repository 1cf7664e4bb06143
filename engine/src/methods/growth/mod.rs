//! What both ways of growth share: the random start, the growth curve, expansions, the end, the codec of checkpoints.
//!
//! Grains that grow start from random sequential addition at a smaller size (`start`) and grow until they have their
//! size, a limit ends them, or they jam. Spheres move by events ([`super::edmd`]), any grains by random moves
//! ([`super::monte_carlo`]). Both give the same [`Outcome`].

pub(crate) mod codec;
mod curve;
mod expansions;
mod start;

use crate::memory::OutOfMemory;
use crate::packing::{GrowthEnd, GrowthPoint, RsaStatistics, Statistics};

pub(crate) use curve::Curve;
pub(crate) use expansions::{EXPANSION, Expansions};
pub(crate) use start::{START_ATTEMPTS, Started, start};

/// Growth beyond the requested size, as far as it goes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToJamming {
    /// Ends as soon as it is known that the grains will jam at a scale outside of these bounds.
    pub within: Option<[f64; 2]>,
}

/// Why growth came to no end of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interrupted {
    /// The control said so.
    Stopped,
    /// The system refused memory.
    OutOfMemory {
        /// Bytes of the allocation that was refused.
        bytes: u64,
    },
    /// Random addition found no start, at any of ever smaller sizes.
    NoStart,
}

impl From<OutOfMemory> for Interrupted {
    fn from(OutOfMemory { bytes }: OutOfMemory) -> Self {
        Self::OutOfMemory { bytes }
    }
}

/// How growth ended. `P` is where the grains lie: centres of spheres in mm, or poses.
#[derive(Clone, Debug)]
pub struct Outcome<P> {
    /// In the order of the grains; of the first of them alone where the run was to finish while random addition had not
    /// inserted all. The packing is valid at [`Outcome::scale`].
    pub placed: P,
    /// Why growth ended.
    pub end: GrowthEnd,
    /// Size reached over requested size: 1 only where the target is reached, unless there is none.
    pub scale: f64,
    /// Constant distance reached, where one is requested, in mm.
    pub distance_mm: Option<f64>,
    /// Volume of the grains at the size reached over that of the specimen.
    pub volume_fraction: f64,
    /// What random addition and growth counted.
    pub statistics: Statistics,
    /// Growth over time.
    pub growth_curve: Vec<GrowthPoint>,
    /// Time of random addition in s.
    pub rsa_s: f64,
    /// Time of growth in s.
    pub growth_s: f64,
}

impl<P> Outcome<P> {
    /// The same with other words for where the grains lie.
    pub(crate) fn with_places<Q>(self, placed: Q) -> Outcome<Q> {
        Outcome {
            placed,
            end: self.end,
            scale: self.scale,
            distance_mm: self.distance_mm,
            volume_fraction: self.volume_fraction,
            statistics: self.statistics,
            growth_curve: self.growth_curve,
            rsa_s: self.rsa_s,
            growth_s: self.growth_s,
        }
    }
}

impl<P> Outcome<Vec<P>> {
    /// A run that was to finish before all grains had a place. Of all grains at their size the volume over that of the
    /// specimen is `volume_fraction`; `statistics` makes the counts of growth, which has counted nothing, of its scale.
    pub(crate) fn unfinished(
        started: Started<P>,
        volume_fraction: f64,
        rsa_s: f64,
        statistics: impl FnOnce(RsaStatistics, f64) -> Statistics,
    ) -> Self {
        let scale = started.scale.min(1.0 - f64::EPSILON);
        Self {
            placed: started.placed,
            end: GrowthEnd::Finished,
            scale,
            distance_mm: None,
            volume_fraction: volume_fraction * started.scale.powi(3),
            statistics: statistics(started.statistics, scale),
            growth_curve: Vec::new(),
            rsa_s,
            growth_s: 0.0,
        }
    }
}

/// What growth begins with.
pub(crate) enum Begun<R, P> {
    /// A run, at its start or as it was at a checkpoint.
    Run(Box<R>),
    /// The end of it: the run was to finish before all grains had a place.
    Finished(Box<Outcome<P>>),
}

/// Whether somebody may want to go on later with growth that ended so: it ended short of a target, `is_scaling`, and
/// its packing is kept.
pub(crate) fn may_go_on(end: GrowthEnd, is_scaling: bool, is_kept: bool) -> bool {
    match end {
        GrowthEnd::Target => false,
        GrowthEnd::Finished => true,
        _ => is_scaling && is_kept,
    }
}
