//! Abaqus keywords of a solid mesh, which Abaqus and CalculiX read as they are: nodes, solid elements and sets alone.
//!
//! CalculiX reads the first 20 characters of a number; no coordinate is longer. Abaqus and CalculiX read 16 numbers a
//! line.

use std::io::{self, Write};

use super::{ELEMENTS_PER_LOOK, ElementKind, PhaseRole, SolidMesh, steps};
use crate::control::Control;
use crate::export::digits::{push_exact, push_whole};
use crate::export::{ExportError, go_on};

/// Numbers on a line of a set.
const PER_LINE: usize = 16;
/// Characters of a number that CalculiX reads.
const MOST_CHARACTERS: usize = 20;
/// Bytes that are gathered before they are written.
const BLOCK_BYTES: usize = 1 << 16;
/// Name of the set of nodes on grains.
const GRAIN_SURFACES: &str = "grain_surfaces";
/// Name of the set of all grains' elements.
const AGGREGATES: &str = "aggregates";

pub(super) fn write(
    mesh: &SolidMesh,
    head: &[String],
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<(), ExportError> {
    let mut file = File { mesh, out, text: Vec::with_capacity(2 * BLOCK_BYTES) };
    for line in head {
        writeln!(file.text, "** {line}")?;
    }
    file.nodes(control)?;
    file.elements(control)?;
    file.sets()?;
    file.out.write_all(&file.text)?;
    Ok(())
}

pub(super) fn bytes(kind: ElementKind, nodes: u64, elements: u64) -> u64 {
    let digits = |count: u64| u64::from(count.max(1).ilog10()) + 1;
    // A coordinate has 17 digits, its point and a comma. Faces and interfaces name a fifth of the nodes.
    let node = digits(nodes) + 3 * 19 + 2 + digits(nodes) / 5;
    let element = digits(elements) + 1 + kind.nodes() as u64 * (digits(nodes) + 1);
    nodes.saturating_mul(node).saturating_add(elements.saturating_mul(element))
}

struct File<'a> {
    mesh: &'a SolidMesh,
    out: &'a mut dyn Write,
    text: Vec<u8>,
}

impl File<'_> {
    fn flush_block(&mut self) -> io::Result<()> {
        if self.text.len() >= BLOCK_BYTES {
            self.out.write_all(&self.text)?;
            self.text.clear();
        }
        Ok(())
    }

    fn nodes(&mut self, control: &dyn Control) -> Result<(), ExportError> {
        self.text.extend_from_slice(b"*NODE\n");
        for (number, point) in (1..).zip(&self.mesh.nodes_mm) {
            if (number as usize).is_multiple_of(ELEMENTS_PER_LOOK) {
                go_on(control)?;
            }
            push_whole(&mut self.text, number);
            for x in point.iter() {
                self.text.push(b',');
                push_coordinate(&mut self.text, *x)?;
            }
            self.text.push(b'\n');
            self.flush_block()?;
        }
        Ok(())
    }

    fn elements(&mut self, control: &dyn Control) -> Result<(), ExportError> {
        let mesh = self.mesh;
        let steps = steps(mesh, "writing elements", control);
        let mut done = 0;
        for (number, phase) in mesh.phases.iter().enumerate() {
            writeln!(self.text, "*ELEMENT, TYPE={}, ELSET={}", mesh.kind.abaqus_name(), phase.name)?;
            for element in (0..mesh.len()).filter(|element| usize::from(mesh.phase_of[*element]) == number) {
                if done % ELEMENTS_PER_LOOK == 0 {
                    go_on(control)?;
                    steps.report(done);
                }
                done += 1;
                push_whole(&mut self.text, element as u64 + 1);
                for node in mesh.element(element) {
                    self.text.push(b',');
                    push_whole(&mut self.text, u64::from(*node) + 1);
                }
                self.text.push(b'\n');
                self.flush_block()?;
            }
        }
        Ok(())
    }

    fn sets(&mut self) -> Result<(), ExportError> {
        let mesh = self.mesh;
        let is_aggregate = |phase: &u16| {
            let set = mesh.phases.get(usize::from(*phase));
            set.is_some_and(|set| set.role != PhaseRole::Matrix)
        };
        // A mix with one aggregate has this set by its elements.
        if mesh.phases.len() > 1 && !mesh.phases.iter().any(|phase| phase.name == AGGREGATES) {
            writeln!(self.text, "*ELSET, ELSET={AGGREGATES}")?;
            let elements = (1..).zip(&mesh.phase_of).filter(|(_, phase)| is_aggregate(phase));
            self.numbers(elements.map(|(element, _)| element))?;
        }
        for face in &mesh.faces {
            writeln!(self.text, "*NSET, NSET={}", face.name)?;
            self.numbers(face.nodes.iter().map(|node| u64::from(*node) + 1))?;
        }
        if !mesh.grain_surfaces.is_empty() {
            writeln!(self.text, "*NSET, NSET={GRAIN_SURFACES}")?;
            self.numbers(mesh.grain_surfaces.iter().map(|node| u64::from(*node) + 1))?;
        }
        for face in &mesh.faces {
            writeln!(self.text, "*SURFACE, TYPE=ELEMENT, NAME={}", face.name)?;
            for side in &face.sides {
                writeln!(self.text, "{}, S{}", u64::from(side.element) + 1, side.side)?;
                self.flush_block()?;
            }
        }
        Ok(())
    }

    fn numbers(&mut self, numbers: impl Iterator<Item = u64>) -> io::Result<()> {
        for (place, number) in numbers.enumerate() {
            match place {
                0 => {}
                place if place.is_multiple_of(PER_LINE) => {
                    self.text.push(b'\n');
                    self.flush_block()?;
                }
                _ => self.text.push(b','),
            }
            push_whole(&mut self.text, number);
        }
        self.text.push(b'\n');
        Ok(())
    }
}

/// Appends a coordinate: to the last bit where that takes 20 characters, else with 12 digits.
fn push_coordinate(text: &mut Vec<u8>, x: f64) -> io::Result<()> {
    let before = text.len();
    push_exact(text, x);
    if text.len() - before > MOST_CHARACTERS {
        text.truncate(before);
        write!(text, "{x:.11e}")?;
    }
    Ok(())
}
