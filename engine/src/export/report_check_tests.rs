//! Reports of other processes are accepted as they were made, and refused with a figure that cannot be right.

use serde_json::{Value, json};

use super::{ExportReport, ExportRequest};
use crate::Unattended;
use crate::export::Model;
use crate::packing::Spheres;
use crate::plan::Limits;
use crate::request::{Boundary, Specimen};

const BOX: Specimen = Specimen::cuboid([10.0; 3], Boundary::Walls);
const CELL: Specimen = Specimen::cuboid([10.0; 3], Boundary::Periodic);
/// That of a ball of 6 mm.
const VOLUME_FRACTION: f64 = std::f64::consts::PI / 6.0 * 0.216;
/// Length of a file of 10 x 10 x 10 labels; that of others is not checked.
const BYTES: u64 = 1000;

type Change = fn(&mut Value);

/// Judges a report with one place changed.
fn checked(
    specimen: &Specimen,
    export: &ExportRequest,
    report: &Value,
    change: Change,
) -> Result<(), String> {
    let mut report = report.clone();
    change(&mut report);
    let report: ExportReport = serde_json::from_value(report).unwrap();
    export.check_report(specimen, VOLUME_FRACTION, None, &report, BYTES)
}

fn refuses(specimen: &Specimen, export: &ExportRequest, report: &Value, changes: &[(&str, Change)]) {
    checked(specimen, export, report, |_| {}).unwrap();
    for (says, change) in changes {
        let fault = checked(specimen, export, report, *change).unwrap_err();
        assert!(fault.contains(says), "{says}: {fault}");
    }
}

fn request(options: &Value) -> ExportRequest {
    ExportRequest::from_json(options).unwrap()
}

/// The report of a file that is made of a ball.
fn made(specimen: &Specimen, export: &ExportRequest) -> Value {
    let mut ball = Spheres::default();
    ball.push([5.0; 3], 6.0);
    let model = Model::new(specimen, &ball);
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
        &BOX,
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
    checked(&BOX, &request(&inscribed), &report, |report| {
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
    let report = made(&BOX, &export);
    refuses(
        &BOX,
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
    let pores = json!({"type": "deck", "cells": 10, "materials": {"matrix": of(25.0), "aggregate": of(0.0)}});
    let pores = request(&pores);
    checked(&BOX, &pores, &made(&BOX, &pores), |_| {}).unwrap();
}

#[test]
fn areas_of_a_cut_that_do_not_agree_are_refused() {
    let export = request(&json!({"type": "slice", "format": "json"}));
    refuses(
        &BOX,
        &export,
        &made(&BOX, &export),
        &[
            ("of 100 mm2", |report| report["area_fraction"] = json!(0.9)),
            ("of 100 mm2", |report| report["aggregate_area_mm2"] = json!(101)),
        ],
    );
}

#[test]
fn properties_outside_of_their_bounds_and_volumes_are_refused() {
    let of = |e, k| json!({"youngs_modulus_gpa": e, "poissons_ratio": 0.2, "conductivity_w_m_k": k});
    let materials = json!({"matrix": of(25.0, 1.8), "aggregate": of(70.0, 3.2)});
    let export = request(&json!({"type": "properties", "cells": 12, "materials": materials}));
    let report = made(&CELL, &export);
    let changes: [(&str, Change); 8] = [
        ("is not symmetric", |report| report["stiffness"]["stiffness_gpa"][0][1] = json!(99)),
        ("the bulk modulus", |report| {
            for axis in 0..3 {
                report["stiffness"]["stiffness_gpa"][axis][axis] = json!(75);
            }
        }),
        ("the shear modulus", |report| {
            for axis in 3..6 {
                report["stiffness"]["stiffness_gpa"][axis][axis] = json!(1);
            }
        }),
        ("a conductivity is 3.3", |report| report["conductivity"]["matrix"][2][2] = json!(3.3)),
        ("that no request stated", |report| {
            report["phases"][1]["material"]["youngs_modulus_gpa"] = json!(700);
        }),
        ("the sum 1", |report| report["phases"][0]["share"] = json!(0.5)),
        ("the aggregates have the share", |report| report["phases"][1]["exact_share"] = json!(0.2)),
        ("must be of \"properties\"", |report| {
            let quality = ExportRequest::from_json(&json!({"type": "quality"})).unwrap();
            let mut balls = Spheres::default();
            for x in [1.0, 4.0, 7.0] {
                balls.push([x, 5.0, 5.0], 2.0);
            }
            let model = Model::new(&CELL, &balls);
            let made = quality.write(&model, &Limits::default(), &Unattended, &mut Vec::new()).unwrap();
            *report = serde_json::to_value(made).unwrap();
        }),
    ];
    refuses(&CELL, &export, &report, &changes);
}

#[test]
fn voxels_of_another_grid_or_packing_are_refused() {
    let export = request(&json!({"type": "voxels", "format": "raw", "cells": 10}));
    let report = made(&CELL, &export);
    let changes: [(&str, Change); 3] = [
        ("the grid has", |report| report["shape"][0] = json!(11)),
        ("must be", |report| report["volume_fraction"] = json!(0.2)),
        ("lie in grains", |report| report["aggregate_voxels"] = json!(1)),
    ];
    refuses(&CELL, &export, &report, &changes);
}
