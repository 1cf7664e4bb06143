//! The form in which a result is stored: one file with its head as JSON and its columns as raw f64.
//!
//! Grains do not compress, and every format can be made from columns while streaming. Layout, all little-endian: the
//! magic `PACKSTN3`, `u64` length of the head, `u64` number of rows, the head as JSON padded with spaces to a multiple
//! of 64 from the start of the file, the columns one after the other, and the CRC-32 of all that came before as `u32`.
//! The head is `{"columns": [names], "head": head}`, and of polyhedra with `"templates": [templates]` between both.
//! Revisions 1 and 2, which had no sum, are refused.

use std::io::{self, Read, Write};

use serde::{Deserialize, Serialize};

use super::columns::names;
use super::npy::write_columns;
use super::source::no_column;
use super::templates::{self, TemplateRecord};
use super::{Column, EngineInfo, GrainSource, Head};
use crate::arrays;
use crate::shape::Polyhedron;
use crate::summed::{SUM_BYTES, Summed, ends_with_sum};

/// First bytes of a stored result.
const MAGIC: [u8; 8] = *b"PACKSTN3";
/// First bytes of the earlier revisions.
const EARLIER: [[u8; 8]; 2] = [*b"PACKSTN1", *b"PACKSTN2"];

/// Length of the first bytes that tell a stored result from other files.
pub const MAGIC_BYTES: usize = 8;

/// Magic and two lengths.
const FIXED: usize = 24;
/// Columns start at a multiple of this.
const ALIGNMENT: usize = 64;

/// The first version whose results have this form, major and minor.
const SINCE: (u64, u64) = (0, 2);
/// The last build that reads the earlier revisions.
const READS_EARLIER: &str = "Packstone 0.2.0 at commit 9f6917b";

/// Whether a file that begins with these bytes is a stored result, of this revision or an earlier one.
#[must_use]
pub fn is_stored(first: [u8; MAGIC_BYTES]) -> bool {
    first == MAGIC || EARLIER.contains(&first)
}

/// Reads a stored result to its end, and makes sure that it is the one that was written.
///
/// # Errors
/// Those of the reader; `InvalidData` where a byte is not what it was.
pub fn verify(from: &mut dyn Read) -> io::Result<()> {
    if ends_with_sum(from)? { Ok(()) } else { Err(damaged()) }
}

fn damaged() -> io::Error {
    invalid("the stored result is damaged: its bytes do not have the sum that stands at its end")
}

fn invalid(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what.to_owned())
}

/// What stands at the place of the head.
#[derive(Serialize, Deserialize)]
struct Named<N, T, H> {
    columns: N,
    #[serde(default = "none", skip_serializing_if = "Option::is_none")]
    templates: Option<T>,
    head: H,
}

fn none<T>() -> Option<T> {
    None
}

/// What a stored result holds and where.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// All but the grains.
    pub head: Head,
    /// The columns in their order.
    pub columns: &'static [Column],
    /// The templates of polyhedra; none of other grains.
    pub templates: Vec<Polyhedron>,
    /// Number of grains.
    pub rows: u64,
    /// Offset of the first column from the start of the file, in bytes.
    pub columns_offset: u64,
}

impl Layout {
    /// Reads the layout from the start of a stored result.
    ///
    /// # Errors
    /// Those of the reader; `InvalidData` where it is no stored result, or a template is no convex polyhedron with an
    /// equivalent diameter of 1.
    pub fn read(from: &mut dyn Read) -> io::Result<Self> {
        let mut fixed = [0; FIXED];
        from.read_exact(&mut fixed)?;
        let (magic, lengths) = fixed.split_at(MAGIC_BYTES);
        if magic != MAGIC && !EARLIER.iter().any(|earlier| magic == earlier) {
            return Err(invalid("not a stored result: its magic is missing"));
        }
        let number = |i: usize| u64::from_le_bytes(arrays::from_fn(|b| lengths[8 * i + b]));
        let (head_length, rows) = (number(0), number(1));
        let mut text = Vec::new();
        from.take(head_length).read_to_end(&mut text)?;
        if text.len() as u64 != head_length {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        if let Some(version) = version_in(&text).filter(|version| is_older(version)) {
            let this = crate::VERSION;
            let what = format!("a result of Packstone {version}, which reads it; this is Packstone {this}");
            return Err(invalid(&what));
        }
        if magic != MAGIC {
            return Err(invalid(&format!("a stored result of an earlier form, which {READS_EARLIER} reads")));
        }
        let Named::<Vec<String>, Vec<TemplateRecord>, Head> { columns, templates, head } =
            serde_json::from_slice(&text)?;
        let known = Column::of_names(&columns);
        let columns = known.ok_or_else(|| invalid("a stored result with unknown columns"))?;
        let templates = templates::read(columns, templates)?;
        let columns_offset = (FIXED as u64)
            .checked_add(head_length)
            .filter(|offset| has_length(*offset, columns.len() as u64, rows))
            .ok_or_else(|| invalid("a stored result whose numbers of bytes and grains no file can have"))?;
        Ok(Self { head, columns, templates, rows, columns_offset })
    }

    /// Offset of a row of a column from the start of the file, in bytes.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidInput`] for a column that the result does not have.
    pub fn offset(&self, column: Column, row: u64) -> io::Result<u64> {
        let position = self.columns.iter().position(|own| *own == column).ok_or_else(|| no_column(column))?;
        Ok(self.columns_offset + 8 * (position as u64 * self.rows + row))
    }

    /// Length of the whole file, in bytes. [`Self::read`] refuses files that have no such length.
    pub fn file_length(&self) -> u64 {
        self.columns_offset + 8 * self.columns.len() as u64 * self.rows + SUM_BYTES as u64
    }
}

/// Whether a file with this many rows of columns behind an offset has a length that can be stated.
fn has_length(offset: u64, columns: u64, rows: u64) -> bool {
    let of_columns = columns.checked_mul(8).and_then(|bytes| bytes.checked_mul(rows));
    of_columns
        .and_then(|bytes| bytes.checked_add(offset)?.checked_add(SUM_BYTES as u64))
        .is_some_and(|length| i64::try_from(length).is_ok())
}

/// The version of the engine in the head of either revision.
fn version_in(head: &[u8]) -> Option<String> {
    #[derive(Deserialize)]
    struct Made {
        engine: EngineInfo,
    }
    #[derive(Deserialize)]
    struct Either {
        engine: Option<EngineInfo>,
        head: Option<Made>,
    }
    let found: Either = serde_json::from_slice(head).ok()?;
    Some(found.engine.or(Some(found.head?.engine))?.version)
}

/// Whether a version made results of an older form.
fn is_older(version: &str) -> bool {
    let mut numbers = version.split('.').map(str::parse::<u64>);
    matches!((numbers.next(), numbers.next()), (Some(Ok(major)), Some(Ok(minor))) if (major, minor) < SINCE)
}

/// A stored result in memory.
#[derive(Debug)]
pub struct StoredBytes<'a> {
    layout: Layout,
    bytes: &'a [u8],
}

impl<'a> StoredBytes<'a> {
    /// Reads the layout of a whole stored result.
    ///
    /// # Errors
    /// Those of [`Layout::read`] and [`verify`]; `InvalidData` where the bytes are more or fewer than the layout says.
    pub fn read(bytes: &'a [u8]) -> io::Result<Self> {
        let layout = Layout::read(&mut &*bytes)?;
        if layout.file_length() != bytes.len() as u64 {
            let what =
                format!("a stored result of {} bytes: must have {}", bytes.len(), layout.file_length());
            return Err(io::Error::new(io::ErrorKind::InvalidData, what));
        }
        verify(&mut &*bytes)?;
        Ok(Self { layout, bytes })
    }

    /// All but the grains.
    pub fn into_head(self) -> Head {
        self.layout.head
    }
}

impl GrainSource for StoredBytes<'_> {
    fn len(&self) -> usize {
        self.layout.rows as usize
    }

    fn columns(&self) -> &'static [Column] {
        self.layout.columns
    }

    fn templates(&self) -> &[Polyhedron] {
        &self.layout.templates
    }

    fn read(&self, column: Column, start: usize, block: &mut [f64]) -> io::Result<()> {
        let from = self.layout.offset(column, start as u64)? as usize;
        let bytes = self.bytes.get(from..from + 8 * block.len()).ok_or(io::ErrorKind::UnexpectedEof)?;
        for (value, eight) in block.iter_mut().zip(bytes.chunks_exact(8)) {
            *value = f64::from_le_bytes(arrays::from_fn(|byte| eight[byte]));
        }
        Ok(())
    }
}

/// Writes the stored form.
///
/// # Errors
/// Those of the writer and of the source.
pub fn write(head: &Head, grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
    let templates = templates::records(grains);
    let mut text = serde_json::to_vec(&Named { columns: names(grains.columns()), templates, head })?;
    let padded = (FIXED + text.len()).next_multiple_of(ALIGNMENT) - FIXED;
    text.resize(padded, b' ');
    let mut out = Summed::new(out);
    out.write_all(&MAGIC)?;
    out.write_all(&(padded as u64).to_le_bytes())?;
    out.write_all(&(grains.len() as u64).to_le_bytes())?;
    out.write_all(&text)?;
    write_columns(grains, &mut out)?;
    out.finish()
}
