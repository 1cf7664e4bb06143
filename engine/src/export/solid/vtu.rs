//! A solid mesh as an unstructured grid of VTK.

use std::io::Write;

use super::{ElementKind, SolidMesh};
use crate::control::Control;
use crate::export::steps::{PIECES_PER_REPORT, Steps};
use crate::export::vtk_xml::VtkXml;
use crate::export::{ExportError, Provenance, go_on};

/// A quantity at the nodes of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeField {
    /// Name of the array.
    pub name: &'static str,
    /// A value for each node.
    pub values: NodeValues,
}

/// Values at the nodes of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub enum NodeValues {
    /// Numbers.
    Scalar(Vec<f32>),
    /// Vectors.
    Vector(Vec<[f32; 3]>),
    /// Symmetric tensors: xx, yy, zz, xy, yz, xz.
    Tensor(Vec<[f32; 6]>),
}

pub(super) fn write(
    mesh: &SolidMesh,
    fields: &[NodeField],
    provenance: Option<&Provenance>,
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<(), ExportError> {
    let (nodes, cells) = (mesh.nodes_mm.len(), mesh.len());
    let piece = [("NumberOfPoints", nodes.to_string()), ("NumberOfCells", cells.to_string())];
    let mut file = VtkXml::new("UnstructuredGrid", &[], &piece, provenance);
    file.section("Points", None);
    file.array("Points", nodes, mesh.nodes_mm.iter().map(|point| <[f64; 3]>::from(*point)));
    if !fields.is_empty() {
        file.section("PointData", None);
    }
    for NodeField { name, values } in fields {
        match values {
            NodeValues::Scalar(values) => file.array(name, nodes, values.iter().copied()),
            NodeValues::Vector(values) => file.array(name, nodes, values.iter().copied()),
            NodeValues::Tensor(values) => file.array(name, nodes, values.iter().copied()),
        }
    }
    file.section("CellData", Some("phase"));
    file.array("phase", cells, mesh.phase_of.iter().map(|phase| i32::from(*phase)));
    file.array("grain", cells, mesh.grain_of.iter().copied());
    file.section("Cells", None);
    let per_cell = mesh.kind.nodes();
    // The mid nodes of VTK's quadratic tetrahedron lie on the edges 12, 23, 31, 14, 24, 34 too.
    file.array("connectivity", per_cell * cells, mesh.elements.iter().map(|node| i64::from(*node)));
    file.array("offsets", cells, (1..=cells).map(|cell| (per_cell * cell) as i64));
    file.array("types", cells, std::iter::repeat_n(mesh.kind.vtk_type(), cells));
    let steps = Steps { control, total: file.bytes() as usize, unit: "bytes", message: "writing elements" };
    let mut blocks: usize = 0;
    file.write(out, &mut |written| {
        if blocks.is_multiple_of(PIECES_PER_REPORT) {
            steps.report(written as usize);
        }
        blocks += 1;
        go_on(control)
    })
}

pub(super) fn bytes(kind: ElementKind, nodes: u64, elements: u64) -> u64 {
    let element = 4 + 4 + 8 * kind.nodes() as u64 + 8 + 1;
    nodes.saturating_mul(24).saturating_add(elements.saturating_mul(element))
}
