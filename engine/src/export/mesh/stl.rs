//! STL, a file for each phase in one zip: `aggregates.stl`, or one for each of several aggregates, and `matrix.stl`.
//!
//! The matrix is bounded by the specimen's faces and, turned inside out, by the grains; both files are closed
//! and their normals point outwards. Binary STL has single precision, about 1e-5 mm in a specimen of 150 mm.

use std::io::Write;
use std::ops::Range;

use super::{Mesh, SurfaceOptions, SurfaceReport};
use crate::arrays::Each as _;
use crate::control::Control;
use crate::export::archive::{Archive, Content, PIECE_BYTES};
use crate::export::groups::AggregateGroups;
use crate::export::{ExportError, Model, go_on};
use crate::gap::linear::{cross, dot};
use crate::plan::Limits;

/// Most triangles of an STL file: their number has 32 bits.
const MAX_TRIANGLES: usize = u32::MAX as usize;
const HEADER_BYTES: usize = 84;
const TRIANGLE_BYTES: usize = 50;

/// Writes the zip.
///
/// # Errors
/// See [`ExportError`].
pub fn write(
    model: &Model<'_>,
    options: &SurfaceOptions,
    limits: &Limits,
    control: &dyn Control,
    out: &mut dyn Write,
) -> Result<SurfaceReport, ExportError> {
    let (mesh, report) = Mesh::new(model, options, limits, control)?;
    let shell = &mesh.shell.surface;
    if shell.triangles.len() + mesh.grain_triangles() > MAX_TRIANGLES {
        return Err(ExportError::Unavailable(
            "STL counts triangles with 32 bits: lower segments, or ask for msh".into(),
        ));
    }
    let mut archive = Archive::new(out, limits.export_threads)?;
    let pieces = Pieces::of(&mesh);
    let groups = AggregateGroups::of(model);
    let parts: Vec<(Option<usize>, &str)> = if groups.is_empty() {
        vec![(None, "aggregates")]
    } else {
        groups.with_grains().map(|(number, name)| (Some(number), name)).collect()
    };
    for (aggregate, name) in parts {
        let is_in = |row: &usize| aggregate.is_none_or(|number| groups.of_grain(*row) == number);
        let triangles = (0..mesh.grains()).filter(is_in).map(|row| mesh.grain(row).1.len()).sum();
        let content = Content {
            pieces: 1 + pieces.number,
            most_bytes: pieces.most_bytes,
            write: |piece: usize, stl: &mut Vec<u8>| {
                go_on(control)?;
                match piece.checked_sub(1) {
                    None => begin(stl, name, triangles),
                    Some(piece) => {
                        Pieces::rows(&mesh, piece)
                            .filter(is_in)
                            .for_each(|row| put_grain(stl, &mesh, row, false));
                    }
                }
                Ok(())
            },
            taken: |_| {},
        };
        archive.add(&format!("{name}.stl"), content)?;
    }
    let of_shell = shell.triangles.len().div_ceil(TRIANGLES);
    let content = Content {
        pieces: 1 + of_shell + pieces.number,
        most_bytes: pieces.most_bytes,
        write: |piece: usize, stl: &mut Vec<u8>| {
            go_on(control)?;
            match piece.checked_sub(1) {
                None => begin(stl, "matrix", shell.triangles.len() + mesh.grain_triangles()),
                Some(piece) if piece < of_shell => {
                    for corners in shell.triangles.iter().skip(piece * TRIANGLES).take(TRIANGLES) {
                        put_triangle(stl, corners.each(|p| shell.points[p as usize]));
                    }
                }
                Some(piece) => {
                    Pieces::rows(&mesh, piece - of_shell).for_each(|row| put_grain(stl, &mesh, row, true));
                }
            }
            Ok(())
        },
        taken: |_| {},
    };
    archive.add("matrix.stl", content)?;
    archive.finish()?;
    super::report_progress(control, mesh.grains(), mesh.grains());
    Ok(report)
}

/// Triangles of a piece.
const TRIANGLES: usize = PIECE_BYTES / TRIANGLE_BYTES;

/// The grains in pieces: those whose first triangle lies in the same range of [`TRIANGLES`].
struct Pieces {
    number: usize,
    most_bytes: usize,
}

impl Pieces {
    fn of(mesh: &Mesh) -> Self {
        let most_of_a_grain = (0..mesh.grains()).map(|row| mesh.grain(row).1.len()).max().unwrap_or(0);
        Self {
            number: mesh.grain_triangles().div_ceil(TRIANGLES),
            most_bytes: HEADER_BYTES + TRIANGLE_BYTES * (TRIANGLES + most_of_a_grain),
        }
    }

    fn rows(mesh: &Mesh, piece: usize) -> Range<usize> {
        let first_from = |triangle: usize| match triangle {
            0 => 0,
            // A grain begins where the one before it ends.
            _ => (1 + mesh.ends.partition_point(|&(_, end)| end < triangle)).min(mesh.grains()),
        };
        first_from(piece * TRIANGLES)..first_from((piece + 1) * TRIANGLES)
    }
}

fn begin(stl: &mut Vec<u8>, name: &str, triangles: usize) {
    // The header must not begin with "solid", which would announce text.
    stl.extend_from_slice(format!("{:<80.80}", format!("packstone {name}, mm")).as_bytes());
    stl.extend_from_slice(&(triangles as u32).to_le_bytes());
}

fn put_grain(stl: &mut Vec<u8>, mesh: &Mesh, row: usize, inside_out: bool) {
    let (points, triangles) = mesh.grain(row);
    for corners in triangles {
        let [a, b, c] = corners.each(|p| points[p as usize]);
        put_triangle(stl, if inside_out { [a, c, b] } else { [a, b, c] });
    }
}

fn put_triangle(stl: &mut Vec<u8>, [a, b, c]: [[f64; 3]; 3]) {
    let from_a = |p: [f64; 3]| [0, 1, 2].each(|i| p[i] - a[i]);
    let normal = cross(from_a(b), from_a(c));
    let length = dot(normal, normal).sqrt();
    let mut record = [0_u8; TRIANGLE_BYTES];
    let numbers = [normal.each(|x| x / length), a, b, c];
    for (bytes, x) in record.chunks_exact_mut(4).zip(numbers.iter().flatten()) {
        bytes.copy_from_slice(&(*x as f32).to_le_bytes());
    }
    stl.extend_from_slice(&record);
}
