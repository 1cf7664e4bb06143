//! The part of a mesh that carries load: without phases of stiffness 0, and without what only such phases surround.
//!
//! Elements are connected where they share a side. Pieces that share an edge or a node alone can turn about it, and
//! their stiffness matrix is singular: only the largest connected piece stays, as in voxel models of porous media.

use nalgebra::Vector3;

use crate::export::ExportError;
use crate::export::solid::{ElementSide, SolidMesh, SpecimenFace};
use crate::memory::{filled, reserved};

/// What was left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LeftOut {
    /// Elements of phases of stiffness 0.
    pub(super) pores: u64,
    /// Elements that share no side with the largest piece, directly or by others.
    pub(super) loose: u64,
}

const GONE: u32 = u32::MAX;

/// Leaves out the phases that are not solid.
///
/// # Errors
/// [`ExportError::OutOfMemory`], and [`ExportError::Unavailable`] where no element is solid.
pub(super) fn solid_part(mesh: SolidMesh, is_solid: &[bool]) -> Result<(SolidMesh, LeftOut), ExportError> {
    if is_solid.iter().all(|solid| *solid) {
        return Ok((mesh, LeftOut::default()));
    }
    let solid = |element: usize| is_solid[usize::from(mesh.phase_of[element])];
    let pieces = pieces(&mesh, &solid)?;
    let mut sizes = filled(mesh.len(), 0_u32)?;
    for element in (0..mesh.len()).filter(|element| solid(*element)) {
        sizes[pieces[element] as usize] += 1;
    }
    let number = (0..mesh.len()).filter(|element| solid(*element)).count() as u64;
    // Of equal sizes the first.
    let Some((largest, size)) = sizes.iter().enumerate().max_by_key(|(at, size)| (**size, GONE - *at as u32))
    else {
        return Err(no_solid());
    };
    if *size == 0 {
        return Err(no_solid());
    }
    let left_out = LeftOut { pores: mesh.len() as u64 - number, loose: number - u64::from(*size) };
    let stays = |element: usize| solid(element) && pieces[element] as usize == largest;
    Ok((part(&mesh, is_solid, stays)?, left_out))
}

fn no_solid() -> ExportError {
    ExportError::Unavailable(
        "no element of the deck has a stiffness: give a phase a youngs_modulus_gpa above 0".into(),
    )
}

/// The piece of each solid element: the least element of it.
fn pieces(mesh: &SolidMesh, solid: &dyn Fn(usize) -> bool) -> Result<Vec<u32>, ExportError> {
    let sides = mesh.kind.number_of_sides();
    let mut keys = reserved(sides * mesh.len())?;
    for element in (0..mesh.len()).filter(|element| solid(*element)) {
        let nodes = mesh.element(element);
        for side in mesh.kind.sides() {
            // The corners of a side tell it from all others.
            let mut corners = [GONE; 4];
            for (corner, node) in corners.iter_mut().zip(&side[..mesh.kind.corners_of_side()]) {
                *corner = nodes[*node];
            }
            corners.sort_unstable();
            keys.push((corners, element as u32));
        }
    }
    keys.sort_unstable();
    let mut parents = reserved(mesh.len())?;
    parents.extend(0..mesh.len() as u32);
    for pair in keys.windows(2) {
        if let [(a, first), (b, second)] = pair
            && a == b
        {
            let (a, b) = (root(&mut parents, *first), root(&mut parents, *second));
            parents[a.max(b) as usize] = a.min(b);
        }
    }
    for element in 0..mesh.len() as u32 {
        parents[element as usize] = root(&mut parents, element);
    }
    Ok(parents)
}

fn root(parents: &mut [u32], mut element: u32) -> u32 {
    while parents[element as usize] != element {
        let up = parents[parents[element as usize] as usize];
        parents[element as usize] = up;
        element = up;
    }
    element
}

/// The mesh of the elements that stay.
fn part(
    mesh: &SolidMesh,
    is_solid: &[bool],
    stays: impl Fn(usize) -> bool,
) -> Result<SolidMesh, ExportError> {
    let mut new_phase = vec![0_u16; is_solid.len()];
    let mut phases = Vec::new();
    for (at, phase) in mesh.phases.iter().enumerate().filter(|(at, _)| is_solid[*at]) {
        new_phase[at] = phases.len() as u16;
        phases.push(phase.clone());
    }
    let mut new_element = filled(mesh.len(), GONE)?;
    let mut new_node = filled(mesh.nodes_mm.len(), GONE)?;
    let mut number = 0;
    for element in (0..mesh.len()).filter(|element| stays(*element)) {
        new_element[element] = number;
        number += 1;
        for node in mesh.element(element) {
            new_node[*node as usize] = 0;
        }
    }
    let mut nodes_mm: Vec<Vector3<f64>> = reserved(mesh.nodes_mm.len())?;
    for (new, place) in new_node.iter_mut().zip(&mesh.nodes_mm).filter(|(new, _)| **new == 0) {
        *new = nodes_mm.len() as u32;
        nodes_mm.push(*place);
    }
    let mut elements = reserved(number as usize * mesh.kind.nodes())?;
    let (mut phase_of, mut grain_of) = (reserved(number as usize)?, reserved(number as usize)?);
    for element in (0..mesh.len()).filter(|element| new_element[*element] != GONE) {
        elements.extend(mesh.element(element).iter().map(|node| new_node[*node as usize]));
        phase_of.push(new_phase[usize::from(mesh.phase_of[element])]);
        grain_of.push(mesh.grain_of[element]);
    }
    let nodes = |old: &[u32]| -> Vec<u32> {
        old.iter().map(|node| new_node[*node as usize]).filter(|node| *node != GONE).collect()
    };
    let faces = mesh.faces.iter().map(|face| SpecimenFace {
        name: face.name.clone(),
        nodes: nodes(&face.nodes),
        sides: face
            .sides
            .iter()
            .map(|side| ElementSide { element: new_element[side.element as usize], ..*side })
            .filter(|side| side.element != GONE)
            .collect(),
    });
    Ok(SolidMesh {
        faces: faces.collect(),
        grain_surfaces: nodes(&mesh.grain_surfaces),
        nodes_mm,
        kind: mesh.kind,
        elements,
        phases,
        phase_of,
        grain_of,
    })
}
