//! The same voxels as a deck for `CalculiX` and as a cell of the export `properties`.
//!
//! Between smooth plates a box deforms as its mirrored cell, and C3D8 of `CalculiX` is the hexahedron of
//! `scheme=hexahedra`: the properties are the same, up to the seven digits that `CalculiX` prints.

use std::path::Path;

use serde_json::{Value, json};

use super::tests::{ccx, cuboid, run, solution_in};
use crate::control::Unattended;
use crate::export::{ExportReport, ExportRequest, Model};
use crate::packing::Spheres;
use crate::plan::Limits;

/// Voxels along an edge.
const CELLS: u32 = 8;
const EDGE_MM: f64 = 12.0;

fn materials(contrast: f64) -> Value {
    json!({
        "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2, "expansion_1_k": 1.1e-5,
            "conductivity_w_m_k": 1.8},
        "aggregate": {"youngs_modulus_gpa": 25.0 * contrast, "poissons_ratio": 0.3, "expansion_1_k": 8e-6,
            "conductivity_w_m_k": 1.8 * contrast},
    })
}

/// The conductivity along z of a deck that is unpacked in a folder: the faces across z have two temperatures.
fn conductivity_along_z(ccx: &Path, folder: &Path) -> f64 {
    let model = format!(
        "*INCLUDE, INPUT=mesh.inp\n*INCLUDE, INPUT=materials.inp\n*NSET, NSET=plates\nz_min, z_max\n\
         *INITIAL CONDITIONS, TYPE=TEMPERATURE\nplates, 0.\n*BOUNDARY\nz_min, 11, 11\n\
         *STEP\n*HEAT TRANSFER, STEADY STATE, SOLVER=SPOOLES\n*BOUNDARY\nz_max, 11, 11, {EDGE_MM:?}\n\
         *NODE PRINT, NSET=z_max, TOTALS=ONLY\nRFL\n*END STEP\n"
    );
    std::fs::write(folder.join("heat.inp"), model).unwrap();
    run(ccx, folder, "heat");
    let printed = std::fs::read_to_string(folder.join("heat.dat")).unwrap();
    let total = printed.split_whitespace().last().and_then(|number| number.parse::<f64>().ok());
    // At a gradient of 1 K/mm.
    total.unwrap_or_else(|| panic!("{printed}")).abs() / (EDGE_MM * EDGE_MM)
}

#[test]
fn hexahedra_have_the_properties_that_calculix_finds_on_the_same_voxels() {
    let Some(ccx) = ccx() else { return };
    let specimen = cuboid([EDGE_MM; 3]);
    let mut balls = Spheres::default();
    for (center, diameter) in
        [([3.7, 3.4, 4.1], 6.0), ([8.6, 8.2, 3.3], 5.4), ([7.9, 3.2, 9.0], 5.0), ([3.1, 8.8, 8.4], 5.8)]
    {
        balls.push(center, diameter);
    }
    let model = Model::new(&specimen, &balls);
    for contrast in [3.0, 30.0, 300.0] {
        let write = |options: Value| {
            let mut all = json!({"cells": CELLS, "materials": materials(contrast)});
            all.as_object_mut().unwrap().extend(options.as_object().unwrap().clone());
            let export = ExportRequest::from_json(&all).unwrap();
            let mut bytes = Vec::new();
            let report = export.write(&model, &Limits::default(), &Unattended, &mut bytes).unwrap();
            (report, bytes)
        };
        let cell =
            json!({"type": "properties", "scheme": "hexahedra", "walls": "mirrored", "tolerance": 1e-9});
        let (ExportReport::Properties(own), _) = write(cell) else { panic!() };
        let agree = |what: &str, own: f64, other: f64| {
            assert!((own / other - 1.0).abs() < 1e-6, "contrast {contrast}, {what}: {own}, CalculiX {other}");
        };
        let solved = |load: &str, folder: &Path| {
            let (_, zip) = write(json!({"type": "deck", "load": load}));
            solution_in(folder, &ccx, &zip)
        };
        let folders = [0; 3].map(|_| tempfile::tempdir().unwrap());
        let folders = folders.each_ref().map(tempfile::TempDir::path);
        let stiffness = own.stiffness.as_ref().unwrap();
        let stretched = solved("uniaxial_z", folders[0]);
        agree("E", stiffness.youngs_moduli_gpa.unwrap()[2], stretched.youngs_modulus_gpa.unwrap());
        let sheared = solved("shear_xy", folders[1]);
        agree("G", stiffness.stiffness_gpa[5][5], sheared.shear_modulus_gpa.unwrap());
        let heated = solved("temperature", folders[2]).expansion_1_k.unwrap();
        for (axis, other) in heated.into_iter().enumerate() {
            agree("expansion", own.expansion.as_ref().unwrap().expansion_1_k[axis][axis], other);
        }
        let heat = conductivity_along_z(&ccx, folders[0]);
        agree("conductivity", own.conductivity.as_ref().unwrap().matrix[2][2], heat);
    }
}
