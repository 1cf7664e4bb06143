//! Whether the report of a grid that a worker process sends with its file can be right.
//!
//! What must hold follows from the packing and the options, without making the grid again.

use super::options::{VoxelFormat, VoxelOptions};
use super::{VoxelGrid, VoxelReport};
use crate::request::Specimen;

/// Largest difference of two sums of the same volumes in another order, relative to the specimen.
const ROUNDING: f64 = 1e-9;

/// The grid, the length of a file of labels alone and the exact volume fraction follow from specimen, options and
/// packing.
pub(super) fn check_voxels(
    specimen: &Specimen,
    options: &VoxelOptions,
    volume_fraction: f64,
    report: &VoxelReport,
    bytes: u64,
) -> Result<(), String> {
    let grid = VoxelGrid::new(specimen, options);
    let expected = grid.voxels().saturating_mul(options.label.bytes());
    if options.format == VoxelFormat::Raw && options.reader.is_none() && bytes != expected {
        return Err(format!("the file has {bytes} bytes: must have {expected}"));
    }
    let shape = grid.shape.map(|n| n as u64);
    if report.shape != shape {
        return Err(format!("the grid has {:?} voxels: must have {shape:?}", report.shape));
    }
    let found = report.volume_fraction;
    if (found - volume_fraction).abs() > ROUNDING {
        return Err(format!("the grains have the volume fraction {found}: must be {volume_fraction}"));
    }
    let labels = report.aggregate_voxels as f64 / report.inside_voxels as f64;
    if report.aggregate_voxels > report.inside_voxels
        || (report.volume_fraction_labels - labels).abs() > ROUNDING
    {
        return Err(format!(
            "{} of {} voxels lie in grains, a fraction of {}",
            report.aggregate_voxels, report.inside_voxels, report.volume_fraction_labels
        ));
    }
    Ok(())
}
