//! The axes of a mesh: those of the specimen, of a cut the two of its plane.

use crate::request::{Axis, Specimen};

/// Names of the faces across an axis of the specimen.
pub(super) const FACES: [[&str; 2]; 3] = [["x_min", "x_max"], ["y_min", "y_max"], ["z_min", "z_max"]];

/// Which axes a mesh has, and how far it reaches along them.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Frame {
    /// The axis of the specimen along each axis of the mesh: three, or two of a cut.
    axes: Vec<usize>,
    /// Lengths along the axes of the mesh; of a cut the last is its thickness.
    pub(super) size_mm: [f64; 3],
    /// Whether the lateral faces are no plates.
    pub(super) has_free_sides: bool,
}

impl Frame {
    /// That of a specimen, or of a cut across an axis.
    pub(super) fn of(specimen: &Specimen, cut: Option<Axis>, thickness_mm: f64) -> Self {
        let bounds_mm = specimen.bounds_mm();
        let size_mm = match cut.map(|axis| axis.plane().map(Axis::index)) {
            Some([u, v]) => [bounds_mm[u], bounds_mm[v], thickness_mm],
            None => bounds_mm,
        };
        Self::new(cut, size_mm, specimen.domain().lateral().is_some())
    }

    /// That of a mesh of these lengths along its own axes, of a specimen or of a cut across an axis.
    pub(super) fn new(cut: Option<Axis>, size_mm: [f64; 3], has_free_sides: bool) -> Self {
        let axes = cut.map_or_else(|| vec![0, 1, 2], |axis| axis.plane().map(Axis::index).to_vec());
        Self { axes, size_mm, has_free_sides }
    }

    /// Number of the axes.
    pub(crate) fn dimension(&self) -> usize {
        self.axes.len()
    }

    /// The axis of the mesh along that of the specimen.
    pub(crate) fn place(&self, axis: usize) -> Option<usize> {
        self.axes.iter().position(|own| *own == axis)
    }

    /// Name of an axis of the mesh: that of the specimen.
    pub(super) fn name(&self, place: usize) -> &'static str {
        Axis::ALL[self.axes[place]].name()
    }

    /// Names of the faces across an axis of the mesh.
    pub(crate) fn faces(&self, place: usize) -> [&'static str; 2] {
        FACES[self.axes[place]]
    }

    /// Radius of a cylinder.
    pub(super) fn radius_mm(&self) -> Option<f64> {
        self.has_free_sides.then_some(self.size_mm[0] / 2.0)
    }
}
