//! The neighbour table of the check: grains sorted by octave of diameter and by cell.
//!
//! Each octave has a grid of its own whose cells are as wide as two of its grains can reach. A grain
//! looks for partners in its own octave and in the finer ones: coarse grains are few, and meet the
//! fine ones around them in long runs, for grains lie in memory in the order of their cells.

use std::ops::Range;

use crate::arrays::{self, Each as _};
use crate::elementary::{cbrt, log2};
use crate::memory::{OutOfMemory, collected, copied, filled, reserved};
use crate::packing::Spheres;

/// Octaves of the largest to the least of numbers.
const MOST_OCTAVES: f64 = 2100.0;

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
    width: [f64; 3],
    /// Grains of cell `i` are `starts[i]..starts[i + 1]`.
    starts: Vec<u32>,
    grains: Vec<Grain>,
    /// Row of each grain in the packing.
    rows: Vec<u32>,
}

/// A piece of the walk over all pairs: grains of one octave, which look for partners in it or in a finer one.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    coarse: usize,
    fine: usize,
    /// Which grains of the coarse octave.
    pub(super) grains: Range<usize>,
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
    pub(super) fn build(
        spheres: &Spheres,
        bounds: [f64; 3],
        periodic: bool,
        reach_beyond: G,
    ) -> Result<Self, OutOfMemory> {
        let largest = spheres.d_mm.iter().copied().fold(0.0, f64::max);
        // The ratio to the least of numbers is no number: such a grain lies in the last octave.
        let octave_of = |d: f64| log2(largest / d).min(MOST_OCTAVES) as usize;
        let mut grains_of: Vec<usize> = Vec::new();
        for &d in &spheres.d_mm {
            let octave = octave_of(d);
            if grains_of.len() <= octave {
                grains_of.resize(octave + 1, 0);
            }
            grains_of[octave] += 1;
        }
        let mut rows_of: Vec<Vec<u32>> = Vec::new();
        for &grains in &grains_of {
            rows_of.push(reserved(grains)?);
        }
        for (row, &d) in spheres.d_mm.iter().enumerate() {
            rows_of[octave_of(d)].push(row as u32);
        }
        let octaves = rows_of
            .into_iter()
            .filter(|rows| !rows.is_empty())
            .map(|rows| Octave::build(spheres, &rows, bounds, &reach_beyond))
            .collect::<Result<_, _>>()?;
        Ok(Self { octaves, periodic, reach_beyond })
    }

    /// Number of grains.
    pub(super) fn grains(&self) -> usize {
        self.octaves.iter().map(|octave| octave.grains.len()).sum()
    }

    /// The pieces of a walk over all pairs, with `grains` grains at most.
    pub(super) fn pieces(&self, grains: usize) -> impl Iterator<Item = Piece> + Clone {
        let octaves = self.octaves.iter().map(|octave| octave.grains.len()).enumerate();
        let number = self.octaves.len();
        octaves.flat_map(move |(coarse, length)| {
            (coarse..number).flat_map(move |fine| {
                (0..length).step_by(grains).map(move |start| Piece {
                    coarse,
                    fine,
                    grains: start..length.min(start + grains),
                })
            })
        })
    }

    /// Calls `visit(row_i, row_j, grain_i, grain_j)` once for every pair in reach of a piece, and for some beyond;
    /// returns how many.
    #[inline(always)]
    pub(super) fn for_each_pair(
        &self,
        piece: &Piece,
        mut visit: impl FnMut(usize, usize, &Grain, &Grain),
    ) -> u64 {
        let mut pairs = 0;
        let (coarse, fine) = (&self.octaves[piece.coarse], &self.octaves[piece.fine]);
        let same = piece.coarse == piece.fine;
        for i in piece.grains.clone() {
            let grain = &coarse.grains[i];
            let beyond = (self.reach_beyond)(grain.diameter, fine.top);
            let reach = (grain.diameter + fine.top) / 2.0 + beyond;
            fine.for_each_run(
                grain.center,
                reach,
                self.periodic,
                same,
                #[inline(always)]
                |from: usize, to: usize| {
                    // Within an octave each pair is met from both sides; one side counts it.
                    let from = if same { from.max(i + 1) } else { from };
                    for j in from..to.max(from) {
                        pairs += 1;
                        visit(coarse.rows[i] as usize, fine.rows[j] as usize, grain, &fine.grains[j]);
                    }
                },
            );
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
    ) -> Result<Self, OutOfMemory> {
        let top = rows.iter().map(|&row| spheres.d_mm[row as usize]).fold(0.0, f64::max);
        // Few grains in much space need few cells.
        let volume: f64 = bounds.iter().product();
        let width = (top + reach_beyond(top, top)).max(cbrt(volume / (2.0 * rows.len() as f64)));
        let counts = bounds.each(|length| ((length / width) as usize).max(1));
        let per_mm = arrays::from_fn(|a| counts[a] as f64 / bounds[a]);
        let width = arrays::from_fn(|a| bounds[a] / counts[a] as f64);
        let mut octave =
            Self { top, counts, per_mm, width, starts: Vec::new(), grains: Vec::new(), rows: Vec::new() };
        let cell_of = |row: &u32| {
            let center = spheres.center(*row as usize);
            let [x, y, z] = arrays::from_fn(|a| octave.index(a, center[a]));
            octave.cell(x, y, z) as u32
        };
        let cells = collected(rows.iter().map(cell_of))?;
        let mut starts = filled(counts.iter().product::<usize>() + 1, 0_u32)?;
        for &cell in &cells {
            starts[cell as usize + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut next = copied(&starts)?;
        octave.grains = filled(rows.len(), Grain { center: [0.0; 3], diameter: 0.0 })?;
        octave.rows = filled(rows.len(), 0)?;
        for (&row, &cell) in rows.iter().zip(&cells) {
            let at = next[cell as usize] as usize;
            next[cell as usize] += 1;
            octave.grains[at] =
                Grain { center: spheres.center(row as usize), diameter: spheres.d_mm[row as usize] };
            octave.rows[at] = row;
        }
        octave.starts = starts;
        Ok(octave)
    }

    #[inline(always)]
    fn index(&self, axis: usize, x: f64) -> usize {
        ((x * self.per_mm[axis]).max(0.0) as usize).min(self.counts[axis] - 1)
    }

    #[inline(always)]
    fn cell(&self, x: usize, y: usize, z: usize) -> usize {
        (z * self.counts[1] + y) * self.counts[0] + x
    }

    /// Calls `visit(from, to)` for runs of grains that together hold all with centres within
    /// `reach` of `center`, none twice. With `forward` in a box with walls, those of earlier layers
    /// of cells and of earlier rows of the same layer are left out.
    #[inline(always)]
    fn for_each_run(
        &self,
        center: [f64; 3],
        reach: f64,
        periodic: bool,
        forward: bool,
        mut visit: impl FnMut(usize, usize),
    ) {
        let [x, y, mut z] = std::array::from_fn(|a| self.span(a, center[a], reach, periodic));
        let wrapped = |i: i64, axis: usize| {
            let count = self.counts[axis] as i64;
            // A division would cost as much as all that is done with the run.
            (if (0..count).contains(&i) { i } else { i.rem_euclid(count) }) as usize
        };
        let own = forward && !periodic;
        let own_row = self.index(1, center[1]) as i64;
        let own_layer = self.index(2, center[2]) as i64;
        if own {
            z.low = own_layer;
        }
        for z_index in z.low..=z.high {
            let y_low = if own && z_index == own_layer { own_row } else { y.low };
            let left_z = reach * reach - self.gap2(2, z_index, center[2], &z);
            for y_index in y_low..=y.high {
                let left = left_z - self.gap2(1, y_index, center[1], &y);
                if left < 0.0 {
                    continue;
                }
                let row = self.cell(0, wrapped(y_index, 1), wrapped(z_index, 2));
                let mut run = |from: usize, to: usize| {
                    let (from, to) = (self.starts[row + from] as usize, self.starts[row + to + 1] as usize);
                    if from < to {
                        visit(from, to);
                    }
                };
                // A short row costs less than the root that would shorten it.
                let short = x.full || x.high - x.low < 5;
                let x = if short { x } else { self.span(0, center[0], left.sqrt(), periodic) };
                let (from, to) = (wrapped(x.low, 0), wrapped(x.high, 0));
                if from <= to {
                    run(from, to);
                } else {
                    run(from, self.counts[0] - 1);
                    run(0, to);
                }
            }
        }
    }

    /// The cells along an axis that hold coordinates within `reach`.
    #[inline(always)]
    fn span(&self, axis: usize, center: f64, reach: f64, periodic: bool) -> Span {
        // Widened far above rounding: a row's reach is a root of a difference.
        let reach = reach + 1.0e-9 * self.width[axis];
        if !periodic {
            let index = |x: f64| self.index(axis, x) as i64;
            return Span { low: index(center - reach), high: index(center + reach), full: false };
        }
        let count = self.counts[axis] as i64;
        let index = |x: f64| (x * self.per_mm[axis]).floor() as i64;
        let (low, high) = (index(center - reach), index(center + reach));
        if high - low + 1 >= count {
            Span { low: 0, high: count - 1, full: true }
        } else {
            Span { low, high, full: false }
        }
    }

    /// Squared gap along an axis between a coordinate and a cell; 0 where the span is all around.
    #[inline(always)]
    fn gap2(&self, axis: usize, index: i64, center: f64, span: &Span) -> f64 {
        let at = center * self.per_mm[axis];
        let gap = (index as f64 - at).max(at - index as f64 - 1.0) - 1.0e-9;
        if span.full || gap <= 0.0 { 0.0 } else { (gap * self.width[axis]).powi(2) }
    }
}

/// Cells from `low` to `high` along an axis, not yet wrapped into a periodic box.
#[derive(Clone, Copy, Debug)]
struct Span {
    low: i64,
    high: i64,
    /// Whether they are all cells of the axis.
    full: bool,
}
