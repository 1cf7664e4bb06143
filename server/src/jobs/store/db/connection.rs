//! The connection that writes, and those that read.

use std::time::{Duration, Instant};

use sqlx::sqlite::{SqliteConnectOptions, SqlitePoolOptions};
use sqlx::{Connection as _, SqliteConnection, SqlitePool};

use super::transaction::Transaction;
use crate::jobs::store::clock::Clock;
use crate::jobs::store::mark::Mark;
use crate::jobs::store::presence::Damage;

/// Readers at once. Reads take microseconds; the pool only has to outnumber the cores.
const READERS: u32 = 4;
/// How long a reader waits for a connection.
pub(in super::super) const WAIT: Duration = Duration::from_secs(10);
/// How long a writer waits for a lock that another program holds on the file (`sqlite3` in a terminal).
pub(in super::super) const WAIT_FOR_LOCK: Duration = Duration::from_secs(3);
/// The same after it was waited for in vain, so that writes that wait for each other are refused soon.
pub(in super::super) const WAIT_FOR_HELD_LOCK: Duration = Duration::from_millis(200);

/// Longest wait for the answer to a statement: a connection may hang without an error.
const ANSWER_WITHIN: Duration = Duration::from_secs(30);

/// Waits for an answer for a bounded time.
///
/// # Errors
/// That of the answer, or [`std::io::ErrorKind::TimedOut`].
pub(in super::super) async fn answered<T>(
    answer: impl Future<Output = Result<T, sqlx::Error>>,
) -> Result<T, sqlx::Error> {
    let silent =
        || sqlx::Error::Io(std::io::Error::new(std::io::ErrorKind::TimedOut, "the database is silent"));
    tokio::time::timeout(ANSWER_WITHIN, answer).await.unwrap_or_else(|_elapsed| Err(silent()))
}

/// A connection that nobody has used for so long is asked whether it is still there.
const ASK_AFTER: Duration = Duration::from_millis(500);

/// What a commit survives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) enum Durability {
    /// A power cut: the commit waits for the disk.
    PowerCut,
    /// The end of the process only; the next commit of the other kind takes this one to the disk with it.
    ProcessEnd,
}

/// How to reach the database.
#[derive(Clone, Debug)]
pub(in super::super) enum Options {
    Sqlite(Box<SqliteConnectOptions>),
    Postgres(Box<sqlx::postgres::PgConnectOptions>),
}

/// A connection that may write.
#[derive(Debug)]
pub(in super::super) enum Connection {
    Sqlite(SqliteConnection),
    Postgres(sqlx::PgConnection),
}

/// The connections that only read, and never wait for a writer.
#[derive(Clone, Debug)]
pub(in super::super) enum Readers {
    Sqlite(SqlitePool, Damage),
    Postgres(sqlx::PgPool, Damage),
}

/// The way of one query to the database.
#[derive(Debug)]
pub(in super::super) enum Via<'c> {
    Sqlite(&'c mut SqliteConnection),
    SqliteReaders(&'c SqlitePool, &'c Damage),
    Postgres(&'c mut sqlx::PgConnection),
    PostgresReaders(&'c sqlx::PgPool, &'c Damage),
    /// A write outside a transaction, which gets one of its own.
    PostgresWriter {
        connection: &'c mut sqlx::PgConnection,
        durability: Durability,
        clock: &'c Clock,
        /// Set where the connection turns out to be gone.
        unusable: &'c mut bool,
    },
}

impl Options {
    /// Opens a connection that may write, for [`Durability::PowerCut`].
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn connect(&self) -> Result<Connection, sqlx::Error> {
        match self {
            Self::Sqlite(options) => SqliteConnection::connect_with(options).await.map(Connection::Sqlite),
            Self::Postgres(options) => {
                answered(sqlx::PgConnection::connect_with(options)).await.map(Connection::Postgres)
            }
        }
    }

    /// Opens a connection that reads.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn connect_to_read(&self) -> Result<Connection, sqlx::Error> {
        match self {
            Self::Sqlite(options) => {
                let options = options.as_ref().clone().create_if_missing(false).read_only(true);
                SqliteConnection::connect_with(&options).await.map(Connection::Sqlite)
            }
            Self::Postgres(_) => self.connect().await,
        }
    }

    /// Opens the connections that read; each makes sure that it reaches the database with this mark. Damaged pages that
    /// they meet are noted.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn readers(
        &self,
        mark: Option<&Mark>,
        damage: &Damage,
    ) -> Result<Readers, sqlx::Error> {
        match self {
            Self::Sqlite(options) => {
                let pool = SqlitePoolOptions::new()
                    .max_connections(READERS)
                    .min_connections(1)
                    .acquire_timeout(WAIT)
                    // Readers only ever close with the process: no pings, no recycling.
                    .test_before_acquire(false)
                    .idle_timeout(None)
                    .max_lifetime(None)
                    .connect_with(options.as_ref().clone().create_if_missing(false).read_only(true));
                Ok(Readers::Sqlite(pool.await?, damage.clone()))
            }
            Self::Postgres(options) => {
                let pool = super::postgres::readers(options, READERS, mark).await?;
                Ok(Readers::Postgres(pool, damage.clone()))
            }
        }
    }
}

impl Connection {
    /// Whether it answers and is in no transaction. A transaction that was dropped is rolled back before it answers.
    /// A connection that was `used` a moment ago is not asked.
    pub(in super::super) async fn is_idle(&mut self, used: Option<Instant>) -> bool {
        let answers = used.is_some_and(|used| used.elapsed() < ASK_AFTER);
        if answers && !self.is_in_transaction() {
            return true;
        }
        let answers = match self {
            Self::Sqlite(connection) => connection.ping().await.is_ok(),
            Self::Postgres(connection) => answered(connection.ping()).await.is_ok(),
        };
        answers && !self.is_in_transaction()
    }

    fn is_in_transaction(&self) -> bool {
        match self {
            Self::Sqlite(connection) => connection.is_in_transaction(),
            Self::Postgres(connection) => connection.is_in_transaction(),
        }
    }

    /// Makes the next commit survive this much, where that is not said with its begin.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn set_durability(
        &mut self,
        durability: Durability,
    ) -> Result<(), sqlx::Error> {
        match self {
            Self::Sqlite(connection) => {
                let pragma = match durability {
                    Durability::PowerCut => "pragma synchronous = full",
                    Durability::ProcessEnd => "pragma synchronous = normal",
                };
                sqlx::query(pragma).execute(connection).await?;
            }
            Self::Postgres(_) => {}
        }
        Ok(())
    }

    /// Waits for so long for a lock that another program holds on the file, where the database is one.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn set_lock_wait(&mut self, longest: Duration) -> Result<(), sqlx::Error> {
        if let Self::Sqlite(connection) = self {
            let text = sqlx::AssertSqlSafe(format!("pragma busy_timeout = {}", longest.as_millis()));
            sqlx::query(text).execute(connection).await?;
        }
        Ok(())
    }

    /// Begins a transaction that may write from its start on, and is the only one that does. The clock is set by that
    /// of the database where it has one of its own.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn begin_write(
        &mut self,
        durability: Durability,
        clock: &Clock,
    ) -> Result<Transaction<'_>, sqlx::Error> {
        match self {
            Self::Sqlite(connection) => {
                let begun = connection.begin_with("begin immediate").await;
                begun.map(|tx| Transaction::Sqlite(tx, None))
            }
            Self::Postgres(connection) => {
                super::postgres::begin_write(connection, durability, clock).await.map(Transaction::Postgres)
            }
        }
    }

    /// The way of a single write.
    pub(in super::super) fn via_write<'c>(
        &'c mut self,
        durability: Durability,
        clock: &'c Clock,
        unusable: &'c mut bool,
    ) -> Via<'c> {
        match self {
            Self::Sqlite(connection) => Via::Sqlite(connection),
            Self::Postgres(connection) => Via::PostgresWriter { connection, durability, clock, unusable },
        }
    }

    /// Copies the write-ahead log into the file, where the database is one.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn fold_log(&mut self) -> Result<(), sqlx::Error> {
        match self {
            Self::Sqlite(connection) => {
                sqlx::query("pragma wal_checkpoint(truncate)").execute(connection).await?;
            }
            Self::Postgres(_) => {}
        }
        Ok(())
    }

    /// Closes it, and waits until it is closed: SQLite then removes its log.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn close(self) -> Result<(), sqlx::Error> {
        match self {
            Self::Sqlite(connection) => connection.close().await,
            Self::Postgres(connection) => connection.close().await,
        }
    }
}

impl Readers {
    /// Begins a transaction that sees one state of the database throughout.
    ///
    /// # Errors
    /// The database's.
    pub(in super::super) async fn begin(&self) -> Result<Transaction<'static>, sqlx::Error> {
        match self {
            Self::Sqlite(pool, _) => pool.begin().await.map(|tx| Transaction::Sqlite(tx, None)),
            Self::Postgres(pool, _) => {
                let begun =
                    answered(pool.begin_with("begin isolation level repeatable read read only")).await;
                begun.map(Transaction::Postgres)
            }
        }
    }

    /// Closes all of them.
    pub(in super::super) async fn close(&self) {
        match self {
            Self::Sqlite(pool, _) => pool.close().await,
            Self::Postgres(pool, _) => pool.close().await,
        }
    }

    pub(super) fn via(&self) -> Via<'_> {
        match self {
            Self::Sqlite(pool, damage) => Via::SqliteReaders(pool, damage),
            Self::Postgres(pool, damage) => Via::PostgresReaders(pool, damage),
        }
    }
}
