//! What a service asks of an export whose making it leaves to others: whether it takes long, and whether a report that
//! another process has sent with the file can be right. That follows from the packing and the options, without making
//! the export again.

use super::properties::PropertyReport;
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
            Self::Deck(_) => ExportType::Deck,
            Self::Ldpm(_) => ExportType::Ldpm,
            Self::Certificates(_) => ExportType::Certificates,
            Self::Shapes(_) => ExportType::Shapes,
            Self::Quality(_) => ExportType::Quality,
            Self::Properties(_) => ExportType::Properties,
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
            Self::Properties(_) => true,
            Self::Mesh(_)
            | Self::Slice(_)
            | Self::Deck(_)
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
            Self::Properties(_) => match report {
                ExportReport::Properties(report) => judge_properties(volume_fraction, report),
                _ => Ok(()),
            },
            // Made by the server itself.
            Self::Mesh(_)
            | Self::Slice(_)
            | Self::Deck(_)
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

/// The shares of the phases are those of the packing, the stiffness is symmetric, and conductivities along the axes lie
/// between their bounds, within the tolerance of the solver.
fn judge_properties(volume_fraction: f64, report: &PropertyReport) -> Result<(), String> {
    let exact: f64 = report.phases.iter().skip(1).map(|phase| phase.exact_share).sum();
    if (exact - volume_fraction).abs() > ROUNDING {
        return Err(format!("the aggregates have the share {exact}: must be {volume_fraction}"));
    }
    let slack = 1e-6 + report.tolerance;
    if let Some(found) = &report.stiffness {
        let matrix = &found.stiffness_gpa;
        let most = matrix.iter().flatten().fold(0.0_f64, |most, value| most.max(value.abs()));
        if (0..6).any(|i| (0..i).any(|j| (matrix[i][j] - matrix[j][i]).abs() > slack * most)) {
            return Err("the stiffness is not symmetric".into());
        }
    }
    for found in report.conductivity.iter().chain(&report.diffusivity) {
        let (low, high) = (found.bounds.reuss, found.bounds.voigt);
        let is_between = |value: f64| value >= low * (1.0 - slack) && value <= high * (1.0 + slack);
        if !(0..3).all(|i| is_between(found.matrix[i][i])) {
            return Err(format!("a conductivity lies outside of its bounds, {low} to {high}"));
        }
    }
    Ok(())
}
