//! Items by bin, in blocks of memory that all bins share: an emptied bin leaves its blocks to the others.

// Forced inlining carries the instruction set of a search to what it calls ([`crate::cpu`]).
#![allow(clippy::inline_always)]

use crate::cpu::prefetch;
use crate::memory::{OutOfMemory, make_room, push, refill};

/// No block.
const NIL: u32 = u32::MAX;

/// Some items of a bin, and the block that holds its earlier ones, or the next block that is not in use. It begins a
/// cache line.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Block<T, const N: usize> {
    items: [T; N],
    below: u32,
}

/// The last block of a bin, and how many items that has. All others are full.
#[derive(Clone, Copy, Debug)]
struct Last {
    block: u32,
    items: u32,
}

/// Bins whose blocks hold `N` items.
#[derive(Debug, Default)]
pub(super) struct Bins<T, const N: usize> {
    last: Vec<Last>,
    blocks: Vec<Block<T, N>>,
    /// The first block that is not in use.
    free: u32,
}

impl<T: Copy + Default, const N: usize> Bins<T, N> {
    /// An empty bin: its counter says that its last block is full, so that the first item allocates a block.
    const EMPTY: Last = Last { block: NIL, items: N as u32 };

    /// Empties all bins; there are so many from now on, with room for so many blocks.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn reset(&mut self, bins: usize, blocks: usize) -> Result<(), OutOfMemory> {
        refill(&mut self.last, bins, Self::EMPTY)?;
        self.blocks.clear();
        make_room(&mut self.blocks, blocks)?;
        self.free = NIL;
        Ok(())
    }

    /// Number of bins.
    #[inline(always)]
    pub(super) fn len(&self) -> usize {
        self.last.len()
    }

    /// Enters an item. Where the system refuses memory, it is left out and the refusal is noted.
    #[inline(always)]
    pub(super) fn push(&mut self, bin: usize, item: T, refused: &mut Option<OutOfMemory>) {
        if self.last[bin].items as usize == N {
            self.add_block(bin, refused);
        }
        let Last { block, items } = &mut self.last[bin];
        if let Some(block) = self.blocks.get_mut(*block as usize)
            && let Some(place) = block.items.get_mut(*items as usize)
        {
            *place = item;
            *items += 1;
        }
    }

    /// Gives a bin whose last block is full another one, where there is memory for it.
    #[inline]
    fn add_block(&mut self, bin: usize, refused: &mut Option<OutOfMemory>) {
        let mut block = self.free;
        if block == NIL {
            block = self.blocks.len() as u32;
            push(&mut self.blocks, Block { items: [T::default(); N], below: NIL }, refused);
        }
        if let Some(added) = self.blocks.get_mut(block as usize) {
            self.free = added.below;
            added.below = self.last[bin].block;
            self.last[bin] = Last { block, items: 0 };
        }
    }

    /// Takes all items out of a bin, the last block first.
    #[inline(always)]
    pub(super) fn drain(&mut self, bin: usize, mut take: impl FnMut(&[T])) {
        let mut drained = std::mem::replace(&mut self.last[bin], Self::EMPTY);
        while let Some(block) = self.blocks.get_mut(drained.block as usize) {
            take(&block.items[..drained.items as usize]);
            let below = std::mem::replace(&mut block.below, self.free);
            self.free = drained.block;
            drained = Last { block: below, ..Self::EMPTY };
        }
    }

    /// Calls `visit` with the items of a bin, if there is that bin.
    #[inline(always)]
    pub(super) fn for_each(&self, bin: usize, mut visit: impl FnMut(T)) {
        let Some(mut at) = self.last.get(bin).copied() else { return };
        while let Some(block) = self.blocks.get(at.block as usize) {
            block.items[..at.items as usize].iter().copied().for_each(&mut visit);
            at = Last { block: block.below, ..Self::EMPTY };
        }
    }

    /// Asks the memory for the last block of a bin.
    #[inline(always)]
    pub(super) fn prefetch_last(&self, bin: usize) {
        prefetch(&self.blocks, self.last.get(bin).map_or(NIL, |last| last.block) as usize);
    }

    /// Asks the memory for the block before the last one of a bin.
    #[inline(always)]
    pub(super) fn ask_for_next_to_last(&self, bin: usize) {
        let last = self.last.get(bin).and_then(|last| self.blocks.get(last.block as usize));
        prefetch(&self.blocks, last.map_or(NIL, |block| block.below) as usize);
    }

    /// Number of blocks, in use or not.
    #[cfg(test)]
    pub(super) fn blocks(&self) -> usize {
        self.blocks.len()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::properties::properties;

    properties! {
        /// Against a vector for each bin. A bin is emptied where no item is given.
        #[test]
        fn items_come_out_of_their_bins(steps in prop::collection::vec((0..5_usize, any::<Option<u16>>()), 0..400)) {
            let (mut bins, mut refused) = (Bins::<u16, 7>::default(), None);
            prop_assert_eq!(bins.reset(5, 0), Ok(()));
            let mut expected = vec![Vec::new(); bins.len()];
            let mut most = 0;
            for (bin, item) in steps {
                if let Some(item) = item {
                    bins.push(bin, item, &mut refused);
                    expected[bin].push(item);
                } else {
                    let (mut seen, mut drained) = (Vec::new(), Vec::new());
                    bins.for_each(bin, |item| seen.push(item));
                    bins.drain(bin, |items| drained.extend_from_slice(items));
                    prop_assert_eq!(&seen, &drained);
                    drained.sort_unstable();
                    expected[bin].sort_unstable();
                    prop_assert_eq!(drained, std::mem::take(&mut expected[bin]));
                }
                most = most.max(expected.iter().map(|items| items.len().div_ceil(7)).sum());
            }
            prop_assert_eq!(refused, None);
            prop_assert!(bins.blocks() <= most, "blocks are used again");
        }
    }
}
