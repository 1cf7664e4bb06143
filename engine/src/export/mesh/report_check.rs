//! Whether the report of a mesh that a worker process sends with its file can be right.
//!
//! What must hold follows from the packing and the options, without making the mesh again.

use super::options::VolumeCorrection;
use super::tetrahedra::TetrahedronReport;
use super::{MeshReport, MeshRequest};
use crate::request::Specimen;

/// Largest relative error of a volume.
pub(in crate::export) const VOLUME_ERROR: f64 = 1e-6;
/// Largest relative difference of the volume of the aggregates in a mesh to that of the grains.
const AGGREGATE_ERROR: f64 = 1e-2;
/// Least share of a cylinder that a coarse mesh of it has: that of a prism with six faces.
pub(in crate::export) const LEAST_OF_CYLINDER: f64 = 0.82;

/// Tetrahedra fill the specimen, and those of the aggregates have the volume of the grains where nothing keeps the
/// polyhedra from it.
pub(super) fn check_mesh(
    specimen: &Specimen,
    mesh: &MeshRequest,
    volume_fraction: f64,
    report: &MeshReport,
) -> Result<(), String> {
    let Some(surfaces) = report.surfaces() else { return Ok(()) };
    if mesh.tetrahedra().is_some() != surfaces.tetrahedra.is_some() {
        return Err("the report has tetrahedra, or has none, where the options say otherwise".into());
    }
    let Some(tetrahedra) = &surfaces.tetrahedra else { return Ok(()) };
    let is_scaled = mesh.surfaces().is_some_and(|of| of.volume_correction == VolumeCorrection::Scaled)
        && surfaces.grains_short_of_volume == 0;
    check_tetrahedra(specimen, volume_fraction, is_scaled, tetrahedra)
}

/// The volumes of tetrahedra. A cylinder has a polygonal surface, which is inside of the round one.
pub(in crate::export) fn check_tetrahedra(
    specimen: &Specimen,
    volume_fraction: f64,
    is_scaled: bool,
    report: &TetrahedronReport,
) -> Result<(), String> {
    let whole = specimen.volume_mm3();
    let volumes = report.phases.iter().map(|phase| phase.volume_mm3);
    let is_curved = specimen.domain().lateral().is_some();
    let least = if is_curved { LEAST_OF_CYLINDER } else { 1.0 - VOLUME_ERROR };
    let filled = volumes.clone().sum::<f64>() / whole;
    let is_as_told = (filled - 1.0 - report.specimen_volume_error).abs() <= VOLUME_ERROR;
    if !(least..=1.0 + VOLUME_ERROR).contains(&filled) || !is_as_told {
        return Err(format!(
            "the tetrahedra have {filled} of the volume of the specimen, and an error of {} is told",
            report.specimen_volume_error
        ));
    }
    let aggregates = volumes.skip(1).sum::<f64>() / whole;
    let least = if is_scaled { volume_fraction * (1.0 - AGGREGATE_ERROR) } else { 0.0 };
    if !(least..=volume_fraction * (1.0 + AGGREGATE_ERROR)).contains(&aggregates) {
        return Err(format!(
            "the tetrahedra of the aggregates have the share {aggregates}: must be {volume_fraction}"
        ));
    }
    let counted: u64 = report.phases.iter().map(|phase| phase.elements).sum();
    if counted != report.elements {
        return Err(format!("the phases have {counted} tetrahedra, all {}", report.elements));
    }
    Ok(())
}
