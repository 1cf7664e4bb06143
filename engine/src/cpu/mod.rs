//! Instruction sets: hot loops are compiled for the baseline of the target and for x86-64-v3, and chosen at run time.
//!
//! The build carries no CPU flags, so that one binary runs on every machine of its target. [`Cpu::detect`] asks the
//! processor once per run. [`InstructionSet::call`] runs a closure in a function that is compiled for the set; what
//! the closure calls is compiled for it as well where it is inlined, and is marked `inline(always)` for that reason.
//! [`Lanes`] are four numbers at once: an array for the baseline, AVX for x86-64-v3.
//!
//! The bits of a result do not depend on the set: every operation here rounds as IEEE 754 prescribes for the single
//! operation, no set has an operation that another computes in two roundings, and the compiler contracts nothing. A
//! test packs on both paths.
// Forced inlining is what carries the instruction set from `call` to the code that uses it.
#![allow(clippy::inline_always)]

mod baseline;
mod prefetch;
#[cfg(target_arch = "x86_64")]
mod x86_64_v3;

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Sub};

pub(crate) use baseline::Baseline;
pub(crate) use prefetch::prefetch;
#[cfg(target_arch = "x86_64")]
pub(crate) use x86_64_v3::V3;

/// An instruction set that code is compiled for. A value of the type shows that the processor has it.
pub(crate) trait InstructionSet: Copy {
    /// Four numbers that are computed with at once.
    type Lanes: Lanes;

    /// The same number four times.
    fn splat(self, x: f64) -> Self::Lanes;

    /// Four numbers.
    fn lanes(self, x: [f64; 4]) -> Self::Lanes;

    /// Calls `work` in a function that is compiled for this set.
    fn call<R>(self, work: impl FnOnce() -> R) -> R;
}

/// Four numbers that are computed with at once. Comparisons give masks: all bits of a number set, or none.
pub(crate) trait Lanes:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + BitAnd<Output = Self>
    + BitOr<Output = Self>
{
    /// The smaller ones; `other` where either is no number.
    fn min(self, other: Self) -> Self;
    /// The larger ones; `other` where either is no number.
    fn max(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    /// Mask of `self < other`.
    fn lt(self, other: Self) -> Self;
    /// Mask of `self <= other`.
    fn le(self, other: Self) -> Self;
    /// Mask of `self >= other`.
    fn ge(self, other: Self) -> Self;
    /// Of this mask: `yes` where it is set, else `no`.
    fn select(self, yes: Self, no: Self) -> Self;
    /// Of this mask: whether it is set anywhere.
    fn any(self) -> bool;
    fn to_array(self) -> [f64; 4];
    /// Rows become columns.
    fn transpose(rows: [Self; 4]) -> [Self; 4];
}

/// The widest instruction set of this processor that hot loops are compiled for.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Cpu {
    /// What every processor of the target has.
    Baseline(Baseline),
    /// AVX2, FMA, BMI1, BMI2, LZCNT and POPCNT, in processors since 2013 (Intel) and 2015 (AMD).
    #[cfg(target_arch = "x86_64")]
    V3(V3),
}

impl Cpu {
    /// Asks the processor.
    pub(crate) fn detect() -> Self {
        #[cfg(test)]
        if tests::IS_BASELINE_FORCED.get() {
            return Self::Baseline(Baseline);
        }
        #[cfg(target_arch = "x86_64")]
        if let Some(v3) = V3::detect() {
            return Self::V3(v3);
        }
        Self::Baseline(Baseline)
    }

    /// Calls `work` in a function that is compiled for this set.
    #[inline(always)]
    pub(crate) fn call<R>(self, work: impl FnOnce() -> R) -> R {
        match self {
            Self::Baseline(baseline) => baseline.call(work),
            #[cfg(target_arch = "x86_64")]
            Self::V3(v3) => v3.call(work),
        }
    }
}

/// Evaluates an expression for the instruction set of a [`Cpu`], bound to a name.
macro_rules! with_instruction_set {
    ($cpu:expr, $set:ident => $work:expr) => {
        match $cpu {
            $crate::cpu::Cpu::Baseline($set) => $work,
            #[cfg(target_arch = "x86_64")]
            $crate::cpu::Cpu::V3($set) => $work,
        }
    };
}
pub(crate) use with_instruction_set;

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(crate) mod tests;
