//! Parses JSON into a value, and reports the place and the reason of a fault.
//!
//! The text is UTF-8 (RFC 8259, section 8.1), with or without a byte order mark. A text in another encoding is refused
//! with the name of that encoding.
//!
//! Stricter than [`serde_json::Value`]: a key that occurs twice is refused, because one of the two values would be lost
//! without notice. Every fault has the JSON pointer (RFC 6901) of its place. The memory of the value is bounded by the
//! length of the text, and in all: a value takes 72 bytes and as little as two bytes of text, an object or array about
//! 400 bytes and as little as four bytes of text, a key or a string at least 32 bytes beside its value. Small blocks
//! are bounded most, because an allocator returns them late to the system.

mod encoding;

use std::cell::Cell;
use std::fmt;
use std::io::{self, BufRead};

use packstone_engine::FieldError;
use packstone_engine::request::decode::pointer_segment;
use serde::de::{DeserializeOwned, DeserializeSeed, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value};
use serde_path_to_error::{Path, Segment};

use crate::failure::{Failure, FailureCode};

/// The pointer of a fault is not built further than this.
const MAX_POINTER_CHARS: usize = 256;
/// Most values of a document.
const MAX_VALUES: usize = 4_000_000;
/// Most values of a document of any length.
const VALUES: usize = 100_000;
/// One more value is allowed for so many bytes of text.
const BYTES_PER_VALUE: usize = 4;
/// Most objects and arrays of a document of any length.
const CONTAINERS: usize = 20_000;
/// One more object or array is allowed for so many bytes of text.
const BYTES_PER_CONTAINER: usize = 16;
/// Most objects and arrays of a document: a study of 10 000 jobs has up to 20 for each.
const MAX_CONTAINERS: usize = 250_000;
/// Most keys and strings of a document.
const MAX_TEXTS: usize = 1_000_000;

/// Parses one JSON document.
///
/// # Errors
/// `malformed-json` if the text is not JSON; `validation-error` if it is JSON, but a number is too large for a 64-bit
/// float, a key comes twice, or the document is nested too deep or has too many values.
pub(crate) fn parse(text: &[u8]) -> Result<Value, Failure> {
    let text = encoding::utf8(text).map_err(malformed)?;
    let mut json = serde_json::Deserializer::from_slice(text);
    let mut track = serde_path_to_error::Track::new();
    let most_values = (VALUES + text.len() / BYTES_PER_VALUE).min(MAX_VALUES);
    let room = Room {
        most_values,
        values: Cell::new(most_values),
        containers: Cell::new((CONTAINERS + text.len() / BYTES_PER_CONTAINER).min(MAX_CONTAINERS)),
        texts: Cell::new(MAX_TEXTS),
    };
    let value = Strict { room: &room }
        .deserialize(serde_path_to_error::Deserializer::new(&mut json, &mut track))
        .map_err(|error| refusal(text, &pointer(&track.path()), &error))?;
    json.end().map_err(|error| refusal(text, "", &error))?;
    Ok(value)
}

/// Reads a document of a known form from a file, which may be longer than what [`parse`] reads at once.
///
/// # Errors
/// Those of the file, and where the document is not of that form or in another encoding.
pub(crate) fn from_file<T: DeserializeOwned>(mut file: impl BufRead) -> io::Result<T> {
    let invalid = |detail: String| io::Error::new(io::ErrorKind::InvalidData, detail);
    let begin = file.fill_buf()?;
    let mark = encoding::byte_order_mark(begin).map_err(invalid)?;
    file.consume(mark);
    serde_json::from_reader(file).map_err(|error| {
        if error.to_string().contains("invalid unicode code point") {
            return invalid(format!("the text is not UTF-8 ({error})"));
        }
        error.into()
    })
}

fn malformed(detail: String) -> Failure {
    let mut failure = Failure::new(FailureCode::MalformedJson, detail.clone());
    failure.fields = vec![FieldError::new("", detail)];
    failure
}

fn refusal(text: &[u8], pointer: &str, error: &serde_json::Error) -> Failure {
    let message = error.to_string();
    let place = format!("line {}, column {}", error.line(), error.column());
    let semantic = |detail: String| Failure::invalid(vec![FieldError::new(pointer, detail)]);
    if message.starts_with("number out of range") {
        let number = token_at(text, error.line(), error.column());
        return semantic(format!(
            "{number} is out of range: a number must be at most 1.7976931348623157e308"
        ));
    }
    if message.starts_with("recursion limit exceeded") {
        return semantic(format!("{place}: the document is nested too deep: at most 127 levels are read"));
    }
    if error.is_data() {
        return semantic(message);
    }
    let what = message.split(" at line ").next().unwrap_or(&message);
    let token = token_at(text, error.line(), error.column());
    let found = if token.is_empty() { String::new() } else { format!("{token} is not JSON: ") };
    let detail = format!("{found}{what} at {place}");
    let mut failure = Failure::new(FailureCode::MalformedJson, detail.clone());
    failure.fields = vec![FieldError::new(pointer, detail)];
    failure
}

/// The word or number around a place, to be shown.
fn token_at(text: &[u8], line: usize, column: usize) -> String {
    let line = text.split(|b| *b == b'\n').nth(line.saturating_sub(1)).unwrap_or_default();
    let in_word = |b: &u8| b.is_ascii_alphanumeric() || b"+-._".contains(b);
    let at = column.saturating_sub(1).min(line.len());
    let before = line[..at].iter().rev().take_while(|b| in_word(b)).count();
    let after = line[at..].iter().take_while(|b| in_word(b)).count();
    String::from_utf8_lossy(&line[at - before..at + after]).chars().take(40).collect()
}

fn pointer(path: &Path) -> String {
    let mut pointer = String::new();
    for segment in path {
        match segment {
            Segment::Seq { index } => {
                pointer.push('/');
                pointer.push_str(&index.to_string());
            }
            Segment::Map { key } => {
                pointer.push('/');
                pointer.push_str(&pointer_segment(key));
            }
            Segment::Enum { .. } | Segment::Unknown => {}
        }
        if pointer.len() > MAX_POINTER_CHARS {
            break;
        }
    }
    pointer
}

/// How many more values, and among them objects and arrays, and how many more keys and strings a document may have.
struct Room {
    most_values: usize,
    values: Cell<usize>,
    containers: Cell<usize>,
    texts: Cell<usize>,
}

impl Room {
    fn take_value<E: serde::de::Error>(&self) -> Result<(), E> {
        let left = self.values.get().checked_sub(1);
        self.values.set(left.ok_or_else(|| {
            E::custom(format!(
                "the document has more than {} values: must have at most {VALUES} and one more for each \
                 {BYTES_PER_VALUE} bytes, {MAX_VALUES} in all",
                self.most_values
            ))
        })?);
        Ok(())
    }

    fn take_container<E: serde::de::Error>(&self) -> Result<(), E> {
        let left = self.containers.get().checked_sub(1);
        self.containers.set(left.ok_or_else(|| {
            E::custom(format!(
                "the document has too many objects and arrays: must have at most {CONTAINERS} and one more for \
                 each {BYTES_PER_CONTAINER} bytes, {MAX_CONTAINERS} in all"
            ))
        })?);
        Ok(())
    }

    fn take_text<E: serde::de::Error>(&self) -> Result<(), E> {
        let left = self.texts.get().checked_sub(1);
        self.texts.set(left.ok_or_else(|| {
            E::custom(format!("the document has too many keys and strings: must have at most {MAX_TEXTS}"))
        })?);
        Ok(())
    }
}

/// Builds a [`Value`], refuses keys that occur twice, and counts values.
#[derive(Clone, Copy)]
struct Strict<'a> {
    room: &'a Room,
}

impl<'de> DeserializeSeed<'de> for Strict<'_> {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        self.room.take_value()?;
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Strict<'_> {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("any JSON value")
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(Value::Bool(value))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E: serde::de::Error>(self, value: f64) -> Result<Value, E> {
        Number::from_f64(value).map(Value::Number).ok_or_else(|| E::custom("a number must be finite"))
    }

    fn visit_str<E: serde::de::Error>(self, value: &str) -> Result<Value, E> {
        self.room.take_text()?;
        Ok(value.into())
    }

    fn visit_string<E: serde::de::Error>(self, value: String) -> Result<Value, E> {
        self.room.take_text()?;
        Ok(value.into())
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        self.room.take_container()?;
        let mut array = Vec::new();
        while let Some(item) = items.next_element_seed(self)? {
            array.push(item);
        }
        // The first item makes room for four.
        array.shrink_to_fit();
        Ok(Value::Array(array))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Value, A::Error> {
        self.room.take_container()?;
        let mut object = Map::new();
        while let Some(key) = entries.next_key::<String>()? {
            self.room.take_text()?;
            if object.contains_key(&key) {
                let key: String = key.chars().take(40).collect();
                return Err(A::Error::custom(format!("the key {key:?} comes twice")));
            }
            let value = entries.next_value_seed(self)?;
            object.insert(key, value);
        }
        Ok(Value::Object(object))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use FailureCode::{MalformedJson, ValidationError};
    use serde_json::json;

    use super::*;

    fn refused(text: &str) -> (FailureCode, String, String) {
        let failure = parse(text.as_bytes()).unwrap_err();
        let fault = &failure.fields[0];
        (failure.code, fault.pointer.clone(), fault.detail.clone())
    }

    #[test]
    fn what_is_json_is_read_whole() {
        let text = r#"{"a": [1, -2, 3.5, 1e3, "ü", null, true, {}], "b": 18446744073709551615}"#;
        assert_eq!(parse(text.as_bytes()).unwrap(), serde_json::from_str::<Value>(text).unwrap());
        assert_eq!(parse(b" 1 ").unwrap(), json!(1));
        let marked = format!("\u{feff}{text}");
        assert_eq!(parse(marked.as_bytes()).unwrap(), parse(text.as_bytes()).unwrap());
        let name: Value = from_file(io::Cursor::new(marked)).unwrap();
        assert_eq!(name["b"], json!(18_446_744_073_709_551_615_u64));
        let refused = from_file::<Value>(io::Cursor::new(b"\xFF\xFE{\0}\0")).unwrap_err().to_string();
        assert!(refused.contains("UTF-16"), "{refused}");
        let refused = from_file::<Value>(io::Cursor::new(b"{\"a\": \"\xFC\"}")).unwrap_err().to_string();
        assert!(refused.contains("is not UTF-8"), "{refused}");
    }

    #[test]
    fn faults_carry_their_place_and_value() {
        let (code, pointer, detail) = refused(r#"{"mix": {"d_min_mm": NaN}}"#);
        assert_eq!((code, pointer.as_str()), (MalformedJson, "/mix/d_min_mm"));
        assert!(detail.starts_with("NaN is not JSON: expected"), "{detail}");
        let (code, pointer, detail) = refused("{\"mix\":\n {\"d\": [1, -1e999]}}");
        assert_eq!((code, pointer.as_str()), (ValidationError, "/mix/d/1"));
        assert!(detail.starts_with("-1e999 is out of range"), "{detail}");
        let (code, pointer, detail) = refused(r#"{"a": {"b~/": 1, "b~/": 2}}"#);
        assert_eq!(code, ValidationError);
        assert!(pointer.starts_with("/a"), "{pointer}");
        assert!(detail.starts_with("the key \"b~/\" comes twice"), "{detail}");
        for text in ["", "{", "[1,]", "{\"a\"}", "1 2", "{'a': 1}", "{\u{feff}}", "\"\u{1}\""] {
            assert_eq!(refused(text).0, MalformedJson, "{text}");
        }
        assert_eq!(parse(&[b'"', 0xff, b'"']).unwrap_err().code, MalformedJson);
    }

    #[test]
    fn the_number_of_values_is_bounded() {
        let list = |value: &str, n: usize| format!("[{}{value}]", format!("{value},").repeat(n - 1));
        // A hundred thousand and one more for two numbers of one digit: less than 200 000.
        assert!(parse(list("0", 199_990).as_bytes()).is_ok());
        let (code, _, detail) = refused(&list("0", 200_010));
        assert_eq!(code, ValidationError);
        assert!(
            detail.starts_with("the document has more than 200005 values: must have at most 100000 and"),
            "{detail}"
        );
        assert!(parse(list("0.5", MAX_VALUES - 1).as_bytes()).is_ok());
        let (_, _, detail) = refused(&list("0.5", MAX_VALUES));
        assert!(detail.starts_with("the document has more than 4000000 values"), "{detail}");
    }

    #[test]
    fn objects_and_arrays_are_bounded_by_the_length_of_the_text() {
        for hostile in ["[0]", "{\"a\":0}", "[]"] {
            let text = format!("[{}0]", format!("{hostile},").repeat((1 << 20) / (hostile.len() + 1)));
            let (code, _, detail) = refused(&text);
            assert_eq!(code, ValidationError);
            assert!(detail.starts_with("the document has too many objects and arrays"), "{detail}");
        }
        let job = r#"{"specimen":{"type":"box","size_mm":[50,50,50]},"mix":{"grading":{"type":"monodisperse","diameter_mm":8},"volume_fraction":0.2}}"#;
        let study = format!("{{\"list\":[{}{job}]}}", format!("{job},").repeat(9_999));
        assert_eq!(parse(study.as_bytes()).unwrap()["list"].as_array().unwrap().len(), 10_000);
    }

    #[test]
    fn small_blocks_are_bounded_whatever_the_length_of_the_text() {
        let many = |item: &str, n: usize| format!("[{}0]", format!("{item},").repeat(n));
        let spaced = format!("[0{}]", " ".repeat(16));
        assert!(parse(many(&spaced, MAX_CONTAINERS - 1).as_bytes()).is_ok());
        let (_, _, detail) = refused(&many(&spaced, MAX_CONTAINERS));
        assert!(detail.starts_with("the document has too many objects and arrays"), "{detail}");
        assert!(parse(many("\"text\"", MAX_TEXTS).as_bytes()).is_ok());
        let (code, _, detail) = refused(&many("\"text\"", MAX_TEXTS + 1));
        assert_eq!(code, ValidationError);
        assert!(detail.starts_with("the document has too many keys and strings: must have at most 1000000"));
        let keys: Vec<String> = (0..=MAX_TEXTS).map(|i| format!("\"{i}\":0")).collect();
        let (_, _, detail) = refused(&format!("{{{}}}", keys.join(",")));
        assert!(detail.starts_with("the document has too many keys and strings"), "{detail}");
    }

    #[test]
    fn a_long_key_is_shortened_in_the_pointer() {
        let (_, pointer, _) = refused(&format!("{{\"{}\": NaN}}", "k".repeat(1 << 20)));
        assert!(pointer.len() < 300, "{}", pointer.len());
    }

    #[test]
    fn depth_is_bounded() {
        let (code, pointer, detail) = refused(&"[".repeat(100_000));
        assert_eq!(code, ValidationError);
        assert!(detail.contains("nested too deep"), "{detail}");
        assert!(pointer.len() <= MAX_POINTER_CHARS + 8, "{pointer}");
        assert!(parse(format!("{}{}", "[".repeat(127), "]".repeat(127)).as_bytes()).is_ok());
    }
}
