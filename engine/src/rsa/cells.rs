//! A grid whose cells list every placed grain that can forbid a place inside them.
//!
//! One look at one cell answers whether a point is free, whatever the mix of sizes: a large grain
//! stands in the lists of all cells that its exclusion sphere touches. The lists are exact for the
//! grains known when the grid was built and short chains for those placed since; the grid is
//! rebuilt as grains get smaller. Cost per attempt therefore does not depend on the number of
//! grains. Knows exclusion spheres only; it must never decide what to try next.

use crate::specimen::Region;

/// A placed grain: its centre, and its part of every exclusion radius.
pub(super) type Placed = [f64; 4];

/// Grains are named by 27 bits; the upper 5 bits of an entry name the periodic image.
const IMAGE_SHIFT: u32 = 27;
const ID_MASK: u32 = (1 << IMAGE_SHIFT) - 1;
/// End of a chain of entries.
const NONE: u32 = u32::MAX;
/// Largest number of grains that entries can name.
pub(crate) const MAX_PLACED: u64 = ID_MASK as u64;
/// Coverage is claimed with this relative margin on squared distances, far above rounding.
const COVERED_MARGIN: f64 = 1.0 - 1.0e-12;

/// Entries added to a cell after the grid was built.
#[derive(Clone, Copy, Debug)]
struct Link {
    entry: u32,
    next: u32,
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
    /// Entries of cell `i` known at the build are `entries[starts[i]..starts[i + 1]]`.
    starts: Vec<u32>,
    entries: Vec<u32>,
    /// Head of the chain of entries added since.
    heads: Vec<u32>,
    links: Vec<Link>,
    /// Offsets of the periodic images; only the zero offset where there are walls.
    images: Vec<[f64; 3]>,
}

impl Cells {
    /// Builds the grid over `region` with cells of about `edge_mm`, for new grains whose part of
    /// the exclusion radius is at most `part_mm`.
    pub(super) fn build(
        region: Region,
        periodic: bool,
        edge_mm: f64,
        placed: &[Placed],
        part_mm: f64,
    ) -> Self {
        let size: [f64; 3] = std::array::from_fn(|a| region.high[a] - region.low[a]);
        let counts = size.map(|length| (length / edge_mm).round().max(1.0) as usize);
        let edge: [f64; 3] = std::array::from_fn(|a| size[a] / counts[a] as f64);
        let per_edge = edge.map(|e| if e > 0.0 { 1.0 / e } else { 0.0 });
        let number = counts.iter().product::<usize>();
        let mut cells = Self {
            region,
            counts,
            edge,
            per_edge,
            starts: vec![0; number + 1],
            entries: Vec::new(),
            heads: vec![NONE; number],
            links: Vec::new(),
            images: images(periodic, size),
        };
        let mut starts = std::mem::take(&mut cells.starts);
        for (id, grain) in placed.iter().enumerate() {
            cells.for_each_touched(id as u32, grain, part_mm, |cell, _| starts[cell + 1] += 1);
        }
        for i in 0..number {
            starts[i + 1] += starts[i];
        }
        let mut entries = vec![0; starts[number] as usize];
        // Filling moves every start to the end of its cell, which is the start of the next.
        for (id, grain) in placed.iter().enumerate() {
            cells.for_each_touched(id as u32, grain, part_mm, |cell, entry| {
                entries[starts[cell] as usize] = entry;
                starts[cell] += 1;
            });
        }
        starts.rotate_right(1);
        starts[0] = 0;
        cells.starts = starts;
        cells.entries = entries;
        cells
    }

    /// Number of cells.
    pub(super) fn len(&self) -> usize {
        self.heads.len()
    }

    /// Enters a grain just placed, for new grains whose part is at most `part_mm`.
    pub(super) fn insert(&mut self, id: u32, grain: &Placed, part_mm: f64) {
        let mut heads = std::mem::take(&mut self.heads);
        let mut links = std::mem::take(&mut self.links);
        self.for_each_touched(id, grain, part_mm, |cell, entry| {
            let next = std::mem::replace(&mut heads[cell], links.len() as u32);
            links.push(Link { entry, next });
        });
        self.heads = heads;
        self.links = links;
    }

    /// Lower corner of a cell, by its index.
    pub(super) fn corner(&self, cell: usize) -> [f64; 3] {
        let [nx, ny, _] = self.counts;
        let at = [cell % nx, cell / nx % ny, cell / (nx * ny)];
        std::array::from_fn(|a| self.region.low[a] + at[a] as f64 * self.edge[a])
    }

    /// The exclusion sphere behind an entry, at the image that the entry names.
    #[inline]
    pub(super) fn sphere(&self, entry: u32, placed: &[Placed]) -> Placed {
        let [x, y, z, part] = placed[(entry & ID_MASK) as usize];
        let shift = self.images[(entry >> IMAGE_SHIFT) as usize];
        [x + shift[0], y + shift[1], z + shift[2], part]
    }

    /// The first exclusion sphere of the cell that holds `p`, for a new grain with `part_mm`.
    #[inline]
    pub(super) fn blocking(
        &self,
        cell: usize,
        p: [f64; 3],
        part_mm: f64,
        placed: &[Placed],
    ) -> Option<Placed> {
        self.entries_of(cell).map(|entry| self.sphere(entry, placed)).find(|sphere| {
            let [dx, dy, dz] = [p[0] - sphere[0], p[1] - sphere[1], p[2] - sphere[2]];
            let reach = sphere[3] + part_mm;
            dx * dx + dy * dy + dz * dz < reach * reach
        })
    }

    /// Collects the exclusion spheres of a cell.
    pub(super) fn gather(&self, cell: usize, placed: &[Placed], into: &mut Vec<Placed>) {
        into.clear();
        into.extend(self.entries_of(cell).map(|entry| self.sphere(entry, placed)));
    }

    #[inline]
    fn entries_of(&self, cell: usize) -> impl Iterator<Item = u32> + '_ {
        let known = &self.entries[self.starts[cell] as usize..self.starts[cell + 1] as usize];
        let mut at = self.heads[cell];
        let since = std::iter::from_fn(move || {
            let link = self.links.get(at as usize)?;
            at = link.next;
            Some(link.entry)
        });
        known.iter().copied().chain(since)
    }

    /// Calls `visit(cell, entry)` for every cell that the exclusion sphere of a grain touches.
    fn for_each_touched(&self, id: u32, grain: &Placed, part_mm: f64, mut visit: impl FnMut(usize, u32)) {
        let reach = grain[3] + part_mm;
        for (image, shift) in self.images.iter().enumerate() {
            let center: [f64; 3] = std::array::from_fn(|a| grain[a] + shift[a]);
            let outside =
                |a: usize| center[a] + reach < self.region.low[a] || center[a] - reach > self.region.high[a];
            if outside(0) || outside(1) || outside(2) {
                continue;
            }
            let entry = id | (image as u32) << IMAGE_SHIFT;
            let [(x0, x1), (y0, y1), (z0, z1)] = std::array::from_fn(|a| {
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

/// Whether an exclusion sphere holds a whole cuboid, for new grains whose part is at least `part_mm`.
#[inline]
pub(super) fn covers(sphere: &Placed, center: [f64; 3], half: [f64; 3], part_mm: f64) -> bool {
    let far = |a: usize| (center[a] - sphere[a]).abs() + half[a];
    let (x, y, z) = (far(0), far(1), far(2));
    let reach = sphere[3] + part_mm;
    x * x + y * y + z * z < reach * reach * COVERED_MARGIN
}

fn images(periodic: bool, size: [f64; 3]) -> Vec<[f64; 3]> {
    if !periodic {
        return vec![[0.0; 3]];
    }
    let steps = [0.0, -1.0, 1.0];
    let mut images = Vec::with_capacity(27);
    for z in steps {
        for y in steps {
            for x in steps {
                images.push([x * size[0], y * size[1], z * size[2]]);
            }
        }
    }
    images
}
