//! The random sequential addition that growth starts from.

use super::Interrupted;
use crate::control::StopToFinish;
use crate::memory::OutOfMemory;
use crate::methods::addition::{self, End};
use crate::packing::RsaStatistics;

/// Attempts per grain: beyond them a smaller size is tried.
pub(crate) const START_ATTEMPTS: u64 = 20_000;
/// Sizes that are tried.
const STARTS: u32 = 60;

/// Grains to grow from.
pub(crate) struct Started<P> {
    pub(crate) placed: Vec<P>,
    /// Their size over the requested one.
    pub(crate) scale: f64,
    /// Of all sizes that were tried.
    pub(crate) statistics: RsaStatistics,
    /// Whether all grains are placed; else the run was to finish before.
    pub(crate) is_complete: bool,
}

/// Inserts grains at a scale, or else at `smaller` times that, and so on.
///
/// # Errors
/// When the control stopped it, the system refused memory, or no scale that was tried had a place for each grain.
pub(crate) fn start<P>(
    mut scale: f64,
    smaller: f64,
    control: &StopToFinish<'_>,
    mut insert: impl FnMut(f64) -> Result<addition::Outcome<P>, OutOfMemory>,
) -> Result<Started<P>, Interrupted> {
    let mut statistics = RsaStatistics::default();
    for _ in 0..STARTS {
        let addition::Outcome { placed, statistics: counted, end } = insert(scale)?;
        statistics.attempts += counted.attempts;
        statistics.grains_by_subdivision += counted.grains_by_subdivision;
        statistics.voxels_tested += counted.voxels_tested;
        let is_complete = end == End::Complete;
        match end {
            End::Complete => return Ok(Started { placed, scale, statistics, is_complete }),
            End::Stopped if control.finish().is_some() => {
                return Ok(Started { placed, scale, statistics, is_complete });
            }
            End::Stopped => return Err(Interrupted::Stopped),
            End::OutOfMemory { bytes } => return Err(Interrupted::OutOfMemory { bytes }),
            End::InsertionFailed { .. } => scale *= smaller,
        }
    }
    Err(Interrupted::NoStart)
}
