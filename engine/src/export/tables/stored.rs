//! The form in which a result is stored: one file with its head as JSON and its columns as raw f64.
//!
//! Spheres do not compress, and every format can be made from columns while streaming. Layout, all
//! little-endian: magic `PACKSTN1`, `u64` length of the head, `u64` number of rows, the head as
//! JSON padded with spaces to a multiple of 64 from the start of the file, then the columns x, y, z, d.

use std::io::{self, Read, Write};

use super::npy::write_columns;
use super::{Column, Head, SphereSource};

/// First bytes of a stored result.
pub const MAGIC: [u8; 8] = *b"PACKSTN1";

/// Magic and two lengths.
const FIXED: usize = 24;
/// Columns start at a multiple of this.
const ALIGNMENT: usize = 64;

/// What a stored result holds and where.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// All but the spheres.
    pub head: Head,
    /// Number of spheres.
    pub rows: u64,
    /// Offset of the first column from the start of the file, in bytes.
    pub columns_offset: u64,
}

impl Layout {
    /// Reads the layout from the start of a stored result.
    ///
    /// # Errors
    /// Those of the reader; `InvalidData` where it is no stored result.
    pub fn read(from: &mut dyn Read) -> io::Result<Self> {
        let mut fixed = [0; FIXED];
        from.read_exact(&mut fixed)?;
        let (magic, lengths) = fixed.split_at(8);
        if magic != MAGIC {
            return Err(io::Error::new(
                io::ErrorKind::InvalidData,
                "not a stored result: its magic is missing",
            ));
        }
        let number = |i: usize| u64::from_le_bytes(std::array::from_fn(|b| lengths[8 * i + b]));
        let (head_length, rows) = (number(0), number(1));
        let mut text = Vec::new();
        from.take(head_length).read_to_end(&mut text)?;
        if text.len() as u64 != head_length {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let head = serde_json::from_slice(&text)?;
        Ok(Self { head, rows, columns_offset: FIXED as u64 + head_length })
    }

    /// Offset of a row of a column from the start of the file, in bytes.
    pub fn offset(&self, column: Column, row: u64) -> u64 {
        self.columns_offset + 8 * (column as u64 * self.rows + row)
    }

    /// Length of the whole file, in bytes.
    pub fn file_length(&self) -> u64 {
        self.columns_offset + 32 * self.rows
    }
}

/// Writes the stored form.
///
/// # Errors
/// Those of the writer and of the source.
pub fn write(head: &Head, spheres: &dyn SphereSource, out: &mut dyn Write) -> io::Result<()> {
    let mut text = serde_json::to_vec(head)?;
    let padded = (FIXED + text.len()).next_multiple_of(ALIGNMENT) - FIXED;
    text.resize(padded, b' ');
    out.write_all(&MAGIC)?;
    out.write_all(&(padded as u64).to_le_bytes())?;
    out.write_all(&(spheres.len() as u64).to_le_bytes())?;
    out.write_all(&text)?;
    write_columns(spheres, out)
}
