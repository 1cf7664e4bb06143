//! The planes of all neighbours, as the build of lists lays them out.
//!
//! The list of a grain has its walls, then the pairs in which other grains found it before its turn, then those that it
//! found, and then the others. Only the numbers of pairs are counted and entered by one thread; the first planes of the
//! pairs that the grains of a leaf found are laid by one of several.

use std::ops::Range;

use super::group::{Group, LANES, Pair, WALL};
use super::lists::Lists;
use super::planes::{Decided, NewPlanes};
use super::system::{Part, System};
use super::window::Window;
use crate::arrays::Each as _;
use crate::elementary::hypot;
use crate::gap::grain::{ConvexShape, Turned};
use crate::gap::linear::{Vector, dot};
use crate::memory::{Blocks, OutOfMemory, refill, reserved};
use crate::threads::share;

/// The planes of the grains of a leaf.
struct Laid<'a> {
    sites: Range<usize>,
    groups: Window<'a, Group>,
    /// The ranges that the grains belong to, where there are several.
    ranges: &'a mut [u16],
    /// Planes whose second one lies in another leaf.
    elsewhere: Blocks<NewPlanes>,
    far: Blocks<FarPair>,
    refused: Option<OutOfMemory>,
}

/// A pair that one grain lists so far back that its place has to be looked for, with a direction near that of its gap.
#[derive(Clone, Copy)]
struct FarPair {
    grain: u32,
    pair: Pair,
    n: Vector,
}

impl Lists {
    /// Lays the planes of all pairs and walls out in groups, and between the grains.
    pub(super) fn lay_out(
        &mut self,
        system: &mut System<impl ConvexShape>,
        shrink: f64,
    ) -> Result<(), OutOfMemory> {
        self.lay_out_groups(system, shrink)?;
        let own = self.enter_pairs(system)?;
        self.pairs = Vec::new();
        self.lay_pairs(system, &own, shrink)
    }

    /// Makes the groups of all grains, with their walls. `next` is where the next plane of a grain goes.
    fn lay_out_groups(
        &mut self,
        system: &mut System<impl ConvexShape>,
        shrink: f64,
    ) -> Result<(), OutOfMemory> {
        let n = system.len();
        refill(&mut self.next, n, 0)?;
        for leaf in 0..system.halves.leaves() {
            let (first, count) = system.halves.leaf(leaf);
            let mut earlier = 0;
            for i in first..first + count {
                self.next[i] += self.ends[i] - earlier;
                earlier = self.ends[i];
            }
        }
        for &pair in self.pairs.iter().flat_map(Blocks::iter) {
            self.next[system.frame.names.read(pair).0] += 1;
        }
        let mut total = 0_usize;
        for i in 0..n {
            let walls = walls(system, i, shrink, self.reserve);
            let lanes = self.next[i] as usize + walls.count_ones() as usize;
            let count = lanes.div_ceil(LANES);
            system.cold[i].list.set_groups(total, count);
            self.next[i] = (LANES * total) as u32;
            total += count;
        }
        system.groups = {
            let mut groups = std::mem::take(&mut system.groups);
            refill(&mut groups, total, Group::EMPTY)?;
            groups
        };
        for i in 0..n {
            let walls = walls(system, i, shrink, self.reserve);
            for wall in system.frame.container.walls().filter(|wall| walls >> wall & 1 == 1) {
                let at = self.next[i] as usize;
                self.next[i] += 1;
                system.groups[at / LANES].neighbors[at % LANES] = WALL + wall;
                let d = system.hot[i].d;
                system.part().lay_wall(i, at / LANES, at % LANES, d);
            }
            let reach = self.reach(system, i) * shrink;
            let (is_near_lateral, is_near_itself) = is_special(system, i, reach, shrink, self.reserve);
            system.cold[i].list.mark_near(is_near_lateral, is_near_itself);
        }
        Ok(())
    }

    /// Enters each pair with both grains. Returns where the planes of the pairs begin that each grain found.
    fn enter_pairs(&mut self, system: &mut System<impl ConvexShape>) -> Result<Vec<u32>, OutOfMemory> {
        let mut own = reserved(system.len())?;
        for (leaf, pairs) in self.pairs.iter().enumerate() {
            let (first, count) = system.halves.leaf(leaf);
            let (mut pairs, mut earlier) = (pairs.iter(), 0);
            for i in first..first + count {
                own.push(self.next[i]);
                for &neighbor in pairs.by_ref().take((self.ends[i] - earlier) as usize) {
                    let (j, image) = system.frame.names.read(neighbor);
                    let [at, mirror] = [i, j].each(|grain| {
                        let at = self.next[grain] as usize;
                        self.next[grain] += 1;
                        at
                    });
                    let mut put = |at: usize, neighbor: u32, of: usize, mirror: usize| {
                        let place = mirror - LANES * system.cold[of].list.first as usize;
                        system.groups[at / LANES].enter(at % LANES, neighbor, place);
                    };
                    put(at, neighbor, j, mirror);
                    let names = &system.frame.names;
                    put(mirror, names.name(i, names.opposite(image)), i, at);
                }
                earlier = self.ends[i];
            }
        }
        Ok(own)
    }

    /// Lays the first planes of all pairs, those that the grains of each leaf found on one of the threads, and finds
    /// the ranges that the grains belong to.
    fn lay_pairs(
        &self,
        system: &mut System<impl ConvexShape>,
        own: &[u32],
        shrink: f64,
    ) -> Result<(), OutOfMemory> {
        let (threads, leaves) = (system.threads, system.halves.leaves());
        let mut groups = std::mem::take(&mut system.groups);
        let mut ranges = system.halves.begin_ranges()?;
        let all = system.part();
        let mut pieces: Vec<Laid<'_>> = reserved(leaves)?;
        let (mut left, mut ranges_left) = (Window::whole(&mut groups), ranges.as_mut_slice());
        for leaf in 0..leaves {
            let (first, count) = all.halves.leaf(leaf);
            let end =
                if leaf + 1 < leaves { all.cold[first + count].list.first as usize } else { usize::MAX };
            let [groups, others] = left.cut(end);
            let (ranges, ranges_above) = ranges_left.split_at_mut(count.min(ranges_left.len()));
            (left, ranges_left) = (others, ranges_above);
            pieces.push(Laid {
                sites: first..first + count,
                groups,
                ranges,
                elsewhere: Blocks::default(),
                far: Blocks::default(),
                refused: None,
            });
        }
        share(threads, &mut pieces, |_, piece| self.lay_pairs_of(&all, piece, own, shrink));
        let mut elsewhere: Vec<(Blocks<NewPlanes>, Blocks<FarPair>)> = reserved(leaves)?;
        for Laid { elsewhere: planes, far, refused, .. } in pieces {
            refused.map_or(Ok(()), Err)?;
            elsewhere.push((planes, far));
        }
        system.halves.end_ranges(ranges)?;
        system.groups = groups;
        let mut all = system.part();
        for (planes, far) in &elsewhere {
            for planes in planes.iter() {
                planes.lay(&mut all.groups, planes.mirror);
            }
            for &FarPair { grain, pair, n } in far.iter() {
                let planes = all.first_planes(grain as usize, pair, n);
                all.lay(&planes);
            }
        }
        Ok(())
    }

    fn lay_pairs_of(&self, all: &Part<'_, impl ConvexShape>, piece: &mut Laid<'_>, own: &[u32], shrink: f64) {
        let sites = piece.sites.clone();
        let mut earlier = 0;
        for i in sites.clone() {
            let first = own[i] as usize;
            let count = (self.ends[i] - std::mem::replace(&mut earlier, self.ends[i])) as usize;
            for at in first..first + count {
                let pair = piece.groups[at / LANES].pair(at / LANES, at % LANES);
                let (j, image) = all.frame.names.read(pair.neighbor);
                let ends = [i, j].map(|i| (&all.hot[i], &all.cold[i]));
                let Some(n) = self.direction(all.frame, ends, all.frame.shift(image), shrink) else {
                    continue;
                };
                if pair.is_far() {
                    piece.far.push(FarPair { grain: i as u32, pair, n }, &mut piece.refused);
                    continue;
                }
                let planes = all.first_planes(i, pair, n);
                planes.lay(&mut piece.groups, planes.at);
                if sites.contains(&j) {
                    planes.lay(&mut piece.groups, planes.mirror);
                } else {
                    piece.elsewhere.push(planes, &mut piece.refused);
                }
            }
        }
        for (i, range) in sites.clone().zip(&mut *piece.ranges) {
            let leaf = all.halves.leaf_of(sites.start);
            let mut leaves = [leaf; 2];
            for group in &piece.groups[all.cold[i].list.groups()] {
                for neighbor in group.neighbors.into_iter().filter(|&neighbor| neighbor < WALL) {
                    let (j, _) = all.frame.names.read(neighbor);
                    if !sites.contains(&j) {
                        let leaf = all.halves.leaf_of(j);
                        leaves = [leaves[0].min(leaf), leaves[1].max(leaf)];
                    }
                }
            }
            *range = all.halves.smallest(leaves) as u16;
        }
    }
}

/// The plane walls that a grain can come close to, as bits.
fn walls(system: &System<impl ConvexShape>, i: usize, shrink: f64, reserve: f64) -> u32 {
    let (hot, cold) = (&system.hot[i], &system.cold[i]);
    let mut walls = 0;
    for wall in system.frame.container.walls() {
        let (normal, offset) = system.frame.container.wall(wall);
        let half = system.hot[i].turned.around().quadratic(normal).sqrt();
        // As it will be when the specimen has shrunk.
        let reach = (half + cold.skin + system.frame.wall_gap(hot.d) + reserve) * shrink;
        walls |= u32::from(dot(hot.center, normal) - offset * system.frame.stretch < reach) << wall;
    }
    walls
}

/// Whether a grain can come close to the lateral surface of a cylinder, and to an image of its own.
fn is_special(
    system: &System<impl ConvexShape>,
    i: usize,
    reach: f64,
    shrink: f64,
    reserve: f64,
) -> (bool, bool) {
    let (hot, cold) = (&system.hot[i], &system.cold[i]);
    let is_near_lateral = system.frame.container.lateral.is_some_and(|radius| {
        let axis = radius * system.frame.stretch;
        let far = hypot(hot.center[0] - axis, hot.center[1] - axis);
        far + (cold.shape.outer_mm() + cold.skin + system.frame.wall_gap(hot.d) + reserve) * shrink >= axis
    });
    let shortest =
        system.frame.container.bounds.into_iter().fold(f64::INFINITY, f64::min) * system.frame.stretch;
    (is_near_lateral, system.frame.container.is_periodic && 2.0 * reach >= shortest)
}

impl<S: ConvexShape> Part<'_, S> {
    /// The first planes between two neighbours, along a direction near that of their gap.
    fn first_planes(&self, i: usize, pair: Pair, n: Vector) -> NewPlanes {
        match self.decide_pair(i, &self.hot[i], pair.along(n)) {
            Decided::Apart(planes) => planes,
            Decided::TooClose(n) => self.planes_along(i, pair, n),
        }
    }
}
