//! Huge pages below large blocks of memory.
//!
//! Packing reads memory at random: with a hundred thousand grains and more, most reads miss the processor's cache of
//! page addresses as well. Linux backs a block with pages of 2 MB where it is asked to before the block is used, its
//! usual setting (`transparent_hugepage=madvise`); the gain is measured in
//! `docs/development/measurements-spheres.md`. It never changes what a block holds or how long it lives.

/// Smaller blocks would hold no whole huge page, or few.
const LEAST_BYTES: usize = 4 << 20;

/// Asks for huge pages below all that a vector has room for, where that is large enough for some.
#[cfg(target_os = "linux")]
pub(super) fn advise<T>(vector: &mut Vec<T>) {
    use rustix::mm::{Advice, madvise};

    /// The smallest page there is; a larger one refuses the advice, and no harm is done.
    const PAGE_BYTES: usize = 4096;

    let bytes = vector.capacity().saturating_mul(size_of::<T>());
    if size_of::<T>() == 0 || bytes < LEAST_BYTES {
        return;
    }
    let block = vector.as_mut_ptr().cast::<u8>();
    let lead = block.addr().wrapping_neg() % PAGE_BYTES;
    let whole = (bytes - lead) / PAGE_BYTES * PAGE_BYTES;
    // SAFETY: `lead + whole` is at most `bytes`, so that the range lies within the one allocation that the vector owns
    // and that is borrowed for itself here. This advice changes neither what the memory holds nor whether it may be
    // used, and it is over when the memory is given back. A refusal costs speed only.
    #[allow(unsafe_code)]
    let _ = unsafe { madvise(block.wrapping_add(lead).cast(), whole, Advice::LinuxHugepage) };
}

/// Asks for nothing.
#[cfg(not(target_os = "linux"))]
pub(super) fn advise<T>(vector: &mut Vec<T>) {
    let _ = (vector, LEAST_BYTES);
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::{filled, make_room, reserved};
    use super::LEAST_BYTES;

    #[test]
    fn large_blocks_hold_what_is_written_as_they_grow() {
        let mut bytes = filled(LEAST_BYTES, 0_u8).unwrap();
        assert!(bytes.iter().all(|byte| *byte == 0));
        bytes.fill(7);
        make_room(&mut bytes, 8 * LEAST_BYTES).unwrap();
        assert!(bytes.iter().all(|byte| *byte == 7) && bytes.len() == LEAST_BYTES);
        bytes.resize(8 * LEAST_BYTES, 9);
        bytes.truncate(LEAST_BYTES);
        bytes.shrink_to_fit();
        assert_eq!(bytes.iter().map(|byte| u64::from(*byte)).sum::<u64>(), 7 * LEAST_BYTES as u64);
        assert_eq!(reserved::<()>(LEAST_BYTES).unwrap().len(), 0);
    }

    /// What Linux says of the mapping that holds an address: `hg` where huge pages were asked for.
    #[cfg(target_os = "linux")]
    fn has_huge_pages(address: usize) -> bool {
        let maps = std::fs::read_to_string("/proc/self/smaps").unwrap();
        let mut within = false;
        for line in maps.lines() {
            let range = line.split(' ').next().unwrap().split_once('-');
            let hexadecimal = |text| usize::from_str_radix(text, 16).ok();
            if let Some((Some(from), Some(to))) = range.map(|(from, to)| (hexadecimal(from), hexadecimal(to)))
            {
                within = (from..to).contains(&address);
            } else if within && let Some(flags) = line.strip_prefix("VmFlags:") {
                return flags.split(' ').any(|flag| flag == "hg");
            }
        }
        false
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn large_blocks_are_asked_for_as_huge_pages_before_they_are_used() {
        if !std::path::Path::new("/sys/kernel/mm/transparent_hugepage").exists() {
            return;
        }
        let large = reserved::<u64>(LEAST_BYTES).unwrap();
        assert!(has_huge_pages(large.as_ptr().addr() + LEAST_BYTES));
        let mut grown = Vec::<u8>::new();
        make_room(&mut grown, 2 * LEAST_BYTES).unwrap();
        assert!(has_huge_pages(grown.as_ptr().addr() + LEAST_BYTES));
    }
}
