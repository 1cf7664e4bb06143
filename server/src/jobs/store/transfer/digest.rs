//! The digest of a table, in a form that both databases give.

use std::fmt;

use sha2::{Digest as _, Sha256};

use crate::hex;
use crate::jobs::store::db::Value;

/// The digest of the rows so far.
///
/// A value is a byte for its type and then its bytes: 0 for null; 1 and the eight bytes of an integer; 2 and the eight
/// bytes of a real number; 3 and the byte 0 or 1 of a flag; 4, the length as eight bytes, and the bytes of a text. All
/// are big-endian. SQLite stores no negative zero, so that it counts as zero.
#[derive(Debug, Default)]
pub(super) struct TableDigest {
    rows: u64,
    sha256: Sha256,
}

/// The digest of all rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Digested {
    /// How many they are.
    pub(super) rows: u64,
    /// Their SHA-256.
    pub(super) sha256: Vec<u8>,
}

impl TableDigest {
    /// Adds the next rows.
    pub(super) fn add(&mut self, rows: &[Vec<Value>]) {
        self.rows += rows.len() as u64;
        for value in rows.iter().flatten() {
            self.add_value(value);
        }
    }

    fn add_value(&mut self, value: &Value) {
        match value {
            Value::Integer(None) | Value::Real(None) | Value::Flag(None) | Value::Text(None) => {
                self.sha256.update([0]);
            }
            Value::Integer(Some(value)) => {
                self.sha256.update([1]);
                self.sha256.update(value.to_be_bytes());
            }
            Value::Real(Some(value)) => {
                self.sha256.update([2]);
                // The sum of both zeros is the positive one.
                self.sha256.update((value + 0.0).to_be_bytes());
            }
            Value::Flag(Some(value)) => self.sha256.update([3, u8::from(*value)]),
            Value::Text(Some(value)) => {
                self.sha256.update([4]);
                self.sha256.update((value.len() as u64).to_be_bytes());
                self.sha256.update(value);
            }
        }
    }

    /// The digest of all rows that were added.
    pub(super) fn finished(self) -> Digested {
        Digested { rows: self.rows, sha256: self.sha256.finalize().to_vec() }
    }
}

impl fmt::Display for Digested {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} rows (SHA-256 {})", self.rows, hex::encode(&self.sha256))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rows: &[&[Value]]) -> Digested {
        let rows: Vec<Vec<Value>> = rows.iter().map(|row| row.to_vec()).collect();
        let mut digest = TableDigest::default();
        digest.add(&rows);
        digest.finished()
    }

    fn text(text: &str) -> Value {
        Value::Text(Some(text.to_owned()))
    }

    #[test]
    fn the_bytes_are_those_that_are_described() {
        let row = [
            Value::Integer(Some(-2)),
            Value::Real(Some(1.5)),
            Value::Flag(Some(true)),
            text("é"),
            Value::Text(None),
        ];
        let mut bytes = vec![1, 255, 255, 255, 255, 255, 255, 255, 254];
        bytes.extend([2, 0x3f, 0xf8, 0, 0, 0, 0, 0, 0, 3, 1]);
        bytes.extend([4, 0, 0, 0, 0, 0, 0, 0, 2, 0xc3, 0xa9, 0]);
        assert_eq!(of(&[&row]), Digested { rows: 1, sha256: Sha256::digest(&bytes).to_vec() });
    }

    #[test]
    fn different_rows_have_different_digests_and_equal_ones_the_same() {
        let different: [&[&[Value]]; 9] = [
            &[],
            &[&[text("")]],
            &[&[Value::Text(None)]],
            &[&[text("ab"), text("c")]],
            &[&[text("a"), text("bc")]],
            &[&[text("a")], &[text("bc")]],
            &[&[Value::Integer(Some(1))]],
            &[&[Value::Flag(Some(true))]],
            &[&[Value::Real(Some(1.0))]],
        ];
        for (place, rows) in different.iter().enumerate() {
            for other in &different[place + 1..] {
                assert_ne!(of(rows), of(other), "{rows:?} {other:?}");
            }
        }
        assert_eq!(of(&[&[Value::Real(Some(-0.0))]]), of(&[&[Value::Real(Some(0.0))]]));
        assert_eq!(of(&[&[Value::Text(None)]]), of(&[&[Value::Integer(None)]]));
    }
}
