//! The text formats: JSON and CSV. Floats are written so that they read back exactly.

use std::io::{self, Write};

use super::Column;
use super::columns::names;
use super::source::for_each_rows;
use super::{GrainSource, Head, templates};

pub(super) fn write_csv(grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "{}", names(grains.columns()).join(","))?;
    let mut text = Vec::new();
    for_each_rows(grains, grains.columns(), &mut |values| {
        text.clear();
        for row in 0..values[0].len() {
            push_row(&mut text, grains.columns(), values, row);
            text.push(b'\n');
        }
        out.write_all(&text)
    })
}

/// The head's fields, then the templates of polyhedra, then the grains as the last field of the same object.
pub(super) fn write_json(head: &Head, grains: GrainTable<'_>, out: &mut dyn Write) -> io::Result<()> {
    let mut text = serde_json::to_vec(head)?;
    // The object is opened again for the grains, which would not fit into memory as a value.
    text.pop();
    if let Some(templates) = templates::records(grains.0) {
        text.extend_from_slice(br#","templates":"#);
        serde_json::to_writer(&mut text, &templates)?;
    }
    text.extend_from_slice(br#","grains":"#);
    out.write_all(&text)?;
    grains.write(out)?;
    out.write_all(b"}\n")
}

/// The grains of a result as one JSON object: the names of the columns, and one row a grain.
#[derive(Clone, Copy)]
pub struct GrainTable<'a>(pub &'a dyn GrainSource);

impl GrainTable<'_> {
    /// Writes the object.
    ///
    /// # Errors
    /// Those of the writer and of the source.
    pub fn write(self, out: &mut dyn Write) -> io::Result<()> {
        write!(out, "{{\"columns\":{},\"rows\":[", serde_json::to_string(&names(self.0.columns()))?)?;
        let (mut text, mut first) = (Vec::new(), true);
        let columns = self.0.columns();
        for_each_rows(self.0, columns, &mut |values| {
            text.clear();
            for row in 0..values[0].len() {
                text.extend_from_slice(if first { b"\n[" } else { b",\n[" });
                first = false;
                push_row(&mut text, columns, values, row);
                text.push(b']');
            }
            out.write_all(&text)
        })?;
        out.write_all(b"\n]}")
    }
}

#[cfg(feature = "openapi")]
impl utoipa::PartialSchema for GrainTable<'_> {
    fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::Schema> {
        let mut tables = utoipa::openapi::OneOfBuilder::new();
        for (about, plain, with_aggregate) in Column::TABLES {
            let table = |about: &str, columns: &[Column]| {
                crate::export::schema::table(about, &names(columns), "One row a grain.")
            };
            tables = tables.item(table(about, plain));
            let about = format!("{about} Last the aggregate of the request, counted from 0.");
            tables = tables.item(table(&about, with_aggregate));
        }
        utoipa::openapi::Schema::from(
            tables
                .description(Some("The grains of a result, largest first; the row number is the grain's id."))
                .build(),
        )
        .into()
    }
}

#[cfg(feature = "openapi")]
impl utoipa::ToSchema for GrainTable<'_> {
    fn name() -> std::borrow::Cow<'static, str> {
        "GrainTable".into()
    }
}

/// Appends a row of these columns; what counts something is written without a fraction.
fn push_row(text: &mut Vec<u8>, columns: &[Column], values: &[&[f64]], row: usize) {
    let mut digits = zmij::Buffer::new();
    for (i, (column, values)) in columns.iter().zip(values).enumerate() {
        if i > 0 {
            text.push(b',');
        }
        let number = digits.format_finite(values[row]);
        let number = if column.is_index() { number.strip_suffix(".0").unwrap_or(number) } else { number };
        text.extend_from_slice(number.as_bytes());
    }
}
