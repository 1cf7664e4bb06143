//! Monte Carlo swap moves of grains of similar size (Berthier, Coslovich, Ninarello and Ozawa 2016,
//! DOI 10.1103/PhysRevLett.116.238002).
//!
//! Two sites exchange their shapes, each site keeping its centre and orientation, where both shapes fit. Near jamming,
//! where grains hardly move, this is what still lets sizes and voids find each other.

use rand_xoshiro::Xoshiro256PlusPlus;

use super::planes::{LANES, NOBODY, is_wall};
use super::shake::{Pending, fits};
use super::system::{Hot, System, shape_matrix};
use crate::cpu::{InstructionSet, prefetch, with_instruction_set};
use crate::gap::linear::Vector;
use crate::memory::{OutOfMemory, make_room, refill};
use crate::rng::uniform;
use crate::shape::Ellipsoid;

/// Share of accepted swaps that the window of sizes is steered to.
const ACCEPTED_AIM: f64 = 0.3;
const LEAST_WINDOW: f64 = 1e-7;
const MOST_WINDOW: f64 = 0.3;
/// Share of the skin that a larger grain may take.
const SKIN_SHARE: f64 = 0.5;

/// Pairs that are drawn ahead.
const AHEAD: usize = 8;

/// What a swap needs to know beside the grains.
#[derive(Clone, Debug)]
pub(super) struct Swaps {
    /// Where the grain of each rank is.
    site: Vec<u32>,
    /// The lowest rank that each rank may change places with.
    limit: Vec<u32>,
    /// Largest relative difference of two diameters that is tried.
    pub(super) window: f64,
    pub(super) tried: u64,
    pub(super) accepted: u64,
}

impl Swaps {
    pub(super) fn new(window: f64) -> Self {
        Self { site: Vec::new(), limit: Vec::new(), window, tried: 0, accepted: 0 }
    }

    /// Tries so many swaps.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn sweep(
        &mut self,
        system: &mut System,
        shapes: &[Ellipsoid],
        diameters: &[f64],
        tries: u64,
        rng: &mut Xoshiro256PlusPlus,
    ) -> Result<(), OutOfMemory> {
        let n = system.len();
        if n < 2 {
            return Ok(());
        }
        refill(&mut self.site, n, 0)?;
        for (site, &rank) in system.rank.iter().enumerate() {
            self.site[rank as usize] = site as u32;
        }
        self.limit.clear();
        make_room(&mut self.limit, n)?;
        let mut largest = 0;
        for &d in diameters {
            while diameters[largest] > d * (1.0 + self.window) {
                largest += 1;
            }
            self.limit.push(largest as u32);
        }
        let cpu = system.cpu;
        let (tried, accepted) = with_instruction_set!(cpu, set => set.call(
            #[inline(always)]
            || self.try_pairs(set, system, shapes, tries, rng)
        ));
        self.tried += tried;
        self.accepted += accepted;
        if tried >= 20 {
            let share = accepted as f64 / tried as f64;
            let factor = if share < ACCEPTED_AIM { 0.7 } else { 1.3 };
            self.window = (self.window * factor).clamp(LEAST_WINDOW, MOST_WINDOW);
        }
        Ok(())
    }

    /// Tries so many pairs; returns how many had different shapes, and how many of these were exchanged.
    #[inline(always)]
    fn try_pairs<S: InstructionSet>(
        &mut self,
        set: S,
        system: &mut System,
        shapes: &[Ellipsoid],
        tries: u64,
        rng: &mut Xoshiro256PlusPlus,
    ) -> (u64, u64) {
        let n = system.len();
        let (mut tried, mut accepted) = (0, 0);
        let mut left = tries;
        while left > 0 {
            let count = left.min(AHEAD as u64) as usize;
            left -= count as u64;
            // Pairs are drawn ahead, so that the cache misses behind them overlap.
            let mut pairs = [[0_usize; 2]; AHEAD];
            for pair in &mut pairs[..count] {
                let smaller = (uniform(rng) * n as f64) as usize;
                let largest = self.limit[smaller] as usize;
                let larger = largest + (uniform(rng) * (smaller - largest) as f64) as usize;
                *pair = [larger, smaller];
                for rank in *pair {
                    let site = self.site[rank] as usize;
                    prefetch(&system.hot, site);
                    prefetch(&system.cold, site);
                }
            }
            for pair in &pairs[..count] {
                let cold = &system.cold[self.site[pair[1]] as usize];
                for group in 0..cold.count as usize {
                    prefetch(&system.groups, cold.first as usize + group);
                }
            }
            for &[larger, smaller] in &pairs[..count] {
                if larger == smaller || shapes[larger] == shapes[smaller] {
                    continue;
                }
                tried += 1;
                let (i, j) = (self.site[larger] as usize, self.site[smaller] as usize);
                if swap(set, system, i, j) {
                    self.site.swap(larger, smaller);
                    accepted += 1;
                }
            }
        }
        (tried, accepted)
    }
}

/// The site as it would be with another shape: how much longer its semi-axes are at most, and how much closer it may
/// come to its planes for its gaps.
struct Changed {
    as_if: Hot,
    semi_axes: Vector,
    longer: f64,
    more: f64,
}

#[inline(always)]
fn changed(system: &System, site: usize, from: usize) -> Changed {
    let (old, new) = (&system.cold[site], &system.cold[from]);
    let (d_old, d_new) = (system.hot[site].d, system.hot[from].d);
    let longer = [0, 1, 2].map(|a| new.semi_axes[a] - old.semi_axes[a]).into_iter().fold(0.0, f64::max);
    let matrix = shape_matrix(old.orientation, new.semi_axes);
    let as_if = Hot { center: system.hot[site].center, matrix, d: d_new };
    Changed { as_if, semi_axes: new.semi_axes, longer, more: system.more_gap(d_old, d_new) }
}

/// Lets the shapes of two sites change places if they fit; the larger one is at the first site.
#[inline(always)]
fn swap<S: InstructionSet>(set: S, system: &mut System, i: usize, j: usize) -> bool {
    let at_j = changed(system, j, i);
    let mut planes_j = Pending::new();
    if at_j.longer + at_j.more > SKIN_SHARE * system.cold[j].skin
        || !fits(set, system, j, &at_j.as_if, at_j.more, &mut planes_j)
    {
        return false;
    }
    let at_i = changed(system, i, j);
    let mut planes_i = Pending::new();
    if at_i.longer + at_i.more > SKIN_SHARE * system.cold[i].skin
        || !fits(set, system, i, &at_i.as_if, at_i.more, &mut planes_i)
    {
        return false;
    }
    // Each fits beside the other as it was.
    if are_neighbors(system, i, j) {
        return false;
    }
    for (site, change) in [(j, &at_j), (i, &at_i)] {
        system.come_closer(site, change.more, change.as_if.d);
        system.hot[site] = change.as_if;
        let cold = &mut system.cold[site];
        cold.semi_axes = change.semi_axes;
        cold.skin -= change.longer + change.more;
    }
    planes_j.lay(system);
    planes_i.lay(system);
    let (step_i, step_j) = (system.cold[i].step, system.cold[j].step);
    (system.cold[i].step, system.cold[j].step) = (step_j, step_i);
    system.rank.swap(i, j);
    true
}

/// Whether two sites are in each other's lists.
fn are_neighbors(system: &System, i: usize, j: usize) -> bool {
    let cold = &system.cold[i];
    let groups = &system.groups[cold.first as usize..(cold.first + cold.count) as usize];
    groups
        .iter()
        .flat_map(|group| group.neighbors)
        .any(|neighbor| neighbor != NOBODY && !is_wall(neighbor) && super::planes::unpack(neighbor).0 == j)
}

impl System {
    /// The most by which a gap of a grain grows when its diameter changes.
    #[inline(always)]
    fn more_gap(&self, d_old: f64, d_new: f64) -> f64 {
        let to_itself = self.gap(d_new, d_new) - self.gap(d_old, d_old);
        let to_walls = self.wall_gap(d_new) - self.wall_gap(d_old);
        to_itself.max(to_walls).max(0.0)
    }

    /// Brings the planes of a grain, but not those of its neighbours, closer to it, for the gaps of its new diameter.
    fn come_closer(&mut self, i: usize, more: f64, d: f64) {
        let cold = &self.cold[i];
        for group in cold.first as usize..(cold.first + cold.count) as usize {
            for lane in 0..LANES {
                let neighbor = self.groups[group].neighbors[lane];
                if neighbor != NOBODY && is_wall(neighbor) {
                    let (normal, o) = self.wall_plane(neighbor - super::planes::WALL, d);
                    self.groups[group].set(lane, normal, o);
                } else {
                    self.groups[group].o[lane] -= more;
                }
            }
        }
    }
}
