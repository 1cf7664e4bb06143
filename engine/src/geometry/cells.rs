//! Uniform grids of cells over a box whose corner is the origin, items sorted by cell, and spheres sorted by octave of
//! diameter and by cell.
//!
//! Items are sorted by counting, in the order in which they come within a cell. Spheres have a grid for each octave
//! of diameters, so that the cells of the fine ones are small (hierarchical grid: Ericson, Real-Time Collision
//! Detection, 2005, section 7.2).

use std::ops::Range;

use crate::arrays::{self, Each as _};
use crate::elementary::{cbrt, log2};
use crate::memory::{OutOfMemory, collected, copied, filled, reserved};
use crate::packing::Spheres;

/// Share of a cell by which spans are widened, far above rounding.
const MARGIN: f64 = 1.0e-9;
/// Spheres between two looks at whether to go on: about a millisecond.
const SPHERES_PER_LOOK: usize = 4096;

/// The cells of a box. Points outside belong to the nearest cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cells {
    counts: [usize; 3],
    per_mm: [f64; 3],
}

impl Cells {
    /// As many equal cells as fit into a box of edges `bounds_mm` without being narrower than `width_mm`, but at
    /// least one along each axis.
    pub fn new(bounds_mm: [f64; 3], width_mm: f64) -> Self {
        let counts = bounds_mm.each(|length| ((length / width_mm) as usize).max(1));
        Self { counts, per_mm: arrays::from_fn(|a| counts[a] as f64 / bounds_mm[a]) }
    }

    /// Number of cells.
    pub fn count(&self) -> usize {
        self.counts.iter().product()
    }

    /// Position of a coordinate's cell along an axis.
    #[inline]
    pub fn index(&self, axis: usize, x_mm: f64) -> usize {
        ((x_mm * self.per_mm[axis]).max(0.0) as usize).min(self.counts[axis] - 1)
    }

    /// Number of the cell at these positions; x runs fastest.
    #[inline]
    pub fn number(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.counts[1] + y) * self.counts[0] + x
    }

    /// Number of the cell of a point.
    #[inline]
    pub fn cell_of(&self, p_mm: [f64; 3]) -> usize {
        self.number(arrays::from_fn(|a| self.index(a, p_mm[a])))
    }

    /// Positions along an axis of the cells from one coordinate to another.
    #[inline]
    pub fn span(&self, axis: usize, low_mm: f64, high_mm: f64) -> Range<usize> {
        self.index(axis, low_mm)..self.index(axis, high_mm) + 1
    }

    /// The same in a periodic box, where cells beyond an end are those at the other; each once.
    #[inline]
    pub fn periodic_span(
        &self,
        axis: usize,
        low_mm: f64,
        high_mm: f64,
    ) -> impl Iterator<Item = usize> + use<> {
        let count = self.counts[axis] as i64;
        let index = |x: f64| (x * self.per_mm[axis]).floor() as i64;
        let (low, high) = (index(low_mm), index(high_mm));
        let span = if high - low + 1 >= count { 0..=count - 1 } else { low..=high };
        span.map(move |i| i.rem_euclid(count) as usize)
    }

    /// Squared distance in mm² along an axis between a coordinate and the cell at a position, less a margin.
    #[inline]
    fn gap2(&self, axis: usize, index: usize, x_mm: f64) -> f64 {
        let at = x_mm * self.per_mm[axis];
        let gap = (index as f64 - at).max(at - index as f64 - 1.0) - MARGIN;
        if gap <= 0.0 { 0.0 } else { (gap / self.per_mm[axis]).powi(2) }
    }
}

/// Items sorted by cell.
#[derive(Clone, Debug)]
pub struct Sorted<T> {
    cells: Cells,
    /// Items of cell `i` are `starts[i]..starts[i + 1]`.
    starts: Vec<u32>,
    items: Vec<T>,
}

impl<T: Copy> Sorted<T> {
    /// Sorts items, less than 2^32 of them, by the cells of their points.
    ///
    /// # Errors
    /// The system refused memory.
    pub fn new(cells: Cells, items: &[T], point_mm: impl Fn(&T) -> [f64; 3]) -> Result<Self, OutOfMemory> {
        let numbers: Vec<usize> = collected(items.iter().map(|item| cells.cell_of(point_mm(item))))?;
        let mut starts = filled(cells.count() + 1, 0_u32)?;
        for &cell in &numbers {
            starts[cell + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut next = copied(&starts)?;
        let mut sorted = copied(items)?;
        for (item, &cell) in items.iter().zip(&numbers) {
            sorted[next[cell] as usize] = *item;
            next[cell] += 1;
        }
        Ok(Self { cells, starts, items: sorted })
    }

    /// The cells.
    pub fn cells(&self) -> &Cells {
        &self.cells
    }

    /// All items, sorted.
    pub fn items(&self) -> &[T] {
        &self.items
    }

    /// The items of cells with these numbers.
    #[inline]
    pub fn of_cells(&self, cells: Range<usize>) -> &[T] {
        &self.items[self.range(cells)]
    }

    #[inline]
    fn range(&self, cells: Range<usize>) -> Range<usize> {
        self.starts[cells.start] as usize..self.starts[cells.end] as usize
    }

    /// Calls `visit` with ranges of items that together hold all within `reach_mm` of a point, and some beyond, none
    /// twice.
    #[inline]
    fn for_each_range(&self, center: [f64; 3], reach_mm: f64, mut visit: impl FnMut(Range<usize>)) {
        let cells = &self.cells;
        let span = |a: usize, reach_mm: f64| {
            let reach_mm = reach_mm + MARGIN / cells.per_mm[a];
            cells.span(a, center[a] - reach_mm, center[a] + reach_mm)
        };
        let (x, y) = (span(0, reach_mm), span(1, reach_mm));
        // Few cells cost less than to find out which of them are beyond reach.
        let is_short = x.len() <= 5;
        for k in span(2, reach_mm) {
            let left_z = if is_short { 0.0 } else { reach_mm * reach_mm - cells.gap2(2, k, center[2]) };
            for j in y.clone() {
                let mut x = x.clone();
                if !is_short {
                    let left = left_z - cells.gap2(1, j, center[1]);
                    if left < 0.0 {
                        continue;
                    }
                    x = span(0, left.sqrt());
                }
                let row = cells.number([0, j, k]);
                let range = self.range(row + x.start..row + x.end);
                if !range.is_empty() {
                    visit(range);
                }
            }
        }
    }
}

/// A sphere with its row in the packing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Centre in mm.
    pub center_mm: [f64; 3],
    /// Diameter in mm.
    pub d_mm: f64,
    /// Row in the packing.
    pub row: u32,
}

/// The spheres of one octave of diameters.
#[derive(Clone, Debug)]
struct Octave {
    largest_d_mm: f64,
    sorted: Sorted<Sphere>,
}

/// Spheres by octave of diameter, from coarse to fine, and by cell.
#[derive(Clone, Debug)]
pub struct Octaves {
    octaves: Vec<Octave>,
}

impl Octaves {
    /// Sorts spheres, whose centres lie between 0 and `bounds_mm`, for searches up to gaps of about `gap_mm`.
    ///
    /// # Errors
    /// The system refused memory.
    pub fn new(spheres: &Spheres, bounds_mm: [f64; 3], gap_mm: f64) -> Result<Self, OutOfMemory> {
        let largest = spheres.d_mm.iter().copied().fold(0.0, f64::max);
        let octave_of = |d_mm: f64| log2(largest / d_mm) as usize;
        let mut counts: Vec<usize> = Vec::new();
        for octave in spheres.d_mm.iter().map(|&d_mm| octave_of(d_mm)) {
            if counts.len() <= octave {
                counts.resize(octave + 1, 0);
            }
            counts[octave] += 1;
        }
        let mut octaves: Vec<Vec<Sphere>> =
            counts.iter().map(|&count| reserved(count)).collect::<Result<_, _>>()?;
        for (row, &d_mm) in spheres.d_mm.iter().enumerate() {
            octaves[octave_of(d_mm)].push(Sphere { center_mm: spheres.center(row), d_mm, row: row as u32 });
        }
        octaves.retain(|spheres| !spheres.is_empty());
        let volume_mm3: f64 = bounds_mm.iter().product();
        let octave = |spheres: Vec<Sphere>| {
            let largest_d_mm = spheres.iter().map(|sphere| sphere.d_mm).fold(0.0, f64::max);
            // Two cells for each sphere at most: few in much space would need many.
            let sparse_mm = cbrt(volume_mm3 / (2.0 * spheres.len() as f64));
            let cells = Cells::new(bounds_mm, (largest_d_mm + gap_mm).max(sparse_mm));
            Ok(Octave { largest_d_mm, sorted: Sorted::new(cells, &spheres, |sphere| sphere.center_mm)? })
        };
        Ok(Self { octaves: octaves.into_iter().map(octave).collect::<Result<_, _>>()? })
    }

    /// Calls `visit` with every sphere whose gap to the sphere of that centre and radius is at most `reach_mm`, and
    /// with some beyond.
    #[inline]
    pub fn for_each_near(
        &self,
        center_mm: [f64; 3],
        radius_mm: f64,
        reach_mm: f64,
        mut visit: impl FnMut(&Sphere),
    ) {
        for Octave { largest_d_mm, sorted } in &self.octaves {
            let far_mm = radius_mm + largest_d_mm / 2.0 + reach_mm;
            sorted.for_each_range(center_mm, far_mm, |range| sorted.items[range].iter().for_each(&mut visit));
        }
    }

    /// Calls `visit` once with every pair whose gap is at most `reach_mm`, and with some beyond. `go_on` is asked now
    /// and then, and ends the walk where it says no; returns whether the walk was completed.
    pub fn for_each_pair(
        &self,
        reach_mm: f64,
        mut visit: impl FnMut(&Sphere, &Sphere),
        go_on: impl Fn() -> bool,
    ) -> bool {
        let mut walked = 0_usize;
        for (index, coarse) in self.octaves.iter().enumerate() {
            for (steps, fine) in self.octaves[index..].iter().enumerate() {
                for (i, one) in coarse.sorted.items.iter().enumerate() {
                    walked += 1;
                    if walked.is_multiple_of(SPHERES_PER_LOOK) && !go_on() {
                        return false;
                    }
                    let far_mm = (one.d_mm + fine.largest_d_mm) / 2.0 + reach_mm;
                    fine.sorted.for_each_range(one.center_mm, far_mm, |range| {
                        // Within an octave each pair is met from both sides; one side counts it.
                        let start = if steps == 0 { range.start.max(i + 1) } else { range.start };
                        for other in fine.sorted.items.get(start..range.end).unwrap_or_default() {
                            visit(one, other);
                        }
                    });
                }
            }
        }
        true
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::collections::BTreeSet;

    use crate::properties::properties;
    use proptest::prelude::*;

    use super::*;

    const BOUNDS: [f64; 3] = [10.0, 7.0, 12.0];

    fn spheres() -> impl Strategy<Value = Spheres> {
        let sphere = (0.0..=1.0_f64, 0.0..=1.0_f64, 0.0..=1.0_f64, 0.02..4.0_f64);
        prop::collection::vec(sphere, 1..60).prop_map(|rows| {
            let mut spheres = Spheres::default();
            for (x, y, z, d) in rows {
                spheres.push([x * BOUNDS[0], y * BOUNDS[1], z * BOUNDS[2]], d);
            }
            spheres
        })
    }

    fn gap(spheres: &Spheres, i: usize, j: usize) -> f64 {
        let (p, q) = (spheres.center(i), spheres.center(j));
        let distance2: f64 = (0..3).map(|a| (p[a] - q[a]).powi(2)).sum();
        distance2.sqrt() - (spheres.d_mm[i] + spheres.d_mm[j]) / 2.0
    }

    properties! {
        #[test]
        fn pairs_and_neighbours_in_reach_are_found(
            spheres in spheres(), reach in 0.0..3.0_f64, sorted_for in 0.0..2.0_f64,
        ) {
            let octaves = Octaves::new(&spheres, BOUNDS, sorted_for).unwrap();
            let mut met = BTreeSet::new();
            let mut twice = false;
            let ended = octaves.for_each_pair(reach, |a, b| {
                twice |= !met.insert((a.row.min(b.row) as usize, a.row.max(b.row) as usize));
            }, || true);
            prop_assert!(ended && !twice);
            for i in 0..spheres.len() {
                let mut near = Vec::new();
                octaves.for_each_near(spheres.center(i), spheres.d_mm[i] / 2.0, reach, |other| {
                    near.push(other.row as usize);
                });
                let distinct: BTreeSet<usize> = near.iter().copied().collect();
                prop_assert_eq!(distinct.len(), near.len());
                prop_assert!(distinct.contains(&i));
                for j in i + 1..spheres.len() {
                    if gap(&spheres, i, j) < reach {
                        prop_assert!(met.contains(&(i, j)) && distinct.contains(&j));
                    }
                }
            }
        }

        #[test]
        fn items_lie_in_their_cells_in_their_order(spheres in spheres(), width in 0.3..20.0_f64) {
            let cells = Cells::new(BOUNDS, width);
            let rows: Vec<usize> = (0..spheres.len()).collect();
            let sorted = Sorted::new(cells, &rows, |&row| spheres.center(row)).unwrap();
            let mut seen = Vec::new();
            for cell in 0..cells.count() {
                let items = sorted.of_cells(cell..cell + 1);
                prop_assert!(items.is_sorted());
                prop_assert!(items.iter().all(|&row| cells.cell_of(spheres.center(row)) == cell));
                seen.extend_from_slice(items);
            }
            prop_assert_eq!(&seen, sorted.items());
            seen.sort_unstable();
            prop_assert_eq!(seen, rows);
        }

        #[test]
        fn periodic_spans_have_each_cell_once(low in -15.0..15.0_f64, length in 0.0..25.0_f64) {
            let cells = Cells::new(BOUNDS, 0.9);
            let span: Vec<usize> = cells.periodic_span(0, low, low + length).collect();
            let distinct: BTreeSet<usize> = span.iter().copied().collect();
            prop_assert_eq!(distinct.len(), span.len());
            for step in 0..=20 {
                let x = (low + length * f64::from(step) / 20.0).rem_euclid(BOUNDS[0]);
                prop_assert!(distinct.contains(&cells.index(0, x)) || length < 1e-9, "{x} {span:?}");
            }
        }
    }
}
