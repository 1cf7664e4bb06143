//! Grains in motion within one compression cycle: their records, their near-neighbour lists, and the rebuilds of both.
//!
//! Every grain lives in its NNL sphere, whose radius is its skin (Donev, Torquato and Stillinger 2005, DOI
//! 10.1016/j.jcp.2004.08.014). Two grains whose NNL spheres, enlarged by their contact radii at the end of the cycle
//! to their cutoffs, do not overlap cannot meet; all others stand in each other's lists. A grain that leaves its NNL
//! sphere gets a new one and a new list.

use rand_xoshiro::Xoshiro256PlusPlus;

use super::container::{Container, IMAGES, mirrored};
use super::grid::Grid;
use super::growth::Growth;
use super::queue::Queue;
use super::records::{Cold, Hot, Next};
use super::shortlist::{LEAST_NEIGHBOURS, MOST_SHORTLISTS, Shortlist};
use super::skin;
use crate::arrays::{self, Each as _};
use crate::cpu::{Cpu, InstructionSet, prefetch};
use crate::memory::{OutOfMemory, collected, copied, filled, make_room, refill, reserved};
use crate::rng::uniform;

/// Bits of a list entry that hold the grain; the rest is the code of the image.
pub(crate) const GRAIN_BITS: u32 = 25;
const GRAIN_MASK: u32 = (1 << GRAIN_BITS) - 1;
/// Most grains that list entries can name, less the codes of other events.
pub(crate) const MAX_GRAINS: usize = (1 << GRAIN_BITS) - 16;

/// Bounds of the skin in contact radii.
const LEAST_SKIN: f64 = 0.04;
const MOST_SKIN: f64 = 2.0;
/// Cache lines of a list that are asked for ahead.
const LIST_LINES: u32 = 3;
/// Grains between two reservations of room for pairs while lists are built, and the pairs of a grain that room is
/// reserved for: on average there are fewer than twenty.
const GRAINS_PER_RESERVATION: usize = 256;
const HALF_PER_GRAIN: usize = 64;
/// Entries of all lists from which their memory is given back between two cycles.
const LARGE_SLAB: usize = 1 << 22;
/// Free places of a new list.
const SPARE: u32 = 3;

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
    /// Bound of the skin by which no search goes beyond the images there are, in mm.
    most_skin: f64,
    /// Length of the cycle in s.
    pub(crate) end: f64,
    pub(crate) shifts: Box<[[f64; 3]; IMAGES]>,
    pub(crate) counts: Counts,
    /// Sum over collisions of impulse times contact distance since the cycle began.
    pub(crate) virial: f64,
    pub(crate) queue: Queue,
    grid: Grid,
    slab: Vec<u32>,
    slab_at_start: usize,
    /// Memory that a list was refused; lists are incomplete from then on.
    refused: Option<OutOfMemory>,
    /// Room for the candidates of a rebuild.
    found: Vec<u32>,
    /// Shortlists, and which of them a grain that has one has.
    pub(crate) shortlists: Vec<Shortlist>,
    pub(crate) shortlist_of: Vec<u32>,
    /// Room for the times of a scan.
    pub(crate) arrivals: Vec<f64>,
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
    fn last_radius(&self, grain: usize) -> f64 {
        self.growth.radius(self.hot[grain].radius, self.end)
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
    fn forget_lists(&mut self) {
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
        for i in 0..n {
            debug_assert_eq!(self.hot[i].time, 0.0);
            self.hot[i].position = self.container.wrap(self.hot[i].position);
            self.center_sphere(i);
        }
        let least = self.cold.iter().map(|cold| cold.cutoff).fold(f64::INFINITY, f64::min);
        let top = (0..n).map(|i| self.last_radius(i)).fold(0.0, f64::max) * 1.5;
        let top = self.cold.iter().map(|cold| cold.cutoff).fold(top, f64::max);
        let cutoffs = self.cold.iter().map(|cold| cold.cutoff);
        self.grid.reset(&self.container, n, least.max(1e-9 * top), top, cutoffs)?;
        for i in 0..n {
            self.cold[i].cell = self.grid.insert(i as u32, self.cold[i].center, self.cold[i].cutoff);
        }
        // Called as a closure that is inlined: what it inlines is compiled for the instruction set.
        let cpu = self.cpu;
        if self.container.is_periodic() {
            cpu.call(
                #[inline(always)]
                || self.fill_lists::<true>(),
            )
        } else {
            cpu.call(
                #[inline(always)]
                || self.fill_lists::<false>(),
            )
        }
    }

    /// Puts the NNL sphere of a grain around its position.
    #[inline(always)]
    fn center_sphere(&mut self, i: usize) {
        let radius = self.last_radius(i);
        let (start, rate) = self.growth.wall(self.hot[i].radius);
        let contact = start + rate * self.end;
        let cold = &mut self.cold[i];
        cold.skin = cold.skin.clamp(LEAST_SKIN * radius, MOST_SKIN * radius).min(self.most_skin);
        cold.cutoff = radius + cold.skin;
        cold.center = self.hot[i].position;
        cold.walls = self.container.walls_within(cold.center, contact.max(start) + cold.skin) as u8;
    }

    /// Whether two grains must know of each other, the second in some image.
    #[inline(always)]
    fn are_neighbours<const PERIODIC: bool>(&self, i: usize, j: usize, image: u32) -> bool {
        let (a, b) = (&self.cold[i], &self.cold[j]);
        let smaller = (a.cutoff - a.skin).min(b.cutoff - b.skin);
        let range = a.cutoff + b.cutoff + self.growth.kappa * smaller;
        let mut d: [f64; 3] = arrays::from_fn(|k| b.center[k] - a.center[k]);
        if PERIODIC {
            let shift = &self.shifts[image as usize];
            d = arrays::from_fn(|k| d[k] + shift[k]);
        }
        d[0] * d[0] + d[1] * d[1] + d[2] * d[2] < range * range
    }

    #[inline(always)]
    fn fill_lists<const PERIODIC: bool>(&mut self) -> Result<(), OutOfMemory> {
        let n = self.len();
        // Every pair once, at the coarser of the two or the later in memory: a fine grain would search many levels
        // whose cells are nearly empty.
        let mut half: Vec<u32> = reserved(n * 8)?;
        let mut ends: Vec<u32> = reserved(n)?;
        let mut degree = filled(n, 0_u32)?;
        for i in 0..n {
            if i % GRAINS_PER_RESERVATION == 0 {
                make_room(&mut half, HALF_PER_GRAIN * GRAINS_PER_RESERVATION.min(n))?;
            }
            let cutoff = self.cold[i].cutoff;
            let from = half.len();
            let center = self.cold[i].center;
            let least_of_level = self.grid.least_of_level(cutoff);
            self.grid.visit::<PERIODIC>(
                center,
                cutoff,
                self.growth.kappa,
                self.grid.finer(cutoff),
                #[inline(always)]
                |j, image| {
                    let j_index = j as usize;
                    if j_index == i {
                        return;
                    }
                    if j_index > i && self.cold[j_index].cutoff > least_of_level {
                        return;
                    }
                    if self.are_neighbours::<PERIODIC>(i, j_index, image) {
                        half.push(j | image << GRAIN_BITS);
                    }
                },
            );
            for &entry in &half[from..] {
                degree[(entry & GRAIN_MASK) as usize] += 1;
            }
            degree[i] += (half.len() - from) as u32;
            ends.push(half.len() as u32);
        }
        let mut offset = 0;
        for (cold, &degree) in self.cold.iter_mut().zip(&degree) {
            cold.offset = offset;
            (cold.len, cold.coarse_neighbours) = (0, 0);
            cold.is_coarse = degree >= LEAST_NEIGHBOURS;
            cold.capacity = degree + SPARE;
            offset += cold.capacity;
        }
        self.lay_out_shortlists()?;
        refill(&mut self.slab, offset as usize, 0)?;
        self.slab_at_start = offset as usize;
        let mut from = 0;
        for i in 0..n {
            let to = ends[i] as usize;
            for &entry in &half[from..to] {
                self.append(i, entry);
                self.append((entry & GRAIN_MASK) as usize, mirror(entry, i));
            }
            from = to;
        }
        Ok(())
    }

    /// Gives every coarse grain an empty shortlist, to the limit of their number.
    fn lay_out_shortlists(&mut self) -> Result<(), OutOfMemory> {
        let coarse = self.cold.iter().filter(|cold| cold.is_coarse).count();
        if coarse > 0 {
            let n = self.len();
            refill(&mut self.shortlist_of, n, 0)?;
        }
        let mut given = 0;
        for (cold, own) in self.cold.iter_mut().zip(&mut self.shortlist_of) {
            cold.is_coarse &= given < MOST_SHORTLISTS;
            if cold.is_coarse {
                *own = given as u32;
                given += 1;
            }
        }
        let missing = given.saturating_sub(self.shortlists.len());
        make_room(&mut self.shortlists, missing)?;
        self.shortlists.resize_with(given.max(self.shortlists.len()), Shortlist::default);
        self.shortlists.iter_mut().for_each(Shortlist::clear);
        Ok(())
    }

    /// Notes that a list was refused memory, and ends the cycle.
    pub(crate) fn refuse(&mut self, refused: OutOfMemory) {
        self.refused = Some(refused);
        self.slab_at_start = 0;
    }

    #[inline(always)]
    fn append(&mut self, grain: usize, entry: u32) {
        let is_coarse = self.cold[(entry & GRAIN_MASK) as usize].is_coarse;
        let cold = &mut self.cold[grain];
        if cold.len == cold.capacity {
            // A new place at the end of the slab; the old one stays empty until the next cycle.
            let (from, len) = (cold.offset as usize, cold.len as usize);
            let capacity = 2 * cold.capacity + SPARE;
            if let Err(refused) = make_room(&mut self.slab, capacity as usize) {
                self.refuse(refused);
                return;
            }
            cold.offset = self.slab.len() as u32;
            cold.capacity = capacity;
            let capacity = cold.capacity as usize;
            self.slab.extend_from_within(from..from + len);
            self.slab.resize(cold.offset as usize + capacity, 0);
        }
        let at = (cold.offset + cold.len) as usize;
        cold.len += 1;
        if is_coarse {
            let first = cold.offset as usize + usize::from(cold.coarse_neighbours);
            cold.coarse_neighbours += 1;
            self.slab[at] = self.slab[first];
            self.slab[first] = entry;
        } else {
            self.slab[at] = entry;
        }
    }

    #[inline(always)]
    fn take_out(&mut self, grain: usize, entry: u32) {
        let cold = &mut self.cold[grain];
        let list = &mut self.slab[cold.offset as usize..(cold.offset + cold.len) as usize];
        let Some(at) = position(list, entry) else { return };
        let last = list.len() - 1;
        cold.len -= 1;
        let coarse = usize::from(cold.coarse_neighbours);
        if at < coarse {
            // The last of the coarse ones comes to its place, and the last of all to that.
            list[at] = list[coarse - 1];
            list[coarse - 1] = list[last];
            cold.coarse_neighbours -= 1;
        } else {
            list[at] = list[last];
        }
        if cold.is_coarse {
            self.shortlists[self.shortlist_of[grain] as usize].remove(entry);
        }
    }

    /// Gives a grain whose record stands at the present a new NNL sphere and new
    /// neighbours.
    #[inline(never)]
    pub(crate) fn rebuild_list<S: InstructionSet, const PERIODIC: bool>(&mut self, set: S, i: usize) {
        set.call(
            #[inline(always)]
            || self.rebuild_list_inlined::<PERIODIC>(i),
        );
    }

    #[inline(always)]
    fn rebuild_list_inlined<const PERIODIC: bool>(&mut self, i: usize) {
        self.counts.list_rebuilds += 1;
        let (offset, len) = (self.cold[i].offset as usize, self.cold[i].len as usize);
        // Far apart in memory: asked for all at once, not one after the other.
        for k in offset..offset + len {
            prefetch(&self.cold, unpack(self.slab[k]).0);
        }
        for k in offset..offset + len {
            self.prefetch_list(unpack(self.slab[k]).0);
        }
        for k in offset..offset + len {
            let entry = self.slab[k];
            self.take_out((entry & GRAIN_MASK) as usize, mirror(entry, i));
        }
        (self.cold[i].len, self.cold[i].coarse_neighbours) = (0, 0);
        self.grid.remove(i as u32, self.cold[i].cell);
        if PERIODIC {
            self.hot[i].position = self.container.wrap(self.hot[i].position);
        }
        self.cold[i].rebuilds = self.cold[i].rebuilds.saturating_add(1);
        if self.cold[i].rebuilds > 2 {
            self.cold[i].adapt_skin();
        }
        let most = self.grid.top_mm() - self.last_radius(i);
        self.cold[i].skin = self.cold[i].skin.min(most);
        self.center_sphere(i);
        let cutoff = self.cold[i].cutoff;
        let center = self.cold[i].center;
        self.cold[i].cell = self.grid.insert(i as u32, center, cutoff);
        let mut found = std::mem::take(&mut self.found);
        found.clear();
        self.grid.visit::<PERIODIC>(
            center,
            cutoff,
            self.growth.kappa,
            self.grid.all(),
            #[inline(always)]
            |j, image| {
                prefetch(&self.cold, j as usize);
                found.push(j | image << GRAIN_BITS);
            },
        );
        // By hand, for `retain` would not be compiled for the instruction set.
        let mut kept = 0;
        for at in 0..found.len() {
            let (j, image) = unpack(found[at]);
            if j != i && self.are_neighbours::<PERIODIC>(i, j, image as u32) {
                found[kept] = found[at];
                kept += 1;
            }
        }
        found.truncate(kept);
        for &entry in &found {
            self.prefetch_list(unpack(entry).0);
        }
        for &entry in &found {
            self.append(i, entry);
            self.append((entry & GRAIN_MASK) as usize, mirror(entry, i));
        }
        self.found = found;
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
        let place = |hot: &Hot| morton(self.container.wrap(hot.position).each(|x| x / longest));
        let mut order = collected(self.hot.iter().enumerate().map(|(i, hot)| (place(hot), i as u32)))?;
        order.sort_unstable();
        self.hot = collected(order.iter().map(|&(_, i)| self.hot[i as usize]))?;
        self.cold = collected(order.iter().map(|&(_, i)| self.cold[i as usize]))?;
        self.mass = collected(order.iter().map(|&(_, i)| self.mass[i as usize]))?;
        self.rank = collected(order.iter().map(|&(_, i)| self.rank[i as usize]))?;
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

/// Position on a Morton curve of 2^30 places, of a point in the unit cube.
fn morton(p: [f64; 3]) -> u32 {
    let mut key = 0;
    for (axis, x) in p.into_iter().enumerate() {
        let place = ((x * 1024.0) as u32).min(1023);
        for bit in 0..10 {
            key |= (place >> bit & 1) << (3 * bit + axis as u32);
        }
    }
    key
}

/// Where an entry stands in a list: sixteen comparisons at once.
#[inline(always)]
fn position(list: &[u32], entry: u32) -> Option<usize> {
    let mut from = 0;
    for chunk in list.chunks_exact(16) {
        if chunk.iter().fold(0, |found, &e| found | u32::from(e == entry)) != 0 {
            break;
        }
        from += 16;
    }
    list[from..].iter().position(|&e| e == entry).map(|at| from + at)
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
