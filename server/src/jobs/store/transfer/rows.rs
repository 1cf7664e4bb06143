//! Reads the rows of a table in pages, and writes a page at once.

use std::fmt::Write as _;

use super::schema::{Kind, Table, quoted};
use crate::jobs::store::db::{QueryBuilder, Transaction, Value};

/// Most rows of a page.
const MOST_ROWS: usize = 1000;
/// Fewest rows whose lengths are looked at for the next page.
const FEWEST_LENGTHS: usize = 16;
/// A page ends before it has more bytes of text than this, unless a single row has: a request may have tens of
/// megabytes.
const MOST_BYTES: i64 = 8 << 20;
/// Most parameters of a statement: SQLite takes 32 766, PostgreSQL 65 535.
const MOST_PARAMETERS: usize = 32_000;

/// The pages of a table in the order of its primary key.
#[derive(Debug)]
pub(super) struct Pages<'t> {
    table: &'t Table,
    /// The columns, to be selected.
    columns: String,
    /// Bytes of all texts of a row.
    bytes: String,
    /// The key, to be ordered by.
    key: String,
    most_rows: usize,
    /// How many lengths are looked at for the next page.
    look_at: usize,
    /// The key of the last row.
    last: Option<Vec<Value>>,
}

impl<'t> Pages<'t> {
    /// All rows of a table.
    pub(super) fn of(table: &'t Table) -> Self {
        let mut bytes = "cast(0".to_owned();
        for text in table.columns.iter().filter(|column| column.kind == Kind::Text) {
            // Writing to a string cannot fail.
            let _ = write!(bytes, " + coalesce(octet_length({}), 0)", quoted(&text.name));
        }
        bytes.push_str(" as bigint)");
        Self {
            table,
            columns: Table::list(&table.columns),
            bytes,
            key: Table::list(table.key_columns()),
            most_rows: MOST_ROWS.min(MOST_PARAMETERS / table.columns.len()),
            look_at: FEWEST_LENGTHS,
            last: None,
        }
    }

    /// The rows of the next page, at least one; `None` after the last.
    ///
    /// # Errors
    /// The database's.
    pub(super) async fn next(
        &mut self,
        source: &mut Transaction<'_>,
    ) -> Result<Option<Vec<Vec<Value>>>, sqlx::Error> {
        let lengths: Vec<i64> = self.query(&self.bytes, self.look_at).build().scalars(&mut *source).await?;
        if lengths.is_empty() {
            return Ok(None);
        }
        let limit = rows_within(&lengths);
        let mut page = Vec::with_capacity(limit);
        for row in self.query(&self.columns, limit).build().fetch_all(source).await? {
            let columns = self.table.columns.iter().enumerate();
            let values: Result<Vec<Value>, _> =
                columns.map(|(place, column)| column.kind.value(&row, place)).collect();
            page.push(values?);
        }
        self.look_at = (4 * limit).clamp(FEWEST_LENGTHS, self.most_rows);
        let key = |row: &Vec<Value>| self.table.key.iter().map(|place| row[*place].clone()).collect();
        self.last = page.last().map(key);
        Ok(Some(page))
    }

    /// Selects `what` of so many rows after the last page.
    fn query(&self, what: &str, limit: usize) -> QueryBuilder {
        let mut query = QueryBuilder::new("select ");
        query.push(what).push(" from ").push(self.table.quoted());
        if let Some(last) = &self.last {
            query.push(format_args!(" where ({}) > (", self.key));
            for (place, value) in last.iter().enumerate() {
                query.push(if place == 0 { "" } else { ", " }).push_value(value.clone());
            }
            query.push(")");
        }
        query.push(format_args!(" order by {} limit {limit}", self.key));
        query
    }
}

/// How many of the first rows have no more bytes than a page may have; at least one.
fn rows_within(lengths: &[i64]) -> usize {
    let sums = lengths.iter().scan(0_i64, |sum, length| {
        *sum = sum.saturating_add(*length);
        Some(*sum)
    });
    sums.take_while(|sum| *sum <= MOST_BYTES).count().max(1)
}

/// Writes rows by one statement.
///
/// # Errors
/// The database's.
pub(super) async fn insert(
    destination: &mut Transaction<'_>,
    table: &Table,
    rows: Vec<Vec<Value>>,
) -> Result<(), sqlx::Error> {
    let columns = Table::list(&table.columns);
    let mut insert = QueryBuilder::new("insert into ");
    insert.push(format_args!("{} ({columns}) ", table.quoted()));
    insert.push_values(rows, |row, values| {
        for value in values {
            row.push_value(value);
        }
    });
    insert.build().execute(destination).await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_bounded_in_bytes_but_has_a_row() {
        assert_eq!(rows_within(&[1, 2, 3]), 3);
        assert_eq!(rows_within(&[MOST_BYTES - 1, 1, 1, 0]), 2);
        assert_eq!(rows_within(&[MOST_BYTES + 1, 1]), 1);
        assert_eq!(rows_within(&[1, i64::MAX, 1]), 1);
    }
}
