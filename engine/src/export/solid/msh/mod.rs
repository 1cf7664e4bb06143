//! Reads the tetrahedra of a packing, or the triangles of a cut, out of a file of Gmsh: MSH 4.1, text or binary, as
//! Gmsh 4.8 to 4.15 write it.
//!
//! The physical groups of volumes are the phases, those of surfaces the faces of the specimen and `itz`, the interface;
//! of a cut surfaces are the phases and curves the edges. Volumes beside the matrix are grains, in the order of their
//! tags. Every number of the file is checked.

mod assembly;
mod source;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;

use std::io::{self, Read};

use nalgebra::Vector3;

use super::{ElementKind, PlaneState, SolidMesh};
use crate::control::Control;
use crate::export::{ExportError, go_on};
use crate::memory::{OutOfMemory, make_room};
use source::Source;

/// Why a file is no mesh of a packing.
#[derive(Debug, thiserror::Error)]
pub enum MshError {
    /// It cannot be read.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// A section is damaged, or has what no mesh of a packing has.
    #[error("section {section}: {what}")]
    Damaged {
        /// Name of the section.
        section: String,
        /// What is wrong.
        what: String,
    },
    /// The system refused memory.
    #[error(transparent)]
    OutOfMemory(#[from] OutOfMemory),
    /// It was told to stop.
    #[error("stopped")]
    Stopped,
}

/// Elements or nodes between two looks at whether to stop.
const PER_LOOK: u64 = 1 << 12;
/// Most elements of a dimension in a file, for room that is reserved by what the file states.
const MOST_AT_ONCE: u64 = 1 << 16;

/// The elements that a mesh consists of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bodies {
    /// Those of volumes.
    Tetrahedra,
    /// Those of planes.
    Triangles(PlaneState),
}

impl Bodies {
    /// Dimension of the bodies: that of their sides is one less.
    fn dimension(self) -> u8 {
        match self {
            Self::Tetrahedra => 3,
            Self::Triangles(_) => 2,
        }
    }

    /// The kind of elements with this number of nodes.
    fn kind(self, nodes: usize) -> Option<ElementKind> {
        match (self, nodes) {
            (Self::Tetrahedra, 4) => Some(ElementKind::Tetrahedron4),
            (Self::Tetrahedra, 10) => Some(ElementKind::Tetrahedron10),
            (Self::Triangles(state), 3) => Some(ElementKind::Triangle3(state)),
            (Self::Triangles(state), 6) => Some(ElementKind::Triangle6(state)),
            _ => None,
        }
    }
}

/// Dimension and number of nodes of an element, by Gmsh's number of its type.
fn element_type(kind: i32) -> Option<(u8, usize)> {
    match kind {
        15 => Some((0, 1)),
        1 => Some((1, 2)),
        8 => Some((1, 3)),
        2 => Some((2, 3)),
        9 => Some((2, 6)),
        4 => Some((3, 4)),
        11 => Some((3, 10)),
        _ => None,
    }
}

/// An entity of a dimension with its physical groups.
struct Entity {
    dimension: u8,
    tag: i32,
    physical: Vec<i32>,
}

/// What a file has, as it is written.
#[derive(Default)]
struct Contents {
    /// Physical groups: dimension, tag and name.
    names: Vec<(u8, i32, String)>,
    entities: Vec<Entity>,
    node_tags: Vec<u64>,
    nodes_mm: Vec<Vector3<f64>>,
    /// The elements of the mesh.
    bodies: Elements,
    /// Elements on its faces.
    sides: Elements,
}

/// Elements of one dimension.
#[derive(Default)]
struct Elements {
    /// Nodes of an element; 0 before the first.
    per_element: usize,
    /// Nodes of the elements.
    nodes: Vec<u64>,
    /// Tag of the entity, and the number of its elements.
    blocks: Vec<(i32, usize)>,
}

/// Reads a file. Nodes without an element are left out; elements are put in the order of the phases.
///
/// # Errors
/// See [`MshError`].
pub fn read(input: impl Read, bodies: Bodies, control: &dyn Control) -> Result<SolidMesh, MshError> {
    let mut source = Source::new(input);
    let mut contents = Contents::default();
    format(&mut source)?;
    while let Some(line) = source.next_line()? {
        let Some(section) = line.strip_prefix('$') else {
            return Err(source.fault(format!("{line:?} stands between two sections")));
        };
        section.clone_into(&mut source.section);
        match section {
            "PhysicalNames" => physical_names(&mut source, &mut contents)?,
            "Entities" => entities(&mut source, &mut contents)?,
            "Nodes" => nodes(&mut source, &mut contents, control)?,
            "Elements" => elements(&mut source, &mut contents, bodies, control)?,
            _ => {
                source.skip()?;
                continue;
            }
        }
        source.end()?;
    }
    assembly::assembled(contents, bodies)
}

fn format<R: Read>(source: &mut Source<R>) -> Result<(), MshError> {
    if source.next_line()?.as_deref() != Some("$MeshFormat") {
        return Err(source.fault("the file does not begin with $MeshFormat"));
    }
    let line = source.next_line()?.unwrap_or_default();
    let fields: Vec<&str> = line.split_whitespace().collect();
    source.is_text = match fields[..] {
        ["4.1", "0", "8"] => true,
        ["4.1", "1", "8"] => false,
        _ => return Err(source.fault(format!("the format {line:?} is not MSH 4.1 with numbers of 8 bytes"))),
    };
    if !source.is_text && source.int()? != 1 {
        return Err(source.fault("the order of bytes is another"));
    }
    source.end()
}

fn physical_names<R: Read>(source: &mut Source<R>, contents: &mut Contents) -> Result<(), MshError> {
    let count: usize = source
        .next_line()?
        .and_then(|line| line.parse().ok())
        .ok_or_else(|| source.fault("the number of groups is missing"))?;
    for _ in 0..count {
        let line = source.next_line()?.unwrap_or_default();
        let mut parts = line.splitn(3, char::is_whitespace);
        let mut number = || parts.next()?.parse::<i32>().ok();
        let (dimension, tag) = (number(), number());
        let name = parts.next().and_then(|name| name.trim().strip_prefix('"')?.strip_suffix('"'));
        match (dimension.and_then(|d| u8::try_from(d).ok()), tag, name) {
            (Some(dimension), Some(tag), Some(name)) => {
                contents.names.push((dimension, tag, name.to_owned()));
            }
            _ => return Err(source.fault(format!("{line:?} is no name of a group"))),
        }
    }
    Ok(())
}

fn entities<R: Read>(source: &mut Source<R>, contents: &mut Contents) -> Result<(), MshError> {
    let mut counts = [0; 4];
    for count in &mut counts {
        *count = source.size()?;
    }
    for (dimension, count) in (0_u8..).zip(counts) {
        for _ in 0..count {
            let tag = source.int()?;
            for _ in 0..if dimension == 0 { 3 } else { 6 } {
                source.double()?;
            }
            let mut physical = Vec::new();
            for _ in 0..source.size()? {
                physical.push(source.int()?);
            }
            if dimension > 0 {
                for _ in 0..source.size()? {
                    source.int()?;
                }
            }
            make_room(&mut contents.entities, 1)?;
            contents.entities.push(Entity { dimension, tag, physical });
        }
    }
    Ok(())
}

fn nodes<R: Read>(
    source: &mut Source<R>,
    contents: &mut Contents,
    control: &dyn Control,
) -> Result<(), MshError> {
    let blocks = source.size()?;
    for _ in 0..3 {
        source.size()?;
    }
    for _ in 0..blocks {
        let (dimension, _, parametric) = (source.int()?, source.int()?, source.int()?);
        if !(0..=3).contains(&dimension) {
            return Err(source.fault(format!("{dimension} is no dimension")));
        }
        let count = source.size()?;
        for number in 0..count {
            look(number, control)?;
            make_room_for(&mut contents.node_tags, count - number)?;
            contents.node_tags.push(source.size()?);
        }
        for number in 0..count {
            look(number, control)?;
            let point = Vector3::new(source.double()?, source.double()?, source.double()?);
            if point.iter().any(|x| !x.is_finite()) {
                return Err(source.fault("a coordinate is not finite"));
            }
            if parametric != 0 {
                for _ in 0..dimension {
                    source.double()?;
                }
            }
            make_room_for(&mut contents.nodes_mm, count - number)?;
            contents.nodes_mm.push(point);
        }
    }
    Ok(())
}

fn elements<R: Read>(
    source: &mut Source<R>,
    contents: &mut Contents,
    bodies: Bodies,
    control: &dyn Control,
) -> Result<(), MshError> {
    let blocks = source.size()?;
    for _ in 0..3 {
        source.size()?;
    }
    for _ in 0..blocks {
        let (_, tag, kind) = (source.int()?, source.int()?, source.int()?);
        let count = source.size()?;
        let Some((dimension, per_element)) = element_type(kind).filter(|(of, _)| *of <= bodies.dimension())
        else {
            return Err(source.fault(format!("elements of the kind {kind} have no place in such a mesh")));
        };
        // Those of lower dimensions have no place either, but are in many files.
        let mut list = match bodies.dimension() - dimension {
            0 => Some(&mut contents.bodies),
            1 => Some(&mut contents.sides),
            _ => None,
        };
        if let Some(list) = &mut list {
            if list.per_element != 0 && list.per_element != per_element {
                return Err(source.fault("elements have several orders"));
            }
            list.per_element = per_element;
        }
        for number in 0..count {
            look(number, control)?;
            source.size()?;
            for _ in 0..per_element {
                let node = source.size()?;
                if let Some(list) = &mut list {
                    make_room_for(&mut list.nodes, (count - number).saturating_mul(per_element as u64))?;
                    list.nodes.push(node);
                }
            }
        }
        if let Some(list) = list {
            list.blocks.push((tag, count as usize));
        }
    }
    Ok(())
}

/// Room for elements that are to come, by what a file states of their number.
fn make_room_for<T>(list: &mut Vec<T>, left: u64) -> Result<(), OutOfMemory> {
    if list.len() == list.capacity() {
        make_room(list, left.clamp(1, MOST_AT_ONCE.max(list.len() as u64)) as usize)?;
    }
    Ok(())
}

fn look(number: u64, control: &dyn Control) -> Result<(), MshError> {
    if number.is_multiple_of(PER_LOOK) {
        go_on(control).map_err(|_: ExportError| MshError::Stopped)?;
    }
    Ok(())
}
