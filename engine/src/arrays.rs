//! Short arrays of numbers from a function of each item, always inlined: for modules that compute with coordinates.
//!
//! [`from_fn`] and [`Each::each`] return what `std::array::from_fn` and `map` return, for items that are `Copy` and
//! `Default`. In the standard library of Rust 1.95, those two call the given function through another one that is not
//! marked for inlining (`core::ops::try_trait::Wrapped`). In a crate of several code generation units a call remains
//! around every operation on coordinates: with them the unit tests of the engine took 1.25 times the CPU time.
// The head states the measured reason.
#![allow(clippy::inline_always)]

/// The array `[value(0), value(1), …]`.
#[inline(always)]
pub(crate) fn from_fn<T: Copy + Default, const N: usize>(mut value: impl FnMut(usize) -> T) -> [T; N] {
    let mut array = [T::default(); N];
    for (index, item) in array.iter_mut().enumerate() {
        *item = value(index);
    }
    array
}

/// A function of each item of an array.
pub(crate) trait Each<T, const N: usize> {
    /// The array `[value(self[0]), value(self[1]), …]`.
    fn each<U: Copy + Default>(self, value: impl FnMut(T) -> U) -> [U; N];
}

impl<T: Copy, const N: usize> Each<T, N> for [T; N] {
    #[inline(always)]
    fn each<U: Copy + Default>(self, mut value: impl FnMut(T) -> U) -> [U; N] {
        from_fn(|index| value(self[index]))
    }
}
