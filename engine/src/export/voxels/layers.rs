//! Grains as voxels, layer by layer in z, from the lowest up.
//!
//! What a row of voxels becomes depends on the row alone. Threads make different rows, each with a [`Sweep`] that finds
//! the grains of its layers; the grains wait once for all.

use std::ops::Range;

use crate::arrays::Each as _;
use crate::export::Model;
use crate::geometry::images::Images;
use crate::grain::{Grain as _, PlacedGrains, RowLines, Rows};
use crate::memory::{OutOfMemory, make_room, refill, reserved};

use super::VoxelGrid;
use super::grid::ceil_within;

/// A grain, or the image of one that a periodic box repeats.
#[derive(Clone, Copy, Debug)]
struct Body {
    /// Its lowest point.
    low: f64,
    /// Its highest point.
    high: f64,
    grain: u32,
    /// Boxes that the image is away.
    steps: [i32; 3],
}

/// The bodies of a packing, the lowest first.
pub(super) struct Bodies<'a> {
    pub(super) grains: &'a PlacedGrains<'a>,
    pub(super) grid: &'a VoxelGrid,
    bounds: [f64; 3],
    sorted: Vec<Body>,
}

/// A body that a layer may touch.
#[derive(Clone, Copy, Debug)]
struct Active {
    center: [f64; 3],
    low: f64,
    high: f64,
    grain: u32,
    /// Half of its extent along y and somewhat more.
    half_y: f32,
}

/// The way of one thread through layers in rising order.
#[derive(Debug, Default)]
pub(super) struct Sweep {
    /// Bodies that lie wholly or in part below the last layer, by their number.
    passed: usize,
    /// Those that the last layer may touch, in their order.
    active: Vec<Active>,
    lines: RowLines,
    /// Whether a grain has got a voxel, a bit each.
    seen: Vec<u64>,
}

/// Rows of a layer.
#[derive(Clone, Debug)]
pub(super) struct Part {
    /// Number of the layer.
    pub(super) k: usize,
    /// The rows.
    pub(super) rows: Range<usize>,
}

impl<'a> Bodies<'a> {
    /// The bodies of a packing.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn new(
        model: &Model<'_>,
        grains: &'a PlacedGrains<'a>,
        grid: &'a VoxelGrid,
    ) -> Result<Self, OutOfMemory> {
        let bounds = model.specimen.bounds_mm();
        let mut sorted = reserved(grains.len())?;
        let images = Images::new(model.specimen);
        for grain in 0..grains.len() {
            let (center, half) = (grains.center_mm(grain), grains.grain(grain).half_extents_mm());
            for image in images.meeting_box(center, half) {
                let low = center[2] + f64::from(image.steps[2]) * bounds[2] - half[2];
                make_room(&mut sorted, 1)?;
                sorted.push(Body { low, high: low + 2.0 * half[2], grain: grain as u32, steps: image.steps });
            }
        }
        // Where grains overlap by a digit of rounding, the later one has the voxel: of equal heights the first grain.
        sorted.sort_unstable_by(|a: &Body, b: &Body| {
            a.low.total_cmp(&b.low).then(b.grain.cmp(&a.grain)).then(b.steps.cmp(&a.steps))
        });
        Ok(Self { grains, grid, bounds, sorted })
    }

    fn activated(&self, body: &Body) -> Active {
        let grain = body.grain as usize;
        let mut center = self.grains.center_mm(grain);
        for ((x, steps), length) in center.iter_mut().zip(body.steps).zip(self.bounds) {
            *x += f64::from(steps) * length;
        }
        let half_y = (self.grains.grain(grain).half_extents_mm()[1] * 1.001) as f32;
        Active { center, low: body.low, high: body.high, grain: body.grain, half_y }
    }

    /// Calls `visit` with each body at a height that may touch some rows, and its section there.
    fn for_each_at(
        &self,
        z: f64,
        rows: &Range<usize>,
        (active, lines): (&[Active], &mut RowLines),
        mut visit: impl FnMut(usize, &Rows<'_>),
    ) {
        let dy = self.grid.spacing_mm[1];
        // A row more on either side, for digits of rounding.
        let (from, to) = ((rows.start as f64 - 1.0) * dy, (rows.end as f64 + 1.0) * dy);
        for body in active.iter().filter(|body| body.low <= z && z <= body.high) {
            let half_y = f64::from(body.half_y);
            if body.center[1] + half_y >= from && body.center[1] - half_y <= to {
                let grain = body.grain as usize;
                visit(grain, &self.grains.rows(grain, body.center, z - body.center[2], lines));
            }
        }
    }

    /// Writes the labels of the voxels of some rows whose centres lie in grains.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn fill<T: Copy>(
        &self,
        sweep: &mut Sweep,
        part: &Part,
        labels: &mut [T],
        label: &impl Fn(usize) -> T,
    ) -> Result<(), OutOfMemory> {
        let (grid, rows) = (self.grid, &part.rows);
        let z = grid.center(2, part.k);
        sweep.reach(self, [z, z])?;
        let Sweep { active, lines, seen, .. } = sweep;
        if seen.is_empty() {
            refill(seen, self.grains.len().div_ceil(64), 0)?;
        }
        self.for_each_at(z, rows, (active, lines), |grain, section| {
            let value = label(grain);
            let mut any = false;
            let [low, high] = section.y();
            let met = grid.centers_within(1, low, high);
            for j in met.start.max(rows.start)..met.end.min(rows.end) {
                let [low, high] = section.x_at(grid.center(1, j));
                let row = grid.centers_within(0, low, high);
                any |= !row.is_empty();
                let start = (j - rows.start) * grid.shape[0];
                labels[start + row.start..start + row.end].fill(value);
            }
            seen[grain / 64] |= u64::from(any) << (grain % 64);
        });
        Ok(())
    }

    /// Adds to the voxels of some rows the share that grains have of them, by samples² lines along x through each,
    /// clipped exactly.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn add_shares(
        &self,
        sweep: &mut Sweep,
        part: &Part,
        samples: u32,
        shares: &mut [f32],
    ) -> Result<(), OutOfMemory> {
        let (grid, rows) = (self.grid, &part.rows);
        let [dx, dy, dz] = grid.spacing_mm;
        let lines = f64::from(samples);
        let weight = 1.0 / (samples * samples) as f32;
        let height = |sample: u32| (part.k as f64 + (f64::from(sample) + 0.5) / lines) * dz;
        sweep.reach(self, [height(0), height(samples - 1)])?;
        let of_row = samples as usize;
        for sample in 0..samples {
            self.for_each_at(height(sample), rows, (&sweep.active, &mut sweep.lines), |_, section| {
                let step = dy / lines;
                let met = lines_within(section.y(), step, grid.shape[1] * of_row);
                for line in met.start.max(rows.start * of_row)..met.end.min(rows.end * of_row) {
                    let start = (line / of_row - rows.start) * grid.shape[0];
                    let row = &mut shares[start..start + grid.shape[0]];
                    let ends = section.x_at((line as f64 + 0.5) * step);
                    add_interval(row, ends.each(|x| x / dx), weight);
                }
            });
        }
        Ok(())
    }

    /// Grains that have not got a voxel in any of the rows of some sweeps.
    pub(super) fn grains_without_voxel<'s>(&self, sweeps: &(impl Iterator<Item = &'s Sweep> + Clone)) -> u64 {
        let seen = |word: usize| {
            sweeps.clone().fold(0, |bits: u64, sweep| bits | sweep.seen.get(word).copied().unwrap_or(0))
        };
        let with: u64 =
            (0..self.grains.len().div_ceil(64)).map(|word| u64::from(seen(word).count_ones())).sum();
        self.grains.len() as u64 - with
    }
}

impl Sweep {
    /// Goes on to the bodies that heights touch, from the lowest to the highest. The lowest must not fall from call to
    /// call.
    fn reach(&mut self, all: &Bodies<'_>, [lowest, highest]: [f64; 2]) -> Result<(), OutOfMemory> {
        self.active.retain(|body| body.high >= lowest);
        while let Some(body) = all.sorted.get(self.passed).filter(|body| body.low <= highest) {
            self.passed += 1;
            if body.high >= lowest {
                make_room(&mut self.active, 1)?;
                self.active.push(all.activated(body));
            }
        }
        Ok(())
    }
}

/// Numbers of those of `n` lines, `step` apart, that lie between two coordinates.
fn lines_within([low, high]: [f64; 2], step: f64, n: usize) -> Range<usize> {
    let number = |y: f64| ceil_within(y / step - 0.5, n);
    number(low)..number(high)
}

/// Adds to each voxel of a row the part of it that an interval covers, in units of voxels, times a weight.
fn add_interval(row: &mut [f32], [low, high]: [f64; 2], weight: f32) {
    let n = row.len() as f64;
    let (low, high) = (low.clamp(0.0, n), high.clamp(0.0, n));
    if high <= low {
        return;
    }
    let (first, last) = (low as usize, (high as usize).min(row.len() - 1));
    if first == last {
        row[first] += weight * (high - low) as f32;
        return;
    }
    row[first] += weight * (first as f64 + 1.0 - low) as f32;
    row[first + 1..last].iter_mut().for_each(|share| *share += weight);
    row[last] += weight * (high - last as f64) as f32;
}
