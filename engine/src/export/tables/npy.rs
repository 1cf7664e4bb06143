//! NumPy's format 1.0: an array of float64 with one row a grain, in column-major order, which is
//! the order of storage (`numpy.lib.format` in NumPy's documentation).

use std::io::{self, Write};

use super::GrainSource;
use super::source::for_each_block;
use crate::export::npy::header;

pub(super) fn write(grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
    out.write_all(&header("<f8", &[grains.len(), grains.columns().len()]))?;
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
