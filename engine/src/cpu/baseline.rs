//! The instructions that every processor of the target has.

use wide::f64x4;

use super::{InstructionSet, Lanes};

/// What every processor of the target has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Baseline;

impl InstructionSet for Baseline {
    type Lanes = f64x4;

    #[inline(always)]
    fn splat(self, x: f64) -> f64x4 {
        f64x4::splat(x)
    }

    #[inline(always)]
    fn lanes(self, x: [f64; 4]) -> f64x4 {
        f64x4::from(x)
    }

    #[inline(always)]
    fn call<R>(self, work: impl FnOnce() -> R) -> R {
        work()
    }
}

impl Lanes for f64x4 {
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.fast_min(other)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.fast_max(other)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self::sqrt(self)
    }

    #[inline(always)]
    fn lt(self, other: Self) -> Self {
        self.simd_lt(other)
    }

    #[inline(always)]
    fn le(self, other: Self) -> Self {
        self.simd_le(other)
    }

    #[inline(always)]
    fn ge(self, other: Self) -> Self {
        self.simd_ge(other)
    }

    #[inline(always)]
    fn select(self, yes: Self, no: Self) -> Self {
        Self::select(self, yes, no)
    }

    #[inline(always)]
    fn any(self) -> bool {
        Self::any(self)
    }

    #[inline(always)]
    fn to_array(self) -> [f64; 4] {
        Self::to_array(self)
    }

    #[inline(always)]
    fn transpose(rows: [Self; 4]) -> [Self; 4] {
        Self::transpose(rows)
    }
}
