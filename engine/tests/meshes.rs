//! Meshes as the programs they are for see them: Gmsh fills them, VTK and meshio read them.

use std::f64::consts::PI;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use packstone_engine::export::mesh::{SurfaceOptions, geo, msh, stl};
use packstone_engine::export::tables::{self, EngineInfo, Format, Head};
use packstone_engine::export::{Model, Provenance};
use packstone_engine::methods::rsa_shapes::{AttemptsIn, ShapeRsa};
use packstone_engine::mix::uniform_orientation;
use packstone_engine::packing::GrainsRef;
use packstone_engine::request::{Boundary, Distance, Specimen};
use packstone_engine::shape::{Ellipsoid, Solid};
use packstone_engine::{Limits, PackingRequest, Solids, Unattended, distance::DistanceRule, pack};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
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
    let packing = pack(&request, &Limits::default(), &Unattended).unwrap();
    write_model(folder, &Model::new(&request.specimen, packing.spheres().unwrap()), options);
}

/// Writes a packing in all forms.
fn write_model(folder: &Path, model: &Model<'_>, options: &SurfaceOptions) {
    let limits = Limits::default();
    std::fs::create_dir(folder).unwrap();
    let file = |name: &str| File::create(folder.join(name)).unwrap();
    let report = msh::write(model, options, &limits, &Unattended, &mut file("packing.msh")).unwrap();
    write!(file("script.geo"), "{}", msh::script("packing.msh")).unwrap();
    let of_stl = stl::write(model, options, &limits, &Unattended, &mut file("packing.zip")).unwrap();
    assert_eq!(report, of_stl);
    let options = geo::GeoOptions { segments: 16, ..geo::GeoOptions::default() };
    let of_geo = geo::write(model, &options, &limits, &Unattended, &mut file("packing.geo")).unwrap();
    let grains_mm3: f64 = model.grains.diameters_mm().map(|d| PI / 6.0 * d.powi(3)).sum();
    let is_of_spheres = matches!(model.grains, GrainsRef::Spheres(_));
    let [x, y, z] = model.specimen.bounds_mm();
    let planes = match model.specimen {
        Specimen::Box { .. } => {
            json!({"x_min": [0, 0.0], "x_max": [0, x], "y_min": [1, 0.0], "y_max": [1, y],
                                       "z_min": [2, 0.0], "z_max": [2, z]})
        }
        Specimen::Cylinder { .. } => json!({"z_min": [2, 0.0], "z_max": [2, z]}),
    };
    let faces = match model.specimen {
        Specimen::Box { .. } => json!(["x_min", "x_max", "y_min", "y_max", "z_min", "z_max"]),
        Specimen::Cylinder { .. } => json!(["side", "z_min", "z_max"]),
    };
    let expected = json!({
        "grains": report.grains, "faces": faces, "planes": planes,
        "least_gamma": if is_of_spheres { 0.05 } else { 0.03 },
        "most_flat": 0.001, "aggregates_of_geo_mm3": grains_mm3 * (1.0 + of_geo.expected_volume_error),
        "aggregates_mm3": report.aggregate_volume_mm3, "specimen_mm3": report.specimen_volume_mm3,
    });
    write!(file("expected.json"), "{expected}").unwrap();
}

/// Writes a packing of two aggregates with grains and one without, whose groups the reader is to find.
fn write_aggregates(folder: &Path) {
    let of = |d_mm: [f64; 2]| json!({"type": "sieves", "points": [[d_mm[0], 0.0], [d_mm[1], 1.0]]});
    let job = json!({"seed": 3, "specimen": {"type": "box", "size_mm": [24, 20, 18]},
                     "mix": {"d_min_mm": 4, "volume_fraction": 0.3, "aggregates": [
                         {"name": "crushed 4/8", "share": 0.5, "grading": of([4.0, 8.0])},
                         {"name": "sand", "share": 0.1, "grading": of([0.1, 2.0])},
                         {"share": 0.4, "grading": of([5.0, 9.0])}]},
                     "distance": {"type": "constant", "gap_mm": 0.5}});
    let request = PackingRequest::from_json(&job, 1).unwrap();
    let packing = pack(&request, &Limits::default(), &Unattended).unwrap();
    let spheres = packing.spheres().unwrap();
    let head =
        Head { job_id: None, request: job, engine: EngineInfo::current(), report: packing.report.clone() };
    let provenance = Provenance::from(&head);
    let model = Model::new(&request.specimen, spheres).with_provenance(&provenance);
    write_model(folder, &model, &SurfaceOptions::default());
    let rows = |aggregate: u16| (0..spheres.len()).filter(move |row| spheres.aggregate[*row] == aggregate);
    let volume_mm3 = |aggregate| rows(aggregate).map(|row| PI / 6.0 * spheres.d_mm[row].powi(3)).sum::<f64>();
    let path = folder.join("expected.json");
    let mut expected: Value = serde_json::from_reader(File::open(&path).unwrap()).unwrap();
    let (crushed, third) = ("aggregate_1_crushed_4_8", "aggregate_3");
    expected["aggregates_by_group"] = json!({crushed: rows(0).count(), third: rows(2).count()});
    expected["volumes_by_group"] = json!({crushed: volume_mm3(0), third: volume_mm3(2)});
    assert!(rows(0).count() > 3 && rows(2).count() > 3 && rows(1).count() == 0);
    write!(File::create(path).unwrap(), "{expected}").unwrap();
}

/// Ellipsoids, as many as random sequential addition inserts with that gap.
fn ellipsoids(specimen: &Specimen, gap_mm: f64) -> Solids {
    let shapes: Vec<Ellipsoid> = (0..45)
        .map(|i| {
            let d = 6.0 * 0.5_f64.powf(f64::from(i) / 44.0);
            Ellipsoid::new([0.64 * d, 0.51 * d, 0.38 * d]).unwrap()
        })
        .collect();
    let rsa = ShapeRsa {
        shapes: &shapes,
        domain: specimen.domain(),
        rule: DistanceRule::new(&Distance::Constant { gap_mm, wall_gap_mm: None }, specimen),
        attempts_per_grain: Some(100_000),
        attempts_in: AttemptsIn::Specimen,
        threads: std::num::NonZeroUsize::MIN,
        orientation: &uniform_orientation,
    };
    let poses = rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(1), &Unattended).placed;
    Solids::of_ellipsoids(shapes[..poses.len()].to_vec(), poses)
}

/// Writes the grains as polygons, with what the reader is to find.
fn write_surfaces(folder: &Path, grains: &Solids) {
    let job = json!({"specimen": {"type": "box", "size_mm": [50, 50, 50]},
                     "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4, "volume_fraction": 0.4}});
    let packing =
        pack(&PackingRequest::from_json(&job, 1).unwrap(), &Limits::default(), &Unattended).unwrap();
    let head = Head { job_id: None, request: job, engine: EngineInfo::current(), report: packing.report };
    for format in [Format::Vtp, Format::Vtk] {
        let mut file = File::create(folder.join(format!("grains.{}", format.name()))).unwrap();
        tables::write(format, &head, grains, &mut file).unwrap();
    }
    let rows = 0..grains.len();
    let faces = |row: usize| grains.shape(row).polyhedron().unwrap().template.faces().len();
    let expected = json!({
        "volume_mm3": rows.clone().map(|row| grains.shape(row).volume_mm3()).sum::<f64>(),
        "sharp": grains.templates[0].rounding() == 0.0,
        "faces": rows.clone().map(faces).sum::<usize>(),
        "diameters_mm": grains.shapes.iter().map(Solid::d_mm).collect::<Vec<_>>(),
        "templates": grains.shapes.iter().map(Solid::template).collect::<Vec<_>>(),
    });
    write!(File::create(folder.join("grains.json")).unwrap(), "{expected}").unwrap();
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
    write_aggregates(&directory.path().join("aggregates"));
    let cases = [
        (Specimen::Box { size_mm: [24.0, 20.0, 18.0], boundary: Boundary::Walls }, 0.3),
        (Specimen::Cylinder { diameter_mm: 20.0, height_mm: 24.0 }, 0.5),
    ];
    for (i, (specimen, gap_mm)) in cases.iter().enumerate() {
        let grains = ellipsoids(specimen, *gap_mm);
        let folder = directory.path().join(format!("ellipsoids-{i}"));
        write_model(&folder, &Model::new(specimen, &grains), &SurfaceOptions::default());
    }
    for (i, rounding) in [0.0, 0.05, 0.01].into_iter().enumerate() {
        let specimen = Specimen::Box { size_mm: [16.0, 14.0, 12.0], boundary: Boundary::Walls };
        let grains = crate::polyhedra_samples::packed(&specimen, 20, [4.5, 2.0], 0.3, rounding);
        let folder = directory.path().join(format!("polyhedra-{i}"));
        write_model(&folder, &Model::new(&specimen, &grains), &SurfaceOptions::default());
        write_surfaces(&folder, &grains);
    }
    let specimen = Specimen::Cylinder { diameter_mm: 20.0, height_mm: 16.0 };
    let grains = crate::polyhedra_samples::mixed(&specimen, 30, [5.5, 2.5], 0.4, 0.05);
    write_model(&directory.path().join("mixed"), &Model::new(&specimen, &grains), &SurfaceOptions::default());
    if let Some(kept) = std::env::var_os("PACKSTONE_KEEP_MESHES") {
        Command::new("cp").arg("-r").arg(directory.path()).arg(kept).status().unwrap();
    }
    let read = Command::new(python).arg(SCRIPT).arg(directory.path()).output().unwrap();
    let said = String::from_utf8_lossy(&read.stdout);
    assert!(read.status.success(), "{said}{}", String::from_utf8_lossy(&read.stderr));
    assert_eq!(said.matches("stl closed").count(), 9, "{said}");
    assert_eq!(said.matches("surfaces in vtp and vtk").count(), 3, "{said}");
    assert_eq!(said.matches("geo ").count(), 9, "{said}");
    println!("{said}");
}
