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

/// Of balls in a softer matrix, the estimate of Mori and Tanaka is the lower bound of Hashin and Shtrikman. A cube of
/// balls is not isotropic, but what their images add is of the fourth order in the directions and has no mean over
/// rotations.
#[test]
fn one_ball_in_a_large_cell_raises_the_moduli_as_mori_and_tanaka_say() {
    let (specimen, grains) = (cube(10.0, Boundary::Periodic), one_ball(3.0));
    let report = properties_of(
        &Model::new(&specimen, &grains),
        &json!({"cells": 96, "kinds": "stiffness,conductivity", "tolerance": 1e-5}),
    );
    let (stiffness, conductivity) = (report.stiffness.unwrap(), report.conductivity.unwrap());
    let lower = stiffness.bounds.hashin_shtrikman_lower;
    for (found, expected, matrix) in [
        (stiffness.isotropic.bulk_modulus_gpa, lower.bulk_modulus_gpa, 25.0 / 1.8),
        (stiffness.isotropic.shear_modulus_gpa, lower.shear_modulus_gpa, 25.0 / 2.4),
        (stiffness.isotropic.youngs_modulus_gpa, lower.youngs_modulus_gpa, 25.0),
        (conductivity.isotropic, conductivity.bounds.hashin_shtrikman_lower, 1.8),
    ] {
        assert!((found - expected).abs() < 1e-3 * (expected - matrix), "{found} {expected} {matrix}");
    }
    // A cube of balls has no direction that differs from another.
    let [x, y, z] = stiffness.youngs_moduli_gpa.unwrap();
    assert!((x - y).abs() < 1e-6 * x && (x - z).abs() < 1e-6 * x, "{x} {y} {z}");
    assert!(stiffness.error.solver < 1e-5 && stiffness.error.voxels < 1e-4, "{:?}", stiffness.error);
    assert!(stiffness.error.energy_against_work < 1e-8, "{:?}", stiffness.error);
    assert!((report.phases[1].share - report.phases[1].exact_share).abs() < 1e-12, "{:?}", report.phases);
}

fn random_packing(seed: u64) -> (PackingRequest, Spheres) {
    let packed = PackingRequest::from_json(
        &json!({
            "specimen": {"type": "box", "size_mm": [20, 20, 20], "boundary": "periodic"},
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 6}, "volume_fraction": 0.3},
        }),
        seed,
    )
    .unwrap();
    let packing = pack(&packed, &Limits::default(), &Unattended).unwrap();
    let Grains::Spheres(spheres) = packing.grains else { panic!() };
    (packed, spheres)
}

#[test]
fn the_properties_of_random_packings_lie_within_their_bounds() {
    let mut above = Vec::new();
    for seed in 1..=50 {
        let (packed, spheres) = random_packing(seed);
        // All kinds of the first few.
        let kinds = if seed <= 4 { "stiffness,conductivity,expansion" } else { "stiffness" };
        let options = json!({"cells": 20, "kinds": kinds});
        let report = properties_of(&Model::new(&packed.specimen, &spheres), &options);
        let stiffness = report.stiffness.unwrap();
        let bounds = &stiffness.bounds;
        let of = |moduli: &homogenization::moduli::IsotropicModuli| moduli.youngs_modulus_gpa;
        let own = of(&stiffness.isotropic);
        assert!(of(&bounds.reuss) < of(&bounds.hashin_shtrikman_lower), "{bounds:?}");
        assert!(of(&bounds.hashin_shtrikman_upper) < of(&bounds.voigt), "{bounds:?}");
        let [low, high] = [bounds.hashin_shtrikman_lower, bounds.hashin_shtrikman_upper].map(|m| of(&m));
        assert!(low < own && own < high && own < low * 1.012, "{seed}: {low} {own} {high}");
        above.push(own / low - 1.0);
        let Some(heat) = report.conductivity else { continue };
        let bounds = heat.bounds;
        assert!(heat.isotropic > bounds.hashin_shtrikman_lower, "{heat:?}");
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
    let mean = above.iter().sum::<f64>() / above.len() as f64;
    assert!(mean < 0.01, "{mean}");
}

/// Iterations to the default tolerance: at most with the laminate rule at a contrast of 1000, and in the mean of the
/// load cases with pores.
#[test]
fn iterations_grow_with_the_contrast_as_promised() {
    let (packed, spheres) = random_packing(1);
    let iterations = |options: &Value| {
        let report = properties_of(&Model::new(&packed.specimen, &spheres), options);
        report.stiffness.unwrap().error.iterations
    };
    let aggregate = |e: f64| {
        let phase = |e: f64| json!({"youngs_modulus_gpa": e, "poissons_ratio": 0.2});
        json!({"matrix": phase(25.0), "aggregate": phase(e)})
    };
    let stiff = iterations(&json!({"cells": 24, "kinds": "stiffness", "materials": aggregate(25e3)}));
    assert!(stiff.iter().all(|n| (30..=80).contains(n)), "{stiff:?}");
    let pores =
        json!({"cells": 40, "kinds": "stiffness", "cut_voxels": "labels", "materials": aggregate(0.0)});
    let pores = iterations(&pores);
    assert!((60..=6 * 30).contains(&pores.iter().sum::<u64>()), "{pores:?}");
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
    let of = |threads: usize, options: Value| {
        let export_threads = NonZeroUsize::new(threads).unwrap();
        let limits = Limits { export_threads, ..Limits::default() };
        let mut out = Vec::new();
        request(&options).write(&model, &limits, &Unattended, &mut out).unwrap();
        out
    };
    let one = String::from_utf8(of(1, json!({"cells": 20}))).unwrap();
    let fields = of(1, json!({"cells": 12, "fields": true}));
    for threads in [2, 4] {
        assert_eq!(String::from_utf8(of(threads, json!({"cells": 20}))).unwrap(), one);
        assert!(of(threads, json!({"cells": 12, "format": "vti"})) == fields);
    }
    let report: PropertyReport = serde_json::from_str(&one).unwrap();
    let phase = &report.phases[1];
    assert!((phase.share - phase.exact_share).abs() < 1e-12, "{phase:?}");
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

/// Keeps each checkpoint that it is offered.
#[derive(Default)]
struct Keeps(std::sync::Mutex<Vec<Vec<u8>>>);

impl Control for Keeps {
    fn report(&self, _: &crate::Progress) {}
    fn should_stop(&self) -> bool {
        false
    }
    fn wants_checkpoint(&self) -> bool {
        true
    }
    fn keep_checkpoint(&self, checkpoint: &crate::Checkpoint<'_>) {
        let mut bytes = Vec::new();
        checkpoint.write_to(&mut bytes).unwrap();
        self.0.lock().unwrap().push(bytes);
    }
}

#[test]
fn what_was_solved_is_not_solved_again_and_changes_no_byte() {
    let (specimen, grains) = (cube(10.0, Boundary::Periodic), one_ball(6.0));
    let model = Model::new(&specimen, &grains);
    let export = request(&json!({"cells": 10}));
    let limits = Limits::default();
    let identity = export.checkpoint_identity(&model).unwrap();
    let make = |resume: Option<Resume>, model: &Model<'_>| {
        let (control, mut out) = (Keeps::default(), Vec::new());
        export.write_or_resume(model, &limits, resume, &control, &mut out).unwrap();
        (out, control.0.into_inner().unwrap())
    };
    // Seven load cases of strain and temperature, and three of heat, on either grid.
    let (whole, kept) = make(None, &model);
    assert_eq!(kept.len(), 20);
    for at in [0, 6, 7, 9, 10, 15, 18, 19] {
        let resume = Resume::of_export(&mut &kept[at][..], &identity).unwrap();
        let (out, solved) = make(Some(resume), &model);
        assert_eq!((solved.len(), out == whole), (19 - at, true), "{at}");
    }
    // Of another packing nothing is of use, and of other options it is refused.
    let resume = Resume::of_export(&mut &kept[15][..], &identity).unwrap();
    let other = one_ball(5.0);
    let other = Model::new(&specimen, &other);
    let (out, solved) = make(Some(resume), &other);
    assert_eq!((solved.len(), out == make(None, &other).0), (20, true));
    let finer = request(&json!({"cells": 11})).checkpoint_identity(&model).unwrap();
    assert!(Resume::of_export(&mut &kept[3][..], &finer).is_err());
}

/// Keeps the fraction of each report.
#[derive(Default)]
struct Follows(std::sync::Mutex<Vec<f64>>);

impl Control for Follows {
    fn report(&self, progress: &crate::Progress) {
        self.0.lock().unwrap().push(progress.fraction);
    }
    fn should_stop(&self) -> bool {
        false
    }
}

/// Voxels are made layer by layer, and load cases solved one by one: neither is a leap of the progress.
#[test]
fn the_progress_follows_voxels_and_load_cases() {
    let (specimen, grains) = (cube(10.0, Boundary::Periodic), one_ball(6.0));
    let model = Model::new(&specimen, &grains);
    let limits = Limits { export_threads: NonZeroUsize::MIN, ..Limits::default() };
    let (control, mut out) = (Follows::default(), Vec::new());
    request(&json!({"cells": 20})).write(&model, &limits, &control, &mut out).unwrap();
    let fractions = control.0.into_inner().unwrap();
    assert!(fractions.iter().filter(|of| (0.12..0.33).contains(*of)).count() >= 19, "{fractions:?}");
    let steps = fractions.iter().zip(&fractions[1..]).map(|(before, now)| now - before);
    assert!(steps.fold(0.0, f64::max) < 0.1, "{fractions:?}");
    assert!(fractions.iter().fold(0.0_f64, |most, of| most.max(*of)) > 0.99);
}

/// The file of fields: its length, its arrays, and means of the stresses, which are the stiffness.
#[test]
fn fields_are_written_for_each_load_case() {
    let (specimen, grains) = (cube(10.0, Boundary::Periodic), one_ball(6.0));
    let model = Model::new(&specimen, &grains);
    let export = request(&json!({"cells": 10, "fields": true}));
    assert_eq!((export.format(), export.file_ending().rsplit('.').next()), ("vti", Some("vti")));
    let mut out = Vec::new();
    let report = export.write(&model, &Limits::default(), &Unattended, &mut out).unwrap();
    let ExportReport::Properties(report) = report else { panic!("{report:?}") };
    let expected = export.estimate(&model.with_materials(Some(&parsed(&materials())))).unwrap().bytes;
    assert!(out.len() as u64 <= expected && out.len() as u64 > expected - 9000, "{} {expected}", out.len());
    let start = out.windows(2).position(|pair| pair == b" _").unwrap() + 2;
    let head = String::from_utf8(out[..start].to_vec()).unwrap();
    let offset = |name: &str| -> usize {
        let line = head.lines().find(|line| line.contains(&format!("Name=\"{name}\""))).unwrap();
        line.split("offset=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
    };
    let mean = |name: &str, components: usize, component: usize| -> f64 {
        let at = start + offset(name) + 8;
        let number = |voxel: usize| {
            let at = at + 4 * (components * voxel + component);
            f64::from(f32::from_le_bytes(out[at..at + 4].try_into().unwrap()))
        };
        (0..1000).map(number).sum::<f64>() / 1000.0
    };
    let c = stiffness_of(report.stiffness.as_ref().unwrap());
    for (i, name) in ["xx", "yy", "zz", "yz", "xz", "xy"].into_iter().enumerate() {
        for (component, j) in [0, 1, 2, 5, 3, 4].into_iter().enumerate() {
            let stress = mean(&format!("stress_of_{name}"), 6, component);
            assert!((stress - c[(i, j)]).abs() < 1e-3 * c[(0, 0)], "{name} {component}: {stress} {c}");
            let strain = mean(&format!("strain_of_{name}"), 6, component);
            let expected = if i != j {
                0.0
            } else if i < 3 {
                1.0
            } else {
                0.5
            };
            assert!((strain - expected).abs() < 1e-5, "{name} {component}: {strain}");
        }
    }
    let k = report.conductivity.unwrap().matrix;
    assert!((mean("heat_flux_of_y", 3, 1) + k[1][1]).abs() < 1e-3 * k[1][1]);
    assert!((mean("temperature_gradient_of_y", 3, 1) - 1.0).abs() < 1e-5);
    assert!(head.contains("stress_of_temperature") && !head.contains("diffusion"));
    for (options, says) in [
        (json!({"format": "json", "fields": true}), "needs format=vti"),
        (json!({"format": "vti", "fields": false}), "needs format=json"),
    ] {
        let mut all = json!({"type": "properties"});
        all.as_object_mut().unwrap().extend(options.as_object().unwrap().clone());
        let faults = ExportRequest::from_json(&all).unwrap_err();
        assert!(faults.len() == 1 && faults[0].to_string().contains(says), "{faults:?}");
    }
}

fn parsed(materials: &Value) -> Materials {
    use crate::request::decode::{At, Faults};
    Materials::read(&At::root(materials, &Faults::default())).unwrap()
}

/// Sharp polyhedra have their exact volume in voxels, rounded ones nearly.
#[test]
fn polyhedra_have_their_volume() {
    use crate::shape::polyhedron::samples::{cuboid as polyhedron, octahedron};
    let specimen = cube(10.0, Boundary::Periodic);
    for (rounding, most) in [(0.0, 1e-12), (0.1, 1e-4)] {
        let sharp = vec![polyhedron([1.0, 0.7, 0.4], 0.0), octahedron(1.0)];
        let rounded = |body: crate::shape::Polyhedron| match rounding {
            0.0 => body.normalized(),
            rounding => body.with_relative_rounding(rounding).unwrap().normalized(),
        };
        let templates = sharp.into_iter().map(rounded).collect();
        let pose = |at: [f64; 3], turn: f64| Pose {
            center_mm: Vector3::from(at),
            orientation: UnitQuaternion::from_euler_angles(turn, 0.4, 2.0 * turn),
        };
        let poses = vec![pose([1.0, 4.0, 9.5], 0.3), pose([6.0, 5.0, 4.0], 1.0)];
        let grains = Solids::of_polyhedra(templates, &[0, 1], &[5.0, 4.0], poses);
        let report =
            properties_of(&Model::new(&specimen, &grains), &json!({"cells": 20, "kinds": "conductivity"}));
        let phase = &report.phases[1];
        assert!((phase.share - phase.exact_share).abs() < most * phase.share, "{rounding}: {phase:?}");
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
