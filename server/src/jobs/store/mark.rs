//! What tells the open database from another one in its place.
//!
//! The row of the table `packstone` has the identity, which a backup has too. In SQLite it has besides the run of the
//! service, random and written at its start, and the number of the last transaction that has written. So a file that is
//! overwritten by a backup of another run, or rolled back to an earlier state of this one, is told: by SQLite's own
//! backup interface the connections see the other row. Bytes that are copied over the file are not seen by connections
//! that find the row in the write-ahead log; therefore the page of the row is read from the file, too. It names the run
//! from the start on, whatever is written to it later.
//!
//! PostgreSQL numbers the bytes of its write-ahead log, and what is on its disk outlives a crash. A whole cluster that
//! was put back to an earlier state ends before a number that this process has seen, and so does a standby that took
//! over without the last transactions.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicUsize, Ordering};
use std::thread::sleep;
use std::time::Duration;

use super::StoreError;
use super::db::{Connection, Text, Transaction, Via, either, query};
use super::presence::Unusable;

/// The identity of the database, with what changes when its tables are made again, and the run of the service.
const MARK: Text = either(
    "select id || ' ' || run from packstone",
    "select id || ' ' || tableoid || ' ' || (select oid from pg_database where datname = current_database())
     from packstone",
);
/// Number of the last byte of the write-ahead log of PostgreSQL that is on its disk.
const REACHED: &str = "select (pg_current_wal_flush_lsn() - '0/0')::bigint";
/// How often a page is read that does not name the run: SQLite may be writing it.
const READS: usize = 20;
/// Time between two of these.
const READ_AGAIN: Duration = Duration::from_millis(1);

/// The mark of the open database, as every new connection must find it.
#[derive(Clone, Debug)]
pub(super) struct Mark {
    text: String,
    /// Of PostgreSQL: the largest [`REACHED`] that this process has seen.
    reached: Arc<AtomicI64>,
    /// In SQLite, of which this process is the only writer.
    run: Option<Arc<Run>>,
}

/// The run of this service.
#[derive(Debug)]
struct Run {
    id: String,
    /// Number of the last transaction that has written, as far as this process knows.
    commits: Arc<AtomicI64>,
    page: Page,
}

/// The page of the file that has the row.
#[derive(Debug)]
struct Page {
    /// Open until the process ends: where any descriptor of the file is closed, SQLite loses its locks
    /// (<https://sqlite.org/howtocorrupt.html>, section 2.2).
    file: File,
    start: u64,
    bytes: usize,
    /// Where the run was found last.
    place: AtomicUsize,
    /// The file has named the run once. Before, the row may lie in the write-ahead log alone.
    was_found: AtomicBool,
}

impl Mark {
    /// Reads it from the first connection to a database, whose file was marked with the run.
    ///
    /// # Errors
    /// The database's, or those of its file.
    pub(super) async fn of(
        connection: &mut Connection,
        file: Option<&Path>,
        run: Option<String>,
    ) -> Result<Self, StoreError> {
        let text = query(MARK).scalar(&mut *connection).await?;
        let reached = Arc::default();
        let (Some(file), Some(id)) = (file, run) else { return Ok(Self { text, reached, run: None }) };
        let commits: i64 = query("select commits from packstone").scalar(&mut *connection).await?;
        let root = "select rootpage from sqlite_schema where type = 'table' and name = 'packstone'";
        let root: i64 = query(root).scalar(&mut *connection).await?;
        let bytes: i64 = query("select page_size from pragma_page_size").scalar(connection).await?;
        let page = Page {
            file: File::open(file).map_err(sqlx::Error::Io)?,
            start: (root.max(1) - 1).unsigned_abs() * bytes.unsigned_abs(),
            bytes: usize::try_from(bytes).unwrap_or_default(),
            place: AtomicUsize::default(),
            was_found: AtomicBool::default(),
        };
        let run = Run { id, commits: Arc::new(AtomicI64::new(commits)), page };
        Ok(Self { text, reached, run: Some(Arc::new(run)) })
    }

    /// Makes sure that a connection reaches the same database, in no earlier state.
    ///
    /// # Errors
    /// The database's, or it is another one.
    pub(super) async fn check(&self, connection: &mut Connection) -> Result<(), sqlx::Error> {
        if let Connection::Postgres(connection) = connection {
            return self.check_postgres(connection).await;
        }
        let committed = self.run.as_ref().map(|run| (run, run.commits.load(Ordering::Acquire)));
        self.compare(query(MARK).scalar(&mut *connection).await)?;
        let Some((run, committed)) = committed else { return Ok(()) };
        let found: i64 = query("select commits from packstone").scalar(connection).await?;
        if found < committed {
            return Err(other_database());
        }
        run.commits.fetch_max(found, Ordering::AcqRel);
        Ok(())
    }

    /// The same for a connection of a pool.
    ///
    /// # Errors
    /// As above.
    pub(super) async fn check_postgres(
        &self,
        connection: &mut sqlx::PgConnection,
    ) -> Result<(), sqlx::Error> {
        let before = self.reached.load(Ordering::Acquire);
        self.compare(query(MARK).scalar(Via::Postgres(&mut *connection)).await)?;
        let reached: i64 = match query(REACHED).scalar(Via::Postgres(connection)).await {
            Err(error) if has_no_log(&error) => return Ok(()),
            reached => reached?,
        };
        if reached < before {
            return Err(other_database());
        }
        self.reached.fetch_max(reached, Ordering::AcqRel);
        Ok(())
    }

    /// Counts a transaction that has begun to write, and makes sure that it follows all that were committed.
    ///
    /// # Errors
    /// The database's, or it is another one.
    pub(super) async fn count(&self, tx: &mut Transaction<'_>) -> Result<(), sqlx::Error> {
        let Some(run) = &self.run else { return Ok(()) };
        let text = "update packstone set commits = commits + 1 where run = ? returning commits";
        let number: Option<i64> = match query(text).bind(&run.id).optional_scalar(&mut *tx).await {
            Err(error) if has_no_tables(&error) => None,
            counted => counted?,
        };
        match number {
            Some(number) if number > run.commits.load(Ordering::Acquire) => {
                tx.set_number(number, &run.commits);
                Ok(())
            }
            _ => Err(other_database()),
        }
    }

    /// Whether the file still names the run of this service. Another fault of the file says nothing about that.
    pub(super) fn is_in_file(&self) -> bool {
        let Some(run) = &self.run else { return true };
        for _ in 0..READS {
            match run.page.names(&run.id) {
                Ok(false) if run.page.was_found.load(Ordering::Acquire) => sleep(READ_AGAIN),
                _ => return true,
            }
        }
        false
    }

    fn compare(&self, found: Result<String, sqlx::Error>) -> Result<(), sqlx::Error> {
        match found {
            Ok(found) if found == self.text => Ok(()),
            Ok(_) => Err(other_database()),
            Err(error) if has_no_tables(&error) => Err(other_database()),
            Err(error) => Err(error),
        }
    }
}

impl Page {
    /// Whether the page names this run. A file that ends before it does not.
    fn names(&self, run: &str) -> io::Result<bool> {
        let mut page = vec![0; self.bytes];
        match self.file.read_exact_at(&mut page, self.start) {
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(false),
            read => read?,
        }
        let at = self.place.load(Ordering::Relaxed);
        if page.get(at..at + run.len()) == Some(run.as_bytes()) {
            return Ok(true);
        }
        let Some(at) = page.windows(run.len()).position(|part| part == run.as_bytes()) else {
            return Ok(false);
        };
        self.place.store(at, Ordering::Relaxed);
        self.was_found.store(true, Ordering::Release);
        Ok(true)
    }
}

/// Another database answers where ours did. The text is that of [`Unusable::DatabaseReplaced`].
fn other_database() -> sqlx::Error {
    sqlx::Error::Configuration(Box::new(Unusable::DatabaseReplaced))
}

/// Whether an error says that another database answers.
pub(super) fn is_other_database(error: &sqlx::Error) -> bool {
    matches!(error, sqlx::Error::Configuration(why) if why.is::<Unusable>())
}

/// Whether the database does not tell of its write-ahead log: it is a standby, one that speaks as PostgreSQL does
/// without such a log, or lets this user not ask.
fn has_no_log(error: &sqlx::Error) -> bool {
    let sqlx::Error::Database(error) = error else { return false };
    matches!(error.code().as_deref(), Some("55000" | "0A000" | "42883" | "42501"))
}

/// Whether the tables are gone, or the database itself.
pub(super) fn has_no_tables(error: &sqlx::Error) -> bool {
    let sqlx::Error::Database(error) = error else { return matches!(error, sqlx::Error::RowNotFound) };
    if error.try_downcast_ref::<sqlx::postgres::PgDatabaseError>().is_some() {
        return matches!(error.code().as_deref(), Some("42P01" | "3D000"));
    }
    error.message().starts_with("no such table")
}
