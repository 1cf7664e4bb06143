//! What is done to one of the two databases: whether it may be moved, its triggers, and the numbers it has given.

use std::time::Duration;

use tokio::time::{Instant, sleep};

use super::TransferError;
use super::schema::{Table, quoted};
use crate::jobs::store::Database;
use crate::jobs::store::db::{Connection, QueryBuilder, Transaction, query};

/// Tables that have rows from the start: sums for each state or kind, and the identity of the database.
const SEEDED: [&str; 4] = ["export_counts", "job_counts", "packstone", "stored_bytes"];
/// The connections of a server that has ended are gone so long after it.
const GONE_WITHIN: Duration = Duration::from_secs(3);
/// Time between two looks at them.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Connections of servers: PostgreSQL shows the names of programs to every user.
const OTHERS: &str = "
    select count(*) from pg_stat_activity
    where datname = current_database() and application_name = 'packstone' and pid <> pg_backend_pid()";

/// Refuses a database of PostgreSQL that servers are connected to. A file of SQLite is locked with its directory.
///
/// # Errors
/// [`TransferError::InUse`], or the database's.
pub(super) async fn refuse_others(
    connection: &mut Connection,
    database: &Database,
) -> Result<(), TransferError> {
    let Connection::Postgres(connection) = connection else { return Ok(()) };
    let until = Instant::now() + GONE_WITHIN;
    loop {
        let connections: i64 = sqlx::query_scalar(OTHERS).fetch_one(&mut *connection).await?;
        if connections == 0 {
            return Ok(());
        }
        if Instant::now() >= until {
            return Err(TransferError::InUse { database: database.to_string(), connections });
        }
        sleep(LOOK_EVERY).await;
    }
}

/// Refuses a destination that has rows besides those from the start.
///
/// # Errors
/// [`TransferError::NotEmpty`], or the database's.
pub(super) async fn refuse_rows(
    destination: &mut Transaction<'_>,
    tables: &[Table],
    database: &Database,
) -> Result<(), TransferError> {
    let mut filled = Vec::new();
    for table in tables.iter().filter(|table| !SEEDED.contains(&table.name.as_str())) {
        match rows_in(destination, table).await? {
            0 => {}
            rows => filled.push((table.name.clone(), rows)),
        }
    }
    if filled.is_empty() {
        return Ok(());
    }
    Err(TransferError::NotEmpty { database: database.to_string(), tables: filled })
}

/// How many rows a table has.
///
/// # Errors
/// The database's.
pub(super) async fn rows_in(source: &mut Transaction<'_>, table: &Table) -> Result<u64, sqlx::Error> {
    let rows: i64 = built(format!("select count(*) from {}", table.quoted())).build().scalar(source).await?;
    Ok(rows.cast_unsigned())
}

/// Turns the triggers off. PostgreSQL knows that; from SQLite they are removed, and their texts returned.
///
/// # Errors
/// The database's.
pub(super) async fn without_triggers(
    destination: &mut Transaction<'_>,
    tables: &[Table],
) -> Result<Vec<String>, sqlx::Error> {
    if matches!(destination, Transaction::Postgres(_)) {
        for table in tables {
            let off = format!("alter table {} disable trigger user", table.quoted());
            built(off).build().execute(&mut *destination).await?;
        }
        return Ok(Vec::new());
    }
    let mut texts = Vec::new();
    let triggers = "select name, sql from sqlite_schema where type = 'trigger' order by rowid";
    for trigger in query(triggers).fetch_all(&mut *destination).await? {
        built(format!("drop trigger {}", quoted(trigger.text(0)?)))
            .build()
            .execute(&mut *destination)
            .await?;
        texts.push(trigger.try_get(1)?);
    }
    Ok(texts)
}

/// Turns the triggers on again; PostgreSQL also gets the statistics that its planner needs.
///
/// # Errors
/// The database's.
pub(super) async fn with_triggers(
    destination: &mut Transaction<'_>,
    tables: &[Table],
    texts: Vec<String>,
) -> Result<(), sqlx::Error> {
    for text in texts {
        built(text).build().execute(&mut *destination).await?;
    }
    if matches!(destination, Transaction::Postgres(_)) {
        for table in tables {
            let table = table.quoted();
            for statement in [format!("alter table {table} enable trigger user"), format!("analyze {table}")]
            {
                built(statement).build().execute(&mut *destination).await?;
            }
        }
    }
    Ok(())
}

/// Removes the rows that tables have from the start.
///
/// # Errors
/// The database's.
pub(super) async fn clear(destination: &mut Transaction<'_>, tables: &[Table]) -> Result<(), sqlx::Error> {
    for table in tables.iter().filter(|table| SEEDED.contains(&table.name.as_str())) {
        built(format!("delete from {}", table.quoted())).build().execute(&mut *destination).await?;
    }
    Ok(())
}

/// Makes the destination go on with its numbers where the source has stopped, so that none is given twice. The rows
/// must have been copied.
///
/// # Errors
/// The databases', or the destination counts otherwise.
pub(super) async fn copy_last_number(
    from: &mut Transaction<'_>,
    to: &mut Transaction<'_>,
    table: &Table,
) -> Result<(), TransferError> {
    let Some(column) = &table.numbered else { return Ok(()) };
    let last = last_number(from, table, column).await?;
    if matches!(to, Transaction::Postgres(_)) {
        let next = last.saturating_add(1);
        let restart =
            format!("alter table {} alter column {} restart with {next}", table.quoted(), quoted(column));
        built(restart).build().execute(&mut *to).await?;
    } else if is_counted(to, table).await? {
        query("delete from sqlite_sequence where name = ?").bind(&table.name).execute(&mut *to).await?;
        let insert = query("insert into sqlite_sequence (name, seq) values (?, ?)");
        insert.bind(&table.name).bind(last).execute(&mut *to).await?;
    } else {
        // SQLite numbers this table by its greatest row.
        return Ok(());
    }
    let found = last_number(to, table, column).await?;
    if found != last {
        let what = format!("its last number is {found} instead of {last}");
        return Err(TransferError::Differs { table: table.name.clone(), what });
    }
    Ok(())
}

/// The last number that was given; 0 where there was none.
async fn last_number(source: &mut Transaction<'_>, table: &Table, column: &str) -> Result<i64, sqlx::Error> {
    if matches!(source, Transaction::Postgres(_)) {
        let sequence = query("select pg_get_serial_sequence(?, ?)").bind(table.quoted()).bind(column);
        let sequence: String = sequence.scalar(&mut *source).await?;
        // The name comes quoted where it has to be.
        let last =
            format!("select case when is_called then last_value else last_value - 1 end from {sequence}");
        return built(last).build().scalar(source).await;
    }
    if is_counted(source, table).await? {
        let last = query("select seq from sqlite_sequence where name = ?").bind(&table.name);
        return Ok(last.optional_scalar(source).await?.unwrap_or(0));
    }
    let greatest = format!("select coalesce(max({}), 0) from {}", quoted(column), table.quoted());
    built(greatest).build().scalar(source).await
}

/// Whether SQLite keeps the last number of a table.
async fn is_counted(sqlite: &mut Transaction<'_>, table: &Table) -> Result<bool, sqlx::Error> {
    let text = "select sql like '%autoincrement%' from sqlite_schema where type = 'table' and name = ?";
    query(text).bind(&table.name).scalar(sqlite).await
}

fn built(text: impl Into<String>) -> QueryBuilder {
    QueryBuilder::new(&text.into())
}
