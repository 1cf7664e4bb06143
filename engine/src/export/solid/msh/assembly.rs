//! Puts a solid mesh together from what an MSH file has.

use super::super::{ElementSide, PhaseRole, PhaseSet, SolidMesh, SpecimenFace};
use super::{Bodies, Contents, Entity, MshError};
use crate::memory::{filled, reserved};

/// Name of the physical group of the surfaces of grains.
const INTERFACE: &str = "itz";
/// Name of the physical group of what is between the grains.
const MATRIX: &str = "matrix";
/// Places of Gmsh's nodes in the order of Abaqus: of tetrahedra the last two mid nodes are exchanged, those of
/// triangles are in the same order.
const ORDER: [usize; 10] = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8];
/// The same of a triangle that runs clockwise.
const REVERSED: [usize; 6] = [0, 2, 1, 5, 4, 3];
/// A node that no element has.
const UNUSED: u32 = u32::MAX;

pub(super) fn assembled(mut contents: Contents, bodies: Bodies) -> Result<SolidMesh, MshError> {
    contents.entities.sort_unstable_by_key(|entity| (entity.dimension, entity.tag));
    let Some(kind) = bodies.kind(contents.bodies.per_element) else {
        return fault("Elements", "there is no element of the mesh");
    };
    let nodes = Nodes::new(&contents)?;
    let phases = phases(&contents, bodies.dimension())?;
    let order = volumes_in_order(&contents, &phases, bodies.dimension())?;
    let per_element = kind.nodes();
    let all = &contents.bodies.nodes;
    let count = all.len() / per_element;
    let (mut elements, mut phase_of, mut grain_of) =
        (reserved(all.len())?, reserved(count)?, reserved(count)?);
    for Volume { first, count, phase, grain } in order {
        for element in all[first * per_element..][..count * per_element].chunks(per_element) {
            let mut places = [0; 10];
            for (place, node) in places.iter_mut().zip(element) {
                *place = nodes.place(*node)?;
            }
            let corner = |at: usize| contents.nodes_mm[places[at] as usize];
            let runs_clockwise =
                bodies.dimension() == 2 && (corner(1) - corner(0)).cross(&(corner(2) - corner(0))).z < 0.0;
            let order = if runs_clockwise { &REVERSED[..] } else { &ORDER[..] };
            elements.extend(order[..per_element].iter().map(|at| places[*at]));
            phase_of.push(phase);
            grain_of.push(grain);
        }
    }
    let (number_of, nodes_mm) = numbered(&mut elements, &contents)?;
    let phases = phases.into_iter().map(|(_, set)| set).collect();
    let mut mesh = SolidMesh {
        nodes_mm,
        kind,
        elements,
        phases,
        phase_of,
        grain_of,
        faces: Vec::new(),
        grain_surfaces: Vec::new(),
    };
    add_surfaces(&mut mesh, &contents, &nodes, &number_of, bodies.dimension())?;
    Ok(mesh)
}

/// Places of nodes by their tags.
struct Nodes {
    by_tag: Vec<(u64, u32)>,
}

impl Nodes {
    fn new(contents: &Contents) -> Result<Self, MshError> {
        if contents.node_tags.len() != contents.nodes_mm.len() || contents.node_tags.len() >= UNUSED as usize
        {
            return fault("Nodes", "there are too many nodes");
        }
        let mut by_tag = reserved(contents.node_tags.len())?;
        by_tag.extend(contents.node_tags.iter().copied().zip(0..));
        by_tag.sort_unstable();
        if by_tag.windows(2).any(|pair| pair[0].0 == pair[1].0) {
            return fault("Nodes", "two nodes have the same tag");
        }
        Ok(Self { by_tag })
    }

    fn place(&self, tag: u64) -> Result<u32, MshError> {
        // Tags are numbers from 1 on without gaps in nearly all files.
        let first = self.by_tag.first().map_or(0, |(tag, _)| *tag);
        let guess = usize::try_from(tag.wrapping_sub(first)).unwrap_or(usize::MAX);
        match self.by_tag.get(guess) {
            Some((own, place)) if *own == tag => Ok(*place),
            _ => match self.by_tag.binary_search_by_key(&tag, |(own, _)| *own) {
                Ok(at) => Ok(self.by_tag[at].1),
                Err(_) => fault("Elements", format!("there is no node {tag}")),
            },
        }
    }
}

/// The physical groups of the dimension of the bodies, the matrix first, each with its tag.
fn phases(contents: &Contents, of: u8) -> Result<Vec<(i32, PhaseSet)>, MshError> {
    let mut groups: Vec<(bool, i32, &str)> = contents
        .names
        .iter()
        .filter(|(dimension, _, _)| *dimension == of)
        .map(|(_, tag, name)| (name != MATRIX, *tag, name.as_str()))
        .collect();
    groups.sort_unstable();
    // A group without an element is no phase: a packing of no grains has none of aggregates.
    groups.retain(|(_, tag, _)| {
        let is_of = |volume: i32| group_of(contents, of, volume) == Some(*tag);
        contents.bodies.blocks.iter().any(|(volume, count)| *count > 0 && is_of(*volume))
    });
    if groups.len() > usize::from(u16::MAX) {
        return fault("PhysicalNames", "there are too many groups");
    }
    let set = |(is_aggregate, tag, name): (bool, i32, &str)| {
        let role = if is_aggregate { PhaseRole::Aggregate { name: None } } else { PhaseRole::Matrix };
        (tag, PhaseSet { name: name.to_owned(), role })
    };
    Ok(groups.into_iter().map(set).collect())
}

/// The first physical group of an entity; entities are sorted.
fn group_of(contents: &Contents, dimension: u8, tag: i32) -> Option<i32> {
    let key = |entity: &Entity| (entity.dimension, entity.tag);
    let at = contents.entities.binary_search_by_key(&(dimension, tag), key).ok()?;
    contents.entities[at].physical.first().map(|group| group.saturating_abs())
}

/// The elements of a volume, or of a surface of a cut.
struct Volume {
    /// The first of them in the file.
    first: usize,
    count: usize,
    phase: u16,
    grain: u32,
}

/// The volumes in the order of their phases.
fn volumes_in_order(
    contents: &Contents,
    phases: &[(i32, PhaseSet)],
    of: u8,
) -> Result<Vec<Volume>, MshError> {
    let mut grains: Vec<i32> = contents
        .entities
        .iter()
        .filter(|entity| entity.dimension == of)
        .filter(|entity| {
            let group = entity.physical.first().map(|group| group.saturating_abs());
            let set = phases.iter().find(|(tag, _)| Some(*tag) == group);
            set.is_some_and(|(_, set)| set.role != PhaseRole::Matrix)
        })
        .map(|entity| entity.tag)
        .collect();
    grains.sort_unstable();
    let mut volumes = Vec::new();
    let mut first = 0;
    for &(tag, count) in &contents.bodies.blocks {
        let group = group_of(contents, of, tag);
        let Some(phase) = phases.iter().position(|(own, _)| Some(*own) == group) else {
            return fault("Elements", format!("the entity {tag} has no named group"));
        };
        let grain = grains.binary_search(&tag).map_or(0, |at| at as u32 + 1);
        volumes.push(Volume { first, count, phase: phase as u16, grain });
        first += count;
    }
    volumes.sort_by_key(|volume| (volume.phase, volume.grain));
    Ok(volumes)
}

/// Numbers the nodes that elements have, in the order of the file; the number of each node of the file, and the
/// positions.
fn numbered(
    elements: &mut [u32],
    contents: &Contents,
) -> Result<(Vec<u32>, Vec<nalgebra::Vector3<f64>>), MshError> {
    let mut number_of = filled(contents.nodes_mm.len(), UNUSED)?;
    for node in elements.iter() {
        number_of[*node as usize] = 0;
    }
    let mut nodes_mm = reserved(contents.nodes_mm.len())?;
    for (number, point) in number_of.iter_mut().zip(&contents.nodes_mm) {
        if *number != UNUSED {
            *number = nodes_mm.len() as u32;
            nodes_mm.push(*point);
        }
    }
    for node in elements {
        *node = number_of[*node as usize];
    }
    Ok((number_of, nodes_mm))
}

/// The corners of a side in ascending order; of an edge two.
fn sorted(corners: &[u32]) -> [u32; 3] {
    let mut key = [UNUSED; 3];
    key[..corners.len()].copy_from_slice(corners);
    key.sort_unstable();
    key
}

/// Finds the faces of the specimen and the nodes on grains by the sides of the physical groups.
fn add_surfaces(
    mesh: &mut SolidMesh,
    contents: &Contents,
    nodes: &Nodes,
    number_of: &[u32],
    of: u8,
) -> Result<(), MshError> {
    let corners_of_side = usize::from(of);
    let sides = &contents.sides;
    let mut groups: Vec<(i32, &str)> = contents
        .names
        .iter()
        .filter(|(dimension, _, _)| *dimension + 1 == of)
        .map(|(_, tag, name)| (*tag, name.as_str()))
        .collect();
    groups.sort_unstable();
    let mut faces: Vec<SpecimenFace> = Vec::new();
    // Sides on the specimen's faces by their sorted corners, with the place of the face.
    let mut outer: Vec<([u32; 3], usize)> = Vec::new();
    for (tag, name) in groups {
        let mut own = Vec::new();
        let mut first = 0;
        for &(surface, count) in &sides.blocks {
            if group_of(contents, of - 1, surface) == Some(tag) {
                for corners in sides.nodes[first..][..count * sides.per_element].chunks(sides.per_element) {
                    let mut places = [0; 6];
                    for (place, node) in places.iter_mut().zip(corners) {
                        *place = number_of[nodes.place(*node)? as usize];
                        if *place == UNUSED {
                            return fault("Elements", format!("a side on {name} belongs to no element"));
                        }
                    }
                    own.extend_from_slice(&places[..corners.len()]);
                    if name != INTERFACE {
                        outer.push((sorted(&places[..corners_of_side]), faces.len()));
                    }
                }
            }
            first += count * sides.per_element;
        }
        own.sort_unstable();
        own.dedup();
        if name == INTERFACE {
            mesh.grain_surfaces = own;
        } else if !own.is_empty() {
            faces.push(SpecimenFace { name: name.to_owned(), nodes: own, sides: Vec::new() });
        }
    }
    outer.sort_unstable();
    let mut is_outer = filled(mesh.nodes_mm.len(), false)?;
    faces.iter().flat_map(|face| &face.nodes).for_each(|node| is_outer[*node as usize] = true);
    for element in 0..mesh.len() {
        let own = mesh.element(element);
        if own.iter().filter(|node| is_outer[**node as usize]).count() < corners_of_side {
            continue;
        }
        for (side, corners) in (1..).zip(mesh.kind.sides()) {
            let mut places = [0; 3];
            for (place, corner) in places.iter_mut().zip(&corners[..corners_of_side]) {
                *place = own[*corner];
            }
            let key = sorted(&places[..corners_of_side]);
            if let Ok(at) = outer.binary_search_by_key(&key, |(corners, _)| *corners) {
                faces[outer[at].1].sides.push(ElementSide { element: element as u32, side });
            }
        }
    }
    let found: usize = faces.iter().map(|face| face.sides.len()).sum();
    if found != outer.len() {
        return fault(
            "Elements",
            format!("{found} sides of elements lie on the {} of the specimen's faces", outer.len()),
        );
    }
    mesh.faces = faces;
    Ok(())
}

fn fault<T>(section: &str, what: impl Into<String>) -> Result<T, MshError> {
    Err(MshError::Damaged { section: section.into(), what: what.into() })
}
