//! The form in which a result is stored: one file with its head as JSON and its columns as raw f64.
//!
//! Spheres do not compress, and every format can be made from columns while streaming. Layout, all
//! little-endian: magic `PACKSTN1`, `u64` length of the head, `u64` number of rows, the head as
//! JSON padded with spaces to a multiple of 64 from the start of the file, then the columns x, y, z, d.

use std::io::{self, Read, Write};

use super::{Column, Head, SphereSource};

/// First bytes of a stored result.
pub const MAGIC: [u8; 8] = *b"PACKSTN1";

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
        let _ = from;
        unimplemented!()
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
    let _ = (head, spheres, out);
    unimplemented!()
}
