//! What a request says about hard-particle Monte Carlo: when to give up.

use serde::Serialize;

use super::decode::{At, Bound, Object};
use super::edmd::MAX_STOP_TIME_S;

/// Most sweeps that a run may be given.
pub const MAX_SWEEPS: i64 = 1_000_000_000;

/// When a run of hard-particle Monte Carlo gives up, which is `target-not-reached`; with `maximize` the
/// distance reached so far is the result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MonteCarloStop {
    /// Wall-clock time of packing, in s.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 2_678_400)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
    /// Number of sweeps, in each of which every grain tries one move.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, minimum = 1, maximum = 1_000_000_000_u64)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sweeps: Option<u64>,
}

impl MonteCarloStop {
    /// Whether nothing is prescribed.
    #[allow(clippy::trivially_copy_pass_by_ref)] // Serde hands over a reference.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// Reads the criteria from the method's object, whose `type` was read before.
///
/// `None` means that faults were reported.
pub(super) fn read_stop(object: &mut Object<'_>) -> Option<MonteCarloStop> {
    object.optional("stop").map_or_else(|| Some(MonteCarloStop::default()), |at| read(&at))
}

fn read(at: &At<'_>) -> Option<MonteCarloStop> {
    let mut object = at.object()?;
    let time_s = match object.optional("time_s") {
        Some(at) => at.number(Bound::positive(MAX_STOP_TIME_S, "s")).map(Some),
        None => Some(None),
    };
    let sweeps = match object.optional("sweeps") {
        Some(at) => at.integer(1, MAX_SWEEPS).map(|n| Some(n as u64)),
        None => Some(None),
    };
    object.finish();
    Some(MonteCarloStop { time_s: time_s?, sweeps: sweeps? })
}
