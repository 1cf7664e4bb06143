//! One block: the grains that move in it and those that are held at its faces, as a system of its own.

use rand_xoshiro::Xoshiro256PlusPlus;

use super::cuts::{Cuts, Reached, all_blocks};
use super::{Swaps, Task};
use crate::arrays;
use crate::memory::{OutOfMemory, collected, make_room};
use crate::methods::edmd::container::Container;
use crate::methods::edmd::growth::Growth;
use crate::methods::edmd::swap::{self, LogRatio};
use crate::methods::edmd::system::{Counts, System};
use crate::rng::branch;

/// Events between two looks at whether to end.
const EVENTS_PER_LOOK: u64 = 20_000;

/// A block ends after this many times the time that its collisions are expected to take: where few grains move, they
/// may not collide so often.
const MOST_TIMES: f64 = 100.0;

/// A block with its grains.
pub(super) struct Block {
    low: [f64; 3],
    size: [f64; 3],
    /// The faces that are no walls of the specimen, as bits.
    faces: u32,
    /// Place of the axis and radius, in a cylinder.
    lateral: Option<[f64; 3]>,
    /// The grains that move, then those that are held, and their places from the low corner.
    grains: Vec<u32>,
    places: Vec<[f64; 3]>,
    pub(super) moving: usize,
    rng: Xoshiro256PlusPlus,
}

/// What came of the grains that moved, in their order.
#[derive(Default)]
pub(super) struct Done {
    grains: Vec<Moved>,
    counts: Counts,
    pub(super) virial: f64,
    pub(super) energy: f64,
    pub(super) time: f64,
    pub(super) swaps_tried: u64,
    pub(super) swaps_accepted: u64,
}

struct Moved {
    place: [f64; 3],
    velocity: [f64; 3],
    radius: f64,
    mass: f64,
    skin: f64,
    rank: u32,
    collisions: u16,
    rebuilds: u16,
}

impl Block {
    /// All blocks of a specimen, those with the most grains first, so that threads end together.
    pub(super) fn all(
        system: &System,
        cuts: &Cuts,
        growth: Growth,
        rng: &mut Xoshiro256PlusPlus,
    ) -> Result<Vec<Self>, OutOfMemory> {
        let counts = cuts.blocks();
        let cylinder_mm = match system.container {
            Container::Cylinder { radius_mm, .. } => Some(radius_mm),
            _ => None,
        };
        let empty = |at: [usize; 3]| {
            let (mut low, mut size, mut faces) = ([0.0; 3], [0.0; 3], 0);
            for a in 0..3 {
                (low[a], size[a]) = cuts.extent(a, at[a]);
                let [low_end, high_end] = cuts.are_faces(a, at[a]);
                faces |= u32::from(low_end) << (2 * a) | u32::from(high_end) << (2 * a + 1);
            }
            let lateral = cylinder_mm.map(|radius| [radius - low[0], radius - low[1], radius]);
            let rng = branch(rng);
            Self { low, size, faces, lateral, grains: Vec::new(), places: Vec::new(), moving: 0, rng }
        };
        let mut blocks = collected(all_blocks(counts)?.into_iter().map(empty))?;
        let per_block = system.len() / blocks.len() + 1;
        let mut held: Vec<(usize, u32, [f64; 3])> = Vec::new();
        let mut found: [Vec<Reached>; 3] = Default::default();
        for (i, hot) in system.hot.iter().enumerate() {
            let (contact, _) = growth.face(hot.radius);
            for (a, found) in found.iter_mut().enumerate() {
                cuts.reach(a, hot.position[a], contact, found);
            }
            let moves = found.iter().all(|found| found.len() == 1);
            for x in &found[0] {
                for y in &found[1] {
                    for z in &found[2] {
                        let block = (x.block * counts[1] + y.block) * counts[2] + z.block;
                        let place = [x.place, y.place, z.place];
                        if moves {
                            blocks[block].enter(i, place, per_block)?;
                        } else {
                            make_room(&mut held, 1)?;
                            held.push((block, i as u32, place));
                        }
                    }
                }
            }
        }
        for block in &mut blocks {
            block.moving = block.grains.len();
        }
        for (block, i, place) in held {
            blocks[block].enter(i as usize, place, per_block / 4 + 1)?;
        }
        blocks.sort_by_key(|block| std::cmp::Reverse(block.moving));
        Ok(blocks)
    }

    fn enter(&mut self, grain: usize, place: [f64; 3], at_once: usize) -> Result<(), OutOfMemory> {
        if self.grains.len() == self.grains.capacity() {
            make_room(&mut self.grains, at_once)?;
            make_room(&mut self.places, at_once)?;
        }
        self.grains.push(grain as u32);
        self.places.push(place);
        Ok(())
    }

    /// Lets its grains change places and collide.
    pub(super) fn run(&self, whole: &System, task: &Task<'_>) -> Result<Done, OutOfMemory> {
        if self.moving == 0 {
            // As in a corner outside of a cylinder.
            return Ok(Done::default());
        }
        let (mut system, ranks) = self.system(whole)?;
        // A collision is an event of two grains, and as many events are looked at in vain.
        let expected = 3.0 * task.events_per_grain * whole.len() as f64 / task.events_per_time;
        let most_time = MOST_TIMES * expected;
        system.rebuild_all_lists(task.growth, most_time)?;
        let (swaps_tried, swaps_accepted) = match task.swaps {
            Some(swaps) => self.swap(whole, &mut system, &ranks, swaps)?,
            None => (0, 0),
        };
        let energy = system.energy();
        system.predict_all(task.events_per_time * self.moving as f64 / whole.len() as f64)?;
        let most = (task.events_per_grain * self.moving as f64) as u64;
        let (mut time, mut told) = (0.0, 0);
        while told < most && time < most_time && !system.is_crowded() {
            time = system.run(most - told, EVENTS_PER_LOOK);
            if let Some(refused) = system.refused() {
                return Err(refused);
            }
            let before = std::mem::replace(&mut told, system.counts.collisions());
            if (task.is_over)(told - before) {
                break;
            }
        }
        system.synchronise(time);
        let moved = |k: usize| {
            let (hot, cold) = (&system.hot[k], &system.cold[k]);
            Moved {
                place: hot.position,
                velocity: hot.velocity,
                radius: hot.radius,
                mass: system.mass[k],
                skin: cold.skin,
                rank: ranks[system.rank[k] as usize],
                collisions: cold.collisions,
                rebuilds: cold.rebuilds,
            }
        };
        Ok(Done {
            grains: collected((0..self.moving).map(moved))?,
            counts: system.counts,
            virial: system.virial,
            energy,
            time,
            swaps_tried,
            swaps_accepted,
        })
    }

    /// The block as a system, whose ranks count among the ranks of the grains that move, which come with it.
    fn system(&self, whole: &System) -> Result<(System, Vec<u32>), OutOfMemory> {
        let container = Container::Block { size_mm: self.size, lateral: self.lateral };
        let grains = || self.grains.iter().map(|&i| i as usize);
        let radii = collected(grains().map(|i| whole.hot[i].radius))?;
        let masses = collected(grains().map(|i| whole.mass[i]))?;
        let mut system = System::new(container, &self.places, &radii, &masses)?;
        (system.moving, system.faces) = (self.moving, self.faces);
        let mut ranks: Vec<u32> = collected(grains().take(self.moving).map(|i| whole.rank[i]))?;
        ranks.sort_unstable();
        for (k, i) in grains().enumerate() {
            let (own, of_whole) = (&mut system.cold[k], &whole.cold[i]);
            own.skin = of_whole.skin;
            (own.collisions, own.rebuilds) = (of_whole.collisions, of_whole.rebuilds);
            if k < self.moving {
                system.hot[k].velocity = whole.hot[i].velocity;
                system.rank[k] = ranks.partition_point(|&rank| rank < whole.rank[i]) as u32;
            }
        }
        Ok((system, ranks))
    }

    /// Tries swaps among the grains that move; returns how many were tried and made.
    fn swap(
        &self,
        whole: &System,
        system: &mut System,
        ranks: &[u32],
        swaps: Swaps<'_>,
    ) -> Result<(u64, u64), OutOfMemory> {
        let mut pairs = swaps.pairs.with_same_window();
        let sizes: Vec<f64> = collected(ranks.iter().map(|&rank| swaps.sizes[rank as usize]))?;
        let tries = (swaps.per_grain * self.moving as f64) as u64;
        let mut rng = self.rng.clone();
        let log_ratio = swaps.preference.map(|preference| {
            move |pair: [usize; 2], places: [[f64; 3]; 2]| {
                let places = places.map(|place| self.in_specimen(whole, place));
                preference.log_acceptance_ratio(pair.map(|rank| ranks[rank] as usize), places)
            }
        });
        let log_ratio = log_ratio.as_ref().map(|log_ratio| log_ratio as LogRatio<'_>);
        swap::sweep(&mut pairs, system, &sizes, log_ratio, tries, &mut rng)?;
        Ok((pairs.tried, pairs.accepted))
    }

    fn in_specimen(&self, whole: &System, place: [f64; 3]) -> [f64; 3] {
        whole.container.wrap(arrays::from_fn(|a| self.low[a] + place[a]))
    }

    /// Takes the grains that moved over into the system of all.
    pub(super) fn hand_back(&self, whole: &mut System, done: &Done) {
        whole.counts.add(&done.counts);
        for (&i, moved) in self.grains.iter().zip(&done.grains) {
            let i = i as usize;
            let position = self.in_specimen(whole, moved.place);
            let hot = &mut whole.hot[i];
            (hot.position, hot.velocity, hot.radius) = (position, moved.velocity, moved.radius);
            let cold = &mut whole.cold[i];
            cold.skin = moved.skin;
            (cold.collisions, cold.rebuilds) = (moved.collisions, moved.rebuilds);
            whole.mass[i] = moved.mass;
            whole.rank[i] = moved.rank;
        }
    }
}
