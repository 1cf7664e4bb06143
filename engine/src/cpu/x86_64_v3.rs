//! x86-64-v3: the instructions of Haswell and Zen, and four numbers in one AVX register.
//!
//! # Safety
//! Code compiled for AVX2 may run only where the processor has it. A [`V3`] is made in one place, [`V3::detect`],
//! after the processor has confirmed every feature named below; its field is private. [`F64x4`] is made only from a
//! [`V3`] or from other values of its type. So whoever holds either runs on a processor with these features, which is
//! all that the functions called here ask for: none of them touches memory other than by value or reference.
#![allow(unsafe_code)]

use std::arch::x86_64 as x86;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Sub};

use super::{InstructionSet, Lanes};

/// Shows that the processor has AVX2, FMA, BMI1, BMI2, LZCNT and POPCNT.
#[derive(Clone, Copy, Debug)]
pub(crate) struct V3(());

impl V3 {
    /// Asks the processor.
    pub(super) fn detect() -> Option<Self> {
        let has_all = is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt");
        has_all.then_some(Self(()))
    }
}

#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
fn call<R>(work: impl FnOnce() -> R) -> R {
    work()
}

impl InstructionSet for V3 {
    type Lanes = F64x4;

    #[inline(always)]
    fn splat(self, x: f64) -> F64x4 {
        // SAFETY: `self` shows that the processor has AVX.
        F64x4(unsafe { x86::_mm256_set1_pd(x) })
    }

    #[inline(always)]
    fn lanes(self, x: [f64; 4]) -> F64x4 {
        // SAFETY: `self` shows that the processor has AVX; the array is live and as long as is read.
        F64x4(unsafe { x86::_mm256_loadu_pd(x.as_ptr()) })
    }

    #[inline(always)]
    fn call<R>(self, work: impl FnOnce() -> R) -> R {
        // SAFETY: `self` shows that the processor has the features that the function is compiled for.
        unsafe { call(work) }
    }
}

/// Four numbers in one register.
#[derive(Clone, Copy, Debug)]
pub(crate) struct F64x4(x86::__m256d);

/// An operator by its instruction.
macro_rules! operator {
    ($name:ident, $method:ident, $instruction:ident) => {
        impl $name for F64x4 {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: `self` exists, so the processor has AVX.
                Self(unsafe { x86::$instruction(self.0, other.0) })
            }
        }
    };
}

operator!(Add, add, _mm256_add_pd);
operator!(Sub, sub, _mm256_sub_pd);
operator!(Mul, mul, _mm256_mul_pd);
operator!(Div, div, _mm256_div_pd);
operator!(BitAnd, bitand, _mm256_and_pd);
operator!(BitOr, bitor, _mm256_or_pd);

impl Neg for F64x4 {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: `self` exists, so the processor has AVX.
        Self(unsafe { x86::_mm256_xor_pd(self.0, x86::_mm256_set1_pd(-0.0)) })
    }
}

/// A comparison by its code.
macro_rules! compared {
    ($a:expr, $b:expr, $code:ident) => {
        // SAFETY: both exist, so the processor has AVX.
        Self(unsafe { x86::_mm256_cmp_pd::<{ x86::$code }>($a.0, $b.0) })
    };
}

impl Lanes for F64x4 {
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: `self` exists, so the processor has AVX.
        Self(unsafe { x86::_mm256_min_pd(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: `self` exists, so the processor has AVX.
        Self(unsafe { x86::_mm256_max_pd(self.0, other.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: `self` exists, so the processor has AVX.
        Self(unsafe { x86::_mm256_sqrt_pd(self.0) })
    }

    #[inline(always)]
    fn lt(self, other: Self) -> Self {
        compared!(self, other, _CMP_LT_OQ)
    }

    #[inline(always)]
    fn le(self, other: Self) -> Self {
        compared!(self, other, _CMP_LE_OQ)
    }

    #[inline(always)]
    fn ge(self, other: Self) -> Self {
        compared!(self, other, _CMP_GE_OQ)
    }

    #[inline(always)]
    fn select(self, yes: Self, no: Self) -> Self {
        // SAFETY: `self` exists, so the processor has AVX.
        Self(unsafe { x86::_mm256_blendv_pd(no.0, yes.0, self.0) })
    }

    #[inline(always)]
    fn any(self) -> bool {
        // SAFETY: `self` exists, so the processor has AVX.
        unsafe { x86::_mm256_movemask_pd(self.0) != 0 }
    }

    #[inline(always)]
    fn to_array(self) -> [f64; 4] {
        let mut array = [0.0; 4];
        // SAFETY: `self` exists, so the processor has AVX; the array is live and as long as is written.
        unsafe { x86::_mm256_storeu_pd(array.as_mut_ptr(), self.0) };
        array
    }

    #[inline(always)]
    fn transpose([a, b, c, d]: [Self; 4]) -> [Self; 4] {
        // SAFETY: `a` exists, so the processor has AVX.
        unsafe {
            let (ab_even, ab_odd) = (x86::_mm256_unpacklo_pd(a.0, b.0), x86::_mm256_unpackhi_pd(a.0, b.0));
            let (cd_even, cd_odd) = (x86::_mm256_unpacklo_pd(c.0, d.0), x86::_mm256_unpackhi_pd(c.0, d.0));
            [
                Self(x86::_mm256_permute2f128_pd::<0x20>(ab_even, cd_even)),
                Self(x86::_mm256_permute2f128_pd::<0x20>(ab_odd, cd_odd)),
                Self(x86::_mm256_permute2f128_pd::<0x31>(ab_even, cd_even)),
                Self(x86::_mm256_permute2f128_pd::<0x31>(ab_odd, cd_odd)),
            ]
        }
    }
}
