//! Decks of tetrahedra against closed forms, on hexahedra that are divided into six tetrahedra each.

use std::collections::BTreeMap;

use super::tests::{
    Constants, GRAIN_CONSTANTS, MATRIX_CONSTANTS, cuboid, hexahedra, materials, near, options, solved,
};
use super::*;
use crate::control::Unattended;
use crate::export::solid::{ElementKind, ElementSide, SpecimenFace};
use crate::export::{ExportRequest, ExportType};
use crate::packing::Spheres;
use crate::request::{Boundary, Specimen};

/// Corners of the tetrahedra around a diagonal of a hexahedron (Kuhn 1960): neighbours have the same triangles.
const KUHN: [[usize; 4]; 6] =
    [[0, 1, 2, 6], [0, 5, 1, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 4, 5, 6], [0, 7, 4, 6]];
/// Ends of the edges in the order of their mid nodes.
const EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];

/// Divides each hexahedron into six tetrahedra of the order.
fn divided(mesh: &SolidMesh, order: u32) -> SolidMesh {
    let mut divided = SolidMesh { kind: ElementKind::Tetrahedron4, ..mesh.clone() };
    divided.elements.clear();
    divided.phase_of.clear();
    divided.grain_of.clear();
    let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    for element in 0..mesh.len() {
        let own = mesh.element(element);
        for corners in KUHN {
            let corners = corners.map(|corner| own[corner]);
            divided.elements.extend(corners);
            if order == 2 {
                for ends in EDGES {
                    let mut ends = ends.map(|end| corners[end]);
                    ends.sort_unstable();
                    let places = ends.map(|end| mesh.nodes_mm[end as usize]);
                    let next = divided.nodes_mm.len() as u32;
                    let middle = *middles.entry(ends).or_insert(next);
                    if middle == next {
                        divided.nodes_mm.push((places[0] + places[1]) / 2.0);
                    }
                    divided.elements.push(middle);
                }
            }
            divided.phase_of.push(mesh.phase_of[element]);
            divided.grain_of.push(mesh.grain_of[element]);
        }
    }
    if order == 2 {
        divided.kind = ElementKind::Tetrahedron10;
    }
    // Sides that one element alone has.
    let mut sides: BTreeMap<Vec<u32>, Vec<ElementSide>> = BTreeMap::new();
    for element in 0..divided.len() {
        for (side, places) in (1..).zip(divided.kind.sides()) {
            let mut nodes: Vec<u32> = places.iter().map(|place| divided.element(element)[*place]).collect();
            nodes.sort_unstable();
            sides.entry(nodes).or_default().push(ElementSide { element: element as u32, side });
        }
    }
    for face in &mut divided.faces {
        let corners = face.nodes.clone();
        let is_on = |node: &u32| *node >= mesh.nodes_mm.len() as u32 || corners.contains(node);
        *face = SpecimenFace { name: face.name.clone(), nodes: Vec::new(), sides: Vec::new() };
        for (nodes, own) in sides.iter().filter(|(nodes, own)| own.len() == 1 && nodes.iter().all(is_on)) {
            face.nodes.extend(nodes);
            face.sides.extend(own);
        }
        face.nodes.sort_unstable();
        face.nodes.dedup();
    }
    divided
}

fn meshed(mesh: &SolidMesh, order: u32) -> Meshed {
    Meshed { elements: DeckElements::Tetrahedra, ..Meshed::of_voxels(divided(mesh, order)) }
}

/// A homogeneous box has its own constants under every load, and so has a column whose nodes lie unevenly about the one
/// that holds it.
#[test]
fn a_homogeneous_specimen_has_its_own_constants() {
    let (e, nu, alpha) = MATRIX_CONSTANTS;
    let cylinder = Specimen::Cylinder { diameter_mm: 9.0, height_mm: 7.0 };
    for (specimen, order) in [(cuboid([8.0, 6.0, 5.0]), 1), (cuboid([8.0, 6.0, 5.0]), 2), (cylinder, 2)] {
        for load in Load::ALL.into_iter().filter(|load| load.fits(&specimen)) {
            let mut mesh = hexahedra(&specimen, 4, |_| 0);
            if matches!(specimen, Specimen::Cylinder { .. }) {
                mesh.nodes_mm.iter_mut().for_each(|x| x.x += 0.03 * x.x * x.x + 0.05 * x.x * x.y);
            }
            let options = options(&[("load", load.name()), ("elements", "tetrahedra")]);
            let materials = materials(MATRIX_CONSTANTS, GRAIN_CONSTANTS);
            let deck =
                Deck::new(meshed(&mesh, order), &specimen, &options.case, &materials, &Unattended).unwrap();
            assert_eq!(deck.report.element_type, if order == 2 { "C3D10" } else { "C3D4" });
            let Some(solution) = solved(&deck) else { return };
            solution.youngs_modulus_gpa.inspect(|found| near(*found, e));
            solution.poissons_ratios.iter().flatten().for_each(|ratio| near(*ratio, nu));
            solution.shear_modulus_gpa.inspect(|found| near(*found, e / 2.0 / (1.0 + nu)));
            solution.expansion_1_k.iter().flatten().for_each(|found| near(*found, alpha));
        }
    }
}

/// A bar of two columns along z, stretched along it: the mean of both where both have one Poisson's ratio.
#[test]
fn a_two_phase_prism_has_the_mean_modulus() {
    let specimen = cuboid([4.0, 4.0, 8.0]);
    let constants = |e: f64| -> Constants { (e, 0.25, 0.0) };
    let materials = materials(constants(10.0), constants(300.0));
    let options = options(&[("strain", "-0.001"), ("elements", "tetrahedra")]);
    for order in [1, 2] {
        let mesh = hexahedra(&specimen, 4, |[i, ..]| u32::from(i == 1));
        let deck =
            Deck::new(meshed(&mesh, order), &specimen, &options.case, &materials, &Unattended).unwrap();
        let Some(solution) = solved(&deck) else { return };
        near(solution.youngs_modulus_gpa.unwrap(), 0.5 * 10.0 + 0.5 * 300.0);
        near(solution.reactions_n.last().unwrap().force_n[2], -0.001 * 155e3 * 16.0);
    }
}

/// Grains of stiffness 0 are left out of tetrahedra too, with what they alone surround, and no mid node stays behind.
#[test]
fn pores_are_left_out_with_what_they_enclose() {
    let specimen = cuboid([6.0; 3]);
    let shell = |at: [usize; 3]| at.iter().all(|x| (1..4).contains(x)) && at != [2, 2, 2];
    let mesh = hexahedra(&specimen, 6, |at| u32::from(shell(at)));
    let materials = materials(MATRIX_CONSTANTS, (0.0, 0.0, 0.0));
    let options = options(&[("load", "uniaxial_x"), ("elements", "tetrahedra")]);
    let deck = Deck::new(meshed(&mesh, 2), &specimen, &options.case, &materials, &Unattended).unwrap();
    assert_eq!((deck.report.pore_elements, deck.report.loose_elements), (6 * 26, 6));
    assert_eq!(deck.report.number_of_elements, 6 * (216 - 27));
    near(deck.report.volume_mm3, 216.0);
    let Some(solution) = solved(&deck) else { return };
    let e = solution.youngs_modulus_gpa.unwrap();
    assert!(e > 25.0 * 27.0 / 36.0 && e < 25.0 * 189.0 / 216.0, "{e}");
}

#[test]
fn options_read_back_and_name_their_file_and_estimates_are_those_of_the_mesh() {
    let read =
        |text: &[(&str, &str)]| ExportRequest::from_text(ExportType::Deck, text.iter().copied()).unwrap();
    for (text, ending) in [
        (&[("elements", "voxels")][..], "deck.zip"),
        (&[("elements", "tetrahedra")], "deck.tetrahedra.zip"),
        (
            &[("elements", "tetrahedra"), ("order", "2"), ("segments", "10"), ("load", "shear_xy")],
            "deck.tetrahedra.shear_xy.segments-10.order-2.zip",
        ),
        (
            &[("elements", "tetrahedra"), ("target_elements", "9000"), ("load", "temperature")],
            "deck.tetrahedra.temperature.target_elements-9000.zip",
        ),
    ] {
        let export = read(text);
        assert_eq!(export.file_ending(), ending);
        assert_eq!(export.needs_mesher(), ending.contains("tetrahedra"));
        let json = serde_json::to_value(&export).unwrap();
        assert_eq!(ExportRequest::from_json(&json).unwrap(), export, "{json}");
    }
    let specimen = cuboid([10.0; 3]);
    let mut spheres = Spheres::default();
    spheres.push([5.0; 3], 4.0);
    let materials = materials(MATRIX_CONSTANTS, GRAIN_CONSTANTS);
    let model = Model::new(&specimen, &spheres).with_materials(Some(&materials));
    let deck = read(&[("elements", "tetrahedra"), ("order", "2")]);
    let mesh = ExportRequest::from_text(ExportType::Mesh, [("format", "inp"), ("order", "2")]).unwrap();
    let (of_deck, of_mesh) = (deck.estimate(&model).unwrap(), mesh.estimate(&model).unwrap());
    let (in_deck, alone) = (of_deck.mesh.unwrap(), of_mesh.mesh.unwrap());
    assert_eq!((in_deck.tetrahedra, in_deck.bytes), (alone.tetrahedra, of_deck.bytes));
    assert_eq!(of_deck.bytes, 100 * in_deck.tetrahedra.unwrap());
    assert!(in_deck.tetrahedra.unwrap() > 1000);
    // Without a mesher, and of a periodic box: nothing is written.
    let periodic = Specimen::Box { size_mm: [10.0; 3], boundary: Boundary::Periodic };
    let of_cell = Model::new(&periodic, &spheres).with_materials(Some(&materials));
    for (model, says) in [(&model, "tetrahedra and triangles are made by Gmsh"), (&of_cell, "ask for voxels")]
    {
        let mut out = Vec::new();
        let refused = deck.write(model, &Limits::default(), &Unattended, &mut out).unwrap_err().to_string();
        assert!(refused.contains(says) && out.is_empty(), "{refused}");
    }
}
