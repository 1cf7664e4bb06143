//! A grid of the grains of one size class, to find those around a point.

/// A centre and a radius.
pub(super) type Grain = [f64; 4];

/// Cells of the grid at most, whatever the specimen.
const MAX_CELLS: f64 = 1.0e7;

/// The grid.
#[derive(Debug)]
pub(super) struct Grid {
    bounds: [f64; 3],
    periodic: bool,
    counts: [usize; 3],
    per_mm: [f64; 3],
    /// Grains of cell `i` are `starts[i]..starts[i + 1]`.
    starts: Vec<u32>,
    grains: Vec<Grain>,
}

impl Grid {
    /// Sorts grains into cells that are about as wide as `reach_mm`, or hold about two grains each.
    pub(super) fn new(grains: &[Grain], bounds: [f64; 3], periodic: bool, reach_mm: f64) -> Self {
        let volume: f64 = bounds.iter().product();
        let sparse = (2.0 * volume / grains.len().max(1) as f64).cbrt();
        let edge = sparse.max(reach_mm / 4.0).max((volume / MAX_CELLS).cbrt());
        let counts = bounds.map(|length| ((length / edge) as usize).max(1));
        let per_mm = std::array::from_fn(|a| counts[a] as f64 / bounds[a]);
        let mut grid = Self { bounds, periodic, counts, per_mm, starts: Vec::new(), grains: Vec::new() };
        let cells: Vec<usize> = grains.iter().map(|grain| grid.cell_of(grain)).collect();
        let mut starts = vec![0_u32; counts.iter().product::<usize>() + 1];
        for &cell in &cells {
            starts[cell + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut next = starts.clone();
        let mut sorted = vec![[0.0; 4]; grains.len()];
        for (grain, &cell) in grains.iter().zip(&cells) {
            sorted[next[cell] as usize] = *grain;
            next[cell] += 1;
        }
        grid.starts = starts;
        grid.grains = sorted;
        grid
    }

    fn cell_of(&self, grain: &Grain) -> usize {
        let [x, y, z] =
            std::array::from_fn(|a| ((grain[a] * self.per_mm[a]).max(0.0) as usize).min(self.counts[a] - 1));
        (z * self.counts[1] + y) * self.counts[0] + x
    }

    /// Calls `visit(squared centre distance, radius)` for all grains with centres within `reach` of a
    /// point, each in its nearest image, and for some beyond. In a periodic box `reach` must be at most half
    /// of the shortest edge. The grain at the point itself is among them.
    pub(super) fn for_each_near(&self, point: [f64; 3], reach: f64, mut visit: impl FnMut(f64, f64)) {
        let spans: [Span; 3] = std::array::from_fn(|a| self.span(a, point[a], reach));
        let each = |a: usize| {
            let (span, count) = (spans[a], self.counts[a] as i64);
            (span.low..=span.high).map(move |i| i.rem_euclid(count) as usize)
        };
        for z in each(2) {
            for y in each(1) {
                let row = (z * self.counts[1] + y) * self.counts[0];
                for x in each(0) {
                    let (from, to) = (self.starts[row + x] as usize, self.starts[row + x + 1] as usize);
                    for grain in &self.grains[from..to] {
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
                }
            }
        }
    }

    /// The cells along an axis that hold coordinates within `reach`, each once.
    fn span(&self, axis: usize, at: f64, reach: f64) -> Span {
        let count = self.counts[axis] as i64;
        let index = |x: f64| (x * self.per_mm[axis]).floor() as i64;
        let (low, high) = (index(at - reach), index(at + reach));
        if !self.periodic {
            return Span { low: low.clamp(0, count - 1), high: high.clamp(0, count - 1) };
        }
        if high - low + 1 >= count { Span { low: 0, high: count - 1 } } else { Span { low, high } }
    }
}

/// Cells from `low` to `high` along an axis, not yet wrapped into a periodic box.
#[derive(Clone, Copy, Debug)]
struct Span {
    low: i64,
    high: i64,
}
