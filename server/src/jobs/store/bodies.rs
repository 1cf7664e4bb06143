//! Bodies of requests: what the jobs of a study have in common is stored once, and each body is checked when it is
//! read.
//!
//! A request is large where it lists something: diameters, points of a curve, corners of polyhedra. So the longest list
//! of a body, from [`LEAST_BYTES`] on, is a part of its own in the table `study_parts`, and the row of the body has the
//! text without it and its place. Equal parts of a study are one row.

use std::collections::HashMap;

use sha2::{Digest as _, Sha256};

use super::StoreError;
use super::db::{Row, Transaction, query};

/// Shortest list that is stored apart.
const LEAST_BYTES: usize = 1024;

/// The body of a request whose row is `r` and whose part is `p`.
macro_rules! composed_body {
    () => {
        "case when r.part is null then r.body
              else substr(r.body, 1, cast(r.part_at as integer)) || p.body
                  || substr(r.body, cast(r.part_at as integer) + 1) end"
    };
}
pub(super) use composed_body;

/// A column with the body of the job's request, and one with its digest, in a query of `jobs`.
macro_rules! body_of_job {
    () => {
        concat!(
            "(select ",
            $crate::jobs::store::bodies::composed_body!(),
            " from job_requests as r left join study_parts as p on p.study = jobs.study and p.part = r.part
              where r.job = jobs.seq) as body,
             (select job_requests.digest from job_requests where job_requests.job = jobs.seq) as body_digest"
        )
    };
}
pub(super) use body_of_job;

/// A body as its row has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct StoredBody {
    /// The text, without its part.
    pub(super) text: String,
    /// The number of the part within the study.
    pub(super) part: Option<i64>,
    /// How many characters of the text come before the part.
    pub(super) part_at: Option<i64>,
    /// Digest of the whole body.
    pub(super) digest: i64,
}

impl StoredBody {
    /// A body that is stored whole.
    pub(super) fn whole(text: &str) -> Self {
        Self { text: text.to_owned(), part: None, part_at: None, digest: digest(text) }
    }

    /// Bytes that it takes.
    pub(super) fn bytes(&self) -> i64 {
        i64::try_from(self.text.len()).unwrap_or(i64::MAX)
    }
}

/// The parts of the requests of a study, each once.
#[derive(Debug, Default)]
pub(super) struct Parts {
    known: HashMap<[u8; 32], i64>,
    new: Vec<(i64, String)>,
    bytes: i64,
}

impl Parts {
    /// Splits a body.
    pub(super) fn split(&mut self, text: &str) -> StoredBody {
        let Some((from, to)) = longest_list(text).filter(|(from, to)| to - from >= LEAST_BYTES) else {
            return StoredBody::whole(text);
        };
        let (before, list, after) = (&text[..from], &text[from..to], &text[to..]);
        let next = self.known.len() as i64;
        let part = *self.known.entry(Sha256::digest(list).into()).or_insert_with(|| {
            self.new.push((next, list.to_owned()));
            self.bytes = self.bytes.saturating_add(list.len() as i64);
            next
        });
        StoredBody {
            text: format!("{before}{after}"),
            part: Some(part),
            part_at: i64::try_from(before.chars().count()).ok(),
            digest: digest(text),
        }
    }

    /// Bytes of all parts.
    pub(super) fn bytes(&self) -> i64 {
        self.bytes
    }

    /// Writes the parts that are new since the last call.
    ///
    /// # Errors
    /// The database's.
    pub(super) async fn insert(&mut self, tx: &mut Transaction<'_>, study: i64) -> Result<(), StoreError> {
        for (part, body) in self.new.drain(..) {
            query("insert into study_parts (study, part, body) values (?, ?, ?)")
                .bind(study)
                .bind(part)
                .bind(body)
                .execute(&mut *tx)
                .await?;
        }
        Ok(())
    }
}

/// The longest list of a JSON text that is in no other list: from its bracket to the place after the other one.
fn longest_list(text: &str) -> Option<(usize, usize)> {
    let (mut longest, mut from, mut depth) = (None::<(usize, usize)>, 0, 0_usize);
    let (mut is_quoted, mut is_escaped) = (false, false);
    for (at, byte) in text.bytes().enumerate() {
        if is_quoted {
            is_quoted = is_escaped || byte != b'"';
            is_escaped = !is_escaped && byte == b'\\';
            continue;
        }
        match byte {
            b'"' => is_quoted = true,
            b'[' => {
                if depth == 0 {
                    from = at;
                }
                depth += 1;
            }
            b']' => {
                depth = depth.saturating_sub(1);
                if depth == 0 && longest.is_none_or(|(start, end)| at + 1 - from > end - start) {
                    longest = Some((from, at + 1));
                }
            }
            _ => {}
        }
    }
    longest
}

/// What tells that a text is the one that was stored: the first 64 bits of its SHA-256.
pub(super) fn digest(text: &str) -> i64 {
    let [a, b, c, d, e, f, g, h, ..]: [u8; 32] = Sha256::digest(text).into();
    i64::from_be_bytes([a, b, c, d, e, f, g, h])
}

/// The text in a column of a row, where it is the one that was stored.
///
/// # Errors
/// [`StoreError::Row`] where it is another one, or the database's.
pub(super) fn checked<'r>(row: &'r Row, text: &str, digest_in: &str) -> Result<&'r str, StoreError> {
    compared(row.text(text)?, row.try_get(digest_in)?)
}

/// A text, where it has this digest.
///
/// # Errors
/// [`StoreError::Row`].
pub(super) fn compared(text: &str, expected: i64) -> Result<&str, StoreError> {
    if digest(text) == expected {
        return Ok(text);
    }
    Err(StoreError::Row("a text of it is not what was stored".into()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_list_is_found_beside_brackets_in_texts() {
        for (text, expected) in [
            (r#"{"a":1}"#, None),
            (r#"{"a":[1],"b":{"c":[1,[2],3]},"d":[]}"#, Some("[1,[2],3]")),
            (r#"{"a":"[[[[[[","b":[1]}"#, Some("[1]")),
            (r#"{"a":"\"[[[\\","b":[1],"c":"]]]"}"#, Some("[1]")),
            (r#"{"é":["é","]"]}"#, Some(r#"["é","]"]"#)),
        ] {
            assert_eq!(longest_list(text).map(|(from, to)| &text[from..to]), expected, "{text}");
        }
    }

    #[test]
    fn equal_parts_are_one_and_a_short_body_stays_whole() {
        let list = format!("[{}]", vec!["1.25"; 1000].join(","));
        let bodies = [1, 2].map(|seed| format!(r#"{{"name":"Größe","mix":{list},"seed":{seed}}}"#));
        let mut parts = Parts::default();
        let split = bodies.each_ref().map(|body| parts.split(body));
        assert_eq!((parts.new.len(), parts.bytes()), (1, list.len() as i64));
        for (body, stored) in bodies.iter().zip(&split) {
            assert_eq!((stored.part, stored.digest), (Some(0), digest(body)));
            assert!(stored.text.len() < 60, "{}", stored.text);
            let at = stored.part_at.unwrap() as usize;
            let chars: Vec<char> = stored.text.chars().collect();
            let (before, after) = chars.split_at(at);
            assert_eq!(&format!("{}{list}{}", String::from_iter(before), String::from_iter(after)), body);
        }
        let short = parts.split(r#"{"a":[1,2]}"#);
        assert_eq!(short, StoredBody::whole(r#"{"a":[1,2]}"#));
    }
}
