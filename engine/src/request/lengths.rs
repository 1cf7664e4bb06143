//! The lengths that a request may name.

use super::decode::{Bound, Object};

/// Smallest length that a request may name for a grain, a sieve or a specimen, in mm: a nanometre. Below it no
/// aggregate is known, and ratios of lengths would leave the range of numbers.
pub const MIN_LENGTH_MM: f64 = 1.0e-6;

/// Largest length a request may name, in mm.
pub const MAX_LENGTH_MM: f64 = 1.0e6;

/// A diameter, a sieve, or an edge of a specimen.
pub(super) const LENGTH: Bound = Bound::closed(MIN_LENGTH_MM, MAX_LENGTH_MM, "mm");

/// Reads a length of an object that must have it.
pub(super) fn length(object: &mut Object<'_>, name: &'static str) -> Option<f64> {
    object.required(name)?.number(LENGTH)
}
