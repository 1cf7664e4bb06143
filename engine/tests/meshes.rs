//! Meshes as the programs they are for see them: Gmsh fills them, VTK and meshio read them.
#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use packstone_engine::export::Model;
use packstone_engine::export::mesh::{SurfaceOptions, geo, msh, stl};
use packstone_engine::request::Specimen;
use packstone_engine::{Limits, PackingRequest, Unattended, pack};
use serde_json::{Value, json};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/python/meshes.py");

/// The interpreter to use: that of `PACKSTONE_PYTHON`, which must then do, or else a `python3` that happens
/// to have the packages.
fn interpreter() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os("PACKSTONE_PYTHON") {
        return Some(named.into());
    }
    let imports = "import gmsh, meshio, numpy, vtkmodules.vtkIOGeometry, vtkmodules.vtkFiltersCore";
    let usable =
        Command::new("python3").args(["-c", imports]).output().is_ok_and(|tried| tried.status.success());
    usable.then(|| "python3".into())
}

/// Packs a job and writes it in all forms, with what the reader is to find.
fn write(folder: &Path, job: &Value, options: &SurfaceOptions) {
    let request = PackingRequest::from_json(job, 1).unwrap();
    let limits = Limits::default();
    let packing = pack(&request, &limits, &Unattended).unwrap();
    let model = Model::new(&request.specimen, packing.spheres().unwrap());
    std::fs::create_dir(folder).unwrap();
    let file = |name: &str| File::create(folder.join(name)).unwrap();
    let report = msh::write(&model, options, &limits, &Unattended, &mut file("packing.msh")).unwrap();
    write!(file("script.geo"), "{}", msh::script("packing.msh")).unwrap();
    let of_stl = stl::write(&model, options, &limits, &Unattended, &mut file("packing.zip")).unwrap();
    assert_eq!(report, of_stl);
    let of_geo = geo::write(
        &model,
        &geo::GeoOptions { segments: 16, ..geo::GeoOptions::default() },
        &limits,
        &Unattended,
        &mut file("packing.geo"),
    )
    .unwrap();
    let spheres_mm3: f64 = packing.spheres().unwrap().d_mm.iter().map(|d| PI / 6.0 * d.powi(3)).sum();
    let [x, y, z] = request.specimen.bounds_mm();
    let planes = match request.specimen {
        Specimen::Box { .. } => {
            json!({"x_min": [0, 0.0], "x_max": [0, x], "y_min": [1, 0.0], "y_max": [1, y],
                                       "z_min": [2, 0.0], "z_max": [2, z]})
        }
        Specimen::Cylinder { .. } => json!({"z_min": [2, 0.0], "z_max": [2, z]}),
    };
    let faces = match request.specimen {
        Specimen::Box { .. } => json!(["x_min", "x_max", "y_min", "y_max", "z_min", "z_max"]),
        Specimen::Cylinder { .. } => json!(["side", "z_min", "z_max"]),
    };
    let expected = json!({
        "grains": report.grains, "faces": faces, "planes": planes,
        "aggregates_of_geo_mm3": spheres_mm3 * (1.0 + of_geo.expected_volume_error),
        "aggregates_mm3": report.aggregate_volume_mm3, "specimen_mm3": report.specimen_volume_mm3,
    });
    write!(file("expected.json"), "{expected}").unwrap();
}

#[test]
fn gmsh_fills_what_was_written_and_vtk_and_meshio_read_it() {
    let Some(python) = interpreter() else {
        // Past the capture of the test harness: that nothing was tested must be seen.
        let warning = "\n*** SKIPPED: no Python with gmsh, vtk and meshio; nobody read the meshes.\n\
                       *** Set PACKSTONE_PYTHON to one with tests/python/requirements.txt installed.\n";
        std::io::stderr().write_all(warning.as_bytes()).unwrap();
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let grains = json!({"type": "classes", "classes": [{"d_min_mm": 4, "d_max_mm": 10, "mass_fraction": 1}]});
    let cube = json!({"seed": 1, "specimen": {"type": "box", "size_mm": [24, 20, 18]},
                      "mix": {"grading": grains, "volume_fraction": 0.3}, "distance": {"type": "constant", "gap_mm": 0.3}});
    let core = json!({"seed": 2, "specimen": {"type": "cylinder", "diameter_mm": 20, "height_mm": 24},
                      "mix": {"grading": grains, "volume_fraction": 0.3}, "distance": {"type": "constant", "gap_mm": 0.5}});
    write(&directory.path().join("box"), &cube, &SurfaceOptions::default().with_segments(10));
    write(&directory.path().join("cylinder"), &core, &SurfaceOptions::default());
    let read = Command::new(python).arg(SCRIPT).arg(directory.path()).output().unwrap();
    let said = String::from_utf8_lossy(&read.stdout);
    assert!(read.status.success(), "{said}{}", String::from_utf8_lossy(&read.stderr));
    assert_eq!(said.matches("stl closed").count(), 2, "{said}");
    println!("{said}");
}
