//! The form in which a result is stored: one file with its head as JSON and its columns as raw f64.
//!
//! Grains do not compress, and every format can be made from columns while streaming. Layout, all little-endian: a
//! magic, `u64` length of the head, `u64` number of rows, the head as JSON padded with spaces to a multiple of 64 from
//! the start of the file, then the columns one after the other. Revision 1 (magic `PACKSTN1`) holds spheres: its
//! columns are x, y, z, d. Revision 2 (magic `PACKSTN2`) names its columns: its head is
//! `{"columns": [names], "head": head}`, and of polyhedra with `"templates": [templates]` between both; a reader that
//! does not know polyhedra refuses their columns.

use std::io::{self, Read, Write};

use serde::{Deserialize, Serialize};

use super::columns::names;
use super::npy::write_columns;
use super::source::no_column;
use super::templates::{self, TemplateRecord};
use super::{Column, EngineInfo, GrainSource, Head};
use crate::arrays;
use crate::shape::Polyhedron;

/// First bytes of a stored result of spheres.
const MAGIC_1: [u8; 8] = *b"PACKSTN1";
/// First bytes of a stored result that names its columns.
const MAGIC_2: [u8; 8] = *b"PACKSTN2";

/// Length of the first bytes that tell a stored result from other files.
pub const MAGIC_BYTES: usize = 8;

/// Magic and two lengths.
const FIXED: usize = 24;
/// Columns start at a multiple of this.
const ALIGNMENT: usize = 64;

/// The first version whose results have this form, major and minor.
const SINCE: (u64, u64) = (0, 2);

/// Whether a file that begins with these bytes is a stored result.
#[must_use]
pub fn is_stored(first: [u8; MAGIC_BYTES]) -> bool {
    first == MAGIC_1 || first == MAGIC_2
}

/// The head of revision 2.
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
        let invalid = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_owned());
        if magic != MAGIC_1 && magic != MAGIC_2 {
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
        let (columns, templates, head) = if magic == MAGIC_1 {
            (Column::OF_SPHERES, Vec::new(), serde_json::from_slice(&text)?)
        } else {
            let Named::<Vec<String>, Vec<TemplateRecord>, Head> { columns, templates, head } =
                serde_json::from_slice(&text)?;
            let known = Column::of_names(&columns);
            let columns = known.ok_or_else(|| invalid("a stored result with unknown columns"))?;
            (columns, templates::read(columns, templates)?, head)
        };
        Ok(Self { head, columns, templates, rows, columns_offset: FIXED as u64 + head_length })
    }

    /// Offset of a row of a column from the start of the file, in bytes.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidInput`] for a column that the result does not have.
    pub fn offset(&self, column: Column, row: u64) -> io::Result<u64> {
        let position = self.columns.iter().position(|own| *own == column).ok_or_else(|| no_column(column))?;
        Ok(self.columns_offset + 8 * (position as u64 * self.rows + row))
    }

    /// Length of the whole file, in bytes.
    pub fn file_length(&self) -> u64 {
        self.columns_offset + 8 * self.columns.len() as u64 * self.rows
    }
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
    /// Those of [`Layout::read`]; `InvalidData` where the bytes are more or fewer than the layout says.
    pub fn read(bytes: &'a [u8]) -> io::Result<Self> {
        let layout = Layout::read(&mut &*bytes)?;
        if layout.file_length() != bytes.len() as u64 {
            let what =
                format!("a stored result of {} bytes: must have {}", bytes.len(), layout.file_length());
            return Err(io::Error::new(io::ErrorKind::InvalidData, what));
        }
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

/// Writes the stored form: revision 1 for spheres, revision 2 for other grains.
///
/// # Errors
/// Those of the writer and of the source.
pub fn write(head: &Head, grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
    let (magic, mut text) = if grains.columns() == Column::OF_SPHERES {
        (MAGIC_1, serde_json::to_vec(head)?)
    } else {
        let templates = templates::records(grains);
        (MAGIC_2, serde_json::to_vec(&Named { columns: names(grains.columns()), templates, head })?)
    };
    let padded = (FIXED + text.len()).next_multiple_of(ALIGNMENT) - FIXED;
    text.resize(padded, b' ');
    out.write_all(&magic)?;
    out.write_all(&(padded as u64).to_le_bytes())?;
    out.write_all(&(grains.len() as u64).to_le_bytes())?;
    out.write_all(&text)?;
    write_columns(grains, out)
}
