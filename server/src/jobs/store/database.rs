//! Which database the store lies in.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use sqlx::sqlite::{SqliteAutoVacuum, SqliteConnectOptions, SqliteJournalMode, SqliteSynchronous};
use sqlx::{Connection as _, SqliteConnection};

use super::db::{Connection, Options, WAIT_FOR_LOCK, query};
use super::faults::{Fault, fault_of};
use super::servers::{Others, Servers};
use super::{StoreError, schema};
use crate::hex;

/// A database that a store can be opened in.
#[derive(Clone, Debug)]
pub(crate) enum Database {
    /// A file of SQLite, of which this process is the only writer.
    File(PathBuf),
    /// PostgreSQL.
    Postgres {
        options: Box<sqlx::postgres::PgConnectOptions>,
        /// Whether other servers may use it at the same time.
        is_shared: bool,
    },
}

/// An open database.
#[derive(Debug)]
pub(super) struct Opened {
    /// The connection that writes.
    pub(super) connection: Connection,
    /// How further connections are opened.
    pub(super) options: Options,
    /// Which database it is (see [`schema`]).
    pub(super) identity: String,
    /// The run of this service, as the file names it; none in PostgreSQL, which several servers may share.
    pub(super) run: Option<String>,
}

/// A text that names no database which this program can use.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum NoDatabase {
    /// It is no URL of PostgreSQL.
    #[error("must be a URL as postgres://user@host/database")]
    Scheme,
    /// The URL cannot be read.
    #[error("{0}")]
    Url(String),
}

impl From<&Path> for Database {
    fn from(file: &Path) -> Self {
        Self::File(file.to_owned())
    }
}

impl FromStr for Database {
    type Err = NoDatabase;

    fn from_str(text: &str) -> Result<Self, NoDatabase> {
        if !["postgres://", "postgresql://"].iter().any(|scheme| text.starts_with(scheme)) {
            return Err(NoDatabase::Scheme);
        }
        super::db::postgres::options(text)
            .map(|options| Self::Postgres { options: Box::new(options), is_shared: true })
            .map_err(|error| NoDatabase::Url(error.to_string()))
    }
}

/// Without a password.
impl fmt::Display for Database {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(file) => file.display().fmt(f),
            Self::Postgres { options, .. } => {
                let database = options.get_database().unwrap_or_else(|| options.get_username());
                write!(
                    f,
                    "postgres://{}@{}:{}/{database}",
                    options.get_username(),
                    options.get_host(),
                    options.get_port()
                )?;
                match options.get_socket() {
                    Some(socket) => write!(f, "?host={}", socket.display()),
                    None => Ok(()),
                }
            }
        }
    }
}

impl Database {
    /// Whether other servers may use it at the same time.
    pub(crate) fn is_shared(&self) -> bool {
        match self {
            Self::File(_) => false,
            Self::Postgres { is_shared, .. } => *is_shared,
        }
    }

    /// The file, where it is one.
    pub(crate) fn file(&self) -> Option<&Path> {
        match self {
            Self::File(file) => Some(file),
            Self::Postgres { .. } => None,
        }
    }

    /// The files that an open database has.
    pub(super) fn open_files(&self) -> Vec<PathBuf> {
        let Some(file) = self.file() else { return Vec::new() };
        // SQLite puts the log beside the file itself, whatever link its name is.
        let real = file.canonicalize().unwrap_or_else(|_| file.to_owned());
        let beside = |ending: &str| {
            let mut name = real.clone().into_os_string();
            name.push(ending);
            PathBuf::from(name)
        };
        vec![file.to_owned(), beside("-wal"), beside("-shm")]
    }

    /// The way to the other servers, with its other end, where there may be any.
    pub(super) fn servers(&self) -> Option<(Servers, Others)> {
        match self {
            Self::Postgres { options, is_shared: true } => Some(Servers::to(options)),
            _ => None,
        }
    }

    /// How connections are opened, to a file that exists, whatever journal it has.
    pub(super) fn options(&self) -> Options {
        match self {
            Self::File(file) => Options::Sqlite(Box::new(
                SqliteConnectOptions::new()
                    .filename(file)
                    // A 201 promises that the job survives a power cut.
                    .synchronous(SqliteSynchronous::Full)
                    .foreign_keys(true)
                    // Thousands of rows in one statement need room to undo it; on the disk that would be another file.
                    .pragma("temp_store", "memory")
                    .busy_timeout(WAIT_FOR_LOCK),
            )),
            Self::Postgres { options, .. } => Options::Postgres(options.clone()),
        }
    }

    /// Opens the connection that writes; makes a file that is missing, and tables where there are none.
    ///
    /// # Errors
    /// The database's, or its tables are not those of this version.
    pub(super) async fn open(&self) -> Result<Opened, StoreError> {
        match self.options() {
            Options::Sqlite(options) => {
                // Must be set before the file has its first page, which a write-ahead log makes.
                let first =
                    options.clone().create_if_missing(true).auto_vacuum(SqliteAutoVacuum::Incremental);
                let mut first = Connection::Sqlite(SqliteConnection::connect_with(&first).await?);
                let identity = schema::prepare(&mut first, self).await?;
                let run = hex::encode(&rand::random::<[u8; 16]>());
                let marked = query("update packstone set run = ?").bind(&run).execute(&mut first).await;
                let run = match marked {
                    Ok(_) => Some(run),
                    // A service starts on a full disk all the same, so that something can be deleted.
                    Err(error) if fault_of(&error) == Some(Fault::NoSpace) => None,
                    Err(error) => return Err(error.into()),
                };
                first.close().await?;
                let options = Options::Sqlite(Box::new(options.journal_mode(SqliteJournalMode::Wal)));
                Ok(Opened { connection: options.connect().await?, options, identity, run })
            }
            options @ Options::Postgres(_) => {
                let mut connection = options.connect().await?;
                let identity = schema::prepare(&mut connection, self).await?;
                Ok(Opened { connection, options, identity, run: None })
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_url_of_another_database_is_refused_with_the_form_that_is_asked_for() {
        for text in ["", "mysql://host/db", "packstone.sqlite", "postgres:/host"] {
            assert_eq!(text.parse::<Database>().err(), Some(NoDatabase::Scheme), "{text}");
        }
    }

    #[test]
    fn a_url_is_shown_without_its_password() {
        let database: Database = "postgres://lab:secret@db.example:5433/packstone".parse().unwrap();
        assert_eq!(database.to_string(), "postgres://lab@db.example:5433/packstone");
        assert!(database.is_shared() && database.file().is_none());
        let socket: Database = "postgres://lab:secret@localhost/packstone?host=/run/pg".parse().unwrap();
        assert_eq!(socket.to_string(), "postgres://lab@localhost:5432/packstone?host=/run/pg");
        assert!(matches!("postgres://host:port/db".parse::<Database>(), Err(NoDatabase::Url(_))));
        for misspelled in ["sslmod=verify-full", "sslmode=verify-ful", "host=/run/pg&ssl_mode=require"] {
            let refused = format!("postgres://lab:secret@db/packstone?{misspelled}").parse::<Database>();
            let Err(NoDatabase::Url(fault)) = refused else { panic!("{misspelled}") };
            assert!(!fault.contains("secret"), "{fault}");
        }
        assert!("postgres://lab@db/packstone?sslmode=verify-full".parse::<Database>().is_ok());
    }
}
