//! Numbers as text, fast: ten significant digits as C's `%.10g` has them, and whole numbers.

/// Powers of ten that are exact.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18,
    1e19, 1e20, 1e21, 1e22,
];
/// All numbers of two digits.
const PAIRS: [[u8; 2]; 100] = pairs();
const DIGITS: i32 = 10;
const FULL: u64 = 10_000_000_000;
/// From here on, doubles are integers.
const INTEGERS: f64 = (1_u64 << 52) as f64;
/// What [`push_number`] and [`push_whole`] write beyond the text that they append, and take back.
pub(super) const SPARE_BYTES: usize = 32;

const fn pairs() -> [[u8; 2]; 100] {
    let mut pairs = [[0; 2]; 100];
    let mut i = 0;
    while i < 100 {
        pairs[i] = [b'0' + (i / 10) as u8, b'0' + (i % 10) as u8];
        i += 1;
    }
    pairs
}

/// Appends a number with ten significant digits, without zeros at the end. The last digit is rounded after one
/// multiplication, so a number within 1e-16 of half way may go to either side.
pub(super) fn push_number(text: &mut Vec<u8>, x: f64) {
    if x == 0.0 {
        text.push(b'0');
        return;
    }
    let a = x.abs();
    let mut exponent = exponent_of(a);
    let shift = DIGITS - 1 - exponent;
    let scaled = match usize::try_from(shift) {
        Ok(up) if up < POWERS.len() => a * POWERS[up],
        Err(_) if exponent < POWERS.len() as i32 - 1 => a / POWERS[-shift as usize],
        // Numbers beyond these bounds are rare and take the general conversion.
        _ => {
            text.extend_from_slice(zmij::Buffer::new().format(x).as_bytes());
            return;
        }
    };
    // A sum of this size has no digits after the point; it is rounded as `round_ties_even` does it, without a call.
    let mut value = (scaled + INTEGERS).to_bits() - INTEGERS.to_bits();
    if value >= FULL {
        value /= 10;
        exponent += 1;
    }
    // Everything is copied in pieces of fixed length, of which a part counts: that takes no calls either.
    let mut digits = [b'0'; 2 * DIGITS as usize];
    // Halves of five digits are numbers of 32 bits.
    let (high, low) = ((value / 100_000) as u32, (value % 100_000) as u32);
    put_five(&mut digits[..5], high);
    put_five(&mut digits[5..10], low);
    let used = digits.iter().rposition(|&digit| digit != b'0').map_or(1, |last| last + 1);
    let mut piece = [b'-'; SPARE_BYTES];
    let start = usize::from(x < 0.0);
    let mut put = |at: usize, ten: &[u8]| piece[start + at..][..10].copy_from_slice(&ten[..10]);
    let length = if (0..DIGITS).contains(&exponent) {
        let whole = exponent as usize + 1;
        put(0, &digits);
        if used > whole {
            put(whole + 1, &digits[whole..]);
            piece[start + whole] = b'.';
            used + 1
        } else {
            whole
        }
    } else if (-4..0).contains(&exponent) {
        let zeros = (1 - exponent) as usize;
        put(0, b"0.00000000");
        put(zeros, &digits);
        zeros + used
    } else {
        put(0, &digits);
        let mut at = start + used;
        if used > 1 {
            put(2, &digits[1..]);
            piece[start + 1] = b'.';
            at += 1;
        }
        let [tens, ones] = PAIRS[exponent.unsigned_abs() as usize];
        let sign = if exponent < 0 { b'-' } else { b'+' };
        piece[at..at + 4].copy_from_slice(&[b'e', sign, tens, ones]);
        at + 4 - start
    };
    let end = text.len() + start + length;
    text.extend_from_slice(&piece);
    text.truncate(end);
}

fn put_five(digits: &mut [u8], value: u32) {
    let (pairs, last) = (value / 10, value % 10);
    digits[..2].copy_from_slice(&PAIRS[(pairs / 100) as usize]);
    digits[2..4].copy_from_slice(&PAIRS[(pairs % 100) as usize]);
    digits[4] = b'0' + last as u8;
}

/// Decimal exponent of a positive number, as far as the exact powers go.
fn exponent_of(a: f64) -> i32 {
    let binary = ((a.to_bits() >> 52) & 0x7ff) as i32 - 1023;
    // log10(2) in 1/2^20, rounded down; the result is the exponent or one less.
    let exponent = (binary * 315_652) >> 20;
    let at_next = match exponent + 1 {
        next @ 0..=22 => a >= POWERS[next as usize],
        next @ -22..=-1 => a * POWERS[-next as usize] >= 1.0,
        _ => false,
    };
    exponent + i32::from(at_next)
}

/// Appends a number with as many digits as it takes to read it back exactly; zero without a sign.
pub(super) fn push_exact(text: &mut Vec<u8>, x: f64) {
    text.extend_from_slice(zmij::Buffer::new().format_finite(x + 0.0).as_bytes());
}

/// A number with this number of decimals; what rounds to zero has no sign.
pub(super) fn fixed(x: f64, decimals: usize) -> String {
    let text = format!("{x:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().all(|c| c == b'0' || c == b'.') => digits.to_owned(),
        _ => text,
    }
}

/// Appends a whole number.
pub(super) fn push_whole(text: &mut Vec<u8>, mut value: u64) {
    const MOST: usize = 20;
    // Copied as one piece of fixed length, of which a part counts, as above.
    let mut digits = [0_u8; 2 * MOST];
    let mut at = MOST;
    let mut put = |pair: usize| {
        at -= 2;
        digits[at..at + 2].copy_from_slice(&PAIRS[pair]);
    };
    while value > u64::from(u32::MAX) {
        put((value % 100) as usize);
        value /= 100;
    }
    // Numbers of 32 bits are divided faster.
    let mut value = value as u32;
    while value >= 100 {
        put((value % 100) as usize);
        value /= 100;
    }
    put(value as usize);
    at += usize::from(value < 10);
    let end = text.len() + MOST - at;
    text.extend_from_slice(&digits[at..at + MOST]);
    text.truncate(end);
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use crate::properties::properties;
    use proptest::prelude::*;

    use super::*;
    fn number(x: f64) -> String {
        let mut text = Vec::new();
        push_number(&mut text, x);
        String::from_utf8(text).unwrap()
    }

    #[test]
    fn zero_has_no_sign() {
        for (x, decimals, expected) in [
            (-0.0, 4, "0.0000"),
            (-0.000_04, 4, "0.0000"),
            (-0.000_06, 4, "-0.0001"),
            (-0.4, 0, "0"),
            (-12.5, 1, "-12.5"),
            (0.04, 1, "0.0"),
        ] {
            assert_eq!(fixed(x, decimals), expected);
        }
        let mut text = Vec::new();
        push_exact(&mut text, -0.0);
        assert_eq!(text, b"0.0");
    }

    #[test]
    fn numbers_look_like_those_of_c() {
        for (x, expected) in [
            (0.0, "0"),
            (-0.0, "0"),
            (1.0, "1"),
            (-150.0, "-150"),
            (0.1, "0.1"),
            (1.0 / 3.0, "0.3333333333"),
            (2.0e3 / 3.0, "666.6666667"),
            (9_999_999_999.4, "9999999999"),
            (9_999_999_999.6, "1e+10"),
            (0.000_123_456_789_012, "0.000123456789"),
            (0.000_012_345_678_901_2, "1.23456789e-05"),
            (-1.5e-12, "-1.5e-12"),
            (0.999_999_999_99, "1"),
            (1e300, "1e+300"),
        ] {
            assert_eq!(number(x), expected, "{x:e}");
        }
    }

    properties! {
        #[test]
        fn numbers_read_back_to_ten_digits(x in prop::num::f64::NORMAL) {
            let read: f64 = number(x).parse().unwrap();
            prop_assert!(((read - x) / x).abs() <= 5.000_001e-10, "{x:e} became {read:e}");
        }

        #[test]
        fn lengths_are_rounded_as_the_library_rounds(x in -1.0e4..1.0e4_f64) {
            let rounded: f64 = format!("{x:.9e}").parse().unwrap();
            prop_assert_eq!(number(x).parse::<f64>().unwrap(), rounded);
        }

        #[test]
        fn whole_numbers_read_back(x in any::<u64>(), shift in 0_u32..64) {
            let x = x >> shift;
            let mut text = Vec::new();
            push_whole(&mut text, x);
            prop_assert_eq!(String::from_utf8(text).unwrap(), x.to_string());
        }
    }
}
