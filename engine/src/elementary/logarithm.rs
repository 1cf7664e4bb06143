//! Logarithms.
//!
//! A number is `2^k z` with z in one of the parts of a table; its logarithm is that of `2^k`, of the middle c of the
//! part, and of `z/c`, which a polynomial gives (Tang, Table-driven implementation of the logarithm function, ACM TOMS
//! 16 (1990) 378-400, DOI 10.1145/98267.98294). Near one, the polynomial alone gives it.

use super::tables::{LN, LOG2};

/// The least significand of the tables, 0.6875.
const LEAST: u64 = 0x3fe6_0000_0000_0000;
/// `2^52`, by which a subnormal number becomes a normal one.
const TO_NORMAL: f64 = 4503599627370496.0;
/// `ln(2)` as the sum of two numbers, the first of which has bits to spare for products with an exponent.
pub(super) const LN_2: [f64; 2] = [0.6931471805598903, 5.497923018708371e-14];
/// Coefficients of `r^2`, `r^3`, ... of `ln(1 + r)` for r within a part.
const OF_LN: [f64; 5] = [
    -0.5000000000000001,
    0.33333333331825593,
    -0.2499999999622955,
    0.20000304511814496,
    -0.16667054827627667,
];
/// The same for r from -1/16 to 0.065.
const OF_LN_NEAR_ONE: [f64; 11] = [
    -0.5,
    0.3333333333333352,
    -0.24999999999998432,
    0.19999999999320328,
    -0.16666666669929706,
    0.14285715076560868,
    -0.12499997863982555,
    0.11110712032936046,
    -0.10000486757818193,
    0.09181994006195467,
    -0.08328363062289341,
];
/// `1 / ln(2)` as the sum of two numbers.
const ONE_BY_LN_2: [f64; 2] = [1.4426950407214463, 1.6751713164886512e-10];
/// Coefficients of `r^2`, `r^3`, ... of `log2(1 + r)` for r within a part.
const OF_LOG2: [f64; 6] = [
    -0.7213475204444882,
    0.4808983469629985,
    -0.36067375954075914,
    0.2885390073180969,
    -0.2404693555628422,
    0.2061202382173603,
];
/// The same for r from -0.042 to 0.044.
const OF_LOG2_NEAR_ONE: [f64; 10] = [
    -0.7213475204444817,
    0.48089834696298744,
    -0.360673760222145,
    0.2885390081805197,
    -0.24044917405728863,
    0.2060992861022954,
    -0.18033596705327856,
    0.1603032746063156,
    -0.14483316576701266,
    0.13046826811283835,
];

/// A positive number as `2^k z`, with the number of the part of z among `2^bits`.
#[inline(always)]
pub(super) fn split(bits_of_x: u64, least: u64, bits: u32) -> (usize, f64, f64) {
    let beyond = bits_of_x.wrapping_sub(least);
    let part = (beyond >> (52 - bits)) as usize % (1 << bits);
    let k = (beyond.cast_signed() >> 52) as i32;
    (part, f64::from(k), f64::from_bits(bits_of_x.wrapping_sub(beyond & (0xfff << 52))))
}

/// The bits of a positive number, as if exponents below those of normal numbers could be written.
#[inline(always)]
pub(super) fn bits_of(x: f64) -> u64 {
    if x < f64::MIN_POSITIVE { (x * TO_NORMAL).to_bits().wrapping_sub(52 << 52) } else { x.to_bits() }
}

/// The logarithm of what is no positive number.
#[cold]
fn of_other(x: f64) -> f64 {
    if x == 0.0 {
        f64::NEG_INFINITY
    } else if x == f64::INFINITY {
        x
    } else {
        f64::NAN
    }
}

#[inline(always)]
pub(super) fn ln(x: f64) -> f64 {
    if !(x > 0.0 && x < f64::INFINITY) {
        return of_other(x);
    }
    let bits = bits_of(x);
    if bits.wrapping_sub(0x3fee_0000_0000_0000) < 0x0003_0900_0000_0000 {
        return ln_near_one(x);
    }
    let (part, k, z) = split(bits, LEAST, 7);
    let (one_by_c, ln_c) = LN[part];
    let r = z.mul_add(one_by_c, -1.0);
    let whole = k.mul_add(LN_2[0], ln_c);
    let high = whole + r;
    let low = k.mul_add(LN_2[1], whole - high + r);
    let r2 = r * r;
    let a = &OF_LN;
    let polynomial = r.mul_add(a[4], a[3]).mul_add(r2, r.mul_add(a[2], a[1]));
    (r * r2).mul_add(polynomial, r2.mul_add(a[0], low)) + high
}

#[inline(always)]
fn ln_near_one(x: f64) -> f64 {
    if x == 1.0 {
        return 0.0;
    }
    let b = &OF_LN_NEAR_ONE;
    let r = x - 1.0;
    let r2 = r * r;
    let r3 = r * r2;
    let first = r2.mul_add(b[3], r.mul_add(b[2], b[1]));
    let second = r2.mul_add(b[6], r.mul_add(b[5], b[4]));
    let third = r3.mul_add(b[10], r2.mul_add(b[9], r.mul_add(b[8], b[7])));
    let polynomial = third.mul_add(r3, second).mul_add(r3, first);
    // The leading bits of r, whose square is exact.
    let shift = f64::from_bits(0x41a0_0000_0000_0000);
    let leading = (-shift).mul_add(r, r.mul_add(shift, r));
    let square = leading * leading;
    let high = square.mul_add(b[0], r);
    let low = square.mul_add(b[0], r - high);
    let low = (b[0] * (r - leading)).mul_add(r + leading, low);
    high + polynomial.mul_add(r3, low)
}

#[inline(always)]
pub(super) fn log2(x: f64) -> f64 {
    if !(x > 0.0 && x < f64::INFINITY) {
        return of_other(x);
    }
    let bits = bits_of(x);
    if bits.wrapping_sub(0x3fee_a4af_0000_0000) < 0x0002_10aa_0000_0000 {
        return log2_near_one(x);
    }
    let (part, k, z) = split(bits, LEAST, 6);
    let (one_by_c, log2_c) = LOG2[part];
    let r = z.mul_add(one_by_c, -1.0);
    let [first, rest] = by_ln_2(r);
    let whole = k + log2_c;
    let high = first + whole;
    let low = whole - high + first + rest;
    let r2 = r * r;
    let a = &OF_LOG2;
    let polynomial =
        r.mul_add(a[5], a[4]).mul_add(r2 * r2, r.mul_add(a[3], a[2]).mul_add(r2, r.mul_add(a[1], a[0])));
    r2.mul_add(polynomial, low) + high
}

#[inline(always)]
fn log2_near_one(x: f64) -> f64 {
    if x == 1.0 {
        return 0.0;
    }
    let b = &OF_LOG2_NEAR_ONE;
    let r = x - 1.0;
    let [first, rest] = by_ln_2(r);
    let r2 = r * r;
    let r4 = r2 * r2;
    let leading = r.mul_add(b[1], b[0]);
    let high = leading.mul_add(r2, first);
    let low = leading.mul_add(r2, first - high) + rest;
    let middle = r.mul_add(b[5], b[4]).mul_add(r2, r.mul_add(b[3], b[2]));
    let last = r.mul_add(b[9], b[8]).mul_add(r2, r.mul_add(b[7], b[6]));
    high + last.mul_add(r4, middle).mul_add(r4, low)
}

/// `r / ln(2)` as the sum of two numbers.
#[inline(always)]
fn by_ln_2(r: f64) -> [f64; 2] {
    let high = ONE_BY_LN_2[0] * r;
    [high, r.mul_add(ONE_BY_LN_2[1], ONE_BY_LN_2[0].mul_add(r, -high))]
}
