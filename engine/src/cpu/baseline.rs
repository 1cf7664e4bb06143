//! The instructions that every processor of the target has. Four numbers are an array: whether they are computed with
//! at once, as by SSE2 or NEON, is left to the compiler.

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Sub};

use super::{InstructionSet, Lanes};

/// What every processor of the target has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Baseline;

impl InstructionSet for Baseline {
    type Lanes = Four;

    #[inline(always)]
    fn splat(self, x: f64) -> Four {
        Four([x; 4])
    }

    #[inline(always)]
    fn lanes(self, x: [f64; 4]) -> Four {
        Four(x)
    }

    #[inline(always)]
    fn call<R>(self, work: impl FnOnce() -> R) -> R {
        work()
    }
}

/// Four numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Four([f64; 4]);

impl Four {
    #[inline(always)]
    fn by_lane(self, other: Self, of: impl Fn(f64, f64) -> f64) -> Self {
        let (a, b) = (self.0, other.0);
        Self([of(a[0], b[0]), of(a[1], b[1]), of(a[2], b[2]), of(a[3], b[3])])
    }

    #[inline(always)]
    fn mask(self, other: Self, is_set: impl Fn(f64, f64) -> bool) -> Self {
        self.by_lane(other, |a, b| f64::from_bits(if is_set(a, b) { u64::MAX } else { 0 }))
    }
}

impl Add for Four {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.by_lane(other, |a, b| a + b)
    }
}

impl Sub for Four {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.by_lane(other, |a, b| a - b)
    }
}

impl Mul for Four {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.by_lane(other, |a, b| a * b)
    }
}

impl Div for Four {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.by_lane(other, |a, b| a / b)
    }
}

impl Neg for Four {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        self.by_lane(self, |a, _| -a)
    }
}

impl BitAnd for Four {
    type Output = Self;

    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        self.by_lane(other, |a, b| f64::from_bits(a.to_bits() & b.to_bits()))
    }
}

impl BitOr for Four {
    type Output = Self;

    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        self.by_lane(other, |a, b| f64::from_bits(a.to_bits() | b.to_bits()))
    }
}

impl Lanes for Four {
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.by_lane(other, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.by_lane(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.by_lane(self, |a, _| a.sqrt())
    }

    #[inline(always)]
    fn lt(self, other: Self) -> Self {
        self.mask(other, |a, b| a < b)
    }

    #[inline(always)]
    fn le(self, other: Self) -> Self {
        self.mask(other, |a, b| a <= b)
    }

    #[inline(always)]
    fn ge(self, other: Self) -> Self {
        self.mask(other, |a, b| a >= b)
    }

    #[inline(always)]
    fn select(self, yes: Self, no: Self) -> Self {
        let chosen = yes & self;
        let not = no.by_lane(self, |no, mask| f64::from_bits(no.to_bits() & !mask.to_bits()));
        chosen | not
    }

    #[inline(always)]
    fn any(self) -> bool {
        let bits = self.0.map(f64::to_bits);
        (bits[0] | bits[1]) | (bits[2] | bits[3]) != 0
    }

    #[inline(always)]
    fn to_array(self) -> [f64; 4] {
        self.0
    }

    #[inline(always)]
    fn transpose(rows: [Self; 4]) -> [Self; 4] {
        let column = |k: usize| Self([rows[0].0[k], rows[1].0[k], rows[2].0[k], rows[3].0[k]]);
        [column(0), column(1), column(2), column(3)]
    }
}
