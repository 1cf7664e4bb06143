//! Reads a request from parsed JSON and reports all faults at once, each with its place.
//!
//! Serde stops at the first fault and loses the path inside internally tagged enums. A person who edits a mix by hand
//! needs all faults, each with its JSON pointer (RFC 6901), the value found and the bound. The report is bounded,
//! because a body of 1 MB can have 100 000 faults: at most [`MAX_FAULTS`] faults are kept, texts are shortened, and the
//! fields that an object may have are listed once per object.

use std::cell::{Cell, RefCell};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Most faults of one document that are reported; one more entry counts the others.
pub const MAX_FAULTS: usize = 100;
/// Longest pointer of a reported fault, in characters. A key can be as long as the document.
const MAX_POINTER_CHARS: usize = 256;
/// Longest description of a reported fault, in characters.
const MAX_DETAIL_CHARS: usize = 600;

/// A name as one segment of a JSON pointer.
#[must_use]
pub fn pointer_segment(name: &str) -> String {
    name.replace('~', "~0").replace('/', "~1")
}

/// One fault in a request.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct FieldError {
    /// RFC 6901 JSON pointer to the field; empty for the document itself.
    pub pointer: String,
    /// What is wrong: the value found and the bound it breaks.
    pub detail: String,
}

impl FieldError {
    /// A fault at `pointer`; both texts are shortened to their longest length.
    pub fn new(pointer: impl Into<String>, detail: impl Into<String>) -> Self {
        Self {
            pointer: shortened(pointer.into(), MAX_POINTER_CHARS),
            detail: shortened(detail.into(), MAX_DETAIL_CHARS),
        }
    }

    /// The entry that stands for `more` faults that are not listed.
    pub fn and_more(more: usize) -> Self {
        let faults = if more == 1 { "fault" } else { "faults" };
        Self { pointer: String::new(), detail: format!("and {more} more {faults}") }
    }
}

/// The text, cut after `max_chars` characters.
fn shortened(mut text: String, max_chars: usize) -> String {
    if text.len() > max_chars
        && let Some((end, _)) = text.char_indices().nth(max_chars)
    {
        text.truncate(end);
        text.push('…');
        text.shrink_to_fit();
    }
    text
}

impl std::fmt::Display for FieldError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let at = if self.pointer.is_empty() { "document" } else { &self.pointer };
        write!(f, "{at}: {}", self.detail)
    }
}

/// Collects the faults of one document: the first [`MAX_FAULTS`], and how many there were.
#[derive(Debug, Default)]
pub struct Faults {
    kept: RefCell<Vec<FieldError>>,
    count: Cell<usize>,
}

impl Faults {
    /// Adds a fault at `pointer`.
    pub fn add(&self, pointer: impl Into<String>, detail: impl Into<String>) {
        if self.count.get() < MAX_FAULTS {
            self.kept.borrow_mut().push(FieldError::new(pointer, detail));
        }
        self.count_more(1);
    }

    /// Counts faults that are not described.
    fn count_more(&self, more: usize) {
        self.count.set(self.count.get() + more);
    }

    /// How many faults were found so far.
    pub fn count(&self) -> usize {
        self.count.get()
    }

    /// The faults in the order in which they were found; a last entry counts those that are not listed.
    pub fn into_vec(self) -> Vec<FieldError> {
        let mut faults = self.kept.into_inner();
        let more = self.count.get() - faults.len();
        if more > 0 {
            faults.push(FieldError::and_more(more));
        }
        faults
    }
}

/// An interval for a number, with the unit that messages show.
#[derive(Clone, Copy, Debug)]
pub struct Bound {
    min: f64,
    min_open: bool,
    max: f64,
    max_open: bool,
    unit: &'static str,
}

impl Bound {
    /// `0 < x <= max`.
    pub const fn positive(max: f64, unit: &'static str) -> Self {
        Self { min: 0.0, min_open: true, max, max_open: false, unit }
    }

    /// `min < x < max`.
    pub const fn open(min: f64, max: f64, unit: &'static str) -> Self {
        Self { min, min_open: true, max, max_open: true, unit }
    }

    /// `min <= x <= max`.
    pub const fn closed(min: f64, max: f64, unit: &'static str) -> Self {
        Self { min, min_open: false, max, max_open: false, unit }
    }

    /// Whether `x` lies inside; NaN does not.
    pub fn contains(&self, x: f64) -> bool {
        (if self.min_open { x > self.min } else { x >= self.min })
            && (if self.max_open { x < self.max } else { x <= self.max })
    }

    fn describe(&self) -> String {
        let low = if self.min_open { "greater than" } else { "at least" };
        let high = if self.max_open { "less than" } else { "at most" };
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        format!("must be {low} {} and {high} {}{unit}", figure(self.min), self.max)
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

    /// Reports a fault at a place below this one, by its pointer from here.
    pub fn fault_below(&self, pointer: &str, detail: impl Into<String>) {
        self.faults.add(format!("{}{pointer}", self.pointer), detail);
    }

    fn expected<T>(&self, what: &str) -> Option<T> {
        self.fault(format!("{} is not {what}", shown(self.value)));
        None
    }

    fn child(&self, segment: &str, value: &'a Value) -> Self {
        let pointer = format!("{}/{}", self.pointer, pointer_segment(segment));
        Self { value, pointer, faults: self.faults }
    }

    /// The object here, or a fault.
    pub fn object(&self) -> Option<Object<'a>> {
        match self.value {
            Value::Object(map) => Some(Object { at: self.clone(), map, known: Vec::new() }),
            _ => self.expected("an object"),
        }
    }

    /// The members of the object here, whose names are the user's own and of which there are at most `max`, or a fault.
    pub fn members(&self, max: usize) -> Option<Vec<(&'a str, At<'a>)>> {
        match self.value {
            Value::Object(map) if map.len() > max => {
                self.fault(format!("has {} entries: must have at most {max}", map.len()));
                None
            }
            Value::Object(map) => {
                Some(map.iter().map(|(name, value)| (name.as_str(), self.child(name, value))).collect())
            }
            _ => self.expected("an object"),
        }
    }

    /// The items of the array here, or a fault.
    pub fn array(&self) -> Option<Items<'a>> {
        match self.value {
            Value::Array(values) => Some(Items { at: self.clone(), values }),
            _ => self.expected("an array"),
        }
    }

    /// The items of the list here: of an array, or the one element that stands in place of a list of one, as MATLAB and
    /// R write it.
    pub fn list(&self) -> Option<Items<'a>> {
        match self.value {
            Value::Array(_) => self.array(),
            one => Some(Items { at: self.clone(), values: std::slice::from_ref(one) }),
        }
    }

    /// The items of an array of exactly `N` items.
    pub fn array_of<const N: usize>(&self) -> Option<[At<'a>; N]> {
        let items = self.array()?;
        if items.len() != N {
            self.fault(format!("has {} items: must have exactly {N}", items.len()));
            return None;
        }
        Some(std::array::from_fn(|i| items.at(i)))
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

/// The items of an array, or one element in place of a list. An item gets its pointer when it is visited: an array may
/// hold a million numbers.
#[derive(Clone, Debug)]
pub struct Items<'a> {
    at: At<'a>,
    values: &'a [Value],
}

impl<'a> Items<'a> {
    /// How many there are.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Item `i`.
    ///
    /// # Panics
    /// If `i` is not below [`len`](Self::len).
    pub fn at(&self, i: usize) -> At<'a> {
        if self.at.value.is_array() {
            self.at.child(&i.to_string(), &self.values[i])
        } else {
            At { value: &self.values[i], ..self.at.clone() }
        }
    }

    /// The items in their order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = At<'a>> + '_ {
        (0..self.values.len()).map(|i| self.at(i))
    }
}

/// An object whose fields are read by name; a field that was never read is unknown.
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
        if !self.known.contains(&name) {
            self.known.push(name);
        }
        self.map.get(name).filter(|v| !v.is_null()).map(|v| self.at.child(name, v))
    }

    /// Whether the field is there and not null. Another may read it.
    pub fn has(&self, name: &str) -> bool {
        self.map.get(name).is_some_and(|value| !value.is_null())
    }

    /// Reports a fault at each of these members that is given; whether none was.
    pub fn refuse_all(&mut self, names: &[&'static str], detail: &str) -> bool {
        let mut none = true;
        for name in names {
            if let Some(at) = self.optional(name) {
                at.fault(detail);
                none = false;
            }
        }
        none
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

    /// Reports every field that was not read.
    pub fn finish(self) {
        self.finish_as("field", "this object");
    }

    /// Reports every field that was not read, in the words of a caller whose user did not write an object: `field` is
    /// the word for a field, `holder` names what has the fields.
    pub fn finish_as(self, field: &str, holder: &str) {
        let mut unknown = self.map.iter().filter(|(name, _)| !self.known.contains(&name.as_str()));
        if let Some((name, value)) = unknown.next() {
            let known = if self.known.is_empty() { "none".to_owned() } else { self.known.join(", ") };
            self.at.child(name, value).fault(format!("unknown {field}: {holder} has {known}"));
        }
        for (name, value) in unknown.by_ref().take(MAX_FAULTS - 1) {
            self.at.child(name, value).fault(format!("unknown {field}"));
        }
        self.at.faults.count_more(unknown.count());
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

/// A sum of numbers typed by hand, without the digits that rounding leaves.
pub(super) fn rounded(sum: f64) -> f64 {
    (sum * 1.0e9).round() / 1.0e9
}

/// All of the values, or none after each was read: every fault is to be reported.
pub(super) fn all<T>(values: impl Iterator<Item = Option<T>>) -> Option<Vec<T>> {
    let values: Vec<Option<T>> = values.collect();
    values.into_iter().collect()
}

/// The items of a list of 1 to `max`.
pub(super) fn bounded<'a>(at: &At<'a>, what: &str, max: usize) -> Option<Items<'a>> {
    let items = at.list()?;
    if items.is_empty() {
        at.fault(format!("has 0 {what}: must have at least 1"));
        return None;
    }
    if items.len() > max {
        at.fault(format!("has {} {what}: must have at most {max}", items.len()));
        return None;
    }
    Some(items)
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
    fn the_report_of_a_hostile_document_is_bounded() {
        let members: Map<String, Value> = (0..50_000).map(|i| (format!("{i:0>300}"), json!(1))).collect();
        let value = Value::Object(members);
        let faults = Faults::default();
        let mut object = At::root(&value, &faults).object().unwrap();
        assert!(object.optional("a").is_none() && object.optional("b").is_none());
        object.finish();
        assert_eq!(faults.count(), 50_000);
        let found = faults.into_vec();
        assert_eq!(found.len(), MAX_FAULTS + 1);
        assert_eq!(found[0].detail, "unknown field: this object has a, b");
        assert_eq!(found[1].detail, "unknown field", "the fields are listed once");
        assert_eq!(found[100].detail, "and 49900 more faults");
        assert!(found.iter().all(|fault| fault.pointer.chars().count() <= MAX_POINTER_CHARS + 1));

        let faults = Faults::default();
        assert!(At::root(&value, &faults).members(32).is_none());
        assert_eq!(faults.into_vec()[0].detail, "has 50000 entries: must have at most 32");
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
