//! Elementary functions whose values have the same bits on every machine.
//!
//! IEEE 754 prescribes the bits of sums, products, quotients, square roots and fused products, and of no other
//! function. Those of the standard library come from the C library of the machine: their last digits differ between
//! libraries, and in one library between processors with and without fused multiply-add. So the engine uses these
//! alone; Clippy refuses the others (`engine/clippy.toml`).
//!
//! Exponential functions, logarithms and powers are the algorithms of Arm's Optimized Routines (Szabolcs Nagy, 2018,
//! <https://github.com/ARM-software/optimized-routines>, MIT), which the C libraries of GNU and of musl have as well.
//! Their values, and those of `hypot`, have the bits of the GNU C library 2.36 on processors with fused multiply-add:
//! packings were made with it before, and keep their bits. Errors are below 0.52 ulp, of `log2` 0.55, of `hypot` 1.
//! Other functions are those of the crate `libm`, which computes in Rust, mostly by the algorithms of FreeBSD's
//! library, with errors below 1 ulp.
// Forced inlining carries the instruction set, as in `cpu`; coefficients are as printed.
#![allow(clippy::inline_always, clippy::many_single_char_names, clippy::unreadable_literal)]

mod exponential;
mod hypotenuse;
mod logarithm;
mod power;
mod tables;

use crate::cpu::Cpu;

/// `e^x`.
pub(crate) fn exp(x: f64) -> f64 {
    Cpu::detect().call(|| exponential::exp(x))
}

/// `2^x`.
pub(crate) fn exp2(x: f64) -> f64 {
    Cpu::detect().call(|| exponential::exp2(x))
}

/// The natural logarithm; minus infinity at 0, NaN below.
pub(crate) fn ln(x: f64) -> f64 {
    Cpu::detect().call(|| logarithm::ln(x))
}

/// The logarithm to base 2; minus infinity at 0, NaN below.
pub(crate) fn log2(x: f64) -> f64 {
    Cpu::detect().call(|| logarithm::log2(x))
}

/// `x^y`; no number where x is negative and y is no integer.
pub(crate) fn powf(x: f64, y: f64) -> f64 {
    Cpu::detect().call(|| power::powf(x, y))
}

/// The length of the vector `(x, y)`.
pub(crate) fn hypot(x: f64, y: f64) -> f64 {
    hypotenuse::hypot(x, y)
}

/// The sine and the cosine of an angle in radians.
pub(crate) fn sin_cos(x: f64) -> (f64, f64) {
    libm::sincos(x)
}

pub(crate) use libm::{acos, asin, atan, atan2, cbrt, cos, expm1 as exp_m1, log1p as ln_1p, log10, sin, tan};

#[cfg(test)]
mod tests;
