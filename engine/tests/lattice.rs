//! Files of lattices read by the readers that users have: VTK, meshio, and Project Chrono's rules for its own.

use std::fs::File;
use std::io::Write;
use std::path::PathBuf;
use std::process::Command;

use packstone_engine::export::ldpm::{self, BoundaryNodes, LatticeOptions};
use packstone_engine::export::{Export as _, Model};
use packstone_engine::{Limits, PackingRequest, Unattended, pack};
use serde_json::{Value, json};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/python/lattice.py");

/// The interpreter to use: that of `PACKSTONE_PYTHON`, which must then do, or else a `python3` that happens
/// to have the packages.
fn interpreter() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os("PACKSTONE_PYTHON") {
        return Some(named.into());
    }
    let imports = "import numpy, meshio, vtkmodules.vtkIOXML";
    let usable =
        Command::new("python3").args(["-c", imports]).output().is_ok_and(|tried| tried.status.success());
    usable.then(|| "python3".into())
}

/// Writes all files of the lattice of a mix, and has them read.
fn read(python: &PathBuf, specimen: &Value, distance: &Value, options: &LatticeOptions) {
    let request = json!({
        "specimen": specimen,
        "mix": {"grading": {"type": "fuller", "d_max_mm": 10.0, "exponent": 0.5}, "d_min_mm": 3.0, "volume_fraction": 0.5},
        "distance": distance,
    });
    let request = PackingRequest::from_json(&request, 1).unwrap();
    let spheres = pack(&request, &Limits::default(), &Unattended).unwrap().into_spheres().unwrap();
    let provenance = crate::provenance::complete();
    let model = Model::new(&request.specimen, &spheres).with_provenance(&provenance);
    let directory = tempfile::tempdir().unwrap();
    let mut volume_mm3 = 0.0;
    for (file, name) in [
        (ldpm::LatticeFormat::Chrono, "chrono.zip"),
        (ldpm::LatticeFormat::Tets, "tets.vtu"),
        (ldpm::LatticeFormat::Facets, "facets.vtu"),
        (ldpm::LatticeFormat::Cells, "cells.vtu"),
    ] {
        let mut out = File::create(directory.path().join(name)).unwrap();
        let options = LatticeOptions { format: file, ..options.clone() };
        volume_mm3 = options.write(&model, &Limits::default(), &Unattended, &mut out).unwrap().volume_mm3;
    }
    let ran =
        Command::new(python).arg(SCRIPT).arg(directory.path()).arg(volume_mm3.to_string()).output().unwrap();
    let said = String::from_utf8_lossy(&ran.stdout);
    assert!(ran.status.success() && said.contains("agree"), "{said}{}", String::from_utf8_lossy(&ran.stderr));
}

#[test]
fn vtk_meshio_and_the_rules_of_chrono_find_one_lattice() {
    let Some(python) = interpreter() else {
        // Past the capture of the test harness: that nothing was tested must be seen.
        let warning = "\n*** SKIPPED: no Python with numpy, vtk and meshio; nobody read the lattices.\n\
                       *** Set PACKSTONE_PYTHON to one with tests/python/requirements.txt installed.\n";
        std::io::stderr().write_all(warning.as_bytes()).unwrap();
        return;
    };
    let cube = json!({"type": "box", "size_mm": [30, 30, 30]});
    read(
        &python,
        &cube,
        &json!({"type": "constant", "gap_mm": 0.3, "wall_gap_mm": 1.65}),
        &LatticeOptions { spacing: 1.3, ..LatticeOptions::default() },
    );
    // Grains that touch walls, inverted pieces, radii of zero on a surface that is no plane.
    let cylinder = json!({"type": "cylinder", "diameter_mm": 30, "height_mm": 40});
    let options = LatticeOptions {
        boundary_nodes: BoundaryNodes::Random,
        surface_radius: 0.0,
        seed: 9,
        ..LatticeOptions::default()
    };
    read(&python, &cylinder, &json!({"type": "none"}), &options);
}
