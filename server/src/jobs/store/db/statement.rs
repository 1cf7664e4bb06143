//! A text with its values, and its way to the database.

use sqlx::sqlite::SqliteArguments;
use sqlx::{AssertSqlSafe, SqlSafeStr as _, SqlStr, Sqlite};

use super::bind::{Bind, Value};
use super::connection::{Connection, Readers, Via, answered};
use super::row::{Column, Row};

/// The text of a query. None is made of what a client sent: values are bound.
#[derive(Clone, Debug)]
pub(in super::super) enum Text {
    /// Both databases understand it.
    Same(&'static str),
    /// Each has its own.
    Either {
        /// For SQLite.
        sqlite: &'static str,
        /// For PostgreSQL.
        postgres: &'static str,
    },
    /// Put together by a [`super::QueryBuilder`]; both understand it.
    Built(String),
}

/// A text for each of the databases.
pub(in super::super) const fn either(sqlite: &'static str, postgres: &'static str) -> Text {
    Text::Either { sqlite, postgres }
}

impl From<&'static str> for Text {
    fn from(text: &'static str) -> Self {
        Self::Same(text)
    }
}

impl Text {
    fn sqlite(self) -> SqlStr {
        match self {
            Self::Same(text) | Self::Either { sqlite: text, .. } => text.into_sql_str(),
            Self::Built(text) => AssertSqlSafe(text).into_sql_str(),
        }
    }

    fn postgres(&self) -> SqlStr {
        let text = match self {
            Self::Same(text) | Self::Either { postgres: text, .. } => text,
            Self::Built(text) => text.as_str(),
        };
        AssertSqlSafe(super::postgres::translated(text)).into_sql_str()
    }
}

/// A text with values for its parameters.
#[derive(Debug)]
#[must_use]
pub(in super::super) struct Query {
    text: Text,
    values: Vec<Value>,
}

/// Starts a query.
pub(in super::super) fn query(text: impl Into<Text>) -> Query {
    Query { text: text.into(), values: Vec::new() }
}

/// Where a query can run: in a transaction, as a single write, or among the readers.
pub(in super::super) trait Source<'s>: Send {
    /// The connection.
    fn via(self) -> Via<'s>;
}

impl<'s> Source<'s> for &'s Readers {
    fn via(self) -> Via<'s> {
        Readers::via(self)
    }
}

/// Outside a transaction, of a connection that has no more than this to do.
impl<'s> Source<'s> for &'s mut Connection {
    fn via(self) -> Via<'s> {
        match self {
            Connection::Sqlite(connection) => Via::Sqlite(connection),
            Connection::Postgres(connection) => Via::Postgres(connection),
        }
    }
}

impl<'s> Source<'s> for Via<'s> {
    fn via(self) -> Via<'s> {
        self
    }
}

/// What a query that answers nothing has done.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Done {
    rows_affected: u64,
}

impl Done {
    /// How many rows it changed.
    pub(in super::super) fn rows_affected(self) -> u64 {
        self.rows_affected
    }
}

impl Query {
    /// Binds the next parameter.
    pub(in super::super) fn bind(self, value: impl Bind) -> Self {
        self.bind_value(value.value())
    }

    /// The same for a value that is one already.
    pub(in super::super) fn bind_value(mut self, value: Value) -> Self {
        self.values.push(value);
        self
    }

    /// Runs it.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn execute<'s>(self, source: impl Source<'s>) -> Result<Done, sqlx::Error> {
        self.run(source.via()).await
    }

    /// All rows of its answer.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn fetch_all<'s>(
        self,
        source: impl Source<'s>,
    ) -> Result<Vec<Row>, sqlx::Error> {
        self.rows(source.via()).await
    }

    /// The first row of its answer, if it has any.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn fetch_optional<'s>(
        self,
        source: impl Source<'s>,
    ) -> Result<Option<Row>, sqlx::Error> {
        Ok(self.rows(source.via()).await?.into_iter().next())
    }

    /// The first row of its answer.
    ///
    /// # Errors
    /// [`sqlx::Error::RowNotFound`], or the database's.
    pub(in super::super) async fn fetch_one<'s>(self, source: impl Source<'s>) -> Result<Row, sqlx::Error> {
        self.fetch_optional(source).await?.ok_or(sqlx::Error::RowNotFound)
    }

    /// The first column of the first row, if there is one.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn optional_scalar<'s, T: Column>(
        self,
        source: impl Source<'s>,
    ) -> Result<Option<T>, sqlx::Error> {
        self.fetch_optional(source).await?.map(|row| row.try_get(0)).transpose()
    }

    /// The first column of the first row.
    ///
    /// # Errors
    /// [`sqlx::Error::RowNotFound`], or the database's.
    pub(in super::super) async fn scalar<'s, T: Column>(
        self,
        source: impl Source<'s>,
    ) -> Result<T, sqlx::Error> {
        self.fetch_one(source).await?.try_get(0)
    }

    /// The first column of all rows.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn scalars<'s, T: Column>(
        self,
        source: impl Source<'s>,
    ) -> Result<Vec<T>, sqlx::Error> {
        self.fetch_all(source).await?.iter().map(|row| row.try_get(0)).collect()
    }

    async fn run(self, via: Via<'_>) -> Result<Done, sqlx::Error> {
        let rows_affected = match via {
            Via::Sqlite(connection) => self.for_sqlite().execute(connection).await?.rows_affected(),
            Via::SqliteReaders(pool, _) => self.for_sqlite().execute(pool).await?.rows_affected(),
            Via::Postgres(connection) => {
                answered(self.for_postgres().execute(connection)).await?.rows_affected()
            }
            Via::PostgresReaders(pool, _) => {
                answered(self.for_postgres().execute(pool)).await?.rows_affected()
            }
            Via::PostgresWriter { connection, durability, clock, unusable } => {
                let begun = super::postgres::begin_write(connection, durability, clock).await;
                *unusable = begun.is_err();
                let mut tx = begun?;
                let done = answered(self.for_postgres().execute(&mut *tx)).await?;
                answered(tx.commit()).await?;
                done.rows_affected()
            }
        };
        Ok(Done { rows_affected })
    }

    async fn rows(self, via: Via<'_>) -> Result<Vec<Row>, sqlx::Error> {
        let of_sqlite = |rows: Vec<_>| rows.into_iter().map(Row::Sqlite).collect();
        let of_postgres = |rows: Vec<_>| rows.into_iter().map(Row::Postgres).collect();
        match via {
            Via::Sqlite(connection) => self.for_sqlite().fetch_all(connection).await.map(of_sqlite),
            Via::SqliteReaders(pool, damage) => answered(self.for_sqlite().fetch_all(pool))
                .await
                .map(of_sqlite)
                .inspect_err(|error| damage.note(error)),
            Via::Postgres(connection) => {
                answered(self.for_postgres().fetch_all(connection)).await.map(of_postgres)
            }
            Via::PostgresReaders(pool, damage) => answered(self.for_postgres().fetch_all(pool))
                .await
                .map(of_postgres)
                .inspect_err(|error| damage.note(error)),
            Via::PostgresWriter { connection, durability, clock, unusable } => {
                let begun = super::postgres::begin_write(connection, durability, clock).await;
                *unusable = begun.is_err();
                let mut tx = begun?;
                let rows = answered(self.for_postgres().fetch_all(&mut *tx)).await?;
                answered(tx.commit()).await?;
                Ok(of_postgres(rows))
            }
        }
    }

    fn for_sqlite(self) -> sqlx::query::Query<'static, Sqlite, SqliteArguments> {
        let mut query = sqlx::query(self.text.sqlite());
        for value in self.values {
            query = match value {
                Value::Integer(value) => query.bind(value),
                Value::Real(value) => query.bind(value),
                Value::Flag(value) => query.bind(value),
                Value::Text(value) => query.bind(value),
            };
        }
        query
    }

    /// PostgreSQL has no texts with U+0000. None is stored, because names are lines of text and documents escape it;
    /// the character that stands for others finds as little.
    fn for_postgres(self) -> sqlx::query::Query<'static, sqlx::Postgres, sqlx::postgres::PgArguments> {
        let mut query = sqlx::query(self.text.postgres());
        for value in self.values {
            query = match value {
                Value::Integer(value) => query.bind(value),
                Value::Real(value) => query.bind(value),
                Value::Flag(value) => query.bind(value),
                Value::Text(value) => query.bind(value.map(|text| text.replace('\0', "\u{fffd}"))),
            };
        }
        query
    }
}
