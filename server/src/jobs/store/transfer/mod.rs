//! Moves all that a store holds from SQLite to PostgreSQL or back, and verifies the copy by digest.
//!
//! The tables are copied row by row, as they are. What the triggers keep (counts, sums, turns of the queue) lies in
//! tables too: the triggers of the destination are off until all rows are in, or they would count every row a second
//! time. All of it is one transaction of the destination, so that a copy that breaks off leaves the destination empty.
//! The source is read in one transaction and not changed. Meanwhile this process holds the writer's lock of both
//! databases: a server that starts in the middle waits for the end.
//!
//! The digest of a table is the SHA-256 of its rows in the order of the primary key, in a form that does not depend on
//! the database ([`digest`]). That of the source is taken of what is read there, that of the destination of what is
//! read back; they are compared before the commit.
//!
//! Names, columns, types and keys of the tables come from PostgreSQL's own catalogue ([`schema`]): a table that is
//! added later is moved without a change here. The identity of the database moves with the rows: the files of results
//! stay where they are, and belong to the destination from then on.

mod digest;
mod rows;
mod schema;
mod side;
#[cfg(test)]
mod tests;

use super::clock::Clock;
use super::database::Opened;
use super::db::{Durability, Transaction};
use super::presence::Damage;
use super::{Database, StoreError};
use crate::hex;
use digest::TableDigest;
use rows::Pages;
use schema::Table;

/// Why a store was not moved. The destination is as empty as before.
#[derive(Debug, thiserror::Error)]
pub(crate) enum TransferError {
    /// One of the databases failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Both are of one kind.
    #[error(
        "one of the two must be PostgreSQL and the other a data directory, but these are {from} and {to}"
    )]
    SameKind {
        /// The source.
        from: String,
        /// The destination.
        to: String,
    },
    /// Someone else uses a database.
    #[error(
        "{database} is in use: {connections} other connections of packstone are open. Stop the servers that use it, or \
         say --force to move it nevertheless"
    )]
    InUse {
        /// The database.
        database: String,
        /// How many connections.
        connections: i64,
    },
    /// The destination has rows.
    #[error("{database} is not empty, and must be: it holds {}", rows_of(.tables))]
    NotEmpty {
        /// The destination.
        database: String,
        /// Tables and how many rows they have.
        tables: Vec<(String, u64)>,
    },
    /// The tables of the two databases differ.
    #[error("the two databases have different tables: {0}. This is a defect of Packstone")]
    Schema(String),
    /// What was read back is not what was written.
    #[error("the copy of the table {table} differs: {what}. Nothing was moved")]
    Differs {
        /// The table.
        table: String,
        /// Both sides.
        what: String,
    },
}

impl From<sqlx::Error> for TransferError {
    fn from(error: sqlx::Error) -> Self {
        Self::Store(error.into())
    }
}

/// Tables with their numbers of rows, as words.
fn rows_of(tables: &[(String, u64)]) -> String {
    tables.iter().map(|(table, rows)| format!("{rows} rows in {table}")).collect::<Vec<_>>().join(", ")
}

/// A table that was moved.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Moved {
    /// Its name.
    pub(crate) table: String,
    /// How many rows it has.
    pub(crate) rows: u64,
    /// SHA-256 of all of them, in hexadecimal.
    pub(crate) sha256: String,
}

/// Rows copied and verified so far, and how many that will be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Progress {
    /// Rows that were written.
    pub(crate) copied: u64,
    /// Rows that were read back.
    pub(crate) verified: u64,
    /// Rows of the source.
    pub(crate) rows: u64,
}

/// A store to be moved.
#[derive(Clone, Debug)]
pub(crate) struct Transfer {
    from: Database,
    to: Database,
}

impl Transfer {
    /// From one database to another.
    ///
    /// # Errors
    /// [`TransferError::SameKind`].
    pub(crate) fn new(from: Database, to: Database) -> Result<Self, TransferError> {
        if from.file().is_some() == to.file().is_some() {
            return Err(TransferError::SameKind { from: from.to_string(), to: to.to_string() });
        }
        Ok(Self { from, to })
    }

    /// The source.
    pub(crate) fn from(&self) -> &Database {
        &self.from
    }

    /// The destination.
    pub(crate) fn to(&self) -> &Database {
        &self.to
    }

    /// Moves all rows, and returns the tables by name. The file of SQLite must be locked by the caller as the service
    /// does it. `force` moves a database of PostgreSQL although connections of other processes are open.
    ///
    /// # Errors
    /// See [`TransferError`].
    pub(crate) async fn run(
        &self,
        force: bool,
        mut progress: impl FnMut(Progress),
    ) -> Result<Vec<Moved>, TransferError> {
        let Opened { connection: mut source, options, .. } = self.from.open().await?;
        let Opened { connection: mut destination, .. } = self.to.open().await?;
        if !force {
            side::refuse_others(&mut source, &self.from).await?;
            side::refuse_others(&mut destination, &self.to).await?;
        }
        let clock = Clock::default();
        // Held, never used: nobody else writes to the source.
        let held = source.begin_write(Durability::PowerCut, &clock).await?;
        let readers = options.readers(None, &Damage::default()).await?;
        let mut from = readers.begin().await?;
        let mut to = destination.begin_write(Durability::PowerCut, &clock).await?;
        let moved = self.copy(&mut from, &mut to, &mut progress).await?;
        to.commit().await?;
        from.rollback().await?;
        held.rollback().await?;
        readers.close().await;
        destination.close().await?;
        source.close().await?;
        Ok(moved)
    }

    async fn copy(
        &self,
        from: &mut Transaction<'_>,
        to: &mut Transaction<'_>,
        progress: &mut impl FnMut(Progress),
    ) -> Result<Vec<Moved>, TransferError> {
        let tables = if self.from.file().is_some() {
            schema::read(to, from).await?
        } else {
            schema::read(from, to).await?
        };
        side::refuse_rows(to, &tables, &self.to).await?;
        let mut done = Progress::default();
        for table in &tables {
            done.rows += side::rows_in(from, table).await?;
        }
        let triggers = side::without_triggers(to, &tables).await?;
        side::clear(to, &tables).await?;
        let mut read = Vec::new();
        for table in &tables {
            read.push(
                copy_table(from, to, table, &mut |rows| {
                    done.copied += rows;
                    progress(done);
                })
                .await?,
            );
            side::copy_last_number(from, to, table).await?;
        }
        side::with_triggers(to, &tables, triggers).await?;
        let mut moved = Vec::new();
        for (table, expected) in tables.iter().zip(read) {
            let found = digest_of(to, table, &mut |rows| {
                done.verified += rows;
                progress(done);
            })
            .await?;
            if found != expected {
                let what = format!("{found} were read back of {expected}");
                return Err(TransferError::Differs { table: table.name.clone(), what });
            }
            let sha256 = hex::encode(&found.sha256);
            moved.push(Moved { table: table.name.clone(), rows: found.rows, sha256 });
        }
        moved.sort_by(|one, other| one.table.cmp(&other.table));
        Ok(moved)
    }
}

/// Copies the rows of a table, and returns the digest of what was read.
async fn copy_table(
    from: &mut Transaction<'_>,
    to: &mut Transaction<'_>,
    table: &Table,
    copied: &mut impl FnMut(u64),
) -> Result<digest::Digested, TransferError> {
    let mut digest = TableDigest::default();
    let mut pages = Pages::of(table);
    while let Some(page) = pages.next(from).await? {
        digest.add(&page);
        let rows = page.len() as u64;
        rows::insert(to, table, page).await?;
        copied(rows);
    }
    Ok(digest.finished())
}

/// The digest of a table.
async fn digest_of(
    source: &mut Transaction<'_>,
    table: &Table,
    verified: &mut impl FnMut(u64),
) -> Result<digest::Digested, TransferError> {
    let mut digest = TableDigest::default();
    let mut pages = Pages::of(table);
    while let Some(page) = pages.next(source).await? {
        digest.add(&page);
        verified(page.len() as u64);
    }
    Ok(digest.finished())
}
