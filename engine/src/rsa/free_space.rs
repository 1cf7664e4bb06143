//! What may be left of the free space: voxels that no single exclusion sphere holds.
//!
//! A point drawn uniformly from the voxels, kept if it is free, is uniform in the free space, for
//! the voxels always hold all of it. Failed draws shrink the voxels: one inside the sphere that
//! blocked the draw drops out, another may be split in eight, of which those inside one sphere drop
//! out. When none is left, it is proven that there is no place. Which voxels were dropped or split
//! depends on failed draws alone, so the law of the accepted point stays uniform.
//!
//! A voxel inside a sphere is so only for grains above some size. Since grains come from the
//! largest down, such a voxel sleeps until a grain is small enough, and is forgotten if none will
//! be before the voxels are made anew.

use rand::rand_core::Rng;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::cells::{Cells, Placed};
use crate::rng::uniform;
use crate::specimen::Region;

/// Deepest level of subdivision: a cell's edge over 2^30. What is left there has less volume than
/// the rounding of a coordinate and counts as nothing.
const MAX_LEVEL: usize = 30;
/// Steps of grain size at which sleeping voxels wake.
const BEDS: usize = 128;
/// A sphere is said to hold a voxel with this relative margin, far above rounding.
const HELD_MARGIN: f64 = 1.0 + 1.0e-12;

/// A voxel of some level: its cell, and its place in the cell in units of its own edge.
#[derive(Clone, Copy, Debug)]
struct Voxel {
    cell: u32,
    at: [u32; 3],
}

/// Where a draw came from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Draw {
    level: usize,
    index: usize,
    /// The cell of the voxel.
    pub(super) cell: usize,
    /// The point drawn.
    pub(super) point: [f64; 3],
}

/// The range of the new grains' parts of the exclusion radius that voxels serve, from the largest
/// to the least, in equal steps.
#[derive(Clone, Copy, Debug)]
struct Parts {
    largest: f64,
    least: f64,
}

/// The voxels.
#[derive(Debug)]
pub(super) struct FreeSpace {
    /// Voxels that may hold a place for the present grain, by level.
    awake: Vec<Vec<Voxel>>,
    /// Voxels, with their level, that some sphere holds until grains are smaller.
    asleep: Vec<Vec<(u8, Voxel)>>,
    parts: Parts,
    /// Beds before this one are empty, their voxels awake.
    bed: usize,
    /// Voxels tested against exclusion spheres.
    pub(super) tested: u64,
    spheres: Vec<Placed>,
}

impl FreeSpace {
    /// All of the region, in cells, for grains whose part falls from `largest` to `least`.
    pub(super) fn whole(cells: &Cells, largest: f64, least: f64) -> Self {
        let half = cells.edge.map(|e| e / 2.0);
        let voxels = (0..cells.len())
            .filter(|&cell| {
                let corner = cells.corner(cell);
                let center = std::array::from_fn(|a| corner[a] + half[a]);
                !cells.region.misses_cuboid(center, half)
            })
            .map(|cell| Voxel { cell: cell as u32, at: [0; 3] })
            .collect();
        let asleep = vec![Vec::new(); BEDS];
        let parts = Parts { largest, least };
        Self { awake: vec![voxels], asleep, parts, bed: 0, tested: 0, spheres: Vec::new() }
    }

    /// Number of voxels awake.
    pub(super) fn len(&self) -> usize {
        self.awake.iter().map(Vec::len).sum()
    }

    /// Whether nothing is left for the present grain.
    pub(super) fn is_empty(&self) -> bool {
        self.awake.iter().all(Vec::is_empty)
    }

    /// Volume of the voxels awake, in units of a cell.
    pub(super) fn volume_cells(&self) -> f64 {
        let mut volume = 0.0;
        for level in self.awake.iter().rev() {
            volume = volume / 8.0 + level.len() as f64;
        }
        volume
    }

    /// Wakes the voxels that may hold a place for a grain of `part_mm`. Parts must not rise from
    /// call to call.
    pub(super) fn wake(&mut self, part_mm: f64) {
        let bed = self.parts.bed_of(part_mm);
        while self.bed <= bed {
            for (level, voxel) in std::mem::take(&mut self.asleep[self.bed]) {
                self.awake[usize::from(level)].push(voxel);
            }
            self.bed += 1;
        }
    }

    /// A uniform point of the voxels awake; `None` when nothing is left.
    #[inline]
    pub(super) fn draw(&self, cells: &Cells, rng: &mut Xoshiro256PlusPlus) -> Option<Draw> {
        let level = self.draw_level(rng)?;
        let voxels = &self.awake[level];
        let index = ((u128::from(rng.next_u64()) * voxels.len() as u128) >> 64) as usize;
        let voxel = voxels[index];
        let corner = cells.corner(voxel.cell as usize);
        let scale = scale_of(level);
        let point = std::array::from_fn(|a| {
            corner[a] + (f64::from(voxel.at[a]) + uniform(rng)) * scale * cells.edge[a]
        });
        Some(Draw { level, index, cell: voxel.cell as usize, point })
    }

    /// A level with the probability of its share of the volume.
    #[inline]
    fn draw_level(&self, rng: &mut Xoshiro256PlusPlus) -> Option<usize> {
        if let [only] = self.awake.as_slice() {
            return (!only.is_empty()).then_some(0);
        }
        let mut left = uniform(rng) * self.volume_cells();
        let mut last = None;
        let mut weight = 1.0;
        for (level, voxels) in self.awake.iter().enumerate() {
            if !voxels.is_empty() {
                last = Some(level);
                left -= voxels.len() as f64 * weight;
                if left < 0.0 {
                    break;
                }
            }
            weight /= 8.0;
        }
        last
    }

    /// Puts the voxel of a failed draw to sleep if `blocking` holds it whole; says whether it did.
    #[inline]
    pub(super) fn drop_if_held(&mut self, draw: &Draw, blocking: &Placed, cells: &Cells) -> bool {
        let voxel = self.awake[draw.level][draw.index];
        let (center, half) = geometry(cells, voxel, draw.level);
        self.tested += 1;
        let held_above = held_above(blocking, center, half);
        let held = self.parts.bed_of(held_above) >= self.bed;
        if held {
            self.awake[draw.level].swap_remove(draw.index);
            self.keep(voxel, draw.level, held_above);
        }
        held
    }

    /// Splits the voxel of a failed draw.
    pub(super) fn split(&mut self, draw: &Draw, cells: &Cells, placed: &[Placed]) {
        let voxel = self.awake[draw.level].swap_remove(draw.index);
        self.split_voxel(voxel, draw.level, cells, &cells.region, placed);
    }

    /// What of this is left for the one grain of `part_mm` whose centre lies in `region`.
    pub(super) fn for_one(&self, part_mm: f64, region: &Region, cells: &Cells, placed: &[Placed]) -> Self {
        let parts = Parts { largest: part_mm, least: part_mm };
        let asleep = vec![Vec::new(); BEDS];
        let mut one = Self { awake: Vec::new(), asleep, parts, bed: 1, tested: 0, spheres: Vec::new() };
        for (level, voxels) in self.awake.iter().enumerate() {
            one.awake.push(Vec::new());
            for &voxel in voxels {
                let (center, _) = geometry(cells, voxel, level);
                cells.gather_around(voxel.cell as usize, center, part_mm, placed, &mut one.spheres);
                one.add(voxel, level, cells, region);
            }
        }
        one
    }

    /// Splits every voxel once.
    pub(super) fn split_all(&mut self, region: &Region, cells: &Cells, placed: &[Placed]) {
        for (level, voxels) in std::mem::take(&mut self.awake).into_iter().enumerate() {
            for voxel in voxels {
                self.split_voxel(voxel, level, cells, region, placed);
            }
        }
    }

    fn split_voxel(&mut self, voxel: Voxel, level: usize, cells: &Cells, region: &Region, placed: &[Placed]) {
        if level == MAX_LEVEL {
            return;
        }
        while self.awake.len() <= level + 1 {
            self.awake.push(Vec::new());
        }
        // All eight parts meet in the centre, so a sphere that holds one of them holds the centre.
        let (center, _) = geometry(cells, voxel, level);
        let part_mm = self.parts.at(self.bed);
        cells.gather_around(voxel.cell as usize, center, part_mm, placed, &mut self.spheres);
        for part in 0..8_u32 {
            let bit = [part & 1, part >> 1 & 1, part >> 2];
            // Along an axis without extent both halves are the same place.
            if (0..3).any(|a| bit[a] == 1 && cells.edge[a] == 0.0) {
                continue;
            }
            let child = Voxel { cell: voxel.cell, at: std::array::from_fn(|a| 2 * voxel.at[a] + bit[a]) };
            self.add(child, level + 1, cells, region);
        }
    }

    /// Keeps a voxel, awake or asleep, unless it is outside or held for all grains to come.
    /// `self.spheres` must have every sphere that may hold it for the present grain.
    fn add(&mut self, voxel: Voxel, level: usize, cells: &Cells, region: &Region) {
        let (center, half) = geometry(cells, voxel, level);
        self.tested += 1;
        if !region.misses_cuboid(center, half) {
            let least = |least: f64, sphere: &Placed| least.min(held_above(sphere, center, half));
            let held_above = self.spheres.iter().fold(f64::INFINITY, least);
            self.keep(voxel, level, held_above);
        }
    }

    fn keep(&mut self, voxel: Voxel, level: usize, held_above: f64) {
        let bed = self.parts.bed_of(held_above);
        if bed < self.bed {
            self.awake[level].push(voxel);
        } else if let Some(bed) = self.asleep.get_mut(bed) {
            bed.push((level as u8, voxel));
        }
    }
}

impl Parts {
    /// A part no smaller than those of the grains for which the beds before `bed` are awake.
    #[inline]
    fn at(&self, bed: usize) -> f64 {
        let from = bed.saturating_sub(1) as f64 / BEDS as f64;
        (self.largest - from * (self.largest - self.least)) * HELD_MARGIN
    }

    /// The step in which a part lies: 0 for the largest, `BEDS` for those below the least. Parts
    /// above the largest count as the largest.
    #[inline]
    fn bed_of(&self, part_mm: f64) -> usize {
        if part_mm < self.least {
            return BEDS;
        }
        let share = (self.largest - part_mm) / (self.largest - self.least);
        // A range of one part only has a share that is no number, which becomes 0.
        ((share * BEDS as f64) as usize).min(BEDS - 1)
    }
}

/// The part of the exclusion radius above which a sphere holds a whole cuboid.
#[inline]
fn held_above(sphere: &Placed, center: [f64; 3], half: [f64; 3]) -> f64 {
    let far = |a: usize| (center[a] - sphere[a]).abs() + half[a];
    let (x, y, z) = (far(0), far(1), far(2));
    (x * x + y * y + z * z).sqrt() * HELD_MARGIN - sphere[3]
}

#[inline]
fn scale_of(level: usize) -> f64 {
    1.0 / f64::from(1_u32 << level)
}

/// Centre and half edges of a voxel.
#[inline]
fn geometry(cells: &Cells, voxel: Voxel, level: usize) -> ([f64; 3], [f64; 3]) {
    let corner = cells.corner(voxel.cell as usize);
    let half = cells.edge.map(|e| e * scale_of(level) / 2.0);
    (std::array::from_fn(|a| corner[a] + f64::from(2 * voxel.at[a] + 1) * half[a]), half)
}
