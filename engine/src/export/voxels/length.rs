//! How long the file of a grid is, and whether it may be made.

use super::inp::{self, Interfaces};
use super::options::{MAX_CELLS, MAX_HEXAHEDRA, MAX_VOXELS, VoxelFormat, VoxelOptions};
use super::{VoxelGrid, readers, vti};
use crate::export::ExportError;
use crate::plan::Limits;
use crate::request::FieldError;

impl VoxelOptions {
    /// Length of the file, but for a head of a kilobyte; of `zip` the most it can be. `inp` depends on the grains.
    pub(super) fn bytes(&self, grid: &VoxelGrid, grains: &Interfaces) -> u64 {
        match (self.format, self.reader) {
            (VoxelFormat::Vti, Some(_)) => readers::damask_bytes(grid.voxels()),
            (VoxelFormat::Vti, None) => grid.voxels().saturating_mul(vti::bytes_per_voxel(self)),
            (VoxelFormat::Inp, _) => inp::bytes(grid, grains),
            (VoxelFormat::Raw | VoxelFormat::Npy | VoxelFormat::Vtk | VoxelFormat::Zip, _) => {
                grid.voxels().saturating_mul(self.label.bytes())
            }
        }
    }

    /// Judges the size of the grid.
    pub(super) fn check_grid(&self, grid: &VoxelGrid, limits: &Limits) -> Result<(), ExportError> {
        let pointer = if self.voxel_mm.is_some() { "/voxel_mm" } else { "/cells" };
        let refused = |detail: String| {
            let [x, y, z] = grid.shape;
            let detail = format!("{x} x {y} x {z} voxels are {detail}");
            Err(ExportError::TooLarge(FieldError { pointer: pointer.into(), detail }))
        };
        if let Some(n) = grid.shape.into_iter().find(|n| *n > MAX_CELLS as usize) {
            return refused(format!("{n} along an edge: at most {MAX_CELLS} are made"));
        }
        let voxels = grid.voxels();
        let most = if self.format == VoxelFormat::Inp { MAX_HEXAHEDRA } else { MAX_VOXELS };
        let bytes = self.bytes(grid, &Interfaces::MOST);
        let megabytes = |bytes: u64| bytes.div_ceil(1_000_000);
        if voxels > most {
            return refused(format!(
                "{voxels} in all, a file of {} MB: at most {most} are made",
                megabytes(bytes)
            ));
        }
        // Written row by row: the length says nothing about the memory.
        if bytes > limits.max_voxel_file_bytes {
            return refused(format!(
                "a file of {} MB: at most {} MB may be made",
                megabytes(bytes),
                limits.max_voxel_file_bytes / 1_000_000
            ));
        }
        Ok(())
    }
}
