//! Powers of any number: `x^y = e^(y ln(x))`, with the logarithm as the sum of two numbers, 68 bits in all.

use super::exponential::signed_exp;
use super::logarithm::{LN_2, bits_of, split};
use super::tables::LN_OF_POWER;

/// The least significand of the table, 0.699.
const LEAST: u64 = 0x3fe6_9555_0000_0000;
/// Coefficients of `r^2`, `r^3`, ... of `ln(1 + r)`, from `r^3` on divided by -1/2, from `r^5` on by 1/4, from `r^7`
/// on by -1/8, as the products with `r^2` below are.
const OF_LN: [f64; 7] = [
    -0.5,
    -0.6666666666666679,
    0.5000000000000007,
    0.7999999995323976,
    -0.6666666663487739,
    -1.142909628459501,
    1.0000415263675542,
];

/// The logarithm of a positive number as the sum of two, from its bits.
#[inline(always)]
fn ln(bits: u64) -> [f64; 2] {
    let (part, k, z) = split(bits, LEAST, 7);
    let (one_by_c, ln_c, rest_of_ln_c) = LN_OF_POWER[part];
    let r = z.mul_add(one_by_c, -1.0);
    let whole = k.mul_add(LN_2[0], ln_c);
    let with_r = whole + r;
    let low_1 = k.mul_add(LN_2[1], rest_of_ln_c);
    let low_2 = whole - with_r + r;
    let a = &OF_LN;
    let ar = a[0] * r;
    let ar2 = r * ar;
    let ar3 = r * ar2;
    let high = with_r + ar2;
    let low_3 = ar.mul_add(r, -ar2);
    let low_4 = with_r - high + ar2;
    let last = r.mul_add(a[6], a[5]).mul_add(ar2, r.mul_add(a[4], a[3]));
    let polynomial = ar2.mul_add(last, r.mul_add(a[2], a[1]));
    let low = ar3.mul_add(polynomial, low_1 + low_2 + low_3 + low_4);
    let sum = high + low;
    [sum, high - sum + low]
}

#[inline(always)]
pub(super) fn powf(x: f64, y: f64) -> f64 {
    if (f64::MIN_POSITIVE..f64::INFINITY).contains(&x) && has_usual_size(y) {
        of_positive(x.to_bits(), y, false)
    } else {
        of_other(x, y)
    }
}

/// Whether powers of numbers other than one with this exponent may be neither 1 nor 0 nor infinite.
#[inline(always)]
fn has_usual_size(y: f64) -> bool {
    let size = y.abs();
    size >= f64::from_bits(0x3be0_0000_0000_0000) && size < f64::from_bits(0x43e0_0000_0000_0000)
}

/// The power where x is no positive normal number, or y is so small or large that the power is rounded to a limit.
#[cold]
fn of_other(x: f64, y: f64) -> f64 {
    if y == 0.0 || x == 1.0 {
        return 1.0;
    }
    if x.is_nan() || y.is_nan() {
        return f64::NAN;
    }
    let size = x.abs();
    if x < 0.0 && size.is_finite() && y.trunc() != y {
        return f64::NAN;
    }
    let is_negative = x.is_sign_negative() && (y % 2.0).abs() == 1.0;
    let sign = if is_negative { -1.0 } else { 1.0 };
    if size == 0.0 || size.is_infinite() {
        sign * if (size > 1.0) == (y > 0.0) { f64::INFINITY } else { 0.0 }
    } else if has_usual_size(y) {
        of_positive(bits_of(size), y, is_negative)
    } else if y.abs() < 1.0 || size == 1.0 {
        1.0
    } else if (size > 1.0) == (y > 0.0) {
        f64::INFINITY
    } else {
        0.0
    }
}

/// The power of a positive number, given by its bits, with a sign.
#[inline(always)]
fn of_positive(bits: u64, y: f64, is_negative: bool) -> f64 {
    let [high, low] = ln(bits);
    let product = y * high;
    signed_exp(product, y.mul_add(low, y.mul_add(high, -product)), is_negative)
}
