//! The sets of nodes that a deck names: the faces of the mesh, all of them together, and the pins of a cylinder.

use nalgebra::Vector3;

use super::frame::Frame;
use super::load::{ALL_FACES, PINS};
use crate::export::solid::SolidMesh;

/// Sets of nodes by name, each in ascending order.
#[derive(Debug)]
pub(super) struct NodeSets<'a> {
    mesh: &'a SolidMesh,
    all_faces: Vec<u32>,
    pins: [Option<u32>; 2],
}

impl<'a> NodeSets<'a> {
    /// Those of a mesh.
    pub(super) fn new(mesh: &'a SolidMesh, frame: &Frame) -> Self {
        let mut all_faces: Vec<u32> = mesh.faces.iter().flat_map(|face| face.nodes.iter().copied()).collect();
        all_faces.sort_unstable();
        all_faces.dedup();
        let mut sets = Self { mesh, all_faces, pins: [None; 2] };
        if let Some(radius_mm) = frame.radius_mm() {
            sets.pins = sets.find_pins(radius_mm);
        }
        sets
    }

    /// The node of the bottom nearest to the axis, and the one that lies farthest along x from it, near its line.
    fn find_pins(&self, radius_mm: f64) -> [Option<u32>; 2] {
        let bottom = self.nodes("z_min");
        let place = |node: &u32| self.mesh.nodes_mm[*node as usize];
        let least = |value: &dyn Fn(Vector3<f64>) -> f64| {
            bottom.iter().copied().min_by(|a, b| value(place(a)).total_cmp(&value(place(b))))
        };
        let on_axis = least(&|x| (x.x - radius_mm).powi(2) + (x.y - radius_mm).powi(2));
        let Some(first) = on_axis.map(|node| place(&node)) else { return [None; 2] };
        [on_axis, least(&|x| (x.y - first.y).abs() - (x.x - first.x))]
    }

    /// The nodes of a set.
    pub(super) fn nodes(&self, name: &str) -> &[u32] {
        if name == ALL_FACES {
            return &self.all_faces;
        }
        if let Some(pin) = PINS.iter().position(|pin| *pin == name) {
            return self.pins[pin].as_slice();
        }
        self.mesh.faces.iter().find(|face| face.name == name).map_or(&[], |face| &face.nodes)
    }

    /// Names of the faces.
    pub(super) fn face_names(&self) -> Vec<&str> {
        self.mesh.faces.iter().map(|face| face.name.as_str()).collect()
    }

    /// The pins, each with its name.
    pub(super) fn pins(&self) -> impl Iterator<Item = (&'static str, u32)> {
        PINS.into_iter().zip(self.pins).filter_map(|(name, node)| Some((name, node?)))
    }
}
