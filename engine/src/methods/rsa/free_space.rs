//! What may be left of the free space: voxels that no single exclusion sphere covers.
//!
//! A point drawn uniformly from the voxels, kept if it is free, is uniform in the free space, for
//! the voxels always hold all of it. Failed draws shrink the voxels: one inside the sphere that
//! blocked the draw drops out, another may be split in eight, of which those inside one sphere drop
//! out. When none is left, and none of the deepest level was left undecided, it is proven that there
//! is no place. Which voxels were dropped or split
//! depends on failed draws alone, so the law of the accepted point stays uniform.
//!
//! A voxel inside a sphere, or too close to a wall, is so only for grains above some size. Since
//! grains come from the largest down, such a voxel sleeps until a grain is small enough, and is
//! forgotten if none will be before the voxels are rebuilt.

use rand::rand_core::Rng;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::cells::{Cells, Placed};
use super::voxels::{Deferred, Level, Voxel, Waiting};
use crate::arrays::{self, Each as _};
use crate::domain::Domain;
use crate::memory::OutOfMemory;
use crate::rng::uniform;

/// Deepest level of subdivision: a cell's edge over 2^30. What is left there has less volume than
/// the rounding of a coordinate and is dropped, but it is not proven to hold no place.
const MAX_LEVEL: usize = 30;
/// Points drawn at once.
pub(super) const DRAWS_AT_ONCE: usize = 16;
/// Steps of grain size at which deferred voxels activate.
const SIZE_BINS: usize = 128;
/// A sphere is said to hold a voxel with this relative margin, far above rounding.
const COVERED_MARGIN: f64 = 1.0 + 1.0e-12;

/// A point drawn, and the voxel it was drawn from.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Draw {
    level: usize,
    index: usize,
    voxel: Voxel,
    /// The point.
    pub(super) point: [f64; 3],
}

impl Draw {
    /// The cell of the voxel.
    #[inline(always)]
    pub(super) fn cell(&self) -> usize {
        self.voxel.cell as usize
    }
}

/// Points drawn ahead, so that the cache misses behind them overlap. The voxels may shrink
/// meanwhile: points of a larger superset of the free space serve as well. They may not grow.
#[derive(Debug)]
struct Batch {
    draws: [Draw; DRAWS_AT_ONCE],
    next: usize,
    /// Volume that the points were drawn from, in units of a cell.
    volume_cells: f64,
}

impl Batch {
    fn empty() -> Self {
        Self { draws: [Draw::default(); DRAWS_AT_ONCE], next: DRAWS_AT_ONCE, volume_cells: 0.0 }
    }
}

/// The grains that a set of voxels serves, by the two lengths that fall from grain to grain: the
/// part of the exclusion radius, and the clearance to walls, which is linear in the part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Served<'a> {
    pub(super) domain: &'a Domain,
    pub(super) largest_part: f64,
    pub(super) least_part: f64,
    pub(super) largest_clearance: f64,
    pub(super) least_clearance: f64,
}

/// Memory of voxels that those of the next grid use again.
#[derive(Debug, Default)]
pub(super) struct VoxelBuffers {
    cells: Option<Level>,
    waiting: Waiting,
}

/// The voxels.
#[derive(Debug)]
pub(super) struct FreeSpace<'a> {
    /// Voxels that may hold a place for the present grain, by level.
    active: Vec<Level>,
    /// Deferred voxels by the step of part in which they activate.
    waiting: Waiting,
    /// Voxels covered for parts of at least this are not active.
    threshold_mm: f64,
    served: Served<'a>,
    batch: Batch,
    /// Voxels tested against exclusion spheres.
    pub(super) tested: u64,
    spheres: Vec<Placed>,
    /// Whether a voxel of the deepest level was dropped that nothing covers as a whole.
    is_undecided: bool,
    /// Memory that a voxel was refused.
    refused: Option<OutOfMemory>,
}

impl<'a> FreeSpace<'a> {
    /// All of the region, in cells, in the memory of earlier voxels.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn whole(
        buffers: VoxelBuffers,
        cells: &Cells,
        served: Served<'a>,
    ) -> Result<Self, OutOfMemory> {
        let half = cells.edge.each(|e| e / 2.0);
        let is_inside = |cell: &usize| {
            let corner = cells.corner(*cell);
            let center = arrays::from_fn(|a| corner[a] + half[a]);
            !cells.region.misses_cuboid(center, half)
        };
        let VoxelBuffers { cells: memory, mut waiting } = buffers;
        // Levels below the cells are those that are in use: their number decides what is drawn.
        let active = Level::of_cells(memory, (0..cells.len()).filter(is_inside), cells.len())?;
        waiting.reset(SIZE_BINS)?;
        Ok(Self {
            active: vec![active],
            waiting,
            threshold_mm: served.largest_part,
            served,
            batch: Batch::empty(),
            tested: 0,
            spheres: Vec::new(),
            is_undecided: false,
            refused: None,
        })
    }

    /// Its memory, for the next voxels.
    pub(super) fn into_buffers(self) -> VoxelBuffers {
        VoxelBuffers { cells: self.active.into_iter().next(), waiting: self.waiting }
    }

    /// The memory that a voxel was refused, if one was: voxels are missing since then.
    pub(super) fn refused(&self) -> Option<OutOfMemory> {
        self.refused.or(self.waiting.refused())
    }

    /// Whether no place is left, where no voxel is: whether each of them was covered as a whole.
    pub(super) fn proves_saturation(&self) -> bool {
        !self.is_undecided
    }

    /// Activates the voxels that may hold a place for a grain of `part_mm`; parts must not rise from
    /// call to call. Unless `exactly`, the others of its bin activate with them, which spares most grains
    /// the loss of the points drawn ahead.
    pub(super) fn activate(&mut self, part_mm: f64, exactly: bool) {
        let bin = self.served.bin_of(part_mm);
        self.waiting.open_to(bin);
        self.threshold_mm = if exactly { part_mm } else { self.served.least_of(bin) };
        while let Some(Deferred { level, voxel, .. }) = self.waiting.pop(self.threshold_mm) {
            // The points drawn ahead do not know this voxel.
            self.batch.next = DRAWS_AT_ONCE;
            self.active[level].push(voxel, level, &mut self.refused);
        }
    }

    /// A uniform point of the voxels active, or of those that were active a few draws ago; `None`
    /// when nothing was left.
    #[inline(always)]
    pub(super) fn draw(&mut self, cells: &Cells, rng: &mut Xoshiro256PlusPlus) -> Option<Draw> {
        if self.batch.next == DRAWS_AT_ONCE {
            self.draw_batch(cells, rng)?;
        }
        self.batch.next += 1;
        Some(self.batch.draws[self.batch.next - 1])
    }

    /// Volume that the last draw was made from, in units of a cell.
    #[inline(always)]
    pub(super) fn drawn_from_cells(&self) -> f64 {
        self.batch.volume_cells
    }

    #[inline(always)]
    fn draw_batch(&mut self, cells: &Cells, rng: &mut Xoshiro256PlusPlus) -> Option<()> {
        let volume_cells = self.volume_cells();
        let draws = self.draw_points(volume_cells, cells, rng)?;
        self.batch = Batch { draws, next: 0, volume_cells };
        Some(())
    }

    /// Uniform points of the voxels active, whose volume is the first; `None` where there are none. The memory is asked
    /// for what looking at them reads first.
    #[inline(always)]
    pub(super) fn draw_points(
        &self,
        volume_cells: f64,
        cells: &Cells,
        rng: &mut Xoshiro256PlusPlus,
    ) -> Option<[Draw; DRAWS_AT_ONCE]> {
        let mut draws = [Draw::default(); DRAWS_AT_ONCE];
        for draw in &mut draws {
            draw.level = self.draw_level(volume_cells, rng)?;
            let voxels = self.active[draw.level].len();
            draw.index = ((u128::from(rng.next_u64()) * voxels as u128) >> 64) as usize;
            draw.point = arrays::from_fn(|_| uniform(rng));
        }
        for draw in &mut draws {
            draw.voxel = self.active[draw.level].get(draw.index, draw.level)?;
        }
        for draw in &mut draws {
            let corner = cells.corner(draw.cell());
            let scale = scale_of(draw.level);
            draw.point = arrays::from_fn(|a| {
                corner[a] + (f64::from(draw.voxel.at[a]) + draw.point[a]) * scale * cells.edge[a]
            });
        }
        std::hint::black_box(cells.touch(&draws.each(|draw| draw.cell())));
        Some(draws)
    }

    /// Number of voxels active.
    pub(super) fn voxels(&self) -> usize {
        self.active.iter().map(Level::len).sum()
    }

    /// Volume of the voxels active, in units of a cell.
    #[inline(always)]
    pub(super) fn volume_cells(&self) -> f64 {
        let mut volume = 0.0;
        for level in self.active.iter().rev() {
            volume = volume / 8.0 + level.len() as f64;
        }
        volume
    }

    /// A level with the probability of its share of the volume.
    #[inline(always)]
    fn draw_level(&self, volume_cells: f64, rng: &mut Xoshiro256PlusPlus) -> Option<usize> {
        if let [only] = self.active.as_slice() {
            return (only.len() > 0).then_some(0);
        }
        let mut left = uniform(rng) * volume_cells;
        let mut last = None;
        let mut weight = 1.0;
        for (level, voxels) in self.active.iter().enumerate() {
            if voxels.len() > 0 {
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

    /// Puts the voxel of a failed draw aside if `blocking` holds it whole; says whether it did.
    #[inline(always)]
    pub(super) fn drop_if_covered(&mut self, draw: &Draw, blocking: &Placed, cells: &Cells) -> bool {
        self.drop_covered(draw, covered_above_of(draw, blocking, cells))
    }

    /// Puts the voxel of a failed draw aside if it is covered for the present grain, the part given being that above
    /// which it is covered; says whether it did.
    #[inline(always)]
    pub(super) fn drop_covered(&mut self, draw: &Draw, covered_above: f64) -> bool {
        self.tested += 1;
        let covered = covered_above < self.threshold_mm;
        if covered && self.remove(draw) {
            self.keep(draw.voxel, draw.level, covered_above);
        }
        covered
    }

    /// Splits the voxel of a failed draw.
    #[inline(always)]
    pub(super) fn split(&mut self, draw: &Draw, cells: &Cells) {
        if draw.level < MAX_LEVEL && self.remove(draw) {
            self.split_voxel(draw.voxel, draw.level, cells);
        } else if draw.level == MAX_LEVEL && self.remove(draw) {
            self.is_undecided = true;
        }
    }

    /// Takes out the voxel of a draw; says whether it was still there.
    #[inline(always)]
    fn remove(&mut self, draw: &Draw) -> bool {
        let voxels = &mut self.active[draw.level];
        let there = voxels.get(draw.index, draw.level) == Some(draw.voxel);
        if there {
            voxels.swap_remove(draw.index);
        }
        there
    }

    #[inline(always)]
    fn split_voxel(&mut self, voxel: Voxel, level: usize, cells: &Cells) {
        while self.active.len() <= level + 1 {
            self.active.push(Level::new(self.active.len(), cells.len()));
        }
        // All eight parts meet in the centre, so a sphere that holds one of them holds the centre.
        let (center, whole) = geometry(cells, voxel, level);
        let half = whole.each(|h| h / 2.0);
        cells.gather_around(voxel.cell as usize, center, self.threshold_mm, &mut self.spheres);
        let covered_above = parts_covered_above(&self.spheres, center, half);
        self.tested += 8;
        let by_walls = !self.served.far_from_walls(center, whole);
        for (part, &covered_by_spheres) in covered_above.iter().enumerate() {
            let bit = [part & 1, part >> 1 & 1, part >> 2];
            // Along an axis without extent both halves are the same place.
            if (0..3).any(|a| bit[a] == 1 && half[a] == 0.0) {
                continue;
            }
            let mut covered_above = covered_by_spheres;
            if by_walls {
                let part_center = arrays::from_fn(|a| center[a] + (2.0 * bit[a] as f64 - 1.0) * half[a]);
                covered_above = covered_above.min(self.served.outside_above(part_center, half));
            }
            let at = arrays::from_fn(|a| 2 * voxel.at[a] + bit[a] as u32);
            self.keep(Voxel { cell: voxel.cell, at }, level + 1, covered_above);
        }
    }

    /// Keeps a voxel, active or deferred, unless it is covered for all grains to come.
    #[inline(always)]
    fn keep(&mut self, voxel: Voxel, level: usize, covered_above: f64) {
        if covered_above >= self.threshold_mm {
            self.active[level].push(voxel, level, &mut self.refused);
        } else if covered_above >= self.served.least_part {
            let bin = self.served.bin_of(covered_above);
            self.waiting.add(Deferred { covered_above, level, voxel }, bin);
        }
    }
}

impl Served<'_> {
    /// The step in which a part lies: 0 for the largest. Parts outside the range count as its ends.
    #[inline(always)]
    fn bin_of(&self, part_mm: f64) -> usize {
        let share = (self.largest_part - part_mm) / (self.largest_part - self.least_part);
        // A range of one part only has a share that is no number, which becomes 0.
        ((share * SIZE_BINS as f64) as usize).min(SIZE_BINS - 1)
    }

    /// A part no larger than any in the bin.
    fn least_of(&self, bin: usize) -> f64 {
        let share = (bin + 1) as f64 / SIZE_BINS as f64;
        (self.largest_part - share * (self.largest_part - self.least_part)) / COVERED_MARGIN
    }

    /// Whether no grain served is kept out of a cuboid by walls.
    #[inline(always)]
    fn far_from_walls(&self, center: [f64; 3], half: [f64; 3]) -> bool {
        self.domain.clearance_reaching_all(center, half) > self.largest_clearance
    }

    /// The part above which walls keep grains out of a whole cuboid.
    fn outside_above(&self, center: [f64; 3], half: [f64; 3]) -> f64 {
        let clearance = self.domain.clearance_reaching_some(center, half) * COVERED_MARGIN;
        if clearance >= self.largest_clearance {
            return f64::INFINITY;
        }
        let range = self.largest_clearance - self.least_clearance;
        if clearance < self.least_clearance || range <= 0.0 {
            return f64::NEG_INFINITY;
        }
        let share = (clearance - self.least_clearance) / range;
        (self.least_part + share * (self.largest_part - self.least_part)) * COVERED_MARGIN
    }
}

/// The part of the exclusion radius above which a sphere covers the whole voxel of a draw.
#[inline(always)]
pub(super) fn covered_above_of(draw: &Draw, sphere: &Placed, cells: &Cells) -> f64 {
    let (center, half) = geometry(cells, draw.voxel, draw.level);
    covered_above(sphere, center, half)
}

/// The part of the exclusion radius above which a sphere covers a whole cuboid.
#[inline(always)]
fn covered_above(sphere: &Placed, center: [f64; 3], half: [f64; 3]) -> f64 {
    let far = |a: usize| (center[a] - sphere[a]).abs() + half[a];
    let (x, y, z) = (far(0), far(1), far(2));
    (x * x + y * y + z * z).sqrt() * COVERED_MARGIN - sphere[3]
}

/// [`covered_above`] of the eight parts of a voxel, the least over all spheres. Along each axis a part
/// reaches from `center` to `2 half` on one side.
#[inline(always)]
fn parts_covered_above(spheres: &[Placed], center: [f64; 3], half: [f64; 3]) -> [f64; 8] {
    let mut least = [f64::INFINITY; 8];
    for sphere in spheres {
        let far2 = |a: usize| {
            let offset = center[a] - sphere[a];
            [(offset - half[a]).abs() + half[a], (offset + half[a]).abs() + half[a]].each(|far| far * far)
        };
        let (x, y, z) = (far2(0), far2(1), far2(2));
        let distance2: [f64; 8] = arrays::from_fn(|part| x[part & 1] + y[part >> 1 & 1] + z[part >> 2]);
        for (least, distance2) in least.iter_mut().zip(distance2) {
            *least = least.min(distance2.sqrt() * COVERED_MARGIN - sphere[3]);
        }
    }
    least
}

#[inline(always)]
fn scale_of(level: usize) -> f64 {
    1.0 / f64::from(1_u32 << level)
}

/// Centre and half edges of a voxel.
#[inline(always)]
fn geometry(cells: &Cells, voxel: Voxel, level: usize) -> ([f64; 3], [f64; 3]) {
    let corner = cells.corner(voxel.cell as usize);
    let half = cells.edge.each(|e| e * scale_of(level) / 2.0);
    (arrays::from_fn(|a| corner[a] + f64::from(2 * voxel.at[a] + 1) * half[a]), half)
}
