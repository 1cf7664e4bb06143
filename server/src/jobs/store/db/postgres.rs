//! What PostgreSQL needs besides the texts.
//!
//! One writer at a time, as in SQLite: each write takes an advisory lock of the database until its end. So every
//! transition of a job sees all others complete, whichever server made them, and no transaction waits for rows of
//! another. The lock is held from the begin to the commit: a few round trips and one write of PostgreSQL's log.

use std::fmt::Write as _;
use std::time::Duration;

use sqlx::postgres::{PgConnectOptions, PgPoolOptions, PgSslMode};
use sqlx::{Connection as _, PgConnection, PgPool, Postgres, Row as _, Transaction};

use super::connection::{Durability, WAIT, answered};
use crate::jobs::store::clock::Clock;
use crate::jobs::store::mark::Mark;

/// Begins a write, in one message. The lock is the word "packston" in ASCII; it is released with the transaction. The
/// database ends the transaction of a server that says nothing for ten seconds, which may be stopped or cut off, for
/// all others wait for the lock.
macro_rules! begin {
    ($settings:literal) => {
        concat!(
            "begin; set local idle_in_transaction_session_timeout = '10s'; ",
            $settings,
            "select pg_advisory_xact_lock(8097862918138523502)"
        )
    };
}
const BEGIN: &str = begin!("");
/// The same for a commit that may be lost with the machine.
const BEGIN_QUICK: &str = begin!("set local synchronous_commit = off; ");

/// The database's clock, in microseconds since the Unix epoch.
const CLOCK: &str = "select (extract(epoch from clock_timestamp()) * 1e6)::bigint";

/// Time after which a connection that nobody uses is closed.
const IDLE: Duration = Duration::from_mins(10);

/// Parameters of a URL that are understood.
const PARAMETERS: [&str; 17] = [
    "application_name",
    "dbname",
    "host",
    "hostaddr",
    "options",
    "password",
    "port",
    "ssl-ca",
    "ssl-cert",
    "ssl-key",
    "ssl-mode",
    "ssl-root-cert",
    "sslcert",
    "sslkey",
    "sslmode",
    "sslrootcert",
    "user",
];

/// How to reach the database of a URL, as libpq reads it: with `PGPASSWORD`, `PGPASSFILE` and the like where the URL
/// says nothing.
///
/// # Errors
/// The URL cannot be read, or has a parameter that is unknown: one that is misspelled, as `sslmod=verify-full`, would
/// leave the connection without encryption. The same holds for the value of `PGSSLMODE`.
pub(in super::super) fn options(url: &str) -> Result<PgConnectOptions, sqlx::Error> {
    let refused = |text: String| sqlx::Error::Configuration(text.into());
    let query = url.split_once('?').map(|(_, query)| query.split('#').next().unwrap_or_default());
    for (name, _) in form_urlencoded::parse(query.unwrap_or_default().as_bytes()) {
        let is_known = PARAMETERS.contains(&&*name)
            || name.starts_with("options[")
            || name == "statement-cache-capacity";
        if !is_known {
            return Err(refused(format!(
                "the parameter {name:?} is unknown: must be one of {}",
                PARAMETERS.join(", ")
            )));
        }
    }
    if let Ok(mode) = std::env::var("PGSSLMODE") {
        mode.parse::<PgSslMode>().map_err(|error| refused(format!("PGSSLMODE: {error}")))?;
    }
    Ok(url.parse::<PgConnectOptions>()?.application_name("packstone"))
}

/// Connections that read. Each makes sure that it reaches the database with this mark.
///
/// # Errors
/// The database's.
pub(super) async fn readers(
    options: &PgConnectOptions,
    most: u32,
    mark: Option<&Mark>,
) -> Result<PgPool, sqlx::Error> {
    let mark = mark.cloned();
    PgPoolOptions::new()
        .after_connect(move |connection, _| {
            let mark = mark.clone();
            Box::pin(async move {
                match mark {
                    Some(mark) => mark.check_postgres(connection).await,
                    None => Ok(()),
                }
            })
        })
        .max_connections(most)
        .acquire_timeout(WAIT)
        .idle_timeout(IDLE)
        .connect_with(options.clone().options([("default_transaction_read_only", "on")]))
        .await
}

/// Waits for the writers before, those of other servers among them, and begins a transaction. Looks at the database's
/// clock where the last look is some time ago.
///
/// # Errors
/// The database's.
pub(super) async fn begin_write<'c>(
    connection: &'c mut PgConnection,
    durability: Durability,
    clock: &Clock,
) -> Result<Transaction<'c, Postgres>, sqlx::Error> {
    let begin = match durability {
        Durability::PowerCut => BEGIN,
        Durability::ProcessEnd => BEGIN_QUICK,
    };
    let mut tx = answered(connection.begin_with(begin)).await?;
    if clock.is_stale() {
        clock.set(answered(sqlx::query(CLOCK).fetch_one(&mut *tx)).await?.try_get(0)?);
    }
    Ok(tx)
}

/// The hint to SQLite, before the name of an index.
const HINT: &str = " indexed by ";

/// The text as PostgreSQL takes it: its parameters are `$1` for `?1`, and for each bare `?` the next number; the names
/// of indices that SQLite is told to use are left out.
pub(super) fn translated(text: &str) -> String {
    let mut translated = String::with_capacity(text.len() + 16);
    let mut next = 1;
    let mut is_quoted = false;
    let mut rest = text;
    while let Some(character) = rest.chars().next() {
        if !is_quoted && let Some(hinted) = rest.strip_prefix(HINT) {
            let name = hinted.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(hinted.len());
            rest = &hinted[name..];
            continue;
        }
        rest = &rest[character.len_utf8()..];
        is_quoted ^= character == '\'';
        if character != '?' || is_quoted {
            translated.push(character);
            continue;
        }
        translated.push('$');
        if !rest.starts_with(|c: char| c.is_ascii_digit()) {
            // Writing to a string cannot fail.
            let _ = write!(translated, "{next}");
            next += 1;
        }
    }
    translated
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_get_the_numbers_that_they_have_in_sqlite_and_hints_are_left_out() {
        for (text, expected) in [
            ("select 1", "select 1"),
            ("values (?, ?, ?)", "values ($1, $2, $3)"),
            ("where a = ?2 and b = ?1 or c = ?12", "where a = $2 and b = $1 or c = $12"),
            ("where a = '?' and b = ?", "where a = '?' and b = $1"),
            ("where a = 'it''s ?' and b in (?,?)", "where a = 'it''s ?' and b in ($1,$2)"),
            ("from jobs indexed by jobs_by_state where a = ?", "from jobs where a = $1"),
            ("from jobs indexed by jobs_queue", "from jobs"),
            ("where a = ' indexed by x'", "where a = ' indexed by x'"),
        ] {
            assert_eq!(translated(text), expected);
        }
    }
}
