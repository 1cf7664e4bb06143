//! Options of tetrahedra, and what is made of a mesher that leaves another mesh than that of the packing.

use serde_json::json;

use super::*;
use std::io::Read;

use crate::export::mesher::Mesher;
use crate::export::{ExportRequest, ExportType};
use crate::request::{PackingRequest, Specimen};
use crate::{Plan, Spheres};

fn read(options: &[(&str, &str)]) -> Result<ExportRequest, String> {
    let read = ExportRequest::from_text(ExportType::Mesh, options.iter().copied());
    read.map_err(|faults| faults.iter().map(ToString::to_string).collect())
}

#[test]
fn options_of_tetrahedra_read_back_and_name_their_file() {
    for (options, ending) in [
        (&[("format", "inp")][..], "tetrahedra.inp"),
        (&[("format", "inp"), ("order", "2")], "tetrahedra.order-2.inp"),
        (&[("elements", "tetrahedra")], "tetrahedra.msh"),
        (&[("elements", "triangles")], "msh"),
        (&[("format", "vtu"), ("segments", "10")], "tetrahedra.segments-10.vtu"),
        (&[("format", "med"), ("target_elements", "50000")], "tetrahedra.target_elements-50000.med"),
        (
            &[("format", "inp"), ("tet_size_mm", "1"), ("tet_size_matrix_mm", "2.5"), ("tet_growth", "1.2")],
            "tetrahedra.tet_size_mm-1.0.tet_size_matrix_mm-2.5.tet_growth-1.2.inp",
        ),
    ] {
        let export = read(options).unwrap();
        assert_eq!(export.file_ending(), ending);
        assert_eq!(export.needs_mesher(), ending.starts_with("tetrahedra"));
        let json = serde_json::to_value(&export).unwrap();
        assert_eq!(ExportRequest::from_json(&json).unwrap(), export, "{json}");
        assert_eq!(export.companion("a.msh").is_some(), ending == "msh");
    }
}

#[test]
fn options_that_do_not_go_together_are_refused() {
    for (options, says) in [
        (&[("format", "inp"), ("elements", "triangles")][..], "/elements: \"triangles\" is unknown"),
        (&[("order", "2")], "/order: goes with elements=tetrahedra"),
        (&[("format", "stl"), ("order", "2")], "/order: unknown option"),
        (
            &[("format", "inp"), ("order", "3")],
            "/order: 3 is out of range: must be a whole number from 1 to 2",
        ),
        (&[("format", "inp"), ("tet_growth", "2")], "/tet_growth: 2 is out of range"),
        (&[("format", "inp"), ("tet_size_mm", "0")], "/tet_size_mm: 0 is out of range"),
        (
            &[("format", "inp"), ("target_elements", "9"), ("segments", "10")],
            "/target_elements: target_elements decides segments too",
        ),
        (
            &[("format", "inp"), ("target_elements", "9"), ("tet_size_matrix_mm", "10")],
            "/target_elements: target_elements decides tet_size_matrix_mm too",
        ),
        (&[("format", "inp"), ("target_elements", "0")], "/target_elements: 0 is out of range"),
    ] {
        let refused = read(options).unwrap_err();
        assert!(refused.contains(says), "{says}: {refused}");
    }
}

#[test]
fn capabilities_name_each_option_once() {
    for format in crate::export::mesh::FORMATS {
        let names = ExportType::Mesh.option_names(format);
        let mut once = names.clone();
        once.sort_unstable();
        once.dedup();
        assert_eq!(once.len(), names.len(), "{format}: {names:?}");
        assert_eq!(names.contains(&"tet_growth"), !["geo", "stl"].contains(&format), "{format}: {names:?}");
    }
}

/// A mesher that returns a file whatever it is given.
#[derive(Debug)]
struct Fixed(&'static str);

struct Files(&'static str);

impl MesherFiles for Files {
    fn open(&self, _: &str) -> io::Result<Box<dyn Read>> {
        Ok(Box::new(self.0.as_bytes()))
    }
}

impl Mesher for Fixed {
    fn version(&self) -> Result<String, ExportError> {
        Ok("Fixed 1".into())
    }

    fn fill(&self, input: MesherInput<'_>, _: &dyn Control) -> Result<Box<dyn MesherFiles>, ExportError> {
        let mut surfaces = Vec::new();
        (input.surfaces.unwrap())(&mut surfaces)?;
        assert_eq!(input.dimension, MeshDimension::Solid);
        assert!(surfaces.starts_with(b"$MeshFormat\n4.1 1 8\n"));
        assert!(input.script.starts_with("Merge \"surfaces.msh\";\nCreateGeometry { Volume{:}; }\n"));
        Ok(Box::new(Files(self.0)))
    }
}

const ONE_TETRAHEDRON: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n3 1 \"matrix\"\n\
    $EndPhysicalNames\n$Entities\n0 0 0 1\n1 0 0 0 1 1 1 1 1 0\n$EndEntities\n$Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n\
    0 0 0\n1 0 0\n0 1 0\n0 0 1\n$EndNodes\n$Elements\n1 1 1 1\n3 1 4 1\n1 1 2 3 4\n$EndElements\n";

#[test]
fn a_mesh_of_another_packing_is_refused() {
    let specimen = Specimen::Box { size_mm: [20.0; 3], boundary: crate::request::Boundary::Walls };
    let grains = Spheres {
        x_mm: vec![10.0],
        y_mm: vec![10.0],
        z_mm: vec![10.0],
        d_mm: vec![8.0],
        ..Spheres::default()
    };
    let export = read(&[("format", "inp"), ("segments", "8")]).unwrap();
    let write = |model: &Model<'_>| {
        let mut out = Vec::new();
        let ended = export.write(model, &Limits::default(), &Unattended, &mut out);
        assert!(out.is_empty(), "nothing is written of a mesh that is refused");
        ended.unwrap_err()
    };
    let model = Model::new(&specimen, &grains);
    assert!(matches!(write(&model), ExportError::Unavailable(what) if what.contains("Gmsh")));
    for (file, says) in [
        ("", "Gmsh left no mesh of the packing: section MeshFormat"),
        (ONE_TETRAHEDRON, "Gmsh's tetrahedra of the specimen have a volume of 0.1666"),
    ] {
        let mesher = Fixed(file);
        let error = write(&model.with_mesher(&mesher));
        assert!(matches!(&error, ExportError::Mesher(what) if what.starts_with(says)), "{error}");
    }
}

/// Measured: A16 above 4 mm, cube of 40 mm, 60 % of all aggregate, gaps of 0.5 mm, 10 segments: 110 387 tetrahedra and
/// 21 491 nodes by Gmsh 4.15.2.
#[test]
fn a_plan_says_how_many_tetrahedra_a_packing_has() {
    let request = json!({"specimen": {"type": "box", "size_mm": [40, 40, 40]}, "seed": 1,
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4, "volume_fraction": 0.6},
        "distance": {"type": "constant", "gap_mm": 0.5}});
    let request = PackingRequest::from_json(&request, 1).unwrap();
    let plan = Plan::new(&request, &Limits::default()).unwrap();
    let of = |options: &[(&str, &str)]| {
        let estimate = read(options).unwrap().estimate_from_plan(&request, &plan).unwrap();
        (estimate.mesh.unwrap(), estimate.bytes)
    };
    let (first, bytes) = of(&[("format", "inp"), ("segments", "10")]);
    let within = |value: Option<u64>, measured: f64| (0.4..2.5).contains(&(value.unwrap() as f64 / measured));
    assert!(within(first.tetrahedra, 110_387.0) && within(first.nodes, 21_491.0), "{first:?}");
    assert_eq!(first.degrees_of_freedom, first.nodes.map(|nodes| 3 * nodes));
    let (second, more_bytes) = of(&[("format", "inp"), ("segments", "10"), ("order", "2")]);
    assert_eq!(second.tetrahedra, first.tetrahedra);
    assert!(second.nodes > first.nodes.map(|nodes| 5 * nodes) && more_bytes > 2 * bytes);
    let (fine, _) = of(&[("format", "inp"), ("segments", "10"), ("tet_size_matrix_mm", "0.4")]);
    assert!(fine.tetrahedra.unwrap().abs_diff(9_000_000) < 10, "{fine:?}");
    let (aimed, _) = of(&[("format", "msh"), ("elements", "tetrahedra"), ("target_elements", "70000")]);
    assert_eq!(aimed.tetrahedra, Some(70_000));
    let (plain, _) = of(&[("format", "msh")]);
    assert_eq!(plain.tetrahedra, None);
}
