//! Abaqus keywords of a voxel model: what stands between `*PART` and `*END PART`, to be included there.
//!
//! One C3D8 per voxel inside the specimen. Sets of elements `matrix` and `aggregates`, and one for each of several
//! aggregates; per face of the specimen
//! (`x_min` to `z_max`, or `side`, `z_min`, `z_max`) a set of nodes, one of elements by its Abaqus face, and a surface;
//! the surface `itz` between the phases, on the side of the aggregates. Numbers of nodes and elements are those of the
//! full lattice, counted from 1 with x fastest, so that a voxel's place is known by its number; those outside of a
//! cylinder are missing.

use std::io::{self, Write};

use super::layers::Layers;
use super::{Found, LayerSteps, VoxelGrid};
use crate::arrays;
use crate::export::groups::AggregateGroups;
use crate::export::{ExportError, Model};
use crate::memory::{OutOfMemory, copied, filled};

/// Passes over the layers: matrix, aggregates, each of several aggregates, interface.
pub(super) fn passes(groups: &AggregateGroups<'_>) -> usize {
    3 + groups.with_grains().count()
}

/// Numbers on a line of a set; Abaqus reads no more than 16.
const PER_LINE: usize = 16;

/// The faces of a hexahedron: name of the specimen's face it may be part of, its identifier, the offset of the
/// neighbour.
const FACES: [(&str, &str, [i64; 3]); 6] = [
    ("x_min", "S6", [-1, 0, 0]),
    ("x_max", "S4", [1, 0, 0]),
    ("y_min", "S3", [0, -1, 0]),
    ("y_max", "S5", [0, 1, 0]),
    ("z_min", "S1", [0, 0, -1]),
    ("z_max", "S2", [0, 0, 1]),
];

/// Bytes of the file at most.
pub(super) fn most_bytes(grid: &VoxelGrid) -> u64 {
    let nodes: u64 = grid.shape.iter().fold(1, |product, n| product.saturating_mul(*n as u64 + 1));
    let digits = u64::from(nodes.max(1).ilog10()) + 1;
    // A node: its number and three coordinates. An element: nine numbers, and in a packing
    // of many small grains one or two faces of the interface; perhaps its number in the set of its aggregate.
    let (node, element) = (digits + 1 + 3 * 21, 10 * (digits + 1) + 2 * (digits + 4));
    nodes.saturating_mul(node).saturating_add(grid.voxels().saturating_mul(element))
}

const MATRIX: u8 = 0;
const AGGREGATE: u8 = 1;
/// More than any label of a mix of [`crate::request::MAX_AGGREGATES`] has.
const OUTSIDE: u8 = u8::MAX;

pub(super) fn write(
    model: &Model<'_>,
    grid: &VoxelGrid,
    groups: &AggregateGroups<'_>,
    layers_done: &LayerSteps<'_>,
    out: &mut dyn Write,
) -> Result<Found, ExportError> {
    let lattice = Lattice { grid };
    let [nx, ny, nz] = grid.shape;
    let [dx, dy, dz] = grid.spacing_mm;
    writeln!(out, "** {nx} x {ny} x {nz} voxels of {dx} x {dy} x {dz} mm; units mm")?;
    writeln!(out, "** to be included between *PART and *END PART")?;
    lattice.write_nodes(out)?;
    let mut found = Found { inside: grid.inside_per_layer() * nz as u64, ..Found::default() };
    for (phase, name) in [(MATRIX, "matrix"), (AGGREGATE, "aggregates")] {
        // A set without elements is no set, and a keyword without lines a fault.
        let mut header = Some(format!("*ELEMENT, TYPE=C3D8, ELSET={name}\n"));
        let mut layers = Phases::new(model, grid)?;
        for k in 0..nz {
            let layer = layers.next(k, &|_| AGGREGATE);
            for (j, row) in layer.chunks_exact(nx).enumerate() {
                for i in row.iter().enumerate().filter(|(_, label)| **label == phase).map(|(i, _)| i) {
                    if let Some(header) = header.take() {
                        out.write_all(header.as_bytes())?;
                    }
                    lattice.write_element([i, j, k], out)?;
                    found.aggregate += u64::from(phase);
                }
            }
            layers_done.next()?;
        }
        found.grains_without_voxel = layers.layers.grains_without_voxel();
    }
    found.of_aggregates = write_aggregates(model, &lattice, groups, layers_done, out)?;
    lattice.write_node_sets(out)?;
    lattice.write_surfaces(out)?;
    write_interface(model, &lattice, layers_done, out)?;
    Ok(found)
}

/// Writes the set of elements of each of several aggregates, and returns how many each has.
///
/// By their numbers and not as parts of `aggregates`, for meshio reads no sets of sets.
fn write_aggregates(
    model: &Model<'_>,
    lattice: &Lattice<'_>,
    groups: &AggregateGroups<'_>,
    layers_done: &LayerSteps<'_>,
    out: &mut dyn Write,
) -> Result<Vec<u64>, ExportError> {
    let [nx, _, nz] = lattice.grid.shape;
    let mut counts = vec![0; groups.all().count()];
    let label = |grain: usize| AGGREGATE + groups.of_grain(grain) as u8;
    for (number, name) in groups.with_grains() {
        let mut phases = Phases::new(model, lattice.grid)?;
        for k in 0..nz {
            for (j, row) in phases.next(k, &label).chunks_exact(nx).enumerate() {
                let is_own =
                    |label: u8| label != OUTSIDE && usize::from(label) == usize::from(AGGREGATE) + number;
                for i in row.iter().enumerate().filter(|(_, label)| is_own(**label)).map(|(i, _)| i) {
                    match counts[number] {
                        0 => writeln!(out, "*ELSET, ELSET={name}")?,
                        n if n % PER_LINE as u64 == 0 => writeln!(out)?,
                        _ => write!(out, ",")?,
                    }
                    write!(out, "{}", lattice.element([i, j, k]))?;
                    counts[number] += 1;
                }
            }
            layers_done.next()?;
        }
        if counts[number] > 0 {
            writeln!(out)?;
        }
    }
    Ok(counts)
}

/// Phases layer by layer.
struct Phases<'a> {
    grid: &'a VoxelGrid,
    layers: Layers<'a>,
    layer: Vec<u8>,
}

impl<'a> Phases<'a> {
    fn new(model: &Model<'a>, grid: &'a VoxelGrid) -> Result<Self, OutOfMemory> {
        let layer = filled(grid.shape[0] * grid.shape[1], MATRIX)?;
        Ok(Self { grid, layers: Layers::new(model, grid)?, layer })
    }

    /// Layer `k`; they come in rising order.
    fn next(&mut self, k: usize, label: &impl Fn(usize) -> u8) -> &[u8] {
        self.layer.fill(MATRIX);
        self.layers.fill(k, &mut self.layer, label);
        self.grid.fill_outside(&mut self.layer, OUTSIDE);
        &self.layer
    }
}

/// Numbers of nodes and elements.
struct Lattice<'a> {
    grid: &'a VoxelGrid,
}

impl Lattice<'_> {
    fn node(&self, [i, j, k]: [usize; 3]) -> usize {
        let [nx, ny, _] = self.grid.shape;
        1 + i + (nx + 1) * (j + (ny + 1) * k)
    }

    fn element(&self, [i, j, k]: [usize; 3]) -> usize {
        let [nx, ny, _] = self.grid.shape;
        1 + i + nx * (j + ny * k)
    }

    /// The nodes of a row that elements have.
    fn node_row(&self, j: usize) -> std::ops::Range<usize> {
        let rows = [j.checked_sub(1), (j < self.grid.shape[1]).then_some(j)];
        let rows = rows.into_iter().flatten().map(|j| self.grid.inside(j)).filter(|row| !row.is_empty());
        rows.map(|row| row.start..row.end + 1)
            .reduce(|a, b| a.start.min(b.start)..a.end.max(b.end))
            .unwrap_or_default()
    }

    fn write_nodes(&self, out: &mut dyn Write) -> io::Result<()> {
        let [_, ny, nz] = self.grid.shape;
        writeln!(out, "*NODE")?;
        let mut digits = [zmij::Buffer::new(), zmij::Buffer::new(), zmij::Buffer::new()];
        let [in_x, in_y, in_z] = &mut digits;
        for k in 0..=nz {
            let z = in_z.format_finite(self.grid.corner(2, k));
            for j in 0..=ny {
                let y = in_y.format_finite(self.grid.corner(1, j));
                for i in self.node_row(j) {
                    let x = in_x.format_finite(self.grid.corner(0, i));
                    writeln!(out, "{},{x},{y},{z}", self.node([i, j, k]))?;
                }
            }
        }
        Ok(())
    }

    fn write_element(&self, place: [usize; 3], out: &mut dyn Write) -> io::Result<()> {
        const CORNERS: [[usize; 2]; 4] = [[0, 0], [1, 0], [1, 1], [0, 1]];
        write!(out, "{}", self.element(place))?;
        let [i, j, k] = place;
        for dk in [0, 1] {
            for [di, dj] in CORNERS {
                write!(out, ",{}", self.node([i + di, j + dj, k + dk]))?;
            }
        }
        writeln!(out)
    }

    /// Whether there is an element at that offset.
    fn has_neighbor(&self, place: [usize; 3], offset: [i64; 3]) -> bool {
        let there: [i64; 3] = arrays::from_fn(|a| place[a] as i64 + offset[a]);
        let on_grid = (0..3).all(|a| (0..self.grid.shape[a] as i64).contains(&there[a]));
        on_grid && self.grid.inside(there[1] as usize).contains(&(there[0] as usize))
    }

    /// The specimen's face that lies at that offset of an element which has no neighbour there.
    fn face_name(&self, face: usize) -> &'static str {
        if self.grid.is_full() || face >= 4 { FACES[face].0 } else { "side" }
    }

    /// The specimen's faces.
    fn face_names(&self) -> &'static [&'static str] {
        if self.grid.is_full() {
            &["x_min", "x_max", "y_min", "y_max", "z_min", "z_max"]
        } else {
            &["side", "z_min", "z_max"]
        }
    }

    /// Calls `visit` with every element that has no neighbour at that offset.
    fn for_each_outer(
        &self,
        face: usize,
        visit: &mut dyn FnMut([usize; 3]) -> io::Result<()>,
    ) -> io::Result<()> {
        let [_, ny, nz] = self.grid.shape;
        let offset = FACES[face].2;
        let layers = match face {
            4 => 0..1,
            5 => nz - 1..nz,
            _ => 0..nz,
        };
        for k in layers {
            for j in 0..ny {
                let row = self.grid.inside(j);
                // Along x only the ends of a row can be outer ones.
                let outer = match face {
                    0 => row.start..row.end.min(row.start + 1),
                    1 => row.end.saturating_sub(1).max(row.start)..row.end,
                    _ => row,
                };
                for i in outer.filter(|i| !self.has_neighbor([*i, j, k], offset)) {
                    visit([i, j, k])?;
                }
            }
        }
        Ok(())
    }

    fn write_node_sets(&self, out: &mut dyn Write) -> io::Result<()> {
        for name in self.face_names() {
            let mut nodes = Vec::new();
            for (face, (_, _, offset)) in
                FACES.iter().enumerate().filter(|(f, _)| self.face_name(*f) == *name)
            {
                self.for_each_outer(face, &mut |place| {
                    let low: [usize; 3] = arrays::from_fn(|a| place[a] + usize::from(offset[a] > 0));
                    let high: [usize; 3] = arrays::from_fn(|a| place[a] + usize::from(offset[a] >= 0));
                    for k in low[2]..=high[2] {
                        for j in low[1]..=high[1] {
                            nodes.extend((low[0]..=high[0]).map(|i| self.node([i, j, k])));
                        }
                    }
                    Ok(())
                })?;
            }
            nodes.sort_unstable();
            nodes.dedup();
            writeln!(out, "*NSET, NSET={name}")?;
            write_set(&nodes, out)?;
        }
        Ok(())
    }

    fn write_surfaces(&self, out: &mut dyn Write) -> io::Result<()> {
        for name in self.face_names() {
            let mut parts = Vec::new();
            for face in (0..FACES.len()).filter(|face| self.face_name(*face) == *name) {
                let mut elements = Vec::new();
                self.for_each_outer(face, &mut |place| {
                    elements.push(self.element(place));
                    Ok(())
                })?;
                let side = FACES[face].1;
                writeln!(out, "*ELSET, ELSET={name}_{side}")?;
                write_set(&elements, out)?;
                parts.push(side);
            }
            writeln!(out, "*SURFACE, TYPE=ELEMENT, NAME={name}")?;
            for side in parts {
                writeln!(out, "{name}_{side}, {side}")?;
            }
        }
        Ok(())
    }
}

fn write_set(numbers: &[usize], out: &mut dyn Write) -> io::Result<()> {
    for line in numbers.chunks(PER_LINE) {
        for (i, number) in line.iter().enumerate() {
            write!(out, "{}{number}", if i > 0 { "," } else { "" })?;
        }
        writeln!(out)?;
    }
    Ok(())
}

/// Faces of aggregate voxels towards the matrix.
fn write_interface(
    model: &Model<'_>,
    lattice: &Lattice<'_>,
    layers_done: &LayerSteps<'_>,
    out: &mut dyn Write,
) -> Result<(), ExportError> {
    let [nx, ny, nz] = lattice.grid.shape;
    let mut header = Some("*SURFACE, TYPE=ELEMENT, NAME=itz\n");
    let mut phases = Phases::new(model, lattice.grid)?;
    let mut below = filled(nx * ny, OUTSIDE)?;
    let aggregate = |_| AGGREGATE;
    let mut layer = copied(phases.next(0, &aggregate))?;
    let mut above = filled(nx * ny, OUTSIDE)?;
    for k in 0..nz {
        if k + 1 < nz {
            above.copy_from_slice(phases.next(k + 1, &aggregate));
        } else {
            above.fill(OUTSIDE);
        }
        for j in 0..ny {
            for i in lattice.grid.inside(j) {
                let at = i + nx * j;
                if layer[at] != AGGREGATE {
                    continue;
                }
                let to_matrix = [
                    i > 0 && layer[at - 1] == MATRIX,
                    i + 1 < nx && layer[at + 1] == MATRIX,
                    j > 0 && layer[at - nx] == MATRIX,
                    j + 1 < ny && layer[at + nx] == MATRIX,
                    below[at] == MATRIX,
                    above[at] == MATRIX,
                ];
                for (_, (_, side, _)) in to_matrix.into_iter().zip(FACES).filter(|(matrix, _)| *matrix) {
                    if let Some(header) = header.take() {
                        out.write_all(header.as_bytes())?;
                    }
                    writeln!(out, "{}, {side}", lattice.element([i, j, k]))?;
                }
            }
        }
        std::mem::swap(&mut below, &mut layer);
        std::mem::swap(&mut layer, &mut above);
        layers_done.next()?;
    }
    Ok(())
}
