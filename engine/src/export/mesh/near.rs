//! What stands close to a grain: other grains, looked up octave by octave of their diameters.
//!
//! It knows centres and radii; it must never know what is made of them.

use crate::packing::Spheres;

/// The grains of one octave of diameters, by cell.
#[derive(Debug)]
struct Octave {
    top_radius_mm: f64,
    counts: [usize; 3],
    per_mm: [f64; 3],
    /// Grains of cell `i` are `rows[starts[i]..starts[i + 1]]`.
    starts: Vec<u32>,
    rows: Vec<u32>,
}

/// The grains of a packing, by octave and cell.
#[derive(Debug)]
pub(super) struct Near<'a> {
    spheres: &'a Spheres,
    octaves: Vec<Octave>,
}

impl<'a> Near<'a> {
    /// Sorts the grains; they lie between 0 and `bounds`.
    pub(super) fn new(spheres: &'a Spheres, bounds: [f64; 3]) -> Self {
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
            .map(|rows| Octave::new(spheres, &rows, bounds))
            .collect();
        Self { spheres, octaves }
    }

    /// Calls `visit(row, clear distance)` for every grain but `own` that stands within `reach_mm` of a
    /// sphere.
    pub(super) fn for_each(
        &self,
        own: Option<usize>,
        center: [f64; 3],
        radius: f64,
        reach_mm: f64,
        mut visit: impl FnMut(usize, f64),
    ) {
        for octave in &self.octaves {
            let far = radius + octave.top_radius_mm + reach_mm;
            let span = |a: usize| octave.index(a, center[a] - far)..=octave.index(a, center[a] + far);
            for z in span(2) {
                for y in span(1) {
                    let row = (z * octave.counts[1] + y) * octave.counts[0];
                    let (from, to) = (*span(0).start(), *span(0).end());
                    let run = octave.starts[row + from] as usize..octave.starts[row + to + 1] as usize;
                    for &other in &octave.rows[run] {
                        let other = other as usize;
                        let apart = super::surface::distance2(center, self.spheres.center(other));
                        let touch = radius + self.spheres.d_mm[other] / 2.0;
                        if apart < (touch + reach_mm).powi(2) && Some(other) != own {
                            visit(other, apart.sqrt() - touch);
                        }
                    }
                }
            }
        }
    }
}

impl Octave {
    fn new(spheres: &Spheres, rows: &[u32], bounds: [f64; 3]) -> Self {
        let top = rows.iter().map(|&row| spheres.d_mm[row as usize]).fold(0.0, f64::max);
        let volume: f64 = bounds.iter().product();
        // About half a grain a cell at most, or few grains in much space would need many cells.
        let width = top.max((volume / (2.0 * rows.len() as f64)).cbrt());
        let counts = bounds.map(|length| ((length / width) as usize).max(1));
        let per_mm = std::array::from_fn(|a| counts[a] as f64 / bounds[a]);
        let mut octave =
            Self { top_radius_mm: top / 2.0, counts, per_mm, starts: Vec::new(), rows: rows.to_vec() };
        let cell = |row: u32| {
            let center = spheres.center(row as usize);
            let [x, y, z] = std::array::from_fn(|a| octave.index(a, center[a]));
            (z * counts[1] + y) * counts[0] + x
        };
        let mut cells: Vec<(usize, u32)> = rows.iter().map(|&row| (cell(row), row)).collect();
        cells.sort_unstable();
        let mut starts = vec![0_u32; counts.iter().product::<usize>() + 1];
        for &(cell, _) in &cells {
            starts[cell + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        octave.starts = starts;
        octave.rows = cells.into_iter().map(|(_, row)| row).collect();
        octave
    }

    fn index(&self, axis: usize, x: f64) -> usize {
        ((x * self.per_mm[axis]).max(0.0) as usize).min(self.counts[axis] - 1)
    }
}
