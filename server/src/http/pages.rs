//! Pages of listings: cursors and links.
//!
//! Pages go by key, not by offset: a page costs the same however deep it is, and what comes in meanwhile
//! neither repeats nor hides others. A cursor holds the last item seen and a digest over it and the listing
//! with its filters, so that one from another listing, or from nowhere, is refused.

use std::fmt::Debug;

use sha2::{Digest, Sha256};

use crate::hex;
use crate::http::params::{Query, shown};
use crate::jobs::request::MAX_LABELS;

const DEFAULT_LIMIT: i64 = 50;
const MAX_LIMIT: i64 = 500;
const CHECK_BYTES: usize = 8;

/// The page that a query asks for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Page {
    pub(crate) limit: u32,
    pub(crate) before: Option<i64>,
}

impl Page {
    /// Reads `limit` and `cursor`; `listing` says what is listed, its filters included.
    pub(crate) fn read(query: &mut Query, listing: &impl Debug) -> Self {
        let limit = query.integer("limit", 1, MAX_LIMIT).unwrap_or(DEFAULT_LIMIT) as u32;
        let before = query.one("cursor").and_then(|cursor| {
            let before = open_cursor(&cursor, listing);
            if before.is_none() {
                let shown = shown(&cursor);
                query.fault("cursor", format!("{shown} is no cursor of this listing: must be the next_cursor of a page with the same filters"));
            }
            before
        });
        Self { limit, before }
    }

    /// The next page's address with its relation, for `Link`; `filters` are parameters with their values.
    pub(crate) fn link(&self, path: &str, filters: &[(&str, String)], cursor: &str) -> String {
        let mut query = form_urlencoded::Serializer::new(String::new());
        query.extend_pairs(filters);
        query.append_pair("limit", &self.limit.to_string()).append_pair("cursor", cursor);
        format!("<{path}?{}>; rel=\"next\"", query.finish())
    }
}

/// Reads `label`, which may be repeated.
pub(crate) fn labels(query: &mut Query) -> Vec<(String, String)> {
    let mut labels = Vec::new();
    for label in query.many("label") {
        match label.split_once('=') {
            Some((key, value)) if !key.is_empty() => labels.push((key.into(), value.into())),
            _ => query.fault("label", format!("{} has no key: must be key=value", shown(&label))),
        }
    }
    if labels.len() > MAX_LABELS {
        let found = labels.len();
        query.fault("label", format!("is given {found} times: must be given at most {MAX_LABELS} times"));
    }
    labels
}

/// Labels as parameters.
pub(crate) fn label_filters(labels: &[(String, String)]) -> impl Iterator<Item = (&'static str, String)> {
    labels.iter().map(|(key, value)| ("label", format!("{key}={value}")))
}

/// The cursor of the page below an item.
pub(crate) fn cursor(seq: i64, listing: &impl Debug) -> String {
    let mut bytes = seq.to_be_bytes().to_vec();
    bytes.extend(check(seq, listing));
    hex::encode(&bytes)
}

fn open_cursor(text: &str, listing: &impl Debug) -> Option<i64> {
    // One form of every cursor, so that equal ones look equal.
    if text.bytes().any(|b| b.is_ascii_uppercase()) {
        return None;
    }
    let bytes = hex::decode(text)?;
    let (seq, found) = bytes.split_first_chunk::<8>()?;
    let seq = i64::from_be_bytes(*seq);
    (found == check(seq, listing)).then_some(seq)
}

fn check(seq: i64, listing: &impl Debug) -> Vec<u8> {
    let mut digest = Sha256::new_with_prefix(b"packstone cursor 1");
    digest.update(seq.to_be_bytes());
    digest.update(format!("{listing:?}"));
    digest.finalize()[..CHECK_BYTES].to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
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
        let mine = cursor(42, &queued);
        assert_eq!(open_cursor(&mine, &queued), Some(42));
        assert_eq!(open_cursor(&mine, &all), None);
        for bad in ["", "00", "nonsense", &mine[2..], &mine.to_uppercase(), &format!("{mine}00")] {
            assert_eq!(open_cursor(bad, &queued), None, "{bad}");
        }
        let mut forged = mine.clone().into_bytes();
        forged[15] = if forged[15] == b'0' { b'1' } else { b'0' };
        assert_eq!(open_cursor(&String::from_utf8_lossy(&forged), &queued), None);
        assert_eq!(open_cursor(&cursor(42, &all), &StudyFilter::default()), None, "jobs are no studies");
    }

    #[test]
    fn links_are_encoded() {
        let labels = [("a b".to_owned(), "c&d>".to_owned())];
        let page = Page { limit: 5, before: None };
        assert_eq!(
            page.link("/v1/jobs", &label_filters(&labels).collect::<Vec<_>>(), "ff"),
            "</v1/jobs?label=a+b%3Dc%26d%3E&limit=5&cursor=ff>; rel=\"next\""
        );
    }
}
