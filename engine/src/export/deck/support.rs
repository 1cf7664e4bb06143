//! Whether the conditions of a load hold a mesh: each set has nodes, each load acts on one, and no rigid motion is
//! left.

use nalgebra::{Matrix6, Vector3, Vector6};

use super::load::Conditions;
use super::sets::NodeSets;
use crate::export::ExportError;

/// Least eigenvalue of the Gram matrix of the constraints on rigid motions, in its largest: what is below is rounding.
const LEAST_EIGENVALUE: f64 = 1e-9;

/// Judges the conditions of a mesh before anything of a deck is written.
///
/// # Errors
/// [`ExportError::Unavailable`] for a set without nodes, for a displacement or a temperature that acts on no node, and
/// where the mesh can still move as a rigid body.
pub(super) fn check(
    conditions: &Conditions,
    sets: &NodeSets<'_>,
    nodes_mm: &[Vector3<f64>],
    dimension: usize,
) -> Result<(), ExportError> {
    let refused = |text: String| Err(ExportError::Unavailable(text));
    for prescribed in &conditions.prescribed {
        if sets.nodes(prescribed.set).is_empty() {
            let what = if prescribed.value_mm == 0.0 { "support" } else { "load" };
            return refused(format!(
                "a {what} of the deck acts on no node: the set {} is empty; \
                 choose finer elements, or give the phase at this face a stiffness",
                prescribed.set
            ));
        }
    }
    for (face, _) in &conditions.tied {
        if sets.nodes(face).is_empty() {
            return refused(format!("the set {face} of the deck is empty: choose finer elements"));
        }
    }
    if is_held(conditions, sets, nodes_mm, dimension) {
        Ok(())
    } else {
        refused(
            "the deck has too few constraints: its mesh can move as a rigid body; choose finer elements"
                .into(),
        )
    }
}

/// Whether no rigid motion meets all constraints: six columns of three translations and three rotations, a row for each
/// constraint. Plane elements keep to their plane.
fn is_held(
    conditions: &Conditions,
    sets: &NodeSets<'_>,
    nodes_mm: &[Vector3<f64>],
    dimension: usize,
) -> bool {
    let centre = nodes_mm.iter().sum::<Vector3<f64>>() / nodes_mm.len().max(1) as f64;
    let radius = nodes_mm.iter().map(|x| (x - centre).norm()).fold(0.0, f64::max);
    let row = |node: u32, axis: usize| {
        let arm = (nodes_mm[node as usize] - centre) / radius;
        let mut direction = Vector3::zeros();
        direction[axis] = 1.0;
        let moment = arm.cross(&direction);
        Vector6::new(direction.x, direction.y, direction.z, moment.x, moment.y, moment.z)
    };
    let mut gram = if dimension == 2 {
        // Along z, and about x and y.
        Matrix6::from_diagonal(&Vector6::new(0.0, 0.0, 1.0, 1.0, 1.0, 0.0))
    } else {
        Matrix6::zeros()
    };
    let mut add = |row: Vector6<f64>| gram += row * row.transpose();
    for prescribed in &conditions.prescribed {
        for node in sets.nodes(prescribed.set) {
            add(row(*node, prescribed.axis));
        }
    }
    for (face, axis) in &conditions.tied {
        if let Some((first, others)) = sets.nodes(face).split_first() {
            for node in others {
                add(row(*node, *axis) - row(*first, *axis));
            }
        }
    }
    let eigenvalues = gram.symmetric_eigenvalues();
    radius > 0.0 && eigenvalues.min() > LEAST_EIGENVALUE * eigenvalues.max()
}
