//! The encoding of a checkpoint's body: numbers as little-endian bytes, counts before what they count.
//!
//! Every number is kept to the last bit, so that the run goes on as if it had never stopped.

use std::io::{self, Read, Write};

use crate::memory::reserved;

/// Writes numbers.
pub(crate) struct Encoder<'a>(pub(crate) &'a mut dyn Write);

impl Encoder<'_> {
    pub(crate) fn u64(&mut self, value: u64) -> io::Result<()> {
        self.0.write_all(&value.to_le_bytes())
    }

    pub(crate) fn f64(&mut self, value: f64) -> io::Result<()> {
        self.0.write_all(&value.to_le_bytes())
    }

    pub(crate) fn f64s(&mut self, values: impl ExactSizeIterator<Item = f64>) -> io::Result<()> {
        self.u64(values.len() as u64)?;
        values.into_iter().try_for_each(|value| self.f64(value))
    }

    pub(crate) fn u32s(&mut self, values: impl ExactSizeIterator<Item = u32>) -> io::Result<()> {
        self.u64(values.len() as u64)?;
        values.into_iter().try_for_each(|value| self.0.write_all(&value.to_le_bytes()))
    }
}

/// Reads them back; an end that comes too early is an error.
pub(crate) struct Decoder<'a>(pub(crate) &'a [u8]);

impl Decoder<'_> {
    fn bytes<const N: usize>(&mut self) -> io::Result<[u8; N]> {
        let mut bytes = [0; N];
        self.0.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    pub(crate) fn u64(&mut self) -> io::Result<u64> {
        self.bytes().map(u64::from_le_bytes)
    }

    /// A finite number: nothing in a run is anything else.
    pub(crate) fn f64(&mut self) -> io::Result<f64> {
        let value = f64::from_le_bytes(self.bytes()?);
        if value.is_finite() { Ok(value) } else { Err(io::ErrorKind::InvalidData.into()) }
    }

    /// A count of things of `bytes_each` bytes, no more than there can be.
    fn count(&mut self, bytes_each: usize) -> io::Result<usize> {
        let count = self.u64()?;
        if count > (self.0.len() / bytes_each) as u64 {
            return Err(io::ErrorKind::InvalidData.into());
        }
        Ok(count as usize)
    }

    pub(crate) fn f64s(&mut self) -> io::Result<Vec<f64>> {
        let count = self.count(8)?;
        let mut values = reserved(count)?;
        for _ in 0..count {
            values.push(self.f64()?);
        }
        Ok(values)
    }

    pub(crate) fn u32s(&mut self) -> io::Result<Vec<u32>> {
        let count = self.count(4)?;
        let mut values = reserved(count)?;
        for _ in 0..count {
            values.push(u32::from_le_bytes(self.bytes()?));
        }
        Ok(values)
    }

    /// Fails unless everything was read.
    pub(crate) fn finish(self) -> io::Result<()> {
        if self.0.is_empty() { Ok(()) } else { Err(io::ErrorKind::InvalidData.into()) }
    }
}
