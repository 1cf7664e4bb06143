//! Tables of text that are no results: one line a row as CSV, or an object with `columns` and `rows` as JSON.

use std::fmt::Write as _;
use std::io::{self, BufWriter, Write};

use serde::{Deserialize, Serialize};

use crate::request::decode::Object;

/// File formats of tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum TableFormat {
    /// One line a row, with the names of the columns first.
    Csv,
    /// An object with `columns` and `rows`.
    Json,
}

impl TableFormat {
    /// All formats, the default first.
    pub const ALL: [Self; 2] = [Self::Csv, Self::Json];

    /// Reads the option `format`, CSV where it is missing; `None` means that a fault was reported.
    pub(super) fn read(object: &mut Object<'_>) -> Option<Self> {
        match object.optional("format") {
            Some(at) => at.choice(&Self::ALL.map(|format| (format.name(), format))),
            None => Some(Self::Csv),
        }
    }

    /// Name of the format, and file extension.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Json => "json",
        }
    }

    /// Media type without parameters.
    #[must_use]
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Csv => "text/csv",
            Self::Json => "application/json",
        }
    }
}

/// A value of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Cell {
    /// A number, with as many digits as tell it from all others.
    Number(f64),
    /// A whole number.
    Whole(i64),
    /// A word without characters that need an escape.
    Word(&'static str),
    /// No value: empty in CSV, `null` in JSON.
    None,
}

impl Cell {
    fn write(self, format: TableFormat, line: &mut String) {
        // Writing to a string cannot fail.
        let _ = match (self, format) {
            (Self::Number(x), _) => write!(line, "{x:?}"),
            (Self::Whole(i), _) => write!(line, "{i}"),
            (Self::Word(word), TableFormat::Csv) => write!(line, "{word}"),
            (Self::Word(word), TableFormat::Json) => write!(line, "\"{word}\""),
            (Self::None, TableFormat::Csv) => Ok(()),
            (Self::None, TableFormat::Json) => write!(line, "null"),
        };
    }
}

/// A table that is being written.
pub(super) struct Rows<'a> {
    out: BufWriter<&'a mut dyn Write>,
    format: TableFormat,
    written: usize,
    line: String,
}

impl<'a> Rows<'a> {
    /// Writes what comes before the rows. `head` are members of the object of JSON that come before `columns`.
    pub(super) fn begin(
        out: &'a mut dyn Write,
        format: TableFormat,
        columns: &[&str],
        head: &[(&str, f64)],
    ) -> io::Result<Self> {
        let mut out = BufWriter::with_capacity(1 << 16, out);
        match format {
            TableFormat::Csv => writeln!(out, "{}", columns.join(","))?,
            TableFormat::Json => {
                write!(out, "{{")?;
                for (name, value) in head {
                    write!(out, "\"{name}\":{value:?},")?;
                }
                write!(out, "\"columns\":[\"{}\"],\"rows\":[", columns.join("\",\""))?;
            }
        }
        Ok(Self { out, format, written: 0, line: String::new() })
    }

    /// Writes a row.
    pub(super) fn row(&mut self, cells: &[Cell]) -> io::Result<()> {
        self.line.clear();
        for (i, cell) in cells.iter().enumerate() {
            if i > 0 {
                self.line.push(',');
            }
            cell.write(self.format, &mut self.line);
        }
        let line = &self.line;
        match self.format {
            TableFormat::Csv => writeln!(self.out, "{line}")?,
            TableFormat::Json => write!(self.out, "{}\n[{line}]", if self.written > 0 { "," } else { "" })?,
        }
        self.written += 1;
        Ok(())
    }

    /// Writes what comes after the rows.
    pub(super) fn end(mut self) -> io::Result<()> {
        if self.format == TableFormat::Json {
            self.out.write_all(b"\n]}\n")?;
        }
        self.out.flush()
    }
}
