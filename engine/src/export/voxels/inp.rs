//! Abaqus keywords of a voxel model: what stands between `*PART` and `*END PART`, to be included there.
//!
//! One C3D8 per voxel inside the specimen. Sets of elements `matrix` and `aggregates`, and one for each of several
//! aggregates; per face of the specimen
//! (`x_min` to `z_max`, or `side`, `z_min`, `z_max`) a set of nodes, one of elements by its Abaqus face, and a surface;
//! the surface `itz` between the phases, on the side of the aggregates. Numbers of nodes and elements are those of the
//! full lattice, counted from 1 with x fastest, so that a voxel's place is known by its number; those outside of a
//! cylinder are missing.

use std::io::{self, Write};

use super::pass::{Found, Text, Work, count_of};
use super::rows::RowPieces;
use super::{Label, MAX_CELLS, VoxelGrid};
use crate::arrays::{self, Each as _};
use crate::elementary;
use crate::export::ExportError;
use crate::export::digits::{push_exact, push_whole};
use crate::export::groups::AggregateGroups;
use crate::memory::reserved;
use crate::request::Specimen;

/// Voxels of a piece of text, where a row has not more: about a megabyte of elements.
const VOXELS_PER_PIECE: usize = 1 << 12;

/// Layers that all passes do: one over the nodes, and one over the voxels for labels, matrix, aggregates, each of
/// several aggregates, and interface.
pub(super) fn layers(grid: &VoxelGrid, groups: &AggregateGroups<'_>) -> usize {
    let nz = grid.shape[2];
    nz + 1 + nz * (4 + groups.with_grains().count())
}

/// Numbers on a line of a set; Abaqus reads no more than 16.
const PER_LINE: usize = 16;

/// The faces of a hexahedron: name of the specimen's face it may be part of, its identifier, the offset of the
/// neighbour.
pub(super) const FACES: [(&str, &str, [i64; 3]); 6] = [
    ("x_min", "S6", [-1, 0, 0]),
    ("x_max", "S4", [1, 0, 0]),
    ("y_min", "S3", [0, -1, 0]),
    ("y_max", "S5", [0, 1, 0]),
    ("z_min", "S1", [0, 0, -1]),
    ("z_max", "S2", [0, 0, 1]),
];

/// What of the grains the length of the file depends on.
#[derive(Clone, Copy, Debug)]
pub(in crate::export) struct Interfaces {
    /// Volume of the grains over that of the specimen.
    pub(in crate::export) fraction: f64,
    /// Surface of the grains over the volume of the specimen, in 1/mm.
    pub(in crate::export) surface_per_mm: f64,
    /// Whether there are several aggregates, each of which has a set.
    pub(in crate::export) has_sets: bool,
}

impl Interfaces {
    /// Those of the longest file that is likely: fine grains and several aggregates.
    pub(in crate::export) const MOST: Self =
        Self { fraction: 0.5, surface_per_mm: f64::INFINITY, has_sets: true };

    /// Those of numbers of grains with their diameters in mm, as spheres.
    pub(in crate::export) fn of(
        specimen: &Specimen,
        grains: impl Iterator<Item = (f64, f64)>,
        has_sets: bool,
    ) -> Self {
        let volume_mm3 = specimen.volume_mm3();
        let (mut fraction, mut surface_per_mm) = (0.0, 0.0);
        for (number, d_mm) in grains {
            let surface = number * std::f64::consts::PI * d_mm * d_mm / volume_mm3;
            surface_per_mm += surface;
            fraction += surface * d_mm / 6.0;
        }
        Self { fraction: fraction.min(1.0), surface_per_mm, has_sets }
    }

    /// Faces between a voxel of aggregate and one of matrix, for each voxel.
    ///
    /// Two points at the distance r lie in different phases with the probability 2 f (1 - f) (1 - exp(-r/l)), where
    /// l = 4 f (1 - f) / s, by the model of Debye, Anderson and Brumberger (1957, 10.1063/1.1722830), which is right
    /// for surfaces s that are flat at that distance and for unrelated points alike. A voxel has three neighbours that
    /// were not counted before.
    fn faces_per_voxel(&self, voxel_mm: f64) -> f64 {
        let apart = 2.0 * self.fraction * (1.0 - self.fraction);
        if apart <= 0.0 {
            return 0.0;
        }
        3.0 * apart * (1.0 - elementary::exp(-voxel_mm * self.surface_per_mm / (2.0 * apart)))
    }
}

/// Digits of all numbers from 1 to `last`.
fn digits_up_to(last: u64) -> u64 {
    let (mut sum, mut first, mut digits) = (0_u64, 1_u64, 1_u64);
    while first <= last {
        let end = first.saturating_mul(10).min(last.saturating_add(1));
        sum = sum.saturating_add((end - first).saturating_mul(digits));
        (first, digits) = (first.saturating_mul(10), digits + 1);
    }
    sum
}

/// Digits of the largest number of a node; elements are fewer.
fn digits(grid: &VoxelGrid) -> u64 {
    let nodes: u64 = grid.shape.iter().fold(1, |product, n| product.saturating_mul(*n as u64 + 1));
    u64::from(nodes.max(1).ilog10()) + 1
}

/// Bytes of a coordinate at most, with what stands before it.
const COORDINATE_BYTES: u64 = 21;

/// Bytes of the file, but for the heads of its sections: exact but for the interface and the sets of aggregates.
pub(super) fn bytes(grid: &VoxelGrid, grains: &Interfaces) -> u64 {
    if grid.shape.iter().any(|n| *n > MAX_CELLS as usize) {
        // It is refused; this is the order of its size.
        return grid.voxels().saturating_mul(100);
    }
    let [nx, ny, nz] = grid.shape.each(|n| n as f64);
    let all: u64 = grid.shape.iter().fold(1, |product, n| product.saturating_mul(*n as u64 + 1));
    let (nodes, voxels) = (all as f64, grid.voxels() as f64);
    // Without what is outside of a cylinder; the numbers are those of the whole grid.
    let inside = grid.inside_per_layer() as f64 / (nx * ny);
    let of_node = digits_up_to(all) as f64 / nodes;
    let of_element = digits_up_to(grid.voxels()) as f64 / voxels;
    // A comma stands before each coordinate.
    let of_place: f64 = (0..3)
        .map(|axis| {
            let count = grid.shape[axis] + 1;
            let mut text = Vec::new();
            (0..count).for_each(|i| push_exact(&mut text, grid.corner(axis, i)));
            1.0 + text.len() as f64 / count as f64
        })
        .sum();
    let lines_of_nodes = nodes * (of_node + of_place + 1.0);
    let lines_of_elements = voxels * (of_element + 8.0 * (of_node + 1.0) + 1.0);
    let side = [nx * ny, ny * nz, nz * nx].into_iter().sum::<f64>() * 2.0;
    let lines_of_faces = side * (of_node + 1.0 + of_element + 5.0);
    let [dx, dy, dz] = grid.spacing_mm;
    let faces = grains.faces_per_voxel(elementary::cbrt(dx * dy * dz));
    // A set of elements and of a face has its numbers, a face's with `, S1`.
    let sets = if grains.has_sets { grains.fraction * (of_element + 1.0) } else { 0.0 };
    let lines_of_phases = voxels * (faces * (of_element + 5.0) + sets);
    ((lines_of_nodes + lines_of_elements + lines_of_phases) * inside + lines_of_faces) as u64
}

const MATRIX: u8 = 0;
/// Label of the first aggregate.
const AGGREGATE: u8 = 1;
/// More than any label of a mix of [`crate::request::MAX_AGGREGATES`] has.
const OUTSIDE: u8 = u8::MAX;

fn is_aggregate(label: u8) -> bool {
    label != MATRIX && label != OUTSIDE
}

pub(super) fn write(work: &Work<'_>, out: &mut dyn Write) -> Result<Found, ExportError> {
    let grid = work.bodies.grid;
    let lattice = Lattice { grid };
    let [nx, ny, nz] = grid.shape;
    let [dx, dy, dz] = grid.spacing_mm;
    writeln!(out, "** {nx} x {ny} x {nz} voxels of {dx} x {dy} x {dz} mm; units mm")?;
    writeln!(out, "** to be included between *PART and *END PART")?;
    let mut labels = reserved(nx * ny * nz)?;
    let found = work.labels(Label::Aggregate, &mut labels)?;
    let voxels = Voxels { lattice: &lattice, labels: &labels };
    let mut text = Text::new(work, voxels.pieces().number(), out);
    voxels.write_nodes(&mut text)?;
    voxels.write_elements("matrix", |label| label == MATRIX, &mut text)?;
    voxels.write_elements("aggregates", is_aggregate, &mut text)?;
    for (number, name) in work.groups.with_grains() {
        voxels.write_aggregate(name, AGGREGATE + number as u8, &mut text)?;
    }
    lattice.write_node_sets(text.out)?;
    lattice.write_surfaces(text.out)?;
    voxels.write_interface(&mut text)?;
    Ok(found)
}

/// All voxels, of which text is written in pieces.
struct Voxels<'a> {
    lattice: &'a Lattice<'a>,
    labels: &'a [u8],
}

impl Voxels<'_> {
    fn pieces(&self) -> RowPieces {
        RowPieces::new(self.lattice.grid.shape, VOXELS_PER_PIECE)
    }

    /// Bytes of a piece at most, by those of a voxel.
    fn most_bytes(&self, pieces: &RowPieces, of_voxel: u64) -> usize {
        pieces.most_rows() * self.lattice.grid.shape[0] * of_voxel as usize
    }

    /// Labels of a piece.
    fn labels(&self, pieces: &RowPieces, piece: usize) -> &[u8] {
        let (rows, nx) = (pieces.rows(piece), self.lattice.grid.shape[0]);
        &self.labels[rows.start * nx..rows.end * nx]
    }

    /// The places of those voxels of a piece whose label is asked for.
    fn places(
        &self,
        pieces: &RowPieces,
        piece: usize,
        is_asked_for: impl Fn(u8) -> bool,
    ) -> impl Iterator<Item = [usize; 3]> {
        let [nx, ny, _] = self.lattice.grid.shape;
        let rows = self.labels(pieces, piece).chunks_exact(nx).zip(pieces.rows(piece));
        rows.flat_map(move |(row, number)| row.iter().enumerate().map(move |(i, label)| (i, number, *label)))
            .filter(move |(_, _, label)| is_asked_for(*label))
            .map(move |(i, number, _)| [i, number % ny, number / ny])
    }

    fn write_nodes(&self, text: &mut Text<'_>) -> Result<(), ExportError> {
        let grid = self.lattice.grid;
        let shape = grid.shape.map(|n| n + 1);
        let pieces = RowPieces::new(shape, VOXELS_PER_PIECE);
        let of_node = digits(grid) + 1 + 3 * COORDINATE_BYTES;
        let coordinate = |axis: usize, i: usize| {
            let mut text = vec![b','];
            push_exact(&mut text, grid.corner(axis, i));
            text
        };
        let along_x: Vec<Vec<u8>> = (0..shape[0]).map(|i| coordinate(0, i)).collect();
        let append = |piece: usize, text: &mut Vec<u8>| {
            for (k, rows) in pieces.layers(piece) {
                let z = coordinate(2, k);
                for j in rows {
                    let mut rest = coordinate(1, j);
                    rest.extend_from_slice(&z);
                    rest.push(b'\n');
                    for i in self.lattice.node_row(j) {
                        push_whole(text, self.lattice.node([i, j, k]) as u64);
                        text.extend_from_slice(&along_x[i]);
                        text.extend_from_slice(&rest);
                    }
                }
            }
        };
        let most_bytes = pieces.most_rows() * shape[0] * of_node as usize;
        text.write(&pieces, most_bytes, "*NODE\n", append)
    }

    /// Writes the elements of the voxels whose label is asked for.
    fn write_elements(
        &self,
        set: &str,
        is_asked_for: impl Fn(u8) -> bool + Copy + Sync,
        text: &mut Text<'_>,
    ) -> Result<(), ExportError> {
        let pieces = self.pieces();
        let append = |piece: usize, text: &mut Vec<u8>| {
            for place in self.places(&pieces, piece, is_asked_for) {
                self.lattice.push_element(place, text);
            }
        };
        let most_bytes = self.most_bytes(&pieces, 9 * (digits(self.lattice.grid) + 1));
        text.write(&pieces, most_bytes, &format!("*ELEMENT, TYPE=C3D8, ELSET={set}\n"), append)
    }

    /// Writes the set of elements of one of several aggregates.
    ///
    /// By their numbers and not as a part of `aggregates`, for meshio reads no sets of sets.
    fn write_aggregate(&self, name: &str, label: u8, text: &mut Text<'_>) -> Result<(), ExportError> {
        let pieces = self.pieces();
        let mut before = reserved(pieces.number())?;
        let mut count = 0_u64;
        for piece in 0..pieces.number() {
            before.push(count);
            count += count_of(self.labels(&pieces, piece), |own| *own == label);
        }
        let append = |piece: usize, text: &mut Vec<u8>| {
            for (n, place) in (before[piece]..).zip(self.places(&pieces, piece, |own| own == label)) {
                match n {
                    0 => {}
                    n if n % PER_LINE as u64 == 0 => text.push(b'\n'),
                    _ => text.push(b','),
                }
                push_whole(text, self.lattice.element(place) as u64);
            }
        };
        let most_bytes = self.most_bytes(&pieces, digits(self.lattice.grid) + 1);
        text.write(&pieces, most_bytes, &format!("*ELSET, ELSET={name}\n"), append)?;
        if count > 0 {
            writeln!(text.out)?;
        }
        Ok(())
    }

    /// Writes the faces of aggregate voxels towards the matrix.
    fn write_interface(&self, text: &mut Text<'_>) -> Result<(), ExportError> {
        let [nx, ny, nz] = self.lattice.grid.shape;
        let pieces = self.pieces();
        let append = |piece: usize, text: &mut Vec<u8>| {
            for place @ [i, j, k] in self.places(&pieces, piece, is_aggregate) {
                let at = i + nx * (j + ny * k);
                let to_matrix = [
                    i > 0 && self.labels[at - 1] == MATRIX,
                    i + 1 < nx && self.labels[at + 1] == MATRIX,
                    j > 0 && self.labels[at - nx] == MATRIX,
                    j + 1 < ny && self.labels[at + nx] == MATRIX,
                    k > 0 && self.labels[at - nx * ny] == MATRIX,
                    k + 1 < nz && self.labels[at + nx * ny] == MATRIX,
                ];
                for (_, (_, side, _)) in to_matrix.into_iter().zip(FACES).filter(|(matrix, _)| *matrix) {
                    push_whole(text, self.lattice.element(place) as u64);
                    text.extend_from_slice(b", ");
                    text.extend_from_slice(side.as_bytes());
                    text.push(b'\n');
                }
            }
        };
        let of_face = digits(self.lattice.grid) + 5;
        let most_bytes = self.most_bytes(&pieces, FACES.len() as u64 * of_face);
        text.write(&pieces, most_bytes, "*SURFACE, TYPE=ELEMENT, NAME=itz\n", append)
    }
}

/// Numbers of nodes and elements, from 1.
pub(super) struct Lattice<'a> {
    pub(super) grid: &'a VoxelGrid,
}

impl Lattice<'_> {
    pub(super) fn node(&self, [i, j, k]: [usize; 3]) -> usize {
        let [nx, ny, _] = self.grid.shape;
        1 + i + (nx + 1) * (j + (ny + 1) * k)
    }

    pub(super) fn element(&self, [i, j, k]: [usize; 3]) -> usize {
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

    /// The nodes of an element.
    pub(super) fn nodes_of(&self, [i, j, k]: [usize; 3]) -> impl Iterator<Item = usize> {
        const CORNERS: [[usize; 2]; 4] = [[0, 0], [1, 0], [1, 1], [0, 1]];
        [0, 1].into_iter().flat_map(move |dk| CORNERS.map(|[di, dj]| self.node([i + di, j + dj, k + dk])))
    }

    fn push_element(&self, place: [usize; 3], text: &mut Vec<u8>) {
        push_whole(text, self.element(place) as u64);
        for node in self.nodes_of(place) {
            text.push(b',');
            push_whole(text, node as u64);
        }
        text.push(b'\n');
    }

    /// Whether there is an element at that offset.
    fn has_neighbor(&self, place: [usize; 3], offset: [i64; 3]) -> bool {
        let there: [i64; 3] = arrays::from_fn(|a| place[a] as i64 + offset[a]);
        let on_grid = (0..3).all(|a| (0..self.grid.shape[a] as i64).contains(&there[a]));
        on_grid && self.grid.inside(there[1] as usize).contains(&(there[0] as usize))
    }

    /// The specimen's face that lies at that offset of an element which has no neighbour there.
    pub(super) fn face_name(&self, face: usize) -> &'static str {
        if self.grid.is_full() || face >= 4 { FACES[face].0 } else { "side" }
    }

    /// The specimen's faces.
    pub(super) fn face_names(&self) -> &'static [&'static str] {
        if self.grid.is_full() {
            &["x_min", "x_max", "y_min", "y_max", "z_min", "z_max"]
        } else {
            &["side", "z_min", "z_max"]
        }
    }

    /// Calls `visit` with every element that has no neighbour at that offset.
    pub(super) fn for_each_outer(
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
                // A row that has a neighbour all along has no outer element across y.
                let beside = j.checked_add_signed(offset[1] as isize).filter(|j| *j < ny);
                let beside = beside.map_or(0..0, |j| self.grid.inside(j));
                if offset[1] != 0 && beside.start <= row.start && row.end <= beside.end {
                    continue;
                }
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
    let mut text = Vec::new();
    for line in numbers.chunks(PER_LINE) {
        text.clear();
        for number in line {
            push_whole(&mut text, *number as u64);
            text.push(b',');
        }
        text.pop();
        text.push(b'\n');
        out.write_all(&text)?;
    }
    Ok(())
}
