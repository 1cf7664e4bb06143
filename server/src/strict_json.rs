//! JSON into a value, telling where and why where it fails.
//!
//! Stricter than [`serde_json::Value`]: a key that comes twice is refused, because one of the two
//! would be dropped in silence. Every fault has the RFC 6901 pointer of the place it was met at.

use std::cell::Cell;
use std::fmt;

use packstone_engine::FieldError;
use serde::de::{DeserializeSeed, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value};
use serde_path_to_error::{Path, Segment};

use crate::problem::{Fault, Kind, Problem};

/// Pointers into documents nested on purpose are cut off here.
const MAX_POINTER_CHARS: usize = 256;
/// Most values of a document. A value takes 72 bytes of memory and as little as two of text.
const MAX_VALUES: u32 = 4_000_000;

/// Parses one JSON document.
///
/// # Errors
/// `malformed-json` (400) where it is no JSON; `validation-error` (422) where it is, but a number
/// is too large for any number, a key comes twice, or it is nested too deep.
pub(crate) fn parse(text: &[u8]) -> Result<Value, Problem> {
    let mut json = serde_json::Deserializer::from_slice(text);
    let mut track = serde_path_to_error::Track::new();
    let left = Cell::new(MAX_VALUES);
    let value = Strict { left: &left }
        .deserialize(serde_path_to_error::Deserializer::new(&mut json, &mut track))
        .map_err(|error| refusal(text, &pointer(&track.path()), &error))?;
    json.end().map_err(|error| refusal(text, "", &error))?;
    Ok(value)
}

fn refusal(text: &[u8], pointer: &str, error: &serde_json::Error) -> Problem {
    let message = error.to_string();
    let place = format!("line {}, column {}", error.line(), error.column());
    let semantic = |detail: String| {
        Problem::fields(Kind::ValidationError, vec![FieldError { pointer: pointer.into(), detail }])
    };
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
    let mut problem = Problem::new(Kind::MalformedJson, detail.clone());
    problem.errors = vec![Fault::from(FieldError { pointer: pointer.into(), detail })];
    problem
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
                pointer.push_str(&key.replace('~', "~0").replace('/', "~1"));
            }
            Segment::Enum { .. } | Segment::Unknown => {}
        }
        if pointer.len() > MAX_POINTER_CHARS {
            break;
        }
    }
    pointer
}

/// Builds a [`Value`], refuses keys that come twice, and counts values.
#[derive(Clone, Copy)]
struct Strict<'a> {
    left: &'a Cell<u32>,
}

impl<'de> DeserializeSeed<'de> for Strict<'_> {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        let left = self.left.get().checked_sub(1);
        self.left.set(left.ok_or_else(|| {
            D::Error::custom(format!(
                "the document has more than {MAX_VALUES} values: must have at most as many"
            ))
        })?);
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

    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_string<E>(self, value: String) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut array = Vec::new();
        while let Some(item) = items.next_element_seed(self)? {
            array.push(item);
        }
        Ok(Value::Array(array))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some(key) = entries.next_key::<String>()? {
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
    use super::*;
    use serde_json::json;

    fn refused(text: &str) -> (u16, String, String) {
        let problem = parse(text.as_bytes()).unwrap_err();
        let fault = &problem.errors[0];
        (problem.status, fault.pointer.clone().unwrap(), fault.detail.clone())
    }

    #[test]
    fn what_is_json_is_read_whole() {
        let text = r#"{"a": [1, -2, 3.5, 1e3, "ü", null, true, {}], "b": 18446744073709551615}"#;
        assert_eq!(parse(text.as_bytes()).unwrap(), serde_json::from_str::<Value>(text).unwrap());
        assert_eq!(parse(b" 1 ").unwrap(), json!(1));
    }

    #[test]
    fn faults_carry_their_place_and_value() {
        let (status, pointer, detail) = refused(r#"{"mix": {"d_min_mm": NaN}}"#);
        assert_eq!((status, pointer.as_str()), (400, "/mix/d_min_mm"));
        assert!(detail.starts_with("NaN is not JSON: expected"), "{detail}");
        let (status, pointer, detail) = refused("{\"mix\":\n {\"d\": [1, -1e999]}}");
        assert_eq!((status, pointer.as_str()), (422, "/mix/d/1"));
        assert!(detail.starts_with("-1e999 is out of range"), "{detail}");
        let (status, pointer, detail) = refused(r#"{"a": {"b~/": 1, "b~/": 2}}"#);
        assert_eq!(status, 422);
        assert!(pointer.starts_with("/a"), "{pointer}");
        assert!(detail.starts_with("the key \"b~/\" comes twice"), "{detail}");
        for text in ["", "{", "[1,]", "{\"a\"}", "1 2", "{'a': 1}", "\u{feff}{}", "\"\u{1}\""] {
            assert_eq!(refused(text).0, 400, "{text}");
        }
        assert_eq!(parse(&[b'"', 0xff, b'"']).unwrap_err().status, 400);
    }

    #[test]
    fn the_number_of_values_is_bounded() {
        let list = |n: u32| format!("[{}0]", "0,".repeat(n as usize - 1));
        assert!(parse(list(MAX_VALUES - 1).as_bytes()).is_ok());
        let (status, _, detail) = refused(&list(MAX_VALUES));
        assert_eq!(status, 422);
        assert!(detail.starts_with("the document has more than 4000000 values"), "{detail}");
    }

    #[test]
    fn depth_is_bounded() {
        let (status, pointer, detail) = refused(&"[".repeat(100_000));
        assert_eq!(status, 422);
        assert!(detail.contains("nested too deep"), "{detail}");
        assert!(pointer.len() <= MAX_POINTER_CHARS + 8, "{pointer}");
        assert!(parse(format!("{}{}", "[".repeat(127), "]".repeat(127)).as_bytes()).is_ok());
    }
}
