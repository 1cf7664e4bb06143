//! Grains in motion within one compression cycle: their records, their near-neighbour lists, and the rebuilds of both.
//!
//! Every grain lives in its NNL sphere, whose radius is its skin (Donev, Torquato and Stillinger 2005, DOI
//! 10.1016/j.jcp.2004.08.014). Two grains whose NNL spheres, enlarged by their contact radii at the end of the cycle
//! to their cutoffs, do not overlap cannot meet; all others stand in each other's lists. A grain that leaves its NNL
//! sphere gets a new one and a new list.

use std::num::NonZeroUsize;

use rand_xoshiro::Xoshiro256PlusPlus;

use super::container::{Container, IMAGES, mirrored};
use super::grid::Grid;
use super::growth::Growth;
use super::queue::Queue;
use super::records::{Cold, Hot, Next};
use super::shortlist::Shortlist;
use super::skin;
use crate::arrays::{self, Each as _};
use crate::cpu::{Cpu, prefetch};
use crate::memory::{OutOfMemory, collected, copied, filled};
use crate::methods::morton;
use crate::rng::uniform;
use crate::threads::share;

/// Bits of a list entry that hold the grain; the rest is the code of the image.
pub(crate) const GRAIN_BITS: u32 = 25;
pub(super) const GRAIN_MASK: u32 = (1 << GRAIN_BITS) - 1;
/// Most grains that list entries can name, less the codes of other events.
pub(crate) const MAX_GRAINS: usize = (1 << GRAIN_BITS) - 16;

/// Bounds of the skin in contact radii.
const LEAST_SKIN: f64 = 0.04;
const MOST_SKIN: f64 = 2.0;
/// Cache lines of a list that are asked for ahead.
const LIST_LINES: u32 = 3;
/// Entries of all lists from which their memory is given back between two cycles.
const LARGE_SLAB: usize = 1 << 22;
/// What was counted since the run began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    pub(crate) grain_collisions: u64,
    pub(crate) wall_collisions: u64,
    pub(crate) list_rebuilds: u64,
    pub(crate) predictions: u64,
    pub(crate) stale_events: u64,
}

impl Counts {
    /// Adds what was counted elsewhere.
    pub(crate) fn add(&mut self, other: &Self) {
        self.grain_collisions += other.grain_collisions;
        self.wall_collisions += other.wall_collisions;
        self.list_rebuilds += other.list_rebuilds;
        self.predictions += other.predictions;
        self.stale_events += other.stale_events;
    }

    /// Events that changed a velocity.
    pub(crate) fn collisions(&self) -> u64 {
        self.grain_collisions + self.wall_collisions
    }
}

/// All grains of a run.
#[derive(Debug)]
pub(crate) struct System {
    /// What the event loop and the lists are compiled for.
    pub(crate) cpu: Cpu,
    pub(crate) container: Container,
    pub(crate) hot: Vec<Hot>,
    pub(crate) cold: Vec<Cold>,
    /// Relative masses.
    pub(crate) mass: Vec<f64>,
    pub(crate) next: Vec<Next>,
    /// Which diameter each grain has, counted from the largest.
    pub(crate) rank: Vec<u32>,
    pub(crate) growth: Growth,
    /// Grains that move: the first. Others are held in their places.
    pub(crate) moving: usize,
    /// The walls that are faces between blocks, as bits.
    pub(crate) faces: u32,
    /// Bound of the skin by which no search goes beyond the images there are, in mm.
    pub(super) most_skin: f64,
    /// Length of the cycle in s.
    pub(crate) end: f64,
    pub(crate) shifts: Box<[[f64; 3]; IMAGES]>,
    pub(crate) counts: Counts,
    /// Sum over collisions of impulse times contact distance since the cycle began.
    pub(crate) virial: f64,
    pub(crate) queue: Queue,
    pub(super) grid: Grid,
    pub(super) slab: Vec<u32>,
    pub(super) slab_at_start: usize,
    /// Memory that a list was refused; lists are incomplete from then on.
    refused: Option<OutOfMemory>,
    /// Room for the candidates of a rebuild.
    pub(super) found: Vec<u32>,
    /// Shortlists, and which of them a grain that has one has.
    pub(crate) shortlists: Vec<Shortlist>,
    pub(crate) shortlist_of: Vec<u32>,
    /// Room for the times of a scan.
    pub(crate) arrivals: Vec<f64>,
    /// Most threads that share the start of a cycle; nothing depends on their number.
    pub(crate) threads: NonZeroUsize,
}

impl System {
    /// Grains at rest with a skin of 0, meaning that none is known yet; centres, contact radii and masses
    /// in the order of the ranks.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(crate) fn new(
        container: Container,
        centers: &[[f64; 3]],
        radii: &[f64],
        masses: &[f64],
    ) -> Result<Self, OutOfMemory> {
        let at_rest = |(&position, &radius)| Hot { position, radius, ..Hot::default() };
        Ok(Self {
            cpu: Cpu::detect(),
            container,
            hot: collected(centers.iter().zip(radii).map(at_rest))?,
            cold: filled(radii.len(), Cold::default())?,
            mass: copied(masses)?,
            next: Vec::new(),
            rank: collected(0..radii.len() as u32)?,
            growth: Growth::default(),
            moving: radii.len(),
            faces: 0,
            most_skin: f64::INFINITY,
            end: 0.0,
            shifts: Box::new(container.shifts()),
            counts: Counts::default(),
            virial: 0.0,
            queue: Queue::default(),
            grid: Grid::default(),
            slab: Vec::new(),
            slab_at_start: 0,
            refused: None,
            found: Vec::new(),
            shortlists: Vec::new(),
            shortlist_of: Vec::new(),
            arrivals: Vec::new(),
            threads: NonZeroUsize::MIN,
        })
    }

    pub(crate) fn len(&self) -> usize {
        self.hot.len()
    }

    /// The neighbours of a grain, as list entries.
    #[inline(always)]
    pub(crate) fn list(&self, grain: usize) -> &[u32] {
        let cold = &self.cold[grain];
        &self.slab[cold.offset as usize..(cold.offset + cold.len) as usize]
    }

    /// The shortlist of a grain that has one.
    #[inline(always)]
    pub(crate) fn shortlist(&self, grain: usize) -> &Shortlist {
        &self.shortlists[self.shortlist_of[grain] as usize]
    }

    /// Asks the memory for the start of a grain's list.
    #[inline(always)]
    pub(crate) fn prefetch_list(&self, grain: usize) {
        let cold = &self.cold[grain];
        for line in 0..LIST_LINES.min(cold.len.div_ceil(16)) {
            prefetch(&self.slab, (cold.offset + 16 * line) as usize);
        }
    }

    /// Asks the memory for the neighbours of a grain whose list is there.
    #[inline(always)]
    pub(crate) fn prefetch_neighbours(&self, grain: usize) {
        let cold = &self.cold[grain];
        let list = if cold.is_coarse {
            let entries = self.shortlist(grain).entries();
            &entries[..entries.len().min(16 * LIST_LINES as usize)]
        } else {
            let end = cold.offset + cold.len.min(16 * LIST_LINES);
            &self.slab[cold.offset as usize..end as usize]
        };
        for &entry in list {
            prefetch(&self.hot, unpack(entry).0);
        }
    }

    /// Asks the memory for what a rebuild of a grain reads, whose list is there.
    #[inline(never)]
    pub(crate) fn prefetch_rebuild(&self, grain: usize) {
        for &entry in self.list(grain) {
            prefetch(&self.cold, unpack(entry).0);
        }
        let hot = &self.hot[grain];
        self.grid.ask(hot.position_at(self.next[grain].time), self.cold[grain].cutoff);
    }

    /// Largest contact radius of the cycle.
    #[inline(always)]
    pub(super) fn last_radius(&self, grain: usize) -> f64 {
        self.growth.radius(self.hot[grain].radius, self.end)
    }

    /// Distance from a wall at which a grain touches it at the start of the cycle, and its rate.
    #[inline(always)]
    pub(super) fn wall_contact(&self, radius: f64, wall: u32) -> (f64, f64) {
        if self.is_face(wall) { self.growth.face(radius) } else { self.growth.wall(radius) }
    }

    /// Whether a wall is a face between two blocks.
    #[inline(always)]
    pub(super) fn is_face(&self, wall: u32) -> bool {
        self.faces >> wall & 1 != 0
    }

    /// Whether lists grew so much that the cycle should end.
    pub(crate) fn is_crowded(&self) -> bool {
        self.slab.len() > 2 * self.slab_at_start + 4096
    }

    /// The memory that a list was refused in the cycle, if one was: the run cannot go on.
    pub(crate) fn refused(&self) -> Option<OutOfMemory> {
        self.refused.or(self.queue.refused())
    }

    /// Gives the memory of all lists back where it is much: between two cycles other things need it.
    pub(super) fn forget_lists(&mut self) {
        if self.slab.capacity() >= LARGE_SLAB {
            self.slab = Vec::new();
        }
    }

    /// Starts a cycle of `end` s with all times at 0: NNL spheres around every grain,
    /// and new lists.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(crate) fn rebuild_all_lists(&mut self, growth: Growth, end: f64) -> Result<(), OutOfMemory> {
        self.forget_lists();
        self.growth = growth;
        self.end = end;
        self.virial = 0.0;
        if self.container.is_periodic() {
            // A contact distance is at most an edge; this leaves a search another one.
            let shortest = self.container.bounds_mm().into_iter().fold(f64::INFINITY, f64::min);
            self.most_skin = shortest / 2.0 / (1.0 + growth.kappa);
        }
        let n = self.len();
        for cold in &mut self.cold {
            cold.adapt_skin();
            (cold.collisions, cold.rebuilds) = (0, 0);
        }
        let volume = self.container.bounds_mm().into_iter().product();
        skin::choose_first(&self.hot, &mut self.cold, volume);
        self.center_all_spheres()?;
        let least = self.cold.iter().map(|cold| cold.cutoff).fold(f64::INFINITY, f64::min);
        let top = (0..n).map(|i| self.last_radius(i)).fold(0.0, f64::max) * 1.5;
        let top = self.cold.iter().map(|cold| cold.cutoff).fold(top, f64::max);
        let cutoffs = self.cold.iter().map(|cold| cold.cutoff);
        self.grid.reset(&self.container, n, least.max(1e-9 * top), top, cutoffs)?;
        for i in 0..n {
            self.cold[i].cell = self.grid.insert(i as u32, self.cold[i].center, self.cold[i].cutoff);
        }
        self.fill_lists()
    }

    /// Puts the NNL spheres of all grains around their positions. Threads share the work.
    fn center_all_spheres(&mut self) -> Result<(), OutOfMemory> {
        let threads = self.threads_for_all();
        let (container, growth, end, most_skin) = (&self.container, self.growth, self.end, self.most_skin);
        let per_thread = self.hot.len().div_ceil(threads.get()).max(1);
        let mut pieces = collected(self.hot.chunks_mut(per_thread).zip(self.cold.chunks_mut(per_thread)))?;
        let faces = self.faces;
        share(threads, &mut pieces, |_, (hot, cold)| {
            for (hot, cold) in hot.iter_mut().zip(cold.iter_mut()) {
                debug_assert_eq!(hot.time, 0.0);
                hot.position = container.wrap(hot.position);
                center_sphere(container, growth, faces, (end, most_skin), hot, cold);
            }
        });
        for held in self.cold.iter_mut().skip(self.moving) {
            held.walls = 0;
        }
        Ok(())
    }

    /// Puts the NNL sphere of a grain around its position.
    #[inline(always)]
    pub(super) fn center_sphere(&mut self, i: usize) {
        let bounds = (self.end, self.most_skin);
        center_sphere(&self.container, self.growth, self.faces, bounds, &self.hot[i], &mut self.cold[i]);
    }

    /// Notes that a list was refused memory, and ends the cycle.
    pub(crate) fn refuse(&mut self, refused: OutOfMemory) {
        self.refused = Some(refused);
        self.slab_at_start = 0;
    }

    /// Brings all grains to one time and sets it to 0; contact radii are left to the caller.
    pub(crate) fn synchronise(&mut self, time: f64) {
        for hot in &mut self.hot {
            hot.advance(time);
            hot.time = 0.0;
        }
    }

    /// Gives every grain a velocity with components uniform in plus minus `velocity` for the lightest,
    /// of the same energy for all, and no common drift in a periodic box.
    pub(crate) fn set_in_motion(&mut self, velocity: f64, rng: &mut Xoshiro256PlusPlus) {
        let mut drift = [0.0; 3];
        let mut total = 0.0;
        for (hot, mass) in self.hot.iter_mut().zip(&self.mass) {
            let scale = velocity / mass.sqrt();
            hot.velocity = arrays::from_fn(|_| (2.0 * uniform(rng) - 1.0) * scale);
            for (drift, v) in drift.iter_mut().zip(hot.velocity) {
                *drift += mass * v;
            }
            total += mass;
        }
        if self.container.is_periodic() && self.len() > 1 {
            for hot in &mut self.hot {
                hot.velocity = arrays::from_fn(|a| hot.velocity[a] - drift[a] / total);
            }
        }
    }

    /// Standard deviation of a component of the velocities.
    pub(crate) fn thermal_velocity(&self) -> f64 {
        let sum: f64 = self.hot.iter().map(|hot| hot.velocity.iter().map(|v| v * v).sum::<f64>()).sum();
        (sum / (3.0 * self.len() as f64)).sqrt()
    }

    pub(crate) fn scale_velocities(&mut self, factor: f64) {
        for hot in &mut self.hot {
            hot.velocity = hot.velocity.each(|v| v * factor);
        }
    }

    /// Sorts the grains in memory along a space-filling curve, between two cycles, so that neighbours
    /// in space are neighbours in memory.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(crate) fn sort_along_curve(&mut self) -> Result<(), OutOfMemory> {
        self.forget_lists();
        let size = self.container.bounds_mm();
        let longest = size.into_iter().fold(0.0, f64::max);
        let relative = |hot: &Hot| self.container.wrap(hot.position).each(|x| x / longest);
        let order = morton::order(self.hot.iter().map(relative))?;
        self.hot = collected(order.iter().map(|&i| self.hot[i as usize]))?;
        self.cold = collected(order.iter().map(|&i| self.cold[i as usize]))?;
        self.mass = collected(order.iter().map(|&i| self.mass[i as usize]))?;
        self.rank = collected(order.iter().map(|&i| self.rank[i as usize]))?;
        Ok(())
    }

    /// Kinetic energy of all grains.
    pub(crate) fn energy(&self) -> f64 {
        self.hot
            .iter()
            .zip(&self.mass)
            .map(|(hot, mass)| 0.5 * mass * hot.velocity.iter().map(|v| v * v).sum::<f64>())
            .sum()
    }
}

/// Puts the NNL sphere of a grain around its position, in a cycle of a length and with a bound of the skin.
#[inline(always)]
fn center_sphere(
    container: &Container,
    growth: Growth,
    faces: u32,
    (end, most_skin): (f64, f64),
    hot: &Hot,
    cold: &mut Cold,
) {
    let radius = growth.radius(hot.radius, end);
    let (start, rate) = growth.wall(hot.radius);
    let mut contact = (start + rate * end).max(start);
    if faces != 0 {
        let (start, rate) = growth.face(hot.radius);
        contact = contact.max(start + rate * end);
    }
    cold.skin = cold.skin.clamp(LEAST_SKIN * radius, MOST_SKIN * radius).min(most_skin);
    cold.cutoff = radius + cold.skin;
    cold.center = hot.position;
    cold.walls = container.walls_within(cold.center, contact + cold.skin) as u8;
}

/// The entry under which a grain stands in the list of the one that an entry of its own names.
#[inline(always)]
pub(crate) fn mirror(entry: u32, grain: usize) -> u32 {
    grain as u32 | mirrored(entry >> GRAIN_BITS) << GRAIN_BITS
}

/// The grain that a list entry names, and the code of the image in which it is seen.
#[inline(always)]
pub(crate) fn unpack(entry: u32) -> (usize, usize) {
    ((entry & GRAIN_MASK) as usize, (entry >> GRAIN_BITS) as usize)
}
