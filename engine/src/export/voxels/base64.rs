//! Base64 (RFC 4648) of a stream of bytes.

use std::io::{self, Write};

const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
/// The two digits of every twelve bits, half of a group.
static PAIRS: [[u8; 2]; 1 << 12] = pairs();

const fn pairs() -> [[u8; 2]; 1 << 12] {
    let mut pairs = [[0; 2]; 1 << 12];
    let mut bits = 0;
    while bits < pairs.len() {
        pairs[bits] = [ALPHABET[bits >> 6], ALPHABET[bits & 63]];
        bits += 1;
    }
    pairs
}

/// Bytes that are encoded at a time, a multiple of three.
const BLOCK_BYTES: usize = 3 << 14;

/// Number of characters of a number of bytes.
pub(super) fn length(bytes: u64) -> u64 {
    bytes.div_ceil(3).saturating_mul(4)
}

/// Encodes what is written to it. [`Base64::finish`] ends the text.
pub(super) struct Base64<'a> {
    out: &'a mut dyn Write,
    bytes: Vec<u8>,
    text: Vec<u8>,
}

impl<'a> Base64<'a> {
    pub(super) fn new(out: &'a mut dyn Write) -> Self {
        Self { out, bytes: Vec::new(), text: Vec::new() }
    }

    fn encode(&mut self) -> io::Result<()> {
        self.text.clear();
        self.text.resize(self.bytes.len().div_ceil(3) * 4, b'=');
        let groups = self.bytes.chunks_exact(3);
        let rest = groups.remainder();
        let mut digits = self.text.chunks_exact_mut(4);
        for (group, digits) in groups.zip(&mut digits) {
            let bits = (usize::from(group[0]) << 16) | (usize::from(group[1]) << 8) | usize::from(group[2]);
            digits[..2].copy_from_slice(&PAIRS[bits >> 12]);
            digits[2..].copy_from_slice(&PAIRS[bits & 0xfff]);
        }
        if let (Some(first), Some(digits)) = (rest.first(), digits.next()) {
            let second = rest.get(1).copied().unwrap_or(0);
            let bits = (usize::from(*first) << 16) | (usize::from(second) << 8);
            digits[..2].copy_from_slice(&PAIRS[bits >> 12]);
            if rest.len() == 2 {
                digits[2] = PAIRS[bits & 0xfff][0];
            }
        }
        self.bytes.clear();
        self.out.write_all(&self.text)
    }

    /// Writes what is left, with padding.
    pub(super) fn finish(mut self) -> io::Result<()> {
        self.encode()
    }
}

impl Write for Base64<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = bytes.len().min(BLOCK_BYTES - self.bytes.len());
        self.bytes.extend_from_slice(&bytes[..taken]);
        if self.bytes.len() == BLOCK_BYTES {
            self.encode()?;
        }
        Ok(taken)
    }

    /// Nothing: only whole groups are encoded before the end.
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn encoded<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> String {
        let mut text = Vec::new();
        let mut encoder = Base64::new(&mut text);
        for part in parts {
            encoder.write_all(part).unwrap();
        }
        encoder.finish().unwrap();
        String::from_utf8(text).unwrap()
    }

    /// The vectors of RFC 4648, section 10.
    #[test]
    fn texts_are_those_of_the_standard() {
        let vectors = [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ];
        for (bytes, text) in vectors {
            assert_eq!(encoded([bytes.as_bytes()]), text);
            assert_eq!(length(bytes.len() as u64), text.len() as u64);
        }
        assert_eq!(encoded([&[0xff, 0xfe, 0x3f, 0xfb][..]]), "//4/+w==");
    }

    #[test]
    fn parts_of_any_length_give_the_same_text() {
        let bytes: Vec<u8> = (0..2 * BLOCK_BYTES + 7).map(|i| (i * 31 % 251) as u8).collect();
        let whole = encoded([bytes.as_slice()]);
        assert_eq!(whole.len() as u64, length(bytes.len() as u64));
        for part in [1, 2, 1000, BLOCK_BYTES - 1] {
            assert!(encoded(bytes.chunks(part)) == whole, "{part}");
        }
    }
}
