//! What a request says about event-driven molecular dynamics: its parameters, and when to give up.
//!
//! Every field may be left out; what a default amounts to depends on the mix, so it is the engine's to
//! choose and is not written into the request. This module must never know how a grain moves.

use serde::Serialize;

use super::decode::{At, Bound, Object};

/// Smallest share of the final diameters with which growth may start.
pub const MIN_INITIAL_SCALE: f64 = 0.5;
/// Largest relative growth rate, per s.
pub const MAX_GROWTH_RATE: f64 = 1000.0;
/// Smallest growth rate, per s: what is slower by far than any packing needs only loses digits.
pub const MIN_GROWTH_RATE: f64 = 1.0e-6;
/// Smallest initial velocity, in mm/s, for the same reason.
pub const MIN_INITIAL_VELOCITY_MM_PER_S: f64 = 1.0e-6;
/// Largest initial velocity, in mm/s.
pub const MAX_INITIAL_VELOCITY_MM_PER_S: f64 = 1.0e6;
/// Longest time that packing may be given, in s: a month.
pub const MAX_STOP_TIME_S: f64 = 2_678_400.0;
/// Most events that a run may be given.
pub const MAX_EVENTS: i64 = 1_000_000_000_000_000;

/// Parameters of event-driven molecular dynamics; the engine picks what is absent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EdmdOptions {
    /// Share of the final diameters with which growth starts.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0.5, maximum = 1))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub initial_scale: Option<f64>,
    /// Relative growth rate of the diameters while the pressure is low, per s. Default: a tenth of the
    /// mean thermal velocity over the mean contact radius.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 1e-6, maximum = 1000))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub growth_rate: Option<f64>,
    /// Components of the initial velocities are uniform in plus minus this for the smallest grain, in
    /// mm/s, and of the same energy for larger ones. Default: 0.5.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 1e-6, maximum = 1e6))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub initial_velocity: Option<f64>,
    /// Whether all grains have the same mass in a collision, whatever their size. Default: false, masses
    /// as the cube of the diameters.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub equal_mass: Option<bool>,
    /// Whether grains of similar size exchange their places now and then, by which far denser packings
    /// are reached. Default: true.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub swap: Option<bool>,
    /// When to give up.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    #[serde(skip_serializing_if = "EdmdStop::is_empty")]
    pub stop: EdmdStop,
}

/// When a run gives up. With a prescribed target that is `target-not-reached`; with `maximize` the
/// distance reached so far is the result, and growth is paced so that the grains jam by then: the more
/// time, the larger the distance. With `time_s` the packing then depends on the speed of the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EdmdStop {
    /// Wall-clock time of packing, in s.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 2_678_400)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
    /// Number of events.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, minimum = 1, maximum = 1_000_000_000_000_000_u64)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub events: Option<u64>,
    /// Simulated time per event and grain, in s, below which the run has stalled.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, exclusive_minimum = 0, maximum = 1))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stall_dt_s: Option<f64>,
}

impl EdmdStop {
    /// Whether nothing is prescribed.
    #[allow(clippy::trivially_copy_pass_by_ref)] // Serde hands over a reference.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// Reads the parameters from the method's object, whose `type` was read before.
///
/// `None` means that faults were reported.
pub(super) fn read_options(object: &mut Object<'_>) -> Option<EdmdOptions> {
    let initial_scale =
        object.optional("initial_scale").map(|at| at.number(Bound::closed(MIN_INITIAL_SCALE, 1.0, "")));
    let growth_rate = object
        .optional("growth_rate")
        .map(|at| at.number(Bound::closed(MIN_GROWTH_RATE, MAX_GROWTH_RATE, "per s")));
    let initial_velocity = object.optional("initial_velocity").map(|at| {
        at.number(Bound::closed(MIN_INITIAL_VELOCITY_MM_PER_S, MAX_INITIAL_VELOCITY_MM_PER_S, "mm/s"))
    });
    let equal_mass = object.optional("equal_mass").map(|at| at.boolean());
    let swap = object.optional("swap").map(|at| at.boolean());
    let stop = object.optional("stop").map(|at| read_stop(&at));
    Some(EdmdOptions {
        initial_scale: valid(initial_scale)?,
        growth_rate: valid(growth_rate)?,
        initial_velocity: valid(initial_velocity)?,
        equal_mass: valid(equal_mass)?,
        swap: valid(swap)?,
        stop: valid(stop)?.unwrap_or_default(),
    })
}

fn read_stop(at: &At<'_>) -> Option<EdmdStop> {
    let mut object = at.object()?;
    let time_s = object.optional("time_s").map(|at| at.number(Bound::positive(MAX_STOP_TIME_S, "s")));
    let events = object.optional("events").map(|at| at.integer(1, MAX_EVENTS));
    let stall_dt_s = object.optional("stall_dt_s").map(|at| at.number(Bound::positive(1.0, "s")));
    object.finish();
    Some(EdmdStop {
        time_s: valid(time_s)?,
        events: valid(events)?.map(|n| n as u64),
        stall_dt_s: valid(stall_dt_s)?,
    })
}

/// A field that may be absent, as absent or read; `None` where it was there and unreadable.
#[allow(clippy::option_option)] // Exactly the three cases that there are.
fn valid<T>(field: Option<Option<T>>) -> Option<Option<T>> {
    match field {
        None => Some(None),
        Some(read) => read.map(Some),
    }
}
