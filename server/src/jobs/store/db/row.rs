//! Rows of an answer.

use sqlx::sqlite::SqliteRow;
use sqlx::{ColumnIndex, Row as _};

/// A row of either database.
#[derive(Debug)]
pub(in super::super) enum Row {
    Sqlite(SqliteRow),
    Postgres(sqlx::postgres::PgRow),
}

/// The name of a column, or its place from 0.
pub(in super::super) trait Index:
    ColumnIndex<SqliteRow> + ColumnIndex<sqlx::postgres::PgRow>
{
}
impl<I: ColumnIndex<SqliteRow> + ColumnIndex<sqlx::postgres::PgRow>> Index for I {}

/// What a column can be read as.
pub(in super::super) trait Column: Sized {
    /// Reads the column.
    ///
    /// # Errors
    /// There is no such column, or it has another type.
    fn read<I: Index>(row: &Row, index: I) -> Result<Self, sqlx::Error>;
}

impl Row {
    /// The value of a column.
    ///
    /// # Errors
    /// There is no such column, or it has another type.
    pub(in super::super) fn try_get<T: Column>(&self, index: impl Index) -> Result<T, sqlx::Error> {
        T::read(self, index)
    }

    /// The text of a column, without a copy of it.
    ///
    /// # Errors
    /// There is no such column, or it is null or no text.
    pub(in super::super) fn text(&self, index: impl Index) -> Result<&str, sqlx::Error> {
        match self {
            Self::Sqlite(row) => row.try_get(index),
            Self::Postgres(row) => row.try_get(index),
        }
    }
}

macro_rules! columns {
    ($($type:ty),*) => {$(
        impl Column for $type {
            fn read<I: Index>(row: &Row, index: I) -> Result<Self, sqlx::Error> {
                match row {
                    Row::Sqlite(row) => row.try_get(index),
                    Row::Postgres(row) => row.try_get(index),
                }
            }
        }
    )*};
}

columns!(i64, f64, bool, String, Option<i64>, Option<f64>, Option<bool>, Option<String>);

/// Counts, whose columns hold 64 bits.
macro_rules! narrow_columns {
    ($($type:ty),*) => {$(
        impl Column for $type {
            fn read<I: Index>(row: &Row, index: I) -> Result<Self, sqlx::Error> {
                Self::try_from(i64::read(row, index)?).map_err(out_of_range)
            }
        }

        impl Column for Option<$type> {
            fn read<I: Index>(row: &Row, index: I) -> Result<Self, sqlx::Error> {
                Option::<i64>::read(row, index)?.map(<$type>::try_from).transpose().map_err(out_of_range)
            }
        }
    )*};
}

narrow_columns!(u16, u32);

fn out_of_range(error: std::num::TryFromIntError) -> sqlx::Error {
    sqlx::Error::Decode(Box::new(error))
}
