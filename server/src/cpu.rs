//! Whether this processor can run this build, asked before anything else.
//!
//! A build for AVX2 (`.cargo/config.toml`) dies of an illegal instruction on a processor without it,
//! which tells nobody anything. This module must never do more than compare integers: it runs where
//! the rest of the program cannot.

/// What the program may take for granted, and how to see whether it is there.
#[cfg(all(target_arch = "x86_64", target_feature = "avx2"))]
mod wanted {
    use std::arch::x86_64::{__cpuid, __cpuid_count};

    /// Bits of the feature words of CPUID: leaf 1, ECX, and leaf 7, EBX.
    const FMA: u32 = 1 << 12;
    const OSXSAVE: u32 = 1 << 27;
    const AVX: u32 = 1 << 28;
    const AVX2: u32 = 1 << 5;
    const BMI2: u32 = 1 << 8;
    /// The leaf with the extended features.
    const EXTENDED: u32 = 7;

    /// Whether feature words have all of it. Without OSXSAVE the operating system does not keep the
    /// wide registers, and they are of no use.
    pub(super) const fn in_words(leaf_1_ecx: u32, leaf_7_ebx: u32) -> bool {
        const LEAF_1: u32 = FMA | OSXSAVE | AVX;
        const LEAF_7: u32 = AVX2 | BMI2;
        leaf_1_ecx & LEAF_1 == LEAF_1 && leaf_7_ebx & LEAF_7 == LEAF_7
    }

    /// Whether this processor has all of it. `is_x86_feature_detected!` would not look: it is true for
    /// whatever the build was made for.
    pub(super) fn here() -> bool {
        __cpuid(0).eax >= EXTENDED && in_words(__cpuid(1).ecx, __cpuid_count(EXTENDED, 0).ebx)
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn every_feature_is_needed() {
            let (leaf_1, leaf_7) = (FMA | OSXSAVE | AVX, AVX2 | BMI2);
            assert!(in_words(leaf_1, leaf_7));
            assert!(in_words(u32::MAX, u32::MAX));
            for bit in [FMA, OSXSAVE, AVX] {
                assert!(!in_words(!bit, u32::MAX), "{bit:#x}");
            }
            for bit in [AVX2, BMI2] {
                assert!(!in_words(u32::MAX, !bit), "{bit:#x}");
            }
        }

        #[test]
        fn the_processor_that_runs_this_test_is_fit() {
            assert!(here());
        }
    }
}

/// Whether this build can run here; says why where it cannot.
#[inline(never)] // What is inlined may be mixed with instructions that are not there.
pub(crate) fn is_fit() -> bool {
    #[cfg(all(target_arch = "x86_64", target_feature = "avx2"))]
    if !wanted::here() {
        eprintln!(
            "packstone: this build needs a processor with AVX2, FMA and BMI2 (Intel since Haswell, AMD since Zen), and \
             this one, or the virtual machine around it, lacks some of them; build anew with \
             RUSTFLAGS='-C target-cpu=x86-64' in the environment"
        );
        return false;
    }
    true
}
