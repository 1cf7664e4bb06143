//! Tolerances that several parts of the dynamics share.

/// Grains grow to their target times this, so that the check, which rounds differently, finds no overlap.
pub(crate) const BEYOND_TARGET: f64 = 1.0 + 1e-10;
/// Growth that ends within this share below its target may be that of grains which fit exactly.
pub(crate) const EXACT_FIT: f64 = 1e-5;
