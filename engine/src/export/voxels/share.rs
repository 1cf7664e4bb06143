//! Volume of the grains: exactly, and as the lines through the voxels measure it.

use std::ops::Range;

use super::VoxelGrid;
use crate::arrays::Each as _;
use crate::control::Control;
use crate::export::solids::Sectioned;
use crate::export::{ExportError, go_on};

/// Lines between two looks at whether to stop; a millisecond or so.
const LINES_PER_LOOK: i64 = 1 << 18;

/// Volume of all grains.
pub(super) fn exact_mm3(solids: &Sectioned<'_>) -> f64 {
    (0..solids.len()).map(|grain| solids.volume_mm3(grain)).sum()
}

/// Volume of all grains by lines along x, samples² through each voxel: the sum of all voxels' shares.
///
/// The lines of a periodic box meet those of its neighbours, so that a grain that crosses its faces is measured
/// in one piece.
pub(super) fn volume_mm3(
    solids: &Sectioned<'_>,
    grid: &VoxelGrid,
    samples: u32,
    control: &dyn Control,
) -> Result<f64, ExportError> {
    let [_, dy, dz] = grid.spacing_mm.each(|spacing| spacing / f64::from(samples));
    let (mut length, mut lines) = (0.0, 0);
    for grain in 0..solids.len() {
        let (center, half) = (solids.center(grain), solids.half_extents(grain));
        let mut grain_length = 0.0;
        for plane in lines_within([center[2] - half[2], center[2] + half[2]], dz) {
            let section = solids.section(grain, center, (plane as f64 + 0.5) * dz - center[2]);
            let within = lines_within(section.y(), dy);
            lines += within.end - within.start + 1;
            grain_length += within.map(|line| section.length_at((line as f64 + 0.5) * dy)).sum::<f64>();
            if lines >= LINES_PER_LOOK {
                lines = 0;
                go_on(control)?;
            }
        }
        length += grain_length;
    }
    Ok(length * dy * dz)
}

/// Numbers of the lines, `step` apart, that lie between two coordinates.
fn lines_within([low, high]: [f64; 2], step: f64) -> Range<i64> {
    let number = |y: f64| (y / step - 0.5).ceil() as i64;
    number(low)..number(high)
}
