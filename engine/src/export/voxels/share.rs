//! Volume of the grains: exactly, and as the lines through the voxels measure it.

use std::f64::consts::PI;
use std::ops::Range;

use super::VoxelGrid;
use crate::control::Control;
use crate::export::{ExportError, SphereModel, go_on};
use crate::packing::Spheres;

/// Lines between two looks at whether to stop; a millisecond or so.
const LINES_PER_LOOK: i64 = 1 << 18;

/// Volume of all grains.
pub(super) fn exact_mm3(spheres: &Spheres) -> f64 {
    spheres.d_mm.iter().map(|d| PI / 6.0 * d * d * d).sum()
}

/// Volume of all grains by lines along x, samples² through each voxel: the sum of all voxels' shares.
///
/// The lines of a periodic box meet those of its neighbours, so that a grain that crosses its faces is measured
/// in one piece.
pub(super) fn volume_mm3(
    model: &SphereModel<'_>,
    grid: &VoxelGrid,
    samples: u32,
    control: &dyn Control,
) -> Result<f64, ExportError> {
    let [_, dy, dz] = grid.spacing_mm.map(|spacing| spacing / f64::from(samples));
    let spheres = model.spheres;
    let (mut length, mut lines) = (0.0, 0);
    for grain in 0..spheres.len() {
        let ([_, y, z], radius) = (spheres.center(grain), spheres.d_mm[grain] / 2.0);
        let mut grain_length = 0.0;
        for plane in lines_within(z, radius, dz) {
            let disc = half_chord(radius, (plane as f64 + 0.5) * dz - z);
            let within = lines_within(y, disc, dy);
            lines += within.end - within.start + 1;
            grain_length +=
                within.map(|line| 2.0 * half_chord(disc, (line as f64 + 0.5) * dy - y)).sum::<f64>();
            if lines >= LINES_PER_LOOK {
                lines = 0;
                go_on(control)?;
            }
        }
        length += grain_length;
    }
    Ok(length * dy * dz)
}

/// Numbers of the lines, `step` apart, that meet a disc.
fn lines_within(center: f64, radius: f64, step: f64) -> Range<i64> {
    let number = |y: f64| (y / step - 0.5).ceil() as i64;
    number(center - radius)..number(center + radius)
}

/// Half the chord of a disc at a distance from its centre.
fn half_chord(radius: f64, distance: f64) -> f64 {
    ((radius - distance) * (radius + distance)).max(0.0).sqrt()
}
