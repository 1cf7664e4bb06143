//! NumPy's format 1.0: an array of float64 with one row a grain, in column-major order, which is
//! the order of storage (`numpy.lib.format` in NumPy's documentation).

use std::io::{self, Write};

use super::GrainSource;
use super::source::for_each_block;

pub(super) fn write(grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
    let shape = (grains.len(), grains.columns().len());
    let mut header = format!("{{'descr': '<f8', 'fortran_order': True, 'shape': {shape:?}, }}");
    // Magic, version and length take 10 bytes; the data start at a multiple of 64, after a newline.
    let padded = (10 + header.len() + 1).next_multiple_of(64) - 10;
    header.extend(std::iter::repeat_n(' ', padded - 1 - header.len()));
    header.push('\n');
    out.write_all(b"\x93NUMPY\x01\x00")?;
    out.write_all(&(padded as u16).to_le_bytes())?;
    out.write_all(header.as_bytes())?;
    write_columns(grains, out)
}

/// All columns as raw little-endian float64, one after the other.
pub(super) fn write_columns(grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
    let mut bytes = Vec::new();
    for column in grains.columns() {
        for_each_block(grains, [*column], |[values]| {
            bytes.clear();
            bytes.extend(values.iter().flat_map(|x| x.to_le_bytes()));
            out.write_all(&bytes)
        })?;
    }
    Ok(())
}
