//! What a service asks of an export whose making it leaves to others: whether it takes long, and whether a report that
//! another process has sent with the file can be right. That follows from the packing and the options, without making
//! the export again.

use super::voxels::{self, VoxelFormat, VoxelGrid, VoxelOptions, VoxelReport};
use super::{ExportReport, ExportRequest, ExportType};
use crate::request::Specimen;

/// Largest difference of two sums of the same volumes in another order, relative to the specimen.
const ROUNDING: f64 = 1e-9;

/// Bytes from which on a voxel model is heavy.
const HEAVY_VOXEL_BYTES: u64 = 100_000_000;

impl ExportReport {
    /// The type of export that it is of.
    pub fn export_type(&self) -> ExportType {
        match self {
            Self::Mesh(_) => ExportType::Mesh,
            Self::Voxels(_) => ExportType::Voxels,
            Self::Slice(_) => ExportType::Slice,
            Self::Ldpm(_) => ExportType::Ldpm,
            Self::Certificates(_) => ExportType::Certificates,
            Self::Shapes(_) => ExportType::Shapes,
            Self::Quality(_) => ExportType::Quality,
        }
    }
}

impl ExportRequest {
    /// Whether it may take as long as a packing: then a service makes it, where the request of a job asks for it, in
    /// the slots of packings instead of beside them.
    pub fn is_heavy(&self, specimen: &Specimen) -> bool {
        match self {
            Self::Voxels(options) => {
                voxels::expected_bytes(specimen, options, &voxels::Interfaces::MOST) >= HEAVY_VOXEL_BYTES
            }
            Self::Mesh(_)
            | Self::Slice(_)
            | Self::Ldpm(_)
            | Self::Certificates(_)
            | Self::Shapes(_)
            | Self::Quality(_) => false,
        }
    }

    /// Judges the report of a file of so many bytes, which is said to be this export of a packing with that volume
    /// fraction.
    ///
    /// # Errors
    /// What cannot be, in one sentence.
    pub fn judge(
        &self,
        specimen: &Specimen,
        volume_fraction: f64,
        report: &ExportReport,
        bytes: u64,
    ) -> Result<(), String> {
        let (kind, found) = (self.export_type(), report.export_type());
        if found != kind {
            return Err(format!("the report is one of {:?}: must be of {:?}", found.name(), kind.name()));
        }
        match self {
            Self::Voxels(options) => match report {
                ExportReport::Voxels(report) => {
                    judge_voxels(specimen, options, volume_fraction, report, bytes)
                }
                _ => Ok(()),
            },
            // Made by the server itself.
            Self::Mesh(_)
            | Self::Slice(_)
            | Self::Ldpm(_)
            | Self::Certificates(_)
            | Self::Shapes(_)
            | Self::Quality(_) => Ok(()),
        }
    }
}

/// The grid, the length of a file of labels alone and the exact volume fraction follow from specimen, options and
/// packing.
fn judge_voxels(
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
