//! The text formats: JSON and CSV. Floats are written so that they read back exactly.

use std::io::{self, Write};

use super::{Column, Head, SphereSource, for_each_block};

/// Names of the columns, in the order of [`Column::ALL`].
const COLUMNS: [&str; 4] = ["x_mm", "y_mm", "z_mm", "d_mm"];

pub(super) fn write_csv(spheres: &dyn SphereSource, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "{}", COLUMNS.join(","))?;
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
pub(super) fn write_json(head: &Head, spheres: SphereTable<'_>, out: &mut dyn Write) -> io::Result<()> {
    let mut text = serde_json::to_vec(head)?;
    // The object is opened again for the spheres, which would not fit into memory as a value.
    text.pop();
    text.extend_from_slice(br#","spheres":"#);
    out.write_all(&text)?;
    spheres.write(out)?;
    out.write_all(b"}\n")
}

/// The grains of a result as one JSON object: the names of the columns, and one row a grain.
#[derive(Clone, Copy)]
pub struct SphereTable<'a>(pub &'a dyn SphereSource);

impl SphereTable<'_> {
    /// Writes the object.
    ///
    /// # Errors
    /// Those of the writer and of the source.
    pub fn write(self, out: &mut dyn Write) -> io::Result<()> {
        write!(out, "{{\"columns\":{},\"rows\":[", serde_json::to_string(&COLUMNS)?)?;
        let (mut text, mut first) = (Vec::new(), true);
        for_each_block(self.0, Column::ALL, |columns| {
            text.clear();
            for row in 0..columns[0].len() {
                text.extend_from_slice(if first { b"\n[" } else { b",\n[" });
                first = false;
                push_row(&mut text, columns, row);
                text.push(b']');
            }
            out.write_all(&text)
        })?;
        out.write_all(b"\n]}")
    }
}

#[cfg(feature = "openapi")]
impl utoipa::PartialSchema for SphereTable<'_> {
    fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::Schema> {
        let about = "The grains of a result, largest first; the row number is the grain's id.";
        utoipa::openapi::Schema::from(crate::export::schema::table(about, &COLUMNS, "One row a grain."))
            .into()
    }
}

#[cfg(feature = "openapi")]
impl utoipa::ToSchema for SphereTable<'_> {
    fn name() -> std::borrow::Cow<'static, str> {
        "SphereTable".into()
    }
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
