//! Equal spheres in a periodic box without growth: the hard-sphere fluid, whose properties are known.
//!
//! Physics and speed are measured on it. Its compressibility factor is `Z = p V / (N k T)`. As in growth, many spheres
//! collide in blocks, which threads share.

use std::num::NonZeroUsize;
use std::time::Instant;

use super::blocks::{self, Task};
use super::container::Container;
use super::growth::Growth;
use super::system::System;
use crate::arrays;
use crate::control::Unattended;
use crate::distance::DistanceRule;
use crate::elementary::cbrt;
use crate::memory::OutOfMemory;
use crate::methods::rsa::Rsa;
use crate::request::{Boundary, Distance, Specimen};
use crate::rng::{Stream, cycle_stream, stream};

/// Volume fraction that random addition starts from, and the rate of growth to the one asked for.
const START_FRACTION: f64 = 0.25;
const PACE: f64 = 0.3;
/// Collisions per grain between two cycles while nothing grows.
const EVENTS_PER_GRAIN: u64 = 25;
/// The same where spheres collide in blocks, which are divided again in each cycle.
const EVENTS_PER_GRAIN_IN_BLOCKS: u64 = 5;
/// A hard-sphere fluid of spheres of diameter 1 mm.
#[derive(Debug)]
pub struct Fluid {
    system: System,
    events_per_time: f64,
    seed: u64,
    cycles: u64,
}

/// What was measured over a number of collisions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FluidFigures {
    /// Collisions.
    pub collisions: u64,
    /// Wall-clock time in s.
    pub seconds: f64,
    /// Compressibility factor `p V / (N k T)`.
    pub reduced_pressure: f64,
}

/// What the system grants: a benchmark has no use for less.
fn granted<T>(asked: Result<T, OutOfMemory>) -> T {
    asked.unwrap_or_else(|OutOfMemory { bytes }| panic!("the system refuses {bytes} bytes"))
}

impl Fluid {
    /// So many spheres at a volume fraction below freezing (0.49), from a seed.
    ///
    /// # Panics
    /// When there is no sphere, the volume fraction can't be reached, or the system refuses memory.
    pub fn new(spheres: usize, volume_fraction: f64, seed: u64) -> Self {
        assert!(spheres > 0 && volume_fraction > 0.0 && volume_fraction < 0.6, "no such fluid");
        let edge = cbrt(spheres as f64 * std::f64::consts::PI / 6.0 / volume_fraction);
        let specimen = Specimen::cuboid([edge; 3], Boundary::Periodic);
        let mut scale = cbrt(START_FRACTION / volume_fraction).min(1.0);
        let addition = Rsa {
            diameters_mm: &vec![scale; spheres],
            domain: specimen.domain(),
            rule: DistanceRule::new(&Distance::None { wall_gap_mm: None }, &specimen),
            preference: None,
            threads: NonZeroUsize::MIN,
            attempts_per_grain: None,
        };
        let centers = addition.run(&mut stream(seed, Stream::Rsa), &Unattended).placed;
        assert_eq!(centers.len(), spheres, "random addition reaches the start");
        let radii = vec![scale / 2.0; spheres];
        let system = System::new(Container::new(&specimen), &centers, &radii, &vec![1.0; spheres]);
        let mut system = granted(system);
        system.set_in_motion(1.0, &mut cycle_stream(seed, 0));
        let mut fluid = Self { system, events_per_time: spheres as f64, seed, cycles: 0 };
        granted(fluid.system.sort_along_curve());
        while scale < 1.0 {
            let alpha = PACE * fluid.system.thermal_velocity() / (scale / 2.0);
            let end = (0.01_f64).min(1.0 / scale - 1.0) / alpha;
            fluid.cycle(Growth { alpha, ..Growth::default() }, end, u64::MAX);
            scale = if 1.0 / scale - 1.0 <= 0.01 { 1.0 } else { scale * (1.0 + alpha * end) };
            for hot in &mut fluid.system.hot {
                hot.radius = scale / 2.0;
            }
        }
        fluid
    }

    /// Sets the largest number of threads that share the work. Nothing else depends on it.
    #[must_use]
    pub fn with_threads(mut self, threads: NonZeroUsize) -> Self {
        self.system.threads = threads;
        self
    }

    /// Collisions in blocks, so many per sphere that moves; returns the simulated time and the compressibility factor.
    fn cycle_in_blocks(&mut self, events_per_grain: f64) -> (f64, f64) {
        self.cycles += 1;
        let before = self.system.counts.collisions();
        let task = Task {
            growth: Growth::default(),
            events_per_grain,
            events_per_time: self.events_per_time,
            swaps: None,
            is_over: &|_| false,
        };
        let outcome =
            granted(blocks::collide(&mut self.system, &task, &mut cycle_stream(self.seed, self.cycles)));
        let collisions = (self.system.counts.collisions() - before) as f64;
        self.events_per_time = 3.0 * collisions / outcome.time / (1.0 - outcome.held);
        (outcome.time, outcome.pressure)
    }

    fn cycle(&mut self, growth: Growth, end: f64, most: u64) -> f64 {
        let before = self.system.counts.collisions();
        granted(self.system.rebuild_all_lists(growth, end));
        granted(self.system.predict_all(self.events_per_time));
        let reached = self.system.run(most, u64::MAX);
        self.system.synchronise(reached);
        self.events_per_time = 3.0 * (self.system.counts.collisions() - before) as f64 / reached;
        reached
    }

    /// Lets a number of collisions happen, and measures.
    ///
    /// # Panics
    /// When the system refuses memory.
    pub fn run(&mut self, collisions: u64) -> FluidFigures {
        let start = Instant::now();
        let before = self.system.counts.collisions();
        let energy = self.system.energy();
        let (mut virial, mut time) = (0.0, 0.0);
        loop {
            let done = self.system.counts.collisions() - before;
            if done >= collisions {
                return FluidFigures {
                    collisions: done,
                    seconds: start.elapsed().as_secs_f64(),
                    reduced_pressure: 1.0 + virial / (2.0 * energy * time),
                };
            }
            let n = self.system.len() as u64;
            if blocks::can_cut(&self.system) {
                let per_grain = EVENTS_PER_GRAIN_IN_BLOCKS.min((collisions - done).div_ceil(n));
                let (in_blocks, pressure) = self.cycle_in_blocks(per_grain as f64);
                time += in_blocks;
                virial += (pressure - 1.0) * 2.0 * energy * in_blocks;
                continue;
            }
            let most = (EVENTS_PER_GRAIN * n).min(collisions - done);
            time += self.cycle(Growth::default(), f64::MAX, most);
            virial += self.system.virial;
        }
    }

    /// Centres in the box, whose edge is the second.
    pub fn centers_mm(&self) -> (Vec<[f64; 3]>, f64) {
        let wrap = |hot: &super::records::Hot| self.system.container.wrap(hot.position);
        (self.system.hot.iter().map(wrap).collect(), self.system.container.bounds_mm()[0])
    }

    /// Kinetic energy and momentum, with all masses 1.
    pub fn energy_and_momentum(&self) -> (f64, [f64; 3]) {
        let sum = |a: usize| self.system.hot.iter().map(|hot| hot.velocity[a]).sum();
        (self.system.energy(), arrays::from_fn(sum))
    }

    /// Turns all velocities around.
    pub fn reverse(&mut self) {
        self.system.scale_velocities(-1.0);
    }
}
