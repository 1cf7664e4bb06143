//! Where planes cut the specimen, and what a grain reaches into.

use rand_xoshiro::Xoshiro256PlusPlus;

use crate::elementary::cbrt;
use crate::memory::{OutOfMemory, collected};
use crate::methods::edmd::system::System;
use crate::rng::uniform;

/// Grains of a block: with their lists they fit in the caches of one core.
const GRAINS_PER_BLOCK: f64 = 10_000.0;
/// Least distance of two planes in largest diameters, so that most of the largest grains are not cut.
const LEAST_SPACING: f64 = 2.5;
/// With walls, planes keep this share of their distance from the outermost walls.
const FROM_WALLS: f64 = 0.25;

/// The planes across one axis.
#[derive(Clone, Debug, PartialEq)]
struct Axis {
    planes: Vec<f64>,
    length: f64,
    is_periodic: bool,
}

/// The planes across all axes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cuts([Axis; 3]);

/// A block that a grain reaches into along an axis, and its place there from the low end of the block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reached {
    pub(super) block: usize,
    pub(super) place: f64,
}

/// How many planes cut each axis. One cuts a periodic axis at least, because blocks are not periodic.
fn numbers_of_planes(system: &System) -> [usize; 3] {
    let bounds = system.container.bounds_mm();
    let largest = system.hot.iter().map(|hot| hot.radius).fold(0.0, f64::max);
    let volume: f64 = bounds.iter().product();
    let spacing = cbrt(volume * GRAINS_PER_BLOCK / system.len() as f64);
    let is_periodic = system.container.is_periodic();
    // So many that there is more than one block.
    let fewest = 1 + usize::from(is_periodic);
    bounds.map(|length| {
        let most = (length / (2.0 * LEAST_SPACING * largest)) as usize;
        ((length / spacing).round() as usize).max(fewest).min(most).max(usize::from(is_periodic))
    })
}

/// Blocks that a specimen is cut into.
pub(super) fn number_of_blocks(system: &System) -> usize {
    let beyond = usize::from(!system.container.is_periodic());
    numbers_of_planes(system).iter().map(|planes| planes + beyond).product()
}

impl Cuts {
    /// Planes at equal distances, from a random first one.
    pub(super) fn choose(system: &System, rng: &mut Xoshiro256PlusPlus) -> Self {
        let bounds = system.container.bounds_mm();
        let is_periodic = system.container.is_periodic();
        let numbers = numbers_of_planes(system);
        let mut axis = |a: usize| {
            let (length, count) = (bounds[a], numbers[a]);
            let spacing = length / count as f64;
            let drawn = uniform(rng);
            let first = if is_periodic { drawn } else { FROM_WALLS + (1.0 - 2.0 * FROM_WALLS) * drawn };
            let planes = (0..count).map(|k| (k as f64 + first) * spacing).collect();
            Axis { planes, length, is_periodic }
        };
        Self([axis(0), axis(1), axis(2)])
    }

    /// Blocks along each axis.
    pub(super) fn blocks(&self) -> [usize; 3] {
        [self.0[0].blocks(), self.0[1].blocks(), self.0[2].blocks()]
    }

    /// Low end and length of a block along an axis.
    pub(super) fn extent(&self, axis: usize, block: usize) -> (f64, f64) {
        self.0[axis].extent(block)
    }

    /// Whether the low and the high end of a block along an axis are planes, and not walls of the specimen.
    pub(super) fn are_faces(&self, axis: usize, block: usize) -> [bool; 2] {
        let axis = &self.0[axis];
        [axis.is_periodic || block > 0, axis.is_periodic || block + 1 < axis.blocks()]
    }

    /// Finds the blocks along an axis that a grain reaches into; more than one if a plane cuts it.
    pub(super) fn reach(&self, axis: usize, x: f64, radius: f64, found: &mut Vec<Reached>) {
        let axis = &self.0[axis];
        found.clear();
        let count = axis.blocks();
        let below = axis.planes.partition_point(|&plane| plane <= x);
        let block = if axis.is_periodic { (below + count - 1) % count } else { below };
        let (low, length) = axis.extent(block);
        let place = if x < low && axis.is_periodic { x - low + axis.length } else { x - low };
        found.push(Reached { block, place });
        if place < radius && (axis.is_periodic || block > 0) {
            let block = (block + count - 1) % count;
            found.push(Reached { block, place: axis.extent(block).1 + place });
        }
        if length - place < radius && (axis.is_periodic || block + 1 < count) {
            found.push(Reached { block: (block + 1) % count, place: place - length });
        }
    }
}

impl Axis {
    fn blocks(&self) -> usize {
        if self.is_periodic { self.planes.len() } else { self.planes.len() + 1 }
    }

    fn extent(&self, block: usize) -> (f64, f64) {
        let (planes, count) = (&self.planes, self.planes.len());
        let (low, high) = if self.is_periodic {
            (planes[block], if block + 1 < count { planes[block + 1] } else { planes[0] + self.length })
        } else {
            let low = if block == 0 { 0.0 } else { planes[block - 1] };
            (low, if block < count { planes[block] } else { self.length })
        };
        (low, high - low)
    }
}

/// The numbers of all blocks along the axes, the last axis fastest.
pub(super) fn all_blocks([x, y, z]: [usize; 3]) -> Result<Vec<[usize; 3]>, OutOfMemory> {
    collected((0..x * y * z).map(|k| [k / (y * z), k / z % y, k % z]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_tile_an_axis_and_a_grain_reaches_into_those_on_both_sides_of_a_plane() {
        for is_periodic in [false, true] {
            let axis = Axis { planes: vec![2.0, 5.0, 8.0], length: 10.0, is_periodic };
            let total: f64 = (0..axis.blocks()).map(|block| axis.extent(block).1).sum();
            assert_eq!((axis.blocks(), total), (if is_periodic { 3 } else { 4 }, 10.0));
            let cuts = Cuts([axis.clone(), axis.clone(), axis]);
            let reached = |x: f64| {
                let mut found = Vec::new();
                cuts.reach(0, x, 0.5, &mut found);
                found.iter().map(|reached| (reached.block, reached.place)).collect::<Vec<_>>()
            };
            let number = |block: usize| if is_periodic { (block + 2) % 3 } else { block };
            assert_eq!(reached(3.0), [(number(1), 1.0)]);
            assert_eq!(reached(5.25), [(number(2), 0.25), (number(1), 3.25)]);
            assert_eq!(reached(7.75), [(number(2), 2.75), (number(3), -0.25)]);
            // The ends of a periodic axis are no faces.
            assert_eq!(reached(0.25), [(number(0), if is_periodic { 2.25 } else { 0.25 })]);
            assert_eq!(cuts.are_faces(0, 0), [is_periodic, true]);
        }
    }
}
