//! What needs the inside of the dynamics: closed forms against high precision, single collisions, the
//! queue against a model, states that were tampered with.
//!
//! Everything goes through a few grains set up by hand ([`Scene`]), so that a change of the records or
//! lists is followed in one place.
#![allow(clippy::unwrap_used)]

mod blocks;
mod bodies;
mod collisions;
mod double;
mod lists;
mod queue;
mod reversal;
mod roots;
mod shortlists;
mod start;

use super::container::Container;
use super::growth::Growth;
use super::system::System;

/// One grain as a test puts it.
#[derive(Clone, Copy, Debug)]
struct Placed {
    position: [f64; 3],
    velocity: [f64; 3],
    radius: f64,
    mass: f64,
}

/// A few grains in one cycle.
struct Scene {
    system: System,
}

impl Scene {
    /// Grains at the start of a cycle that lasts `end_s`.
    fn new(container: Container, growth: Growth, end_s: f64, grains: &[Placed]) -> Self {
        let positions: Vec<_> = grains.iter().map(|grain| grain.position).collect();
        let radii: Vec<_> = grains.iter().map(|grain| grain.radius).collect();
        let masses: Vec<_> = grains.iter().map(|grain| grain.mass).collect();
        let mut system = System::new(container, &positions, &radii, &masses).unwrap();
        for (hot, grain) in system.hot.iter_mut().zip(grains) {
            hot.velocity = grain.velocity;
        }
        system.rebuild_all_lists(growth, end_s).unwrap();
        system.predict_all(1.0).unwrap();
        Self { system }
    }

    /// Lets one collision happen; its time, or `None` where there is none until the cycle ends.
    fn collide(&mut self) -> Option<f64> {
        let before = self.system.counts.collisions();
        let reached = self.system.run(1, u64::MAX);
        (self.system.counts.collisions() > before).then_some(reached)
    }

    fn velocity(&self, grain: usize) -> [f64; 3] {
        self.system.hot[grain].velocity
    }

    fn position_at(&self, grain: usize, time: f64) -> [f64; 3] {
        self.system.hot[grain].position_at(time)
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

fn plus_times(a: [f64; 3], factor: f64, b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] + factor * b[k])
}
