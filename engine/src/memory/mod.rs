//! Allocations of known size that may fail.
//!
//! The standard containers end the process when the system refuses them memory. What a run allocates in proportion to
//! its grains or cells is reserved here first, so that a refusal ends the run and not the process. Large blocks are
//! asked for as huge pages ([`pages`]). A reservation fails unless [`LEFT_BYTES`] stay free, so that small allocations
//! that cannot fail, as of a line of text, still succeed.

mod blocks;
mod pages;

pub(crate) use blocks::Blocks;

/// Bytes that must stay free after a large allocation.
const LEFT_BYTES: usize = 1 << 20;
/// Smaller blocks are allocated without a test of what they leave.
const LOOK_BYTES: usize = 1 << 16;

/// The system refused an allocation of so many bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the system refused {bytes} bytes of memory")]
pub struct OutOfMemory {
    /// Size of the allocation.
    pub bytes: u64,
}

impl From<OutOfMemory> for std::io::Error {
    fn from(_: OutOfMemory) -> Self {
        std::io::ErrorKind::OutOfMemory.into()
    }
}

/// Whether the system, which has granted a block of so many bytes, grants more.
fn leaves_enough(bytes: usize) -> bool {
    bytes < LOOK_BYTES || Vec::<u8>::new().try_reserve_exact(LEFT_BYTES).is_ok()
}

/// An empty vector with room for so many elements.
pub(crate) fn reserved<T>(elements: usize) -> Result<Vec<T>, OutOfMemory> {
    let mut vector = Vec::new();
    let bytes = elements.saturating_mul(size_of::<T>());
    if vector.try_reserve_exact(elements).is_err() || !leaves_enough(bytes) {
        return Err(OutOfMemory { bytes: bytes as u64 });
    }
    pages::advise(&mut vector);
    Ok(vector)
}

/// A vector of so many equal elements.
pub(crate) fn filled<T: Clone>(elements: usize, value: T) -> Result<Vec<T>, OutOfMemory> {
    let mut vector = reserved(elements)?;
    vector.resize(elements, value);
    Ok(vector)
}

/// The elements of an iterator whose length is known.
pub(crate) fn collected<T>(elements: impl ExactSizeIterator<Item = T>) -> Result<Vec<T>, OutOfMemory> {
    let mut vector = reserved(elements.len())?;
    vector.extend(elements);
    Ok(vector)
}

/// A copy of a slice.
pub(crate) fn copied<T: Copy>(elements: &[T]) -> Result<Vec<T>, OutOfMemory> {
    collected(elements.iter().copied())
}

/// Gives a vector that is used again so many equal elements. One that is too small is given back first: it would be
/// copied, and the new one made twice as long.
pub(crate) fn refill<T: Clone>(vector: &mut Vec<T>, elements: usize, value: T) -> Result<(), OutOfMemory> {
    vector.clear();
    if vector.capacity() < elements {
        *vector = Vec::new();
        *vector = reserved(elements)?;
    }
    vector.resize(elements, value);
    Ok(())
}

/// Room for so many more elements, with some to spare as the vector grows.
pub(crate) fn make_room<T>(vector: &mut Vec<T>, more: usize) -> Result<(), OutOfMemory> {
    let bytes = vector.len().saturating_add(more).saturating_mul(size_of::<T>());
    let before = vector.capacity();
    let granted = vector.try_reserve(more).is_ok();
    if !granted || (vector.capacity() != before && !leaves_enough(bytes)) {
        return Err(OutOfMemory { bytes: bytes as u64 });
    }
    if vector.capacity() != before {
        pages::advise(vector);
    }
    Ok(())
}

/// Appends an element. Where the system refuses memory for more, it is left out and the refusal is noted.
#[inline]
pub(crate) fn push<T>(vector: &mut Vec<T>, element: T, refused: &mut Option<OutOfMemory>) {
    if vector.len() == vector.capacity()
        && let Err(error) = make_room(vector, 1)
    {
        *refused = Some(error);
        return;
    }
    vector.push(element);
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
        assert_eq!(make_room(&mut vec![0_u64; 2], 1 << 60), Err(OutOfMemory { bytes: (8 << 60) + 16 }));
        let mut used = vec![1, 2];
        assert_eq!(refill(&mut used, 1 << 61, 7), Err(OutOfMemory { bytes: 4 << 61 }));
        refill(&mut used, 3, 7).unwrap();
        assert_eq!((used, copied(&[1, 2]).unwrap()), (vec![7, 7, 7], vec![1, 2]));
    }
}
