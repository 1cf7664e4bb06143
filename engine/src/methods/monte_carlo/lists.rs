//! Which grains can come close to which, until the lists are built again.
//!
//! Each grain may come out of its place by its skin (near-neighbour lists: Donev, Torquato and Stillinger 2005,
//! DOI 10.1016/j.jcp.2004.08.014), and the specimen may shrink by a factor. Two grains are neighbours unless some
//! direction shows a gap of the ellipsoids around them that both skins and the gap they keep do not use up: so lists
//! hold for other shapes at a site that lie in its ellipsoid. Candidates come from a grid of levels, a
//! factor of 1.6 of radius each.

use super::group::MAX_GRAINS;
use super::system::{Cold, Frame, Hot, System};
use crate::arrays::Each as _;
use crate::elementary::{cbrt, ln};
use crate::gap::grain::{ConvexShape, Turned};
use crate::gap::linear::{Symmetric, Vector, dot, minus, norm, scaled, sum};
use crate::memory::{Blocks, OutOfMemory, refill, reserved};
use crate::threads::share;

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
    /// Each pair once, as the second grain with its image, by the leaf of the first one; those of the first grain `i`
    /// end before `ends[i]` there. Their directions are found a second time: kept, they would take 24 bytes a pair.
    pub(super) pairs: Vec<Blocks<u32>>,
    pub(super) ends: Vec<u32>,
    pub(super) next: Vec<u32>,
    /// By how much the gaps may widen.
    pub(super) reserve: f64,
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
        let bounds = system.frame.container.bounds.each(|length| length * system.frame.stretch);
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
    pub(super) fn reach(&self, system: &System<impl ConvexShape>, i: usize) -> f64 {
        let (cold, d) = (&system.cold[i], system.hot[i].d);
        cold.shape.outer_mm() + cold.skin + (system.frame.gap(d, d) + self.reserve) / 2.0
    }

    /// Finds the pairs, those of the grains of each leaf on one of the threads.
    fn find(&mut self, system: &System<impl ConvexShape>, shrink: f64) -> Result<(), OutOfMemory> {
        self.next = Vec::new();
        let mut ends = std::mem::take(&mut self.ends);
        refill(&mut ends, system.len(), 0)?;
        let mut pieces: Vec<Found<'_>> = reserved(system.halves.leaves())?;
        let mut left = ends.as_mut_slice();
        for leaf in 0..system.halves.leaves() {
            let (first, count) = system.halves.leaf(leaf);
            let (ends, others) = left.split_at_mut(count);
            left = others;
            pieces.push(Found { first, ends, pairs: Blocks::default(), refused: None });
        }
        share(system.threads, &mut pieces, |_, piece| self.find_of(system, piece, shrink));
        for Found { pairs, refused, .. } in pieces {
            refused.map_or(Ok(()), Err)?;
            self.pairs.push(pairs);
        }
        self.ends = ends;
        Ok(())
    }

    /// Finds the pairs of the grains of a leaf: each grain looks at its own level and at the finer ones.
    fn find_of(&self, system: &System<impl ConvexShape>, piece: &mut Found<'_>, shrink: f64) {
        let images = system.frame.images.scaled(system.frame.stretch);
        for (i, end) in (piece.first..).zip(&mut *piece.ends) {
            let own = usize::from(self.level_of[i]);
            let (center, own_reach) = (system.hot[i].center, self.reach(system, i));
            for (number, level) in self.levels.iter().enumerate().skip(own) {
                // Distances are as they will be when the specimen has shrunk.
                let reach = (own_reach + level.reach) * shrink;
                for steps in images.boxes_met(center, [reach; 3]) {
                    let image = system.frame.names.code(steps);
                    let shift = system.frame.shift(image);
                    let seen_from = minus(center, shift);
                    level.for_each_near(seen_from, reach, |j| {
                        let is_first = number > own || (j as usize) > i;
                        if !is_first || piece.refused.is_some() {
                            return;
                        }
                        let ends = [i, j as usize].map(|i| (&system.hot[i], &system.cold[i]));
                        if self.direction(&system.frame, ends, shift, shrink).is_some() {
                            let name = system.frame.names.name(j as usize, image);
                            piece.pairs.push(name, &mut piece.refused);
                        }
                    });
                    if piece.refused.is_some() {
                        return;
                    }
                }
            }
            *end = piece.pairs.len() as u32;
        }
    }

    /// Of two neighbours, a direction near that of their gap; `None` if they are none.
    #[inline(always)]
    pub(super) fn direction<S: ConvexShape>(
        &self,
        frame: &Frame,
        [(one, cold), (other, other_cold)]: [Grain<'_, S>; 2],
        shift: Vector,
        shrink: f64,
    ) -> Option<Vector> {
        let r = sum(minus(other.center, one.center), shift);
        let gap = frame.gap(one.d, other.d) + self.reserve;
        let skins = cold.skin + other_cold.skin + gap;
        let far = (cold.shape.outer_mm() + other_cold.shape.outer_mm() + skins) * shrink;
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
}

/// A grain, as lists know it.
pub(super) type Grain<'a, S> = (&'a Hot<<S as ConvexShape>::Turned>, &'a Cold<S>);

/// The pairs of the grains of a leaf.
struct Found<'a> {
    first: usize,
    /// As in [`Lists`].
    ends: &'a mut [u32],
    pairs: Blocks<u32>,
    refused: Option<OutOfMemory>,
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
