//! Collisions without growth in blocks of the specimen, which threads share.
//!
//! The specimen is cut by planes that lie elsewhere each time. A grain that lies within a block moves there and bounces
//! off the faces between the blocks; a grain that a plane cuts is held in its place, and others bounce off it as off a
//! wall. Nothing that moves in one block can touch what moves in another, so that each block is a system of its own,
//! small enough for the caches of a processor. The outcome depends on the stream of random numbers, and neither on the
//! number of threads nor on the order in which the blocks end.
//!
//! The grains of each block sample the equilibrium of hard spheres in which the held ones lie where they are; with
//! planes that move, all grains do (the domain decomposition of hard-particle Monte Carlo rests on the same: Anderson,
//! Jankowski, Grubb, Engel and Glotzer 2013, DOI 10.1016/j.jcp.2013.07.023). Momentum is not conserved at held grains
//! and faces, energy is.

mod block;
mod cuts;

use rand_xoshiro::Xoshiro256PlusPlus;

use super::growth::Growth;
use super::system::System;
use crate::memory::{OutOfMemory, collected};
use crate::methods::swap_pairs::SwapPairs;
use crate::segregation::Preference;
use crate::threads::share;
use block::{Block, Done};
use cuts::Cuts;

/// Grains from which a slowed cycle lets them collide in blocks.
pub(crate) const LEAST_GRAINS: usize = 40_000;

/// What grains do in all blocks.
pub(crate) struct Task<'a> {
    /// Contact distances, without rates.
    pub(crate) growth: Growth,
    /// Collisions per grain that moves.
    pub(crate) events_per_grain: f64,
    /// Events of all grains per s that queues are laid out for.
    pub(crate) events_per_time: f64,
    pub(crate) swaps: Option<Swaps<'a>>,
    /// Takes the number of collisions since the last call, and says whether to end before the rest.
    pub(crate) is_over: &'a (dyn Fn(u64) -> bool + Sync),
}

/// Swaps that are tried before the collisions.
#[derive(Clone, Copy)]
pub(crate) struct Swaps<'a> {
    pub(crate) per_grain: f64,
    pub(crate) pairs: &'a SwapPairs,
    /// Contact radii at the target by rank, falling.
    pub(crate) sizes: &'a [f64],
    pub(crate) preference: Option<&'a Preference>,
}

/// What came of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Outcome {
    /// Simulated time in s, on average over the grains that moved.
    pub(crate) time: f64,
    /// Compressibility factor, from the collisions of grains and with walls of the specimen.
    pub(crate) pressure: f64,
    /// Share of the grains that were held.
    pub(crate) held: f64,
    pub(crate) swaps_tried: u64,
    pub(crate) swaps_accepted: u64,
}

/// Whether planes cut the specimen of a system at all: not where its grains are too coarse, or too few.
pub(crate) fn can_cut(system: &System) -> bool {
    system.len() >= LEAST_GRAINS && cuts::number_of_blocks(system) > 1
}

/// Lets the grains of a system, which are at time 0, collide in blocks. Threads of the system share the blocks.
///
/// # Errors
/// When the system refuses memory.
pub(crate) fn collide(
    system: &mut System,
    task: &Task<'_>,
    rng: &mut Xoshiro256PlusPlus,
) -> Result<Outcome, OutOfMemory> {
    system.forget_lists();
    for hot in &mut system.hot {
        hot.position = system.container.wrap(hot.position);
    }
    let cuts = Cuts::choose(system, rng);
    let blocks = Block::all(system, &cuts, task.growth, rng)?;
    let whole = &*system;
    let mut pieces = collected(blocks.iter().map(|block| (block, Ok(Done::default()))))?;
    share(system.threads, &mut pieces, |_, (block, done)| *done = block.run(whole, task));
    let results = collected(pieces.into_iter().map(|(_, done)| done))?;

    let mut outcome = Outcome::default();
    let (mut moving, mut virial_rate, mut energy) = (0, 0.0, 0.0);
    for (block, done) in blocks.iter().zip(results) {
        let done = done?;
        moving += block.moving;
        outcome.time += done.time * block.moving as f64;
        outcome.swaps_tried += done.swaps_tried;
        outcome.swaps_accepted += done.swaps_accepted;
        energy += done.energy;
        if done.time > 0.0 {
            virial_rate += done.virial / done.time;
        }
        block.hand_back(system, &done);
    }
    outcome.time /= moving.max(1) as f64;
    outcome.held = 1.0 - moving as f64 / system.len() as f64;
    if energy > 0.0 {
        // Of the contacts, those between two held grains are missing. A neighbour of a held grain is held if it lies
        // along the plane: about every second.
        let counted = 1.0 - outcome.held / 2.0;
        let per_energy = virial_rate / (2.0 * energy) * (1.0 - outcome.held);
        outcome.pressure = 1.0 + per_energy / counted;
    }
    Ok(outcome)
}
