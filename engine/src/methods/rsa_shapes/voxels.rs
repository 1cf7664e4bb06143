//! What may be left for centres: voxels that no single exclusion ellipsoid covers.
//!
//! A point drawn uniformly from the voxels and kept if it is free is uniform in the free space, for the voxels always
//! hold all of it. Which voxels are dropped or split depends on failed draws alone, so that the law of accepted points
//! stays.

use std::num::NonZeroUsize;

use rand::rand_core::Rng;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::grid::{Grid, Inserted};
use crate::arrays::{self, Each as _};
use crate::domain::Region;
use crate::gap::grain::Turned;
use crate::gap::linear::{Vector, norm};
use crate::memory::{OutOfMemory, collected, make_room};
use crate::rng::uniform;
use crate::threads::share;

/// Deepest level: a cell's edge over 2^20. What is left there counts as a voxel for good.
const MOST_LEVELS: usize = 20;
/// Cells that a thread takes at once.
const CELLS_PER_PIECE: usize = 4096;

/// A voxel of some level: its cell, and its place in the cell in units of its own edge.
#[derive(Clone, Copy, Debug)]
struct Voxel {
    cell: u32,
    at: [u32; 3],
}

/// The voxels of a level, each as one number: its place in the cell below its cell, in as many words as the largest of
/// them needs. There are tens of voxels per grain, nearly all of them of levels that need one word.
#[derive(Debug)]
struct VoxelList {
    level: u32,
    words_each: usize,
    words: Vec<u32>,
    len: usize,
}

impl VoxelList {
    fn new(level: usize, cells: usize) -> Self {
        let bits = usize::BITS - cells.saturating_sub(1).leading_zeros() + 3 * level as u32;
        let words_each = bits.div_ceil(u32::BITS).max(1) as usize;
        Self { level: level as u32, words_each, words: Vec::new(), len: 0 }
    }

    #[inline(always)]
    fn get(&self, index: usize) -> Voxel {
        let words = &self.words[index * self.words_each..][..self.words_each];
        let number = words.iter().rev().fold(0_u128, |number, &word| number << u32::BITS | u128::from(word));
        let mask = (1_u32 << self.level) - 1;
        Voxel {
            cell: (number >> (3 * self.level)) as u32,
            at: [0, 1, 2].each(|axis| (number >> (axis * self.level)) as u32 & mask),
        }
    }

    fn push(&mut self, voxel: Voxel) -> Result<(), OutOfMemory> {
        make_room(&mut self.words, self.words_each)?;
        let axes = [voxel.at[0], voxel.at[1], voxel.at[2], voxel.cell];
        let number = axes.iter().rev().fold(0_u128, |number, &x| number << self.level | u128::from(x));
        let words = (0..self.words_each).map(|word| (number >> (word * 32)) as u32);
        self.words.extend(words);
        self.len += 1;
        Ok(())
    }

    fn append(&mut self, more: Self) -> Result<(), OutOfMemory> {
        make_room(&mut self.words, more.words.len())?;
        self.words.extend(more.words);
        self.len += more.len;
        Ok(())
    }

    /// Takes a voxel out; the last one comes to its place.
    fn swap_remove(&mut self, index: usize) {
        let last = self.words.len() - self.words_each;
        self.words.copy_within(last.., index * self.words_each);
        self.words.truncate(last);
        self.len -= 1;
    }
}

/// A point that was drawn, and where.
#[derive(Clone, Copy, Debug)]
pub(super) struct Draw {
    point: Vector,
    pub(super) cell: usize,
    level: usize,
    index: usize,
    center: Vector,
    half: Vector,
    radius_mm: f64,
}

impl Draw {
    /// The point, or where the region has one coordinate only along an axis, which no draw meets, the one at it, if it
    /// is a point of the voxel.
    pub(super) fn point_in(&self, region: &Region) -> Vector {
        let coordinate = |axis: usize| {
            let only = region.low[axis];
            let is_met = (only - self.center[axis]).abs() <= self.half[axis];
            if only == region.high[axis] && is_met { only } else { self.point[axis] }
        };
        arrays::from_fn(coordinate)
    }
}

/// The voxels of a stage by level.
#[derive(Debug)]
pub(super) struct Voxels {
    levels: Vec<VoxelList>,
    region: Region,
    cell_mm3: f64,
}

impl Voxels {
    /// All of the region that is not covered, down to a level of subdivision. Threads share the cells.
    pub(super) fn new(
        region: &Region,
        level: usize,
        grid: &Grid,
        inserted: &[Inserted<impl Turned>],
        (threads, tested): (NonZeroUsize, &mut u64),
    ) -> Result<Self, OutOfMemory> {
        let cells = grid.counts.iter().product::<usize>();
        let empty = || Self {
            levels: (0..=MOST_LEVELS).map(|level| VoxelList::new(level, cells)).collect(),
            region: *region,
            cell_mm3: grid.edge.iter().product(),
        };
        let pieces = if threads == NonZeroUsize::MIN { 1 } else { cells.div_ceil(CELLS_PER_PIECE).max(1) };
        let end = |piece: usize| cells * piece / pieces;
        let mut parts = collected((0..pieces).map(|_| (empty(), 0, Ok(()))))?;
        share(threads, &mut parts, |piece, (voxels, tested, done)| {
            *done = (end(piece)..end(piece + 1)).try_for_each(|cell| {
                voxels.keep(Voxel { cell: cell as u32, at: [0; 3] }, 0, level, grid, inserted, tested)
            });
        });
        let mut parts = parts.into_iter();
        let mut voxels = empty();
        if let Some((first, count, done)) = parts.next() {
            done?;
            voxels = first;
            *tested += count;
        }
        for (part, count, done) in parts {
            done?;
            *tested += count;
            for (list, more) in voxels.levels.iter_mut().zip(part.levels) {
                list.append(more)?;
            }
        }
        Ok(voxels)
    }

    /// Keeps what is left of a voxel at a level of subdivision, in voxels of a deeper one.
    fn keep(
        &mut self,
        voxel: Voxel,
        level: usize,
        upto: usize,
        grid: &Grid,
        inserted: &[Inserted<impl Turned>],
        tested: &mut u64,
    ) -> Result<(), OutOfMemory> {
        let (corner, edge) = place(&voxel, level, grid);
        let half = edge.each(|e| e / 2.0);
        let center = arrays::from_fn(|a| corner[a] + half[a]);
        *tested += 1;
        if self.region.misses_cuboid(center, half)
            || grid.covering_ball(voxel.cell as usize, center, norm(half), inserted).is_some()
        {
            return Ok(());
        }
        if level == upto {
            return self.levels[level].push(voxel);
        }
        self.keep_parts(voxel, level, upto, grid, inserted, tested)
    }

    fn keep_parts(
        &mut self,
        voxel: Voxel,
        level: usize,
        upto: usize,
        grid: &Grid,
        inserted: &[Inserted<impl Turned>],
        tested: &mut u64,
    ) -> Result<(), OutOfMemory> {
        for part in 0..8 {
            let at = arrays::from_fn(|a| 2 * voxel.at[a] + (part >> a & 1));
            self.keep(Voxel { cell: voxel.cell, at }, level + 1, upto, grid, inserted, tested)?;
        }
        Ok(())
    }

    /// Number of the voxels.
    pub(super) fn len(&self) -> usize {
        self.levels.iter().map(|level| level.len).sum()
    }

    /// Volume of the voxels in mm³.
    #[inline(always)]
    pub(super) fn volume_mm3(&self) -> f64 {
        let mut volume = 0.0;
        for level in self.levels.iter().rev() {
            volume = volume / 8.0 + level.len as f64;
        }
        volume * self.cell_mm3
    }

    /// A uniform point of the voxels, which is in the region or not; `None` when nothing is left.
    #[inline(always)]
    pub(super) fn draw(&self, grid: &Grid, rng: &mut Xoshiro256PlusPlus) -> Option<Draw> {
        let mut left = uniform(rng) * self.volume_mm3() / self.cell_mm3;
        let (mut chosen, mut weight) = (None, 1.0);
        for (level, voxels) in self.levels.iter().enumerate() {
            if voxels.len > 0 {
                chosen = Some(level);
                left -= voxels.len as f64 * weight;
                if left < 0.0 {
                    break;
                }
            }
            weight /= 8.0;
        }
        let level = chosen?;
        let index = ((u128::from(rng.next_u64()) * self.levels[level].len as u128) >> 64) as usize;
        let voxel = self.levels[level].get(index);
        let (corner, edge) = place(&voxel, level, grid);
        let half = edge.each(|e| e / 2.0);
        Some(Draw {
            point: arrays::from_fn(|a| corner[a] + uniform(rng) * edge[a]),
            cell: voxel.cell as usize,
            level,
            index,
            center: arrays::from_fn(|a| corner[a] + half[a]),
            half,
            radius_mm: norm(half),
        })
    }

    /// Drops the voxel of a draw if one exclusion covers it; says whether.
    pub(super) fn drop_if_covered(&mut self, draw: &Draw, by: &Inserted<impl Turned>, shift: Vector) -> bool {
        let is_covered = by.covers(shift, draw.center, draw.radius_mm);
        if is_covered {
            self.levels[draw.level].swap_remove(draw.index);
        }
        is_covered
    }

    /// Splits the voxel of a draw into what is left of its eight parts.
    pub(super) fn split(
        &mut self,
        draw: &Draw,
        grid: &Grid,
        inserted: &[Inserted<impl Turned>],
        tested: &mut u64,
    ) -> Result<(), OutOfMemory> {
        if draw.level == MOST_LEVELS {
            return Ok(());
        }
        let voxel = self.levels[draw.level].get(draw.index);
        self.levels[draw.level].swap_remove(draw.index);
        self.keep_parts(voxel, draw.level, draw.level + 1, grid, inserted, tested)
    }
}

/// Lower corner and edges of a voxel.
#[inline(always)]
fn place(voxel: &Voxel, level: usize, grid: &Grid) -> (Vector, Vector) {
    let scale = 1.0 / (1_u64 << level) as f64;
    let corner = grid.corner(voxel.cell as usize);
    let edge = grid.edge.each(|e| e * scale);
    (arrays::from_fn(|a| corner[a] + f64::from(voxel.at[a]) * edge[a]), edge)
}
