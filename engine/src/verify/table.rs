//! The neighbour table of the check: grains sorted by octave of diameter and by cell.
//!
//! Each octave has a grid of its own whose cells are as wide as two of its grains can reach; a
//! grain looks for partners in its own octave and in the coarser ones. Grains lie in memory in the
//! order of their cells, so that neighbours are read in runs.

use crate::packing::Spheres;

/// A grain as the table holds it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grain {
    pub(super) center: [f64; 3],
    pub(super) diameter: f64,
}

/// The grains of one octave of diameters.
#[derive(Debug)]
struct Octave {
    /// Largest diameter in the octave.
    top: f64,
    counts: [usize; 3],
    per_mm: [f64; 3],
    /// Grains of cell `i` are `starts[i]..starts[i + 1]`.
    starts: Vec<u32>,
    grains: Vec<Grain>,
    /// Row of each grain in the packing.
    rows: Vec<u32>,
}

/// The table.
#[derive(Debug)]
pub(super) struct Table<G> {
    octaves: Vec<Octave>,
    periodic: bool,
    reach_beyond: G,
}

impl<G: Fn(f64, f64) -> f64> Table<G> {
    /// Sorts the grains. `reach_beyond(d_i, d_j)` is the clear distance up to which a pair is seen;
    /// it must not fall with either diameter.
    pub(super) fn build(spheres: &Spheres, bounds: [f64; 3], periodic: bool, reach_beyond: G) -> Self {
        let largest = spheres.d_mm.iter().copied().fold(0.0, f64::max);
        let mut rows_of: Vec<Vec<u32>> = Vec::new();
        for (row, &d) in spheres.d_mm.iter().enumerate() {
            let octave = (largest / d).log2() as usize;
            if rows_of.len() <= octave {
                rows_of.resize_with(octave + 1, Vec::new);
            }
            rows_of[octave].push(row as u32);
        }
        let octaves = rows_of
            .into_iter()
            .filter(|rows| !rows.is_empty())
            .map(|rows| Octave::build(spheres, &rows, bounds, &reach_beyond))
            .collect();
        Self { octaves, periodic, reach_beyond }
    }

    /// Calls `visit(row_i, row_j, grain_i, grain_j)` once for every pair in reach, and for some
    /// beyond; returns how many.
    pub(super) fn for_each_pair(&self, mut visit: impl FnMut(usize, usize, &Grain, &Grain)) -> u64 {
        let mut pairs = 0;
        for (fine_index, fine) in self.octaves.iter().enumerate() {
            for (coarse_index, coarse) in self.octaves[..=fine_index].iter().enumerate() {
                let same = coarse_index == fine_index;
                for (i, grain) in fine.grains.iter().enumerate() {
                    let reach =
                        (grain.diameter + coarse.top) / 2.0 + (self.reach_beyond)(grain.diameter, coarse.top);
                    coarse.for_each_run(grain.center, reach, self.periodic, |from, to| {
                        // Within an octave each pair is met from both sides; one side counts it.
                        let from = if same { from.max(i + 1) } else { from };
                        for j in from..to.max(from) {
                            pairs += 1;
                            let (row_i, row_j) = (fine.rows[i] as usize, coarse.rows[j] as usize);
                            visit(row_i, row_j, grain, &coarse.grains[j]);
                        }
                    });
                }
            }
        }
        pairs
    }
}

impl Octave {
    fn build(
        spheres: &Spheres,
        rows: &[u32],
        bounds: [f64; 3],
        reach_beyond: &impl Fn(f64, f64) -> f64,
    ) -> Self {
        let top = rows.iter().map(|&row| spheres.d_mm[row as usize]).fold(0.0, f64::max);
        // Few grains in much space need few cells.
        let volume: f64 = bounds.iter().product();
        let width = (top + reach_beyond(top, top)).max((volume / (2.0 * rows.len() as f64)).cbrt());
        let counts = bounds.map(|length| ((length / width) as usize).max(1));
        let per_mm = std::array::from_fn(|a| counts[a] as f64 / bounds[a]);
        let mut octave =
            Self { top, counts, per_mm, starts: Vec::new(), grains: Vec::new(), rows: Vec::new() };
        let cells: Vec<u32> = rows
            .iter()
            .map(|&row| {
                let center = spheres.center(row as usize);
                let [x, y, z] = std::array::from_fn(|a| octave.index(a, center[a]));
                octave.cell(x, y, z) as u32
            })
            .collect();
        let mut starts = vec![0_u32; counts.iter().product::<usize>() + 1];
        for &cell in &cells {
            starts[cell as usize + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut next = starts.clone();
        octave.grains = vec![Grain { center: [0.0; 3], diameter: 0.0 }; rows.len()];
        octave.rows = vec![0; rows.len()];
        for (&row, &cell) in rows.iter().zip(&cells) {
            let at = next[cell as usize] as usize;
            next[cell as usize] += 1;
            octave.grains[at] =
                Grain { center: spheres.center(row as usize), diameter: spheres.d_mm[row as usize] };
            octave.rows[at] = row;
        }
        octave.starts = starts;
        octave
    }

    fn index(&self, axis: usize, x: f64) -> usize {
        ((x * self.per_mm[axis]).max(0.0) as usize).min(self.counts[axis] - 1)
    }

    fn cell(&self, x: usize, y: usize, z: usize) -> usize {
        (z * self.counts[1] + y) * self.counts[0] + x
    }

    /// Calls `visit(from, to)` for runs of grains that together hold all with centres within
    /// `reach` of `center`, none twice.
    fn for_each_run(
        &self,
        center: [f64; 3],
        reach: f64,
        periodic: bool,
        mut visit: impl FnMut(usize, usize),
    ) {
        let [(x0, x1), (y0, y1), (z0, z1)] = std::array::from_fn(|a| {
            let (low, high) = ((center[a] - reach) * self.per_mm[a], (center[a] + reach) * self.per_mm[a]);
            let count = self.counts[a] as i64;
            if !periodic {
                return (low.floor().max(0.0) as i64, (high.floor() as i64).min(count - 1));
            }
            let (low, high) = (low.floor() as i64, high.floor() as i64);
            if high - low + 1 >= count { (0, count - 1) } else { (low, high) }
        });
        let wrapped = |i: i64, axis: usize| i.rem_euclid(self.counts[axis] as i64) as usize;
        for z in z0..=z1 {
            for y in y0..=y1 {
                let row = self.cell(0, wrapped(y, 1), wrapped(z, 2));
                let mut run = |from: usize, to: usize| {
                    visit(self.starts[row + from] as usize, self.starts[row + to + 1] as usize);
                };
                let (from, to) = (wrapped(x0, 0), wrapped(x1, 0));
                if from <= to {
                    run(from, to);
                } else {
                    run(from, self.counts[0] - 1);
                    run(0, to);
                }
            }
        }
    }
}
