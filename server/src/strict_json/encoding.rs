//! The encoding of a text: UTF-8 is read, every other is named.

/// What UTF-8 may begin with.
const UTF8_MARK: &[u8] = b"\xEF\xBB\xBF";

/// A text in UTF-8 without its byte order mark.
///
/// # Errors
/// The encoding that the text seems to have, in one sentence.
pub(super) fn utf8(text: &[u8]) -> Result<&[u8], String> {
    let text = &text[byte_order_mark(text)?..];
    let Err(error) = std::str::from_utf8(text) else { return Ok(text) };
    let at = error.valid_up_to();
    let before = &text[..at];
    let line = before.split(|byte| *byte == b'\n').count();
    let column = 1 + before.iter().rev().take_while(|byte| **byte != b'\n').count();
    let place = format!("byte 0x{:02X} at line {line}, column {column}", text[at]);
    if error.error_len().is_none() {
        return Err(format!("the text ends within a character of UTF-8, with {place}: its end is missing"));
    }
    // A letter of Latin-1 stands alone among others, which are ASCII in most languages.
    let is_alone = text.get(at + 1).is_none_or(u8::is_ascii);
    let seems = if is_alone { ", as in a text of Latin-1 (ISO 8859-1 or Windows-1252)" } else { "" };
    Err(format!("the text is not UTF-8: {place} is none of it{seems}; save it as UTF-8"))
}

/// Length of the byte order mark that a text in UTF-8 begins with.
///
/// # Errors
/// The text is in UTF-16 or UTF-32, by its mark or by its zero bytes: a document begins with a character of ASCII.
pub(super) fn byte_order_mark(text: &[u8]) -> Result<usize, String> {
    let is_zero = |i: usize| text.get(i).map(|byte| *byte == 0);
    let zeros = [0, 1, 2, 3].map(is_zero);
    let name = match (text, zeros) {
        _ if text.starts_with(UTF8_MARK) => return Ok(UTF8_MARK.len()),
        ([0xFF, 0xFE, 0, 0, ..], _) | (_, [Some(false), Some(true), Some(true), Some(true)]) => {
            "UTF-32 (little-endian)"
        }
        ([0, 0, 0xFE, 0xFF, ..], _) | (_, [Some(true), Some(true), Some(true), Some(false)]) => {
            "UTF-32 (big-endian)"
        }
        ([0xFF, 0xFE, ..], _) | (_, [Some(false), Some(true), None | Some(false), _]) => {
            "UTF-16 (little-endian)"
        }
        ([0xFE, 0xFF, ..], _) | (_, [Some(true), Some(false), None | Some(true), _]) => "UTF-16 (big-endian)",
        _ => return Ok(0),
    };
    Err(format!("the text is encoded in {name}: must be UTF-8 (PowerShell: -Encoding utf8)"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_encoding_but_utf_8_is_named() {
        let text = "{\"name\": \"Würfel Ø50\"}";
        assert_eq!(utf8(text.as_bytes()), Ok(text.as_bytes()));
        assert_eq!(utf8(format!("\u{feff}{text}").as_bytes()), Ok(text.as_bytes()));
        assert_eq!(utf8(b""), Ok(&b""[..]));
        let units = || text.encode_utf16();
        let chars = || text.chars().map(u32::from);
        let le16: Vec<u8> = units().flat_map(u16::to_le_bytes).collect();
        let be16: Vec<u8> = units().flat_map(u16::to_be_bytes).collect();
        let le32: Vec<u8> = chars().flat_map(u32::to_le_bytes).collect();
        let be32: Vec<u8> = chars().flat_map(u32::to_be_bytes).collect();
        for (name, mark, bytes) in [
            ("UTF-16 (little-endian)", &b"\xFF\xFE"[..], &le16),
            ("UTF-16 (big-endian)", b"\xFE\xFF", &be16),
            ("UTF-32 (little-endian)", b"\xFF\xFE\0\0", &le32),
            ("UTF-32 (big-endian)", b"\0\0\xFE\xFF", &be32),
        ] {
            for bytes in [bytes.clone(), [mark, bytes].concat()] {
                let refused = utf8(&bytes).unwrap_err();
                assert!(refused.contains(name), "{name}: {refused}");
            }
        }
        assert!(utf8(b"1\0").unwrap_err().contains("UTF-16 (little-endian)"));
        let latin: Vec<u8> = text.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
        let refused = utf8(&latin).unwrap_err();
        assert!(refused.contains("Latin-1") && refused.contains("0xFC at line 1, column 12"), "{refused}");
        assert!(utf8(&"{\"ü".as_bytes()[..3]).unwrap_err().contains("ends within a character"));
    }
}
