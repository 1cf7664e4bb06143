//! The check of a solid mesh: numbers in range, no unused node, positive volumes, no empty set.

use serde::{Deserialize, Serialize};

use super::{ELEMENTS_PER_LOOK, SolidMesh, steps};
use crate::control::Control;
use crate::export::{ExportError, go_on};
use crate::memory::filled;

/// Least determinant of an element, in that of an affine one of the same volume: flatter ones are rounding errors.
const LEAST_DETERMINANT: f64 = 1e-12;
/// Tetrahedra of less gamma are counted.
const LOW_GAMMA: f64 = 0.03;

/// What a check measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SolidMeasures {
    /// Nodes.
    pub nodes: u64,
    /// Elements.
    pub elements: u64,
    /// Volume of all elements.
    pub volume_mm3: f64,
    /// The phases: the matrix first.
    pub phases: Vec<PhaseMeasures>,
    /// Least gamma of tetrahedra or triangles (Gmsh's quality by their corners: 1 regular, 0 flat); absent for
    /// hexahedra.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub smallest_gamma: Option<f64>,
    /// Tetrahedra or triangles of a gamma below 0.03.
    pub elements_below_gamma_0_03: u64,
}

/// The elements of a phase.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct PhaseMeasures {
    /// Name of the set of elements.
    pub name: String,
    /// Elements.
    pub elements: u64,
    /// Their volume; that of plane elements is of a thickness of 1 mm.
    pub volume_mm3: f64,
}

pub(super) fn of(mesh: &SolidMesh, control: &dyn Control) -> Result<SolidMeasures, ExportError> {
    lengths(mesh)?;
    sets(mesh)?;
    let mut phases: Vec<PhaseMeasures> = mesh
        .phases
        .iter()
        .map(|phase| PhaseMeasures { name: phase.name.clone(), elements: 0, volume_mm3: 0.0 })
        .collect();
    let mut is_used = filled(mesh.nodes_mm.len(), false)?;
    let (mut smallest, mut low) = (f64::INFINITY, 0);
    let steps = steps(mesh, "checking the mesh", control);
    for (element, phase) in mesh.phase_of.iter().enumerate() {
        if element % ELEMENTS_PER_LOOK == 0 {
            go_on(control)?;
            steps.report(element);
        }
        let mut points = [nalgebra::Vector3::zeros(); 10];
        let nodes = mesh.element(element);
        for (point, node) in points.iter_mut().zip(nodes) {
            *point = mesh.nodes_mm[*node as usize];
            is_used[*node as usize] = true;
        }
        let points = &points[..nodes.len()];
        let (volume, least) = mesh.kind.volume(points);
        if !(volume > 0.0 && least > LEAST_DETERMINANT) {
            return failed(format!(
                "element {} at {:?} mm has no positive volume everywhere",
                element + 1,
                points[0].as_slice()
            ));
        }
        let own = &mut phases[usize::from(*phase)];
        own.elements += 1;
        own.volume_mm3 += volume;
        if let Some(gamma) = mesh.kind.gamma(points) {
            smallest = smallest.min(gamma);
            low += u64::from(gamma < LOW_GAMMA);
        }
    }
    if let Some(node) = is_used.iter().position(|is_used| !is_used) {
        return failed(format!("node {} belongs to no element", node + 1));
    }
    if let Some(phase) = phases.iter().find(|phase| phase.elements == 0) {
        return failed(format!("the phase {} has no element", phase.name));
    }
    Ok(SolidMeasures {
        nodes: mesh.nodes_mm.len() as u64,
        elements: mesh.len() as u64,
        volume_mm3: phases.iter().map(|phase| phase.volume_mm3).sum(),
        phases,
        smallest_gamma: smallest.is_finite().then_some(smallest),
        elements_below_gamma_0_03: low,
    })
}

/// Lengths of the arrays, and numbers in range.
fn lengths(mesh: &SolidMesh) -> Result<(), ExportError> {
    let count = mesh.len();
    if mesh.elements.len() != count * mesh.kind.nodes()
        || [mesh.phase_of.len(), mesh.grain_of.len()] != [count, count]
    {
        return failed(format!(
            "{} nodes of elements, {} phases and {} grains of {count} elements",
            mesh.elements.len(),
            mesh.phase_of.len(),
            mesh.grain_of.len()
        ));
    }
    if count == 0 {
        return failed("the mesh has no element".into());
    }
    let nodes = mesh.nodes_mm.len();
    if let Some(node) = mesh.elements.iter().find(|node| **node as usize >= nodes) {
        return failed(format!("an element names node {}, and there are {nodes}", u64::from(*node) + 1));
    }
    if let Some(phase) = mesh.phase_of.iter().find(|phase| usize::from(**phase) >= mesh.phases.len()) {
        return failed(format!("an element names phase {phase}, and there are {}", mesh.phases.len()));
    }
    if let Some(node) = mesh.nodes_mm.iter().position(|point| point.iter().any(|x| !x.is_finite())) {
        return failed(format!("node {} has a coordinate that is not finite", node + 1));
    }
    Ok(())
}

/// The faces of the specimen and the surfaces of grains.
fn sets(mesh: &SolidMesh) -> Result<(), ExportError> {
    let (nodes, elements) = (mesh.nodes_mm.len(), mesh.len());
    let sides = mesh.kind.number_of_sides();
    for face in &mesh.faces {
        if face.nodes.is_empty() || face.sides.is_empty() {
            return failed(format!("the face {} has no node or no side of an element", face.name));
        }
        if face.nodes.iter().any(|node| *node as usize >= nodes) {
            return failed(format!("the face {} names a node that there is not", face.name));
        }
        let is_known = |side: &super::ElementSide| {
            (side.element as usize) < elements && (1..=sides).contains(&usize::from(side.side))
        };
        if !face.sides.iter().all(is_known) {
            return failed(format!("the face {} names a side that there is not", face.name));
        }
    }
    if mesh.grain_surfaces.iter().any(|node| *node as usize >= nodes) {
        return failed("the surfaces of grains name a node that there is not".into());
    }
    if mesh.phases.len() > 1 && mesh.grain_surfaces.is_empty() {
        return failed("the surfaces of grains have no node".into());
    }
    Ok(())
}

fn failed<T>(what: String) -> Result<T, ExportError> {
    Err(ExportError::CheckFailed(what))
}
