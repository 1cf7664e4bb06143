//! Whether the report of a mesh, a deck or a cut that a worker process sends can be right: the volumes of the phases,
//! elements, loads and materials ([`report_check`](super::report_check)).

use super::deck::{DeckElements, DeckOptions, DeckPhase, DeckReport};
use super::mesh::{MeshReport, MeshRequest, TetrahedronReport, VolumeCorrection};
use super::slice::SliceReport;
use crate::request::{Materials, Specimen};

/// Largest relative error of a volume or an area.
const VOLUME_ERROR: f64 = 1e-6;
/// Largest relative difference of the volume of the aggregates in a mesh to that of the grains.
const AGGREGATE_ERROR: f64 = 1e-2;
/// Least share of a cylinder that a coarse mesh of it has: that of a prism with six faces.
const LEAST_OF_CYLINDER: f64 = 0.82;

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
fn check_tetrahedra(
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

/// The areas of a cut agree.
pub(super) fn check_slice(report: &SliceReport) -> Result<(), String> {
    let share = report.aggregate_area_mm2 / report.area_mm2;
    if !(0.0..=1.0 + VOLUME_ERROR).contains(&share) || (report.area_fraction - share).abs() > VOLUME_ERROR {
        return Err(format!(
            "the aggregates have {} of {} mm2, a share of {}",
            report.aggregate_area_mm2, report.area_mm2, report.area_fraction
        ));
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::{Value, json};

    use crate::Unattended;
    use crate::export::{ExportReport, ExportRequest, Model};
    use crate::packing::Spheres;
    use crate::plan::Limits;
    use crate::request::{Boundary, Specimen};

    const BOX: Specimen = Specimen::cuboid([10.0; 3], Boundary::Walls);
    /// That of a ball of 6 mm in the box.
    const VOLUME_FRACTION: f64 = std::f64::consts::PI / 6.0 * 0.216;

    type Change = fn(&mut Value);

    /// Judges a report with one place changed.
    fn checked(export: &ExportRequest, report: &Value, change: Change) -> Result<(), String> {
        let mut report = report.clone();
        change(&mut report);
        let report: ExportReport = serde_json::from_value(report).unwrap();
        export.check_report(&BOX, VOLUME_FRACTION, None, &report, 1)
    }

    fn refuses(export: &ExportRequest, report: &Value, changes: &[(&str, Change)]) {
        checked(export, report, |_| {}).unwrap();
        for (says, change) in changes {
            let fault = checked(export, report, *change).unwrap_err();
            assert!(fault.contains(says), "{says}: {fault}");
        }
    }

    fn request(options: &Value) -> ExportRequest {
        ExportRequest::from_json(options).unwrap()
    }

    /// The report of a file that is made of a ball in the box.
    fn made(export: &ExportRequest) -> Value {
        let mut ball = Spheres::default();
        ball.push([5.0; 3], 6.0);
        let model = Model::new(&BOX, &ball);
        let report = export.write(&model, &Limits::default(), &Unattended, &mut Vec::new()).unwrap();
        serde_json::to_value(report).unwrap()
    }

    #[test]
    fn tetrahedra_that_do_not_fill_the_box_or_the_grains_are_refused() {
        let export = request(&json!({"type": "mesh", "format": "inp"}));
        let aggregates = VOLUME_FRACTION * 1000.0;
        let phase = |name: &str, elements: u64, volume_mm3: f64| json!({"name": name, "elements": elements, "volume_mm3": volume_mm3});
        // As the export has it, which needs a mesher.
        let report = json!({
            "type": "mesh", "format": "inp", "grains": 1, "nodes": 300, "triangles": 500, "shortest_edge_mm": 0.5,
            "longest_edge_mm": 2, "specimen_volume_mm3": 1000, "specimen_volume_error": 0,
            "aggregate_volume_mm3": aggregates, "aggregate_volume_error": 0, "grains_short_of_volume": 0,
            "tetrahedra": {
                "elements": 900, "runs": 1, "nodes": 300, "degrees_of_freedom": 900, "smallest_gamma": 0.2,
                "elements_below_gamma_0_03": 0, "specimen_volume_error": 0, "largest_grain_volume_error": 0,
                "phases": [phase("matrix", 600, 1000.0 - aggregates), phase("aggregates", 300, aggregates)],
                "mesher": "Gmsh 4.15.2", "mesher_options": []
            },
        });
        refuses(
            &export,
            &report,
            &[
                ("of the volume of the specimen", |report| {
                    report["tetrahedra"]["phases"][0]["volume_mm3"] = json!(800);
                }),
                ("of the volume of the specimen", |report| {
                    report["tetrahedra"]["specimen_volume_error"] = json!(0.01);
                }),
                ("the aggregates have the share", |report| {
                    report["tetrahedra"]["phases"][0]["volume_mm3"] = json!(900);
                    report["tetrahedra"]["phases"][1]["volume_mm3"] = json!(100);
                }),
                ("the aggregates have the share", |report| {
                    report["tetrahedra"]["phases"][0]["volume_mm3"] = json!(880);
                    report["tetrahedra"]["phases"][1]["volume_mm3"] = json!(120);
                }),
                ("900", |report| report["tetrahedra"]["phases"][0]["elements"] = json!(601)),
                ("the options say otherwise", |report| {
                    report.as_object_mut().unwrap().remove("tetrahedra");
                }),
            ],
        );
        // Polyhedra that are inscribed are smaller.
        let inscribed = json!({"type": "mesh", "format": "inp", "volume_correction": "none"});
        checked(&request(&inscribed), &report, |report| {
            report["tetrahedra"]["phases"][0]["volume_mm3"] = json!(900);
            report["tetrahedra"]["phases"][1]["volume_mm3"] = json!(100);
        })
        .unwrap();
    }

    #[test]
    fn decks_of_other_materials_loads_and_volumes_are_refused() {
        let of = |e: f64| json!({"youngs_modulus_gpa": e, "poissons_ratio": 0.2});
        let materials = json!({"matrix": of(25.0), "aggregate": of(70.0)});
        let options = json!({"type": "deck", "cells": 10, "materials": materials});
        let export = request(&options);
        let report = made(&export);
        refuses(
            &export,
            &report,
            &[
                ("uniaxial_z", |report| report["load"] = json!("uniaxial_x")),
                ("voxels", |report| report["elements"] = json!("tetrahedra")),
                ("that no request stated", |report| report["phases"][1]["youngs_modulus_gpa"] = json!(700)),
                ("that no request stated", |report| report["phases"][0]["poissons_ratio"] = json!(0.3)),
                ("elements, all", |report| report["number_of_elements"] = json!(999)),
                ("mm3 of", |report| report["phases"][0]["volume_mm3"] = json!(1)),
                ("of the volume of the specimen", |report| {
                    report["volume_mm3"] = json!(2000);
                    report["pore_elements"] = json!(1);
                }),
            ],
        );
        // The volume of pores is not that of a phase.
        let pores =
            json!({"type": "deck", "cells": 10, "materials": {"matrix": of(25.0), "aggregate": of(0.0)}});
        let pores = request(&pores);
        checked(&pores, &made(&pores), |_| {}).unwrap();
    }

    #[test]
    fn areas_of_a_cut_that_do_not_agree_are_refused() {
        let export = request(&json!({"type": "slice", "format": "json"}));
        refuses(
            &export,
            &made(&export),
            &[
                ("of 100 mm2", |report| report["area_fraction"] = json!(0.9)),
                ("of 100 mm2", |report| report["aggregate_area_mm2"] = json!(101)),
            ],
        );
    }
}
