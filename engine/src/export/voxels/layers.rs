//! Grains as voxels, layer by layer in z, from the lowest up.

use crate::export::SphereModel;
use crate::memory::{OutOfMemory, filled, reserved};
use crate::packing::Spheres;

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
    spheres: &'a Spheres,
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
    pub(super) fn new(model: &SphereModel<'a>, grid: &'a VoxelGrid) -> Result<Self, OutOfMemory> {
        let spheres = model.spheres;
        let bounds = model.specimen.bounds_mm();
        let mut waiting = reserved(spheres.len())?;
        let shifts: &[i8] = if model.specimen.is_periodic() { &[-1, 0, 1] } else { &[0] };
        for grain in 0..spheres.len() {
            let (center, radius) = (spheres.center(grain), spheres.d_mm[grain] / 2.0);
            let reaches = |axis: usize, shift: i8| {
                let at = center[axis] + f64::from(shift) * bounds[axis];
                at + radius > 0.0 && at - radius < bounds[axis]
            };
            for &x in shifts.iter().filter(|shift| reaches(0, **shift)) {
                for &y in shifts.iter().filter(|shift| reaches(1, **shift)) {
                    for &z in shifts.iter().filter(|shift| reaches(2, **shift)) {
                        let low = center[2] + f64::from(z) * bounds[2] - radius;
                        waiting.push(Body { low, grain: grain as u32, shift: [x, y, z] });
                    }
                }
            }
        }
        // Stable, so that the order is that of the grains where heights are equal.
        waiting.sort_by(|a, b| b.low.total_cmp(&a.low));
        let seen = filled(spheres.len().div_ceil(64), 0)?;
        Ok(Self { spheres, grid, bounds, waiting, active: Vec::new(), seen })
    }

    /// Calls `visit` with grain, centre and radius of each body at a height, which must rise from call to call.
    fn for_each_at(&mut self, z: f64, mut visit: impl FnMut(usize, [f64; 3], f64)) {
        while let Some(body) = self.waiting.pop_if(|body| body.low <= z) {
            self.active.push(body);
        }
        let d_mm = &self.spheres.d_mm;
        self.active.retain(|body| body.low + d_mm[body.grain as usize] >= z);
        for body in &self.active {
            let grain = body.grain as usize;
            let mut center = self.spheres.center(grain);
            for ((x, shift), length) in center.iter_mut().zip(body.shift).zip(self.bounds) {
                *x += f64::from(shift) * length;
            }
            visit(grain, center, d_mm[grain] / 2.0);
        }
    }

    /// Writes the labels of the voxels of layer `k` whose centres lie in grains. Layers come in rising order.
    pub(super) fn fill<T: Copy>(&mut self, k: usize, layer: &mut [T], label: &impl Fn(usize) -> T) {
        let grid = self.grid;
        let z = grid.center(2, k);
        let mut seen = std::mem::take(&mut self.seen);
        self.for_each_at(z, |grain, center, radius| {
            let dz = z - center[2];
            let disc = ((radius - dz) * (radius + dz)).max(0.0).sqrt();
            let value = label(grain);
            let mut any = false;
            for j in grid.centers_within(1, center[1] - disc, center[1] + disc) {
                let dy = grid.center(1, j) - center[1];
                let half_chord = ((disc - dy) * (disc + dy)).max(0.0).sqrt();
                let row = grid.centers_within(0, center[0] - half_chord, center[0] + half_chord);
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
            self.for_each_at(z, |_, center, radius| {
                let height = z - center[2];
                let disc = ((radius - height) * (radius + height)).max(0.0).sqrt();
                for_each_line(
                    center[1],
                    disc,
                    dy / lines,
                    grid.shape[1] * samples as usize,
                    |line, half_chord| {
                        let start = line / samples as usize * grid.shape[0];
                        let row = &mut layer[start..start + grid.shape[0]];
                        let ends = [center[0] - half_chord, center[0] + half_chord];
                        add_interval(row, ends.map(|x| x / dx), weight);
                    },
                );
            });
        }
    }

    /// Grains that have not got a voxel in all layers so far.
    pub(super) fn grains_without_voxel(&self) -> u64 {
        let with: u64 = self.seen.iter().map(|bits| u64::from(bits.count_ones())).sum();
        self.spheres.len() as u64 - with
    }
}

/// Calls `visit` with the number and half the chord of each of `n` lines, `step` apart, that meet a disc.
fn for_each_line(center: f64, disc: f64, step: f64, n: usize, mut visit: impl FnMut(usize, f64)) {
    let number = |y: f64| (y / step - 0.5).ceil().clamp(0.0, n as f64) as usize;
    for line in number(center - disc)..number(center + disc) {
        let dy = (line as f64 + 0.5) * step - center;
        visit(line, ((disc - dy) * (disc + dy)).max(0.0).sqrt());
    }
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
