//! Voxel models and cuts read by the programs that users have: VTK, meshio, Gmsh, Pillow, numpy.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use packstone_engine::export::{Export as _, Model};
use packstone_engine::request::decode::{At, Faults, Object};
use packstone_engine::{
    Limits, PackingRequest, Solids, Unattended,
    distance::DistanceRule,
    export::{slice, voxels},
    methods::rsa_shapes::{AttemptsIn, ShapeRsa},
    mix::uniform_orientation,
    pack,
    request::{Boundary, Distance, Specimen},
    shape::Ellipsoid,
};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use serde::Serialize;
use serde_json::{Value, json};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/python/read_slices_and_voxels.py");

/// The interpreter to use: that of `PACKSTONE_PYTHON`, which must then do, or else a `python3` that happens
/// to have the packages.
fn interpreter() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os("PACKSTONE_PYTHON") {
        return Some(named.into());
    }
    let imports = "import numpy, vtkmodules.vtkIOXML, meshio, gmsh, PIL";
    let usable =
        Command::new("python3").args(["-c", imports]).output().is_ok_and(|tried| tried.status.success());
    usable.then(|| "python3".into())
}

fn read<T>(options: &Value, read: impl Fn(&mut Object<'_>) -> Option<T>) -> T {
    let faults = Faults::default();
    let mut object = At::root(options, &faults).object().unwrap();
    let options = read(&mut object);
    object.finish();
    assert_eq!(faults.into_vec(), []);
    options.unwrap()
}

/// Writes a file and its report beside it.
fn keep(directory: &Path, name: &str, bytes: &[u8], report: &impl Serialize, more: &Value) {
    let mut report = serde_json::to_value(report).unwrap();
    report.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    fs::write(directory.join(name), bytes).unwrap();
    fs::write(directory.join(format!("{name}.json")), report.to_string()).unwrap();
}

fn make(directory: &Path, specimen: &Value, at: f64) {
    fs::create_dir(directory).unwrap();
    let request = json!({
        "specimen": specimen,
        "mix": {"grading": {"type": "fuller", "d_max_mm": 8, "exponent": 0.5}, "volume_fraction": 0.5},
        "distance": {"type": "constant", "gap_mm": 0.2},
    });
    let request = PackingRequest::from_json(&request, 1).unwrap();
    let packing = pack(&request, &Limits::default(), &Unattended).unwrap();
    let provenance = crate::provenance::complete();
    let model = Model::new(&request.specimen, packing.spheres().unwrap()).with_provenance(&provenance);
    let volume = json!({"specimen_volume_mm3": request.specimen.volume_mm3()});
    let grids = [
        ("voxels", voxels::VoxelFormat::Vti, json!({"cells": 41, "label": "grain", "fractions": true})),
        ("voxels", voxels::VoxelFormat::Raw, json!({"cells": 41, "label": "grain"})),
        ("coarse", voxels::VoxelFormat::Raw, json!({"voxel_mm": 1.3})),
        ("voxels", voxels::VoxelFormat::Inp, json!({"voxel_mm": 1.3})),
    ];
    for (name, format, options) in grids {
        let options = {
            let mut options = options.clone();
            options["format"] = json!(format);
            read(&options, voxels::VoxelOptions::read)
        };
        let mut bytes = Vec::new();
        let report = options.write(&model, &Limits::default(), &Unattended, &mut bytes).unwrap();
        keep(directory, &format!("{name}.{}", format.name()), &bytes, &report, &volume);
    }
    write_slices(directory, &model, at);
}

fn write_slices(directory: &Path, model: &Model<'_>, at: f64) {
    for axis in ["x", "y", "z"] {
        // Triangles are made by Gmsh, which the engine does not start: `tests/plane_models.rs` has them.
        for format in slice::SliceFormat::ALL.into_iter().filter(|format| !format.has_triangles()) {
            let mut options = json!({"format": format, "axis": axis, "at_mm": at});
            if format == slice::SliceFormat::Png {
                options["pixels"] = json!(400);
            }
            let options = read(&options, slice::SliceOptions::read);
            let mut bytes = Vec::new();
            let report = options.write(model, &Limits::default(), &Unattended, &mut bytes).unwrap();
            keep(directory, &format!("slice-{axis}.{}", format.name()), &bytes, &report, &json!({}));
        }
    }
}

fn ellipsoids(specimen: &Specimen) -> Solids {
    let shapes: Vec<Ellipsoid> = (0..45)
        .map(|i| {
            let d = 6.0 * 0.5_f64.powf(f64::from(i) / 44.0);
            Ellipsoid::new([0.75 * d, 0.5 * d, d / 3.0]).unwrap()
        })
        .collect();
    let rsa = ShapeRsa {
        shapes: &shapes,
        domain: specimen.domain(),
        rule: DistanceRule::new(&Distance::Constant { gap_mm: 0.2, wall_gap_mm: None }, specimen),
        attempts_per_grain: Some(100_000),
        attempts_in: AttemptsIn::Specimen,
        threads: std::num::NonZeroUsize::MIN,
        orientation: &uniform_orientation,
    };
    let poses = rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(1), &Unattended).placed;
    Solids::of_ellipsoids(shapes[..poses.len()].to_vec(), poses)
}

#[test]
fn other_programs_read_what_the_reports_say() {
    let Some(python) = interpreter() else {
        // Past the capture of the test harness: that nothing was tested must be seen.
        let warning = "\n*** SKIPPED: no Python with vtk, meshio, gmsh, pillow; nobody read the voxels and cuts.\n\
                       *** Set PACKSTONE_PYTHON to one with tests/python/requirements.txt installed.\n";
        std::io::stderr().write_all(warning.as_bytes()).unwrap();
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let kept = directory.path().to_owned();
    let _ = &kept;
    let make = |name: &str, specimen: Value, at| make(&directory.path().join(name), &specimen, at);
    make("walls", json!({"type": "box", "size_mm": [30, 26, 22]}), 11.3);
    make("periodic", json!({"type": "box", "size_mm": [22, 22, 22], "boundary": "periodic"}), 0.4);
    make("cylinder", json!({"type": "cylinder", "diameter_mm": 24, "height_mm": 30}), 7.1);
    for (name, specimen, at) in [
        ("ellipsoids", Specimen::Box { size_mm: [24.0, 20.0, 18.0], boundary: Boundary::Walls }, 8.3),
        ("periodic-ellipsoids", Specimen::Box { size_mm: [20.0; 3], boundary: Boundary::Periodic }, 0.4),
        ("core-ellipsoids", Specimen::Cylinder { diameter_mm: 20.0, height_mm: 24.0 }, 8.3),
    ] {
        let grains = ellipsoids(&specimen);
        let folder = directory.path().join(name);
        fs::create_dir(&folder).unwrap();
        write_slices(&folder, &Model::new(&specimen, &grains), at);
    }
    for (name, specimen, rounding, at) in [
        ("polyhedra", Specimen::Box { size_mm: [18.0, 16.0, 14.0], boundary: Boundary::Walls }, 0.0, 7.3),
        ("rounded", Specimen::Box { size_mm: [18.0, 16.0, 14.0], boundary: Boundary::Walls }, 0.06, 7.3),
        ("periodic-polyhedra", Specimen::Box { size_mm: [14.0; 3], boundary: Boundary::Periodic }, 0.0, 0.4),
        ("periodic-rounded", Specimen::Box { size_mm: [14.0; 3], boundary: Boundary::Periodic }, 0.06, 0.4),
        ("core-polyhedra", Specimen::Cylinder { diameter_mm: 18.0, height_mm: 16.0 }, 0.06, 7.3),
    ] {
        let grains = crate::polyhedra_samples::packed(&specimen, 24, [5.0, 2.0], 0.2, rounding);
        let folder = directory.path().join(name);
        fs::create_dir(&folder).unwrap();
        write_slices(&folder, &Model::new(&specimen, &grains), at);
    }
    let read = Command::new(python).arg(SCRIPT).arg(directory.path()).output().unwrap();
    let said = String::from_utf8_lossy(&read.stdout);
    assert!(read.status.success(), "{said}{}", String::from_utf8_lossy(&read.stderr));
    assert!(said.contains("11 packings agree"), "{said}");
}
