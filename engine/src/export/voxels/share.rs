//! Volume of the grains: exactly, and as the lines through the voxels measure it.

use std::ops::Range;

use super::Work;
use crate::arrays::Each as _;
use crate::control::Control;
use crate::export::pieces::{in_order, slots};
use crate::export::{ExportError, go_on};
use crate::grain::{Grain as _, PlacedGrains, RowLines};
use crate::memory::{OutOfMemory, make_room};

/// Lines of a piece of the work, where one grain has not more: a tenth of a millisecond for spheres, a few milliseconds
/// for rounded polyhedra.
const LINES_PER_PIECE: f64 = 16_384.0;
/// Lines between two looks at whether to stop, within a grain.
const LINES_PER_LOOK: i64 = 1 << 16;

/// Volume of all grains.
pub(super) fn exact_mm3(grains: &PlacedGrains<'_>) -> f64 {
    (0..grains.len()).map(|grain| grains.grain(grain).volume_mm3()).sum()
}

/// Volume of all grains by lines along x, samples² through each voxel: the sum of all voxels' shares.
///
/// The lines of a periodic box meet those of its neighbours, so that a grain that crosses its faces is measured
/// in one piece.
pub(super) fn volume_mm3(work: &Work<'_>, samples: u32) -> Result<f64, ExportError> {
    let (placed, control) = (work.bodies.grains, work.control);
    let [_, dy, dz] = work.bodies.grid.spacing_mm.each(|spacing| spacing / f64::from(samples));
    let ends = ends_of_pieces(placed, [dy, dz])?;
    let grains = |piece: usize| piece.checked_sub(1).map_or(0, |before| ends[before])..ends[piece];
    let mut length = 0.0;
    in_order(
        &mut slots(work.threads, ends.len(), <(Vec<f64>, RowLines)>::default),
        ends.len(),
        |piece, (lengths, lines)| {
            lengths.clear();
            make_room(lengths, grains(piece).len())?;
            for grain in grains(piece) {
                lengths.push(length_of(placed, grain, [dy, dz], lines, control)?);
            }
            Ok(())
        },
        |_, (lengths, _)| {
            length = lengths.iter().fold(length, |sum, of_grain| sum + of_grain);
            go_on(control)
        },
    )?;
    Ok(length * dy * dz)
}

/// The first grain after each piece of the work.
fn ends_of_pieces(grains: &PlacedGrains<'_>, [dy, dz]: [f64; 2]) -> Result<Vec<usize>, OutOfMemory> {
    let (mut ends, mut lines) = (Vec::new(), 0.0);
    for grain in 0..grains.len() {
        let [_, half_y, half_z] = grains.grain(grain).half_extents_mm();
        lines += (1.0 + 2.0 * half_y / dy) * (1.0 + 2.0 * half_z / dz);
        if lines >= LINES_PER_PIECE || grain + 1 == grains.len() {
            make_room(&mut ends, 1)?;
            ends.push(grain + 1);
            lines = 0.0;
        }
    }
    Ok(ends)
}

/// Length of all lines in a grain.
fn length_of(
    grains: &PlacedGrains<'_>,
    grain: usize,
    [dy, dz]: [f64; 2],
    scratch: &mut RowLines,
    control: &dyn Control,
) -> Result<f64, ExportError> {
    let (center, half) = (grains.center_mm(grain), grains.grain(grain).half_extents_mm());
    let (mut length, mut lines) = (0.0, 0);
    for plane in lines_within([center[2] - half[2], center[2] + half[2]], dz) {
        let section = grains.rows(grain, center, (plane as f64 + 0.5) * dz - center[2], scratch);
        let within = lines_within(section.y(), dy);
        lines += within.end - within.start + 1;
        length += within.map(|line| section.length_at((line as f64 + 0.5) * dy)).sum::<f64>();
        if lines >= LINES_PER_LOOK {
            lines = 0;
            go_on(control)?;
        }
    }
    Ok(length)
}

/// Numbers of the lines, `step` apart, that lie between two coordinates.
fn lines_within([low, high]: [f64; 2], step: f64) -> Range<i64> {
    let number = |y: f64| (y / step - 0.5).ceil() as i64;
    number(low)..number(high)
}
