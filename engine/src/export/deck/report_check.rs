//! Whether the report of a deck that a worker process sends with its file can be right.
//!
//! What must hold follows from the packing, the options and the materials, without making the deck again.

use super::options::{DeckElements, DeckOptions};
use super::report::{DeckPhase, DeckReport};
use crate::export::mesh::report_check::{LEAST_OF_CYLINDER, VOLUME_ERROR, check_tetrahedra};
use crate::request::{Materials, Specimen};

/// A deck has the elements, the load and the materials that were requested; its phases and pores fill the specimen.
pub(super) fn check_deck(
    specimen: &Specimen,
    options: &DeckOptions,
    volume_fraction: f64,
    materials: Option<&Materials>,
    report: &DeckReport,
) -> Result<(), String> {
    let (elements, load) = (options.mesh.elements(), options.case.load);
    if (report.elements, report.load) != (elements, load) {
        return Err(format!(
            "the deck has {} under {}: must have {} under {}",
            report.elements.name(),
            report.load.name(),
            elements.name(),
            load.name()
        ));
    }
    let materials = options.case.materials.as_ref().or(materials);
    let is_given = |phase: &DeckPhase| {
        let moduli = (Some(phase.youngs_modulus_gpa), Some(phase.poissons_ratio));
        materials.is_some_and(|given| {
            given.entries().any(|(_, known)| (known.youngs_modulus_gpa, known.poissons_ratio) == moduli)
        })
    };
    if let Some(phase) = report.phases.iter().find(|phase| !is_given(phase)) {
        return Err(format!("the phase {:?} has a material that no request stated", phase.name));
    }
    let counted = report.phases.iter().map(|phase| phase.elements).sum::<u64>();
    if counted != report.number_of_elements {
        return Err(format!("the phases have {counted} elements, all {}", report.number_of_elements));
    }
    let solid: f64 = report.phases.iter().map(|phase| phase.volume_mm3).sum();
    let has_pores = report.pore_elements + report.loose_elements > 0;
    let whole = report.volume_mm3;
    if solid > whole * (1.0 + VOLUME_ERROR) || (!has_pores && solid < whole * (1.0 - VOLUME_ERROR)) {
        return Err(format!("the phases have {solid} mm3 of {whole} mm3"));
    }
    if elements == DeckElements::Triangles {
        return Ok(());
    }
    let filled = whole / specimen.volume_mm3();
    // Voxels stand out of a round surface, and tetrahedra stay within it.
    let is_curved = specimen.domain().lateral().is_some();
    let slack = if is_curved { 1.0 - LEAST_OF_CYLINDER } else { VOLUME_ERROR };
    if (filled - 1.0).abs() > slack {
        return Err(format!("the mesh has {filled} of the volume of the specimen"));
    }
    match &report.tetrahedra {
        Some(tetrahedra) => check_tetrahedra(specimen, volume_fraction, false, tetrahedra),
        None => Ok(()),
    }
}
