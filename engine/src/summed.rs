//! The CRC-32 at the end of a file: of all bytes before it, as `u32`, little-endian.

use std::io::{self, Read, Write};

use crc32fast::Hasher;

/// Length of the sum in bytes.
pub(crate) const SUM_BYTES: usize = 4;

const BUFFER_BYTES: usize = 1 << 16;

/// A writer that sums what passes.
pub(crate) struct Summed<'a> {
    inner: &'a mut dyn Write,
    sum: Hasher,
}

impl<'a> Summed<'a> {
    /// Sums what is written to `inner`.
    pub(crate) fn new(inner: &'a mut dyn Write) -> Self {
        Self { inner, sum: Hasher::new() }
    }

    /// Writes the sum of all that passed.
    ///
    /// # Errors
    /// Those of the writer.
    pub(crate) fn finish(self) -> io::Result<()> {
        self.inner.write_all(&self.sum.finalize().to_le_bytes())
    }
}

impl Write for Summed<'_> {
    fn write(&mut self, block: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(block)?;
        self.sum.update(&block[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

/// Reads to the end; whether the last four bytes are the sum of those before.
///
/// # Errors
/// Those of the reader.
pub(crate) fn ends_with_sum(from: &mut dyn Read) -> io::Result<bool> {
    let (mut sum, mut bytes, mut held) = (Hasher::new(), vec![0; BUFFER_BYTES], 0);
    loop {
        let read = match from.read(&mut bytes[held..]) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            read => read?,
        };
        let filled = held + read;
        if read == 0 {
            return Ok(filled == SUM_BYTES && bytes[..SUM_BYTES] == sum.finalize().to_le_bytes());
        }
        let summed = filled.saturating_sub(SUM_BYTES);
        sum.update(&bytes[..summed]);
        bytes.copy_within(summed..filled, 0);
        held = filled - summed;
    }
}
