//! Pages of listings: cursors and links.
//!
//! Pages go by key, not by offset: a page costs the same however deep it is, and what comes in meanwhile
//! neither repeats nor hides others. A cursor holds the last item seen and a digest over it and the listing
//! with its filters, so that one from another listing, or from nowhere, is refused.

use std::fmt::Debug;

use serde::Serialize;
use sha2::{Digest, Sha256};
#[cfg(test)]
use utoipa::openapi::schema::{Object, ObjectBuilder, Type};

use crate::base_path;
use crate::hex;
use crate::http::params::values::{Value, WholeNumber};
use crate::http::params::{ParameterSet, pairs, parameters, shown};
use crate::jobs::store::{DamagedRow, Position};
use crate::problem::{Fault, Problem};

const CHECK_BYTES: usize = 8;
/// Hexadecimal digits of a cursor.
const CURSOR_DIGITS: usize = 2 * (2 * size_of::<i64>() + CHECK_BYTES);

parameters! {
    /// The page of a listing that a request is about.
    #[derive(Clone, Debug)]
    pub(crate) struct PageParameters {
        /// Most items on the page.
        pub(crate) limit: WholeNumber<1, 500, 50>,
        /// `next_cursor` of the page before, with the same filters.
        pub(crate) cursor: Option<Cursor>,
    }
}

/// An item of a page whose record in the database is damaged.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct DamagedItem {
    /// Its ID; empty where that cannot be read either.
    id: String,
    /// What is wrong with the record.
    detail: String,
}

impl DamagedItem {
    /// The damaged items of a page.
    pub(crate) fn all(rows: Vec<DamagedRow>) -> Vec<Self> {
        rows.into_iter().map(|DamagedRow { id, fault }| Self { id, detail: fault }).collect()
    }
}

impl PageParameters {
    /// The position of the item before the page; `listing` says what is listed, its filters included.
    ///
    /// # Errors
    /// `validation-error` for the cursor of another listing.
    pub(crate) fn after(&self, listing: &impl Debug) -> Result<Option<Position>, Problem> {
        let Some(cursor) = &self.cursor else { return Ok(None) };
        let foreign = || Problem::parameters(vec![Fault::parameter("cursor", no_cursor(&cursor.0))]);
        open_cursor(&cursor.0, listing).map(Some).ok_or_else(foreign)
    }

    /// Goes to the page that starts at that cursor.
    pub(crate) fn turn_to(&mut self, cursor: &str) {
        self.cursor = Some(Cursor(cursor.to_owned()));
    }
}

/// Where a page starts. Whether it belongs to a listing is known once the filters of this are.
#[derive(Clone, Debug)]
pub(crate) struct Cursor(String);

impl Value for Cursor {
    #[cfg(test)]
    fn schema() -> Object {
        let pattern = format!("^[0-9a-f]{{{CURSOR_DIGITS}}}$");
        ObjectBuilder::new().schema_type(Type::String).pattern(Some(pattern)).build()
    }

    fn read(text: &str) -> Result<Self, String> {
        // One form of every cursor, so that equal ones look equal.
        let digits = text.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b));
        if digits && text.len() == CURSOR_DIGITS { Ok(Self(text.to_owned())) } else { Err(no_cursor(text)) }
    }

    fn write(&self) -> String {
        self.0.clone()
    }
}

fn no_cursor(text: &str) -> String {
    let shown = shown(text);
    format!("{shown} is no cursor of this listing: must be the next_cursor of a page with the same filters")
}

/// The next page's address with its relation, for `Link`; `query` are its parameters.
pub(crate) fn link(path: &str, query: &impl ParameterSet) -> String {
    let query = form_urlencoded::Serializer::new(String::new()).extend_pairs(pairs(query)).finish();
    format!("<{}?{query}>; rel=\"next\"", base_path::absolute(path))
}

/// The cursor of the page that follows an item.
pub(crate) fn cursor(item: impl Into<Position>, listing: &impl Debug) -> String {
    let item = item.into();
    let mut bytes = item.key.to_be_bytes().to_vec();
    bytes.extend(item.seq.to_be_bytes());
    bytes.extend(check(item, listing));
    hex::encode(&bytes)
}

fn open_cursor(text: &str, listing: &impl Debug) -> Option<Position> {
    let bytes = hex::decode(text)?;
    let (key, rest) = bytes.split_first_chunk::<8>()?;
    let (seq, found) = rest.split_first_chunk::<8>()?;
    let item = Position { key: i64::from_be_bytes(*key), seq: i64::from_be_bytes(*seq) };
    (found == check(item, listing)).then_some(item)
}

fn check(item: Position, listing: &impl Debug) -> Vec<u8> {
    let mut digest = Sha256::new_with_prefix(b"packstone cursor 2");
    digest.update(item.key.to_be_bytes());
    digest.update(item.seq.to_be_bytes());
    digest.update(format!("{listing:?}"));
    digest.finalize()[..CHECK_BYTES].to_vec()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::http::params::values::Labels;
    use crate::jobs;
    use crate::jobs::store::{Filter, StudyFilter};

    #[test]
    fn a_cursor_opens_only_its_own_listing() {
        let all = Filter::default();
        let queued = Filter {
            state: Some(jobs::State::Queued),
            labels: vec![("a".into(), "b".into())],
            ..Filter::default()
        };
        let mine = cursor(Position { key: -7, seq: 42 }, &queued);
        assert_eq!(open_cursor(&mine, &queued), Some(Position { key: -7, seq: 42 }));
        assert_eq!(open_cursor(&mine, &all), None);
        for bad in ["", "00", "nonsense", &mine[2..], &mine.to_uppercase(), &format!("{mine}00")] {
            assert!(Cursor::read(bad).is_err(), "{bad}");
        }
        assert_eq!(Cursor::read(&mine).map(|cursor| cursor.write()).as_ref(), Ok(&mine));
        let mut forged = mine.clone().into_bytes();
        forged[31] = if forged[31] == b'0' { b'1' } else { b'0' };
        assert_eq!(open_cursor(&String::from_utf8_lossy(&forged), &queued), None);
        assert_eq!(open_cursor(&cursor(42, &all), &StudyFilter::default()), None, "jobs are no studies");
    }

    #[test]
    fn links_are_encoded() {
        parameters! {
            struct Labelled {
                /// Labels.
                label: Labels,
                ..page: PageParameters,
            }
        }
        let label = Labels(vec![("a b".to_owned(), "c&d>".to_owned())]);
        let page = PageParameters { limit: WholeNumber::read("5").unwrap(), cursor: None };
        let mut query = Labelled { label, page };
        query.page.turn_to("ff");
        assert_eq!(
            link("/v1/jobs", &query),
            "</v1/jobs?label=a+b%3Dc%26d%3E&limit=5&cursor=ff>; rel=\"next\""
        );
    }
}
