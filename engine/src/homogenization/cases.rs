//! Load cases that are solved: their displacements, which a run that was stopped goes on from.

use std::io::{self, Read, Write};

use super::solve::{Field, zeros};
use crate::memory::OutOfMemory;

/// Numbers that are written at a time.
const BLOCK: usize = 1 << 14;

/// A load case that is solved.
#[derive(Clone, Debug, PartialEq)]
pub struct SolvedCase<const D: usize> {
    pub(super) displacement: Field<D>,
    pub(super) iterations: u64,
    pub(super) error: f64,
}

/// The load cases of a grid and a material that are solved, in their order.
#[derive(Clone, Debug, PartialEq)]
pub struct SolvedCases<const D: usize>(pub(super) Vec<SolvedCase<D>>);

impl<const D: usize> Default for SolvedCases<D> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

/// Why load cases were not read.
#[derive(Debug, thiserror::Error)]
pub enum CaseError {
    /// What is read ends early, or the reader failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The system refused memory.
    #[error(transparent)]
    OutOfMemory(#[from] OutOfMemory),
}

impl<const D: usize> SolvedCases<D> {
    /// How many are solved.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether none is solved.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Writes the cases, little-endian, of each iterations, error, and each component of the displacements.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut bytes = Vec::with_capacity(BLOCK * size_of::<f32>());
        for case in &self.0 {
            out.write_all(&case.iterations.to_le_bytes())?;
            out.write_all(&case.error.to_le_bytes())?;
            for component in &case.displacement {
                for block in component.chunks(BLOCK) {
                    bytes.clear();
                    bytes.extend(block.iter().flat_map(|x| x.to_le_bytes()));
                    out.write_all(&bytes)?;
                }
            }
        }
        Ok(())
    }

    /// Reads this many cases of a grid.
    ///
    /// # Errors
    /// See [`CaseError`].
    pub fn read(input: &mut dyn Read, cases: usize, voxels: usize) -> Result<Self, CaseError> {
        let mut read = Vec::new();
        let mut bytes = vec![0; BLOCK * size_of::<f32>()];
        for _ in 0..cases {
            let mut number = [0; 8];
            input.read_exact(&mut number)?;
            let iterations = u64::from_le_bytes(number);
            input.read_exact(&mut number)?;
            let error = f64::from_le_bytes(number);
            let mut displacement: Field<D> = zeros(voxels)?;
            for block in displacement.iter_mut().flat_map(|component| component.chunks_mut(BLOCK)) {
                let bytes = &mut bytes[..size_of_val(block)];
                input.read_exact(bytes)?;
                let numbers = bytes.as_chunks().0.iter().map(|x| f32::from_le_bytes(*x));
                block.iter_mut().zip(numbers).for_each(|(to, x)| *to = x);
            }
            read.push(SolvedCase { displacement, iterations, error });
        }
        Ok(Self(read))
    }
}
