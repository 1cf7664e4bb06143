//! What may be left of the free space: voxels that no single exclusion sphere holds.
//!
//! A point drawn uniformly from the voxels, kept if it is free, is uniform in the free space, for
//! the voxels always hold all of it. Failed draws shrink the voxels: one inside the sphere that
//! blocked the draw drops out, another may be split in eight, of which those inside one sphere drop
//! out. When none is left, it is proven that there is no place. Which voxels were dropped or split
//! depends on failed draws alone, so the law of the accepted point stays uniform.
//!
//! A set of voxels is made for a part of the exclusion radius, the smallest of the grains it will
//! serve, and is a superset of the free space for each of them.

use rand::rand_core::Rng;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::cells::{Cells, Placed, covers};
use crate::rng::uniform;
use crate::specimen::Region;

/// Deepest level of subdivision: a cell's edge over 2^30. What is left there has less volume than
/// the rounding of a coordinate and counts as nothing.
const MAX_LEVEL: usize = 30;

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

/// The voxels.
#[derive(Debug)]
pub(super) struct FreeSpace {
    levels: Vec<Vec<Voxel>>,
    /// Voxels below this part of the exclusion radius are not represented.
    part_mm: f64,
    /// Voxels tested against exclusion spheres.
    pub(super) tested: u64,
    spheres: Vec<Placed>,
}

impl FreeSpace {
    /// All of the region, in cells.
    pub(super) fn whole(cells: &Cells, part_mm: f64) -> Self {
        let half = cells.edge.map(|e| e / 2.0);
        let voxels = (0..cells.len())
            .filter(|&cell| {
                let corner = cells.corner(cell);
                let center = std::array::from_fn(|a| corner[a] + half[a]);
                !cells.region.misses_cuboid(center, half)
            })
            .map(|cell| Voxel { cell: cell as u32, at: [0; 3] })
            .collect();
        Self { levels: vec![voxels], part_mm, tested: 0, spheres: Vec::new() }
    }

    /// Number of voxels.
    pub(super) fn len(&self) -> usize {
        self.levels.iter().map(Vec::len).sum()
    }

    /// Whether nothing is left.
    pub(super) fn is_empty(&self) -> bool {
        self.levels.iter().all(Vec::is_empty)
    }

    /// Volume of the voxels in units of a cell.
    pub(super) fn volume_cells(&self) -> f64 {
        let mut volume = 0.0;
        for level in self.levels.iter().rev() {
            volume = volume / 8.0 + level.len() as f64;
        }
        volume
    }

    /// A uniform point of the voxels; `None` when nothing is left.
    #[inline]
    pub(super) fn draw(&self, cells: &Cells, rng: &mut Xoshiro256PlusPlus) -> Option<Draw> {
        let level = self.draw_level(rng)?;
        let voxels = &self.levels[level];
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
        if let [only] = self.levels.as_slice() {
            return (!only.is_empty()).then_some(0);
        }
        let mut left = uniform(rng) * self.volume_cells();
        let mut last = None;
        let mut weight = 1.0;
        for (level, voxels) in self.levels.iter().enumerate() {
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

    /// Drops the voxel of a failed draw if `blocking` holds it whole; says whether it did.
    #[inline]
    pub(super) fn drop_if_covered(&mut self, draw: &Draw, blocking: &Placed, cells: &Cells) -> bool {
        let voxel = self.levels[draw.level][draw.index];
        let (center, half) = geometry(cells, voxel, draw.level);
        self.tested += 1;
        let covered = covers(blocking, center, half, self.part_mm);
        if covered {
            self.levels[draw.level].swap_remove(draw.index);
        }
        covered
    }

    /// Splits the voxel of a failed draw and keeps the parts that no single sphere holds.
    pub(super) fn split(&mut self, draw: &Draw, cells: &Cells, placed: &[Placed]) {
        let voxel = self.levels[draw.level].swap_remove(draw.index);
        let mut spheres = std::mem::take(&mut self.spheres);
        cells.gather(draw.cell, placed, &mut spheres);
        self.split_voxel(voxel, draw.level, cells, &cells.region, &spheres);
        self.spheres = spheres;
    }

    /// What of this is left for grains whose part is at least `part_mm` and whose centres lie in
    /// `region`.
    pub(super) fn restricted(&self, part_mm: f64, region: &Region, cells: &Cells, placed: &[Placed]) -> Self {
        let mut tested = 0;
        let mut spheres = Vec::new();
        let mut gathered = usize::MAX;
        let mut levels = Vec::with_capacity(self.levels.len());
        for (level, voxels) in self.levels.iter().enumerate() {
            let mut kept = Vec::new();
            for &voxel in voxels {
                if voxel.cell as usize != gathered {
                    gathered = voxel.cell as usize;
                    cells.gather(gathered, placed, &mut spheres);
                }
                let (center, half) = geometry(cells, voxel, level);
                tested += 1;
                if !region.misses_cuboid(center, half) && !covered(&spheres, center, half, part_mm) {
                    kept.push(voxel);
                }
            }
            levels.push(kept);
        }
        Self { levels, part_mm, tested, spheres: Vec::new() }
    }

    /// Splits every voxel once.
    pub(super) fn split_all(&mut self, region: &Region, cells: &Cells, placed: &[Placed]) {
        let levels = std::mem::take(&mut self.levels);
        let mut spheres = std::mem::take(&mut self.spheres);
        let mut gathered = usize::MAX;
        for (level, voxels) in levels.into_iter().enumerate() {
            for voxel in voxels {
                if voxel.cell as usize != gathered {
                    gathered = voxel.cell as usize;
                    cells.gather(gathered, placed, &mut spheres);
                }
                self.split_voxel(voxel, level, cells, region, &spheres);
            }
        }
        self.spheres = spheres;
    }

    fn split_voxel(
        &mut self,
        voxel: Voxel,
        level: usize,
        cells: &Cells,
        region: &Region,
        spheres: &[Placed],
    ) {
        if level == MAX_LEVEL {
            return;
        }
        while self.levels.len() <= level + 1 {
            self.levels.push(Vec::new());
        }
        for part in 0..8_u32 {
            let bit = [part & 1, part >> 1 & 1, part >> 2];
            // Along an axis without extent both halves are the same place.
            if (0..3).any(|a| bit[a] == 1 && cells.edge[a] == 0.0) {
                continue;
            }
            let child = Voxel { cell: voxel.cell, at: std::array::from_fn(|a| 2 * voxel.at[a] + bit[a]) };
            let (center, half) = geometry(cells, child, level + 1);
            self.tested += 1;
            if !region.misses_cuboid(center, half) && !covered(spheres, center, half, self.part_mm) {
                self.levels[level + 1].push(child);
            }
        }
    }
}

fn covered(spheres: &[Placed], center: [f64; 3], half: [f64; 3], part_mm: f64) -> bool {
    spheres.iter().any(|sphere| covers(sphere, center, half, part_mm))
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
