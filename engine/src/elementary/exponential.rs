//! Powers of e and of 2.
//!
//! A power of e is `2^(k/128) e^r` with an integer k and `|r| < ln(2)/256`: the first factor from a table, the second
//! from a polynomial (Tang, Table-driven implementation of the exponential function, ACM TOMS 15 (1989) 144-157,
//! DOI 10.1145/63522.214389).

use std::f64::consts::LN_2;

use super::tables::EXP;

/// `128 / ln(2)`.
const PARTS_PER_UNIT: f64 = 184.6649652337873;
/// `-ln(2) / 128`, as the sum of two numbers, the first of which has bits to spare.
const MINUS_PART: [f64; 2] = [-0.005415212348111709, -1.2864023111638346e-14];
/// Added to a number and subtracted again, it rounds to an integer, whose last bits the sum has.
const TO_INTEGER: f64 = 6755399441055744.0;
/// The same for 128ths.
const TO_PART: f64 = TO_INTEGER / 128.0;
/// Coefficients of `r^2`, `r^3`, ... of `e^r`.
const OF_E: [f64; 4] = [0.49999999999996786, 0.16666666666665886, 0.0416666808410674, 0.008333335853059549];
/// Coefficients of `r`, `r^2`, ... of `2^r`.
const OF_2: [f64; 5] =
    [LN_2, 0.24022650695909065, 0.0555041086686087, 0.009618131975721055, 0.0013332074570119598];

/// A power of two that is no number yet: the bits of `2^(k/128)`, whose exponent may be out of range, times
/// `1 + beyond_one`.
struct Factors {
    bits: u64,
    beyond_one: f64,
    /// `k < 0`.
    is_small: bool,
}

/// How a product is added to a number.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Rounding {
    /// Once.
    Fused,
    /// The product first.
    Twice,
}

impl Rounding {
    #[inline(always)]
    fn multiply_add(self, a: f64, b: f64, c: f64) -> f64 {
        match self {
            Self::Fused => a.mul_add(b, c),
            Self::Twice => a * b + c,
        }
    }
}

impl Factors {
    /// The product, where it is a normal number.
    #[inline(always)]
    fn product(&self, rounding: Rounding) -> f64 {
        let scale = f64::from_bits(self.bits);
        rounding.multiply_add(scale, self.beyond_one, scale)
    }

    /// The product, where it may be too large or too small for a normal number.
    #[cold]
    fn far_product(&self, rounding: Rounding) -> f64 {
        if !self.is_small {
            let lower = Self { bits: self.bits.wrapping_sub(1009 << 52), ..*self };
            return f64::from_bits(0x7f00_0000_0000_0000) * lower.product(rounding);
        }
        let scale = f64::from_bits(self.bits.wrapping_add(1022 << 52));
        let added = scale * self.beyond_one;
        let mut product = scale + added;
        if product.abs() < 1.0 {
            // It will be subnormal: rounded here to as many bits as will be left.
            let one = 1.0_f64.copysign(product);
            let rest = scale - product + added;
            let high = one + product;
            let low = one - high + product + rest;
            product = (high + low) - one;
            if product == 0.0 {
                product = 0.0_f64.copysign(scale);
            }
        }
        f64::MIN_POSITIVE * product
    }
}

/// `e^(x + more)` for `|more|` below an ulp of x and `2^-54 <= |x| < 1024`, with the sign bit in `sign << 45`.
#[inline(always)]
fn power_of_e(x: f64, more: f64, sign: u64) -> Factors {
    let shifted = x.mul_add(PARTS_PER_UNIT, TO_INTEGER);
    let (k, parts) = (shifted.to_bits(), shifted - TO_INTEGER);
    let r = parts.mul_add(MINUS_PART[1], parts.mul_add(MINUS_PART[0], x)) + more;
    let (tail, bits) = EXP[(k % 128) as usize];
    let r2 = r * r;
    let low = r.mul_add(OF_E[1], OF_E[0]).mul_add(r2, tail + r);
    Factors {
        bits: bits.wrapping_add(k.wrapping_add(sign) << 45),
        beyond_one: (r2 * r2).mul_add(r.mul_add(OF_E[3], OF_E[2]), low),
        is_small: k & 0x8000_0000 != 0,
    }
}

/// `e^(x + more)` with a sign: see [`power_of_e`], for all x.
#[inline(always)]
pub(super) fn signed_exp(x: f64, more: f64, is_negative: bool) -> f64 {
    let sign = if is_negative { -1.0 } else { 1.0 };
    let size = x.abs();
    if size < f64::from_bits(0x3c90_0000_0000_0000) {
        return sign * (1.0 + x);
    }
    if size >= 1024.0 {
        return sign * if x > 0.0 { f64::INFINITY } else { 0.0 };
    }
    let factors = power_of_e(x, more, u64::from(is_negative) << 18);
    if size < 512.0 { factors.product(Rounding::Fused) } else { factors.far_product(Rounding::Fused) }
}

#[inline(always)]
pub(super) fn exp(x: f64) -> f64 {
    if x.is_nan() { x } else { signed_exp(x, 0.0, false) }
}

#[inline(always)]
pub(super) fn exp2(x: f64) -> f64 {
    if x.is_nan() {
        return x;
    }
    if x.abs() < f64::from_bits(0x3c90_0000_0000_0000) {
        return 1.0 + x;
    }
    if x >= 1024.0 {
        return f64::INFINITY;
    }
    if x <= -1075.0 {
        return 0.0;
    }
    // Products are rounded, as by the C library of GNU in 2026.
    let shifted = x + TO_PART;
    let (k, r) = (shifted.to_bits(), x - (shifted - TO_PART));
    let (tail, bits) = EXP[(k % 128) as usize];
    let r2 = r * r;
    let factors = Factors {
        bits: bits.wrapping_add(k << 45),
        beyond_one: (OF_2[2] * r + OF_2[1]) * r2 + (OF_2[0] * r + tail) + (OF_2[4] * r + OF_2[3]) * (r2 * r2),
        is_small: k & 0x8000_0000 != 0,
    };
    if x.abs() <= 928.0 { factors.product(Rounding::Twice) } else { factors.far_product(Rounding::Twice) }
}
