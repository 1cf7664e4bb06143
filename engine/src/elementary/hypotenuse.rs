//! The length of a vector in the plane, by Borges, An improved algorithm for hypot(a,b), ACM TOMS 47 (2021) 9,
//! DOI 10.1145/3428446: the square root, corrected once. The GNU C library has it as well.

/// Below this share of the longer side, the shorter one changes no digit of the sum of the two.
const NEGLIGIBLE: f64 = f64::EPSILON / 4.0;
/// Squares of longer and of shorter sides need not be normal numbers: `2^511` and `2^-459`.
const USUAL: [f64; 2] = [f64::from_bits(0x5fe0_0000_0000_0000), f64::from_bits(0x2340_0000_0000_0000)];
/// What takes sides from far above or below into the usual range: `2^600`.
const SCALE: f64 = f64::from_bits(0x6570_0000_0000_0000);

/// The square root of `long^2 + short^2` for positive sides of usual sizes.
#[inline]
fn corrected(long: f64, short: f64) -> f64 {
    let root = (long * long + short * short).sqrt();
    let error = if root <= 2.0 * short {
        let beyond = root - short;
        long * (2.0 * beyond - long) + (beyond - 2.0 * (long - short)) * beyond
    } else {
        let beyond = root - long;
        2.0 * beyond * (long - 2.0 * short) + ((4.0 * beyond - short) * short + beyond * beyond)
    };
    root - error / (2.0 * root)
}

#[inline]
pub(super) fn hypot(x: f64, y: f64) -> f64 {
    let (x, y) = (x.abs(), y.abs());
    if x.is_infinite() || y.is_infinite() {
        return f64::INFINITY;
    }
    let (long, short) = if x < y { (y, x) } else { (x, y) };
    if short <= long * NEGLIGIBLE {
        long + short
    } else if long > USUAL[0] {
        corrected(long / SCALE, short / SCALE) * SCALE
    } else if short < USUAL[1] {
        corrected(long * SCALE, short * SCALE) / SCALE
    } else {
        corrected(long, short)
    }
}
