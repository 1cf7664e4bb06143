//! The VTK forms: points with arrays for a sphere glyph, legacy (big-endian) and XML (raw appended). The XML form has
//! field data too: job ID, name, version of the engine, seed and volume fractions.
//!
//! Arrays: `diameter` and `radius` (float64, mm), `sieve_class` (int32, counted from fine to coarse
//! in the order of the summary's classes), `id` (int32, the row in the other formats).

use std::io::{self, Write};

use super::{Column, Head, SphereSource, for_each_block};
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
    // Every block of the appended data: its length in 8 bytes, then its bytes.
    let sizes = [24 * n, 8 * n, 8 * n, 4 * n, 4 * n, 8 * n, 8 * n];
    let mut offsets = [0; 7];
    for i in 1..7 {
        offsets[i] = offsets[i - 1] + 8 + sizes[i - 1];
    }
    let [points, diameter, radius, class, id, connectivity, ends] = offsets;
    let fields = field_data(head);
    write!(
        out,
        r#"<?xml version="1.0"?>
<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">
  <PolyData>
{fields}    <Piece NumberOfPoints="{n}" NumberOfVerts="{n}" NumberOfLines="0" NumberOfStrips="0" NumberOfPolys="0">
      <Points>
        <DataArray type="Float64" Name="Points" NumberOfComponents="3" format="appended" offset="{points}"/>
      </Points>
      <PointData Scalars="diameter">
        <DataArray type="Float64" Name="diameter" format="appended" offset="{diameter}"/>
        <DataArray type="Float64" Name="radius" format="appended" offset="{radius}"/>
        <DataArray type="Int32" Name="sieve_class" format="appended" offset="{class}"/>
        <DataArray type="Int32" Name="id" format="appended" offset="{id}"/>
      </PointData>
      <Verts>
        <DataArray type="Int64" Name="connectivity" format="appended" offset="{connectivity}"/>
        <DataArray type="Int64" Name="offsets" format="appended" offset="{ends}"/>
      </Verts>
    </Piece>
  </PolyData>
  <AppendedData encoding="raw">
   _"#
    )?;
    let mut bytes = Vec::new();
    let mut sizes = sizes.into_iter();
    let mut next_size = |out: &mut dyn Write| {
        let size = sizes.next().unwrap_or_default() as u64;
        out.write_all(&size.to_le_bytes())
    };
    next_size(out)?;
    write_points(spheres, &mut bytes, out, f64::to_le_bytes)?;
    next_size(out)?;
    write_diameters(spheres, &mut bytes, out, |d, bytes| bytes.extend(d.to_le_bytes()))?;
    next_size(out)?;
    write_diameters(spheres, &mut bytes, out, |d, bytes| bytes.extend((d / 2.0).to_le_bytes()))?;
    next_size(out)?;
    let class_of = classifier(head);
    write_diameters(spheres, &mut bytes, out, |d, bytes| bytes.extend(class_of(d).to_le_bytes()))?;
    next_size(out)?;
    write_rows(n, &mut bytes, out, |row, bytes| bytes.extend((row as i32).to_le_bytes()))?;
    next_size(out)?;
    write_rows(n, &mut bytes, out, |row, bytes| bytes.extend((row as i64).to_le_bytes()))?;
    next_size(out)?;
    write_rows(n, &mut bytes, out, |row, bytes| bytes.extend((row as i64 + 1).to_le_bytes()))?;
    out.write_all(b"\n  </AppendedData>\n</VTKFile>\n")
}

/// What is known about the packing as VTK field data: arrays of text (the codes of its characters) and of numbers.
fn field_data(head: &Head) -> String {
    let summary = &head.report.summary;
    let mut lines = vec!["    <FieldData>\n".to_owned()];
    let texts = [
        ("job_id", head.job_id.as_deref()),
        ("name", head.request.get("name").and_then(|name| name.as_str())),
        ("engine_version", Some(head.engine.version.as_str())),
    ];
    for (name, text) in texts {
        let Some(text) = text else { continue };
        let codes: Vec<String> = text.bytes().map(|byte| byte.to_string()).collect();
        lines.push(format!(
            "      <DataArray type=\"String\" Name=\"{name}\" NumberOfTuples=\"1\" format=\"ascii\">{} 0</DataArray>\n",
            codes.join(" ")
        ));
    }
    let seed = head.request.get("seed").and_then(serde_json::Value::as_u64);
    let seed = seed.map(|seed| ("seed", "UInt64", seed.to_string()));
    let fractions = [
        ("volume_fraction_mixture", "Float64", summary.volume_fraction_mixture.to_string()),
        ("volume_fraction_effective", "Float64", summary.volume_fraction_effective.to_string()),
    ];
    for (name, kind, value) in seed.into_iter().chain(fractions) {
        lines.push(format!(
            "      <DataArray type=\"{kind}\" Name=\"{name}\" NumberOfTuples=\"1\" format=\"ascii\">{value}</DataArray>\n"
        ));
    }
    lines.push("    </FieldData>\n".to_owned());
    lines.concat()
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
