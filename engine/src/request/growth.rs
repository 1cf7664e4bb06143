//! What a request says about growth: its parameters, and when to give up.
//!
//! Grains grow by events (event-driven molecular dynamics, spheres alone) or by moves (hard-particle Monte Carlo, all
//! grains). Every field may be left out; what a default amounts to depends on the mix, so it is the engine's to choose
//! and is not written into the request. A field that the way of growth has no use for is refused.

use serde::Serialize;

use super::Method;
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

/// Most sweeps that a run may be given.
pub const MAX_SWEEPS: i64 = 1_000_000_000;

/// How grains move while they grow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GrowthBy {
    /// On straight lines from collision to collision: event-driven molecular dynamics, of spheres.
    Events,
    /// By random moves, turns and pushes: hard-particle Monte Carlo, of any grains.
    Moves,
}

impl GrowthBy {
    /// How grains grow by a method; events are for spheres, and faster.
    #[must_use]
    pub fn of(method: &Method, has_shapes: bool) -> Self {
        match method {
            Method::Edmd { .. } => Self::Events,
            Method::MonteCarlo { .. } => Self::Moves,
            _ if has_shapes => Self::Moves,
            _ => Self::Events,
        }
    }

    /// The name of the method that always takes this way.
    fn method(self) -> &'static str {
        match self {
            Self::Events => "edmd",
            Self::Moves => "monte_carlo",
        }
    }
}

/// Parameters of growth; the engine picks what is absent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct GrowthOptions {
    /// Share of the final diameters with which growth starts.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 0.5, maximum = 1))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub initial_scale: Option<f64>,
    /// Of `edmd`: relative growth rate of the diameters while the pressure is low, per s. Default: a tenth of the mean
    /// thermal velocity over the mean contact radius.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 1e-6, maximum = 1000))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub growth_rate: Option<f64>,
    /// Of `edmd`: components of the initial velocities are uniform in plus minus this for the smallest grain, in mm/s,
    /// and of the same energy for larger ones. Default: 0.5.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, minimum = 1e-6, maximum = 1e6))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub initial_velocity: Option<f64>,
    /// Of `edmd`: whether all grains have the same mass in a collision, whatever their size. Default: false, masses as
    /// the cube of the diameters.
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
    #[serde(skip_serializing_if = "GrowthStop::is_empty")]
    pub stop: GrowthStop,
}

/// When growth gives up. With a prescribed target that is `target-not-reached`; with `maximize` the distance reached so
/// far is the result. Of `edmd` growth is then paced so that the grains jam by this limit: the more time, the larger
/// the distance. With `time_s` the packing depends on the speed of the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct GrowthStop {
    /// Wall-clock time of packing, in s.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, exclusive_minimum = 0, maximum = 2_678_400)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
    /// Of `edmd`: number of events.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, minimum = 1, maximum = 1_000_000_000_000_000_u64)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub events: Option<u64>,
    /// Of `monte_carlo`: number of sweeps, in each of which every grain tries one move. It is looked at between cycles,
    /// which have five sweeps and more, some thousand where there are few grains.
    #[cfg_attr(
        feature = "openapi",
        schema(required = false, nullable, minimum = 1, maximum = 1_000_000_000_u64)
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sweeps: Option<u64>,
    /// Of `edmd`: simulated time per event and grain, in s, below which the run has stalled.
    #[cfg_attr(feature = "openapi", schema(required = false, nullable, exclusive_minimum = 0, maximum = 1))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stall_dt_s: Option<f64>,
}

impl GrowthOptions {
    /// The names of the fields that are given, and that growth in this way has no use for.
    fn useless(&self, by: GrowthBy) -> impl Iterator<Item = &'static str> {
        let stop = &self.stop;
        let fields = [
            (GrowthBy::Events, "growth_rate", self.growth_rate.is_some()),
            (GrowthBy::Events, "initial_velocity", self.initial_velocity.is_some()),
            (GrowthBy::Events, "equal_mass", self.equal_mass.is_some()),
            (GrowthBy::Events, "stop/events", stop.events.is_some()),
            (GrowthBy::Events, "stop/stall_dt_s", stop.stall_dt_s.is_some()),
            (GrowthBy::Moves, "stop/sweeps", stop.sweeps.is_some()),
        ];
        fields.into_iter().filter(move |(of, _, is_given)| *is_given && *of != by).map(|(_, name, _)| name)
    }
}

impl GrowthStop {
    /// Whether nothing is prescribed.
    #[allow(clippy::trivially_copy_pass_by_ref)] // Serde hands over a reference.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The limit of work: events of growth by events, sweeps of growth by moves.
    #[must_use]
    pub fn work(&self) -> Option<u64> {
        self.events.or(self.sweeps)
    }
}

/// Judges a method that grows grains of this kind: its way of growth must be one for them, and have a use for each
/// option. `None` means that a fault was reported.
pub(super) fn judge(at: &At<'_>, method: &Method, has_shapes: bool) -> Option<()> {
    let Some(options) = method.growth() else { return Some(()) };
    let by = GrowthBy::of(method, has_shapes);
    if has_shapes && by == GrowthBy::Events {
        // Where the fault is: no other field of the object would be right with this type.
        at.object()?.required("type")?.fault(
            "\"edmd\" packs spheres alone: must be \"growth\", \"monte_carlo\", \"rsa\" or \"auto\" for grains with a \
             shape",
        );
        return None;
    }
    let grains = if has_shapes { "grains with a shape" } else { "spheres" };
    let way = match (method, by) {
        (Method::Growth { .. }, by) => format!("{grains} grow by \"{}\", which", by.method()),
        (_, by) => format!("\"{}\"", by.method()),
    };
    let mut useless = options.useless(by).peekable();
    let has_use = useless.peek().is_none();
    for name in useless {
        at.fault_below(&format!("/{name}"), format!("{way} has no use for it: must be left out"));
    }
    has_use.then_some(())
}

/// Reads the parameters from the method's object, whose `type` was read before.
///
/// `None` means that faults were reported.
pub(super) fn read_options(object: &mut Object<'_>) -> Option<GrowthOptions> {
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
    Some(GrowthOptions {
        initial_scale: valid(initial_scale)?,
        growth_rate: valid(growth_rate)?,
        initial_velocity: valid(initial_velocity)?,
        equal_mass: valid(equal_mass)?,
        swap: valid(swap)?,
        stop: valid(stop)?.unwrap_or_default(),
    })
}

fn read_stop(at: &At<'_>) -> Option<GrowthStop> {
    let mut object = at.object()?;
    let time_s = object.optional("time_s").map(|at| at.number(Bound::positive(MAX_STOP_TIME_S, "s")));
    let events = object.optional("events").map(|at| at.integer(1, MAX_EVENTS));
    let sweeps = object.optional("sweeps").map(|at| at.integer(1, MAX_SWEEPS));
    let stall_dt_s = object.optional("stall_dt_s").map(|at| at.number(Bound::positive(1.0, "s")));
    object.finish();
    Some(GrowthStop {
        time_s: valid(time_s)?,
        events: valid(events)?.map(|n| n as u64),
        sweeps: valid(sweeps)?.map(|n| n as u64),
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
