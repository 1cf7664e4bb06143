//! Asking the memory for what will be read next.
//!
//! With 1e5 grains and more, an event of a simulation waits for some forty cache lines that nothing has touched
//! lately; asked for an event ahead they arrive while the one before is computed.
#![allow(unsafe_code)]

/// Asks for the cache line of an element, if there is one. Changes nothing but when it is there.
#[inline(always)]
pub(crate) fn prefetch<T>(of: &[T], index: usize) {
    #[cfg(target_arch = "x86_64")]
    if let Some(element) = of.get(index) {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: SSE is part of x86-64, and a prefetch neither reads nor faults, whatever the address;
        // this one is that of a live element.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(element).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (of, index);
}
