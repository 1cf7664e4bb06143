//! Plane models against closed forms, on rectangles that are divided into two triangles each.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::tests::{Constants, GRAIN_CONSTANTS, MATRIX_CONSTANTS, cuboid, materials, near, options, solved};
use super::*;
use crate::control::Unattended;
use crate::export::solid::{ElementKind, ElementSide, SpecimenFace};
use crate::export::{ExportRequest, ExportType};
use crate::packing::Spheres;
use crate::request::Specimen;

/// Columns and rows of rectangles.
const CELLS: [usize; 2] = [4, 3];

/// A rectangle, whose columns are of a phase.
fn divided(
    size_mm: [f64; 2],
    faces: [[&str; 2]; 2],
    order: u32,
    state: PlaneState,
    phase: fn(usize) -> u16,
) -> SolidMesh {
    let [columns, rows] = CELLS;
    let mut nodes_mm: Vec<Vector3<f64>> = Vec::new();
    let mut numbers: BTreeMap<[usize; 2], u32> = BTreeMap::new();
    // Places in half rectangles.
    let mut node = |[i, j]: [usize; 2], nodes_mm: &mut Vec<Vector3<f64>>| {
        *numbers.entry([i, j]).or_insert_with(|| {
            let at = |k: usize, n: usize, length: f64| k as f64 / (2 * n) as f64 * length;
            nodes_mm.push(Vector3::new(at(i, columns, size_mm[0]), at(j, rows, size_mm[1]), 0.0));
            nodes_mm.len() as u32 - 1
        })
    };
    let (mut elements, mut phase_of) = (Vec::new(), Vec::new());
    for j in 0..rows {
        for i in 0..columns {
            let corner = |a: usize, b: usize| [2 * (i + a), 2 * (j + b)];
            for corners in
                [[corner(0, 0), corner(1, 0), corner(1, 1)], [corner(0, 0), corner(1, 1), corner(0, 1)]]
            {
                elements.extend(corners.map(|place| node(place, &mut nodes_mm)));
                if order == 2 {
                    for [a, b] in [[0, 1], [1, 2], [2, 0]] {
                        let middle = [0, 1].map(|axis| (corners[a][axis] + corners[b][axis]) / 2);
                        elements.push(node(middle, &mut nodes_mm));
                    }
                }
                phase_of.push(phase(i));
            }
        }
    }
    let kind = if order == 2 { ElementKind::Triangle6(state) } else { ElementKind::Triangle3(state) };
    let grain_of: Vec<u32> = phase_of.iter().map(|phase| u32::from(*phase)).collect();
    let mut phases = vec![PhaseSet { name: "matrix".into(), role: PhaseRole::Matrix }];
    if grain_of.contains(&1) {
        phases.push(PhaseSet { name: "aggregates".into(), role: PhaseRole::Aggregate { name: None } });
    }
    let mut mesh = SolidMesh {
        nodes_mm,
        kind,
        elements,
        phases,
        phase_of,
        grain_of,
        faces: Vec::new(),
        grain_surfaces: vec![0],
    };
    for (axis, names) in faces.into_iter().enumerate() {
        for (name, at) in names.into_iter().zip([0.0, size_mm[axis]]) {
            let is_on = |node: &u32| mesh.nodes_mm[*node as usize][axis] == at;
            let nodes: Vec<u32> = (0..mesh.nodes_mm.len() as u32).filter(is_on).collect();
            let mut sides = Vec::new();
            for element in 0..mesh.len() {
                for (side, places) in (1..).zip(mesh.kind.sides()) {
                    if places.iter().all(|place| is_on(&mesh.element(element)[*place])) {
                        sides.push(ElementSide { element: element as u32, side });
                    }
                }
            }
            mesh.faces.push(SpecimenFace { name: name.into(), nodes, sides });
        }
    }
    mesh
}

/// The specimen of 8 x 6 x 5 mm, cut across an axis.
fn cut(axis: Axis, order: u32, state: PlaneState, phase: fn(usize) -> u16) -> (Specimen, Meshed) {
    let specimen = cuboid([8.0, 6.0, 5.0]);
    let [u, v] = axis.plane().map(Axis::index);
    let size_mm = [specimen.bounds_mm()[u], specimen.bounds_mm()[v]];
    let mesh = divided(size_mm, [frame::FACES[u], frame::FACES[v]], order, state, phase);
    (specimen, Meshed::of_cut(mesh, axis, 2.5, state))
}

/// A homogeneous cut has the constants of its state under every load in its plane, and no other load acts on it.
#[test]
fn a_homogeneous_cut_has_the_constants_of_its_state() {
    let (e, nu, alpha) = MATRIX_CONSTANTS;
    let materials = materials(MATRIX_CONSTANTS, GRAIN_CONSTANTS);
    for (axis, order, state, name) in [
        (Axis::Z, 1, PlaneState::Stress, "CPS3"),
        (Axis::X, 2, PlaneState::Stress, "CPS6"),
        (Axis::Z, 1, PlaneState::Strain, "CPE3"),
        (Axis::Y, 2, PlaneState::Strain, "CPE6"),
    ] {
        let (e, nu, alpha) = match state {
            PlaneState::Stress => (e, nu, alpha),
            PlaneState::Strain => (e / (1.0 - nu * nu), nu / (1.0 - nu), (1.0 + nu) * alpha),
        };
        let loads: Vec<Load> = Load::ALL.into_iter().filter(|load| load.fits_cut(axis)).collect();
        assert_eq!(loads.len(), 4, "{loads:?}");
        for load in loads {
            let (specimen, meshed) = cut(axis, order, state, |_| 0);
            let options = options(&[("load", load.name())]);
            let deck = Deck::new(meshed, &specimen, &options.case, &materials, &Unattended).unwrap();
            assert_eq!(deck.report.element_type, name);
            let Some(solution) = solved(&deck) else { return };
            solution.youngs_modulus_gpa.inspect(|found| near(*found, e));
            let ratios: Vec<f64> = solution.poissons_ratios.into_iter().flatten().collect();
            assert_eq!(ratios.len(), usize::from(load.axis().is_some()));
            for ratio in ratios {
                near(ratio, nu);
            }
            let shear = MATRIX_CONSTANTS.0 / 2.0 / (1.0 + MATRIX_CONSTANTS.1);
            assert_eq!(solution.shear_modulus_gpa.is_some(), load.plane().is_some());
            solution.shear_modulus_gpa.inspect(|found| near(*found, shear));
            let expansions: Vec<f64> = solution.expansion_1_k.into_iter().flatten().collect();
            assert_eq!(expansions.len(), if load == Load::Temperature { 2 } else { 0 });
            for found in expansions {
                near(found, alpha);
            }
        }
    }
}

/// Two strips side by side, stretched along them: the mean of both where both have one Poisson's ratio; stretched
/// across them in plane stress with a Poisson's ratio of zero: the harmonic mean.
#[test]
fn strips_have_their_mean_moduli() {
    let constants = |nu: f64, e: f64| -> Constants { (e, nu, 0.0) };
    for (nu, state, load) in [
        (0.25, PlaneState::Stress, "uniaxial_y"),
        (0.25, PlaneState::Strain, "uniaxial_y"),
        (0.0, PlaneState::Stress, "uniaxial_x"),
    ] {
        for order in [1, 2] {
            let (specimen, meshed) = cut(Axis::Z, order, state, |column| u16::from(column == 1));
            let options = options(&[("load", load), ("strain", "-0.001")]);
            let materials = materials(constants(nu, 10.0), constants(nu, 300.0));
            let deck = Deck::new(meshed, &specimen, &options.case, &materials, &Unattended).unwrap();
            near(deck.report.phases[1].volume_mm3, 8.0 * 6.0 / 4.0);
            let Some(solution) = solved(&deck) else { return };
            let expected = match (load, state) {
                ("uniaxial_x", _) => 1.0 / (0.75 / 10.0 + 0.25 / 300.0),
                (_, PlaneState::Stress) => 0.75 * 10.0 + 0.25 * 300.0,
                (_, PlaneState::Strain) => (0.75 * 10.0 + 0.25 * 300.0) / (1.0 - nu * nu),
            };
            near(solution.youngs_modulus_gpa.unwrap(), expected);
        }
    }
}

/// What cannot be solved is refused: loads across the cut, cylinders, sets without nodes, too few constraints.
#[test]
fn decks_of_cuts_that_cannot_run_are_refused() {
    let judged = |specimen: &Specimen, text: &[(&str, &str)]| {
        let all: Vec<(&str, &str)> =
            [("elements", "triangles")].into_iter().chain(text.iter().copied()).collect();
        options(&all).check(specimen, &Limits::default()).map_err(|error| error.to_string())
    };
    let specimen = cuboid([8.0, 6.0, 5.0]);
    assert_eq!(judged(&specimen, &[]), Ok(()));
    assert_eq!(judged(&specimen, &[("axis", "x")]), Ok(()));
    let across = judged(&specimen, &[("load", "shear_yz")]).unwrap_err();
    assert_eq!(
        across,
        "/load: shear_yz does not act in the plane of a cut across z: must be one of uniaxial_x, uniaxial_y, shear_xy, \
         temperature"
    );
    assert!(judged(&specimen, &[("at_mm", "5.1")]).unwrap_err().starts_with("/at_mm: 5.1 is out of range"));
    assert!(
        judged(&specimen, &[("max_size_mm", "1e-5")]).unwrap_err().starts_with("/max_size_mm: the triangles")
    );
    let cylinder = Specimen::Cylinder { diameter_mm: 9.0, height_mm: 7.0 };
    let refused = judged(&cylinder, &[("axis", "x"), ("load", "uniaxial_z")]).unwrap_err();
    assert!(refused.starts_with("/elements: triangles make a deck of a box alone"), "{refused}");

    let materials = materials(MATRIX_CONSTANTS, GRAIN_CONSTANTS);
    let refusal = |keep: fn(&str, usize) -> bool| {
        let (specimen, mut meshed) = cut(Axis::Z, 1, PlaneState::Stress, |_| 0);
        for face in &mut meshed.mesh.faces {
            let (name, mut at) = (face.name.clone(), 0..);
            face.nodes.retain(|_| keep(&name, at.next().unwrap_or_default()));
        }
        let case = options(&[("load", "uniaxial_x")]).case;
        match Deck::new(meshed, &specimen, &case, &materials, &Unattended) {
            Err(error) => error.to_string(),
            Ok(deck) => panic!("{:?}", deck.report),
        }
    };
    assert!(refusal(|_, at| at < 1).contains("too few constraints"));
    assert!(refusal(|face, _| face != "x_max").contains("a load of the deck acts on no node: the set x_max"));
    assert!(refusal(|face, _| face != "y_min").contains("a support of the deck acts on no node"));
}

#[test]
fn options_read_back_and_name_their_file() {
    for (text, ending) in [
        (&[][..], "deck.triangles.zip"),
        (
            &[("axis", "x"), ("plane", "strain"), ("order", "2")],
            "deck.triangles.uniaxial_z.x.order-2.plane-strain.zip",
        ),
        (
            &[("load", "shear_xy"), ("at_mm", "3"), ("segments", "12")],
            "deck.triangles.shear_xy.at_mm-3.0.segments-12.zip",
        ),
    ] {
        let all = [("elements", "triangles")].into_iter().chain(text.iter().copied());
        let export = ExportRequest::from_text(ExportType::Deck, all).unwrap();
        assert!(export.needs_mesher());
        let parts = |name: &str| -> Vec<String> {
            let mut parts: Vec<String> = name.split('.').map(str::to_owned).collect();
            parts.sort_unstable();
            parts
        };
        assert_eq!(parts(&export.file_ending()), parts(ending));
        let json = serde_json::to_value(&export).unwrap();
        assert_eq!(ExportRequest::from_json(&json).unwrap(), export, "{json}");
    }
    let specimen = cuboid([8.0, 6.0, 5.0]);
    let model_spheres = Spheres::default();
    let materials = materials(MATRIX_CONSTANTS, GRAIN_CONSTANTS);
    let model = Model::new(&specimen, &model_spheres).with_materials(Some(&materials));
    let export = ExportRequest::from_text(ExportType::Deck, [("elements", "triangles")]).unwrap();
    assert!(export.estimate(&model).unwrap().bytes > 1000);
    let mut out = Vec::new();
    let refused = export.write(&model, &Limits::default(), &Unattended, &mut out).unwrap_err().to_string();
    assert!(refused.contains("made by Gmsh") && out.is_empty(), "{refused}");
}
