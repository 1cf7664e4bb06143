//! JSON pointers (RFC 6901) that put values into a document.
//!
//! The document as a whole and the place after the end of an array (`-`) are refused, because no value can be put
//! there.

use packstone_engine::request::decode::pointer_segment;
use serde_json::Value;

/// Longest pointer, in characters.
const MAX_CHARS: usize = 250;

/// A place in a document.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Pointer {
    text: String,
    segments: Vec<String>,
}

impl Pointer {
    /// Reads a pointer, or describes what is wrong with it.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let length = text.chars().count();
        if length > MAX_CHARS {
            return Err(format!("the key has {length} characters: must have at most {MAX_CHARS}"));
        }
        let Some(rest) = text.strip_prefix('/') else {
            return Err("the key is no JSON pointer to a field: must begin with a slash, as \
                        /mix/volume_fraction"
                .into());
        };
        let segments = rest.split('/').map(unescaped).collect::<Option<Vec<String>>>().ok_or(
            "the key is no JSON pointer: a tilde must be written as ~0, a slash in a name as ~1 (RFC 6901)",
        )?;
        Ok(Self { text: text.into(), segments })
    }

    /// As it was written.
    pub(super) fn text(&self) -> &str {
        &self.text
    }

    /// Whether the other place is this one, or is within it.
    pub(super) fn holds(&self, other: &Self) -> bool {
        other.segments.starts_with(&self.segments)
    }

    /// The part of a pointer after this place, where the pointer begins with this place.
    pub(super) fn rest_of<'a>(&self, pointer: &'a str) -> Option<&'a str> {
        pointer.strip_prefix(self.text.as_str()).filter(|rest| rest.is_empty() || rest.starts_with('/'))
    }

    /// The place in a document: an item of an array, or a member of an object, which may be missing. Says
    /// what is wrong where there can be none.
    pub(super) fn check(&self, document: &Value) -> Result<(), String> {
        let mut at = document;
        let (last, parents) = self.segments.split_last().ok_or("the key names no field")?;
        let mut parent = String::new();
        for segment in parents {
            parent = format!("{parent}/{}", pointer_segment(segment));
            at = child(at, segment).ok_or_else(|| {
                format!("the template has no {parent}, so that nothing can be put into it: write it there")
            })?;
        }
        let of = if parent.is_empty() { "the template".into() } else { parent };
        match at {
            Value::Array(items) if child(at, last).is_none() => {
                Err(format!("the template has no such item: {of} has {} items, counted from 0", items.len()))
            }
            Value::Object(_) | Value::Array(_) => Ok(()),
            _ => Err(format!("{of} is neither an object nor an array, so that nothing can be put into it")),
        }
    }

    /// Puts a value there. Returns whether there was such a place.
    pub(super) fn put(&self, document: &mut Value, value: Value) -> bool {
        let Some((last, parents)) = self.segments.split_last() else { return false };
        let mut at = document;
        for segment in parents {
            let next = match at {
                Value::Object(members) => members.get_mut(segment),
                Value::Array(items) => index(segment).and_then(|i| items.get_mut(i)),
                _ => None,
            };
            match next {
                Some(next) => at = next,
                None => return false,
            }
        }
        match at {
            Value::Object(members) => {
                members.insert(last.clone(), value);
                true
            }
            Value::Array(items) => match index(last).and_then(|i| items.get_mut(i)) {
                Some(item) => {
                    *item = value;
                    true
                }
                None => false,
            },
            _ => false,
        }
    }
}

fn child<'a>(value: &'a Value, segment: &str) -> Option<&'a Value> {
    match value {
        Value::Object(members) => members.get(segment),
        Value::Array(items) => index(segment).and_then(|i| items.get(i)),
        _ => None,
    }
}

fn index(segment: &str) -> Option<usize> {
    let canonical = segment == "0" || !segment.starts_with(['0', '+']);
    canonical.then(|| segment.parse().ok()).flatten()
}

fn unescaped(segment: &str) -> Option<String> {
    let mut parts = segment.split('~');
    let mut text = parts.next()?.to_owned();
    for part in parts {
        let (replaced, rest) = match part.as_bytes().first()? {
            b'0' => ('~', &part[1..]),
            b'1' => ('/', &part[1..]),
            _ => return None,
        };
        text.push(replaced);
        text.push_str(rest);
    }
    Some(text)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use proptest::prelude::*;
    use serde_json::json;

    use super::*;

    fn put(document: Value, pointer: &str, value: Value) -> Result<Value, String> {
        let pointer = Pointer::parse(pointer)?;
        pointer.check(&document)?;
        let mut document = document;
        assert!(pointer.put(&mut document, value), "{pointer:?} was checked");
        Ok(document)
    }

    #[test]
    fn values_go_where_the_pointer_says() {
        let document = json!({"a": [1, {"b/c~": 2}], "": 3});
        assert_eq!(put(document.clone(), "/a/0", json!(9)), Ok(json!({"a": [9, {"b/c~": 2}], "": 3})));
        assert_eq!(put(document.clone(), "/a/1/b~1c~0", json!(9)), Ok(json!({"a": [1, {"b/c~": 9}], "": 3})));
        assert_eq!(put(document.clone(), "/new", json!(9)).unwrap()["new"], 9);
        assert_eq!(put(document, "/", json!(9)).unwrap()[""], 9);
    }

    #[test]
    fn what_names_no_place_is_refused_with_the_reason() {
        let document = json!({"a": [1, {"b": 2}], "c": "text"});
        for (pointer, says) in [
            ("", "must begin with a slash"),
            ("a", "must begin with a slash"),
            ("/a~", "~0"),
            ("/a~2b", "~0"),
            ("/x/y", "the template has no /x"),
            ("/a/1/x/y", "the template has no /a/1/x"),
            ("/a/2", "/a has 2 items"),
            ("/a/-", "/a has 2 items"),
            ("/a/01", "/a has 2 items"),
            ("/a/+1", "/a has 2 items"),
            ("/c/d", "/c is neither"),
        ] {
            let refused = put(document.clone(), pointer, json!(9)).unwrap_err();
            assert!(refused.contains(says), "{pointer}: {refused}");
        }
    }

    #[test]
    fn a_place_holds_itself_and_what_lies_in_it() {
        let parse = |text| Pointer::parse(text).unwrap();
        assert!(parse("/method").holds(&parse("/method/type")));
        assert!(parse("/method").holds(&parse("/method")));
        assert!(!parse("/method").holds(&parse("/methods")));
        assert_eq!(parse("/method").rest_of("/method/stop/time_s"), Some("/stop/time_s"));
        assert_eq!(parse("/method").rest_of("/method"), Some(""));
        assert_eq!(parse("/method").rest_of("/methods"), None);
    }

    proptest! {
        #[test]
        fn any_name_survives_its_escape(names in prop::collection::vec(any::<String>(), 1..4)) {
            let segments: Vec<String> = names.iter().map(|name| pointer_segment(name)).collect();
            let text = format!("/{}", segments.join("/"));
            prop_assume!(text.chars().count() <= MAX_CHARS);
            let pointer = Pointer::parse(&text).unwrap();
            prop_assert_eq!(&pointer.segments, &names);
            let (last, parents) = names.split_last().unwrap();
            let mut document = parents.iter().rev().fold(json!({}), |inner, name| json!({name.as_str(): inner}));
            prop_assert!(pointer.put(&mut document, json!(7)));
            prop_assert_eq!(document.pointer(&text), Some(&json!(7)), "{}", last);
        }
    }
}
