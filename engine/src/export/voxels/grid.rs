//! The grid: how many voxels of which size, and which of them lie inside a cylinder.

use std::ops::Range;

use super::VoxelOptions;
use super::options::DEFAULT_CELLS;
use crate::arrays::Each as _;
use crate::domain::Lateral;
use crate::request::Specimen;

/// A grid that fills the specimen's bounding box exactly.
#[derive(Clone, Debug, PartialEq)]
pub struct VoxelGrid {
    /// Voxels along x, y, z.
    pub shape: [usize; 3],
    /// Edges of a voxel.
    pub spacing_mm: [f64; 3],
    /// Edges of the whole.
    pub size_mm: [f64; 3],
    /// For each row along x the voxels whose centres lie inside; all of them in a box. The same in all layers.
    rows: Option<Vec<Range<usize>>>,
}

impl VoxelGrid {
    /// Voxels as near to cubes as whole numbers of them allow.
    pub fn new(specimen: &Specimen, options: &VoxelOptions) -> Self {
        let target = options.voxel_mm;
        target.map_or_else(
            || Self::of_cells(specimen, options.cells.unwrap_or(DEFAULT_CELLS)),
            |target| Self::of_edges(specimen, target),
        )
    }

    /// This many voxels along the longest edge of the specimen.
    pub fn of_cells(specimen: &Specimen, cells: u32) -> Self {
        let longest = specimen.bounds_mm().into_iter().fold(0.0, f64::max);
        Self::of_edges(specimen, longest / f64::from(cells))
    }

    /// Voxels with edges near a length in mm.
    fn of_edges(specimen: &Specimen, target: f64) -> Self {
        let bounds = specimen.bounds_mm();
        let shape = bounds.each(|length| (length / target).round().max(1.0) as usize);
        let spacing_mm = [0, 1, 2].each(|a| bounds[a] / shape[a] as f64);
        Self { shape, spacing_mm, size_mm: bounds, rows: None }.cut(specimen)
    }

    /// Leaves out what lies outside of a cylinder.
    fn cut(mut self, specimen: &Specimen) -> Self {
        // A grid that will be refused for its size has no rows to speak of.
        if let Some(Lateral { center_mm: [x, y], radius_mm: radius }) = specimen.domain().lateral()
            && self.shape[1] <= super::MAX_CELLS as usize
        {
            let inside = |j: usize| {
                let dy = self.center(1, j) - y;
                let half_chord = ((radius - dy) * (radius + dy)).max(0.0).sqrt();
                self.centers_within(0, x - half_chord, x + half_chord)
            };
            self.rows = Some((0..self.shape[1]).map(inside).collect());
        }
        self
    }

    /// Number of voxels, those outside of a cylinder included; saturates.
    pub fn voxels(&self) -> u64 {
        self.shape.iter().fold(1, |product: u64, n| product.saturating_mul(*n as u64))
    }

    /// Volume of a voxel.
    pub fn voxel_mm3(&self) -> f64 {
        self.spacing_mm.iter().product()
    }

    /// Centre of a voxel along one axis.
    pub(in crate::export) fn center(&self, axis: usize, i: usize) -> f64 {
        (i as f64 + 0.5) * self.spacing_mm[axis]
    }

    /// Corner of a voxel along one axis; that of the one past the last is the specimen's end, exactly.
    pub(in crate::export) fn corner(&self, axis: usize, i: usize) -> f64 {
        self.size_mm[axis] * i as f64 / self.shape[axis] as f64
    }

    /// The voxels whose centres lie in `low..=high`, along one axis.
    pub(in crate::export) fn centers_within(&self, axis: usize, low: f64, high: f64) -> Range<usize> {
        let (n, spacing) = (self.shape[axis], self.spacing_mm[axis]);
        let first = ceil_within(low / spacing - 0.5, n);
        let last = high / spacing - 0.5;
        let end = if last < 0.0 { 0 } else { (last.min(n as f64) as usize + 1).min(n) };
        first..end.max(first)
    }

    /// The voxels of a row along x that are inside the specimen.
    pub(super) fn inside(&self, j: usize) -> Range<usize> {
        self.rows.as_ref().map_or(0..self.shape[0], |rows| rows[j].clone())
    }

    /// Whether all voxels are inside the specimen.
    pub(super) fn is_full(&self) -> bool {
        self.rows.is_none()
    }

    /// Voxels of a layer that are inside the specimen.
    pub(super) fn inside_per_layer(&self) -> u64 {
        (0..self.shape[1]).map(|j| self.inside(j).len() as u64).sum()
    }

    /// Sets what lies outside of the specimen, in some rows of a layer.
    pub(super) fn fill_outside<T: Copy>(&self, rows: Range<usize>, voxels: &mut [T], value: T) {
        if self.is_full() {
            return;
        }
        for (j, row) in rows.zip(voxels.chunks_exact_mut(self.shape[0])) {
            let inside = self.inside(j);
            row[..inside.start].fill(value);
            row[inside.end..].fill(value);
        }
    }
}

/// The least whole number that is not below a number, of those up to `n`. `f64::ceil` is a call of a library.
pub(super) fn ceil_within(x: f64, n: usize) -> usize {
    let x = x.clamp(0.0, n as f64);
    let below = x as usize;
    below + usize::from((below as f64) < x)
}

#[cfg(test)]
mod tests {
    use crate::properties::properties;
    use proptest::prelude::*;

    use super::*;

    properties! {
        #[test]
        fn voxels_are_those_of_the_functions_of_the_library(
            n in 1_usize..9000, low in -2.0..2.0_f64, length in -0.1..3.0_f64, at_centers in any::<bool>(),
        ) {
            let spacing_mm = [0.37; 3];
            let grid = VoxelGrid { shape: [n; 3], spacing_mm, size_mm: [0.37 * n as f64; 3], rows: None };
            let mut ends = [low, low + length].map(|x| x * grid.size_mm[0]);
            if at_centers {
                ends = ends.map(|x| ((x / 0.37).floor() + 0.5) * 0.37);
            }
            let [low, high] = ends;
            let n = n as f64;
            let first = (low / 0.37 - 0.5).ceil().clamp(0.0, n);
            let end = ((high / 0.37 - 0.5).floor() + 1.0).clamp(first, n);
            prop_assert_eq!(grid.centers_within(0, low, high), first as usize..end as usize);
        }
    }
}
