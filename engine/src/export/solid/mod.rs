//! Solid meshes of a packing, and plane ones of a cut: nodes, tetrahedra, hexahedra or triangles, a set of elements for
//! each phase, and the faces of the specimen.
//!
//! [`SolidMesh`] is what a solver's deck is made of. `element` knows the shapes of elements (numbers of nodes, sides,
//! volumes), `measures` checks a mesh, `inp` and `vtu` write it, [`msh`] reads it from a file of Gmsh.

mod element;
mod inp;
mod measures;
pub mod msh;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
mod vtu;

use std::io::Write;

use nalgebra::Vector3;

use super::steps::Steps;
use super::{ExportError, Provenance};
use crate::control::Control;

pub use element::{ElementKind, PlaneState};
pub use measures::{PhaseMeasures, SolidMeasures};
pub use vtu::{NodeField, NodeValues};

/// Elements between two looks at whether to stop.
const ELEMENTS_PER_LOOK: usize = 1 << 12;

/// A mesh of elements of one kind. Plane ones lie in the plane of x and y, and their faces are edges.
#[derive(Clone, Debug, PartialEq)]
pub struct SolidMesh {
    /// Positions of the nodes, in mm. Each node belongs to an element.
    pub nodes_mm: Vec<Vector3<f64>>,
    /// The kind of all elements.
    pub kind: ElementKind,
    /// Nodes of the elements, counted from 0: [`ElementKind::nodes`] of each, in the order of Abaqus.
    pub elements: Vec<u32>,
    /// The phases, the matrix first; each is a set of elements.
    pub phases: Vec<PhaseSet>,
    /// The phase of each element: a place in `phases`.
    pub phase_of: Vec<u16>,
    /// The grain of each element: 0 for the matrix, else one more than the grain's place in the packing.
    pub grain_of: Vec<u32>,
    /// The faces of the specimen: `x_min` to `z_max` of a box; `z_min`, `z_max` and `side` of a cylinder.
    pub faces: Vec<SpecimenFace>,
    /// Nodes on the surfaces of grains, in ascending order; none where there are no grains.
    pub grain_surfaces: Vec<u32>,
}

/// A phase of a mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PhaseSet {
    /// Name of the set of elements: `matrix`, `aggregates` of a mix with one aggregate, or `aggregate_1` and so on.
    pub name: String,
    /// Whether it is the matrix or an aggregate.
    pub role: PhaseRole,
}

/// What a phase is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PhaseRole {
    /// What is between the grains.
    Matrix,
    /// The grains of an aggregate.
    Aggregate {
        /// The name that the request gives the aggregate.
        name: Option<String>,
    },
}

/// A face of the specimen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpecimenFace {
    /// Name of its set of nodes and of its surface.
    pub name: String,
    /// Its nodes, in ascending order.
    pub nodes: Vec<u32>,
    /// The sides of elements that it consists of.
    pub sides: Vec<ElementSide>,
}

/// A side of an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ElementSide {
    /// The element, counted from 0.
    pub element: u32,
    /// The number that Abaqus gives the side, counted from 1: 3 is `S3`.
    pub side: u8,
}

impl SolidMesh {
    /// Number of elements.
    pub fn len(&self) -> usize {
        self.elements.len() / self.kind.nodes()
    }

    /// Whether there is no element.
    pub fn is_empty(&self) -> bool {
        self.elements.is_empty()
    }

    /// The nodes of an element.
    ///
    /// # Panics
    /// For an element that there is not.
    pub fn element(&self, element: usize) -> &[u32] {
        let nodes = self.kind.nodes();
        &self.elements[nodes * element..][..nodes]
    }

    /// The volume of an element, in mm³.
    ///
    /// # Panics
    /// For an element that there is not.
    pub fn volume_mm3(&self, element: usize) -> f64 {
        let mut points = [Vector3::zeros(); 10];
        let nodes = self.element(element);
        for (point, node) in points.iter_mut().zip(nodes) {
            *point = self.nodes_mm[*node as usize];
        }
        self.kind.volume(&points[..nodes.len()]).0
    }

    /// Numbers and volumes of the elements of each phase, and the quality of tetrahedra.
    ///
    /// # Errors
    /// [`ExportError::CheckFailed`] with the first fault: a number of a node, a phase, or a side that there is not, a
    /// node without an element, an element whose volume is not positive everywhere, an empty set; and
    /// [`ExportError::Stopped`].
    pub fn check(&self, control: &dyn Control) -> Result<SolidMeasures, ExportError> {
        measures::of(self, control)
    }

    /// Writes the mesh as keywords for Abaqus and CalculiX: nodes, solid elements with a set for each phase, and for
    /// each face of the specimen a set of nodes and a surface; `grain_surfaces` are the nodes of the interface.
    /// Numbers count from 1. `head` is written first, as comments.
    ///
    /// # Errors
    /// [`ExportError::Write`], [`ExportError::Stopped`].
    pub fn write_inp(
        &self,
        head: &[String],
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<(), ExportError> {
        inp::write(self, head, control, out)
    }

    /// Writes the mesh as an unstructured grid of VTK, with the phase (a place in [`phases`](Self::phases)) and the
    /// grain of each cell.
    ///
    /// # Errors
    /// [`ExportError::Write`], [`ExportError::Stopped`].
    pub fn write_vtu(
        &self,
        provenance: Option<&Provenance>,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<(), ExportError> {
        self.write_vtu_with(&[], provenance, control, out)
    }

    /// The same with quantities at the nodes.
    ///
    /// # Errors
    /// [`ExportError::Write`], [`ExportError::Stopped`], and [`ExportError::CheckFailed`] for a quantity of another
    /// number of nodes.
    pub fn write_vtu_with(
        &self,
        fields: &[NodeField],
        provenance: Option<&Provenance>,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<(), ExportError> {
        vtu::write(self, fields, provenance, control, out)
    }

    /// Longest length of the file that [`write_inp`](Self::write_inp) writes for these numbers of nodes and elements,
    /// within a tenth.
    pub fn inp_bytes(kind: ElementKind, nodes: u64, elements: u64) -> u64 {
        inp::bytes(kind, nodes, elements)
    }

    /// Length of the file that [`write_vtu`](Self::write_vtu) writes for these numbers of nodes and elements, without
    /// its head.
    pub fn vtu_bytes(kind: ElementKind, nodes: u64, elements: u64) -> u64 {
        vtu::bytes(kind, nodes, elements)
    }
}

/// Reports how many elements are done.
fn steps<'a>(mesh: &SolidMesh, message: &'static str, control: &'a dyn Control) -> Steps<'a> {
    Steps { control, total: mesh.len(), unit: "elements", message }
}
