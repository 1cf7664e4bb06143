//! Lines of JSON that tell whether a byte of them has changed: the first member of each object, `crc32`, is the CRC-32
//! of the text after this member and its comma, as eight hexadecimal digits.

use std::io;

use serde::Serialize;
use serde::de::DeserializeOwned;

/// What a line begins with, before the digits of its sum and after them.
const SUM: (&[u8], &[u8]) = (b"{\"crc32\":\"", b"\",");
/// Digits of a sum.
const DIGITS: usize = 8;

/// A value that is an object as JSON, as a line with its end.
///
/// # Errors
/// The value cannot be written as JSON.
pub(super) fn line(value: &impl Serialize) -> io::Result<String> {
    let text = serde_json::to_string(value)?;
    let members = text.strip_prefix('{').unwrap_or(&text);
    Ok(format!("{{\"crc32\":\"{}\",{members}\n", sum(members.as_bytes())))
}

/// The value of a line without its end.
///
/// # Errors
/// What is wrong with the line.
pub(super) fn read<T: DeserializeOwned>(line: &[u8]) -> Result<T, String> {
    let Some(rest) = line.strip_prefix(SUM.0) else {
        return Err("it does not begin with its sum: it is of an earlier version, or damaged".into());
    };
    let found = rest.split_at_checked(DIGITS);
    let found = found.and_then(|(digits, rest)| Some((digits, rest.strip_prefix(SUM.1)?)));
    let found = found.filter(|(digits, members)| *digits == sum(members).as_bytes());
    let Some((_, members)) = found else {
        return Err("it is damaged: its bytes do not have the sum that it begins with".into());
    };
    serde_json::from_slice(&[b"{", members].concat()).map_err(|error| error.to_string())
}

fn sum(bytes: &[u8]) -> String {
    format!("{:0DIGITS$x}", crc32fast::hash(bytes))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    #[test]
    fn a_line_has_the_sum_of_its_members() {
        let value = json!({"point": 3, "name": "Gr\u{f6}\u{df}e"});
        let text = line(&value).unwrap();
        // By zlib: zlib.crc32('"point":3,"name":"Größe"}'.encode()).
        assert_eq!(text, "{\"crc32\":\"0012986d\",\"point\":3,\"name\":\"Größe\"}\n");
        assert_eq!(read::<Value>(text.trim_end().as_bytes()).unwrap(), value);
    }

    #[test]
    fn a_flipped_bit_is_found() {
        let text = line(&json!({"point": 3, "facts": {"time_s": 0.25}})).unwrap();
        let text = text.trim_end().as_bytes();
        for bit in 0..8 * text.len() {
            let mut flipped = text.to_vec();
            flipped[bit / 8] ^= 1 << (bit % 8);
            let refused = read::<Value>(&flipped).unwrap_err();
            assert!(refused.contains("its sum") || refused.contains("the sum"), "{refused}");
        }
        assert!(read::<Value>(br#"{"point":3}"#).unwrap_err().contains("an earlier version"));
    }
}
