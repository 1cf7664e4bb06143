//! Queries whose text depends on what is asked for.

use std::fmt::{Display, Write as _};

use super::bind::{Bind, Value};
use super::statement::{Query, Text, query};

/// A text in the making, with the values for its parameters.
#[derive(Debug)]
pub(in super::super) struct QueryBuilder {
    text: String,
    values: Vec<Value>,
}

/// One row of values in an insert.
#[derive(Debug)]
pub(in super::super) struct RowOfValues<'a> {
    builder: &'a mut QueryBuilder,
    is_first: bool,
}

impl QueryBuilder {
    /// Starts with a text.
    pub(in super::super) fn new(text: &str) -> Self {
        Self { text: text.to_owned(), values: Vec::new() }
    }

    /// Adds to the text.
    pub(in super::super) fn push(&mut self, text: impl Display) -> &mut Self {
        // Writing to a string cannot fail.
        let _ = write!(self.text, "{text}");
        self
    }

    /// Adds a text before the present one, which has no values.
    pub(in super::super) fn prepend(&mut self, text: &str) -> &mut Self {
        self.text.insert_str(0, text);
        self
    }

    /// Adds a parameter with its value.
    pub(in super::super) fn push_bind(&mut self, value: impl Bind) -> &mut Self {
        self.text.push('?');
        self.values.push(value.value());
        self
    }

    /// The same for a value that is one already.
    pub(in super::super) fn push_value(&mut self, value: Value) -> &mut Self {
        self.text.push('?');
        self.values.push(value);
        self
    }

    /// Adds the word `values` and a row for each item.
    pub(in super::super) fn push_values<T>(
        &mut self,
        items: impl IntoIterator<Item = T>,
        mut row_of: impl FnMut(&mut RowOfValues<'_>, T),
    ) -> &mut Self {
        for (place, item) in items.into_iter().enumerate() {
            self.push(if place == 0 { "values (" } else { ", (" });
            row_of(&mut RowOfValues { builder: self, is_first: true }, item);
            self.push(")");
        }
        self
    }

    /// The finished query.
    pub(in super::super) fn build(self) -> Query {
        self.values.into_iter().fold(query(Text::Built(self.text)), Query::bind_value)
    }

    /// The text as SQLite takes it.
    #[cfg(test)]
    pub(in super::super) fn sql(&self) -> &str {
        &self.text
    }
}

impl RowOfValues<'_> {
    /// Adds a value to the row.
    pub(in super::super) fn push_bind(&mut self, value: impl Bind) -> &mut Self {
        self.separate();
        self.builder.push_bind(value);
        self
    }

    /// The same for a value that is one already.
    pub(in super::super) fn push_value(&mut self, value: Value) -> &mut Self {
        self.separate();
        self.builder.push_value(value);
        self
    }

    fn separate(&mut self) {
        if !std::mem::take(&mut self.is_first) {
            self.builder.push(", ");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_values_are_separated() {
        let mut builder = QueryBuilder::new("insert into t (a, b) ");
        builder.push_values([(1_i64, "x"), (2, "y")], |row, (a, b)| {
            row.push_bind(a).push_bind(b);
        });
        assert_eq!(builder.sql(), "insert into t (a, b) values (?, ?), (?, ?)");
        assert_eq!(builder.values[3], Value::Text(Some("y".into())));
    }
}
