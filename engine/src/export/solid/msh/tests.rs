//! A file of two tetrahedra, as text and in binary form, whole and damaged.

use super::super::{ElementKind, ElementSide, PhaseRole};
use super::*;
use crate::control::Unattended;
use crate::properties::properties;
use proptest::prelude::*;

/// Numbers of a section: `i` an integer, `s` a size, `d` a double.
type Section = (&'static str, &'static str);

/// Two tetrahedra on the two sides of the triangle 2-3-4: one of the matrix, one of a grain; the face 1-2-3 is `z_min`.
const SECTIONS: [Section; 3] = [
    (
        "Entities",
        "s0 s0 s2 s2  i1 d0 d0 d0 d1 d1 d0 s1 i4 s0  i2 d0 d0 d0 d1 d1 d1 s1 i3 s0 \
         i1 d0 d0 d0 d1 d1 d1 s1 i1 s2 i1 i2  i2 d0 d0 d0 d1 d1 d1 s1 i2 s1 i2",
    ),
    (
        "Nodes",
        "s2 s6 s1 s9  i2 i1 i0 s3 s1 s2 s3 d0 d0 d0 d1 d0 d0 d0 d1 d0 \
         i3 i1 i0 s3 s4 s5 s9 d0 d0 d1 d1 d1 d1 d7 d7 d7",
    ),
    (
        "Elements",
        "s4 s4 s1 s4  i2 i1 i2 s1 s1 s1 s3 s2  i2 i2 i2 s1 s2 s2 s3 s4 \
         i3 i2 i4 s1 s3 s2 s3 s4 s5  i3 i1 i4 s1 s4 s1 s2 s3 s4",
    ),
];

fn file(sections: &[Section], is_text: bool) -> Vec<u8> {
    let mut out = format!("$MeshFormat\n4.1 {} 8\n", u8::from(!is_text)).into_bytes();
    if !is_text {
        out.extend(1_i32.to_le_bytes());
        out.push(b'\n');
    }
    out.extend(
        b"$EndMeshFormat\n$PhysicalNames\n4\n2 3 \"itz\"\n2 4 \"z_min\"\n3 1 \"matrix\"\n3 2 \"aggregates\"\n\
          $EndPhysicalNames\n$Comment\nof another\n$EndComment\n",
    );
    for (name, numbers) in sections {
        out.extend(format!("${name}\n").bytes());
        for number in numbers.split_whitespace() {
            let (kind, text) = number.split_at(1);
            if is_text {
                out.extend(text.bytes());
                out.push(b'\n');
            } else {
                match kind {
                    "i" => out.extend(text.parse::<i32>().unwrap().to_le_bytes()),
                    "s" => out.extend(text.parse::<u64>().unwrap().to_le_bytes()),
                    _ => out.extend(text.parse::<f64>().unwrap().to_le_bytes()),
                }
            }
        }
        out.extend(format!("\n$End{name}\n").bytes());
    }
    out
}

#[test]
fn text_and_binary_files_give_the_same_mesh() {
    let mesh = read(&file(&SECTIONS, true)[..], Bodies::Tetrahedra, &Unattended).unwrap();
    assert_eq!(read(&file(&SECTIONS, false)[..], Bodies::Tetrahedra, &Unattended).unwrap(), mesh);
    assert_eq!((mesh.kind, mesh.nodes_mm.len()), (ElementKind::Tetrahedron4, 5), "node 9 has no element");
    assert_eq!(mesh.elements, [0, 1, 2, 3, 1, 2, 3, 4], "the matrix comes first");
    assert_eq!((&mesh.phase_of[..], &mesh.grain_of[..]), (&[0, 1][..], &[0, 1][..]));
    let names: Vec<_> = mesh.phases.iter().map(|phase| (phase.name.as_str(), &phase.role)).collect();
    let aggregate = PhaseRole::Aggregate { name: None };
    assert_eq!(names, [("matrix", &PhaseRole::Matrix), ("aggregates", &aggregate)]);
    assert_eq!(mesh.grain_surfaces, [1, 2, 3]);
    assert_eq!(mesh.faces.len(), 1);
    assert_eq!((mesh.faces[0].name.as_str(), &mesh.faces[0].nodes[..]), ("z_min", &[0, 1, 2][..]));
    assert_eq!(mesh.faces[0].sides, [ElementSide { element: 0, side: 1 }]);
    let measures = mesh.check(&Unattended).unwrap();
    let volumes: Vec<f64> = measures.phases.iter().map(|phase| phase.volume_mm3).collect();
    assert!((volumes[0] - 1.0 / 6.0).abs() < 1e-15 && (volumes[1] - 1.0 / 3.0).abs() < 1e-15, "{volumes:?}");
}

#[test]
fn mid_nodes_are_put_in_the_order_of_abaqus() {
    let nodes = "s1 s10 s1 s10 i3 i1 i0 s10 s1 s2 s3 s4 s5 s6 s7 s8 s9 s10 \
                 d0 d0 d0 d2 d0 d0 d0 d2 d0 d0 d0 d2 d1 d0 d0 d1 d1 d0 d0 d1 d0 d0 d0 d1 d0 d1 d1 d1 d0 d1";
    let elements = "s1 s1 s1 s1 i3 i1 i11 s1 s1 s1 s2 s3 s4 s5 s6 s7 s8 s9 s10";
    let sections = [SECTIONS[0], ("Nodes", nodes), ("Elements", elements)];
    let mesh = read(&file(&sections, true)[..], Bodies::Tetrahedra, &Unattended).unwrap();
    // Gmsh: 12, 23, 31, 14, 34, 24. A middle in the wrong place would give another volume.
    assert!((mesh.check(&Unattended).unwrap().volume_mm3 - 8.0 / 6.0).abs() < 1e-14);
    assert_eq!(mesh.elements, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]);
    assert_eq!(mesh.phases.len(), 1, "a group without an element is no phase");
}

/// A triangle that runs clockwise is turned round, with its mid nodes; lines are the edges, and their middles belong to
/// them.
#[test]
fn triangles_of_a_cut_run_anticlockwise() {
    let text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n1 3 \"x_min\"\n2 1 \"matrix\"\n$EndPhysicalNames\n\
        $Entities\n0 1 1 0\n1 0 0 0 0 2 0 1 3 0\n1 0 0 0 2 2 0 1 1 0\n$EndEntities\n$Nodes\n1 6 1 6\n2 1 0 6\n1\n2\n3\n4\n5\n6\n\
        0 0 0\n0 2 0\n2 0 0\n0 1 0\n1 1 0\n1 0 0\n$EndNodes\n$Elements\n2 2 1 2\n1 1 8 1\n1 1 2 4\n2 1 9 1\n2 1 2 3 4 5 6\n\
        $EndElements\n";
    let mesh = read(text.as_bytes(), Bodies::Triangles(PlaneState::Strain), &Unattended).unwrap();
    assert_eq!(mesh.kind.abaqus_name(), "CPE6");
    assert_eq!(mesh.elements, [0, 2, 1, 5, 4, 3]);
    assert_eq!((mesh.faces[0].name.as_str(), &mesh.faces[0].nodes[..]), ("x_min", &[0, 1, 3][..]));
    assert_eq!(mesh.faces[0].sides, [ElementSide { element: 0, side: 3 }]);
    let measures = mesh.check(&Unattended).unwrap();
    assert!((measures.volume_mm3 - 2.0).abs() < 1e-15);
    // Of a right triangle with two equal sides: 2 r / R with r = 2 - sqrt 2 and R = sqrt 2 for sides of 2.
    assert!((measures.smallest_gamma.unwrap() - 2.0 * (2.0_f64.sqrt() - 1.0)).abs() < 1e-14);
}

#[test]
fn a_file_that_is_no_mesh_of_a_packing_is_refused_with_its_fault() {
    let with = |section: usize, from: &str, to: &str| {
        let mut sections = SECTIONS.map(|(name, numbers)| (name, numbers.to_owned()));
        assert!(sections[section].1.contains(from), "{from}");
        sections[section].1 = sections[section].1.replacen(from, to, 1);
        let leaked: Vec<Section> =
            sections.into_iter().map(|(name, numbers)| (name, &*numbers.leak())).collect();
        file(&leaked, true)
    };
    let faults = [
        (b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n".to_vec(), "is not MSH 4.1"),
        (b"no mesh".to_vec(), "does not begin with $MeshFormat"),
        (file(&SECTIONS[..2], true), "there is no element of the mesh"),
        (with(2, "s4 s1 s2 s3 s4", "s4 s1 s2 s3 s8"), "there is no node 8"),
        (with(2, "i3 i2 i4", "i3 i7 i4"), "the entity 7 has no named group"),
        (with(2, "i3 i2 i4", "i3 i2 i5"), "elements of the kind 5"),
        (with(1, "s4 s5 s9", "s4 s5 s5"), "two nodes have the same tag"),
        (with(1, "d7", "dnan"), "not finite"),
        (with(2, "s1 s3 s2", "s1 s5 s2"), "0 sides of elements lie on the 1 of the specimen"),
        (with(2, "s1 s1 s1 s3 s2", "s99999999999 s1 s1 s3 s2"), "section Elements"),
    ];
    for (bytes, says) in faults {
        let error = read(&bytes[..], Bodies::Tetrahedra, &Unattended).unwrap_err().to_string();
        assert!(error.contains(says), "{says}: {error}");
    }
}

properties! {
    #[test]
    fn damaged_files_end_without_a_panic(cut in 0_usize..900, at in 0_usize..900, byte in any::<u8>(), is_text in any::<bool>()) {
        let whole = file(&SECTIONS, is_text);
        let mut bytes = whole.clone();
        let length = bytes.len();
        bytes[at % length] = byte;
        // A byte of a coordinate may be another without the file being damaged.
        let _ = read(&bytes[..], Bodies::Tetrahedra, &Unattended).map(|mesh| mesh.check(&Unattended));
        let cut = cut % (length - 1);
        let is_whole = whole[cut..].iter().all(u8::is_ascii_whitespace);
        prop_assert!(is_whole || read(&whole[..cut], Bodies::Tetrahedra, &Unattended).is_err());
    }
}
