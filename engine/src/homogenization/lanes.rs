//! Four numbers of single precision as one number: a Fourier transform of them is four transforms at once.
//!
//! `rustfft` is generic over its numbers. Its own vector instructions are chosen at run time and contract products, so
//! that bits would depend on the processor; four lanes of plain operations are as fast as its SSE code and round in the
//! same way everywhere.

use std::ops::{Add, Div, Mul, Neg, Rem, Sub};

use num_traits::{FromPrimitive, Num, One, Signed, Zero};

/// Numbers in a lane.
pub(super) const WIDTH: usize = 4;

/// Four numbers that are computed with at once.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(16))]
pub(super) struct Lanes(pub(super) [f32; WIDTH]);

impl Lanes {
    /// The same number four times.
    #[inline]
    pub(super) fn splat(x: f32) -> Self {
        Self([x; WIDTH])
    }

    /// The first four numbers of a slice, which has as many.
    #[inline]
    pub(super) fn load(from: &[f32]) -> Self {
        Self([from[0], from[1], from[2], from[3]])
    }

    /// Puts the numbers into the first four places of a slice.
    #[inline]
    pub(super) fn store(self, to: &mut [f32]) {
        to[..WIDTH].copy_from_slice(&self.0);
    }

    #[inline]
    fn each(self, of: impl Fn(f32) -> f32) -> Self {
        let a = self.0;
        Self([of(a[0]), of(a[1]), of(a[2]), of(a[3])])
    }

    #[inline]
    fn with(self, other: Self, of: impl Fn(f32, f32) -> f32) -> Self {
        let (a, b) = (self.0, other.0);
        Self([of(a[0], b[0]), of(a[1], b[1]), of(a[2], b[2]), of(a[3], b[3])])
    }

    /// The inverse of each number that is positive, and 0 of the others.
    #[inline]
    pub(super) fn inverse_or_zero(self) -> Self {
        self.each(|x| if x > 0.0 { 1.0 / x } else { 0.0 })
    }
}

macro_rules! by_lane {
    ($($operator:ident $method:ident $of:expr;)*) => {$(
        impl $operator for Lanes {
            type Output = Self;

            #[inline]
            fn $method(self, other: Self) -> Self {
                self.with(other, $of)
            }
        }
    )*};
}

by_lane! {
    Add add |a, b| a + b;
    Sub sub |a, b| a - b;
    Mul mul |a, b| a * b;
    Div div |a, b| a / b;
    Rem rem |a, b| a % b;
}

impl Neg for Lanes {
    type Output = Self;

    #[inline]
    fn neg(self) -> Self {
        self.each(|x| -x)
    }
}

impl Zero for Lanes {
    #[inline]
    fn zero() -> Self {
        Self::splat(0.0)
    }

    fn is_zero(&self) -> bool {
        self.0 == [0.0; WIDTH]
    }
}

impl One for Lanes {
    #[inline]
    fn one() -> Self {
        Self::splat(1.0)
    }
}

impl Num for Lanes {
    type FromStrRadixErr = <f32 as Num>::FromStrRadixErr;

    fn from_str_radix(text: &str, radix: u32) -> Result<Self, Self::FromStrRadixErr> {
        f32::from_str_radix(text, radix).map(Self::splat)
    }
}

impl Signed for Lanes {
    fn abs(&self) -> Self {
        self.each(f32::abs)
    }

    fn abs_sub(&self, other: &Self) -> Self {
        self.with(*other, |a, b| if a > b { a - b } else { 0.0 })
    }

    fn signum(&self) -> Self {
        self.each(f32::signum)
    }

    fn is_positive(&self) -> bool {
        self.0.iter().all(|x| *x > 0.0)
    }

    fn is_negative(&self) -> bool {
        self.0.iter().all(|x| *x < 0.0)
    }
}

impl FromPrimitive for Lanes {
    fn from_i64(n: i64) -> Option<Self> {
        Some(Self::splat(n as f32))
    }

    fn from_u64(n: u64) -> Option<Self> {
        Some(Self::splat(n as f32))
    }

    fn from_f32(x: f32) -> Option<Self> {
        Some(Self::splat(x))
    }

    fn from_f64(x: f64) -> Option<Self> {
        Some(Self::splat(x as f32))
    }
}
