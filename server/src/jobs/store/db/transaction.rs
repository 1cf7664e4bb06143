//! Transactions.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use sqlx::Sqlite;

use super::connection::Via;
use super::connection::answered;
use super::statement::Source;

/// A transaction; dropped without [`Self::commit`], it is rolled back.
#[derive(Debug)]
pub(in super::super) enum Transaction<'c> {
    Sqlite(sqlx::Transaction<'c, Sqlite>, Option<CommitNumber>),
    Postgres(sqlx::Transaction<'c, sqlx::Postgres>),
}

/// The number that a transaction gives to its commit, and where that of the last commit is kept.
#[derive(Debug)]
pub(in super::super) struct CommitNumber {
    number: i64,
    last: Arc<AtomicI64>,
}

impl Transaction<'_> {
    /// Keeps the number of its commit in `last` once it is committed.
    pub(in super::super) fn set_number(&mut self, number: i64, last: &Arc<AtomicI64>) {
        match self {
            Self::Sqlite(_, kept) => *kept = Some(CommitNumber { number, last: Arc::clone(last) }),
            Self::Postgres(_) => {}
        }
    }

    /// Runs a text of several statements, which has no parameters.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn run_script(&mut self, text: &'static str) -> Result<(), sqlx::Error> {
        let script = sqlx::raw_sql(text);
        match self {
            Self::Sqlite(tx, _) => script.execute(&mut **tx).await.map(drop),
            Self::Postgres(tx) => answered(script.execute(&mut **tx)).await.map(drop),
        }
    }

    /// Lets [`Self::roll_back_to_savepoint`] take back what follows, and no longer what came before. sqlx does not know
    /// of it: its own count of transactions is wrong where SQLite has rolled all of it back by itself.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn set_savepoint(&mut self, is_first: bool) -> Result<(), sqlx::Error> {
        let next = "release savepoint shared_write; savepoint shared_write";
        self.run_script(if is_first { "savepoint shared_write" } else { next }).await
    }

    /// Takes back what followed the savepoint.
    ///
    /// # Errors
    /// The database's; then all of the transaction is lost, as where SQLite has rolled it back by itself.
    pub(in super::super) async fn roll_back_to_savepoint(&mut self) -> Result<(), sqlx::Error> {
        self.run_script("rollback to savepoint shared_write").await
    }

    /// Makes its changes last.
    ///
    /// # Errors
    /// The database's; then nothing is changed, unless the connection broke off in the very moment.
    pub(in super::super) async fn commit(self) -> Result<(), sqlx::Error> {
        match self {
            Self::Sqlite(tx, number) => {
                tx.commit().await?;
                if let Some(CommitNumber { number, last }) = number {
                    last.fetch_max(number, Ordering::AcqRel);
                }
                Ok(())
            }
            Self::Postgres(tx) => answered(tx.commit()).await,
        }
    }

    /// Takes its changes back.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn rollback(self) -> Result<(), sqlx::Error> {
        match self {
            Self::Sqlite(tx, _) => tx.rollback().await,
            Self::Postgres(tx) => answered(tx.rollback()).await,
        }
    }
}

impl<'s> Source<'s> for &'s mut Transaction<'_> {
    fn via(self) -> Via<'s> {
        match self {
            Transaction::Sqlite(tx, _) => Via::Sqlite(tx),
            Transaction::Postgres(tx) => Via::Postgres(tx),
        }
    }
}
