use std::num::NonZeroUsize;

use nalgebra::{Matrix6, UnitQuaternion, Vector3};
use serde_json::{Value, json};

use super::*;
use crate::export::{ExportReport, ExportRequest};
use crate::packing::{Grains, Solids, Spheres};
use crate::request::Boundary;
use crate::shape::{Ellipsoid, Pose};
use crate::{PackingRequest, Unattended, pack};

fn cube(size: f64, boundary: Boundary) -> Specimen {
    Specimen::Box { size_mm: [size; 3], boundary }
}

fn materials() -> Value {
    json!({
        "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2, "conductivity_w_m_k": 1.8, "expansion_1_k": 1.1e-5},
        "aggregate": {"youngs_modulus_gpa": 70, "poissons_ratio": 0.2, "conductivity_w_m_k": 3.2, "expansion_1_k": 8e-6},
    })
}

fn request(options: &Value) -> ExportRequest {
    let mut all = json!({"type": "properties", "materials": materials()});
    all.as_object_mut().unwrap().extend(options.as_object().unwrap().clone());
    ExportRequest::from_json(&all).unwrap()
}

fn properties_of(model: &Model<'_>, options: &Value) -> PropertyReport {
    let mut out = Vec::new();
    let report = request(options).write(model, &Limits::default(), &Unattended, &mut out).unwrap();
    let ExportReport::Properties(report) = report else { panic!("{report:?}") };
    assert_eq!(serde_json::from_slice::<PropertyReport>(&out).unwrap(), *report);
    *report
}

fn stiffness_of(report: &StiffnessReport) -> Matrix6<f64> {
    Matrix6::from_fn(|i, j| report.stiffness_gpa[i][j])
}

fn one_ball(diameter: f64) -> Spheres {
    let mut spheres = Spheres::default();
    spheres.push([5.0; 3], diameter);
    spheres
}

#[test]
fn one_ball_in_a_large_cell_raises_the_moduli_as_mori_and_tanaka_say() {
    let (specimen, grains) = (cube(10.0, Boundary::Periodic), one_ball(3.0));
    let report = properties_of(
        &Model::new(&specimen, &grains),
        &json!({"cells": 48, "kinds": "stiffness,conductivity"}),
    );
    let (stiffness, conductivity) = (report.stiffness.unwrap(), report.conductivity.unwrap());
    // Of balls in a softer matrix, the estimate of Mori and Tanaka is the lower bound of Hashin and Shtrikman.
    let lower = stiffness.bounds.hashin_shtrikman_lower;
    let increment = |found: f64, expected: f64, matrix: f64| (found - expected).abs() / (expected - matrix);
    let of_bulk = increment(stiffness.isotropic.bulk_modulus_gpa, lower.bulk_modulus_gpa, 25.0 / 1.8);
    let of_modulus = increment(stiffness.isotropic.youngs_modulus_gpa, lower.youngs_modulus_gpa, 25.0);
    let of_heat = increment(conductivity.isotropic, conductivity.bounds.hashin_shtrikman_lower, 1.8);
    assert!(of_bulk < 0.01 && of_modulus < 0.01 && of_heat < 0.01, "{of_bulk} {of_modulus} {of_heat}");
    // A cube of balls has no direction that differs from another.
    let [x, y, z] = stiffness.youngs_moduli_gpa.unwrap();
    assert!((x - y).abs() < 1e-5 * x && (x - z).abs() < 1e-5 * x, "{x} {y} {z}");
    assert!(stiffness.error.solver < 1e-4 && stiffness.error.voxels < 2e-3, "{:?}", stiffness.error);
    assert!((report.phases[1].share - report.phases[1].exact_share).abs() < 1e-12, "{:?}", report.phases);
}

#[test]
fn the_properties_of_random_packings_lie_within_their_bounds() {
    for seed in 1..=4 {
        let packed = PackingRequest::from_json(
            &json!({
                "specimen": {"type": "box", "size_mm": [20, 20, 20], "boundary": "periodic"},
                "mix": {"grading": {"type": "monodisperse", "diameter_mm": 6}, "volume_fraction": 0.3},
            }),
            seed,
        )
        .unwrap();
        let packing = pack(&packed, &Limits::default(), &Unattended).unwrap();
        let Grains::Spheres(spheres) = &packing.grains else { panic!() };
        let report = properties_of(&Model::new(&packed.specimen, spheres), &json!({"cells": 24}));
        let (stiffness, heat) = (report.stiffness.unwrap(), report.conductivity.unwrap());
        let bounds = &stiffness.bounds;
        let of = |moduli: &homogenization::moduli::IsotropicModuli| moduli.youngs_modulus_gpa;
        let own = of(&stiffness.isotropic);
        assert!(of(&bounds.reuss) < of(&bounds.hashin_shtrikman_lower), "{bounds:?}");
        assert!(of(&bounds.hashin_shtrikman_upper) < of(&bounds.voigt), "{bounds:?}");
        let [low, high] = [bounds.hashin_shtrikman_lower, bounds.hashin_shtrikman_upper].map(|m| of(&m));
        assert!(low * 0.999 < own && own < high && own < low * 1.01, "{seed}: {low} {own} {high}");
        let bounds = heat.bounds;
        assert!(heat.isotropic > bounds.hashin_shtrikman_lower * 0.999, "{heat:?}");
        assert!(heat.isotropic < bounds.hashin_shtrikman_upper, "{heat:?}");
        // Levin's relation for two isotropic phases, of the bulk modulus that was found.
        let [k1, k2, k] = [25.0 / 1.8, 70.0 / 1.8, stiffness.isotropic.bulk_modulus_gpa].map(|k| 1.0 / k);
        let shares: Vec<f64> = report.phases.iter().map(|phase| phase.share).collect();
        let (a1, a2) = (1.1e-5, 8e-6);
        let mean = shares[0] * a1 + shares[1] * a2;
        let expected = mean + (a2 - a1) / (k2 - k1) * (k - shares[0] * k1 - shares[1] * k2);
        let found = report.expansion.unwrap().isotropic_1_k;
        assert!((found - expected).abs() < 1e-4 * expected, "{found} {expected}");
    }
}

#[test]
fn the_file_is_the_same_on_any_number_of_threads() {
    let specimen = cube(10.0, Boundary::Periodic);
    let shapes = vec![Ellipsoid::new([2.0, 1.5, 1.0]).unwrap(), Ellipsoid::new([1.5, 1.2, 1.1]).unwrap()];
    let pose = |at: [f64; 3], turn: f64| Pose {
        center_mm: Vector3::from(at),
        orientation: UnitQuaternion::from_euler_angles(turn, 0.4, 2.0 * turn),
    };
    let grains = Solids::of_ellipsoids(shapes, vec![pose([1.0, 4.0, 9.5], 0.3), pose([6.0, 5.0, 4.0], 1.0)]);
    let model = Model::new(&specimen, &grains);
    let of = |threads: usize| {
        let export_threads = NonZeroUsize::new(threads).unwrap();
        let limits = Limits { export_threads, ..Limits::default() };
        let mut out = Vec::new();
        request(&json!({"cells": 20})).write(&model, &limits, &Unattended, &mut out).unwrap();
        String::from_utf8(out).unwrap()
    };
    let one = of(1);
    for threads in [2, 4] {
        assert_eq!(of(threads), one);
    }
    let report: PropertyReport = serde_json::from_str(&one).unwrap();
    let phase = &report.phases[1];
    assert!((phase.share - phase.exact_share).abs() < 1e-3 * phase.share, "{phase:?}");
    let c = stiffness_of(&report.stiffness.unwrap());
    assert!((c - c.transpose()).amax() == 0.0 && c.cholesky().is_some(), "{c}");
}

#[test]
fn ellipsoids_with_equal_axes_have_the_properties_of_spheres() {
    let specimen = cube(10.0, Boundary::Periodic);
    let (center_mm, orientation) = (Vector3::new(5.0, 5.0, 5.0), UnitQuaternion::identity());
    let solids =
        Solids::of_ellipsoids(vec![Ellipsoid::new([2.5; 3]).unwrap()], vec![Pose { center_mm, orientation }]);
    let spheres = one_ball(5.0);
    let of = |model: &Model<'_>| {
        let report = properties_of(model, &json!({"cells": 16, "kinds": "stiffness", "tolerance": 1e-6}));
        stiffness_of(&report.stiffness.unwrap())
    };
    let (own, expected) = (of(&Model::new(&specimen, &solids)), of(&Model::new(&specimen, &spheres)));
    assert!((own - expected).amax() < 3e-4 * expected.amax(), "{own}{expected}");
}

#[test]
fn a_mirrored_cell_of_a_symmetric_box_is_the_cell_itself() {
    let (specimen, grains) = (cube(10.0, Boundary::Walls), one_ball(7.0));
    let model = Model::new(&specimen, &grains);
    let of = |walls: &str, kind: CellKind| {
        let report = properties_of(&model, &json!({"cells": 10, "walls": walls, "tolerance": 1e-8}));
        assert_eq!(report.cell.kind, kind);
        (report.cell.size_mm[0], stiffness_of(report.stiffness.as_ref().unwrap()), report.expansion.unwrap())
    };
    let (edge, own, expansion) = of("periodic", CellKind::RepeatedBox);
    let (twice, mirrored, of_mirrored) = of("mirrored", CellKind::MirroredBox);
    assert_eq!((edge, twice), (10.0, 20.0));
    assert!((own - mirrored).amax() < 1e-6 * own.amax(), "{own}{mirrored}");
    assert!((expansion.isotropic_1_k - of_mirrored.isotropic_1_k).abs() < 1e-6 * expansion.isotropic_1_k);
}

#[test]
fn labels_are_those_of_the_export_of_voxels() {
    let (specimen, grains) = (cube(10.0, Boundary::Periodic), one_ball(7.3));
    let model = Model::new(&specimen, &grains);
    let mut labels = Vec::new();
    let raw = ExportRequest::from_json(&json!({"type": "voxels", "format": "raw", "cells": 18})).unwrap();
    raw.write(&model, &Limits::default(), &Unattended, &mut labels).unwrap();
    let in_grains: usize = labels.iter().map(|label| usize::from(*label == 1)).sum();
    let report = properties_of(&model, &json!({"cells": 18, "scheme": "hexahedra", "kinds": "stiffness"}));
    assert_eq!((report.cut_voxels, report.cell.cut_share), (CutVoxels::Labels, 0.0));
    let share = in_grains as f64 / labels.len() as f64;
    assert!((report.phases[1].share - share).abs() < 1e-12, "{share} {:?}", report.phases);
}

#[test]
fn pores_lower_the_stiffness_as_bounds_allow() {
    let (specimen, grains) = (cube(10.0, Boundary::Periodic), one_ball(5.0));
    let model = Model::new(&specimen, &grains);
    let air = json!({
        "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2},
        "aggregate": {"youngs_modulus_gpa": 0},
    });
    let of = |cut_voxels: &str| {
        let options = json!({"cells": 32, "materials": air, "cut_voxels": cut_voxels});
        let report = properties_of(&model, &options);
        assert!(report.expansion.is_none() && report.conductivity.is_none());
        report.stiffness.unwrap()
    };
    let (mixed, labels) = (of("mixed"), of("labels"));
    // Of balls in a stiffer matrix, the estimate of Mori and Tanaka is the upper bound; at a share of 0.065 a cubic
    // lattice of pores is near to it.
    let upper = mixed.bounds.hashin_shtrikman_upper.bulk_modulus_gpa;
    for found in [&mixed, &labels] {
        let error = found.isotropic.bulk_modulus_gpa / upper - 1.0;
        assert!(error.abs() < 0.02, "{error} {found:?}");
        assert!(found.error.iterations.iter().all(|n| *n <= 30), "{:?}", found.error);
    }
}

#[test]
fn refusals_name_the_field_and_have_an_example() {
    let spheres = one_ball(3.0);
    let none = Spheres::default();
    let cylinder = Specimen::Cylinder { diameter_mm: 20.0, height_mm: 20.0 };
    let periodic = cube(10.0, Boundary::Periodic);
    let limits = Limits { max_model_bytes: 1_000_000, ..Limits::default() };
    let with = |field: &str, value: Value| {
        let mut all = materials();
        all["matrix"][field] = value;
        json!({"materials": all})
    };
    for (specimen, grains, options, limits, says) in [
        (&cylinder, &none, json!({}), &Limits::default(), "pack the mix in a box"),
        (&periodic, &spheres, json!({"materials": null}), &Limits::default(), "/materials: is missing"),
        (&periodic, &spheres, json!({"walls": "mirrored"}), &Limits::default(), "/walls"),
        (&periodic, &spheres, json!({"cells": 64}), &limits, "/cells: the properties of 64 x 64 x 64 voxels"),
        (
            &periodic,
            &spheres,
            with("youngs_modulus_gpa", json!(0)),
            &Limits::default(),
            "/materials/matrix/youngs_modulus_gpa: 0 is out of range",
        ),
        (
            &periodic,
            &spheres,
            json!({"materials": {"matrix": {"youngs_modulus_gpa": 1, "poissons_ratio": 0.2}}}),
            &Limits::default(),
            "/materials/aggregate: is missing",
        ),
        (
            &periodic,
            &spheres,
            json!({"kinds": "conductivity", "materials": {"matrix": {"conductivity_w_m_k": 1.0},
                "aggregate": {"density_kg_m3": 1}}}),
            &Limits::default(),
            "/materials/aggregate/conductivity_w_m_k: is missing: kinds=conductivity needs it",
        ),
    ] {
        let mut all = json!({"type": "properties", "materials": materials()});
        all.as_object_mut().unwrap().extend(options.as_object().unwrap().clone());
        let model = Model::new(specimen, grains);
        let error = match ExportRequest::from_json(&all) {
            Ok(export) => export.write(&model, limits, &Unattended, &mut Vec::new()).unwrap_err().to_string(),
            Err(faults) => faults.iter().map(ToString::to_string).collect(),
        };
        assert!(error.contains(says), "{options}: {error}");
    }
    let bare = ExportRequest::from_json(&json!({"type": "properties"})).unwrap();
    let packing = json!({
        "specimen": {"type": "box", "size_mm": [20, 20, 20]},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 6}, "volume_fraction": 0.1},
    });
    let packing = PackingRequest::from_json(&packing, 1).unwrap();
    let refused = bare.check_materials(&packing).unwrap_err().to_string();
    assert!(refused.contains(crate::request::materials::EXAMPLE), "{refused}");
    for (kinds, says) in [(json!("mass"), "\"mass\" is no kind"), (json!([]), "names no kind")] {
        let faults = ExportRequest::from_json(&json!({"type": "properties", "kinds": kinds})).unwrap_err();
        assert!(faults[0].to_string().contains(says), "{faults:?}");
    }
}

#[test]
fn names_of_files_and_options_read_back() {
    let export = request(&json!({"cells": 64, "kinds": ["expansion", "stiffness"]}));
    let stored = serde_json::to_value(&export).unwrap();
    assert_eq!(stored["kinds"], "stiffness,expansion");
    assert_eq!(ExportRequest::from_json(&stored).unwrap(), export);
    let ending = export.file_ending();
    assert!(ending.starts_with("properties.cells-64.kinds-stiffness-expansion.materials-"), "{ending}");
    assert!(ending.rsplit('.').next() == Some("json") && !ending.contains('{'), "{ending}");
}
