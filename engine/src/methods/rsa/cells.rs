//! A grid whose cells list every inserted grain that can exclude a point inside them.
//!
//! One look at one cell answers whether a point is free, whatever the mix of sizes: a large grain stands in the lists
//! of all cells that its exclusion sphere touches. The lists are exact for the grains known when the grid was built,
//! and short chains for those inserted since; the grid is rebuilt as grains get smaller. The cost per attempt
//! therefore does not depend on the number of grains.
//!
//! The cells hold the spheres that touch them, not the centres inside them.

use super::End;
use crate::arrays::{self, Each as _};
use crate::cpu::prefetch;
use crate::domain::Region;
use crate::geometry::images::{Image, Images};
use crate::memory::{OutOfMemory, push, refill};

/// A placed grain: its centre, and its part of every exclusion radius.
pub(super) type Placed = [f64; 4];

/// Grains are named by 27 bits; the upper 5 bits of an entry name the periodic image.
const IMAGE_SHIFT: u32 = 27;
const ID_MASK: u32 = (1 << IMAGE_SHIFT) - 1;
/// Grains between two looks at whether to stop: about a millisecond.
const GRAINS_PER_LOOK: usize = 1 << 12;
/// End of a chain of entries.
const NONE: u32 = u32::MAX;
/// Largest number of grains that entries can name.
pub(crate) const MAX_PLACED: u64 = ID_MASK as u64;

/// Entries added to a cell after the grid was built.
#[derive(Clone, Copy, Debug)]
struct Link {
    entry: u32,
    next: u32,
}

/// Memory of a grid that the next one uses again: pages that are new to a process must be cleared first.
#[derive(Debug, Default)]
pub(super) struct CellBuffers {
    starts: Vec<u32>,
    entries: Vec<u32>,
    heads: Vec<u32>,
    links: Vec<Link>,
    spheres: Vec<Placed>,
    /// Of [`Cells::order`], where it goes on.
    next: Vec<u32>,
}

/// What the grains entered mean for a point.
#[derive(Clone, Copy, Debug)]
pub(super) enum Known {
    /// None covers it, whatever the new grain.
    Free,
    /// This one covers it for every new grain.
    Covered(Placed),
    /// Some cover it for some new grains.
    Partly,
}

/// The grid.
#[derive(Debug)]
pub(super) struct Cells {
    /// Where centres may lie.
    pub(super) region: Region,
    /// Cells along each axis.
    pub(super) counts: [usize; 3],
    /// Edges of a cell in mm; 0 along an axis on which one place only is left.
    pub(super) edge: [f64; 3],
    per_edge: [f64; 3],
    /// One over the cells of a row and of a layer, plus the trifle that makes truncation exact.
    per_row: f64,
    per_layer: f64,
    /// Entries of cell `i` known at the build are `entries[starts[i]..starts[i + 1]]`.
    starts: Vec<u32>,
    entries: Vec<u32>,
    /// Head of the chain of entries added since.
    heads: Vec<u32>,
    links: Vec<Link>,
    /// The grains known at the build in the order of [`Self::ordered`], then those placed since.
    spheres: Vec<Placed>,
    /// Offsets of the periodic images; only the zero offset where there are walls.
    images: Vec<[f64; 3]>,
    next: Vec<u32>,
}

impl Cells {
    /// Builds the grid over `region` with cells of about `edge_mm`, for new grains whose part of
    /// the exclusion radius is at most `part_mm`, in the memory of an earlier one.
    ///
    /// # Errors
    /// [`End::Stopped`] when `should_stop` said so, [`End::OutOfMemory`].
    #[inline(always)]
    pub(super) fn build(
        buffers: CellBuffers,
        region: &Region,
        periodic: bool,
        edge_mm: f64,
        placed: &[Placed],
        part_mm: f64,
        should_stop: &dyn Fn() -> bool,
    ) -> Result<Self, End> {
        let size: [f64; 3] = arrays::from_fn(|a| region.high[a] - region.low[a]);
        let counts = size.each(|length| (length / edge_mm).round().max(1.0) as usize);
        let edge: [f64; 3] = arrays::from_fn(|a| size[a] / counts[a] as f64);
        let per_edge = edge.each(|e| if e > 0.0 { 1.0 / e } else { 0.0 });
        let number = counts.iter().product::<usize>();
        let CellBuffers { mut starts, mut entries, mut heads, mut links, spheres, next } = buffers;
        refill(&mut heads, number, NONE)?;
        links.clear();
        let mut cells = Self {
            region: *region,
            counts,
            edge,
            per_edge,
            per_row: 1.0 / counts[0] as f64,
            per_layer: 1.0 / (counts[0] * counts[1]) as f64,
            starts: Vec::new(),
            entries: Vec::new(),
            heads,
            links,
            spheres,
            images: images(periodic, size),
            next,
        };
        cells.order(placed)?;
        refill(&mut starts, number + 1, 0)?;
        for (id, grain) in cells.spheres.iter().enumerate() {
            if id.is_multiple_of(GRAINS_PER_LOOK) && should_stop() {
                return Err(End::Stopped);
            }
            cells.for_each_touched(0, grain, part_mm, |cell, _| starts[cell + 1] += 1);
        }
        for i in 0..number {
            starts[i + 1] += starts[i];
        }
        refill(&mut entries, starts[number] as usize, 0)?;
        // Filling moves every start to the end of its cell, which is the start of the next.
        for (id, grain) in cells.spheres.iter().enumerate() {
            if id.is_multiple_of(GRAINS_PER_LOOK) && should_stop() {
                return Err(End::Stopped);
            }
            cells.for_each_touched(id as u32, grain, part_mm, |cell, entry| {
                entries[starts[cell] as usize] = entry;
                starts[cell] += 1;
            });
        }
        starts.rotate_right(1);
        starts[0] = 0;
        cells.starts = starts;
        cells.entries = entries;
        Ok(cells)
    }

    #[cfg(test)]
    pub(super) fn images(&self) -> &[[f64; 3]] {
        &self.images
    }

    /// Its memory, for the next grid.
    pub(super) fn into_buffers(self) -> CellBuffers {
        let Self { starts, entries, heads, links, spheres, next, .. } = self;
        CellBuffers { starts, entries, heads, links, spheres, next }
    }

    /// Takes the grains in a few groups from large to small, each in the order of cells: neighbours are
    /// neighbours in memory, and in a cell's list the grains most likely to block come first.
    fn order(&mut self, placed: &[Placed]) -> Result<(), OutOfMemory> {
        let (mut ordered, mut next) = (std::mem::take(&mut self.spheres), std::mem::take(&mut self.next));
        let cell_of = |grain: &Placed| {
            let at: [usize; 3] = arrays::from_fn(|a| self.index(a, grain[a]));
            (at[2] * self.counts[1] + at[1]) * self.counts[0] + at[0]
        };
        refill(&mut ordered, placed.len(), [0.0; 4])?;
        let n = placed.len();
        for (from, to) in [(0, n / 8), (n / 8, n / 4), (n / 4, n / 2), (n / 2, n)] {
            refill(&mut next, self.len() + 1, 0_u32)?;
            for grain in &placed[from..to] {
                next[cell_of(grain) + 1] += 1;
            }
            for i in 1..next.len() {
                next[i] += next[i - 1];
            }
            for grain in &placed[from..to] {
                let next = &mut next[cell_of(grain)];
                ordered[from + *next as usize] = *grain;
                *next += 1;
            }
        }
        (self.spheres, self.next) = (ordered, next);
        Ok(())
    }

    /// Index along an axis of the cell that holds a coordinate, or of the nearest.
    #[inline(always)]
    fn index(&self, axis: usize, x: f64) -> usize {
        (((x - self.region.low[axis]) * self.per_edge[axis]).max(0.0) as usize).min(self.counts[axis] - 1)
    }

    /// Number of cells.
    pub(super) fn len(&self) -> usize {
        self.heads.len()
    }

    /// Enters a grain just placed, for new grains whose part is at most `part_mm`.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn insert(&mut self, grain: &Placed, part_mm: f64) -> Result<(), OutOfMemory> {
        let id = self.spheres.len() as u32;
        let mut refused = None;
        push(&mut self.spheres, *grain, &mut refused);
        let mut heads = std::mem::take(&mut self.heads);
        let mut links = std::mem::take(&mut self.links);
        self.for_each_touched(id, grain, part_mm, |cell, entry| {
            let next = std::mem::replace(&mut heads[cell], links.len() as u32);
            push(&mut links, Link { entry, next }, &mut refused);
        });
        self.heads = heads;
        self.links = links;
        refused.map_or(Ok(()), Err)
    }

    /// Lower corner of a cell, by its index.
    #[inline(always)]
    pub(super) fn corner(&self, cell: usize) -> [f64; 3] {
        // Three integer divisions cost more than the rest of a draw. The half keeps the quotient
        // away from whole numbers, so that truncation is exact for all u32.
        let z = ((cell as f64 + 0.5) * self.per_layer) as usize;
        let in_layer = cell - z * self.counts[0] * self.counts[1];
        let y = ((in_layer as f64 + 0.5) * self.per_row) as usize;
        let at = [in_layer - y * self.counts[0], y, z];
        arrays::from_fn(|a| self.region.low[a] + at[a] as f64 * self.edge[a])
    }

    /// Reads what [`Self::blocking`] will read first in each of the cells, so that the cache misses
    /// of many draws overlap. The sum only keeps the reads from being dropped as unused.
    #[inline(always)]
    pub(super) fn touch<const N: usize>(&self, cells: &[usize; N]) -> f64 {
        let starts = cells.each(|cell| (self.starts[cell] as usize, self.heads[cell] as usize));
        let entries = starts.each(|(known, since)| {
            let since = self.links.get(since).map_or(0, |link| link.entry);
            (self.entries.get(known).copied().unwrap_or(0), since)
        });
        let x = |entry: u32| self.spheres.get((entry & ID_MASK) as usize).map_or(0.0, |sphere| sphere[0]);
        entries.iter().map(|&(known, since)| x(known) + x(since)).sum()
    }

    /// The exclusion sphere behind an entry, at the image that the entry names.
    #[inline(always)]
    fn sphere(&self, entry: u32) -> Placed {
        let [x, y, z, part] = self.spheres[(entry & ID_MASK) as usize];
        let shift = self.images[(entry >> IMAGE_SHIFT) as usize];
        [x + shift[0], y + shift[1], z + shift[2], part]
    }

    /// What the grains of a cell mean for a point and new grains from the largest part to the least.
    #[inline(always)]
    pub(super) fn known(&self, cell: usize, p: [f64; 3], largest_mm: f64, least_mm: f64) -> Known {
        let mut known = Known::Free;
        for &entry in &self.entries[self.starts[cell] as usize..self.starts[cell + 1] as usize] {
            let sphere = self.sphere(entry);
            if covers(&sphere, p, largest_mm) {
                if covers(&sphere, p, least_mm) {
                    return Known::Covered(sphere);
                }
                known = Known::Partly;
            }
        }
        let mut at = self.heads[cell];
        while let Some(link) = self.links.get(at as usize) {
            let sphere = self.sphere(link.entry);
            if covers(&sphere, p, largest_mm) {
                if covers(&sphere, p, least_mm) {
                    return Known::Covered(sphere);
                }
                known = Known::Partly;
            }
            at = link.next;
        }
        known
    }

    /// Whether a grain entered since there were `before` of them covers a point of a cell.
    #[inline(always)]
    pub(super) fn covered_since(&self, before: u32, cell: usize, p: [f64; 3], part_mm: f64) -> bool {
        let mut at = self.heads[cell];
        // The latest comes first.
        while let Some(link) = self.links.get(at as usize).filter(|link| link.entry & ID_MASK >= before) {
            if covers(&self.sphere(link.entry), p, part_mm) {
                return true;
            }
            at = link.next;
        }
        false
    }

    /// Grains entered, those known at the build included.
    pub(super) fn grains(&self) -> u32 {
        self.spheres.len() as u32
    }

    /// Asks the memory for what entering a grain in a cell writes, its neighbours across rows and layers included.
    #[inline(always)]
    pub(super) fn prefetch_around(&self, cell: usize) {
        let (row, layer) = (self.counts[0], self.counts[0] * self.counts[1]);
        for of_layer in [cell.wrapping_sub(layer), cell, cell + layer] {
            for of_row in [of_layer.wrapping_sub(row), of_layer, of_layer.wrapping_add(row)] {
                prefetch(&self.heads, of_row);
            }
        }
    }

    /// An exclusion sphere of the cell that holds `p`, if any does, for a new grain with `part_mm`.
    #[inline(always)]
    pub(super) fn blocking(&self, cell: usize, p: [f64; 3], part_mm: f64) -> Option<Placed> {
        for &entry in &self.entries[self.starts[cell] as usize..self.starts[cell + 1] as usize] {
            let sphere = self.sphere(entry);
            if covers(&sphere, p, part_mm) {
                return Some(sphere);
            }
        }
        let mut at = self.heads[cell];
        while let Some(link) = self.links.get(at as usize) {
            let sphere = self.sphere(link.entry);
            if covers(&sphere, p, part_mm) {
                return Some(sphere);
            }
            at = link.next;
        }
        None
    }

    /// Collects the exclusion spheres of the cell that hold `p`, for a new grain with `part_mm`.
    #[inline(always)]
    pub(super) fn gather_around(&self, cell: usize, p: [f64; 3], part_mm: f64, into: &mut Vec<Placed>) {
        into.clear();
        let known = &self.entries[self.starts[cell] as usize..self.starts[cell + 1] as usize];
        // By hand: what `extend` calls is not compiled for the instruction set.
        for &entry in known {
            let sphere = self.sphere(entry);
            if covers(&sphere, p, part_mm) {
                into.push(sphere);
            }
        }
        let mut at = self.heads[cell];
        while let Some(link) = self.links.get(at as usize) {
            let sphere = self.sphere(link.entry);
            if covers(&sphere, p, part_mm) {
                into.push(sphere);
            }
            at = link.next;
        }
    }

    /// Calls `visit(cell, entry)` for every cell that the exclusion sphere of a grain touches.
    #[inline(always)]
    fn for_each_touched(&self, id: u32, grain: &Placed, part_mm: f64, mut visit: impl FnMut(usize, u32)) {
        let reach = grain[3] + part_mm;
        for (image, shift) in self.images.iter().enumerate() {
            let center: [f64; 3] = arrays::from_fn(|a| grain[a] + shift[a]);
            let outside =
                |a: usize| center[a] + reach < self.region.low[a] || center[a] - reach > self.region.high[a];
            if outside(0) || outside(1) || outside(2) {
                continue;
            }
            let entry = id | (image as u32) << IMAGE_SHIFT;
            let [(x0, x1), (y0, y1), (z0, z1)] = arrays::from_fn(|a| {
                let last = self.counts[a] - 1;
                let index =
                    |x: f64| (((x - self.region.low[a]) * self.per_edge[a]).max(0.0) as usize).min(last);
                (index(center[a] - reach), index(center[a] + reach))
            });
            // Squared gap from the centre to the slab of cells along an axis. The slab is widened a
            // little, because its corner is computed another way when points are drawn in it.
            let gap2 = |a: usize, i: usize| {
                let low = self.region.low[a] + i as f64 * self.edge[a];
                let gap = (low - center[a]).max(center[a] - low - self.edge[a]) - 1.0e-9 * self.edge[a];
                if gap > 0.0 { gap * gap } else { 0.0 }
            };
            let reach2 = reach * reach;
            for z in z0..=z1 {
                let left_z = reach2 - gap2(2, z);
                if left_z < 0.0 {
                    continue;
                }
                for y in y0..=y1 {
                    let left_y = left_z - gap2(1, y);
                    if left_y < 0.0 {
                        continue;
                    }
                    let row = (z * self.counts[1] + y) * self.counts[0];
                    for x in x0..=x1 {
                        if gap2(0, x) <= left_y {
                            visit(row + x, entry);
                        }
                    }
                }
            }
        }
    }
}

/// Whether an exclusion sphere covers a point, for a new grain with `part_mm`.
#[inline(always)]
fn covers(sphere: &Placed, p: [f64; 3], part_mm: f64) -> bool {
    let [dx, dy, dz] = [p[0] - sphere[0], p[1] - sphere[1], p[2] - sphere[2]];
    let reach = sphere[3] + part_mm;
    dx * dx + dy * dy + dz * dz < reach * reach
}

/// Offsets of the images whose exclusion spheres can reach into a box: a plan refuses grains whose own reach is longer
/// than an edge, and rounding leaves those of a reach of three quarters, which are the same, alone. The grain itself
/// comes first, then the boxes below and above it, along x fastest.
fn images(periodic: bool, size: [f64; 3]) -> Vec<[f64; 3]> {
    let (middle, half) = (size.each(|length| length / 2.0), size.each(|length| 1.25 * length));
    let mut images: Vec<Image> = Images::of_box(size, periodic).meeting_box(middle, half).collect();
    images.sort_by_key(|image| {
        let [x, y, z] = image.steps.each(|step| (-step).rem_euclid(3));
        [z, y, x]
    });
    images.iter().map(|image| image.offset_mm.into()).collect()
}
