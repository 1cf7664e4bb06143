//! Meshes of a few elements whose volumes and qualities are known.

use super::*;
use crate::control::Unattended;

/// A brick of two hexahedra along x, the second an aggregate.
fn two_bricks() -> SolidMesh {
    let nodes_mm = (0..12)
        .map(|n| Vector3::new(f64::from(n % 3) * 2.0, f64::from(n / 3 % 2) * 3.0, f64::from(n / 6) * 5.0))
        .collect();
    let face = |name: &str, nodes: &[u32], sides: &[(u32, u8)]| SpecimenFace {
        name: name.into(),
        nodes: nodes.to_vec(),
        sides: sides.iter().map(|&(element, side)| ElementSide { element, side }).collect(),
    };
    SolidMesh {
        nodes_mm,
        kind: ElementKind::Hexahedron8,
        elements: vec![0, 1, 4, 3, 6, 7, 10, 9, 1, 2, 5, 4, 7, 8, 11, 10],
        phases: vec![
            PhaseSet { name: "matrix".into(), role: PhaseRole::Matrix },
            PhaseSet { name: "aggregate_1_a".into(), role: PhaseRole::Aggregate { name: Some("a".into()) } },
        ],
        phase_of: vec![0, 1],
        grain_of: vec![0, 1],
        faces: vec![
            face("x_min", &[0, 3, 6, 9], &[(0, 6)]),
            face("z_max", &[6, 7, 8, 9, 10, 11], &[(0, 2), (1, 2)]),
        ],
        grain_surfaces: vec![1, 4, 7, 10],
    }
}

/// One tetrahedron with the corners of a cube that is 2 mm wide, and its mid nodes.
fn curved(middle: impl Fn(Vector3<f64>) -> Vector3<f64>) -> SolidMesh {
    let corners = [[0.0; 3], [2.0, 2.0, 0.0], [2.0, 0.0, 2.0], [0.0, 2.0, 2.0]];
    // Turned so that its volume is positive.
    let corners = [corners[0], corners[2], corners[1], corners[3]].map(Vector3::from);
    let mut nodes_mm = corners.to_vec();
    nodes_mm.extend(element::EDGES.map(|[a, b]| middle((corners[a] + corners[b]) / 2.0)));
    SolidMesh {
        nodes_mm,
        kind: ElementKind::Tetrahedron10,
        elements: (0..10).collect(),
        phases: vec![PhaseSet { name: "matrix".into(), role: PhaseRole::Matrix }],
        phase_of: vec![0],
        grain_of: vec![0],
        faces: Vec::new(),
        grain_surfaces: Vec::new(),
    }
}

fn text(mesh: &SolidMesh) -> String {
    let mut out = Vec::new();
    mesh.write_inp(&["units: mm".into()], &Unattended, &mut out).unwrap();
    String::from_utf8(out).unwrap()
}

#[test]
fn a_deck_has_solid_elements_sets_and_surfaces_alone() {
    let lines = [
        "*ELEMENT, TYPE=C3D8, ELSET=matrix",
        "1,1,2,5,4,7,8,11,10",
        "*ELEMENT, TYPE=C3D8, ELSET=aggregate_1_a",
        "2,2,3,6,5,8,9,12,11",
        "*ELSET, ELSET=aggregates",
        "2",
        "*NSET, NSET=x_min",
        "1,4,7,10",
        "*NSET, NSET=z_max",
        "7,8,9,10,11,12",
        "*NSET, NSET=grain_surfaces",
        "2,5,8,11",
        "*SURFACE, TYPE=ELEMENT, NAME=x_min",
        "1, S6",
        "*SURFACE, TYPE=ELEMENT, NAME=z_max",
        "1, S2",
        "2, S2",
    ];
    let text = text(&two_bricks());
    assert!(text.starts_with("** units: mm\n*NODE\n1,0.0,0.0,0.0\n2,2.0,0.0,0.0\n"), "{text}");
    assert!(text.ends_with(&(lines.join("\n") + "\n")), "{text}");
}

#[test]
fn a_coordinate_has_at_most_20_characters_and_12_digits() {
    let mut mesh = two_bricks();
    for (x, written) in [
        (1.0 / 3.0, "0.3333333333333333"),
        (-1.234_567_890_123_456_7e-17, "-1.23456789012e-17"),
        (123.456_789_012_345_67, "123.45678901234567"),
    ] {
        mesh.nodes_mm[0].x = x;
        let text = text(&mesh);
        let first = text.lines().find(|line| line.starts_with("1,")).unwrap();
        assert_eq!(first, format!("1,{written},0.0,0.0"));
        assert!(first.split(',').all(|field| field.len() <= 20));
    }
}

#[test]
fn volumes_are_those_of_the_bricks() {
    let measures = two_bricks().check(&Unattended).unwrap();
    assert_eq!((measures.nodes, measures.elements, measures.smallest_gamma), (12, 2, None));
    for phase in &measures.phases {
        assert_eq!(phase.elements, 1);
        assert!((phase.volume_mm3 - 30.0).abs() < 1e-12, "{phase:?}");
    }
}

#[test]
fn a_regular_tetrahedron_has_gamma_1_and_a_third_of_its_cube() {
    let measures = curved(|middle| middle).check(&Unattended).unwrap();
    assert!((measures.volume_mm3 - 8.0 / 3.0).abs() < 1e-13, "{measures:?}");
    assert!((measures.smallest_gamma.unwrap() - 1.0).abs() < 1e-13);
}

/// A map that moves points along z by a quadratic function of x and y keeps volumes, and quadratic elements represent
/// it exactly.
#[test]
fn a_quadratic_shear_keeps_the_volume_of_a_curved_tetrahedron() {
    let bent = |p: Vector3<f64>| Vector3::new(p.x, p.y, p.z + 0.3 * p.x * p.x - 0.2 * p.x * p.y);
    let mut mesh = curved(|middle| middle);
    mesh.nodes_mm.iter_mut().for_each(|node| *node = bent(*node));
    let measures = mesh.check(&Unattended).unwrap();
    assert!((measures.volume_mm3 - 8.0 / 3.0).abs() < 1e-12, "{measures:?}");
}

#[test]
fn a_mesh_that_no_solver_can_use_is_refused() {
    type Fault = fn(&mut SolidMesh);
    let faults: [(Fault, &str); 10] = [
        (|mesh| mesh.elements.swap(0, 6), "element 1 at"),
        (|mesh| mesh.elements[3] = 12, "names node 13, and there are 12"),
        (|mesh| mesh.phase_of[0] = 2, "names phase 2, and there are 2"),
        (|mesh| mesh.phase_of[1] = 0, "the phase aggregate_1_a has no element"),
        (|mesh| mesh.nodes_mm.push(Vector3::zeros()), "node 13 belongs to no element"),
        (|mesh| mesh.nodes_mm[2].y = f64::NAN, "node 3 has a coordinate that is not finite"),
        (|mesh| mesh.faces[0].nodes.clear(), "the face x_min has no node"),
        (|mesh| mesh.faces[1].sides[0].side = 7, "the face z_max names a side"),
        (|mesh| mesh.grain_surfaces.clear(), "the surfaces of grains have no node"),
        (|mesh| mesh.grain_of.truncate(1), "1 grains of 2 elements"),
    ];
    for (spoil, says) in faults {
        let mut mesh = two_bricks();
        spoil(&mut mesh);
        match mesh.check(&Unattended) {
            Err(ExportError::CheckFailed(what)) => assert!(what.contains(says), "{what}"),
            other => panic!("{says}: {other:?}"),
        }
    }
    // Mid nodes beyond the corners turn a tetrahedron inside out near them.
    let mut mesh = curved(|middle| middle);
    mesh.nodes_mm[4] = 0.9 * mesh.nodes_mm[1];
    assert!(matches!(mesh.check(&Unattended), Err(ExportError::CheckFailed(_))));
}

/// The manuals of Abaqus and CalculiX list the corners of each side so that its normal points into the element.
#[test]
fn sides_are_those_of_the_manuals() {
    let hexahedron = ["1234", "5876", "1562", "2673", "3784", "4851"];
    let tetrahedron = ["123", "142", "243", "341"];
    for (mesh, sides) in [(two_bricks(), &hexahedron[..]), (curved(|middle| middle), &tetrahedron)] {
        let point = |place: usize| mesh.nodes_mm[mesh.element(0)[place] as usize];
        let corners = if mesh.kind == ElementKind::Hexahedron8 { 8 } else { 4 };
        let center = (0..corners).map(point).sum::<Vector3<f64>>() / corners as f64;
        let own: Vec<&[usize]> = mesh.kind.sides().collect();
        assert_eq!(own.len(), mesh.kind.number_of_sides());
        for (own, side) in own.into_iter().zip(sides) {
            let numbers: String = own[..side.len()].iter().map(|place| (place + 1).to_string()).collect();
            assert_eq!(numbers, *side);
            let [a, b, c] = [0, 1, 2].map(|n| point(own[n]));
            assert!((b - a).cross(&(c - a)).dot(&(center - a)) > 0.0, "S{side}");
            // Behind the corners of a tetrahedron's side come the middles of its edges.
            for (n, middle) in own[side.len()..].iter().enumerate() {
                let ends = (point(own[n]) + point(own[(n + 1) % 3])) / 2.0;
                assert!((point(*middle) - ends).norm() < 1e-12);
            }
        }
    }
}

#[test]
fn a_grid_has_the_types_of_vtk() {
    for (mesh, kind) in [(two_bricks(), 12), (curved(|middle| middle), 24)] {
        let mut out = Vec::new();
        mesh.write_vtu(None, &Unattended, &mut out).unwrap();
        let end = b"\n  </AppendedData>\n</VTKFile>\n";
        assert!(out.ends_with(end));
        assert_eq!(out[out.len() - end.len() - 1], kind);
        let expected = SolidMesh::vtu_bytes(mesh.kind, mesh.nodes_mm.len() as u64, mesh.len() as u64);
        let head = out.windows(4).position(|bytes| bytes == b"   _").unwrap() as u64;
        assert!((out.len() as u64).abs_diff(expected) < head + 150, "{} of {expected}", out.len());
    }
}
