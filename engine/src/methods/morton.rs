//! The order of grains along a Morton curve, so that neighbours in space are neighbours in memory.

use crate::memory::{OutOfMemory, reserved};

/// The numbers of points of the unit cube in their order along the curve. Points outside belong to its surface.
///
/// # Errors
/// When the system refuses memory.
pub(super) fn order(points: impl ExactSizeIterator<Item = [f64; 3]>) -> Result<Vec<u32>, OutOfMemory> {
    // First what stays.
    let mut order = reserved(points.len())?;
    let mut keyed: Vec<(u32, u32)> = reserved(points.len())?;
    keyed.extend(points.map(place).zip(0..));
    keyed.sort_unstable();
    order.extend(keyed.iter().map(|(_, number)| *number));
    Ok(order)
}

/// Place of a point among the 2^30 of the curve.
fn place(p: [f64; 3]) -> u32 {
    let mut key = 0;
    for (axis, x) in p.into_iter().enumerate() {
        let cell = ((x * 1024.0) as u32).min(1023);
        for bit in 0..10 {
            key |= (cell >> bit & 1) << (3 * bit + axis as u32);
        }
    }
    key
}
