//! Reading a request out of parsed JSON, so that every fault is reported at once and at its place.
//!
//! Serde stops at the first fault and loses the path inside internally tagged enums; a person who
//! edits a mix by hand wants all of them, each with its RFC 6901 pointer, the value found and the
//! bound it breaks. This module knows JSON values and bounds; it must never know what a field means.

use std::cell::RefCell;
use std::fmt::Write as _;

use serde::Serialize;
use serde_json::{Map, Value};

/// One fault in a request.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct FieldError {
    /// RFC 6901 JSON pointer to the field; empty for the document itself.
    pub pointer: String,
    /// What is wrong: the value found and the bound it breaks.
    pub detail: String,
}

impl std::fmt::Display for FieldError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let at = if self.pointer.is_empty() { "document" } else { &self.pointer };
        write!(f, "{at}: {}", self.detail)
    }
}

/// Collects the faults of one document.
#[derive(Debug, Default)]
pub struct Faults(RefCell<Vec<FieldError>>);

impl Faults {
    /// Adds a fault at `pointer`.
    pub fn add(&self, pointer: impl Into<String>, detail: impl Into<String>) {
        self.0.borrow_mut().push(FieldError { pointer: pointer.into(), detail: detail.into() });
    }

    /// How many faults were found so far.
    pub fn count(&self) -> usize {
        self.0.borrow().len()
    }

    /// The faults in the order in which they were found.
    pub fn into_vec(self) -> Vec<FieldError> {
        self.0.into_inner()
    }
}

/// An interval for a number, with the unit that messages show.
#[derive(Clone, Copy, Debug)]
pub struct Bound {
    min: f64,
    min_open: bool,
    max: f64,
    unit: &'static str,
}

impl Bound {
    /// `0 < x <= max`.
    pub const fn positive(max: f64, unit: &'static str) -> Self {
        Self { min: 0.0, min_open: true, max, unit }
    }

    /// `min <= x <= max`.
    pub const fn closed(min: f64, max: f64, unit: &'static str) -> Self {
        Self { min, min_open: false, max, unit }
    }

    /// Whether `x` lies inside; NaN does not.
    pub fn contains(&self, x: f64) -> bool {
        (if self.min_open { x > self.min } else { x >= self.min }) && x <= self.max
    }

    fn describe(&self) -> String {
        let low = if self.min_open { "greater than" } else { "at least" };
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        format!("must be {low} {} and at most {}{unit}", figure(self.min), self.max)
    }
}

/// A number for a message: 1e-9 is read at a glance, 0.000000001 is not.
fn figure(x: f64) -> String {
    let size = x.abs();
    if (size > 0.0 && size < 1e-4) || size >= 1e16 { format!("{x:e}") } else { x.to_string() }
}

/// A value at its place in the document.
#[derive(Clone, Debug)]
pub struct At<'a> {
    value: &'a Value,
    pointer: String,
    faults: &'a Faults,
}

impl<'a> At<'a> {
    /// The document itself.
    pub fn root(value: &'a Value, faults: &'a Faults) -> Self {
        Self { value, pointer: String::new(), faults }
    }

    /// The RFC 6901 pointer of this place.
    pub fn pointer(&self) -> &str {
        &self.pointer
    }

    /// The raw value.
    pub fn value(&self) -> &'a Value {
        self.value
    }

    /// Reports a fault at this place.
    pub fn fault(&self, detail: impl Into<String>) {
        self.faults.add(self.pointer.clone(), detail);
    }

    fn expected<T>(&self, what: &str) -> Option<T> {
        self.fault(format!("{} is not {what}", shown(self.value)));
        None
    }

    fn child(&self, segment: &str, value: &'a Value) -> Self {
        let mut pointer = self.pointer.clone();
        let _ = write!(pointer, "/{}", segment.replace('~', "~0").replace('/', "~1"));
        Self { value, pointer, faults: self.faults }
    }

    /// The object here, or a fault.
    pub fn object(&self) -> Option<Object<'a>> {
        match self.value {
            Value::Object(map) => Some(Object { at: self.clone(), map, known: Vec::new() }),
            _ => self.expected("an object"),
        }
    }

    /// The members of the object here, whose names are the user's own, or a fault.
    pub fn members(&self) -> Option<Vec<(&'a str, At<'a>)>> {
        match self.value {
            Value::Object(map) => {
                Some(map.iter().map(|(name, value)| (name.as_str(), self.child(name, value))).collect())
            }
            _ => self.expected("an object"),
        }
    }

    /// The items of the array here, or a fault.
    pub fn array(&self) -> Option<Vec<At<'a>>> {
        match self.value {
            Value::Array(items) => {
                Some(items.iter().enumerate().map(|(i, v)| self.child(&i.to_string(), v)).collect())
            }
            _ => self.expected("an array"),
        }
    }

    /// The items of an array of exactly `N` items.
    pub fn array_of<const N: usize>(&self) -> Option<[At<'a>; N]> {
        let items = self.array()?;
        let found = items.len();
        items.try_into().map_err(|_| self.fault(format!("has {found} items: must have exactly {N}"))).ok()
    }

    /// A finite number inside `bound`.
    pub fn number(&self, bound: Bound) -> Option<f64> {
        let Some(x) = self.value.as_f64() else {
            return self.expected("a number");
        };
        if bound.contains(x) {
            Some(x)
        } else {
            self.fault(format!("{} is out of range: {}", figure(x), bound.describe()));
            None
        }
    }

    /// A whole number in `min..=max`. `3.0` counts as whole, as MATLAB and JavaScript write it.
    pub fn integer(&self, min: i64, max: i64) -> Option<i64> {
        let whole = self.value.as_i64().or_else(|| {
            self.value.as_f64().filter(|x| x.fract() == 0.0 && x.abs() < 9.0e15).map(|x| x as i64)
        });
        match whole {
            Some(i) if (min..=max).contains(&i) => Some(i),
            _ if self.value.is_number() => {
                self.fault(format!(
                    "{} is out of range: must be a whole number from {min} to {max}",
                    self.value
                ));
                None
            }
            _ => self.expected("a whole number"),
        }
    }

    /// A string.
    pub fn string(&self) -> Option<&'a str> {
        match self.value {
            Value::String(s) => Some(s),
            _ => self.expected("a string"),
        }
    }

    /// `true` or `false`.
    pub fn boolean(&self) -> Option<bool> {
        match self.value {
            Value::Bool(b) => Some(*b),
            _ => self.expected("true or false"),
        }
    }

    /// One of the named choices.
    pub fn choice<T: Copy>(&self, choices: &[(&str, T)]) -> Option<T> {
        let name = self.string()?;
        if let Some((_, choice)) = choices.iter().find(|(n, _)| *n == name) {
            return Some(*choice);
        }
        let names: Vec<String> = choices.iter().map(|(n, _)| format!("{n:?}")).collect();
        self.fault(format!("{} is unknown: must be one of {}", shown(self.value), names.join(", ")));
        None
    }
}

/// An object whose fields are asked for by name; what was never asked for is unknown.
#[derive(Debug)]
pub struct Object<'a> {
    at: At<'a>,
    map: &'a Map<String, Value>,
    known: Vec<&'static str>,
}

impl<'a> Object<'a> {
    /// Names of the fields that were asked for so far.
    pub fn known(&self) -> &[&'static str] {
        &self.known
    }

    /// The place of the object.
    pub fn at(&self) -> &At<'a> {
        &self.at
    }

    /// The field, if it is there and not null.
    pub fn optional(&mut self, name: &'static str) -> Option<At<'a>> {
        self.known.push(name);
        self.map.get(name).filter(|v| !v.is_null()).map(|v| self.at.child(name, v))
    }

    /// The field, or a fault that it is missing.
    pub fn required(&mut self, name: &'static str) -> Option<At<'a>> {
        let found = self.optional(name);
        if found.is_none() {
            let what = if self.map.contains_key(name) { "is null" } else { "is missing" };
            let pointer = format!("{}/{name}", self.at.pointer);
            self.at.faults.add(pointer, format!("{what}: the field is required"));
        }
        found
    }

    /// The `type` that names the variant of a tagged object.
    pub fn variant<T: Copy>(&mut self, choices: &[(&str, T)]) -> Option<T> {
        self.required("type")?.choice(choices)
    }

    /// Reports every field that was not asked for.
    pub fn finish(self) {
        self.finish_as("field", "this object");
    }

    /// The same in the words of whoever did not write an object: what a field is called there, and what has it.
    pub fn finish_as(self, field: &str, holder: &str) {
        let known = if self.known.is_empty() { "none".to_owned() } else { self.known.join(", ") };
        for (name, value) in self.map {
            if !self.known.contains(&name.as_str()) {
                self.at.child(name, value).fault(format!("unknown {field}: {holder} has {known}"));
            }
        }
    }
}

/// A value as messages show it: short, and of one line.
fn shown(value: &Value) -> String {
    match value {
        Value::Object(_) => "an object".into(),
        Value::Array(_) => "an array".into(),
        Value::String(s) if s.chars().count() > 40 => {
            format!("{:?}…", s.chars().take(40).collect::<String>())
        }
        other => other.to_string(),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn every_fault_is_reported_with_pointer_value_and_bound() {
        let value = json!({"a": -1.0, "b": "x", "we/ird~": 1});
        let faults = Faults::default();
        let mut object = At::root(&value, &faults).object().unwrap();
        assert_eq!(object.required("a").unwrap().number(Bound::positive(10.0, "mm")), None);
        assert_eq!(object.required("b").unwrap().choice(&[("y", 1), ("z", 2)]), None);
        assert!(object.required("c").is_none());
        object.finish();
        let found: Vec<String> = faults.into_vec().iter().map(ToString::to_string).collect();
        assert_eq!(
            found,
            [
                "/a: -1 is out of range: must be greater than 0 and at most 10 mm",
                "/b: \"x\" is unknown: must be one of \"y\", \"z\"",
                "/c: is missing: the field is required",
                "/we~1ird~0: unknown field: this object has a, b, c",
            ]
        );
    }

    #[test]
    fn whole_numbers_may_be_written_as_floats() {
        let faults = Faults::default();
        assert_eq!(At::root(&json!(3.0), &faults).integer(0, 5), Some(3));
        assert_eq!(At::root(&json!(3.5), &faults).integer(0, 5), None);
        assert_eq!(At::root(&json!(18_446_744_073_709_551_615_u64), &faults).integer(0, 5), None);
        assert_eq!(faults.count(), 2);
    }
}
