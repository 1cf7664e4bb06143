//! The VTK forms: points with arrays for glyphs, legacy (big-endian) and XML (raw appended). The XML form has field
//! data too: job ID, name, version of the engine, seed and volume fractions.
//!
//! Arrays of all grains: `diameter` (float64, mm; of the sphere of equal volume), `sieve_class` (int32, counted from
//! fine to coarse in the order of the summary's classes), `id` (int32, the row in the other formats). Spheres have
//! `radius` (float64, mm). Ellipsoids have `sieve` (float64, mm), `semi_axes` (3 float64, mm), `orientation` (4
//! float64: the quaternion w, x, y, z), and `tensor`: `R diag(2a, 2b, 2c) Rᵀ` in mm, which ParaView's Tensor Glyph
//! applies to a sphere of radius 0.5. The XML form has its six components in VTK's order XX, YY, ZZ, XY, YZ, XZ, the
//! legacy form all nine. Polyhedra are written as surfaces (`surfaces`).

use std::io::{self, Write};

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use super::source::{BLOCK_ROWS, for_each_block};
use super::{Column, GrainSource, Head, nominal_size};
use crate::arrays::Each as _;
use crate::export::vtk_xml::{Sink, VtkXml};
use crate::export::{ExportError, Provenance};
use crate::mix::sieve::class_of;
use crate::shape::Pose;

const POSITION: [Column; 3] = [Column::X, Column::Y, Column::Z];
const SEMI_AXES: [Column; 3] = [Column::A, Column::B, Column::C];
const ORIENTATION: [Column; 4] = [Column::Qw, Column::Qx, Column::Qy, Column::Qz];
pub(super) const BODY: [Column; 7] =
    [Column::Qw, Column::Qx, Column::Qy, Column::Qz, Column::A, Column::B, Column::C];

pub(super) fn write_legacy(head: &Head, grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
    let n = grains.len();
    let be = f64::to_be_bytes;
    write!(out, "# vtk DataFile Version 3.0\n{}\nBINARY\nDATASET POLYDATA\n", title(head))?;
    writeln!(out, "POINTS {n} double")?;
    let mut bytes = Vec::new();
    write_values(grains, POSITION, &mut bytes, out, |point| point, be)?;
    writeln!(out, "\nVERTICES {n} {}", 2 * n)?;
    write_rows(n, &mut bytes, out, |row, bytes| {
        bytes.extend(1_i32.to_be_bytes());
        bytes.extend((row as i32).to_be_bytes());
    })?;
    writeln!(out, "\nPOINT_DATA {n}")?;
    writeln!(out, "SCALARS diameter double 1\nLOOKUP_TABLE default")?;
    write_values(grains, [Column::Diameter], &mut bytes, out, |d| d, be)?;
    let is_spherical = !grains.has(Column::A);
    if !is_spherical {
        writeln!(out, "\nTENSORS tensor double")?;
        write_values(
            grains,
            BODY,
            &mut bytes,
            out,
            |body| tensor(body).into(),
            |row: [f64; 3]| {
                // Symmetric, so that the order of rows and columns does not matter.
                let mut nine = [0; 24];
                for (eight, x) in nine.chunks_exact_mut(8).zip(row) {
                    eight.copy_from_slice(&x.to_be_bytes());
                }
                nine
            },
        )?;
    }
    // Readers keep one array of scalars only, but all of a field.
    let arrays = if is_spherical { 3 } else { 5 } + i32::from(grains.has(Column::Aggregate));
    write!(out, "\nFIELD arrays {arrays}\n")?;
    if is_spherical {
        writeln!(out, "radius 1 {n} double")?;
        write_values(grains, [Column::Diameter], &mut bytes, out, |[d]| [d / 2.0], be)?;
    } else {
        writeln!(out, "sieve 1 {n} double")?;
        write_values(grains, [Column::Sieve], &mut bytes, out, |size| size, be)?;
        writeln!(out, "\nsemi_axes 3 {n} double")?;
        write_values(grains, SEMI_AXES, &mut bytes, out, |axes| axes, be)?;
        writeln!(out, "\norientation 4 {n} double")?;
        write_values(grains, ORIENTATION, &mut bytes, out, |q| q, be)?;
    }
    write!(out, "\nsieve_class 1 {n} int\n")?;
    let class = classifier(head);
    let size = nominal_size(head, grains);
    write_values(grains, [size], &mut bytes, out, |[d]| [class(d)], i32::to_be_bytes)?;
    if grains.has(Column::Aggregate) {
        write!(out, "\naggregate 1 {n} int\n")?;
        write_values(grains, [Column::Aggregate], &mut bytes, out, |[k]| [k as i32], i32::to_be_bytes)?;
    }
    write!(out, "\nid 1 {n} int\n")?;
    write_rows(n, &mut bytes, out, |row, bytes| bytes.extend((row as i32).to_be_bytes()))?;
    writeln!(out)
}

pub(super) fn write_xml(head: &Head, grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
    let n = grains.len();
    let le = f64::to_le_bytes;
    let mut file = provenance_file(head, [n, n, 0]);
    file.section("Points", None);
    file.fill::<[f64; 3]>("Points", n, |sink| fill(grains, POSITION, sink, |point| point, le));
    file.section("PointData", Some("diameter"));
    file.fill::<f64>("diameter", n, |sink| fill(grains, [Column::Diameter], sink, |d| d, le));
    if grains.has(Column::A) {
        file.fill::<f64>("sieve", n, |sink| fill(grains, [Column::Sieve], sink, |size| size, le));
        file.fill::<[f64; 3]>("semi_axes", n, |sink| fill(grains, SEMI_AXES, sink, |axes| axes, le));
        file.fill::<[f64; 4]>("orientation", n, |sink| fill(grains, ORIENTATION, sink, |q| q, le));
        file.fill::<[f64; 6]>("tensor", n, |sink| {
            fill(grains, BODY, sink, |body| symmetric(&tensor(body)), le)
        });
    } else {
        file.fill::<f64>("radius", n, |sink| fill(grains, [Column::Diameter], sink, |[d]| [d / 2.0], le));
    }
    let class = classifier(head);
    let size = nominal_size(head, grains);
    file.fill::<i32>("sieve_class", n, move |sink| {
        fill(grains, [size], sink, |[d]| [class(d)], i32::to_le_bytes)
    });
    if grains.has(Column::Aggregate) {
        file.fill::<i32>("aggregate", n, |sink| {
            fill(grains, [Column::Aggregate], sink, |[k]| [k as i32], i32::to_le_bytes)
        });
    }
    file.array("id", n, (0..n).map(|row| row as i32));
    file.section("Verts", None);
    file.array("connectivity", n, (0..n).map(|row| row as i64));
    file.array("offsets", n, (1..=n).map(|end| end as i64));
    file.write(out, &mut |_| Ok(())).map_err(|error| match error {
        ExportError::Write(error) => error,
        other => io::Error::other(other),
    })
}

/// A file of these numbers of points, vertices and polygons that states where it comes from.
pub(super) fn provenance_file<'a>(head: &Head, [points, vertices, polygons]: [usize; 3]) -> VtkXml<'a> {
    let counts = [
        ("NumberOfPoints", points),
        ("NumberOfVerts", vertices),
        ("NumberOfLines", 0),
        ("NumberOfStrips", 0),
        ("NumberOfPolys", polygons),
    ];
    let piece = counts.map(|(name, count)| (name, count.to_string()));
    VtkXml::new("PolyData", &[], &piece, Some(&Provenance::from(head)))
}

/// The tensor of an ellipsoid with this orientation and these semi-axes.
pub(super) fn tensor([w, i, j, k, a, b, c]: [f64; 7]) -> Matrix3<f64> {
    let orientation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
    let rotation = Pose { center_mm: Vector3::zeros(), orientation }.rotation();
    rotation * Matrix3::from_diagonal(&Vector3::new(2.0 * a, 2.0 * b, 2.0 * c)) * rotation.transpose()
}

/// The components of a symmetric tensor in VTK's order.
pub(super) fn symmetric(tensor: &Matrix3<f64>) -> [f64; 6] {
    [tensor.m11, tensor.m22, tensor.m33, tensor.m12, tensor.m23, tensor.m13]
}

/// Fills an array with what the columns of each row become.
fn fill<T: Copy, const N: usize, const M: usize, const BYTES: usize>(
    grains: &dyn GrainSource,
    columns: [Column; N],
    sink: &mut Sink<'_>,
    convert: impl Fn([f64; N]) -> [T; M],
    encode: impl Fn(T) -> [u8; BYTES],
) -> Result<(), ExportError> {
    write_values(grains, columns, &mut Vec::new(), sink, convert, encode).map_err(ExportError::Write)
}

/// The one free line of the legacy form: at most 256 characters, no line break.
pub(super) fn title(head: &Head) -> String {
    let name = head.request.get("name").and_then(|name| name.as_str()).unwrap_or("packing");
    let clean: String = name.chars().filter(|c| c.is_ascii() && !c.is_ascii_control()).take(180).collect();
    format!("{clean} (packstone {})", head.engine.version)
}

pub(super) fn classifier(head: &Head) -> impl Fn(f64) -> i32 + '_ {
    let classes = &head.report.summary.classes;
    move |d| class_of(d, classes.iter().map(|c| c.d_max_mm)) as i32
}

fn write_values<T: Copy, const N: usize, const M: usize, const BYTES: usize>(
    grains: &dyn GrainSource,
    columns: [Column; N],
    bytes: &mut Vec<u8>,
    out: &mut dyn Write,
    convert: impl Fn([f64; N]) -> [T; M],
    encode: impl Fn(T) -> [u8; BYTES],
) -> io::Result<()> {
    for_each_block(grains, columns, |columns| {
        bytes.clear();
        for row in 0..columns[0].len() {
            for value in convert(columns.each(|column| column[row])) {
                bytes.extend(encode(value));
            }
        }
        out.write_all(bytes)
    })
}

fn write_rows(
    n: usize,
    bytes: &mut Vec<u8>,
    out: &mut dyn Write,
    push: impl Fn(usize, &mut Vec<u8>),
) -> io::Result<()> {
    let mut start = 0;
    while start < n {
        let end = n.min(start + BLOCK_ROWS);
        bytes.clear();
        (start..end).for_each(|row| push(row, bytes));
        out.write_all(bytes)?;
        start = end;
    }
    Ok(())
}
