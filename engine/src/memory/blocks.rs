//! Lists in blocks.

use super::{OutOfMemory, make_room, reserved};

/// Smaller than the size from which an allocation is tested, so that no test is made for each block.
const BLOCK_BYTES: usize = 1 << 15;

/// A list in blocks that are not copied as it grows. They find room between larger blocks that stay, where a vector of
/// the whole list would need room of its own.
#[derive(Clone, Debug)]
pub(crate) struct Blocks<T> {
    blocks: Vec<Vec<T>>,
    len: usize,
}

impl<T> Default for Blocks<T> {
    fn default() -> Self {
        Self { blocks: Vec::new(), len: 0 }
    }
}

impl<T> Blocks<T> {
    /// Elements of a block.
    const EACH: usize = BLOCK_BYTES / size_of::<T>();

    /// An empty list with room for so many elements.
    pub(crate) fn reserved(elements: usize) -> Result<Self, OutOfMemory> {
        let mut list = Self { blocks: reserved(elements.div_ceil(Self::EACH))?, len: 0 };
        for _ in 0..elements.div_ceil(Self::EACH) {
            list.blocks.push(reserved(Self::EACH)?);
        }
        Ok(list)
    }

    /// Appends an element. Where the system refuses memory for more, it is left out and the refusal is noted.
    #[inline]
    pub(crate) fn push(&mut self, element: T, refused: &mut Option<OutOfMemory>) {
        if self.len == self.blocks.len() * Self::EACH
            && let Err(error) = self.add_block()
        {
            *refused = Some(error);
            return;
        }
        self.blocks[self.len / Self::EACH].push(element);
        self.len += 1;
    }

    #[cold]
    fn add_block(&mut self) -> Result<(), OutOfMemory> {
        make_room(&mut self.blocks, 1)?;
        self.blocks.push(reserved(Self::EACH)?);
        Ok(())
    }

    /// Number of elements.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// The elements in the order in which they were appended.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &T> {
        self.blocks.iter().flatten()
    }

    /// The same, to be changed.
    pub(crate) fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.blocks.iter_mut().flatten()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_list_in_blocks_keeps_its_order_and_the_room_that_it_has() {
        let mut refused = None;
        let mut grown = Blocks::default();
        let mut with_room = Blocks::reserved(20_000).unwrap();
        let blocks = with_room.blocks.len();
        for number in 0..20_000_u32 {
            grown.push(number, &mut refused);
            with_room.push(number, &mut refused);
        }
        assert_eq!((refused, grown.len(), with_room.blocks.len()), (None, 20_000, blocks));
        assert!(grown.iter().copied().eq(0..20_000) && with_room.iter().copied().eq(0..20_000));
        grown.iter_mut().for_each(|number| *number += 1);
        assert!(grown.iter().copied().eq(1..20_001));
    }
}
