//! Grains as voxels, layer by layer in z, from the lowest up.

use std::ops::Range;

use crate::arrays::Each as _;
use crate::export::Model;
use crate::export::solids::{Section, Sectioned};
use crate::memory::{OutOfMemory, filled, reserved};

use super::VoxelGrid;

/// A grain, or the image of one that a periodic box repeats.
#[derive(Clone, Copy, Debug)]
struct Body {
    /// Its lowest point.
    low: f64,
    grain: u32,
    /// Boxes that the image is away.
    shift: [i8; 3],
}

/// The bodies that have a part in the layers to come.
pub(super) struct Layers<'a> {
    solids: Sectioned<'a>,
    grid: &'a VoxelGrid,
    bounds: [f64; 3],
    /// Those that no layer has reached, the lowest last.
    waiting: Vec<Body>,
    /// Those that the last layer may have touched.
    active: Vec<Body>,
    /// Whether a grain has got a voxel, a bit each.
    seen: Vec<u64>,
}

impl<'a> Layers<'a> {
    /// The bodies of a packing.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn new(model: &Model<'a>, grid: &'a VoxelGrid) -> Result<Self, OutOfMemory> {
        let solids = Sectioned::new(model.grains)?;
        let bounds = model.specimen.bounds_mm();
        let mut waiting = reserved(solids.len())?;
        let shifts: &[i8] = if model.specimen.is_periodic() { &[-1, 0, 1] } else { &[0] };
        for grain in 0..solids.len() {
            let (center, half) = (solids.center(grain), solids.half_extents(grain));
            let reaches = |axis: usize, shift: i8| {
                let at = center[axis] + f64::from(shift) * bounds[axis];
                at + half[axis] > 0.0 && at - half[axis] < bounds[axis]
            };
            for &x in shifts.iter().filter(|shift| reaches(0, **shift)) {
                for &y in shifts.iter().filter(|shift| reaches(1, **shift)) {
                    for &z in shifts.iter().filter(|shift| reaches(2, **shift)) {
                        let low = center[2] + f64::from(z) * bounds[2] - half[2];
                        waiting.push(Body { low, grain: grain as u32, shift: [x, y, z] });
                    }
                }
            }
        }
        // Stable, so that the order is that of the grains where heights are equal.
        waiting.sort_by(|a, b| b.low.total_cmp(&a.low));
        let seen = filled(solids.len().div_ceil(64), 0)?;
        Ok(Self { solids, grid, bounds, waiting, active: Vec::new(), seen })
    }

    /// Calls `visit` with each grain at a height and its section there. The height must rise from call to call.
    fn for_each_at(&mut self, z: f64, mut visit: impl FnMut(usize, &Section)) {
        while let Some(body) = self.waiting.pop_if(|body| body.low <= z) {
            self.active.push(body);
        }
        let solids = &self.solids;
        self.active.retain(|body| body.low + 2.0 * solids.half_extents(body.grain as usize)[2] >= z);
        for body in &self.active {
            let grain = body.grain as usize;
            let mut center = solids.center(grain);
            for ((x, shift), length) in center.iter_mut().zip(body.shift).zip(self.bounds) {
                *x += f64::from(shift) * length;
            }
            visit(grain, &solids.section(grain, center, z - center[2]));
        }
    }

    /// Writes the labels of the voxels of layer `k` whose centres lie in grains. Layers come in rising order.
    pub(super) fn fill<T: Copy>(&mut self, k: usize, layer: &mut [T], label: &impl Fn(usize) -> T) {
        let grid = self.grid;
        let z = grid.center(2, k);
        let mut seen = std::mem::take(&mut self.seen);
        self.for_each_at(z, |grain, section| {
            let value = label(grain);
            let mut any = false;
            let [low, high] = section.y();
            for j in grid.centers_within(1, low, high) {
                let [low, high] = section.x_at(grid.center(1, j));
                let row = grid.centers_within(0, low, high);
                any |= !row.is_empty();
                let start = j * grid.shape[0];
                layer[start + row.start..start + row.end].fill(value);
            }
            seen[grain / 64] |= u64::from(any) << (grain % 64);
        });
        self.seen = seen;
    }

    /// Writes for the voxels of layer `k` the share that grains have of them, by samples² lines along x through
    /// each, clipped exactly. Layers come in rising order.
    pub(super) fn fill_shares(&mut self, k: usize, samples: u32, layer: &mut [f32]) {
        let grid = self.grid;
        let [dx, dy, dz] = grid.spacing_mm;
        let lines = f64::from(samples);
        let weight = 1.0 / (samples * samples) as f32;
        for sample in 0..samples {
            let z = (k as f64 + (f64::from(sample) + 0.5) / lines) * dz;
            self.for_each_at(z, |_, section| {
                let step = dy / lines;
                for line in lines_within(section.y(), step, grid.shape[1] * samples as usize) {
                    let start = line / samples as usize * grid.shape[0];
                    let row = &mut layer[start..start + grid.shape[0]];
                    let ends = section.x_at((line as f64 + 0.5) * step);
                    add_interval(row, ends.each(|x| x / dx), weight);
                }
            });
        }
    }

    /// Grains that have not got a voxel in all layers so far.
    pub(super) fn grains_without_voxel(&self) -> u64 {
        let with: u64 = self.seen.iter().map(|bits| u64::from(bits.count_ones())).sum();
        self.solids.len() as u64 - with
    }
}

/// Numbers of those of `n` lines, `step` apart, that lie between two coordinates.
fn lines_within([low, high]: [f64; 2], step: f64, n: usize) -> Range<usize> {
    let number = |y: f64| (y / step - 0.5).ceil().clamp(0.0, n as f64) as usize;
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
