//! Allocations of known size that may fail.
//!
//! The standard containers end the process when the system refuses them memory. What a run allocates in proportion to
//! its grains or cells is reserved here first, so that a refusal ends the run and not the process.

/// The system refused an allocation of so many bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct OutOfMemory {
    pub(crate) bytes: u64,
}

/// An empty vector with room for so many elements.
pub(crate) fn reserved<T>(elements: usize) -> Result<Vec<T>, OutOfMemory> {
    let mut vector = Vec::new();
    match vector.try_reserve_exact(elements) {
        Ok(()) => Ok(vector),
        Err(_) => Err(OutOfMemory { bytes: (elements as u64).saturating_mul(size_of::<T>() as u64) }),
    }
}

/// A vector of so many equal elements.
pub(crate) fn filled<T: Clone>(elements: usize, value: T) -> Result<Vec<T>, OutOfMemory> {
    let mut vector = reserved(elements)?;
    vector.resize(elements, value);
    Ok(vector)
}

/// Whether the system grants so many bytes at once; they are given back.
pub(crate) fn probe(bytes: usize) -> Result<(), OutOfMemory> {
    reserved::<u8>(bytes).map(drop)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_refused_allocation_is_an_error_with_its_size() {
        let bytes = (isize::MAX as u64) / 2;
        assert_eq!(probe(bytes as usize), Err(OutOfMemory { bytes }));
        assert_eq!(reserved::<u64>(1 << 60), Err(OutOfMemory { bytes: 8 << 60 }));
        assert_eq!(filled(3, 7).unwrap(), [7, 7, 7]);
    }
}
