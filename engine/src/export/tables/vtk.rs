//! The VTK forms: points with arrays for a sphere glyph, legacy (big-endian) and XML (raw appended). The XML form has
//! field data too: job ID, name, version of the engine, seed and volume fractions.
//!
//! Arrays: `diameter` and `radius` (float64, mm), `sieve_class` (int32, counted from fine to coarse
//! in the order of the summary's classes), `id` (int32, the row in the other formats).

use std::io::{self, Write};

use super::{Column, Head, SphereSource, for_each_block};
use crate::export::vtk_xml::{Sink, VtkXml};
use crate::export::{ExportError, Provenance};
use crate::mix::sieve::class_of;

const POSITION: [Column; 3] = [Column::X, Column::Y, Column::Z];

pub(super) fn write_legacy(head: &Head, spheres: &dyn SphereSource, out: &mut dyn Write) -> io::Result<()> {
    let n = spheres.len();
    write!(out, "# vtk DataFile Version 3.0\n{}\nBINARY\nDATASET POLYDATA\n", title(head))?;
    writeln!(out, "POINTS {n} double")?;
    let mut bytes = Vec::new();
    write_points(spheres, &mut bytes, out, f64::to_be_bytes)?;
    writeln!(out, "\nVERTICES {n} {}", 2 * n)?;
    write_rows(n, &mut bytes, out, |row, bytes| {
        bytes.extend(1_i32.to_be_bytes());
        bytes.extend((row as i32).to_be_bytes());
    })?;
    writeln!(out, "\nPOINT_DATA {n}")?;
    writeln!(out, "SCALARS diameter double 1\nLOOKUP_TABLE default")?;
    write_diameters(spheres, &mut bytes, out, |d, bytes| bytes.extend(d.to_be_bytes()))?;
    // Readers keep one array of scalars only, but all of a field.
    write!(out, "\nFIELD arrays 3\nradius 1 {n} double\n")?;
    write_diameters(spheres, &mut bytes, out, |d, bytes| bytes.extend((d / 2.0).to_be_bytes()))?;
    write!(out, "\nsieve_class 1 {n} int\n")?;
    let class = classifier(head);
    write_diameters(spheres, &mut bytes, out, |d, bytes| bytes.extend(class(d).to_be_bytes()))?;
    write!(out, "\nid 1 {n} int\n")?;
    write_rows(n, &mut bytes, out, |row, bytes| bytes.extend((row as i32).to_be_bytes()))?;
    writeln!(out)
}

pub(super) fn write_xml(head: &Head, spheres: &dyn SphereSource, out: &mut dyn Write) -> io::Result<()> {
    let n = spheres.len();
    let counts = [
        ("NumberOfPoints", n),
        ("NumberOfVerts", n),
        ("NumberOfLines", 0),
        ("NumberOfStrips", 0),
        ("NumberOfPolys", 0),
    ];
    let piece = counts.map(|(name, count)| (name, count.to_string()));
    let mut file = VtkXml::new("PolyData", &[], &piece, Some(&Provenance::from(head)));
    file.section("Points", None);
    file.fill::<[f64; 3]>("Points", n, |sink| {
        write_points(spheres, &mut Vec::new(), sink, f64::to_le_bytes).map_err(ExportError::Write)
    });
    file.section("PointData", Some("diameter"));
    file.fill::<f64>("diameter", n, |sink| fill_diameters(spheres, sink, f64::to_le_bytes));
    file.fill::<f64>("radius", n, |sink| fill_diameters(spheres, sink, |d| (d / 2.0).to_le_bytes()));
    let class = classifier(head);
    file.fill::<i32>("sieve_class", n, move |sink| fill_diameters(spheres, sink, |d| class(d).to_le_bytes()));
    file.array("id", n, (0..n).map(|row| row as i32));
    file.section("Verts", None);
    file.array("connectivity", n, (0..n).map(|row| row as i64));
    file.array("offsets", n, (1..=n).map(|end| end as i64));
    file.write(out, &mut |_| Ok(())).map_err(|error| match error {
        ExportError::Write(error) => error,
        other => io::Error::other(other),
    })
}

/// Fills an array with what each diameter becomes.
fn fill_diameters<const BYTES: usize>(
    spheres: &dyn SphereSource,
    sink: &mut Sink<'_>,
    encode: impl Fn(f64) -> [u8; BYTES],
) -> Result<(), ExportError> {
    let written = write_diameters(spheres, &mut Vec::new(), sink, |d, bytes| bytes.extend(encode(d)));
    written.map_err(ExportError::Write)
}

/// The one free line of the legacy form: at most 256 characters, no line break.
fn title(head: &Head) -> String {
    let name = head.request.get("name").and_then(|name| name.as_str()).unwrap_or("packing");
    let clean: String = name.chars().filter(|c| c.is_ascii() && !c.is_ascii_control()).take(180).collect();
    format!("{clean} (packstone {})", head.engine.version)
}

fn classifier(head: &Head) -> impl Fn(f64) -> i32 + '_ {
    let classes = &head.report.summary.classes;
    move |d| class_of(d, classes.iter().map(|c| c.d_max_mm)) as i32
}

fn write_points(
    spheres: &dyn SphereSource,
    bytes: &mut Vec<u8>,
    out: &mut dyn Write,
    encode: fn(f64) -> [u8; 8],
) -> io::Result<()> {
    for_each_block(spheres, POSITION, |[x, y, z]| {
        bytes.clear();
        for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
            bytes.extend([x, y, z].map(encode).as_flattened());
        }
        out.write_all(bytes)
    })
}

fn write_diameters(
    spheres: &dyn SphereSource,
    bytes: &mut Vec<u8>,
    out: &mut dyn Write,
    push: impl Fn(f64, &mut Vec<u8>),
) -> io::Result<()> {
    for_each_block(spheres, [Column::Diameter], |[d]| {
        bytes.clear();
        for &d in d {
            push(d, bytes);
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
        let end = n.min(start + super::BLOCK_ROWS);
        bytes.clear();
        (start..end).for_each(|row| push(row, bytes));
        out.write_all(bytes)?;
        start = end;
    }
    Ok(())
}
