//! The system's allocator, which asks for huge pages for large blocks.
//!
//! Packing reads memory at random: with a hundred thousand grains and more, most reads miss the
//! processor's cache of page addresses as well. Linux backs a block with pages of 2 MB where it is
//! asked to, its usual setting (`transparent_hugepage=madvise`); the gain is measured in
//! `docs/performance.md`. It must never change what a block holds or how long it lives.

use std::alloc::{GlobalAlloc, Layout, System};

/// Smaller blocks would hold no whole huge page, or few.
const LEAST_BYTES: usize = 4 << 20;

/// [`System`], with huge pages for large blocks.
pub(crate) struct HugePages;

// SAFETY: every block comes from `System`, goes back to it as it came, and meets its contract as
// `System` does; `advise` changes nothing of it that a program can see.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for HugePages {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise about `layout` is the one that `System` asks for.
        advise(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        advise(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: the block came from `System`, with this layout.
        unsafe { System.dealloc(block, layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        // SAFETY: the block came from `System`, with this layout; `new_size` is as the caller promised.
        advise(unsafe { System.realloc(block, layout, new_size) }, new_size)
    }
}

/// Asks for huge pages below a block that is large enough for some; the same block, or null.
#[cfg(target_os = "linux")]
fn advise(block: *mut u8, size: usize) -> *mut u8 {
    use rustix::mm::{Advice, madvise};

    /// The smallest page there is; a larger one refuses the advice, and no harm is done.
    const PAGE_BYTES: usize = 4096;

    if size >= LEAST_BYTES && !block.is_null() {
        let lead = block.addr().wrapping_neg() % PAGE_BYTES;
        let whole = (size - lead) / PAGE_BYTES * PAGE_BYTES;
        // SAFETY: the range lies within a block that was just handed out, and this advice changes
        // neither what it holds nor whether it may be used. It is advice: a refusal costs speed only.
        #[allow(unsafe_code)]
        let _ = unsafe { madvise(block.wrapping_add(lead).cast(), whole, Advice::LinuxHugepage) };
    }
    block
}

#[cfg(not(target_os = "linux"))]
fn advise(block: *mut u8, _size: usize) -> *mut u8 {
    let _ = LEAST_BYTES;
    block
}

#[cfg(test)]
mod tests {
    /// The binary's tests run on this allocator.
    #[test]
    fn large_blocks_hold_what_is_written_as_they_grow() {
        let mut bytes = vec![0_u8; super::LEAST_BYTES];
        assert!(bytes.iter().all(|byte| *byte == 0));
        bytes.fill(7);
        bytes.reserve_exact(8 * super::LEAST_BYTES);
        bytes.resize(8 * super::LEAST_BYTES, 9);
        assert!(bytes[..super::LEAST_BYTES].iter().all(|byte| *byte == 7));
        bytes.truncate(super::LEAST_BYTES);
        bytes.shrink_to_fit();
        assert_eq!(bytes.iter().map(|byte| u64::from(*byte)).sum::<u64>(), 7 * super::LEAST_BYTES as u64);
    }
}
