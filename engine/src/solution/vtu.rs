//! The fields of a solution on the mesh of its deck, as an unstructured grid of VTK.

use std::io::Write;

use super::frd::Field;
use crate::control::Control;
use crate::export::solid::{NodeField, NodeValues, SolidMesh};
use crate::export::{ExportError, Provenance};

/// Names in CalculiX's file, names in ours, numbers of a node. Tensors have the order xx, yy, zz, xy, yz, xz in both.
const FIELDS: [(&str, &str, usize); 5] = [
    ("DISP", "displacement", 3),
    ("STRESS", "stress", 6),
    ("TOSTRAIN", "strain", 6),
    ("NDTEMP", "temperature", 1),
    ("PE", "plastic_strain", 1),
];

pub(super) fn write(
    mesh: &SolidMesh,
    fields: &[Field],
    provenance: Option<&Provenance>,
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<(), ExportError> {
    let known = fields.iter().filter_map(|field| {
        let known = |(name, _, components): &&(&str, &str, usize)| {
            *name == field.name && *components == field.components
        };
        let (_, name, _) = FIELDS.iter().find(known)?;
        Some(NodeField { name, values: values(field, mesh.nodes_mm.len())? })
    });
    mesh.write_vtu_with(&known.collect::<Vec<_>>(), provenance, control, out)
}

fn values(field: &Field, nodes: usize) -> Option<NodeValues> {
    match field.components {
        1 => Some(NodeValues::Scalar(of_nodes(field, nodes).into_iter().map(|[x]| x).collect())),
        3 => Some(NodeValues::Vector(of_nodes(field, nodes))),
        6 => Some(NodeValues::Tensor(of_nodes(field, nodes))),
        _ => None,
    }
}

/// A value for each node: not a number where the file has none.
fn of_nodes<const N: usize>(field: &Field, nodes: usize) -> Vec<[f32; N]> {
    let mut all = vec![[f32::NAN; N]; nodes];
    for (node, values) in &field.rows {
        if let Some(place) = all.get_mut((*node as usize).wrapping_sub(1)) {
            for (place, value) in place.iter_mut().zip(values) {
                *place = *value as f32;
            }
        }
    }
    all
}
