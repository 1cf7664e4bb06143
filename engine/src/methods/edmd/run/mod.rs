//! One run from the first compression cycle to the last: growth, pressure, swaps, limits, checkpoints.
//!
//! Between two cycles all grains stand at the same time and the run is a handful of numbers and columns; a checkpoint
//! holds them, and a cycle depends on nothing else. The pressure of a cycle is the compressibility factor `Z = 1 + W /
//! (2 E t)` with the sum `W` of impulse times contact distance, the kinetic energy `E` and the time `t` (Lubachevsky
//! and Stillinger 1990, DOI 10.1007/BF01025983).

mod again;
mod body;
mod end;
mod forecast;
mod rearrange;
mod report;

use std::io::Write;
use std::num::NonZeroUsize;
use std::time::Instant;

use super::Expected;
use super::blocks;
use super::compression_rate::{CompressionRate, LOOSE_RATE, distance_to_jamming};
use super::container::Container;
use super::growth_protocol::GrowthProtocol;
use super::swap::unjam;
use super::system::{Counts, System};
use super::tolerances::BEYOND_TARGET;
use crate::checkpoint::Checkpoint;
use crate::control::Control;
use crate::memory::{OutOfMemory, collected, filled};
use crate::methods::growth::{Curve, Expansions, ToJamming};
use crate::methods::swap_pairs::SwapPairs;
use crate::mix::sphere_volume;
use crate::packing::{GrowthEnd, RsaStatistics};
use crate::request::{Distance, GrowthOptions, PackingRequest};
use crate::rng::cycle_stream;
use crate::segregation::Preference;
use again::Again;
use forecast::Forecast;
pub(crate) use forecast::{STALL_EVENTS, start_share};
pub(crate) use report::Moments;

/// Collisions per grain in a cycle.
pub(crate) const CYCLE_EVENTS_PER_GRAIN: u64 = 5;
/// Those with growth, where the others are collisions without growth in blocks.
const EVENTS_WITH_GROWTH: u64 = 1;
/// Fewest grains that a cycle is laid out for: smaller packings take more events per grain.
const LEAST_CYCLE_GRAINS: u64 = 100;
/// Largest relative growth in a cycle.
const CYCLE_GROWTH: f64 = 0.02;
/// Swaps tried per grain in a cycle.
const SWAPS_PER_GRAIN: f64 = 10.0;
/// Relative difference of sizes that swaps start with.
const FIRST_SWAP_WINDOW: f64 = 0.05;
/// Energy may drift by this share before velocities are rescaled.
const ENERGY_DRIFT: f64 = 0.01;
/// Events between two looks at the control.
const EVENTS_PER_LOOK: u64 = 20_000;
/// Epochs between two sortings of grains in memory, and the least number of grains that profit.
const CYCLES_PER_SORT: u64 = 16;
const LEAST_SORTED: usize = 20_000;
/// A grain with more than this share of a cycle's collisions is pinned.
const PINNED_SHARE: f64 = 0.25;
/// Fewer grains than this are few enough for any to have that share.
const PINNED_AMONG: usize = 50;
/// Simulated time per event and grain below which growth to a target, or to the largest distance, has
/// stalled, over the time in which a grain passes its own radius. At radii of 1.3 mm and 0.5 mm/s that
/// is 1e-6 s and 1e-8 s.
const TARGET_STALL: f64 = 2e-7;
const DISTANCE_STALL: f64 = 2e-9;
/// Collisions per grain in which grains grow to the largest distance and jam, where no limit is set,
const LENGTH_COLLISIONS: f64 = STALL_EVENTS;
/// and the most within a limit, so that a long limit of time does not make a small packing take all of it.
const MOST_LENGTH_COLLISIONS: f64 = 30_000.0;
/// Swaps tried to free a pinned grain.
const UNJAM_TRIES: u64 = 10_000;

/// What grows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    /// Everything by one scale, to the size and distance asked for.
    Scale,
    /// All radii by one length, as far as it goes.
    Length,
}

/// How a stage ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ended {
    As(GrowthEnd),
    /// The control said so.
    Stopped,
    /// The system refused memory.
    OutOfMemory(OutOfMemory),
}

/// What stays the same in a run.
pub(crate) struct Frame<'a> {
    pub(crate) request: &'a PackingRequest,
    pub(crate) options: GrowthOptions,
    pub(crate) diameters_mm: &'a [f64],
    pub(crate) control: &'a dyn Control,
    /// What the run is expected to take; progress is predicted from it.
    pub(crate) expected: Expected,
    /// Most threads; the outcome does not depend on their number.
    pub(crate) threads: NonZeroUsize,
    /// Whether grains grow by scale until they jam, whatever their size is then.
    pub(crate) to_jamming: Option<ToJamming>,
    pub(crate) moments: Moments,
    /// The gradient that swaps keep to.
    pub(crate) preference: Option<Preference>,
    /// Since the run, or its part after a checkpoint, began.
    pub(crate) started: Instant,
}

impl Frame<'_> {
    /// Whether grains grow as far as they go, by scale or by length, in place of to a target.
    pub(crate) fn is_without_target(&self) -> bool {
        self.to_jamming.is_some() || matches!(self.request.distance, Distance::Maximize { .. })
    }

    fn of_equal_grains(&self) -> bool {
        self.diameters_mm.first() == self.diameters_mm.last()
    }

    fn masses(&self) -> Result<Vec<f64>, OutOfMemory> {
        if self.options.equal_mass == Some(true) {
            return filled(self.diameters_mm.len(), 1.0);
        }
        let least = self.diameters_mm.last().copied().unwrap_or(1.0);
        collected(self.diameters_mm.iter().map(|d| (d / least).powi(3)))
    }

    /// Half the distance beyond which a grain of a periodic box would meet its own image, which moves
    /// along with it; with walls no distance is longer than the diagonal.
    fn most_half_distance_mm(&self) -> f64 {
        let bounds = self.request.specimen.bounds_mm();
        if self.request.specimen.is_periodic() {
            let shortest = bounds.into_iter().fold(f64::INFINITY, f64::min);
            let largest = self.diameters_mm.first().copied().unwrap_or(0.0);
            (shortest - largest * BEYOND_TARGET) / 2.0
        } else {
            bounds.into_iter().map(|length| length * length).sum::<f64>().sqrt() / 2.0
        }
    }

    /// The scale that growth ends at: the target or, to jamming, that at which the largest grain of a periodic box
    /// meets its own image, which moves along with it and never collides.
    fn most_scale(&self, protocol: &GrowthProtocol) -> f64 {
        if self.to_jamming.is_none() {
            return BEYOND_TARGET;
        }
        if !self.request.specimen.is_periodic() {
            return f64::INFINITY;
        }
        let shortest = self.request.specimen.bounds_mm().into_iter().fold(f64::INFINITY, f64::min);
        shortest / (2.0 * protocol.radii_mm.iter().copied().fold(f64::MIN_POSITIVE, f64::max))
    }

    /// Whether the limit of time is reached, by a run that took so long before its checkpoint, or the run is to finish.
    pub(crate) fn is_over(&self, earlier_s: f64) -> bool {
        let elapsed_s = || earlier_s + self.started.elapsed().as_secs_f64();
        self.control.should_finish().is_some()
            || self.options.stop.time_s.is_some_and(|most| elapsed_s() >= most)
    }

    /// Standard deviation of the components of velocity that are uniform in plus minus the initial
    /// one.
    fn thermal_velocity(&self) -> f64 {
        self.options.initial_velocity.unwrap_or(super::INITIAL_VELOCITY_MM_PER_S) / 3.0_f64.sqrt()
    }
}

/// A run between two cycles, or in one.
pub(crate) struct Run {
    pub(crate) system: System,
    pub(crate) stage: Stage,
    /// Scale, or half the distance in mm.
    pub(crate) size: f64,
    first_size: f64,
    /// Volume fraction with distances at the target.
    target_fraction: f64,
    compression_rate: CompressionRate,
    pressure: f64,
    events_per_time: f64,
    energy: f64,
    swaps: SwapPairs,
    compression_cycles: u64,
    rescalings: u64,
    pinned_grains: u64,
    resumes: u64,
    expansions: Expansions,
    again: Again,
    simulated_s: f64,
    /// Packing time before the last checkpoint.
    earlier_s: f64,
    /// The random addition that growth started from, and its time.
    pub(crate) rsa: RsaStatistics,
    pub(crate) rsa_s: f64,
    grow_started: Instant,
    fraction: f64,
    forecast: Forecast,
    pub(crate) curve: Curve,
}

impl Run {
    /// A run from centres by rank at a size of the protocol.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(crate) fn new(
        frame: &Frame<'_>,
        protocol: &GrowthProtocol,
        stage: Stage,
        size: f64,
        centers: &[[f64; 3]],
    ) -> Result<Self, OutOfMemory> {
        let radii = radii(protocol, stage, size)?;
        let container = Container::new(&frame.request.specimen);
        let mut system = System::new(container, centers, &radii, &frame.masses()?)?;
        let velocity = frame.options.initial_velocity.unwrap_or(super::INITIAL_VELOCITY_MM_PER_S);
        system.set_in_motion(velocity, &mut cycle_stream(frame.request.seed, 0));
        let energy = system.energy();
        let mean = mean_radius_mm(protocol);
        let mut compression_rate = first_rate(frame, protocol);
        if stage == Stage::Length || frame.to_jamming.is_some() {
            compression_rate = compression_rate.without_target(radii.len(), frame.of_equal_grains());
        }
        let events_per_time = system.len() as f64 * frame.thermal_velocity() / mean;
        Ok(Self {
            system,
            stage,
            size,
            first_size: size,
            target_fraction: protocol.radii_mm.iter().map(|r| sphere_volume(2.0 * r)).sum::<f64>()
                / frame.request.specimen.volume_mm3(),
            compression_rate,
            pressure: 1.0,
            events_per_time,
            energy,
            swaps: SwapPairs::new(FIRST_SWAP_WINDOW),
            compression_cycles: 0,
            rescalings: 0,
            pinned_grains: 0,
            resumes: 0,
            expansions: Expansions::default(),
            again: Again::default(),
            simulated_s: 0.0,
            earlier_s: 0.0,
            rsa: RsaStatistics::default(),
            rsa_s: 0.0,
            grow_started: Instant::now(),
            fraction: 0.0,
            forecast: Forecast::new(&frame.expected),
            curve: Curve::new(),
        })
    }

    /// Goes over from growth by scale, done, to growth by length.
    pub(crate) fn lengthen(&mut self, frame: &Frame<'_>, protocol: &GrowthProtocol) {
        let few = (protocol.radii_mm.len(), frame.of_equal_grains());
        if self.again.number == 0 {
            self.compression_rate = self.compression_rate.without_target(few.0, few.1);
        }
        self.stage = Stage::Length;
        self.size = 0.0;
        self.first_size = 0.0;
        self.set_radii(protocol);
    }

    /// Grows until something ends it.
    pub(crate) fn grow(&mut self, frame: &Frame<'_>, protocol: &GrowthProtocol) -> Ended {
        loop {
            if self.is_grown(frame) {
                return Ended::As(GrowthEnd::Target);
            }
            if let Some(end) = self.limit_reached(frame) {
                return Ended::As(end);
            }
            if frame.control.wants_checkpoint() {
                let write = |out: &mut dyn Write| self.write(frame, out);
                frame.control.keep_checkpoint(&Checkpoint::new(frame.request, &write));
                // A cycle of many grains takes seconds before it asks.
                if frame.control.should_stop() {
                    return Ended::Stopped;
                }
            }
            match self.cycle(frame, protocol) {
                Ok(None) => {}
                Ok(Some(ended)) => return ended,
                Err(refused) => return Ended::OutOfMemory(refused),
            }
            if self.jams_outside(frame) {
                return Ended::As(GrowthEnd::Stalled);
            }
        }
    }

    fn cycle(&mut self, frame: &Frame<'_>, protocol: &GrowthProtocol) -> Result<Option<Ended>, OutOfMemory> {
        self.compression_cycles += 1;
        if self.compression_cycles % CYCLES_PER_SORT == 1 && self.system.len() >= LEAST_SORTED {
            self.system.sort_along_curve()?;
        }
        self.system.threads = frame.threads;
        let n = self.system.len();
        let mean = self.system.hot.iter().map(|hot| hot.radius).sum::<f64>() / n as f64;
        let relative_speed = match self.stage {
            Stage::Scale if frame.to_jamming.is_none() && self.again.number == 0 => {
                let now = self.size.powi(3) * self.target_fraction;
                let distance = distance_to_jamming(now, self.target_fraction, self.pressure);
                self.compression_rate.next(self.pressure, distance)
            }
            // Swaps change nothing among equal grains, and order where they have time.
            Stage::Length if frame.of_equal_grains() => self.compression_rate.next(self.pressure, 1.0),
            _ => self.compression_rate.paced(self.pressure, self.collisions_left(frame)),
        };
        // Grains that grow as fast as loose ones need neither swaps nor time to rearrange.
        let is_slowed = relative_speed < self.compression_rate.loose();
        let swaps_help = is_slowed && frame.options.swap != Some(false);
        // In part of a cycle as much growth as in a whole one.
        let in_blocks = is_slowed && blocks::can_cut(&self.system);
        let cycle_events = if in_blocks { EVENTS_WITH_GROWTH } else { CYCLE_EVENTS_PER_GRAIN };
        let faster = CYCLE_EVENTS_PER_GRAIN as f64 / cycle_events as f64;
        let speed = faster * relative_speed * self.system.thermal_velocity();
        let left = self.left(frame, protocol);
        if left <= 0.0 {
            return Ok(Some(Ended::As(GrowthEnd::Stalled)));
        }
        let (growth, rate) = match self.stage {
            Stage::Scale => (protocol.by_scale(self.size, speed / mean), speed / mean),
            Stage::Length => (protocol.by_length(self.size, speed), speed),
        };
        let most = if self.stage == Stage::Scale { CYCLE_GROWTH } else { CYCLE_GROWTH * mean };
        let end = left.min(most) / rate;
        let pinned = self.pinned_grain();
        self.system.rebuild_all_lists(growth, end)?;
        let mut rng = cycle_stream(frame.request.seed, self.compression_cycles);
        if let Some(grain) = pinned {
            self.pinned_grains += 1;
            unjam(&mut self.system, grain, UNJAM_TRIES, &mut rng);
        }
        if swaps_help && !in_blocks {
            self.swap(frame, protocol, &mut rng)?;
        }
        self.system.predict_all(self.events_per_time)?;

        let before = self.system.counts;
        let most_events = cycle_events * (n as u64).max(LEAST_CYCLE_GRAINS);
        let limit = frame.options.stop.events.unwrap_or(u64::MAX);
        let most_events = most_events.min(limit.saturating_sub(before.collisions()));
        let mut reached;
        loop {
            let done = self.system.counts.collisions() - before.collisions();
            reached = self.system.run(most_events - done, EVENTS_PER_LOOK);
            if let Some(refused) = self.system.refused() {
                return Err(refused);
            }
            if frame.control.should_stop() {
                return Ok(Some(Ended::Stopped));
            }
            let done = self.system.counts.collisions() - before.collisions();
            if reached >= end
                || done >= most_events
                || self.system.is_crowded()
                || frame.is_over(self.earlier_s)
            {
                break;
            }
            self.report(frame);
        }
        let reached = reached.min(end);
        self.system.synchronise(reached);
        self.size = match self.stage {
            Stage::Scale if reached >= end && left <= most => frame.most_scale(protocol),
            Stage::Scale => self.size * (1.0 + growth.alpha * reached),
            Stage::Length if reached >= end && left <= most => self.size + left,
            Stage::Length => self.size + growth.beta * reached,
        };
        self.set_radii(protocol);
        let pressure_before = self.pressure;
        self.measure(&before, reached);
        let finished = self.is_grown(frame);
        let mut time = reached;
        if in_blocks && !finished && self.limit_reached(frame).is_none() {
            match self.rearrange(frame, protocol, pressure_before, swaps_help, &mut rng)? {
                Ok(more) => time += more,
                Err(ended) => return Ok(Some(ended)),
            }
        }
        self.simulated_s += time;
        self.note_point(frame);
        self.report(frame);
        let events = (self.system.counts.collisions() - before.collisions()) as f64;
        let stalled = events >= n as f64 && time / events * (n as f64) < self.least_dt(frame, mean);
        Ok((stalled && !finished).then_some(Ended::As(GrowthEnd::Stalled)))
    }

    /// What is left to grow: a share of the scale, or half a distance in mm.
    fn left(&self, frame: &Frame<'_>, protocol: &GrowthProtocol) -> f64 {
        match self.stage {
            Stage::Scale => frame.most_scale(protocol) / self.size - 1.0,
            Stage::Length => frame.most_half_distance_mm() - self.size,
        }
    }

    /// Time between two events of a grain below which growth stalls, in seconds, for grains of this mean radius in mm.
    fn least_dt(&self, frame: &Frame<'_>, mean: f64) -> f64 {
        frame.options.stop.stall_dt_s.unwrap_or_else(|| {
            let has_target = self.stage == Stage::Scale && frame.to_jamming.is_none();
            let share = if has_target { TARGET_STALL } else { DISTANCE_STALL };
            share * mean / frame.thermal_velocity()
        })
    }

    fn set_radii(&mut self, protocol: &GrowthProtocol) {
        let (stage, size) = (self.stage, self.size);
        for (hot, &rank) in self.system.hot.iter_mut().zip(&self.system.rank) {
            hot.radius = radius(protocol.radii_mm[rank as usize], stage, size);
        }
    }

    /// Pressure and rate of the cycle, and the energy brought back to where it was.
    fn measure(&mut self, before: &Counts, reached: f64) {
        let events = (self.system.counts.collisions() - before.collisions()) as f64;
        let energy = self.system.energy();
        if reached > 0.0 {
            // What counts is the energy while the collisions took place. Finite, for it is stored.
            let pressure = 1.0 + self.system.virial / (reached * (energy + self.energy));
            self.pressure = if pressure.is_finite() { pressure } else { f64::MAX };
            self.events_per_time = 3.0 * events / reached;
        }
        if energy > 0.0 && (energy / self.energy - 1.0).abs() > ENERGY_DRIFT {
            self.system.scale_velocities((self.energy / energy).sqrt());
            self.rescalings += 1;
        }
    }

    /// The grain that took part in most collisions of the last cycle, if that is too many: it is caught
    /// between others, which push it back and forth while the rest stands still.
    fn pinned_grain(&self) -> Option<usize> {
        let collisions = |grain: &usize| u64::from(self.system.cold[*grain].collisions);
        let all: u64 = (0..self.system.len()).map(|grain| collisions(&grain)).sum();
        let most = (0..self.system.len()).max_by_key(collisions)?;
        let pinned =
            self.system.len() >= PINNED_AMONG && collisions(&most) as f64 > PINNED_SHARE * all as f64 / 2.0;
        pinned.then_some(most)
    }

    pub(crate) fn elapsed_s(&self, frame: &Frame<'_>) -> f64 {
        self.earlier_s + frame.started.elapsed().as_secs_f64()
    }

    /// Collisions per grain that growth to the largest distance has left, in all of [`LENGTH_COLLISIONS`] without a
    /// limit. With a limit of time they follow from their number per time of growth so far.
    fn collisions_left(&self, frame: &Frame<'_>) -> f64 {
        let (stop, n) = (&frame.options.stop, self.system.len() as f64);
        let done = self.system.counts.collisions() as f64 / n;
        let by_events = stop.events.map(|most| most as f64 / n - done);
        let elapsed_s = self.elapsed_s(frame);
        let per_s =
            if done > 0.0 { done / (elapsed_s - self.rsa_s).max(f64::EPSILON) } else { f64::INFINITY };
        let by_time = stop.time_s.map(|most| (most - elapsed_s) * per_s);
        let by_limits = by_events.into_iter().chain(by_time).reduce(f64::min);
        let paced = self.paced_collisions_left();
        let [without, most] = match paced {
            Some(left) => [left; 2],
            None => [LENGTH_COLLISIONS - done, MOST_LENGTH_COLLISIONS - done],
        };
        by_limits.map_or(without, |left| left.min(most))
    }

    /// Puts the grains, which jammed just before their target, to where they fit exactly.
    pub(crate) fn settle(&mut self, protocol: &GrowthProtocol, centers: &[[f64; 3]]) {
        for (hot, &rank) in self.system.hot.iter_mut().zip(&self.system.rank) {
            hot.position = centers[rank as usize];
        }
        self.size = BEYOND_TARGET;
        self.set_radii(protocol);
    }

    /// Centres by rank.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(crate) fn centers(&self) -> Result<Vec<[f64; 3]>, OutOfMemory> {
        let mut centers = filled(self.system.len(), [0.0; 3])?;
        for (hot, &rank) in self.system.hot.iter().zip(&self.system.rank) {
            centers[rank as usize] = self.system.container.wrap(hot.position);
        }
        Ok(centers)
    }
}

/// The rate towards a target, as it is at the start.
fn first_rate(frame: &Frame<'_>, protocol: &GrowthProtocol) -> CompressionRate {
    let rate = match frame.options.growth_rate {
        Some(per_s) => per_s * mean_radius_mm(protocol) / frame.thermal_velocity(),
        None => LOOSE_RATE,
    };
    CompressionRate::new(rate, protocol.radii_mm.len())
}

fn mean_radius_mm(protocol: &GrowthProtocol) -> f64 {
    protocol.radii_mm.iter().sum::<f64>() / protocol.radii_mm.len() as f64
}

fn radius(of_protocol: f64, stage: Stage, size: f64) -> f64 {
    match stage {
        Stage::Scale => of_protocol * size,
        Stage::Length => of_protocol + size,
    }
}

fn radii(protocol: &GrowthProtocol, stage: Stage, size: f64) -> Result<Vec<f64>, OutOfMemory> {
    collected(protocol.radii_mm.iter().map(|&r| radius(r, stage, size)))
}
