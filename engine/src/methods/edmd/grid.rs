//! A grid of levels that answers which list centres lie near one.
//!
//! Level `l` holds the grains whose cutoff (contact radius and skin) lies within a factor of two below `top / 2^l`, so
//! that a search visits few cells whatever the ratio of sizes.
//!
//! Grains are entered and removed while the simulation runs.

use super::container::{Container, HOME, image_code};
use crate::arrays::{self, Each as _};
use crate::cpu::prefetch;
use crate::elementary::{cbrt, log2};
use crate::memory::{OutOfMemory, refill};

const NIL: u32 = u32::MAX;
/// Edge of a cell in largest cutoffs of its level.
const EDGE: f64 = 1.6;
/// Most cells per grain of a level; a finer grid would hold mostly nothing.
const CELLS_PER_GRAIN: f64 = 3.0;
/// Cells that every level may have.
const LEAST_CELLS: f64 = 64.0;
/// Beyond the range of a search, for rounding.
const WIDER: f64 = 1.0 + 1e-9;
/// Cells that are looked into together.
const BATCH: usize = 32;

#[derive(Clone, Debug)]
struct Level {
    /// Largest cutoff of a grain here, in mm.
    cutoff_mm: f64,
    cells: [i32; 3],
    /// Cells per mm along the axes.
    per_edge: [f64; 3],
    /// Edges of a cell in mm.
    edge: [f64; 3],
    first_cell: u32,
    grains: u32,
}

impl Level {
    /// The cell along an axis; with walls the nearest one there is.
    #[inline(always)]
    fn at<const PERIODIC: bool>(&self, axis: usize, x: f64) -> i32 {
        let cell = floor(x * self.per_edge[axis]);
        if PERIODIC { cell } else { cell.clamp(0, self.cells[axis] - 1) }
    }

    #[inline(always)]
    fn first_within<const PERIODIC: bool>(&self, center: [f64; 3], range: f64) -> [i32; 3] {
        arrays::from_fn(|axis| self.at::<PERIODIC>(axis, center[axis] - range))
    }

    #[inline(always)]
    fn last_within<const PERIODIC: bool>(&self, center: [f64; 3], range: f64) -> [i32; 3] {
        arrays::from_fn(|axis| self.at::<PERIODIC>(axis, center[axis] + range))
    }

    /// Where a point lies along an axis, in cells; with walls the nearest place between them.
    #[inline(always)]
    fn place<const PERIODIC: bool>(&self, axis: usize, center: [f64; 3]) -> f64 {
        let x = center[axis] * self.per_edge[axis];
        if PERIODIC { x } else { x.clamp(0.0, f64::from(self.cells[axis])) }
    }

    /// Square of the distance of a place along an axis from a layer of cells. Grains beyond a wall are in the outermost
    /// layer, and further from a place between the walls than this layer is.
    #[inline(always)]
    fn square_distance(&self, axis: usize, place: f64, layer: i32) -> f64 {
        let above = place - f64::from(layer);
        let above = if above > 1.0 {
            above - 1.0
        } else if above < 0.0 {
            above
        } else {
            0.0
        };
        let distance = above * self.edge[axis];
        distance * distance
    }
}

/// The grid.
#[derive(Debug, Default)]
pub(crate) struct Grid {
    levels: Vec<Level>,
    heads: Vec<u32>,
    next: Vec<u32>,
    top_mm: f64,
}

impl Grid {
    /// Empties the grid and lays it out for so many grains, of cutoffs between two bounds.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(crate) fn reset(
        &mut self,
        container: &Container,
        grains: usize,
        least_mm: f64,
        top_mm: f64,
        cutoffs: impl Iterator<Item = f64>,
    ) -> Result<(), OutOfMemory> {
        let count = (log2(top_mm / least_mm).floor().max(0.0) as usize + 1).min(40);
        let size = container.bounds_mm();
        self.top_mm = top_mm;
        self.levels.clear();
        for level in 0..count {
            let cutoff_mm = top_mm / f64::from(1_u32 << level.min(31));
            self.levels.push(Level {
                cutoff_mm,
                cells: [1; 3],
                per_edge: [0.0; 3],
                edge: [0.0; 3],
                first_cell: 0,
                grains: 0,
            });
        }
        for cutoff in cutoffs {
            let level = self.level_of(cutoff);
            self.levels[level].grains += 1;
        }
        let mut first_cell = 0;
        let volume = size[0] * size[1] * size[2];
        for level in &mut self.levels {
            let most_cells = (CELLS_PER_GRAIN * f64::from(level.grains)).max(LEAST_CELLS);
            let edge = (EDGE * level.cutoff_mm).max(cbrt(volume / most_cells));
            level.cells = size.each(|length| ((length / edge).floor() as i32).max(1));
            level.per_edge = arrays::from_fn(|a| f64::from(level.cells[a]) / size[a]);
            level.edge = arrays::from_fn(|a| size[a] / f64::from(level.cells[a]));
            level.first_cell = first_cell;
            level.grains = 0;
            first_cell += level.cells.iter().product::<i32>() as u32;
        }
        refill(&mut self.heads, first_cell as usize, NIL)?;
        refill(&mut self.next, grains, NIL)
    }

    /// The largest cutoff it was laid out for, in mm.
    pub(crate) fn top_mm(&self) -> f64 {
        self.top_mm
    }

    #[inline(always)]
    fn level_of(&self, cutoff_mm: f64) -> usize {
        let mut level = 0;
        while level + 1 < self.levels.len() && cutoff_mm <= self.levels[level + 1].cutoff_mm {
            level += 1;
        }
        level
    }

    #[inline(always)]
    fn cell(&self, level: usize, center: [f64; 3]) -> u32 {
        let level = &self.levels[level];
        let at = |a: usize| ((center[a] * level.per_edge[a]) as i32).clamp(0, level.cells[a] - 1);
        level.first_cell + ((at(2) * level.cells[1] + at(1)) * level.cells[0] + at(0)) as u32
    }

    /// Enters a grain; returns the cell by which it can be removed.
    #[inline(always)]
    pub(crate) fn insert(&mut self, grain: u32, center: [f64; 3], cutoff_mm: f64) -> u32 {
        let level = self.level_of(cutoff_mm);
        let cell = self.cell(level, center);
        self.next[grain as usize] = self.heads[cell as usize];
        self.heads[cell as usize] = grain;
        self.levels[level].grains += 1;
        cell
    }

    /// Removes a grain from the cell it was entered in.
    #[inline(always)]
    pub(crate) fn remove(&mut self, grain: u32, cell: u32) {
        let level = self.levels.partition_point(|level| level.first_cell <= cell) - 1;
        self.levels[level].grains -= 1;
        let after = self.next[grain as usize];
        if self.heads[cell as usize] == grain {
            self.heads[cell as usize] = after;
            return;
        }
        let mut at = self.heads[cell as usize];
        while at != NIL {
            let next = self.next[at as usize];
            if next == grain {
                self.next[at as usize] = after;
                return;
            }
            at = next;
        }
    }

    /// Visits every grain that may lie within `cutoff_mm` and its own cutoff, and `extra`
    /// times the smaller of both, of a centre, with the code of the image in which it does.
    #[inline(always)]
    pub(crate) fn visit<const PERIODIC: bool>(
        &self,
        center: [f64; 3],
        cutoff_mm: f64,
        extra: f64,
        levels: std::ops::Range<usize>,
        mut found: impl FnMut(u32, u32),
    ) {
        for level in &self.levels[levels] {
            if level.grains == 0 {
                continue;
            }
            let range = (cutoff_mm + level.cutoff_mm + extra * cutoff_mm.min(level.cutoff_mm)) * WIDER;
            let mut batch = Batch::new(self, &mut found);
            let [_, y_low, z_low] = level.first_within::<PERIODIC>(center, range);
            let [_, y_high, z_high] = level.last_within::<PERIODIC>(center, range);
            let (y_place, z_place) = (level.place::<PERIODIC>(1, center), level.place::<PERIODIC>(2, center));
            for z in z_low..=z_high {
                let left = range * range - level.square_distance(2, z_place, z);
                let (iz, z) = if PERIODIC { wrapped(z, level.cells[2]) } else { (0, z) };
                for y in y_low..=y_high {
                    // Only what of the row lies within the sphere.
                    let left = left - level.square_distance(1, y_place, y);
                    if left < 0.0 {
                        continue;
                    }
                    let half = left.sqrt();
                    let low = level.at::<PERIODIC>(0, center[0] - half);
                    let high = level.at::<PERIODIC>(0, center[0] + half);
                    let (iy, y) = if PERIODIC { wrapped(y, level.cells[1]) } else { (0, y) };
                    let row =
                        level.first_cell as usize + ((z * level.cells[1] + y) * level.cells[0]) as usize;
                    if PERIODIC {
                        for x in low..=high {
                            let (ix, x) = wrapped(x, level.cells[0]);
                            let head = self.heads[row + x as usize];
                            if head != NIL {
                                batch.add(head, image_code([ix, iy, iz]));
                            }
                        }
                    } else {
                        for &head in &self.heads[row + low as usize..=row + high as usize] {
                            batch.add(head, HOME);
                        }
                    }
                }
            }
            batch.flush();
        }
    }

    /// Asks the memory for the cells that a visit at home will look into.
    pub(crate) fn ask(&self, center: [f64; 3], cutoff_mm: f64) {
        for level in self.levels.iter().filter(|level| level.grains > 0) {
            let range = cutoff_mm + level.cutoff_mm;
            let at = |a: usize, x: f64| ((x * level.per_edge[a]) as i32).clamp(0, level.cells[a] - 1);
            let low: [i32; 3] = arrays::from_fn(|a| at(a, center[a] - range));
            let high: [i32; 3] = arrays::from_fn(|a| at(a, center[a] + range));
            for z in low[2]..=high[2] {
                for y in low[1]..=high[1] {
                    let row =
                        level.first_cell as usize + ((z * level.cells[1] + y) * level.cells[0]) as usize;
                    prefetch(&self.heads, row + low[0] as usize);
                    prefetch(&self.heads, row + high[0] as usize);
                }
            }
        }
    }

    /// Levels as fine as or finer than that of a cutoff.
    #[inline(always)]
    pub(crate) fn finer(&self, cutoff_mm: f64) -> std::ops::Range<usize> {
        self.level_of(cutoff_mm)..self.levels.len()
    }

    /// All levels.
    #[inline(always)]
    pub(crate) fn all(&self) -> std::ops::Range<usize> {
        0..self.levels.len()
    }

    /// The bound that cutoffs of the level of a cutoff lie above; 0 of the finest level.
    #[inline(always)]
    pub(crate) fn least_of_level(&self, cutoff_mm: f64) -> f64 {
        self.levels.get(self.level_of(cutoff_mm) + 1).map_or(0.0, |finer| finer.cutoff_mm)
    }
}

/// Cells whose first grains are asked for together, before any chain is followed: with many grains
/// each is a cache miss.
struct Batch<'a, F> {
    grid: &'a Grid,
    found: &'a mut F,
    heads: [(u32, u32); BATCH],
    len: usize,
}

impl<'a, F: FnMut(u32, u32)> Batch<'a, F> {
    #[inline(always)]
    fn new(grid: &'a Grid, found: &'a mut F) -> Self {
        Self { grid, found, heads: [(NIL, 0); BATCH], len: 0 }
    }

    /// A cell's first grain, if it has one, in an image.
    #[inline(always)]
    fn add(&mut self, head: u32, image: u32) {
        if self.len == BATCH {
            self.flush();
        }
        prefetch(&self.grid.next, head as usize);
        self.heads[self.len] = (head, image);
        self.len += usize::from(head != NIL);
    }

    #[inline(always)]
    fn flush(&mut self) {
        for &(head, image) in &self.heads[..self.len] {
            let mut at = head;
            while at != NIL {
                (self.found)(at, image);
                at = self.grid.next[at as usize];
            }
        }
        self.len = 0;
    }
}

/// The largest whole number not above `x`, which is small.
#[inline(always)]
fn floor(x: f64) -> i32 {
    let whole = x as i32;
    whole - i32::from(f64::from(whole) > x)
}

/// The image that a cell lies in, and the cell within it.
#[inline(always)]
fn wrapped(cell: i32, cells: i32) -> (i32, i32) {
    // Nearly always at home or next door, where a division would be a waste.
    if cell >= 0 && cell < cells {
        (0, cell)
    } else if cell < 0 && cell >= -cells {
        (-1, cell + cells)
    } else {
        (cell.div_euclid(cells), cell.rem_euclid(cells))
    }
}
