//! The text formats: JSON and CSV. Floats are written so that they read back exactly.

use std::io::{self, Write};

use super::{Column, Head, SphereSource, for_each_block};

pub(super) fn write_csv(spheres: &dyn SphereSource, out: &mut dyn Write) -> io::Result<()> {
    out.write_all(b"x_mm,y_mm,z_mm,d_mm\n")?;
    let mut text = Vec::new();
    for_each_block(spheres, Column::ALL, |columns| {
        text.clear();
        for row in 0..columns[0].len() {
            push_row(&mut text, columns, row);
            text.push(b'\n');
        }
        out.write_all(&text)
    })
}

/// The head's fields, then the spheres as the last field of the same object.
pub(super) fn write_json(head: &Head, spheres: &dyn SphereSource, out: &mut dyn Write) -> io::Result<()> {
    let mut text = serde_json::to_vec(head)?;
    // The object is opened again for the spheres, which would not fit into memory as a value.
    text.pop();
    text.extend_from_slice(br#","spheres":{"columns":["x_mm","y_mm","z_mm","d_mm"],"rows":["#);
    out.write_all(&text)?;
    let mut first = true;
    for_each_block(spheres, Column::ALL, |columns| {
        text.clear();
        for row in 0..columns[0].len() {
            text.extend_from_slice(if first { b"\n[" } else { b",\n[" });
            first = false;
            push_row(&mut text, columns, row);
            text.push(b']');
        }
        out.write_all(&text)
    })?;
    out.write_all(b"\n]}}\n")
}

fn push_row(text: &mut Vec<u8>, columns: [&[f64]; 4], row: usize) {
    let mut digits = zmij::Buffer::new();
    for (i, column) in columns.iter().enumerate() {
        if i > 0 {
            text.push(b',');
        }
        text.extend_from_slice(digits.format_finite(column[row]).as_bytes());
    }
}
