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
/// What [`push_number`] writes beyond the text that it appends, and takes back.
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

/// Appends a number with as many digits as it takes to read it back exactly.
pub(super) fn push_exact(text: &mut Vec<u8>, x: f64) {
    text.extend_from_slice(zmij::Buffer::new().format_finite(x).as_bytes());
}

/// Appends a whole number.
pub(super) fn push_whole(text: &mut Vec<u8>, mut value: u64) {
    let mut digits = [0_u8; 20];
    let mut at = digits.len();
    loop {
        at -= 1;
        digits[at] = b'0' + (value % 10) as u8;
        value /= 10;
        if value == 0 {
            break;
        }
    }
    text.extend_from_slice(&digits[at..]);
}
