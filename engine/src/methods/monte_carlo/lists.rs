//! Which grains can come close to which, until the lists are built again.
//!
//! Each grain may come out of its place by its skin (near-neighbour lists: Donev, Torquato and Stillinger 2005,
//! DOI 10.1016/j.jcp.2004.08.014), and the specimen may shrink by a factor. Two grains are neighbours unless some
//! direction shows a gap of the ellipsoids around them that both skins and the gap they keep do not use up: so lists
//! hold for other shapes at a site that lie in its ellipsoid. Candidates come from a grid of levels, a
//! factor of 1.6 of radius each.

use super::planes::{Decided, Group, LANES, MAX_GRAINS, WALL, normal};
use super::system::System;
use crate::arrays::Each as _;
use crate::elementary::{cbrt, hypot, ln};
use crate::gap::grain::{ConvexShape, Turned};
use crate::gap::linear::{Symmetric, Vector, dot, minus, norm, scaled, sum};
use crate::memory::{Blocks, OutOfMemory, refill};

/// Largest ratio of radii in a level.
const LEVEL_RATIO: f64 = 1.6;
/// Most cells of a level per grain of it.
const CELLS_PER_GRAIN: f64 = 2.0;
/// Iterations of the fixed point to find a direction that shows two grains to be no neighbours.
const DIRECTIONS: u32 = 2;

/// Grains of similar radius by cell.
#[derive(Clone, Debug, Default)]
struct Level {
    /// Largest reach of its grains: radius, skin and half the gap.
    reach: f64,
    counts: [usize; 3],
    edge: Vector,
    starts: Vec<u32>,
    grains: Vec<u32>,
}

/// Working memory of the build of neighbour lists. It is freed with the lists: pushes, which need as much memory, run
/// between two builds.
#[derive(Clone, Debug, Default)]
pub(super) struct Lists {
    levels: Vec<Level>,
    level_of: Vec<u8>,
    /// Each pair once, as the second grain with its image; those of the first grain `i` end before `ends[i]`. Their
    /// directions are found a second time: kept, they would take 24 bytes a pair.
    pairs: Blocks<u32>,
    ends: Vec<u32>,
    next: Vec<u32>,
    /// By how much the gaps may widen.
    reserve: f64,
}

impl Lists {
    /// Builds all lists for a specimen that shrinks by `shrink` at most, and gaps that widen by `reserve` at most.
    /// Skins are those of the grains.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn build(
        mut self,
        system: &mut System<impl ConvexShape>,
        shrink: f64,
        reserve: f64,
    ) -> Result<(), OutOfMemory> {
        self.reserve = reserve;
        debug_assert!(system.len() <= MAX_GRAINS);
        system.wrap();
        for (cold, hot) in system.cold.iter_mut().zip(&system.hot) {
            (cold.listed_center, cold.listed_orientation) = (hot.center, cold.orientation);
        }
        let largest = self.sort(system)?;
        system.name_images(2.0 * largest, shrink)?;
        self.find(system, shrink)?;
        (self.levels, self.level_of) = (Vec::new(), Vec::new());
        self.lay_out(system, shrink)
    }

    /// Sorts the grains into levels and cells; returns the largest reach.
    fn sort(&mut self, system: &System<impl ConvexShape>) -> Result<f64, OutOfMemory> {
        let n = system.len();
        refill(&mut self.level_of, n, 0)?;
        let largest = (0..n).map(|i| self.reach(system, i)).fold(0.0, f64::max);
        // Gaps of pairs may exceed the mean of the gaps to grains of their own size by this, of no rule that there is.
        let level = |reach: f64| (ln(largest / reach) / ln(LEVEL_RATIO)) as u8;
        let mut tops = Vec::new();
        for i in 0..n {
            let reach = self.reach(system, i);
            let number = level(reach);
            self.level_of[i] = number;
            if tops.len() <= usize::from(number) {
                tops.resize(usize::from(number) + 1, (0.0_f64, 0_usize));
            }
            let top = &mut tops[usize::from(number)];
            *top = (top.0.max(reach), top.1 + 1);
        }
        self.levels.resize_with(tops.len(), Level::default);
        let bounds = system.container.bounds.each(|length| length * system.stretch);
        for (number, (level, (reach, count))) in self.levels.iter_mut().zip(tops).enumerate() {
            let sparse = cbrt(bounds.iter().product::<f64>() / (CELLS_PER_GRAIN * count.max(1) as f64));
            let width = reach.max(sparse);
            level.reach = reach;
            level.counts = bounds.each(|length| ((length / width) as usize).max(1));
            level.edge = [0, 1, 2].each(|a| bounds[a] / level.counts[a] as f64);
            let cells = level.counts.iter().product::<usize>();
            refill(&mut level.starts, cells + 1, 0)?;
            refill(&mut level.grains, count, 0)?;
            let members = || (0..n).filter(|&i| usize::from(self.level_of[i]) == number);
            for i in members() {
                let cell = level.cell(system.hot[i].center);
                level.starts[cell + 1] += 1;
            }
            for cell in 0..cells {
                level.starts[cell + 1] += level.starts[cell];
            }
            refill(&mut self.next, cells, 0)?;
            self.next.copy_from_slice(&level.starts[..cells]);
            for i in members() {
                let next = &mut self.next[level.cell(system.hot[i].center)];
                level.grains[*next as usize] = i as u32;
                *next += 1;
            }
        }
        Ok(largest)
    }

    /// How far a grain reaches from its centre: radius, skin and half the gap.
    #[inline(always)]
    fn reach(&self, system: &System<impl ConvexShape>, i: usize) -> f64 {
        let (cold, d) = (&system.cold[i], system.hot[i].d);
        cold.shape.outer_mm() + cold.skin + (system.gap(d, d) + self.reserve) / 2.0
    }

    /// Finds the pairs: each grain looks at its own level and at the finer ones.
    fn find(&mut self, system: &System<impl ConvexShape>, shrink: f64) -> Result<(), OutOfMemory> {
        self.next = Vec::new();
        let mut pairs = Blocks::default();
        refill(&mut self.ends, system.len(), 0)?;
        let images = system.images.scaled(system.stretch);
        for i in 0..system.len() {
            let own = usize::from(self.level_of[i]);
            let (center, own_reach) = (system.hot[i].center, self.reach(system, i));
            for (number, level) in self.levels.iter().enumerate().skip(own) {
                // Distances are as they will be when the specimen has shrunk.
                let reach = (own_reach + level.reach) * shrink;
                for steps in images.boxes_met(center, [reach; 3]) {
                    let image = system.names.code(steps);
                    let shift = system.shift(image);
                    let seen_from = minus(center, shift);
                    let mut refused = None;
                    level.for_each_near(seen_from, reach, |j| {
                        let is_first = number > own || (j as usize) > i;
                        if !is_first || refused.is_some() {
                            return;
                        }
                        if self.direction(system, i, j as usize, shift, shrink).is_some() {
                            pairs.push(system.names.name(j as usize, image), &mut refused);
                        }
                    });
                    if let Some(refused) = refused {
                        return Err(refused);
                    }
                }
            }
            self.ends[i] = pairs.len() as u32;
        }
        self.pairs = pairs;
        Ok(())
    }

    /// Of two neighbours, a direction near that of their gap; `None` if they are none.
    #[inline(always)]
    fn direction<S: ConvexShape>(
        &self,
        system: &System<S>,
        i: usize,
        j: usize,
        shift: Vector,
        shrink: f64,
    ) -> Option<Vector> {
        let (one, other) = (&system.hot[i], &system.hot[j]);
        let r = sum(minus(other.center, one.center), shift);
        let gap = system.gap(one.d, other.d) + self.reserve;
        let skins = system.cold[i].skin + system.cold[j].skin + gap;
        let far = (system.cold[i].shape.outer_mm() + system.cold[j].shape.outer_mm() + skins) * shrink;
        let r2 = dot(r, r);
        if r2 >= far * far {
            return None;
        }
        if one.turned.is_sphere() && other.turned.is_sphere() {
            return Some(scaled(r, 1.0 / r2.sqrt()));
        }
        let per_shrink = 1.0 / shrink;
        let (a, b) = (one.turned.around(), other.turned.around());
        let (mut n, mut h_a, mut h_b) = (r, a.quadratic(r).sqrt(), b.quadratic(r).sqrt());
        let mut best = (f64::NEG_INFINITY, r);
        for step in 0..=DIRECTIONS {
            if step > 0 {
                n = Symmetric::blend(&a, &b, h_a / (h_a + h_b)).solve(r);
                (h_a, h_b) = (a.quadratic(n).sqrt(), b.quadratic(n).sqrt());
            }
            let inverse = 1.0 / norm(n);
            let along = dot(r, n);
            if (along * per_shrink - h_a - h_b) * inverse >= skins {
                return None;
            }
            let s = (along - h_a - h_b) * inverse;
            if s > best.0 {
                best = (s, scaled(n, inverse));
            }
        }
        Some(best.1)
    }

    /// Lays the planes of all pairs and walls out in groups, and between the grains.
    fn lay_out(&mut self, system: &mut System<impl ConvexShape>, shrink: f64) -> Result<(), OutOfMemory> {
        let n = system.len();
        refill(&mut self.next, n, 0)?;
        let mut first = 0;
        for (i, &end) in self.ends.iter().enumerate() {
            self.next[i] += end - first;
            first = end;
        }
        for &pair in self.pairs.iter() {
            self.next[system.names.read(pair).0] += 1;
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
            for wall in system.container.walls().filter(|wall| walls >> wall & 1 == 1) {
                let at = self.next[i] as usize;
                self.next[i] += 1;
                system.groups[at / LANES].neighbors[at % LANES] = WALL + wall;
                system.lay_wall(i, at / LANES, at % LANES, system.hot[i].d);
            }
            let reach = self.reach(system, i) * shrink;
            let (is_near_lateral, is_near_itself) = is_special(system, i, reach, shrink, self.reserve);
            system.cold[i].list.mark_near(is_near_lateral, is_near_itself);
        }
        let pairs = std::mem::take(&mut self.pairs);
        let mut pairs = pairs.iter();
        let mut first = 0;
        for i in 0..n {
            for &pair in pairs.by_ref().take((self.ends[i] - first) as usize) {
                self.lay_pair(system, i, pair, shrink);
            }
            first = self.ends[i];
        }
        Ok(())
    }

    /// Enters a pair with both grains and lays its first planes.
    fn lay_pair(&mut self, system: &mut System<impl ConvexShape>, i: usize, neighbor: u32, shrink: f64) {
        let (j, image) = system.names.read(neighbor);
        let Some(n) = self.direction(system, i, j, system.shift(image), shrink) else { return };
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
        let mirrored = system.names.name(i, system.names.opposite(image));
        put(mirror, mirrored, i, at);
        system.lay_first(i, at, n);
    }
}

impl Level {
    #[inline(always)]
    fn index(&self, axis: usize, x: f64) -> usize {
        ((x / self.edge[axis]).max(0.0) as usize).min(self.counts[axis] - 1)
    }

    #[inline(always)]
    fn cell(&self, p: Vector) -> usize {
        let [x, y, z] = [0, 1, 2].each(|a| self.index(a, p[a]));
        (z * self.counts[1] + y) * self.counts[0] + x
    }

    /// Calls `visit` with every grain of a centre within `reach` of a point along each axis, and some beyond.
    #[inline(always)]
    fn for_each_near(&self, center: Vector, reach: f64, mut visit: impl FnMut(u32)) {
        let span = |a: usize| self.index(a, center[a] - reach)..self.index(a, center[a] + reach) + 1;
        let (xs, ys) = (span(0), span(1));
        for z in span(2) {
            for y in ys.clone() {
                let row = (z * self.counts[1] + y) * self.counts[0];
                let range = self.starts[row + xs.start] as usize..self.starts[row + xs.end] as usize;
                self.grains[range].iter().for_each(|&j| visit(j));
            }
        }
    }
}

/// The plane walls that a grain can come close to, as bits.
fn walls(system: &System<impl ConvexShape>, i: usize, shrink: f64, reserve: f64) -> u32 {
    let (hot, cold) = (&system.hot[i], &system.cold[i]);
    let mut walls = 0;
    for wall in system.container.walls() {
        let (normal, offset) = system.container.wall(wall);
        let half = system.hot[i].turned.around().quadratic(normal).sqrt();
        // As it will be when the specimen has shrunk.
        let reach = (half + cold.skin + system.wall_gap(hot.d) + reserve) * shrink;
        walls |= u32::from(dot(hot.center, normal) - offset * system.stretch < reach) << wall;
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
    let is_near_lateral = system.container.lateral.is_some_and(|radius| {
        let axis = radius * system.stretch;
        let far = hypot(hot.center[0] - axis, hot.center[1] - axis);
        far + (cold.shape.outer_mm() + cold.skin + system.wall_gap(hot.d) + reserve) * shrink >= axis
    });
    let shortest = system.container.bounds.into_iter().fold(f64::INFINITY, f64::min) * system.stretch;
    (is_near_lateral, system.container.is_periodic && 2.0 * reach >= shortest)
}

impl<S: ConvexShape> System<S> {
    /// The plane of a wall that a grain of this diameter stays behind: its outward normal and offset.
    pub(super) fn wall_plane(&self, wall: u32, d: f64) -> (Vector, f64) {
        let (inward, offset) = self.container.wall(wall);
        (inward.each(|x| -x), -offset * self.stretch - self.wall_gap(d))
    }

    /// Lays the first planes between two neighbours, along a direction near that of their gap.
    fn lay_first(&mut self, i: usize, at: usize, n: Vector) {
        let (group, lane) = (at / LANES, at % LANES);
        self.groups[group].set(lane, normal(n), 0.0);
        let hot = self.hot[i];
        match self.decide(i, &hot, group, lane) {
            Decided::Apart(planes) => self.lay(&planes),
            Decided::TooClose(n) => self.lay_between(i, group, lane, n),
        }
    }
}
