//! A grid of the grains of one size class, to find those around a point.

use std::ops::Range;

use crate::elementary::cbrt;
use crate::geometry::cells::{Cells, Sorted};
use crate::memory::OutOfMemory;

/// A centre and a radius.
pub(super) type Grain = [f64; 4];

/// Cells of the grid at most, whatever the specimen.
const MAX_CELLS: f64 = 1.0e7;

/// The grid.
#[derive(Debug)]
pub(super) struct NeighborGrid {
    bounds: [f64; 3],
    periodic: bool,
    grains: Sorted<Grain>,
}

impl NeighborGrid {
    /// Sorts grains into cells that are about as wide as `reach_mm`, or hold about two grains each.
    pub(super) fn new(
        grains: &[Grain],
        bounds: [f64; 3],
        periodic: bool,
        reach_mm: f64,
    ) -> Result<Self, OutOfMemory> {
        let volume: f64 = bounds.iter().product();
        let sparse = cbrt(2.0 * volume / grains.len().max(1) as f64);
        let edge = sparse.max(reach_mm / 4.0).max(cbrt(volume / MAX_CELLS));
        let grains = Sorted::new(Cells::new(bounds, edge), grains, |&[x, y, z, _]| [x, y, z])?;
        Ok(Self { bounds, periodic, grains })
    }

    /// Calls `visit(squared centre distance, radius)` for all grains with centres within `reach` of a
    /// point, each in its nearest image, and for some beyond. In a periodic box `reach` must be at most half
    /// of the shortest edge. The grain at the point itself is among them.
    pub(super) fn for_each_near(&self, point: [f64; 3], reach: f64, mut visit: impl FnMut(f64, f64)) {
        let cells = self.grains.cells();
        let mut visit_cells = |cells: Range<usize>| {
            for grain in self.grains.of_cells(cells) {
                let mut distance2 = 0.0;
                for a in 0..3 {
                    let mut step = (grain[a] - point[a]).abs();
                    if self.periodic {
                        step = step.min(self.bounds[a] - step);
                    }
                    distance2 += step * step;
                }
                visit(distance2, grain[3]);
            }
        };
        if self.periodic {
            let span = |a: usize| cells.periodic_span(a, point[a] - reach, point[a] + reach);
            for z in span(2) {
                for y in span(1) {
                    for x in span(0) {
                        let cell = cells.number([x, y, z]);
                        visit_cells(cell..cell + 1);
                    }
                }
            }
        } else {
            let [x, y, z] = [0, 1, 2].map(|a| cells.span(a, point[a] - reach, point[a] + reach));
            for z in z {
                for y in y.clone() {
                    let row = cells.number([0, y, z]);
                    visit_cells(row + x.start..row + x.end);
                }
            }
        }
    }
}
