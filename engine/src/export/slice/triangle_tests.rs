//! Options of triangles, and what is made of a mesher that leaves another mesh than that of the cut.

use std::io::Read;

use super::*;
use crate::control::Unattended;
use crate::export::mesher::Mesher;
use crate::export::slice::tests::cube;
use crate::export::slice::{Ellipse, Polygon};
use crate::export::{ExportReport, ExportRequest, ExportType};
use crate::packing::Spheres;
use crate::request::Boundary;

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
        assert!(input.dimension == MeshDimension::Plane && input.surfaces.is_none());
        for line in
            ["DefineConstant[ segments = {12, Name", "size_max = {2.5, Name", "\nMesh.ElementOrder = 1;\n"]
        {
            assert!(input.script.contains(line), "{line}: {}", input.script);
        }
        Ok(Box::new(Files(self.0)))
    }
}

/// The square of 10 mm as two triangles.
const SQUARE: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n1 2 \"x_min\"\n2 1 \"matrix\"\n\
    $EndPhysicalNames\n$Entities\n0 1 1 0\n1 0 0 0 0 10 0 1 2 0\n1 0 0 0 10 10 0 1 1 0\n$EndEntities\n$Nodes\n1 4 1 4\n\
    2 1 0 4\n1\n2\n3\n4\n0 0 0\n10 0 0\n10 10 0\n0 10 0\n$EndNodes\n$Elements\n2 3 1 3\n1 1 1 1\n1 4 1\n2 1 2 2\n\
    2 1 2 3\n3 1 3 4\n$EndElements\n";
/// One of them.
const HALF: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n2 1 \"matrix\"\n$EndPhysicalNames\n\
    $Entities\n0 0 1 0\n1 0 0 0 10 10 0 1 1 0\n$EndEntities\n$Nodes\n1 3 1 3\n2 1 0 3\n1\n2\n3\n0 0 0\n10 0 0\n10 10 0\n\
    $EndNodes\n$Elements\n1 1 1 1\n2 1 2 1\n2 1 2 3\n$EndElements\n";

fn export(format: &str) -> ExportRequest {
    let options = [("format", format), ("segments", "12"), ("max_size_mm", "2.5"), ("plane", "strain")];
    ExportRequest::from_text(ExportType::Slice, options).unwrap()
}

#[test]
fn what_the_mesher_leaves_is_read_checked_and_written() {
    let (specimen, none) = (cube(Boundary::Walls), Spheres::default());
    let model = Model::new(&specimen, &none);
    let mesher = Fixed(SQUARE);
    let write = |format: &str| {
        let mut out = Vec::new();
        let model = model.with_mesher(&mesher);
        let report = export(format).write(&model, &Limits::default(), &Unattended, &mut out).unwrap();
        (report, String::from_utf8_lossy(&out).into_owned())
    };
    let (report, inp) = write("inp");
    let ExportReport::Slice(report) = report else { panic!("{report:?}") };
    let triangles = report.triangles.unwrap();
    assert_eq!((triangles.elements, triangles.nodes, triangles.degrees_of_freedom), (2, 4, 8));
    assert_eq!((triangles.mesher.as_str(), triangles.element_type.as_str()), ("Fixed 1", "CPE3"));
    assert!(triangles.area_error.abs() < 1e-15 && triangles.aggregate_area_error == 0.0, "{triangles:?}");
    for line in [
        "*ELEMENT, TYPE=CPE3, ELSET=matrix\n1,1,2,3\n2,1,3,4\n",
        "*NSET, NSET=x_min\n1,4\n*SURFACE, TYPE=ELEMENT, NAME=x_min\n2, S3\n",
    ] {
        assert!(inp.contains(line), "{inp}");
    }
    assert!(write("vtu").1.contains("Name=\"phase\""));
    assert_eq!(write("msh").1, SQUARE);
}

#[test]
fn a_mesh_of_another_cut_is_refused_and_nothing_is_written() {
    let specimen = cube(Boundary::Walls);
    let mut one = Spheres::default();
    one.push([5.0; 3], 4.0);
    let none = Spheres::default();
    for (spheres, file, says) in [
        (&none, HALF, "Gmsh's triangles have an area of 50 mm² where the cut has 100 mm²"),
        (&none, "no mesh", "Gmsh left no mesh of the packing: section MeshFormat"),
        (&one, SQUARE, "Gmsh left 0 surfaces of grains where the cut has 1"),
    ] {
        let (mesher, mut out) = (Fixed(file), Vec::new());
        let model = Model::new(&specimen, spheres).with_mesher(&mesher);
        let ended = export("inp").write(&model, &Limits::default(), &Unattended, &mut out);
        let error = ended.unwrap_err();
        assert!(matches!(&error, ExportError::Mesher(what) if what.starts_with(says)), "{error}");
        assert!(out.is_empty());
    }
    let mut out = Vec::new();
    let without =
        export("vtu").write(&Model::new(&specimen, &one), &Limits::default(), &Unattended, &mut out);
    assert!(matches!(without.unwrap_err(), ExportError::Unavailable(what) if what.contains("Gmsh")));
}

#[test]
fn options_of_triangles_read_back_and_name_their_file() {
    for (options, ending) in [
        (&[("elements", "triangles")][..], "slice.msh"),
        (&[("format", "inp")], "slice.inp"),
        (&[("format", "inp"), ("order", "2"), ("plane", "strain")], "slice.order-2.plane-strain.inp"),
        (&[("format", "vtu"), ("axis", "x"), ("segments", "12")], "slice.x.segments-12.vtu"),
        (&[], "slice.svg"),
        (&[("format", "geo")], "slice.geo"),
    ] {
        let export = ExportRequest::from_text(ExportType::Slice, options.iter().copied()).unwrap();
        assert_eq!(export.file_ending(), ending);
        let has_triangles = ["msh", "inp", "vtu"].iter().any(|format| ending.ends_with(format));
        assert_eq!((export.needs_mesher(), export.is_quick()), (has_triangles, !has_triangles));
        let json = serde_json::to_value(&export).unwrap();
        assert_eq!(ExportRequest::from_json(&json).unwrap(), export, "{json}");
    }
    for (options, says) in [
        (&[("order", "2")][..], "/order: unknown option"),
        (&[("format", "inp"), ("order", "3")], "/order: 3 is out of range"),
        (&[("format", "inp"), ("elements", "tetrahedra")], "/elements: \"tetrahedra\" is unknown"),
        (&[("format", "inp"), ("pixels", "100")], "/pixels: pixels are for the format"),
        (&[("format", "vtu"), ("max_size_mm", "0")], "/max_size_mm: 0 is out of range"),
        (&[("format", "svg"), ("elements", "triangles")], "/elements: unknown option"),
    ] {
        let faults = ExportRequest::from_text(ExportType::Slice, options.iter().copied()).unwrap_err();
        assert!(faults[0].to_string().starts_with(says), "{says}: {}", faults[0]);
    }
}

/// Points of the boundary of each figure have the gauge 1, and others that of their place between centre and boundary.
#[test]
fn the_gauge_of_a_section_is_one_on_its_boundary() {
    let ellipse = Figure::Ellipse(Ellipse { semi_axes_mm: [3.0, 1.0], long: [0.6, 0.8] });
    let corners_mm = vec![[2.0, 0.0], [0.0, 2.0], [-2.0, 0.0], [0.0, -2.0]];
    let polygon = Figure::Polygon(Polygon { corners_mm, is_curved: Vec::new() });
    for (figure, boundary) in [
        (&Figure::Circle { radius_mm: 2.5 }, [1.5, -2.0]),
        (&ellipse, [1.8, 2.4]),
        (&ellipse, [-0.8, 0.6]),
        (&polygon, [0.5, 1.5]),
    ] {
        for factor in [0.2, 1.0, 3.0] {
            let found = gauge(figure, boundary.each(|x| factor * x));
            assert!((found - factor).abs() < 1e-12, "{figure:?}: {found}, not {factor}");
        }
    }
}
