//! Decks against closed forms: what CalculiX computes of them, and what is refused.

use std::io::{Cursor, Read as _};
use std::path::{Path, PathBuf};
use std::process::Command;

use nalgebra::{Matrix3, Vector3};
use serde_json::json;

use super::*;
use crate::control::Unattended;
use crate::export::voxels::{VoxelGrid, VoxelOptions, of_labels};
use crate::export::{ExportReport, ExportRequest, ExportType};
use crate::packing::Spheres;
use crate::request::Boundary;
use crate::request::decode::{At, Faults};
use crate::request::materials::EXAMPLE;
use crate::solution::{BALANCE, Results, Solution};

/// CalculiX: that of `PACKSTONE_CCX`, else one on PATH. Without it the tests that need it say so.
pub(super) fn ccx() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os("PACKSTONE_CCX") {
        return Some(named.into());
    }
    let path = std::env::var_os("PATH")?;
    let found = std::env::split_paths(&path).map(|folder| folder.join("ccx")).find(|file| file.is_file());
    if found.is_none() {
        eprintln!("SKIPPED: no ccx on PATH, and PACKSTONE_CCX names none");
    }
    found
}

/// Young's modulus in GPa, Poisson's ratio, expansion in 1/K.
pub(super) type Constants = (f64, f64, f64);
pub(super) const MATRIX_CONSTANTS: Constants = (25.0, 0.2, 1.1e-5);
pub(super) const GRAIN_CONSTANTS: Constants = (70.0, 0.28, 5e-6);

pub(super) fn materials(matrix: Constants, grains: Constants) -> Materials {
    let of = |(e, nu, alpha): Constants| {
        json!({"youngs_modulus_gpa": e, "poissons_ratio": nu, "expansion_1_k": alpha, "density_kg_m3": 2400.0,
               "conductivity_w_m_k": 2.0})
    };
    let value = json!({"matrix": of(matrix), "aggregate": of(grains)});
    Materials::read(&At::root(&value, &Faults::default())).unwrap()
}

pub(super) fn options(text: &[(&str, &str)]) -> DeckOptions {
    match ExportRequest::from_text(ExportType::Deck, text.iter().copied()).unwrap() {
        ExportRequest::Deck(options) => options,
        other => panic!("{other:?}"),
    }
}

fn voxels_of(options: &DeckOptions) -> VoxelOptions {
    let DeckMesh::Voxels(own) = &options.mesh else { panic!("{options:?}") };
    own.voxels()
}

pub(super) fn cuboid(size_mm: [f64; 3]) -> Specimen {
    Specimen::Box { size_mm, boundary: Boundary::Walls }
}

/// Hexahedra of a specimen without a packing: a function gives the phase of the voxel at a place.
pub(super) fn hexahedra(specimen: &Specimen, cells: u32, phase: impl Fn([usize; 3]) -> u32) -> SolidMesh {
    let cells = cells.to_string();
    let grid = VoxelGrid::new(specimen, &voxels_of(&options(&[("cells", &cells)])));
    let [nx, ny, _] = grid.shape;
    let of = |voxel: usize| phase([voxel % nx, voxel / nx % ny, voxel / nx / ny]);
    let mut mesh = of_labels(&grid, of, &Unattended).unwrap();
    if mesh.grain_of.iter().any(|grain| *grain > 0) {
        let role = PhaseRole::Aggregate { name: None };
        mesh.phases.push(PhaseSet { name: "aggregates".into(), role });
        mesh.phase_of = mesh.grain_of.iter().map(|grain| u16::from(*grain > 0)).collect();
    }
    mesh
}

/// The files of a deck by name.
pub(super) fn unzipped(bytes: &[u8]) -> Vec<(String, String)> {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    (0..archive.len())
        .map(|i| {
            let mut file = archive.by_index(i).unwrap();
            let mut text = String::new();
            file.read_to_string(&mut text).unwrap();
            (file.name().unwrap().into_owned(), text)
        })
        .collect()
}

/// Runs CalculiX in a folder.
pub(super) fn run(ccx: &Path, folder: &Path, model: &str) {
    let run = Command::new(ccx).arg(model).current_dir(folder).output().unwrap();
    let log = String::from_utf8_lossy(&run.stdout).into_owned();
    assert!(run.status.success() && log.contains("Job finished"), "{log}");
}

/// What CalculiX computes of a deck; `None` where there is no CalculiX.
pub(super) fn solved(deck: &Deck) -> Option<Solution> {
    let ccx = ccx()?;
    let mut bytes = Vec::new();
    deck.write(None, NonZeroUsize::MIN, &Unattended, &mut bytes).unwrap();
    let folder = tempfile::tempdir().unwrap();
    Some(solution_in(folder.path(), &ccx, &bytes))
}

/// Unpacks a deck into a folder, and solves it there.
pub(super) fn solution_in(folder: &Path, ccx: &Path, zip: &[u8]) -> Solution {
    for (name, text) in &unzipped(zip) {
        std::fs::write(folder.join(name), text).unwrap();
    }
    run(ccx, folder, MODEL);
    let text = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let results = Results::of_deck(&text("deck.json"), &text("mesh.inp")).unwrap();
    let solution = results.solution(&text("model.dat")).unwrap();
    assert!(solution.imbalance < BALANCE, "{solution:?}");
    assert!(solution.stray_stress.unwrap_or_default() < BALANCE, "{solution:?}");
    let mut vtu = Vec::new();
    results.write_vtu(&text("model.frd"), None, &Unattended, &mut vtu).unwrap();
    for name in ["displacement", "stress", "strain"] {
        assert!(String::from_utf8_lossy(&vtu).contains(&format!("Name=\"{name}\"")), "{name}");
    }
    solution
}

pub(super) fn near(found: f64, expected: f64) {
    assert!((found / expected - 1.0).abs() < 1e-6, "{found}, not {expected}");
}

/// A homogeneous box has its own constants under every load, and so has a homogeneous cylinder.
#[test]
fn a_homogeneous_specimen_has_its_own_constants() {
    let (e, nu, alpha) = MATRIX_CONSTANTS;
    let cylinder = Specimen::Cylinder { diameter_mm: 9.0, height_mm: 7.0 };
    for specimen in [cuboid([8.0, 6.0, 5.0]), cylinder] {
        for load in Load::ALL.into_iter().filter(|load| load.fits(&specimen)) {
            let mesh = hexahedra(&specimen, 5, |_| 0);
            let options = options(&[("load", load.name())]);
            let materials = materials(MATRIX_CONSTANTS, GRAIN_CONSTANTS);
            let deck = Deck::new(Meshed::of_voxels(mesh), &specimen, &options.case, &materials, &Unattended)
                .unwrap();
            let Some(solution) = solved(&deck) else { return };
            let (uniaxial, shear) = (load.axis().is_some(), load.plane().is_some());
            assert_eq!(solution.youngs_modulus_gpa.is_some(), uniaxial);
            assert_eq!(solution.shear_modulus_gpa.is_some(), shear);
            solution.youngs_modulus_gpa.inspect(|found| near(*found, e));
            for ratio in solution.poissons_ratios.iter().flatten() {
                near(*ratio, nu);
            }
            solution.shear_modulus_gpa.inspect(|found| near(*found, e / 2.0 / (1.0 + nu)));
            solution.expansion_1_k.iter().flatten().for_each(|found| near(*found, alpha));
        }
    }
}

/// Normal stiffness and thermal stress of layers across x, and shear moduli along and across them (Backus 1962,
/// 10.1029/JZ067i011p04427, for isotropic layers).
struct Laminate {
    stiffness: Matrix3<f64>,
    thermal_stress: Vector3<f64>,
    shear_across: f64,
    shear_along: f64,
}

fn laminate(layers: &[(f64, Constants)]) -> Laminate {
    let mean = |of: &dyn Fn(f64, f64, f64) -> f64| -> f64 {
        let of_layer = |(share, (e, nu, alpha)): &(f64, Constants)| {
            let lambda = e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu));
            let c11 = lambda + e / (1.0 + nu);
            share * of(c11, lambda, (c11 + 2.0 * lambda) * alpha)
        };
        layers.iter().map(of_layer).sum()
    };
    let cxx = 1.0 / mean(&|c11, _, _| 1.0 / c11);
    let ratio = mean(&|c11, c12, _| c12 / c11);
    let cxy = ratio * cxx;
    let cyy = mean(&|c11, c12, _| c11 - c12 * c12 / c11) + ratio * ratio * cxx;
    let cyz = mean(&|c11, c12, _| c12 - c12 * c12 / c11) + ratio * ratio * cxx;
    let tx = mean(&|c11, _, thermal| thermal / c11) * cxx;
    let ty = mean(&|c11, c12, thermal| thermal - c12 * thermal / c11) + ratio * tx;
    Laminate {
        stiffness: Matrix3::new(cxx, cxy, cxy, cxy, cyy, cyz, cxy, cyz, cyy),
        thermal_stress: Vector3::new(tx, ty, ty),
        shear_across: 1.0 / mean(&|c11, c12, _| 2.0 / (c11 - c12)),
        shear_along: mean(&|c11, c12, _| (c11 - c12) / 2.0),
    }
}

/// Layers, whose displacements are linear in each, come out exactly: under all loads, across and along them.
#[test]
fn layers_have_their_closed_form() {
    let specimen = cuboid([8.0, 4.0, 6.0]);
    let expected = laminate(&[(0.625, MATRIX_CONSTANTS), (0.375, GRAIN_CONSTANTS)]);
    let compliance = expected.stiffness.try_inverse().unwrap();
    for load in Load::ALL {
        let mesh = hexahedra(&specimen, 8, |[i, ..]| u32::from(i >= 5));
        let options = options(&[("load", load.name()), ("cells", "8")]);
        let materials = materials(MATRIX_CONSTANTS, GRAIN_CONSTANTS);
        let deck =
            Deck::new(Meshed::of_voxels(mesh), &specimen, &options.case, &materials, &Unattended).unwrap();
        let Some(solution) = solved(&deck) else { return };
        if let Some(axis) = load.axis() {
            near(solution.youngs_modulus_gpa.unwrap(), 1.0 / compliance[(axis, axis)]);
            let lateral = (0..3).filter(|other| *other != axis);
            for (other, found) in lateral.zip(solution.poissons_ratios.unwrap()) {
                near(found, -compliance[(other, axis)] / compliance[(axis, axis)]);
            }
        } else if let Some([a, _]) = load.plane() {
            let across = a == 0;
            let modulus = if across { expected.shear_across } else { expected.shear_along };
            near(solution.shear_modulus_gpa.unwrap(), modulus);
        } else {
            let free = compliance * expected.thermal_stress;
            for (found, expected) in solution.expansion_1_k.unwrap().into_iter().zip(free.iter()) {
                near(found, *expected);
            }
        }
    }
}

/// A bar of two columns along z: stretched along it the stiffness is the mean of both where both have one Poisson's
/// ratio.
#[test]
fn a_two_phase_prism_has_the_mean_modulus() {
    let specimen = cuboid([4.0, 4.0, 8.0]);
    let mesh = hexahedra(&specimen, 8, |[i, j, _]| u32::from(i >= 1 && j >= 2));
    let constants = |e: f64| (e, 0.25, 0.0);
    let materials = materials(constants(10.0), constants(300.0));
    let options = options(&[("strain", "-0.001"), ("cells", "8")]);
    let deck = Deck::new(Meshed::of_voxels(mesh), &specimen, &options.case, &materials, &Unattended).unwrap();
    let Some(solution) = solved(&deck) else { return };
    near(solution.youngs_modulus_gpa.unwrap(), 0.625 * 10.0 + 0.375 * 300.0);
    near(solution.mean_stress_mpa[2], -(0.625 * 10.0 + 0.375 * 300.0));
    near(solution.reactions_n.last().unwrap().force_n[2], -(0.625 * 10.0 + 0.375 * 300.0) * 16.0);
}

/// Grains of stiffness 0 are left out, with what they alone surround, and what is left runs.
#[test]
fn pores_are_left_out_with_what_they_enclose() {
    let specimen = cuboid([6.0; 3]);
    // A shell of pore around one voxel of matrix.
    let shell = |at: [usize; 3]| at.iter().all(|x| (1..4).contains(x)) && at != [2, 2, 2];
    let mesh = hexahedra(&specimen, 6, |at| u32::from(shell(at)));
    let materials = materials(MATRIX_CONSTANTS, (0.0, 0.0, 0.0));
    let options = options(&[("cells", "6"), ("load", "uniaxial_x")]);
    let deck = Deck::new(Meshed::of_voxels(mesh), &specimen, &options.case, &materials, &Unattended).unwrap();
    assert_eq!((deck.report.pore_elements, deck.report.loose_elements), (26, 1));
    assert_eq!(deck.report.number_of_elements, 216 - 27);
    near(deck.report.volume_mm3, 216.0);
    assert_eq!(deck.report.phases.len(), 1);
    assert!(deck.report.warnings[0].starts_with("1 elements are left out"), "{:?}", deck.report.warnings);
    let Some(solution) = solved(&deck) else { return };
    let e = solution.youngs_modulus_gpa.unwrap();
    // Between columns without any pore and the Voigt bound.
    assert!(e > 25.0 * 27.0 / 36.0 && e < 25.0 * 189.0 / 216.0, "{e}");
}

/// Pieces that touch along an edge alone are no connection.
#[test]
fn what_hangs_by_an_edge_is_loose() {
    let specimen = cuboid([4.0, 4.0, 4.0]);
    let mesh = hexahedra(&specimen, 4, |[i, j, _]| u32::from((i < 2) != (j < 2)));
    let is_solid = [false, true];
    let (part, left_out) = solid_part::solid_part(mesh, &is_solid).unwrap();
    assert_eq!((left_out.pores, left_out.loose, part.len()), (32, 16, 16));
    assert_eq!(part.nodes_mm.len(), 3 * 3 * 5);
}

/// What cannot be solved is refused before a byte is written.
#[test]
fn decks_that_cannot_run_are_refused_before_anything_is_written() {
    let specimen = cuboid([6.0; 3]);
    let materials = materials(MATRIX_CONSTANTS, GRAIN_CONSTANTS);
    let options_of = |load: &str| options(&[("load", load), ("cells", "3")]);
    let refusal = |mesh: SolidMesh, load: &str, materials: &Materials| match Deck::new(
        Meshed::of_voxels(mesh),
        &specimen,
        &options_of(load).case,
        materials,
        &Unattended,
    ) {
        Err(error) => error.to_string(),
        Ok(deck) => panic!("{:?}", deck.report),
    };
    let mesh = || hexahedra(&specimen, 3, |_| 0);
    // Nodes that no face has any more: too few constraints, a load on no node, an empty set.
    let with_faces = |keep: &dyn Fn(&str, usize) -> bool| {
        let mut mesh = mesh();
        for face in &mut mesh.faces {
            let (name, mut at) = (face.name.clone(), 0..);
            face.nodes.retain(|_| keep(&name, at.next().unwrap_or_default()));
        }
        mesh
    };
    let few = with_faces(&|face, at| at < if face == "z_max" { 9 } else { 1 });
    assert!(refusal(few, "uniaxial_z", &materials).contains("too few constraints"));
    let unloaded = with_faces(&|face, _| face != "z_max");
    let text = refusal(unloaded, "uniaxial_z", &materials);
    assert!(text.contains("a load of the deck acts on no node: the set z_max is empty"), "{text}");
    let unsupported = with_faces(&|face, _| face != "x_min");
    assert!(refusal(unsupported, "uniaxial_z", &materials).contains("a support of the deck acts on no node"));
    let untied = with_faces(&|face, _| face != "y_max");
    assert!(refusal(untied, "temperature", &materials).contains("the set y_max of the deck is empty"));
    let mut empty = mesh();
    empty.phases.push(PhaseSet { name: "aggregates".into(), role: PhaseRole::Aggregate { name: None } });
    assert!(
        refusal(empty, "shear_xy", &materials)
            .contains("the set of elements aggregates of the deck is empty")
    );
    let soft = self::materials((0.0, 0.2, 0.0), GRAIN_CONSTANTS);
    assert!(refusal(mesh(), "shear_xy", &soft).contains("no element of the deck has a stiffness"));
}

/// A packing of two spheres: phases, volumes and materials, by the export as users have it.
#[test]
fn a_packing_becomes_a_deck_and_missing_materials_are_named() {
    let specimen = cuboid([10.0; 3]);
    let mut spheres = Spheres::default();
    spheres.push([3.0, 5.0, 5.0], 4.0);
    spheres.push([7.5, 5.0, 5.0], 3.0);
    let materials = materials(MATRIX_CONSTANTS, GRAIN_CONSTANTS);
    let plain = Model::new(&specimen, &spheres);
    let model = plain.with_materials(Some(&materials));
    let export =
        |text: &[(&str, &str)]| ExportRequest::from_text(ExportType::Deck, text.iter().copied()).unwrap();
    let write = |export: &ExportRequest, model: &Model<'_>, threads: usize| {
        let limits = Limits { export_threads: NonZeroUsize::new(threads).unwrap(), ..Limits::default() };
        let mut out = Vec::new();
        let written = export.write(model, &limits, &Unattended, &mut out);
        (written, out)
    };
    let with = export(&[("cells", "10"), ("load", "temperature")]);
    let (report, bytes) = write(&with, &model, 1);
    assert!(write(&with, &model, 3).1 == bytes);
    let ExportReport::Deck(report) = report.unwrap() else { panic!() };
    assert_eq!((report.number_of_elements, report.nodes), (1000, 1331));
    let expected = with.estimate(&model).unwrap().bytes as usize;
    assert!((0.8..1.25).contains(&(expected as f64 / bytes.len() as f64)), "{expected} of {}", bytes.len());
    let files = unzipped(&bytes);
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["README.txt", "model.inp", "materials.inp", "plates.inp", "deck.json", "mesh.inp"]);
    for (name, text) in &files {
        assert!(name == "deck.json" || text.contains(text::UNITS), "{name}");
    }
    assert_eq!(serde_json::from_str::<DeckReport>(&files[4].1).unwrap(), report);
    assert!(files[2].1.contains("*MATERIAL, NAME=aggregates\n*ELASTIC\n70000.0, 0.28\n"), "{}", files[2].1);
    assert!(files[2].1.contains("** Plasticity and damage of matrix go here"), "{}", files[2].1);
    assert!(files[1].1.contains("*STATIC, SOLVER=SPOOLES\n"), "{}", files[1].1);
    assert_eq!(with.file_ending(), "deck.temperature.cells-10.zip");

    // Abaqus has no such parameter.
    let (_, abaqus) = write(&export(&[("cells", "10"), ("solver", "abaqus")]), &model, 1);
    let model_inp = &unzipped(&abaqus)[1].1;
    assert!(!model_inp.contains("SPOOLES") && model_inp.contains("*ELEMENT OUTPUT\nS, E\n"), "{model_inp}");

    let refusal = |export: &ExportRequest, model: &Model<'_>| {
        let (written, bytes) = write(export, model, 1);
        assert!(bytes.is_empty());
        written.unwrap_err().to_string()
    };
    let coarse = refusal(&export(&[("cells", "1")]), &model);
    assert!(coarse.contains("is empty") && coarse.contains("choose finer elements"), "{coarse}");
    let missing = refusal(&export(&[]), &plain);
    assert!(missing.starts_with("/materials: is missing") && missing.contains(EXAMPLE), "{missing}");
    let half = export(&[("materials", r#"{"matrix": {"youngs_modulus_gpa": 25}}"#)]);
    let half = refusal(&half, &plain);
    assert_eq!(half, "/materials/aggregate: is missing: every phase must have a material");
    let other = r#"{"matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2}, "gravel": {"youngs_modulus_gpa": 9}}"#;
    let other = refusal(&export(&[("materials", other)]), &plain);
    assert!(other.contains("/materials/gravel: is no phase of the mix"), "{other}");
    let cold = r#"{"matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2}, "aggregate": {"youngs_modulus_gpa": 0}}"#;
    let cold = refusal(&export(&[("load", "temperature"), ("materials", cold)]), &plain);
    assert_eq!(cold, "/materials/matrix/expansion_1_k: is missing: the export needs it of every phase");
}

/// Options that contradict one another, and loads that a cylinder does not have.
#[test]
fn options_are_judged() {
    for (text, says) in [
        (&[("load", "temperature"), ("strain", "0.1")][..], "/strain: goes with a uniaxial load or shear"),
        (&[("temperature_change_k", "5")], "/temperature_change_k: goes with load=temperature"),
        (&[("strain", "0")], "/strain: 0 is out of range: must be at least 1e-9 in size"),
        (&[("strain", "-0.2")], "/strain: -0.2 is out of range: must be at least -0.1 and at most 0.1"),
        (&[("cells", "9"), ("voxel_mm", "1")], "/voxel_mm: cells and voxel_mm say the same"),
        (
            &[("order", "2")],
            "/order: goes with elements=tetrahedra or triangles: give that too, or leave it out",
        ),
        (&[("elements", "voxels"), ("segments", "9")], "/segments: goes with elements=tetrahedra"),
        (&[("elements", "tetrahedra"), ("cells", "9")], "/cells: goes with elements=voxels: leave it out"),
        (&[("elements", "tetrahedra"), ("order", "3")], "/order: 3 is out of range"),
        (
            &[("elements", "wedges")],
            "/elements: \"wedges\" is unknown: must be one of \"voxels\", \"tetrahedra\"",
        ),
        (&[("load", "bending")], "/load: \"bending\" is unknown: must be one of \"uniaxial_x\""),
        (&[("solver", "ansys")], "/solver: \"ansys\" is unknown"),
    ] {
        let faults = ExportRequest::from_text(ExportType::Deck, text.iter().copied()).unwrap_err();
        assert!(faults[0].to_string().starts_with(says), "{}", faults[0]);
    }
    let cylinder = Specimen::Cylinder { diameter_mm: 9.0, height_mm: 7.0 };
    for load in Load::ALL {
        let judged = options(&[("load", load.name())]).check(&cylinder, &Limits::default());
        assert_eq!(judged.is_ok(), matches!(load, Load::UniaxialZ | Load::Temperature));
    }
    let written = options(&[("load", "temperature"), ("voxel_mm", "0.5")]);
    let value = serde_json::to_value(ExportRequest::Deck(written.clone())).unwrap();
    assert_eq!(ExportRequest::from_json(&value).unwrap(), ExportRequest::Deck(written));
}
