//! From the bytes of an input to a text or to the tables of a workbook.

use encoding_rs::{Encoding, UTF_8, UTF_16BE, UTF_16LE, WINDOWS_1252};

use super::table::Table;
use super::{Note, Refusal, workbook};

/// Most bytes of a text.
pub const MAX_TEXT_BYTES: usize = 1 << 20;

/// What bytes are.
#[derive(Debug, PartialEq)]
pub(super) enum Source {
    Text(String),
    Workbook(Vec<Table>, Vec<Note>),
}

/// Tells a workbook from a text by its first bytes, and the encoding of a text by its mark, its zeros and whether it is
/// UTF-8.
///
/// # Errors
/// [`Refusal`] where it is neither, or above the limits.
pub(super) fn source(bytes: &[u8], sheet: Option<&str>) -> Result<Source, Refusal> {
    if bytes.starts_with(b"PK\x03\x04") {
        let (tables, notes) = workbook::tables(bytes, sheet)?;
        return Ok(Source::Workbook(tables, notes));
    }
    if bytes.starts_with(b"%PDF") {
        return Err(Refusal::new("is a PDF: mark the table in it, copy it, and paste its text"));
    }
    if bytes.starts_with(&[0xd0, 0xcf, 0x11, 0xe0]) {
        return Err(Refusal::new("is a workbook of the old form .xls: save it as .xlsx, .ods or .csv"));
    }
    if bytes.len() > MAX_TEXT_BYTES {
        let bytes = bytes.len();
        return Err(Refusal::new(format!(
            "has {bytes} bytes: must have at most {MAX_TEXT_BYTES}; cut out the table"
        )));
    }
    let zeros = |from: usize| bytes.iter().skip(from).step_by(2).filter(|&&byte| byte == 0).count();
    let encoding = match Encoding::for_bom(bytes) {
        Some((encoding, _)) => encoding,
        None if 4 * zeros(1) > bytes.len() => UTF_16LE,
        None if 4 * zeros(0) > bytes.len() => UTF_16BE,
        None if std::str::from_utf8(bytes).is_ok() => UTF_8,
        None => WINDOWS_1252,
    };
    let (text, _, _) = encoding.decode(bytes);
    if text.chars().any(|c| c == '\0') {
        return Err(Refusal::new(
            "is neither a text nor a workbook (.xlsx, .ods): save the table as one of these",
        ));
    }
    if text.trim().is_empty() {
        return Err(Refusal::new("is empty: must have a table"));
    }
    Ok(Source::Text(text.replace("\r\n", "\n").replace('\r', "\n")))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_read_in_the_encodings_of_office_programs() {
        let text = "Größe µm;Durchgang\r\n63;2,5\r4;3";
        let expected = Source::Text("Größe µm;Durchgang\n63;2,5\n4;3".to_owned());
        let utf16: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let utf16_be: Vec<u8> = text.encode_utf16().flat_map(u16::to_be_bytes).collect();
        let windows: Vec<u8> = text.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
        for bytes in [
            text.as_bytes().to_vec(),
            [b"\xef\xbb\xbf", text.as_bytes()].concat(),
            utf16.clone(),
            [b"\xff\xfe", &utf16[..]].concat(),
            utf16_be,
            windows,
        ] {
            assert_eq!(source(&bytes, None).as_ref(), Ok(&expected), "{bytes:?}");
        }
    }
}
