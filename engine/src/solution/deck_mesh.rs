//! The mesh of a deck, read from its `mesh.inp`: nodes, elements of one kind with their sets, and the sets of nodes.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::SolutionError;
use crate::export::solid::{ElementKind, PhaseRole, PhaseSet, SolidMesh, SpecimenFace};

enum Block {
    Nodes,
    Elements,
    NodeSet,
    Other,
}

/// Reads a mesh whose numbers of nodes and elements count from 1. Sides of faces and surfaces of grains are not read.
///
/// # Errors
/// [`SolutionError::Unreadable`] with the line.
pub(super) fn read(text: &str) -> Result<SolidMesh, SolutionError> {
    let mut nodes_mm: Vec<Vector3<f64>> = Vec::new();
    let mut kind = None;
    let mut elements: BTreeMap<u32, (u16, Vec<u32>)> = BTreeMap::new();
    let mut phases: Vec<PhaseSet> = Vec::new();
    let mut faces: Vec<SpecimenFace> = Vec::new();
    let mut block = Block::Other;
    for (at, line) in (1..).zip(text.lines()) {
        let unreadable = || SolutionError::Unreadable {
            file: "mesh.inp",
            line: at,
            text: line.trim().chars().take(80).collect(),
        };
        if line.starts_with("**") || line.trim().is_empty() {
            continue;
        }
        if line.starts_with('*') {
            let keyword = line.split(',').next().unwrap_or_default().trim().to_ascii_uppercase();
            block = match keyword.as_str() {
                "*NODE" => Block::Nodes,
                "*ELEMENT" => {
                    let name = parameter(line, "TYPE").ok_or_else(unreadable)?;
                    let found = ElementKind::of_abaqus(name).ok_or_else(unreadable)?;
                    if kind.is_some_and(|kind| kind != found) {
                        return Err(unreadable());
                    }
                    kind = Some(found);
                    let name = parameter(line, "ELSET").ok_or_else(unreadable)?.to_owned();
                    phases.push(PhaseSet { name, role: PhaseRole::Matrix });
                    Block::Elements
                }
                "*NSET" => {
                    let name = parameter(line, "NSET").ok_or_else(unreadable)?.to_owned();
                    faces.push(SpecimenFace { name, nodes: Vec::new(), sides: Vec::new() });
                    Block::NodeSet
                }
                _ => Block::Other,
            };
            continue;
        }
        let mut fields = line.split(',').map(str::trim).filter(|field| !field.is_empty());
        match block {
            Block::Nodes => {
                let number: usize = fields.next().and_then(|n| n.parse().ok()).ok_or_else(unreadable)?;
                let mut coordinate = || fields.next().and_then(|x| x.parse().ok()).ok_or_else(unreadable);
                let place = Vector3::new(coordinate()?, coordinate()?, coordinate()?);
                if number != nodes_mm.len() + 1 {
                    return Err(unreadable());
                }
                nodes_mm.push(place);
            }
            Block::Elements => {
                let numbers: Option<Vec<u32>> = fields.map(|n| n.parse().ok()).collect();
                let numbers = numbers.ok_or_else(unreadable)?;
                let (Some((number, nodes)), Some(kind)) = (numbers.split_first(), kind) else {
                    return Err(unreadable());
                };
                let is_node = |node: &u32| (1..=nodes_mm.len()).contains(&(*node as usize));
                if nodes.len() != kind.nodes() || !nodes.iter().all(is_node) {
                    return Err(unreadable());
                }
                let nodes = nodes.iter().map(|node| node - 1).collect();
                elements.insert(*number, (phases.len() as u16 - 1, nodes));
            }
            Block::NodeSet => {
                let numbers: Option<Vec<u32>> =
                    fields.map(|n| n.parse::<u32>().ok()?.checked_sub(1)).collect();
                let numbers = numbers.ok_or_else(unreadable)?;
                if let Some(set) = faces.last_mut() {
                    set.nodes.extend(numbers);
                }
            }
            Block::Other => {}
        }
    }
    let Some(kind) = kind else {
        return Err(SolutionError::Missing("mesh.inp has no elements".into()));
    };
    let grain_of = vec![0; elements.len()];
    let (phase_of, nodes): (Vec<u16>, Vec<Vec<u32>>) = elements.into_values().unzip();
    Ok(SolidMesh {
        nodes_mm,
        kind,
        elements: nodes.concat(),
        phases,
        phase_of,
        grain_of,
        faces,
        grain_surfaces: Vec::new(),
    })
}

/// The value of a parameter of a keyword line.
fn parameter<'a>(line: &'a str, name: &str) -> Option<&'a str> {
    line.split(',').skip(1).find_map(|part| {
        let (key, value) = part.split_once('=')?;
        key.trim().eq_ignore_ascii_case(name).then(|| value.trim())
    })
}
